"""Count missed welds and false alarms on synthetic track: `python -m benchmarks.detection` prints the table.

Each row is 1 km of roughness at a level over the ISO 3095 limit, with a weld about every 20 m: cosine dips or
protrusions of one height, 80 to 500 mm long, or welds of the synthetic population as they are.
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.measurement.roughness import rail_roughness
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.measurement.synthetic_welds import Making, SyntheticWeld, population
from weld_force_ros.measurement.weld_detection import detect

LEVELS_DB = (-6.0, 0.0, 6.0, 10.0)
HEIGHTS_MM = (0.05, 0.1, 0.2, 0.3)
LENGTH_M, STEP_M, SPACING_M = 1000.0, 1e-3, 20.0
HIT_M = 0.5  # a weld is found if something is found so near

FloatArray = NDArray[np.float64]
Weld = Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class Outcome:
    """Welds of a run that were missed, what was found beside them, and the median error of the centres found."""

    welds: int
    missed: int
    false_alarms: int
    centre_error_m: float

    @property
    def missed_share(self) -> float:
        """Share of the welds that was missed."""
        return self.missed / self.welds


def cosine_welds(height_m: float, seed: int, count: int) -> list[Weld]:
    """Return cosine dips (negative heights) or protrusions of random lengths."""
    lengths = np.random.default_rng(seed).uniform(0.08, 0.5, count)
    return [lambda x, length=length: cosine_dip(x, length, -height_m) for length in lengths]  # type: ignore[misc]


def population_welds(making: Making, seed: int, count: int) -> list[Weld]:
    """Return the first welds of one making of the synthetic population."""
    welds = (weld for weld in population(20 * count, seed) if weld.parameters.making == making)

    def shape(weld: SyntheticWeld) -> Weld:
        return lambda x: np.interp(x, weld.x_m, weld.z_m, left=0.0, right=0.0)

    return [shape(weld) for weld in islice(welds, count)]


def detection_outcome(level_db: float, welds: list[Weld], seed: int, length_m: float = LENGTH_M) -> Outcome:
    """Detect welds in rough rail: one in each spacing but the first, anywhere in its middle half."""
    x = STEP_M * np.arange(round(length_m / STEP_M) + 1)
    z = rail_roughness(length_m, STEP_M, seed, level_db)
    shifts = np.random.default_rng(seed).uniform(-SPACING_M / 4, SPACING_M / 4, len(welds))
    centres = SPACING_M * (np.arange(len(welds)) + 1) + shifts
    for centre, weld in zip(centres, welds, strict=True):
        near = slice(round((centre - 1) / STEP_M), round((centre + 1) / STEP_M))
        z[near] += weld(x[near] - centre)
    found = np.array([weld.centre_m for weld in detect(x, z)])
    apart = np.abs(found[:, None] - centres[None, :])
    hits = apart <= HIT_M
    errors = np.where(hits, apart, np.inf).min(axis=0, initial=np.inf)
    caught = np.isfinite(errors)
    return Outcome(
        welds=len(welds),
        missed=int((~caught).sum()),
        false_alarms=int((~hits.any(axis=1)).sum()),
        centre_error_m=float(np.median(errors[caught])) if caught.any() else np.nan,
    )


def main() -> None:
    """Print the table."""
    count = round(LENGTH_M / SPACING_M) - 1
    rows: list[tuple[str, Callable[[int], list[Weld]]]] = [("none", lambda seed: [])]
    for height_mm in HEIGHTS_MM:
        for name, sign in (("dip", -1), ("protrusion", 1)):
            height_m = sign * height_mm * 1e-3
            rows.append((f"{name} {height_mm:g} mm", lambda seed, h=height_m: cosine_welds(h, seed, count)))  # type: ignore[misc]
    makings: tuple[Making, ...] = ("dip", "protrusion", "ground")
    rows.extend((f"population, {m}", lambda seed, m=m: population_welds(m, seed, count)) for m in makings)  # type: ignore[misc]
    head = "".join(f"{f'{level:+g} dB':>22}" for level in LEVELS_DB)
    print(f"{'':22}{head}\n{'weld':22}" + len(LEVELS_DB) * f"{'missed':>8}{'false/km':>9}{'mm':>5}")
    for number, (name, welds) in enumerate(rows):
        cells = ""
        for level in LEVELS_DB:
            seed = 100 * number + round(level) + 10
            outcome = detection_outcome(level, welds(seed), seed)
            missed = f"{100 * outcome.missed_share:.0f} %" if outcome.welds else "-"
            cells += f"{missed:>8}{outcome.false_alarms * 1000 / LENGTH_M:9.0f}{1e3 * outcome.centre_error_m:5.0f}"
        print(f"{name:22}{cells}", flush=True)


if __name__ == "__main__":
    main()
