"""Draw a weld: its geometry with the quality index, force over speed, one passage, and the map of forces."""

import string
from collections.abc import Sequence
from typing import Any

import numpy as np
from msgspec import UNSET, UnsetType
from numpy.typing import NDArray

from weld_force_ros._words import Words
from weld_force_ros.assessment.grinding_spots import ends_in_words
from weld_force_ros.assessment.limits import worst
from weld_force_ros.assessment.speed_advice import in_prose_kmh
from weld_force_ros.messages import Running, Verdict, known
from weld_force_ros.recording.weld_records import WeldRecord
from weld_force_ros.report.numbers import thinned
from weld_force_ros.report.quantities import UNITS, centimetres, hundredths, kilonewtons, kmh, number, unit_of
from weld_force_ros.report.svg_figure import SCALE, WIDTH, Axis, Panel, arrow, axis_of, figure, shades_of
from weld_force_ros.report.weld_words import criterion_name

_LEFT, _RIGHT = 46.0, WIDTH - 16.0
_TOP = 32.0
_BELOW = 34.0  # for the axis
_LIMITS = ("limit", "reject_limit")
_MOST_SPEEDS = 100
_STEPS = 64**2 - 1

Content = dict[str, Any]


def running_of(record: WeldRecord) -> tuple[Running, bool]:
    """Return in which direction trains run in the figures, and whether anybody stated it."""
    stated = record.force_map.running if record.force_map else UNSET
    return ("with", False) if isinstance(stated, UnsetType) else (stated, True)


def _direction(record: WeldRecord, words: Words) -> str:
    running, is_stated = running_of(record)
    return arrow(running, words("figure.trains" if is_stated else "figure.trains_assumed"))


def geometry_figure(content: Content, record: WeldRecord, words: Words) -> str:
    """Draw the rail's height, the wheel's path, what grinding leaves, and the quality index above them."""
    profile, grinding = content["profile"], content.get("grinding")
    has_index = bool(profile.get("index"))
    upper, height = (74.0 if has_index else 0.0), 262.0
    top = _TOP + (upper + 26.0 if has_index else 0.0)
    x_mm = 1e3 * np.array(profile["x_m"])
    x = Axis(float(x_mm[0]), float(x_mm[-1]), _LEFT, _RIGHT)
    shown = [1e6 * np.array(profile[name]) for name in ("z_m", "low_m", "high_m", "wheel_m") if name in profile]
    panel = Panel(x, axis_of(np.concatenate(shown), height - _BELOW - 12, top, least=20.0))
    _mark_spots(panel, grinding)
    panel.frame(words("figure.along_mm"), words("figure.height_um"))
    _draw_rail(panel, profile, grinding, words)
    chainage = record.profile.chainage_direction if record.profile else UNSET
    ends = (words("figure.falling_x"), words("figure.rising_x"))
    if grinding or not isinstance(chainage, UnsetType):
        ends = grinding["ends"] if grinding else ends_in_words(chainage)
    panel.ends(*ends)
    panels = [panel]
    if has_index:
        panels.append(_quality_panel(x, profile, upper, words))
    most = number(max(profile["index"])) if has_index else words("phrase.not_known")
    label = words("figure.geometry_label", most=most)
    return figure(height, label, panels, _direction(record, words), unit="mm", along=words("figure.along"))


def _mark_spots(panel: Panel, grinding: Content | None) -> None:
    for spot in grinding["spots"] if grinding else ():
        panel.span(1e3 * spot["from_m"], 1e3 * spot["to_m"], "spot")
        panel.text(1e3 * spot["deepest_m"], panel.y.high, hundredths(spot["depth_m"]), "m spot-text")


def _draw_rail(panel: Panel, profile: Content, grinding: Content | None, words: Words) -> None:
    x_mm = 1e3 * np.array(profile["x_m"])

    def heights(name: str) -> NDArray[np.float64]:
        return np.asarray(1e6 * np.array(profile[name]))

    if "low_m" in profile:
        panel.band(x_mm, heights("low_m"), heights("high_m"), "likely")
    if "measured_x_m" in profile:
        panel.dots(1e3 * np.array(profile["measured_x_m"]), heights("measured_z_m"), "samples")
        wrong_um = np.clip(heights("wrong_z_m"), panel.y.low, panel.y.high)  # they may lie far off
        for at_mm, height_um in zip(1e3 * np.array(profile["wrong_x_m"]), wrong_um, strict=True):
            panel.cross(float(at_mm), float(height_um), "set-aside")
    if "underside_m" in profile:
        panel.band(x_mm, heights("z_m"), heights("underside_m"), "bridged")
    if "wheel_m" in profile:
        panel.line(1e3 * np.array(profile["wheel_x_m"]), heights("wheel_m"), "wheel", words("figure.wheel"), "µm")
    panel.line(x_mm, heights("z_m"), "rail", words("figure.rail"), "µm")
    if grinding and grinding["most_removed_m"] > 0:
        ground = 1e6 * np.array(grinding["ground_m"])
        panel.line(1e3 * np.array(grinding["x_m"]), ground, "after", words("figure.after"), "µm")


def _quality_panel(x: Axis, profile: Content, height: float, words: Words) -> Panel:
    index = np.array(profile["index"])
    at_mm = 1e3 * (profile["index_from_m"] + profile["index_step_m"] * np.arange(len(index)))
    inside = (at_mm >= x.low) & (at_mm <= x.high)
    panel = Panel(x, Axis(0.0, 1.15 * max(1.3, float(index.max())), _TOP + height, _TOP))
    panel.frame("", words("figure.quality_index"), y_ticks=3)
    panel.line(at_mm[inside], index[inside], "index", words("figure.quality_index"))
    norm = words("figure.norm", gradient=number(1e3 * profile["norm_rad"]), speed=kmh(profile["norm_kmh"]))
    panel.horizontal(1.0, "limit-reject", norm)
    return panel


def speed_figure(content: Content, record: WeldRecord, words: Words, name: str = "peak_force") -> str:
    """Draw a criterion over speed at its worst position, with its limits and speeds that matter."""
    curves, verdict = content["curves"], record.verdict
    series = next(one for one in curves["series"] if one["name"] == name)
    factor, unit = UNITS.get(unit_of(name, series["unit"]), (1.0, ""))
    speeds = np.array(curves["speeds_kmh"])
    values = factor * np.array(series["values"])
    limits = [(css, *step) for css in _LIMITS for step in _limit_steps(series, speeds, css)]
    shown = [values, *(np.array([factor * value]) for _, _, _, value in limits if factor * value < 2.5 * values.max())]
    x = Axis(float(speeds[0]), float(max(speeds[-1], speeds[0] + 1)), _LEFT, _RIGHT)
    all_shown = np.concatenate(shown)
    y = axis_of(all_shown, 230 - _BELOW, _TOP, from_zero=unit != "kN")
    panel = Panel(x, y)
    for band in verdict.avoid:
        panel.span(band.from_kmh, max(band.to_kmh, band.from_kmh + 0.5), "avoid")
    title = criterion_name(name, words) + (f", {unit}" if unit else "")
    panel.frame(words("figure.speed"), title)
    if name == "peak_force":
        _draw_best(panel, curves, values, factor)
    _draw_limits(panel, limits, factor)
    drawn = thinned(values, _MOST_SPEEDS)
    panel.line(speeds[drawn], values[drawn], "force", words("figure.worst_position"), unit)
    grinding = content.get("grinding")
    if name == "peak_force" and grinding and grinding["most_removed_m"] > 0:
        ground = factor * np.array(grinding["peak_after_n"])
        panel.line(grinding["speeds_kmh"], ground, "after", words("figure.after"), unit)
    _mark_speeds(panel, content, verdict, words)
    most = f"{number(float(values.max()))} {unit}".rstrip()
    label = words("figure.speed_label", criterion=criterion_name(name, words), most=most)
    return figure(230, label, [panel], _direction(record, words), unit="km/h", along=words("figure.at_speed"))


def _limit_steps(series: Content, speeds: NDArray[np.float64], field: str) -> list[tuple[float, float, float]]:
    """Return from which speed to which a limit of a series holds, and what it is."""
    steps = []
    for limit in series["limits"]:
        first = max(float(speeds[0]), limit.get("above_kmh") or 0.0, limit.get("from_kmh") or 0.0)
        last = min(float(speeds[-1]), limit.get("to_kmh") or np.inf, limit.get("below_kmh") or np.inf)
        if limit.get(field) is not None and last > first:
            steps.append((first, last, limit[field]))
    return steps


def _draw_best(panel: Panel, curves: Content, values: NDArray[np.float64], factor: float) -> None:
    best = curves["best"]
    if best is None:
        return
    at = np.array(best["speeds_kmh"])
    worst_there = np.interp(at, curves["speeds_kmh"], values)
    panel.band(at, factor * np.array(best["peak_n"]), worst_there, "likely")


def _draw_limits(panel: Panel, limits: Sequence[tuple[str, float, float, float]], factor: float) -> None:
    for css, first, last, value in limits:
        if panel.y.low <= factor * value <= panel.y.high:
            style = "limit-grind" if css == "limit" else "limit-reject"
            panel.horizontal(factor * value, style, "", first=first, last=last)


def _mark_speeds(panel: Panel, content: Content, verdict: Verdict, words: Words) -> None:
    line = (content.get("map") or {}).get("line_speed_kmh")
    permitted = known(verdict.permitted_speed_kmh)
    if permitted is not None and panel.x.low <= permitted < verdict.judged_speed_kmh:
        label = words("figure.within_to", speed=number(in_prose_kmh(permitted), 4))
        panel.vertical(permitted, "permitted", label, row=1)
    if line is not None and panel.x.low <= line <= panel.x.high:
        panel.vertical(line, "line-speed", words("figure.line", speed=number(line, 4)))


def passage_figure(content: Content, record: WeldRecord, words: Words) -> str:
    """Draw the contact force along the track in the worst passage, and the wheel's path over the weld."""
    history, force_map = content["history"], content.get("map")
    x_cm = 100 * np.array(history["x_m"])
    force_kn, path_um = 1e-3 * np.array(history["force_n"]), 1e6 * np.array(history["irregularity_m"])
    x = Axis(float(x_cm[0]), float(x_cm[-1]), _LEFT, _RIGHT)
    panel = Panel(x, axis_of(force_kn, 160.0, _TOP, least=5.0))
    panel.frame("", words("figure.force_kn"))
    lower = Panel(x, axis_of(path_um, 250 - _BELOW, 184.0, least=20.0))
    lower.frame(words("figure.after_sleeper_cm"), words("figure.path_um"), y_ticks=2)
    if force_map:
        span = force_map["span_m"]
        for at in np.arange(np.ceil(x_cm[0] / 100 / span), np.floor(x_cm[-1] / 100 / span) + 1) * span * 100:
            panel.vertical(float(at), "sleeper")
            lower.vertical(float(at), "sleeper")
        static_kn = force_map["static_load_n"] / 1e3
        if panel.y.low <= static_kn <= panel.y.high:
            panel.horizontal(static_kn, "line-speed", words("figure.static"))
    panel.line(x_cm, force_kn, "force", words("figure.force"), "kN")
    drawn = slice(None, None, 2)
    lower.line(x_cm[drawn], path_um[drawn], "wheel", words("figure.path"), "µm")
    most = kilonewtons(max(history["force_n"]))
    label = words("figure.passage_label", most=most, speed=kmh(history["speed_kmh"]))
    direction = known(record.history.running) if record.history else None
    shown = arrow(direction, words("figure.trains")) if direction else _direction(record, words)
    return figure(250, label, [panel, lower], shown, unit="cm", along=words("figure.after_sleeper"))


def map_figure(content: Content, record: WeldRecord, words: Words) -> str:
    """Draw the map of peak forces over speed and position in the sleeper bay as an image with its values."""
    force_map, verdict = content["map"], record.verdict
    positions, speeds = np.array(force_map["positions_m"]), np.array(force_map["speeds_kmh"])
    shape = (len(speeds), len(positions))
    peaks = np.array(force_map["peak_n"]).reshape(shape)
    hollow = np.array([cell == "1" for cell in force_map["hollow"]]).reshape(shape)
    edges = _edges(positions)
    if len(positions) > 1 and abs(edges[-1] - edges[0] - force_map["span_m"]) < 1e-6:
        positions = np.append(positions, positions[0] + force_map["span_m"])  # the next sleeper again
        peaks, hollow = np.column_stack([peaks, peaks[:, 0]]), np.column_stack([hollow, hollow[:, 0]])
        edges = _edges(positions)
    rows = _edges(speeds)
    panel = Panel(Axis(100 * edges[0], 100 * edges[-1], _LEFT, _RIGHT), Axis(rows[0], rows[-1], 250 - _BELOW, _TOP))
    low, high = float(peaks.min()), float(peaks.max())
    cells = shades_of(_uniform(peaks, rows, edges), low, high)
    panel.image(cells, words("figure.map_title"))
    panel.frame(words("figure.position_cm"), words("figure.speed"), y_ticks=5)
    if hollow.any():
        panel.parts.append(_outline(panel, hollow, rows, 100 * edges))
    for at in (0.0, force_map["span_m"]):
        if edges[0] <= at <= edges[-1]:
            panel.vertical(100 * at, "sleeper-white")
    if force_map.get("weld_position_m") is not None:
        panel.vertical(100 * force_map["weld_position_m"], "here")
    line = force_map.get("line_speed_kmh")
    if line is not None and rows[0] < line < rows[-1]:
        panel.horizontal(line, "line-white", words("figure.line", speed=number(line, 4)))
    panel.cross(100 * verdict.worst_position_m, verdict.worst_speed_kmh, "worst")
    label = words(
        "figure.map_label", most=kilonewtons(high), least=kilonewtons(low),
        speed=kmh(verdict.worst_speed_kmh), position=centimetres(verdict.worst_position_m),
    )  # fmt: skip
    return figure(
        250, label, [panel], _direction(record, words), "map",
        values=_in_digits(peaks, low, high), range=f"{low / 1e3:.6g} {high / 1e3:.6g}",
        speeds=" ".join(f"{v:g}" for v in speeds), positions=" ".join(f"{100 * v:.4g}" for v in positions),
        y=f"{rows[0]:.6g} {rows[-1]:.6g} {SCALE * panel.y.start:.0f} {SCALE * panel.y.end:.0f}",
    )  # fmt: skip


def _in_digits(values: NDArray[np.float64], low: float, high: float) -> str:
    """Return values between two as two digits of base 64 each: three quarters of their bytes in Base64."""
    digits = np.array(list(string.ascii_uppercase + string.ascii_lowercase + string.digits + "+/"))
    steps = np.round(_STEPS * (values.ravel() - low) / max(high - low, 1e-12)).astype(int)
    return "".join(digits[np.column_stack([steps // 64, steps % 64]).ravel()])


def _edges(centres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the edges of cells about their centres."""
    if len(centres) == 1:
        half = max(0.02, 0.02 * abs(float(centres[0])))
        return np.array([centres[0] - half, centres[0] + half])
    inner = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - inner[0]], inner, [2 * centres[-1] - inner[-1]]])


def _uniform(cells: NDArray[np.float64], *edges: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return cells between edges of any distance as cells of one size, for an image."""
    for axis, of_axis in enumerate(edges):
        widths = np.diff(of_axis)
        if np.ptp(widths) > 1e-6 * widths.max():
            fine = np.linspace(of_axis[0], of_axis[-1], 8 * len(widths) + 1)
            at = np.searchsorted(of_axis, (fine[1:] + fine[:-1]) / 2) - 1
            cells = np.take(cells, np.clip(at, 0, len(widths) - 1), axis=axis)
    return cells


def _outline(panel: Panel, inside: NDArray[np.bool_], rows: NDArray[np.float64], columns: NDArray[np.float64]) -> str:
    """Return the outline of the cells of local minima."""
    x, y = panel.x.at(columns), panel.y.at(rows)
    padded = np.pad(inside, 1)
    upright, level = padded[1:-1, 1:] != padded[1:-1, :-1], padded[1:, 1:-1] != padded[:-1, 1:-1]
    marks = [f"M{x[c]} {y[first]}V{y[last]}" for c in range(len(x)) for first, last in _runs(upright[:, c])]
    marks += [f"M{x[first]} {y[r]}H{x[last]}" for r in range(len(y)) for first, last in _runs(level[r])]
    return f'<path class="hollow" d="{"".join(marks)}"/>'


def _runs(marked: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return where each run of marked edges begins and ends, (n, 2)."""
    return np.flatnonzero(np.diff(np.pad(marked, 1).astype(np.int8))).reshape(-1, 2)


def second_criterion(content: Content, verdict: Verdict) -> str | None:
    """Return the criterion to draw over speed beside the peak force: one that alone is beyond its limit."""
    names = {one["name"] for one in content["curves"]["series"]} - {"peak_force"}
    forces = [c for c in verdict.criteria if c.name in names and c.decides and not c.passed]
    return worst(forces).name if forces else None
