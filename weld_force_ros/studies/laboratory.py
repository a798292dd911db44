"""What the paper's studies share: its welds, tracks and wheel, and passages over them.

A study asks a `Laboratory` for passages and gives an `Investigation` back. A laboratory may be given another weld or
track; then the study shows those, and says nothing about the paper.
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
from weld_force_ros.physics.passage.passage import History, Rig
from weld_force_ros.physics.passage.peak_map import Surface
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import Trajectory, wheel_trajectory
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies.tables import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BILBAO, CONTINUOUS, JOHANSSON_NIELSEN = "bilbao", "bilbao-continuous", "johansson-nielsen"
DIP_48, DIP_96, RISE_48, FLAT = "cosine-dip-48mm", "cosine-dip-96mm", "cosine-rise-48mm", "wheel-flat-0.9mm"
WELDS = (
    "weld-1-dip",
    "weld-2-rise-between-shrinkages",
    "weld-3-long-ground-dip",
    "weld-4-steep-ramp",
    "weld-5-ramp-protrusion",
)

Measured = dict[str, float | bool | list[float]]


@dataclass(frozen=True)
class Picture:
    """A figure with what is to be seen in it."""

    name: str
    title: str
    caption: str
    figure: "Figure"


@dataclass(frozen=True)
class Investigation:
    """What a study gives: pictures, data, and the quantities that the paper's claims are held against."""

    name: str
    title: str
    pictures: list[Picture]
    tables: dict[str, Table]
    measured: Measured = field(default_factory=dict)


@dataclass(frozen=True)
class Laboratory:
    """Passages for studies.

    Attributes:
        own_weld: to be studied instead of the paper's.
        own_track: name or file of a track to be used instead of the paper's.
        coarse: every third speed and position, to see whether a study works.
    """

    own_weld: WeldProfile | None = None
    own_track: str | None = None
    coarse: bool = False

    @property
    def papers(self) -> bool:
        """Whether what is found may be held against the paper."""
        return self.own_weld is None and self.own_track is None

    def welds(self, *names: str) -> list[str]:
        """The welds to study: the paper's, or the user's own one."""
        return list(names) if self.own_weld is None else [self.own_weld.weld_id]

    def track(self, name: str) -> TrackDefinition:
        """A track of the paper, or the user's own in its place.

        Raises:
            TrackError: a track file that cannot be used.
        """
        return self._definition(self.own_track or name)

    def rig(self, track: str, *, hertz_n_per_m15: float | None = None) -> Rig:
        """Track and wheel, ready to roll; with another contact stiffness if given."""
        definition = self.track(track)
        wheel = definition.wheel
        if hertz_n_per_m15 is not None:
            wheel = replace(wheel, hertz_n_per_m15=hertz_n_per_m15)
        return self._rig(definition, wheel)

    def weld(self, name: str) -> WeldProfile:
        """A shipped profile by name, or the user's own."""
        if self.own_weld is not None and name == self.own_weld.weld_id:
            return self.own_weld
        return profile_file.read_profile(profile_file.find(name))

    def trajectory(self, weld: str | tuple[FloatArray, FloatArray], track: str) -> Trajectory:
        """The wheel centre's way over a weld: a name, or positions and heights in m."""
        radius_m = self.track(track).wheel.radius_m
        if isinstance(weld, str):
            profile = self.weld(weld)
            weld = np.array(profile.x_m), np.array(profile.z_m)
        return wheel_trajectory(*weld, radius_m)

    def surface(
        self,
        weld: str | tuple[FloatArray, FloatArray],
        track: str,
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        hertz_n_per_m15: float | None = None,
    ) -> Surface:
        """Peaks at every speed and position, each (n_speed, n_position)."""
        rig = self.rig(track, hertz_n_per_m15=hertz_n_per_m15)
        return rig.surface(self.trajectory(weld, track), speeds_kmh, positions_m)

    def history(
        self, weld: str | tuple[FloatArray, FloatArray], track: str, speed_kmh: float, position_m: float
    ) -> History:
        """One passage, from a span before the weld to two spans behind it."""
        trajectory = self.trajectory(weld, track)
        rig = self.rig(track)
        until_m = position_m + trajectory.end_m + 2 * rig.model.spacing_m
        return rig.history(trajectory, speed_kmh, position_m, until_m=until_m)

    def smooth_rail(self, track: str, speed_kmh: float, spans: int) -> History:
        """A passage over rail without a weld, whole spans from a sleeper on."""
        flat = Trajectory(0.0, np.zeros(2))
        rig = self.rig(track)
        return rig.history(flat, speed_kmh, rig.model.spacing_m, until_m=spans * rig.model.spacing_m)

    def speeds(self, first_kmh: float, last_kmh: float, step_kmh: float) -> FloatArray:
        """A grid of speeds, both ends in it."""
        return self._thinned(np.arange(first_kmh, last_kmh + 0.5 * step_kmh, step_kmh))

    def positions(self, track: str, count: int = 15) -> FloatArray:
        """Equal steps over the span, from the sleeper on."""
        spacing_m = self.track(track).track.spacing_m
        return self._thinned(np.arange(count) * spacing_m / count)

    def _thinned(self, values: FloatArray) -> FloatArray:
        return values[::3] if self.coarse else values

    @cached_property
    def _definitions(self) -> dict[str, TrackDefinition]:
        return {}

    @cached_property
    def _rigs(self) -> dict[tuple[str, Wheel], Rig]:
        return {}

    def _definition(self, name: str) -> TrackDefinition:
        if name not in self._definitions:
            self._definitions[name] = track_file.load(name)
        return self._definitions[name]

    def _rig(self, definition: TrackDefinition, wheel: Wheel) -> Rig:
        key = (definition.text, wheel)
        if key not in self._rigs:
            self._rigs[key] = Rig(fit_store.fitted(definition).model(), wheel)
        return self._rigs[key]


def as_columns(*columns: ArrayLike) -> list[tuple[float, ...]]:
    """Columns of equal length as a table's rows."""
    return [tuple(float(cell) for cell in row) for row in zip(*map(np.ravel, map(np.asarray, columns)), strict=True)]


def grid_rows(
    speeds_kmh: Sequence[float] | FloatArray, positions_m: Sequence[float] | FloatArray, *values: FloatArray
) -> list[tuple[float, ...]]:
    """Rows of speed, position and values that are (n_speed, n_position) each."""
    speed, position = np.meshgrid(speeds_kmh, positions_m, indexing="ij")
    return as_columns(speed, position, *values)
