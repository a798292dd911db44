"""A weld's force-speed curve as text, for a terminal."""

import itertools
import math
from typing import Any

import plotext
from msgspec import UnsetType

from weld_force_ros.messages import ForceMap, MeasurementNoise, Verdict, WeldProfile
from weld_force_ros.simulation.force_map_view import force_curve, relevant_range

_HEIGHT = 18
_MOST_TICKS = 8
_ASCII = str.maketrans("─│┌┐└┘├┤┬┴┼╌╎┄┆┈┊", "-|+++++++++-|-|-|")


def curve_plot(force_map: ForceMap, verdict: Verdict, *, width: int, unicode: bool) -> str:
    """Draw the maximum force over all positions considered against speed, with the static load and the limit.

    Args:
        force_map: of one weld.
        verdict: its criteria hold the limit.
        width: in characters.
        unicode: draw with more than ASCII characters.
    """
    speeds_kmh, worst = force_curve(relevant_range(force_map))
    speeds, peaks = speeds_kmh.tolist(), (worst.peak_force_n / 1e3).tolist()
    lines = {"static": force_map.static_load_n / 1e3}
    lines.update(("limit", c.limit / 1e3) for c in verdict.criteria if c.name == "peak_force")
    low, high = min(*peaks, *lines.values()), max(*peaks, *lines.values())
    room = 0.05 * (high - low or high)
    figure = _empty_figure("maximum contact force over all positions considered, kN over km/h", width)
    for side in ("left", "right"):
        figure.ruler("y", side).lim(low - room, high + room)
    figure.ruler("y", "left").ticks(*_ticks(low, high))
    figure.ruler("x").ticks(*_ticks(speeds[0], speeds[-1]))
    figure.ruler("y", "right").ticks(list(lines.values()), list(lines))
    for name, value in lines.items():
        figure.line(value, style="dotted" if name == "static" else "default")
    figure.draw(figure.signal(speeds, peaks, marker="braille" if unicode else "*").lines(True))
    return _text_of(figure, unicode)


def profile_plot(profile: WeldProfile, *, width: int, unicode: bool) -> str:
    """Draw a weld's geometry in um over mm; the samples as measured as dots, where the geometry was estimated.

    Args:
        profile: of the weld.
        width: in characters.
        unicode: draw with more than ASCII characters.
    """
    x_mm, z_um = [1e3 * x for x in profile.x_m], [1e6 * z for z in profile.z_m]
    figure = _empty_figure("height of the rail in um over mm along it, the weld at 0", width)
    figure.ruler("x").ticks(*_ticks(x_mm[0], x_mm[-1]))
    figure.ruler("y", "left").ticks(*_ticks(min(z_um), max(z_um)))
    figure.draw(figure.signal(x_mm, z_um, marker="braille" if unicode else "*").lines(True))
    if not isinstance(profile.measured_x_m, UnsetType) and not isinstance(profile.measured_z_m, UnsetType):
        outside = set(profile.noise.outliers_m) if isinstance(profile.noise, MeasurementNoise) else set()
        samples = zip(profile.measured_x_m, profile.measured_z_m, strict=True)
        kept = [(1e3 * x, 1e6 * z) for x, z in samples if x not in outside]
        if len(kept) <= 4 * width:
            figure.draw(figure.signal([x for x, _ in kept], [z for _, z in kept], marker="·" if unicode else "."))
    return _text_of(figure, unicode)


def _empty_figure(title: str, width: int) -> Any:
    plotext.terminal.limit(False, False)
    figure = plotext.figure
    figure.clear()
    figure.theme("colorless")
    figure.legend(False)
    figure.plot_size(width, _HEIGHT)
    figure.title(title)
    return figure


def _text_of(figure: Any, unicode: bool) -> str:
    drawn = figure.build().string(colorless=True)
    return "\n".join(line.rstrip() for line in (drawn if unicode else drawn.translate(_ASCII)).splitlines())


def _ticks(low: float, high: float) -> tuple[list[float], list[str]]:
    """Return at most `_MOST_TICKS` round numbers between two, and their texts."""
    smallest = math.floor(math.log10(high - low or 1.0)) - 1
    steps = (digit * 10.0**power for power in itertools.count(smallest) for digit in (1, 2, 5))
    step = next(step for step in steps if (high - low) / step <= _MOST_TICKS)
    ticks = [step * count for count in range(math.ceil(low / step), math.floor(high / step) + 1)]
    return ticks, [f"{tick:g}" for tick in ticks]
