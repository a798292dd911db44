"""Set the environment variables that rclpy from PyPI needs before it starts, and check what it comes with."""

import io
import os
import sys
from collections.abc import Iterable
from contextlib import redirect_stderr, suppress
from importlib import import_module
from pathlib import Path

import numpy as np
import platformdirs

from weld_force_ros.errors import InputError

LOCALHOST_ONLY = "LOCALHOST"

_MESSAGE_PACKAGES = ("std_msgs", "geometry_msgs", "sensor_msgs", "diagnostic_msgs")


def prepare() -> None:
    """Set what is missing for rclpy: where package shares are and where logs go. The user's own values stay."""
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if "ROS_LOG_DIR" not in os.environ and "ROS_HOME" not in os.environ:
        folder = Path(platformdirs.user_log_dir("weld_force_ros", appauthor=False))
        with suppress(OSError):  # then ROS decides
            folder.mkdir(parents=True, exist_ok=True)
            os.environ["ROS_LOG_DIR"] = str(folder)


def check_message_extensions(packages: Iterable[str] = _MESSAGE_PACKAGES) -> None:
    """Load the compiled parts of ROS messages, which are built against one major version of NumPy.

    Those of Ubuntu 24.04 are built against NumPy 1; rclpy itself says no more than that a type support is missing.

    Raises:
        InputError: they do not fit the NumPy that is imported, or are not there.
    """
    for package in packages:
        try:
            with redirect_stderr(io.StringIO()):  # NumPy explains itself there in forty lines
                import_module(f"{package}.{package}_s__rosidl_typesupport_c")
        except (ImportError, AttributeError, SystemError) as error:
            raise InputError(
                f"the message extensions of ROS ({package}) do not fit NumPy {np.__version__} in {sys.prefix}: "
                f"{' '.join(str(error).split())}",
                "with ROS from apt: `pip uninstall numpy` in a venv with --system-site-packages, so that apt's is used "
                "(docs/ros-from-apt.md)",
            ) from None


def stay_on_this_machine() -> None:
    """Keep discovery to this machine, unless the user chose a range."""
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", LOCALHOST_ONLY)


def use_own_domain() -> None:
    """Stay on this machine, in a ROS domain of this process unless the user chose one: two demos do not mix."""
    stay_on_this_machine()
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))
