"""Set the environment variables that rclpy from PyPI needs before it starts."""

import os
import sys
from contextlib import suppress
from pathlib import Path

import platformdirs

LOCALHOST_ONLY = "LOCALHOST"


def prepare() -> None:
    """Set what is missing for rclpy: where package shares are and where logs go. The user's own values stay."""
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "ROS_LOG_DIR" not in os.environ and "ROS_HOME" not in os.environ:
        folder = Path(platformdirs.user_log_dir("weld_force_ros", appauthor=False))
        with suppress(OSError):  # then ROS decides
            folder.mkdir(parents=True, exist_ok=True)
            os.environ["ROS_LOG_DIR"] = str(folder)


def stay_on_this_machine() -> None:
    """Keep discovery to this machine, unless the user chose a range."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", LOCALHOST_ONLY)


def use_own_domain() -> None:
    """Stay on this machine, in a ROS domain of this process unless the user chose one: two demos do not mix."""
    stay_on_this_machine()
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
