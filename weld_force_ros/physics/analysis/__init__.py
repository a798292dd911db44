"""What geometries, forces and force-speed curves say."""
