"""What the paper's words say of the shape of each of its five welds, as conditions on heights.

Ranges of terms do not bring it about by themselves, since a sum of terms may look otherwise than each.
"""

from collections.abc import Callable, Iterator

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies.study_context import Profile
from weld_force_ros.studies.weld_map import upward_ramp

_CENTRAL_M = 0.1
_NEGLIGIBLE = 0.2  # as in claims.yaml
_FIRST_DIP_M, _CLOSE_M = -0.03, 0.025  # cm 47, where the weld's centre is cm 50
_LONG_DIP_M = 0.1  # over half of its depth: much longer than the dip of weld 1


def contradictions(weld: str, profile: Profile) -> int:
    """Return how many conditions a shape does not meet.

    Args:
        weld: `weld-1` to `weld-5`.
        profile: positions from the weld's centre and heights, m.
    """
    return sum(not met for met in _CONDITIONS[weld](*profile))


def _weld_1(x_m: FloatArray, z_m: FloatArray) -> Iterator[bool]:
    # A dip in the central region distinguishes it.
    yield bool(abs(x_m[np.argmin(z_m)]) <= 0.03)
    yield bool(-z_m.min() > z_m.max())


def _weld_2(x_m: FloatArray, z_m: FloatArray) -> Iterator[bool]:
    # A super-elevation in the centre between shrinkages; the first dip is larger, and similar in size to the rise.
    first = int(np.argmin(z_m))
    yield bool(abs(x_m[first] - _FIRST_DIP_M) <= _CLOSE_M)
    rise = first + int(np.argmax(np.where(x_m[first:] <= _CENTRAL_M, z_m[first:], -np.inf)))
    yield bool(z_m[rise] > 0 and z_m[rise:].min() < 0)
    yield bool(0.5 <= -z_m[rise] / z_m[first] <= 2) if z_m[first] else False


def _weld_3(x_m: FloatArray, z_m: FloatArray) -> Iterator[bool]:
    # A dip in the central zone, much longer than that of weld 1, between two protrusions.
    lowest = int(np.argmin(np.where(np.abs(x_m) <= _CENTRAL_M, z_m, np.inf)))
    yield bool(z_m[lowest] < 0)
    yield bool(z_m[:lowest].max() > 0 and z_m[lowest:].max() > 0)
    yield bool(np.sum(z_m < 0.5 * z_m.min()) * (x_m[1] - x_m[0]) >= _LONG_DIP_M)


def _weld_4(x_m: FloatArray, z_m: FloatArray) -> Iterator[bool]:
    # A steep ramp at the beginning, and no dip, or one that is negligible.
    steps_m = np.diff(z_m)
    yield bool(-z_m.min() < _NEGLIGIBLE * z_m.max())
    yield bool(steps_m.max() > -steps_m.min() and x_m[np.argmax(steps_m)] < -_CENTRAL_M)


def _weld_5(x_m: FloatArray, z_m: FloatArray) -> Iterator[bool]:
    # A ramp at the beginning, a protrusion at the centre, and dips that are not significant compared to it.
    yield bool(-z_m.min() < _NEGLIGIBLE * z_m.max())
    yield bool(upward_ramp((x_m, z_m))[1] < -_CENTRAL_M)
    yield bool(z_m[np.abs(x_m) <= _CENTRAL_M].max() > _NEGLIGIBLE * z_m.max())


_CONDITIONS: dict[str, Callable[[FloatArray, FloatArray], Iterator[bool]]] = {
    "weld-1": _weld_1,
    "weld-2": _weld_2,
    "weld-3": _weld_3,
    "weld-4": _weld_4,
    "weld-5": _weld_5,
}
