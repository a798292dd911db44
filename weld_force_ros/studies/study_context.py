"""The paper's welds, tracks and wheel, and passages over them, which its studies share.

A study asks a `StudyContext` for passages and returns a `StudyResult`. A context may have another weld or track; then
the study shows those, and says nothing about the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.measurement import profile_file
from weld_force_ros.messages import WeldProfile
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.passage import History, VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies.result_table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BILBAO, CONTINUOUS, JOHANSSON_NIELSEN = "bilbao", "bilbao-continuous", "johansson-nielsen"
DIP_48, DIP_96, RISE_48, FLAT = "cosine-dip-48mm", "cosine-dip-96mm", "cosine-rise-48mm", "wheel-flat-0.9mm"
WELDS = tuple(f"weld-{number}" for number in range(1, 6))
"""The paper's welds, as inferred from its text."""

Quantities = dict[str, float | bool | list[float]]
Profile = tuple[FloatArray, FloatArray]
"""Positions from a weld's centre and heights, m, (n,) each."""


@dataclass(frozen=True)
class Picture:
    """A figure with its title and caption."""

    name: str
    title: str
    caption: str
    figure: "Figure"


@dataclass(frozen=True)
class StudyResult:
    """The result of a study: pictures, data, and the quantities with which the paper's claims are compared."""

    name: str
    title: str
    pictures: list[Picture]
    tables: dict[str, Table]
    measured: Quantities = field(default_factory=dict)


@dataclass(frozen=True)
class StudyContext:
    """The inputs of studies, and passages over them.

    Attributes:
        own_weld: weld to study instead of the paper's.
        own_track: name or file of a track to use instead of the paper's.
        coarse: use every third speed and position only, and the longest steps: to see whether a study works.
    """

    own_weld: WeldProfile | None = None
    own_track: str | None = None
    coarse: bool = False

    @property
    def uses_paper_inputs(self) -> bool:
        """Return whether weld and track are the paper's, so that results can be compared with it."""
        return self.own_weld is None and self.own_track is None

    def welds(self, *names: str) -> list[str]:
        """Return the names of the welds to study: the paper's, or the user's own one."""
        return list(names) if self.own_weld is None else [self.own_weld.weld_id]

    def track(self, name: str) -> TrackDefinition:
        """Return a track of the paper, or the user's own in its place.

        Raises:
            TrackError: a track file that cannot be used.
        """
        used = self.own_track or name
        if used not in self._definitions:
            self._definitions[used] = track_file.load(used)
        return self._definitions[used]

    def vehicle_track(self, track: str, *, hertz_n_per_m15: float | None = None) -> VehicleTrackModel:
        """Return the model of wheel and track, with another contact stiffness if given."""
        definition = self.track(track)
        wheel = definition.wheel
        if hertz_n_per_m15 is not None:
            wheel = replace(wheel, hertz_n_per_m15=hertz_n_per_m15)
        key = (definition.text, wheel)
        if key not in self._vehicle_tracks:
            self._vehicle_tracks[key] = VehicleTrackModel(self.model(track), wheel)
        return self._vehicle_tracks[key]

    def model(self, track: str) -> StateModel:
        """Return the fit of a track that passages are computed with."""
        return fit_store.fitted_moving(self.track(track)).model()

    def rfp_error(self, track: str) -> float:
        """Return how far rational fractions of the paper's degrees are from a track, as fits state it."""
        return fit_store.fitted(self.track(track), "rfp").error

    def weld(self, name: str) -> WeldProfile:
        """Return a shipped profile by name, or the user's own."""
        if self.own_weld is not None and name == self.own_weld.weld_id:
            return self.own_weld
        return profile_file.read_profile(profile_file.find(name))

    def profile(self, name: str) -> Profile:
        """Return the samples of a weld by its name."""
        weld = self.weld(name)
        return np.array(weld.x_m), np.array(weld.z_m)

    def wheel_path(self, weld: str | Profile, track: str) -> WheelPath:
        """Return the wheel centre's path over a weld: a name, or positions and heights in m."""
        radius_m = self.track(track).wheel.radius_m
        return wheel_path_over(*(self.profile(weld) if isinstance(weld, str) else weld), radius_m)

    def peak_map(
        self,
        weld: str | Profile,
        track: str,
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        hertz_n_per_m15: float | None = None,
    ) -> PeakMap:
        """Return peaks at every speed and position, each (n_speed, n_position)."""
        vehicle_track = self.vehicle_track(track, hertz_n_per_m15=hertz_n_per_m15)
        return vehicle_track.peak_map(self.wheel_path(weld, track), speeds_kmh, positions_m)

    def history(self, weld: str | Profile, track: str, speed_kmh: float, position_m: float) -> History:
        """Simulate one passage, from a span before the weld to two spans behind it."""
        wheel_path = self.wheel_path(weld, track)
        vehicle_track = self.vehicle_track(track)
        until_m = position_m + wheel_path.end_m + 2 * vehicle_track.model.spacing_m
        stride = self.stride(track, speed_kmh)
        return vehicle_track.history(wheel_path, speed_kmh, position_m, until_m=until_m, stride=stride)

    def smooth_rail(self, track: str, speed_kmh: float, spans: int) -> History:
        """Simulate a passage over rail without a weld, whole spans from a sleeper on."""
        flat = WheelPath(0.0, np.zeros(2))
        vehicle_track = self.vehicle_track(track)
        spacing_m, stride = vehicle_track.model.spacing_m, self.stride(track, speed_kmh)
        return vehicle_track.history(flat, speed_kmh, spacing_m, until_m=spans * spacing_m, stride=stride)

    def stride(self, track: str, speed_kmh: float) -> int:
        """Return in which steps single passages are computed: the shortest, or the longest if coarse."""
        return self.vehicle_track(track).solver.coarsest_stride(speed_kmh) if self.coarse else 1

    def speeds(self, first_kmh: float, last_kmh: float, step_kmh: float) -> FloatArray:
        """Return a grid of speeds with both ends."""
        return self._thinned(np.arange(first_kmh, last_kmh + 0.5 * step_kmh, step_kmh))

    def positions(self, track: str, count: int = 15) -> FloatArray:
        """Return positions in equal steps over the span, from the sleeper on."""
        spacing_m = self.track(track).track.spacing_m
        return self._thinned(np.arange(count) * spacing_m / count)

    def _thinned(self, values: FloatArray) -> FloatArray:
        return values[::3] if self.coarse else values

    @cached_property
    def _definitions(self) -> dict[str, TrackDefinition]:
        return {}

    @cached_property
    def _vehicle_tracks(self) -> dict[tuple[str, Wheel], VehicleTrackModel]:
        return {}


def as_rows(*columns: ArrayLike) -> list[tuple[float, ...]]:
    """Return columns of equal length as a table's rows."""
    return [tuple(float(cell) for cell in row) for row in zip(*map(np.ravel, map(np.asarray, columns)), strict=True)]


def grid_rows(
    speeds_kmh: Sequence[float] | FloatArray, positions_m: Sequence[float] | FloatArray, *values: FloatArray
) -> list[tuple[float, ...]]:
    """Return rows of speed, position and values that are (n_speed, n_position) each."""
    speed, position = np.meshgrid(speeds_kmh, positions_m, indexing="ij")
    return as_rows(speed, position, *values)
