"""Make a network of synthetic welds, seeded: geometries of `synthetic_welds` along lines with speeds and positions."""

from collections.abc import Iterator

import numpy as np

from weld_force_ros.measurement.synthetic_welds import SyntheticWeld, population
from weld_force_ros.messages import WeldProfile

WELD_SPACING_M = 18.0
STRETCH_WELDS = 250
LINE_SPEEDS_KMH = (120.0, 160.0, 200.0, 250.0)
RAILS = ("left", "right")
_SPAN_M = 0.6
_KNOWN_POSITION = 0.8
_RESOLUTION_DECIMALS = 9  # a trolley's nanometre, so that files are short


def network(count: int, seed: int, first: int = 0) -> Iterator[WeldProfile]:
    """Yield synthetic welds along a line, both rails in turn.

    Every stretch of `STRETCH_WELDS` has a line speed of its own. Four in five have a known position in the sleeper
    span, uniformly distributed. Weld k of a seed is the same in a network of any size.

    Args:
        count: number of welds, with those before `first`.
        seed: seed of the population.
        first: number of the first weld that is yielded.

    Raises:
        InputError: a negative count or seed.
    """
    for number, weld in enumerate(population(count, seed)):
        if number >= first:
            yield _placed(number, weld, seed)


def _placed(number: int, weld: SyntheticWeld, seed: int) -> WeldProfile:
    x_m = np.round(weld.x_m, _RESOLUTION_DECIMALS).tolist()
    z_m = (np.round(weld.z_m, _RESOLUTION_DECIMALS) + 0.0).tolist()
    stretch = np.random.default_rng([seed, 1, number // STRETCH_WELDS])
    place = np.random.default_rng([seed, 2, number])
    profile = WeldProfile(
        weld_id=weld.weld_id,
        source=f"population of seed {seed}",
        x_m=x_m,
        z_m=z_m,
        rail=RAILS[number % len(RAILS)],
        chainage_m=number // len(RAILS) * WELD_SPACING_M,
        line_speed_kmh=float(stretch.choice(LINE_SPEEDS_KMH)),
    )
    if place.random() < _KNOWN_POSITION:
        profile.weld_position_m = round(float(place.uniform(0.0, _SPAN_M)), 3)
    return profile
