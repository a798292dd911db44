"""Wheel-rail contact forces over measured rail welds.

The package's root imports nothing: `weld_force_ros.simulation.simulator` holds the one composition from a weld profile to a
verdict, `weld_force_ros.core` the science, `weld_force_ros.ros` the nodes.
"""

__version__ = "0.1.0"
