"""Simulate a measuring trolley on a synthetic rail: rough, with welds at known places, all from one seed."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.roughness import rail_roughness
from weld_force_ros.measurement.synthetic_welds import SyntheticWeld, population
from weld_force_ros.physics.arrays import FloatArray

SPACING_M = 18.0
STEP_M = 1e-3
BACK_M = 2.0
LEVEL_DB = -6.0

_BLOCK_M = 100.0
_KEPT_BLOCKS = 4
_MARGIN_M = 2.0  # of rail after the last weld, so that its whole window is measured


@dataclass(frozen=True)
class PlacedWeld:
    """A weld in the rail, its centre at a chainage in m."""

    chainage_m: float
    weld: SyntheticWeld

    @property
    def weld_id(self) -> str:
        """Name of the weld."""
        return self.weld.weld_id


class SyntheticRail:
    """A rail of which every height is known: roughness to ISO 3095 level and welds of the synthetic population.

    Args:
        length_m: from its first chainage to its last.
        seed: the same seed gives the same rail.
        first_m: chainage where it begins.
        spacing_m: from weld to weld; the first one stands so far from the beginning.
        level_db: of the roughness over the ISO 3095 limit.

    Raises:
        InputError: a rail that cannot be.
    """

    def __init__(
        self,
        length_m: float,
        seed: int,
        *,
        first_m: float = 12_000.0,
        spacing_m: float = SPACING_M,
        level_db: float = LEVEL_DB,
    ) -> None:
        if not (0 < length_m < 1e7 and abs(first_m) < 1e7 and spacing_m >= 1.0 and seed >= 0 and abs(level_db) < 100):
            raise InputError(
                f"no rail of {length_m:g} m from {first_m:g} m, welds {spacing_m:g} m apart, seed {seed}, "
                f"{level_db:g} dB can be made",
                "give lengths over 0, welds 1 m apart or more, and a seed from 0 on",
            )
        self.first_m, self.length_m = first_m, length_m
        self._spacing_m, self._seed, self._level_db = spacing_m, seed, level_db
        count = max(int((length_m - _MARGIN_M) // spacing_m), 0)
        self.welds = tuple(
            PlacedWeld(first_m + spacing_m * number, weld)
            for number, weld in enumerate(population(count, seed), start=1)
        )
        self._block = lru_cache(_KEPT_BLOCKS)(self._rough)

    def height_m(self, chainage_m: FloatArray) -> FloatArray:
        """Return heights at places of the rail, positive up, (n,)."""
        along_m = chainage_m - self.first_m
        height = self._roughness(along_m)
        if self.welds:
            nearest = np.clip(np.round(along_m / self._spacing_m).astype(np.int64), 1, len(self.welds))
            for number in np.unique(nearest).tolist():
                placed, here = self.welds[number - 1], nearest == number
                x, z = placed.weld.x_m, placed.weld.z_m
                height[here] += np.interp(chainage_m[here] - placed.chainage_m, x, z, left=0.0, right=0.0)
        return height

    def _roughness(self, along_m: FloatArray) -> FloatArray:
        """Return the sum of blocks that half overlap, faded by sine and cosine: the variance is the same everywhere."""
        half_m = _BLOCK_M / 2
        height = np.zeros(len(along_m))
        number = np.floor(along_m / half_m).astype(np.int64)
        for first in np.unique(number).tolist():
            here = number == first
            for block in (first - 1, first):
                within_m = along_m[here] - half_m * block
                height[here] += np.sin(np.pi * within_m / _BLOCK_M) * _interpolated(self._block(block), within_m)
        return height

    def _rough(self, block: int) -> FloatArray:
        seed = int(np.random.SeedSequence([self._seed, abs(block), int(block < 0)]).generate_state(1)[0])
        return rail_roughness(_BLOCK_M, STEP_M, seed, self._level_db)


def _interpolated(heights_m: FloatArray, along_m: FloatArray) -> FloatArray:
    """Interpolate heights `STEP_M` apart by straight lines: `numpy.interp` would look at all of them each time."""
    before = np.clip((along_m / STEP_M).astype(np.int64), 0, len(heights_m) - 2)
    share = along_m / STEP_M - before
    between: FloatArray = heights_m[before] + share * (heights_m[before + 1] - heights_m[before])
    return between


@dataclass(frozen=True)
class Handling:
    """Motion of the trolley, and errors of its instruments.

    Attributes:
        speed_m_per_s: along its way.
        batch_s: of samples that are sent together.
        overlap: samples of a batch that are sent again with the next one.
        turn_every_m: of rail after which it goes back `BACK_M` and over it again; infinite: never.
        lost_share: of batches that never arrive.
        noise_m: standard deviation of the height.
        jitter_m: standard deviation of the chainage.
    """

    speed_m_per_s: float = 1.2
    batch_s: float = 0.1
    overlap: int = 20
    turn_every_m: float = 25.0
    lost_share: float = 0.0
    noise_m: float = 1e-6
    jitter_m: float = 0.1e-3


@dataclass(frozen=True)
class SampleBatch:
    """Samples that are sent together, in the order measured.

    Attributes:
        at_s: when the last one was measured, from the start of the run.
        chainage_m: (n,).
        height_m: (n,), positive up.
        weld: the one that the trolley stands over, for the first time, with the last sample.
    """

    at_s: float
    chainage_m: FloatArray
    height_m: FloatArray
    weld: PlacedWeld | None


def run(rail: SyntheticRail, seed: int, handling: Handling | None = None) -> Iterator[SampleBatch]:
    """Yield the batches of a trolley that goes along a whole rail, a sample every `STEP_M` of its way.

    Raises:
        InputError: a handling that gets the trolley nowhere.
    """
    handling = handling or Handling()
    if not (handling.speed_m_per_s > 0 and handling.batch_s > 0 and handling.turn_every_m > BACK_M):
        raise InputError(
            f"a trolley does not get on at {handling.speed_m_per_s:g} m/s, in batches of {handling.batch_s:g} s, "
            f"turning every {handling.turn_every_m:g} m",
            f"give numbers over 0, and {BACK_M:g} m between turns",
        )
    return _batches(rail, np.random.default_rng(seed), handling)


def _batches(rail: SyntheticRail, generator: np.random.Generator, handling: Handling) -> Iterator[SampleBatch]:
    way = _Route(rail.length_m, handling.turn_every_m)
    welds = {way.first_reached(placed.chainage_m - rail.first_m): placed for placed in rail.welds}
    again = (np.empty(0), np.empty(0))
    for first, last in _stops(way.steps, handling.speed_m_per_s * handling.batch_s, sorted(welds)):
        true_m = rail.first_m + way.along_m(np.arange(first, last + 1))
        count = len(true_m)
        sent_m = true_m + handling.jitter_m * generator.standard_normal(count)
        height_m = rail.height_m(true_m) + handling.noise_m * generator.standard_normal(count)
        chainages, heights = np.concatenate([again[0], sent_m]), np.concatenate([again[1], height_m])
        again = (sent_m[count - min(handling.overlap, count) :], height_m[count - min(handling.overlap, count) :])
        if generator.random() >= handling.lost_share:
            yield SampleBatch(last * STEP_M / handling.speed_m_per_s, chainages, heights, welds.get(last))


class _Route:
    """The trolley's way in steps, back and forth along the rail."""

    def __init__(self, length_m: float, turn_every_m: float) -> None:
        turns = [turn_every_m * number for number in range(1, int(np.ceil(length_m / turn_every_m)))]
        self._places_m = np.concatenate(
            [[0.0], [place for turn in turns for place in (turn, turn - BACK_M)], [length_m]]
        )
        self._gone_m = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(self._places_m)))])
        self.steps = round(float(self._gone_m[-1]) / STEP_M)

    def along_m(self, steps: NDArray[np.int64]) -> FloatArray:
        """Return the place along the rail after so many steps, (n,)."""
        return np.asarray(np.interp(STEP_M * steps, self._gone_m, self._places_m))

    def first_reached(self, along_m: float) -> int:
        """Return the step at which a place is reached for the first time."""
        turn = int(np.argmax(self._places_m >= along_m))
        return round(float(self._gone_m[turn] - (self._places_m[turn] - along_m)) / STEP_M)


def _stops(steps: int, batch_m: float, wanted: list[int]) -> Iterator[tuple[int, int]]:
    """Yield first and last step of each batch; batches end at the `wanted` steps, too."""
    each = max(round(batch_m / STEP_M), 1)
    first = 0
    for last in sorted({*range(each - 1, steps, each), *wanted, steps}):
        yield first, last
        first = last + 1
