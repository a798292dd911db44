"""What sleepers that bend do to peak forces: those of a bundled track against rigid ones of the same mass."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.track.support import Support
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies.result_table import Column, Table

TRACK = "bending-sleepers"
PADS_N_PER_M = (85e6, 300e6, 1300e6)
# Depth, positive down, and length of a cosine, m.
SHAPES = {
    "dip of 0.5 mm over 500 mm": (0.5e-3, 0.5),
    "dip of 0.2 mm over 200 mm": (0.2e-3, 0.2),
    "rise of 0.2 mm over 120 mm": (-0.2e-3, 0.12),
    "dip of 0.04 mm over 48 mm": (40e-6, 0.048),
}
_GRID_STEP_M = 0.5e-3


@dataclass(frozen=True)
class Change:
    """By how much peak forces differ from those on rigid sleepers, as shares, (n_speed, n_position).

    Attributes:
        pad_n_per_m: stiffness of the pads.
        shape: a key of `SHAPES`.
        share: (n_speed, n_position).
    """

    pad_n_per_m: float
    shape: str
    share: FloatArray


def changes(speeds_kmh: FloatArray, positions: int, *, on_fit: Callable[[str], None] | None = None) -> list[Change]:
    """Compute the changes on pads of `PADS_N_PER_M` over all shapes.

    Args:
        speeds_kmh: (n_speed,).
        positions: equal steps over a span.
        on_fit: called with a line of text if a fit has to be made.
    """
    definition = track_file.load(TRACK)
    at_m = definition.track.spacing_m / positions * np.arange(positions)
    found = []
    for pad_n_per_m in PADS_N_PER_M:
        bends = _on_pads(definition, pad_n_per_m)
        support = bends.track.support
        rigid = _with(bends, Support(support.springs, (support.mass_kg,)), "rigid")
        models = [VehicleTrackModel(fit_store.fitted(one, on_fit=on_fit).model(), one.wheel) for one in (bends, rigid)]
        for shape, (depth_m, length_m) in SHAPES.items():
            x = np.linspace(-length_m / 2, length_m / 2, round(length_m / _GRID_STEP_M) + 1)
            path = wheel_path_over(x, cosine_dip(x, length_m, depth_m), definition.wheel.radius_m)
            own, of_rigid = (model.peak_map(path, speeds_kmh, at_m).peak_force_n for model in models)
            found.append(Change(pad_n_per_m, shape, own / of_rigid - 1))
    return found


def _on_pads(definition: TrackDefinition, pad_n_per_m: float) -> TrackDefinition:
    support = definition.track.support
    pad = support.pad.scaled(pad_n_per_m / support.pad.stiffness_n_per_m)
    return _with(definition, replace(support, springs=(pad, *support.springs[1:])), f"pads {pad_n_per_m / 1e6:g} kN/mm")


def _with(definition: TrackDefinition, support: Support, what: str) -> TrackDefinition:
    track = definition.track
    return replace(definition, track=replace(track, name=f"{track.name}, {what}", support=support))


def table(found: list[Change]) -> Table:
    """Return the least and greatest change, and that of the highest force, a row a pad and shape."""
    rows = [
        (f"{one.pad_n_per_m / 1e6:g}", one.shape, 100 * float(one.share.min()), 100 * float(np.median(one.share)),
         100 * float(one.share.max()))
        for one in found
    ]  # fmt: skip
    return Table(
        f"Change of the peak force by sleepers that bend (track {TRACK}), over all speeds and places",
        (
            Column("pad_kn_per_mm", "pads, kN/mm"), Column("shape", "weld"), Column("least_percent", "from, %", 1),
            Column("median_percent", "median, %", 1), Column("most_percent", "to, %", 1),
        ),
        rows,
    )  # fmt: skip
