"""The track in the frequency domain: beams and rails of any section on periodic supports."""
