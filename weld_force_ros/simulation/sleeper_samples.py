"""Let what lies beneath each sleeper near a weld differ from sleeper to sleeper in the samples of what is uncertain.

To first order: how the worst forces of the nominal geometry, wheel and track change with each sleeper is found once a
weld, from tracks of which that one sleeper is stiffer and softer (exact low-rank change, fitted over a window). A
sample's forces are multiplied by what its own factors make of that, each by itself; what can be zero is moved. Left out
are what two sleepers do together, and that another speed may become the worst, or be it at another position.
"""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from weld_force_ros.messages import Uncertainty, UncertaintyResult, known
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.track.local_support import LocalSupports, SupportChange
from weld_force_ros.simulation import fit_store
from weld_force_ros.simulation.force_map_view import Passages, RelevantMap
from weld_force_ros.simulation.running import Run
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.simulation.uncertainty import standard_levels

SLEEPERS = (-1, 0, 1, 2)
"""Those that are drawn: the two beside the weld and their neighbours; farther ones would add 4 % to their variance."""
_FACTOR = 1.5  # of the stiffer track, far enough for the fits' own errors to count little; the softer has its inverse
_OWN_SEED = 2  # beside that of the other quantities, whose samples stay as they are
_MOVED = ("min_force_n", "contact_loss_s")
_FORCE_DECIMALS, _TIME_DECIMALS, _EFFECT_DECIMALS = 1, 6, 6


def drawn(unknown: Uncertainty) -> FloatArray:
    """Return the logarithm of each sleeper's factor in each sample, (n_sample, n_sleeper), evenly spread (Latin)."""
    random = np.random.default_rng([unknown.seed, _OWN_SEED])
    ranks = np.stack([random.permutation(unknown.samples) for _ in SLEEPERS], axis=1)
    return np.asarray((known(unknown.sleeper_spread) or 0.0) * standard_levels(unknown.samples)[ranks])


class SleeperSensitivities:
    """Finds how the worst forces over welds change with what lies beneath single sleepers, by common poles.

    Args:
        definition: the track.
        wheel: that runs over it.
        on_fit: called with a line of text if a fit has to be made.
        threads: that compute; one a core, if not given.
    """

    def __init__(
        self,
        definition: TrackDefinition,
        wheel: Wheel,
        *,
        on_fit: Callable[[str], None] | None = None,
        threads: int | None = None,
    ) -> None:
        self._definition, self._wheel, self._on_fit, self._threads = definition, wheel, on_fit, threads

    @cached_property
    def _models(self) -> list[StateModel]:
        """Tracks of which one sleeper is softer, then stiffer, in the order of `SLEEPERS`."""
        changes = [SupportChange(sleeper, factor) for sleeper in SLEEPERS for factor in (1 / _FACTOR, _FACTOR)]
        fits = [
            fit_store.fitted_window(self._definition, LocalSupports.of([change]), on_fit=self._on_fit)
            for change in changes
        ]
        return [fit.model() for fit in fits]

    def of(self, wheel_path: WheelPath, relevant: RelevantMap) -> dict[str, FloatArray]:
        """Return the change of each column's worst by the logarithm of each factor, (n_sleeper, n_position).

        Of the logarithm of a column, but for what can be zero: of itself.

        Raises:
            NumericalError: a passage did not stay finite.
        """
        worst = _worst_cells(relevant)
        rows = np.unique([speed for speed, _ in worst.values()])  # few: the tables of every speed take their time
        change, at = 2 * np.log(_FACTOR), np.arange(len(relevant.positions_m))
        found: dict[str, list[FloatArray]] = {name: [] for name in worst}
        for softer, stiffer in zip(self._models[::2], self._models[1::2], strict=True):
            low, high = (self._passages(model, wheel_path, relevant, rows) for model in (softer, stiffer))
            for name, (speed, directions) in worst.items():
                cells = directions, np.searchsorted(rows, speed), at
                before, after = low.columns[name][cells], high.columns[name][cells]
                found[name].append((after - before if name in _MOVED else np.log(after / before)) / change)
        return {name: np.stack(values) for name, values in found.items()}

    def _passages(
        self, model: StateModel, wheel_path: WheelPath, relevant: RelevantMap, rows: NDArray[np.intp]
    ) -> Passages:
        """Return passages at some of the speeds, (n_direction, n_speed, n_position)."""
        # Made anew for every weld: the tables of all would not fit into a small machine's memory.
        track = VehicleTrackModel(model, self._wheel, threads=self._threads)
        runs = [Run(direction, track.opposite_m) for direction in relevant.by_direction]
        peak_maps = track.maps_of_few(
            [run.path(wheel_path) for run in runs],
            relevant.speeds_kmh[rows],
            np.stack([run.places(relevant.positions_m) for run in runs]),
            low_passed=True,
        )
        return Passages.stacked([Passages.of_peak_map(peak_map, self._wheel.static_load_n) for peak_map in peak_maps])


def _worst_cells(relevant: RelevantMap) -> dict[str, tuple[int, NDArray[np.intp]]]:
    """Return of each column where it counts: the speed, and the direction at each position, (n_position,).

    At the speed of the worst of all positions, in the worse direction at each; contact is lost where least force is.
    """
    both, cells = Passages.stacked(list(relevant.by_direction.values())), {}
    for name, values in both.columns.items():
        found = -values if name == "min_force_n" else values
        speed = int(np.unravel_index(found.argmax(), found.shape)[1])
        cells[name] = speed, found[:, speed].argmax(axis=0)
    return cells | {"contact_loss_s": cells["min_force_n"]}


def scattered(
    spread: UncertaintyResult, logarithms: FloatArray, sensitivities: Mapping[str, FloatArray]
) -> UncertaintyResult:
    """Return samples whose sleepers differ from each other.

    Args:
        spread: with all sleepers alike.
        logarithms: (n_sample, n_sleeper), as of `drawn`.
        sensitivities: (n_sleeper, n_position) of each column, as of `SleeperSensitivities`.
    """
    columns: dict[str, Any] = {}
    for name, of_sleepers in sensitivities.items():
        values = np.array(getattr(spread, name)).reshape(len(logarithms), -1)
        change = logarithms @ of_sleepers
        moved = np.maximum(0.0, values + change) if name in _MOVED else values * np.exp(change)
        decimals = _TIME_DECIMALS if name == "contact_loss_s" else _FORCE_DECIMALS
        columns[name] = np.round(moved, decimals).ravel().tolist()
    effect = np.exp(logarithms @ sensitivities["peak_force_n"]).mean(axis=1)
    return changed(spread, sleeper_effect=np.round(effect, _EFFECT_DECIMALS).tolist(), **columns)
