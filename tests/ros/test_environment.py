"""What ROS starts with: wrong values are said in one line, missing ones do not matter."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.ros import environment
from weld_force_ros.ros.environment import check_message_extensions

LOG_VARIABLES = ("ROS_LOG_DIR", "ROS_HOME")


@pytest.mark.parametrize(
    ("name", "value", "reason", "remedy"),
    [
        ("ROS_DOMAIN_ID", "300", "ROS_DOMAIN_ID is '300'", "0 to 232"),
        ("ROS_DOMAIN_ID", "-1", "ROS_DOMAIN_ID is '-1'", "0 to 232"),
        ("ROS_DOMAIN_ID", "lab", "ROS_DOMAIN_ID is 'lab'", "0 to 232"),
        ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp", "which is not installed", "rmw_fastrtps_cpp"),
        ("RMW_IMPLEMENTATION", "rmw_zenoh_cpp", "which is not installed", "rmw_fastrtps_cpp"),
        ("ROS_LOG_DIR", "/proc/nowhere", "no logs can be written to /proc/nowhere", "name another"),
        ("ROS_HOME", "/proc/nowhere", "no logs can be written to /proc/nowhere/log", "name another"),
    ],
)
def test_what_ros_cannot_start_with_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, name: str, value: str, reason: str, remedy: str
) -> None:
    for variable in LOG_VARIABLES:
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.setenv(name, value)
    with pytest.raises(InputError) as caught:
        environment.prepare()
    assert reason in caught.value.reason
    assert remedy in caught.value.remedy
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", ["0", "232", ""])
def test_domains_that_there_are_are_taken(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", value)
    environment.prepare()


@pytest.mark.slow
@pytest.mark.parametrize("home", [None, "/proc/1/nowhere"], ids=["none", "read-only"])
def test_a_home_that_is_read_only_or_none_keeps_no_node_from_starting(
    domain_id: int, tmp_path: Path, home: str | None
) -> None:
    """As the settings of a service or a container leave it."""
    without = (*LOG_VARIABLES, "HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME")
    given = {name: value for name, value in os.environ.items() if name not in without}
    given |= {"HOME": home} if home else {}
    script = (
        "import os\n"
        "from weld_force_ros.ros.node_suite import NodeSuite\n"
        f"with NodeSuite(('profile',), parameters={{'profile': {{'folder': {str(tmp_path)!r}}}}}) as suite:\n"
        "    print(os.environ['ROS_LOG_DIR'], suite.nodes['profile'].active)\n"
    )
    done = subprocess.run([sys.executable, "-c", script], env=given, capture_output=True, text=True, timeout=120)
    folder, active = done.stdout.split()
    assert (done.returncode, active, "Traceback" in done.stderr) == (0, "True", False)
    assert any(Path(folder).iterdir())


def test_extensions_that_are_there_fit() -> None:
    check_message_extensions()
    assert "sensor_msgs.sensor_msgs_s__rosidl_typesupport_c" in sys.modules


@pytest.mark.parametrize(
    "failing",
    [
        "import sys; sys.stderr.write('A module that was compiled using NumPy 1.x\\n' * 40)\n"
        "raise ImportError('numpy.core.multiarray failed to import')",
        "raise AttributeError('_ARRAY_API not found')",
        "raise SystemError('initialization of the module raised\\nunreported exception')",
    ],
)
def test_extensions_built_against_another_numpy_are_one_line(
    failing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "old_msgs").mkdir()
    (tmp_path / "old_msgs" / "old_msgs_s__rosidl_typesupport_c.py").write_text(failing)
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(InputError, match=r"message extensions of ROS \(old_msgs\) do not fit NumPy") as refused:
        check_message_extensions(("old_msgs",))
    assert np.__version__ in str(refused.value)
    assert "pip uninstall numpy" in str(refused.value)
    assert "\n" not in str(refused.value)
    assert capfd.readouterr() == ("", "")
    sys.modules.pop("old_msgs", None)
