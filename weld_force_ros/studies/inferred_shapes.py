"""Shapes of the paper's welds that were searched for without some of its claims, and what is measured over them."""

from collections.abc import Sequence
from importlib import resources

import msgspec
import numpy as np

from weld_force_ros.studies import curve_study, increment_study, map_study, motion_study, spectrum_study
from weld_force_ros.studies.inference import Solution
from weld_force_ros.studies.study_context import WELDS, Quantities, StudyContext
from weld_force_ros.studies.weld_map import weld_maps

FILE = "inferred-shapes.json"


def load() -> list[Solution]:
    """Return the shapes that come with the package: of each weld the one that ships, and one without each fold."""
    data = (resources.files("weld_force_ros") / "data" / FILE).read_bytes()
    return msgspec.json.decode(data, type=list[Solution])


def encoded(shapes: Sequence[Solution]) -> bytes:
    """Return the text of the file from which shapes are loaded."""
    return msgspec.json.format(msgspec.json.encode(shapes), indent=2) + b"\n"


def quantities_without(fold: int, context: StudyContext) -> Quantities:
    """Return what claims on the five welds ask for, over the shapes that were searched for without those of a fold."""
    found = {shape.weld: shape.profile for shape in load() if shape.without_fold == fold}
    welds = {name: found[name] for name in WELDS}
    with np.errstate(all="ignore"):  # a shape without a hollow has no depth
        measured = map_study.quantities_over(context, weld_maps(context, welds))
        for study in (curve_study, motion_study, increment_study, spectrum_study):
            measured |= study.quantities_over_weld_1(context, welds[WELDS[0]])
        return measured | motion_study.quantities_over_weld_5(context, welds[WELDS[4]])
