"""The speeds that the paper names for its cosine dips, and those that a model of the continuous track gives."""

import gc

import numpy as np

from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.studies import passage_curves
from weld_force_ros.studies.result_table import Column
from weld_force_ros.studies.study_context import CONTINUOUS, DIP_48, DIP_96, StudyContext

PAPERS_KMH = {DIP_48: (53.0, 74.0, 112.0), DIP_96: (107.0, 152.0, 230.0)}
"""First maximum, first and second kink of each dip."""
LABELS = ("first maximum", "first kink", "second kink")
COLUMNS = tuple(
    Column(f"{key}_{dip}_kmh", f"{label}, {dip}, km/h", 1)
    for dip in PAPERS_KMH
    for key, label in zip(("maximum", "first_kink", "second_kink"), LABELS, strict=True)
)
"""A table's columns for them, both dips after each other."""

DipSpeeds = dict[str, tuple[float, float, float]]
"""First maximum, first and second kink over each dip, km/h; NaN where there is none."""

NONE: DipSpeeds = dict.fromkeys(PAPERS_KMH, (np.nan, np.nan, np.nan))


def dip_speeds(context: StudyContext, model: StateModel) -> DipSpeeds:
    """Return what a model of the continuous track gives from 20 to 300 km/h."""
    speeds = context.speeds(20, 300, 1)
    fast, found = VehicleTrackModel(model, context.track(CONTINUOUS).wheel), {}
    for dip in PAPERS_KMH:
        peak_map = fast.peak_map(context.wheel_path(dip, CONTINUOUS), speeds, [0.0])
        maximum, _ = passage_curves.first_maximum(passage_curves.features(speeds, peak_map.peak_force_n[:, 0]))
        found[dip] = (float(maximum), *passage_curves.first_kinks_kmh(speeds, peak_map))
    del fast
    gc.collect()  # it keeps hundreds of megabytes and refers to itself
    return found


def cells(speeds: DipSpeeds) -> tuple[float, ...]:
    """Return the cells of `COLUMNS`."""
    return tuple(speed for dip in PAPERS_KMH for speed in speeds[dip])
