"""From a track file and a weld profile to its force map: settings, fits, simulator, uncertainty."""
