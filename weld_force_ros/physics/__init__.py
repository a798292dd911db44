"""The science: receptance of the track, passages of a wheel, what they say. No files, messages, ROS or pictures."""
