"""What a contact of 100 instead of 50 GN/m^1.5 changes of the maximum force, over several welds and speeds.

The paper gives one figure, about 10 % of the nominal force, and names neither weld nor speed.
"""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.studies import passage_curves
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import CONTINUOUS, DIP_48, DIP_96, RISE_48, WELDS, StudyContext

SHAPES = (DIP_48, DIP_96, RISE_48, WELDS[0], WELDS[3])
SOFT_N_PER_M15, STIFF_N_PER_M15 = 50e9, 100e9
_SHOWN_KMH = (100.0, 200.0, 300.0)


@dataclass(frozen=True)
class HertzChange:
    """The change over one weld, from 20 to 300 km/h, relative to the static load.

    Attributes:
        shape: name of the weld.
        speeds_kmh: (n,).
        change: (n,), of the maximum force.
        at_maximum: of the force at the curve's first local maximum; NaN without one.
    """

    shape: str
    speeds_kmh: FloatArray
    change: FloatArray
    at_maximum: float


def hertz_changes(context: StudyContext) -> list[HertzChange]:
    """Roll over each shape with either contact."""
    speeds, found = context.speeds(20, 300, 1), []
    static_n = context.track(CONTINUOUS).wheel.static_load_n
    for shape in SHAPES:
        soft, stiff = (
            context.peak_map(shape, CONTINUOUS, speeds, [0.0], hertz_n_per_m15=hertz).peak_force_n[:, 0]
            for hertz in (SOFT_N_PER_M15, STIFF_N_PER_M15)
        )
        maxima = [passage_curves.first_maximum(passage_curves.features(speeds, force))[1] for force in (soft, stiff)]
        found.append(HertzChange(shape, speeds, (stiff - soft) / static_n, float(maxima[1] - maxima[0]) / static_n))
    return found


def table(found: list[HertzChange]) -> Table:
    """Return a row a weld, in per cent of the static load."""
    columns = (
        Column("weld", "weld"), Column("at_first_maximum_percent", "at the first maximum, %", 1),
        *(Column(f"at_{v:g}_kmh_percent", f"at {v:g} km/h, %", 1) for v in _SHOWN_KMH),
        Column("mean_percent", "mean over speeds, %", 1), Column("largest_percent", "largest, %", 1),
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = []
    for one in found:
        at = np.interp(_SHOWN_KMH, one.speeds_kmh, one.change)
        cells = (one.at_maximum, *at, one.change.mean(), one.change.max())
        rows.append((one.shape, *(100 * float(cell) for cell in cells)))
    return Table("Change of the maximum force by a contact twice as stiff, per cent of the static load", columns, rows)
