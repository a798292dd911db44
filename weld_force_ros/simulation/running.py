"""Run over a weld in either direction: against rising x is with it over the mirror image.

The track is the same on either side of a sleeper. So a passage against rising x over a weld at a position p is one with
rising x over the mirrored weld at span - p. Where a few supports differ, the track's mirror image lies further along,
and it is one at `opposite_m` - p (`weld_force_ros.physics.engines.window_fit`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from msgspec import UnsetType
from msgspec.structs import replace as changed

from weld_force_ros.messages import Direction, Running, SimulationSettings, WeldProfile, mirrored_support
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.wheel_path import WheelPath

DIRECTIONS: Final[tuple[Direction, ...]] = ("with", "against")


_WORDS = {
    "with": "towards rising x",
    "against": "against rising x",
    "both": "in both directions",
}


def stated_running(profile: WeldProfile, settings: SimulationSettings) -> Running | UnsetType:
    """Return in which direction trains run: as the profile states it, else the settings; unset if neither does."""
    return settings.running if isinstance(profile.running, UnsetType) else profile.running


def directions(running: Running | UnsetType) -> tuple[Direction, ...]:
    """Return the directions of passages; with rising x if nothing is stated."""
    if isinstance(running, UnsetType):
        return ("with",)
    return DIRECTIONS if running == "both" else (running,)


@dataclass(frozen=True)
class Run:
    """Passages in one direction, as passages with rising x.

    Attributes:
        direction: of the passages.
        opposite_m: what a place is met at against rising x, plus the place.
    """

    direction: Direction
    opposite_m: float

    def path(self, wheel_path: WheelPath) -> WheelPath:
        """Return the wheel's path as it is met."""
        return wheel_path.mirrored if self.direction == "against" else wheel_path

    def places(self, x_m: FloatArray) -> FloatArray:
        """Return places along rising x from those of a passage, or the other way round."""
        return x_m if self.direction == "with" else np.asarray(self.opposite_m - x_m)

    def place(self, x_m: float) -> float:
        """Return one place as `places` does."""
        return x_m if self.direction == "with" else self.opposite_m - x_m


def directed_runs(running: Running | UnsetType, opposite_m: float) -> list[Run]:
    """Return the passages that are simulated, in each direction; `opposite_m` as of `Run`."""
    return [Run(direction, opposite_m) for direction in directions(running)]


def direction_in_words(running: Running | UnsetType) -> str:
    """Return a direction as people read it; nothing if it is not known."""
    return "" if isinstance(running, UnsetType) else _WORDS[running]


def drawn_alike(profile: WeldProfile, draw: Callable[[WeldProfile], FloatArray]) -> FloatArray:
    """Return samples of a profile's geometry, (n_sample, n), that are mirrored where the profile is.

    Of profile and mirror image the one whose heights compare smaller is drawn from.
    """
    image = mirror_image(profile)
    if (image.z_m, image.x_m) < (profile.z_m, profile.x_m):
        return draw(image)[:, ::-1]
    return draw(profile)


def mirror_image(profile: WeldProfile) -> WeldProfile:
    """Return a profile as it is met in the opposite direction: its samples, measured ones and wrong ones mirrored."""
    noise = profile.noise
    if not isinstance(noise, UnsetType):
        noise = changed(noise, outliers_m=_negated(noise.outliers_m))
    return changed(
        profile,
        x_m=_negated(profile.x_m),
        z_m=profile.z_m[::-1],
        measured_x_m=_of_known(_negated, profile.measured_x_m),
        measured_z_m=_of_known(_reversed, profile.measured_z_m),
        noise=noise,
        support=profile.support if isinstance(profile.support, UnsetType) else mirrored_support(profile.support),
    )


def _negated(values: Sequence[float]) -> list[float]:
    return [0.0 - value for value in reversed(values)]  # no -0.0


def _reversed(values: Sequence[float]) -> list[float]:
    return list(reversed(values))


def _of_known(
    turn: Callable[[Sequence[float]], list[float]], values: list[float] | UnsetType
) -> list[float] | UnsetType:
    return values if isinstance(values, UnsetType) else turn(values)
