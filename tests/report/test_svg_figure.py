"""Lines of a figure: few points, none of what they show lost."""

import re

import numpy as np
import pytest

from weld_force_ros.report.svg_figure import SCALE, Axis, Panel


def points(path: str) -> np.ndarray:
    d = re.search(r' d="([^"]*)"', path).group(1)
    return np.array([int(v) for v in re.findall(r"-?\d+", d)]).reshape(-1, 2).cumsum(axis=0)


@pytest.mark.parametrize("seed", range(20))
def test_a_line_passes_every_point_within_a_fifth_of_a_pixel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.integers(1, 40, 150)) / SCALE
    y = np.cumsum(rng.normal(0.0, rng.choice([0.03, 0.3, 3.0]), 150))
    panel = Panel(Axis(0.0, 1000.0, 0.0, 1000.0), Axis(-1000.0, 1000.0, 2000.0, 0.0))
    panel.line(x, y, "rail")
    drawn = points(panel.parts[0]) / SCALE
    assert (drawn[0], drawn[-1]) == (
        pytest.approx([x[0], 1000 - y[0]], abs=0.06),
        pytest.approx([x[-1], 1000 - y[-1]], abs=0.06),
    )
    assert np.interp(x, *drawn.T) == pytest.approx(1000 - y, abs=0.26)  # with its rounding


def test_a_straight_line_takes_two_points_and_a_step_its_corners() -> None:
    panel = Panel(Axis(0.0, 100.0, 0.0, 100.0), Axis(0.0, 100.0, 100.0, 0.0))
    panel.line(np.linspace(0, 100, 101), np.linspace(0, 50, 101), "straight")
    panel.line([0, 10, 50, 50, 90, 100], [20, 20, 20, 60, 60, 60], "step")
    straight, step = map(points, panel.parts)
    assert straight.tolist() == [[0, 1000], [1000, 500]]
    assert step.tolist() == [[0, 800], [500, 800], [500, 400], [1000, 400]]
