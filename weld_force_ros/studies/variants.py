"""A weld beside its variants: twice as long, or upside down.

The paper compares two lengths of a cosine dip (section 6.1) and a dip with its inverse (section 6.2.2); the same can be
asked of any weld.
"""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.studies.laboratory import CONTINUOUS, DIP_48, DIP_96, RISE_48, StudyContext


@dataclass(frozen=True)
class Variant:
    """A weld with a name for figures."""

    label: str
    wheel_path: WheelPath


def by_length(lab: StudyContext) -> list[Variant]:
    """The cosine dips of 48 and 96 mm, or the user's weld as it is and stretched to twice its length."""
    if lab.own_weld is None:
        return [_shipped(lab, "dip, 48 mm", DIP_48), _shipped(lab, "dip, 96 mm", DIP_96)]
    return [_own(lab), _own(lab, ", twice as long", stretch=2.0)]


def by_sign(lab: StudyContext) -> list[Variant]:
    """The cosine dip of 48 mm and its inverse, or the user's weld and the same upside down."""
    if lab.own_weld is None:
        return [_shipped(lab, "dip, 48 mm", DIP_48), _shipped(lab, "rise, 48 mm", RISE_48)]
    return [_own(lab), _own(lab, ", upside down", sign=-1.0)]


def _shipped(lab: StudyContext, label: str, name: str) -> Variant:
    return Variant(label, lab.wheel_path(name, CONTINUOUS))


def _own(lab: StudyContext, how: str = "", *, stretch: float = 1.0, sign: float = 1.0) -> Variant:
    assert lab.own_weld is not None  # noqa: S101
    x_m, z_m = np.array(lab.own_weld.x_m), np.array(lab.own_weld.z_m)
    return Variant(f"{lab.own_weld.weld_id}{how}", lab.wheel_path((stretch * x_m, sign * z_m), CONTINUOUS))
