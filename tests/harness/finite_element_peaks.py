"""Peaks of the finite elements over tracks, shapes and supports, in a file.

Written by `python -m tests.harness.finite_element_peaks`,
which takes a quarter of an hour on one thread. Each track carries its own wheel.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np

from tests.harness.finite_element_passage import Peak, passage, peak
from tests.harness.finite_elements import AS_BUILT, Supports
from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import track_file

FILE = Path(__file__).parents[1] / "data" / "finite_elements_support.json"
LINEAR = {
    "as built": AS_BUILT,
    "0 hangs": Supports(ballast={0: 0.02}),
    "0 and 1 hang": Supports(ballast={0: 0.02, 1: 0.02}),
    "1 without ballast": Supports(ballast={1: 0.0}),
    "0 and 1 softer": Supports(ballast={0: 0.5, 1: 0.3}),
}
GAPS = {
    "0 over 0.3 mm": Supports(gap_m={0: 0.3e-3}),
    "0 over 0.8 mm": Supports(gap_m={0: 0.8e-3}),
    "0 and 1 over 0.3 mm": Supports(gap_m={0: 0.3e-3, 1: 0.3e-3}),
}
SUPPORTS = LINEAR | GAPS
SHAPES = {"dip": (0.2e-3, 0.2), "rise": (-0.2e-3, 0.12), "smooth": None}
"""Depth and length, m, of one cosine wave about the weld's centre."""
_COLUMNS = ("track", "shape", "supports", "speed_kmh", "position_spans", "peak_n", "peak_m", "least_n")


@dataclass(frozen=True)
class Case:
    """One passage: track and shape and supports by name, and the weld's centre after sleeper 0 in spans."""

    track: str
    shape: str
    supports: str
    speed_kmh: float
    position_spans: float


def wheel_path(shape: str) -> WheelPath | None:
    """Return the wheel centre's path over a shape, for a radius of 0.45 m; None: smooth rail."""
    numbers = SHAPES[shape]
    if numbers is None:
        return None
    depth, length = numbers
    x = np.linspace(-length / 2, length / 2, round(length / 0.5e-3) + 1)
    return wheel_path_over(x, cosine_dip(x, length, depth), 0.45)


def cases() -> Iterator[Case]:
    """Yield what the file holds; smooth rail at one position."""
    tracks = ("bilbao-viscous", "johansson-nielsen")
    for track, shape, supports, speed in product(tracks, SHAPES, LINEAR, (80, 120, 160, 200, 250)):
        for position in (0.0,) if shape == "smooth" else (0.0, 0.25, 0.5, 0.75):
            yield Case(track, shape, supports, speed, position)
    for shape, supports, speed, position in product(("dip", "rise"), GAPS, (80, 160, 250), (0.0, 0.5)):
        yield Case("bilbao-viscous", shape, supports, speed, position)


def computed(case: Case) -> Peak:
    """Return the peak of a case, which takes a second or two."""
    definition = track_file.load(case.track)
    position_m = case.position_spans * definition.track.spacing_m
    path, supports = wheel_path(case.shape), SUPPORTS[case.supports]
    done = passage(definition.track, definition.wheel, path, case.speed_kmh, position_m, supports)
    return peak(done, definition.track.spacing_m)


def read() -> dict[Case, Peak]:
    """Return the file's peaks: forces to 10 N, places to 1 mm."""
    return {Case(*row[:5]): Peak(*row[5:]) for row in json.loads(FILE.read_text())["rows"]}


def write() -> None:
    """Compute every case and write the file, a row a line."""
    rows = []
    for case in cases():
        found = computed(case)
        numbers = (round(found.force_n, -1), round(found.at_m, 3), round(found.least_n, -1))
        rows.append(json.dumps([case.track, case.shape, case.supports, case.speed_kmh, case.position_spans, *numbers]))
    FILE.write_text(f'{{"columns": {json.dumps(_COLUMNS)},\n"rows": [\n' + ",\n".join(rows) + "\n]}\n")


if __name__ == "__main__":
    write()
