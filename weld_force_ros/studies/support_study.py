"""Study `support`: what one and two hanging sleepers do over speed and place, and what sleepers that bend do."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.messages import HANGING_SHARE
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.report.figures import new_figure
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies import StartProgress, bending_sleepers, no_progress
from weld_force_ros.studies.figure_style import COLOURS, legend_above
from weld_force_ros.studies.result_table import Column, Table
from weld_force_ros.studies.study_context import Picture, Quantities, StudyResult, grid_rows

TRACKS = ("bilbao-viscous", "johansson-nielsen")
SUPPORTS = {
    "all rest": LocalSupports(()),
    "the sleeper before the weld hangs": LocalSupports.of([SupportChange(0, HANGING_SHARE)]),
    "both sleepers beside the weld hang": LocalSupports.of(
        [SupportChange(0, HANGING_SHARE), SupportChange(1, HANGING_SHARE)]
    ),
}
SHAPES = {"dip of 0.2 mm over 200 mm": (0.2e-3, 0.2), "rise of 0.2 mm over 120 mm": (-0.2e-3, 0.12)}
_GRID_STEP_M = 0.5e-3


@dataclass(frozen=True)
class _Track:
    """A track, with a model for each support of `SUPPORTS`."""

    definition: TrackDefinition
    models: list[VehicleTrackModel]


def run(
    *,
    coarse: bool = False,
    start_progress: StartProgress = no_progress,
    on_fit: Callable[[str], None] = lambda text: None,
) -> StudyResult:
    """Compute peak forces with sleepers at rest, one and two hanging, and with sleepers that bend and rigid ones.

    Args:
        coarse: a third of the speeds and positions.
        start_progress: called with what is done and in how many steps.
        on_fit: called with a line of text if a fit has to be made.
    """
    speeds_kmh = np.arange(40.0, 301.0, 20.0 if coarse else 5.0)
    done = start_progress("tracks", len(TRACKS) + 1)
    pictures: list[Picture] = []
    tables: dict[str, Table] = {}
    measured: Quantities = {}
    for name in TRACKS:
        track = _track(name, on_fit)
        at_m = track.definition.track.spacing_m * np.linspace(0.0, 1.0, 7 if coarse else 17)
        for number, (shape, (depth_m, length_m)) in enumerate(SHAPES.items(), start=1):
            peaks = _peaks(track, depth_m, length_m, speeds_kmh, at_m)
            key = f"{name}-{'dip' if number == 1 else 'rise'}"
            pictures.append(_picture(key, f"{name}, {shape}", speeds_kmh, at_m, peaks))
            tables[key] = _table(f"Peak force, {name}, {shape}", speeds_kmh, at_m, peaks)
            for count, more in zip(("one", "two"), peaks[1:] / peaks[0] - 1, strict=True):
                measured[f"support.{key}.{count}.least"] = float(more.min())
                measured[f"support.{key}.{count}.most"] = float(more.max())
        done()
    bending = bending_sleepers.changes(speeds_kmh, 7 if coarse else 16, on_fit=on_fit)
    done()
    tables["bending-sleepers"] = bending_sleepers.table(bending)
    return StudyResult("support", "Supports", pictures, tables, measured)


def _track(name: str, on_fit: Callable[[str], None]) -> _Track:
    definition = track_file.load(name)
    fits = [
        fit_store.fitted_window(definition, supports, on_fit=on_fit)
        if supports.changes
        else fit_store.fitted(definition, on_fit=on_fit)
        for supports in SUPPORTS.values()
    ]
    return _Track(definition, [VehicleTrackModel(fit.model(), definition.wheel) for fit in fits])


def _peaks(track: _Track, depth_m: float, length_m: float, speeds_kmh: FloatArray, at_m: FloatArray) -> FloatArray:
    """Return peak forces (n_support, n_speed, n_position), N."""
    x = np.linspace(-length_m / 2, length_m / 2, round(length_m / _GRID_STEP_M) + 1)
    path = wheel_path_over(x, cosine_dip(x, length_m, depth_m), track.definition.wheel.radius_m)
    return np.stack([model.peak_map(path, speeds_kmh, at_m).peak_force_n for model in track.models])


def _picture(name: str, title: str, speeds_kmh: FloatArray, at_m: FloatArray, peaks: FloatArray) -> Picture:
    changes = 100 * (peaks[1:] / peaks[0] - 1)
    figure = new_figure(9.0, 3.6)
    curves, one, two = figure.subplots(1, 3, width_ratios=[1.3, 1, 1])
    for label, own, colour in zip(SUPPORTS, peaks, COLOURS, strict=False):
        curves.plot(speeds_kmh, own.max(axis=1) / 1e3, color=colour, label=label)
    curves.set(xlabel="speed, km/h", ylabel="highest peak force\nwherever the weld lies, kN")
    most = float(np.abs(changes).max())
    for axes, change, words in zip((one, two), changes, ("one hangs", "two hang"), strict=True):
        image = axes.pcolormesh(at_m * 100, speeds_kmh, change, shading="gouraud", cmap="RdBu_r", vmin=-most, vmax=most)
        axes.set(xlabel="weld after the sleeper, cm", ylabel="speed, km/h")
        axes.set_title(words, fontsize=10)
    two.set_ylabel("")
    figure.colorbar(image, ax=[one, two], label="change of the peak force, %")
    legend_above(figure, 3, curves)
    return Picture(
        f"support-{name}", title,
        f"One hanging sleeper changes the peak by {changes[0].min():.0f} to {changes[0].max():+.0f} %, two by "
        f"{changes[1].min():.0f} to {changes[1].max():+.0f} %. Left: the highest peak of all places; right: the change"
        " at each place and speed, red where it is worse. The sleeper that hangs in both cases is at 0.",
        figure,
    )  # fmt: skip


def _table(title: str, speeds_kmh: FloatArray, at_m: FloatArray, peaks: FloatArray) -> Table:
    columns = (
        Column("speed_kmh", "km/h", 0), Column("position_m", "m", 4), Column("all_rest_n", "N", 0),
        Column("one_hangs_n", "N", 0), Column("two_hang_n", "N", 0),
    )  # fmt: skip
    return Table(title, columns, grid_rows(speeds_kmh, at_m, *peaks))


def summary(found: StudyResult) -> Table:
    """Return by how much hanging sleepers change the peaks, a row a case."""
    cases = dict.fromkeys(name.rpartition(".")[0] for name in found.measured)
    rows = [
        (
            case.split(".")[1],
            case.split(".")[2],
            100 * float(str(found.measured[f"{case}.least"])),
            100 * float(str(found.measured[f"{case}.most"])),
        )
        for case in cases
    ]
    return Table(
        "Change of the peak force by hanging sleepers, over all speeds and places",
        (
            Column("case", "track and weld"), Column("hanging", "hanging"), Column("least", "from, %", 1),
            Column("most", "to, %", 1),
        ),
        rows,
    )  # fmt: skip
