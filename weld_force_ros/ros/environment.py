"""Check and complete what ROS starts with, its variables and its extensions: what is wrong is said in one line."""

import io
import os
import socket
import sys
import tempfile
from collections.abc import Iterable
from contextlib import redirect_stderr
from importlib import import_module
from pathlib import Path

import platformdirs

from weld_force_ros.errors import InputError

LOCALHOST_ONLY = "LOCALHOST"
_MAX_DOMAIN_ID = 232  # above, the ports of Fast DDS run out

_MESSAGE_PACKAGES = ("std_msgs", "geometry_msgs", "sensor_msgs", "diagnostic_msgs")


def prepare() -> None:
    """Set what is missing for rclpy: where package shares are and where logs go. The user's own values stay.

    Raises:
        InputError: a value with which ROS does not start.
    """
    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    _check_domain()
    _check_middleware()
    _prepare_log_folder()


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
            import numpy as np

            raise InputError(
                f"the message extensions of ROS ({package}) do not fit NumPy {np.__version__} in {sys.prefix}: "
                f"{' '.join(str(error).split())}",
                "with ROS from apt: `pip uninstall numpy` in a venv with --system-site-packages, so that apt's is used "
                "(docs/ros-from-apt.md)",
            ) from None


def stay_on_this_machine() -> None:
    """Keep discovery to this machine, unless the user chose a range, by the older variable or the newer one."""
    if not os.environ.get("ROS_LOCALHOST_ONLY"):
        os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", LOCALHOST_ONLY)


def check_loopback() -> None:
    """Check that processes of this machine can find each other; the nodes of one process need no network.

    Raises:
        InputError: the loopback interface is down.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("127.0.0.1", 7400))
        except OSError as error:
            raise InputError(
                f"the loopback interface cannot be used: {error.strerror}",
                "bring it up (`ip link set lo up`), or leave out --processes",
            ) from None


def use_own_domain() -> None:
    """Stay on this machine, in a ROS domain of this process unless the user chose one: two demos do not mix."""
    stay_on_this_machine()
    os.environ.setdefault("ROS_DOMAIN_ID", str(1 + os.getpid() % 100))


def _check_domain() -> None:
    domain = os.environ.get("ROS_DOMAIN_ID", "")
    if domain and not (domain.isdecimal() and int(domain) <= _MAX_DOMAIN_ID):
        raise InputError(f"ROS_DOMAIN_ID is {domain!r}", f"give a whole number from 0 to {_MAX_DOMAIN_ID}, or unset it")


def _check_middleware() -> None:
    """Look the middleware up where ROS does: once it is loaded, a wrong name ends the process."""
    name = os.environ.get("RMW_IMPLEMENTATION", "")
    folders = [Path(prefix) for prefix in os.environ["AMENT_PREFIX_PATH"].split(os.pathsep)]
    index = Path("share") / "ament_index" / "resource_index" / "rmw_typesupport"
    installed = {file.name for folder in folders for file in (folder / index).glob("rmw_*")} - {"rmw_implementation"}
    if name and installed and name not in installed:
        raise InputError(
            f"RMW_IMPLEMENTATION is {name!r}, which is not installed",
            f"install it, set {' or '.join(sorted(installed))}, or unset it",
        )


def _prepare_log_folder() -> None:
    stated = next((name for name in ("ROS_LOG_DIR", "ROS_HOME") if os.environ.get(name)), None)
    if stated is not None:
        folder = Path(os.environ[stated]).expanduser() / ("log" if stated == "ROS_HOME" else "")
        if (problem := _unwritable(folder)) is not None:
            raise InputError(f"{stated}: no logs can be written to {folder}: {problem}", "name another, or unset it")
        return
    folder = Path(platformdirs.user_log_dir("weld_force_ros", appauthor=False))
    if _unwritable(folder) is not None:  # a home that is read-only, or none
        folder = Path(tempfile.gettempdir()) / f"weld_force_ros-log-{os.getuid()}"
    if _unwritable(folder) is None:
        os.environ["ROS_LOG_DIR"] = str(folder)


def _unwritable(folder: Path) -> str | None:
    """Make a folder and return why nothing can be written to it; None if it can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return None
    except OSError as error:
        return error.strerror or str(error)
