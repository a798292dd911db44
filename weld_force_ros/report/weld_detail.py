"""Collect the numbers of one weld's figures and tables: no more points than a screen shows."""

from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from weld_force_ros.assessment.criteria import FORCE_CRITERIA, gradient_norm_rad
from weld_force_ros.assessment.grinding_spots import ends_in_words
from weld_force_ros.assessment.hanging import sleeper_share_sentences, support_sentences
from weld_force_ros.assessment.judge import told_apart
from weld_force_ros.assessment.limits import decides, levels
from weld_force_ros.assessment.rule_books import limits_by_book, verified_of
from weld_force_ros.errors import InputError
from weld_force_ros.messages import (
    AssessmentSettings,
    Criterion,
    ForceHistory,
    ForceMap,
    GrindingAdvice,
    Limit,
    Rejection,
    SimulationSettings,
    Verdict,
    WeldProfile,
    known,
)
from weld_force_ros.physics.analysis.geometry import inclinations
from weld_force_ros.physics.analysis.speed_curve import surface_features
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.passage.wheel_path import underside, wheel_path_over
from weld_force_ros.recording.weld_records import WeldRecord
from weld_force_ros.report.numbers import decimals, short, significant, thinned, without_none
from weld_force_ros.simulation.force_map_view import (
    RelevantMap,
    force_curve,
    relevant_range,
    worse_passages,
)
from weld_force_ros.simulation.measured_geometry import standard_deviation

MOST_POINTS = 160
_MOST_SAMPLES = 120
_INDICES_TOGETHER = 14  # of every 0.5 mm
_SEEN_M = 1e-6  # of height, below which a bridged dip is none
_NINETY_PERCENT = 1.645  # standard deviations on either side


def content(weld: WeldRecord) -> dict[str, Any]:
    """Return the numbers of a weld's figures and tables, as far as they are known."""
    share = told_apart(weld.force_map, weld.limits) if weld.force_map and weld.limits else None
    found = {
        "map": weld.force_map and _map(weld.force_map, share),
        "curves": weld.force_map and _curves(weld.force_map, weld.verdict, weld.limits, share),
        "history": weld.history and _history(weld.history),
        "profile": weld.profile and _profile(weld.profile, weld.settings) | _quality_index(weld.profile, weld),
        "grinding": weld.grinding and _grinding(weld.grinding),
        "support": weld.force_map
        and [*support_sentences(weld.verdict, weld.force_map.support), *sleeper_share_sentences(weld.force_map)],
        "provenance": _provenance(weld),
    }
    return {name: value for name, value in found.items() if value}


def _map(force_map: ForceMap, share: float | None) -> dict[str, Any]:
    shape = (len(force_map.speeds_kmh), len(force_map.positions_m))
    content = {
        "speeds_kmh": short(force_map.speeds_kmh),
        "positions_m": short(force_map.positions_m),
        "span_m": force_map.span_m,
        "peak_n": decimals(worse_passages(force_map).peak_force_n.ravel(), -2),
        "hollow": "".join("1" if cell else "0" for cell in _hollow(force_map, shape, share or 0.0).ravel()),
        "static_load_n": force_map.static_load_n,
        "line_speed_kmh": known(force_map.line_speed_kmh),
        "weld_position_m": known(force_map.weld_position_m),
    }
    return without_none(content)


def _hollow(force_map: ForceMap, shape: tuple[int, int], share: float) -> NDArray[np.bool_]:
    """Return which cells (n_speed, n_position) lie in a local minimum over speed; none on too coarse a grid.

    Only those that are deeper than fit error and model uncertainty, a share of the force's dynamic part.
    """
    peaks = worse_passages(force_map).peak_force_n
    try:
        hollow = surface_features(force_map.speeds_kmh, force_map.positions_m, peaks, force_map.span_m).hollow
        before = np.maximum.accumulate(peaks, axis=0)
        return np.asarray(hollow & (before - peaks >= share * (before - force_map.static_load_n)))
    except (InputError, IndexError):
        return np.zeros(shape, dtype=bool)


def _curves(
    force_map: ForceMap, verdict: Verdict, limits: AssessmentSettings | None, share: float | None
) -> dict[str, Any]:
    """Return every force criterion over speed at its worst position, with the limits applied to it."""
    relevant = relevant_range(force_map)
    speeds, worst = force_curve(relevant)
    series = []
    for name in dict.fromkeys(["peak_force", *(c.name for c in verdict.criteria)]):
        values = FORCE_CRITERIA[name].value(worst) if name in FORCE_CRITERIA else None
        if values is None:
            continue
        of_verdict = [c for c in verdict.criteria if c.name == name]
        stated = [limit for limit in limits.limits if limit.name == name] if limits else []
        applied = [_limit(limit, force_map.static_load_n) for limit in stated or of_verdict]
        unit = next((c.unit for c in of_verdict), "N" if name == "peak_force" else "1")
        series.append({
            "name": name,
            "unit": unit,
            "values": decimals(values, -2) if unit == "N" else [significant(v, 4) for v in values.tolist()],
            "limits": applied,
        })  # fmt: skip
    content = {"speeds_kmh": short(speeds.tolist()), "series": series, "best": _lowest_peaks(relevant)}
    if share is not None:
        content |= {"error_share": significant(share, 3), "static_n": force_map.static_load_n}
    return content


def _limit(limit: Limit | Criterion, static_load_n: float) -> dict[str, Any]:
    """Return what a limit comes to, and the line speeds that it holds for."""
    if isinstance(limit, Criterion):
        at_most, reject, is_deciding = limit.limit, known(limit.reject_limit), limit.decides
    else:
        applied = levels(limit, static_load_n)
        at_most, is_deciding = applied.limit, decides(limit)
        reject = applied.reject_limit if np.isfinite(applied.reject_limit) else None
    bounds = ("above_kmh", "from_kmh", "below_kmh", "to_kmh")
    return without_none({
        "limit": at_most,
        "reject_limit": reject,
        "verified": limit.verified,
        "decides": is_deciding,
        **({name: known(getattr(limit, name)) for name in bounds} if isinstance(limit, Limit) else {}),
    })  # fmt: skip


def _lowest_peaks(relevant: RelevantMap) -> dict[str, Any] | None:
    """Return the peak at the best position of each speed; None if only one position is considered."""
    if len(relevant.positions_m) == 1:
        return None
    return {
        "speeds_kmh": short(relevant.speeds_kmh.tolist()),
        "peak_n": decimals(relevant.passages.peak_force_n.min(axis=1), -2),
    }


def _history(history: ForceHistory) -> dict[str, Any]:
    drawn = thinned(history.force_n, MOST_POINTS)
    return {
        "speed_kmh": significant(history.speed_kmh),
        "position_m": significant(history.position_m),
        "x_m": decimals(np.array(history.x_m)[drawn], 4),
        "force_n": decimals(np.array(history.force_n)[drawn], -2),
        "irregularity_m": decimals(np.array(history.irregularity_m)[drawn], 7),
    }


def _profile(profile: WeldProfile, settings: SimulationSettings | None) -> dict[str, Any]:
    drawn = thinned(profile.z_m, MOST_POINTS)
    x, z = np.array(profile.x_m), np.array(profile.z_m)
    content = {"x_m": decimals(x[drawn], 5), "z_m": decimals(z[drawn], 7)}
    if settings is not None:
        wheel_x = np.linspace(x[0], x[-1], MOST_POINTS // 2)
        content["wheel_x_m"] = decimals(wheel_x, 5)
        path = wheel_path_over(x, z, settings.rolling_radius_m, settings.patch_half_length_m)
        content["wheel_m"] = decimals(path.at(wheel_x), 7)
        content |= _bridged(x, z, settings.rolling_radius_m, drawn)
    if (deviation := standard_deviation(profile)) is not None:
        beyond = _NINETY_PERCENT * deviation[drawn]
        content |= {"low_m": decimals(z[drawn] - beyond, 7), "high_m": decimals(z[drawn] + beyond, 7)}
        content |= _measured(profile)
    return content


def _bridged(x_m: FloatArray, z_m: FloatArray, radius_m: float, drawn: NDArray[np.intp]) -> dict[str, Any]:
    """Return how deep the wheel reaches over a rail that it bridges, and how much of it; nothing where it does not."""
    deepest = underside(x_m, z_m, radius_m)
    unseen = deepest > z_m + _SEEN_M
    if not np.any(unseen):
        return {}
    return {
        "underside_m": decimals(deepest[drawn], 7),
        "bridged_m": significant(float(np.sum(np.gradient(x_m)[unseen]))),
    }


def _quality_index(profile: WeldProfile, weld: WeldRecord) -> dict[str, Any]:
    """Return the quality index along the weld, the largest within 5 mm each, and its norm on the line."""
    line_kmh = known(profile.line_speed_kmh) or (weld.force_map and relevant_range(weld.force_map).line_kmh)
    if not line_kmh:
        return {}
    norm = gradient_norm_rad(line_kmh, weld.limits.gradient_norm if weld.limits else [])
    x_m, slope = inclinations(profile.x_m, profile.z_m)
    index = np.maximum.reduceat(np.abs(slope) / norm, np.arange(0, len(x_m), _INDICES_TOGETHER))
    return {
        "index": decimals(index, 3),
        "index_from_m": round(float(x_m[:_INDICES_TOGETHER].mean()), 5),
        "index_step_m": round(float(x_m[_INDICES_TOGETHER] - x_m[0]), 5),
        "norm_rad": significant(norm),
        "norm_kmh": line_kmh,
    }


def _measured(profile: WeldProfile) -> dict[str, Any]:
    """Return the samples as measured, those set aside apart."""
    x, z = np.array(known(profile.measured_x_m)), np.array(known(profile.measured_z_m))
    noise = known(profile.noise)
    if noise is None:
        return {}
    wrong = np.isin(x, noise.outliers_m)
    kept = np.flatnonzero(~wrong)[:: max(1, len(x) // _MOST_SAMPLES)]
    return {
        "measured_x_m": decimals(x[kept], 5),
        "measured_z_m": decimals(z[kept], 7),
        "wrong_x_m": decimals(x[wrong], 5),
        "wrong_z_m": decimals(z[wrong], 7),
    }


def _grinding(advice: GrindingAdvice) -> dict[str, Any]:
    x, ground = np.array(advice.x_m), np.array(advice.z_m) - np.array(advice.removal_m)
    drawn = thinned(ground, MOST_POINTS)
    return {
        "x_m": decimals(x[drawn], 5),
        "ground_m": decimals(ground[drawn], 7),
        "most_removed_m": significant(advice.most_removed_m),
        "spots": [short(msgspec.to_builtins(spot)) for spot in advice.spots],
        "ends": ends_in_words(advice.chainage_direction),
        "speeds_kmh": short(advice.speeds_kmh),
        "peak_after_n": decimals(advice.peak_after_n, -2),
    }


def _provenance(weld: WeldRecord) -> list[list[str]]:
    verdict, force_map, profile, settings = weld.verdict, weld.force_map, weld.profile, weld.settings
    rows: dict[str, object] = {
        "source": profile and profile.source,
        "file format": profile and known(profile.format),
        "conditioning": profile and "; ".join(profile.conditioning),
        "software": verdict.software,
        "track": force_map and force_map.track,
        "engine": force_map and force_map.engine,
        "grid": force_map and _grid(force_map),
        "fit error": force_map
        and force_map.model_error is not UNSET
        and f"about {force_map.model_error:.1%} of the dynamic force",
        "vehicle": _vehicle(verdict, force_map),
        "wheel": settings and _wheel(settings),
        "limits": weld.limits and _limits(weld.limits),
        "Monte-Carlo samples": verdict.samples,
        "profile, sha256": verdict.profile_sha256,
        "measurement": known(verdict.profile_id),
        "file, sha256": profile and known(profile.source_sha256),
        "simulation settings, sha256": verdict.config_sha256,
        "limits, sha256": verdict.limits_sha256,
    }
    return _stated(rows)


def _vehicle(verdict: Verdict, force_map: ForceMap | None) -> str | None:
    count = len(force_map.judged_together) if force_map else 0
    name = known(verdict.vehicle)
    return f"{name}, which decides of {count}" if name and count > 1 else name


def _grid(force_map: ForceMap) -> str:
    speeds, positions = force_map.speeds_kmh, force_map.positions_m
    return f"{len(speeds)} speeds from {speeds[0]:g} to {speeds[-1]:g} km/h, {len(positions)} positions"


def _wheel(settings: SimulationSettings) -> str:
    return (
        f"{settings.wheel_mass_kg:g} kg, static load {settings.static_load_n / 1e3:g} kN, radius "
        f"{settings.wheel_radius_m:g} m, Hertz constant {settings.hertz_n_per_m15:.3g} N/m^1.5"
        f"{'' if settings.rolling is UNSET else '; its circle does not roll, it follows the rail as it stands'}"
    )


def _limits(limits: AssessmentSettings) -> str:
    books = limits_by_book(limits)
    if books:
        return ", ".join(f"{book.name} ({verified_of(own)} numbers verified)" for book, own in books)
    unverified = sum(not limit.verified for limit in limits.limits)
    return f"{len(limits.limits)}, of which {unverified} unverified"


def _stated(rows: dict[str, object]) -> list[list[str]]:
    return [[name, str(value)] for name, value in rows.items() if value]


def provenance_of_rejection(rejection: Rejection) -> list[list[str]]:
    """Return where an input that could not be used came from."""
    return _stated({"source": rejection.source, "file, sha256": known(rejection.source_sha256)})
