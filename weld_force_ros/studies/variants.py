"""A weld and its variants: twice as long, or upside down.

The paper compares two lengths of a cosine dip (section 6.1) and a dip with its inverse (section 6.2.2); the same can be
done with any weld.
"""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.studies.study_context import CONTINUOUS, DIP_48, DIP_96, RISE_48, StudyContext


@dataclass(frozen=True)
class Variant:
    """A weld with a name for figures."""

    label: str
    wheel_path: WheelPath


def by_length(context: StudyContext) -> list[Variant]:
    """Return the cosine dips of 48 and 96 mm, or the user's weld as it is and stretched to twice its length."""
    if context.own_weld is None:
        return [_shipped(context, "dip, 48 mm", DIP_48), _shipped(context, "dip, 96 mm", DIP_96)]
    return [_own(context), _own(context, ", twice as long", stretch=2.0)]


def by_sign(context: StudyContext) -> list[Variant]:
    """Return the cosine dip of 48 mm and its inverse, or the user's weld and the same upside down."""
    if context.own_weld is None:
        return [_shipped(context, "dip, 48 mm", DIP_48), _shipped(context, "rise, 48 mm", RISE_48)]
    return [_own(context), _own(context, ", upside down", sign=-1.0)]


def _shipped(context: StudyContext, label: str, name: str) -> Variant:
    return Variant(label, context.wheel_path(name, CONTINUOUS))


def _own(context: StudyContext, how: str = "", *, stretch: float = 1.0, sign: float = 1.0) -> Variant:
    assert context.own_weld is not None  # noqa: S101
    x_m, z_m = np.array(context.own_weld.x_m), np.array(context.own_weld.z_m)
    return Variant(f"{context.own_weld.weld_id}{how}", context.wheel_path((stretch * x_m, sign * z_m), CONTINUOUS))
