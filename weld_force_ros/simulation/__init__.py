"""From a track file and a weld profile to its force map: settings, fits, the simulator, samples of what is uncertain."""
