"""What rclpy from PyPI needs in the environment before it starts."""

import os
import sys
from contextlib import suppress
from pathlib import Path

import platformdirs

LOCALHOST_ONLY = "LOCALHOST"


def prepare() -> None:
    """Set what is missing for rclpy: where package shares are and where logs go. What the user set stays."""
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "ROS_LOG_DIR" not in os.environ and "ROS_HOME" not in os.environ:
        folder = Path(platformdirs.user_log_dir("weld_force_ros", appauthor=False))
        with suppress(OSError):  # then ROS decides
            folder.mkdir(parents=True, exist_ok=True)
            os.environ["ROS_LOG_DIR"] = str(folder)


def stay_on_this_machine() -> None:
    """Keep discovery to this machine, unless the user chose a range."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", LOCALHOST_ONLY)
