"""The science: track receptance, fits, passages, verdicts. No ROS, no files, no printing."""
