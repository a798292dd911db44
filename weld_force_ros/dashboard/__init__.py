"""The dashboard: the report's page on this machine, fed with what the suite publishes while it does."""

from weld_force_ros.dashboard.board import NEWEST, Board
from weld_force_ros.dashboard.server import Server

__all__ = ["NEWEST", "Board", "Server"]
