"""Wheel-rail contact forces over measured rail welds: simulate every speed and position, judge, record to MCAP."""

__version__ = "0.1.0"
SOFTWARE = f"weld_force_ros {__version__}"
"""What verdicts, plans and studies name as the software that made them."""
