"""What is said before ROS starts if what it comes with does not fit."""

import sys
from pathlib import Path

import numpy as np
import pytest

from weld_force_ros.errors import InputError
from weld_force_ros.ros.environment import check_message_extensions


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
