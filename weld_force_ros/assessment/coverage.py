"""Say what a verdict cannot rest on: speeds and positions that were not computed, waves that samples do not show."""

from collections.abc import Sequence

import numpy as np
from msgspec import UnsetType

from weld_force_ros.assessment.limits import decides, within_limits
from weld_force_ros.messages import Limit, Rules
from weld_force_ros.simulation.force_map_view import RelevantMap, force_curve

LOWEST_KMH = 40.0
"""Below it the bundled welds 1 to 4 reach no more than from it to 80 km/h (tests); judgement for others."""
WIDEST_STEP_KMH = 10.0
WIDEST_GAP_M = 0.16
"""Of positions in the span: a quarter of it, and 1 cm for spans that are no round number."""

_RESOLVED_BY_SAMPLES = 2  # a wave: the sampling theorem
_COARSE_M, _FINE_M = 4.9e-5, 1e-5  # steps of heights: of the first, short waves come out up to 18 % off


def uncomputed(relevant: RelevantMap, limits: Sequence[Limit]) -> list[str]:
    """Return what was not computed and could be worse, in clauses; nothing if all was."""
    return [*_speeds(relevant), *_between(relevant, limits), *_positions(relevant)]


def _speeds(relevant: RelevantMap) -> list[str]:
    computed, line_kmh = force_curve(relevant)[0], relevant.line_kmh
    first, last = float(computed[0]), float(computed[-1])
    if first > line_kmh:
        return [f"nothing was computed up to the line's {line_kmh:g} km/h, speeds begin at {first:g}"]
    found = []
    if last < line_kmh * (1 - 1e-9):
        found.append(f"forces hold up to {last:g} km/h, the highest speed computed; the line's is {line_kmh:g} km/h")
    if first > LOWEST_KMH:
        found.append(f"speeds below {first:g} km/h were not computed: begin at {LOWEST_KMH:g}")
    up_to_line = computed[: int(np.searchsorted(computed, line_kmh)) + 1]
    wide = np.flatnonzero(np.diff(up_to_line) > WIDEST_STEP_KMH + 1e-9)
    if len(wide):
        left, right = up_to_line[wide[0]], up_to_line[wide[0] + 1]
        found.append(f"nothing was computed between {left:g} and {right:g} km/h: compute every {WIDEST_STEP_KMH:g}")
    return found


def _between(relevant: RelevantMap, limits: Sequence[Limit]) -> list[str]:
    """Describe what the finer curve shows over a limit where the map shows nothing."""
    own = [limit for limit in limits if decides(limit)]
    on_map = within_limits(relevant.speeds_kmh, relevant.worst_over_positions, own)
    speeds, worst = relevant.worst_by_speed()
    over = speeds[~within_limits(speeds, worst, own)]
    if not on_map.all() or not len(over):
        return []
    return [f"a limit is exceeded at {over[0]:g} km/h, between the speeds of the map"]


def _positions(relevant: RelevantMap) -> list[str]:
    computed, span_m = np.array(relevant.force_map.positions_m), relevant.force_map.span_m
    at_m = relevant.force_map.weld_position_m
    if isinstance(at_m, UnsetType):
        around = np.append(computed, computed[0] + span_m)
        if np.diff(around).max() <= WIDEST_GAP_M:
            return []
        return [f"{len(computed)} positions do not cover the span of {span_m:g} m: compute 4 or more"]
    distance = np.abs(np.mod(relevant.positions_m - at_m + span_m / 2, span_m) - span_m / 2).min()
    if distance <= WIDEST_GAP_M / 2:
        return []
    return [f"the weld lies {at_m:g} m after its sleeper, the nearest position computed is {distance:.2f} m off"]


def unseen(relevant: RelevantMap, rules: Rules) -> list[str]:
    """Describe what samples too far apart, or heights in too large steps, do not show; nothing if all can be seen."""
    measures, worst_speed_kmh = relevant.force_map.measures, float(relevant.speeds_kmh[relevant.peak_index[0]])
    if isinstance(measures, UnsetType) or not rules.resolved_hz:
        return []
    if isinstance(measures.resolution_m, float) and measures.resolution_m >= _COARSE_M:
        return [
            f"heights in steps of {measures.resolution_m * 1e3:.2g} mm do not show what is lower: measure in steps of "
            f"{_FINE_M * 1e3:g} mm"
        ]
    shortest_m = _RESOLVED_BY_SAMPLES * measures.spacing_m
    resolved_hz = worst_speed_kmh / 3.6 / shortest_m
    if resolved_hz >= rules.resolved_hz:
        return []
    needed_mm = 1e3 * worst_speed_kmh / 3.6 / rules.resolved_hz / _RESOLVED_BY_SAMPLES
    return [
        f"samples {measures.spacing_m * 1e3:.3g} mm apart do not show waves below {shortest_m * 1e3:.3g} mm, "
        f"which act above {resolved_hz:.0f} Hz at {worst_speed_kmh:g} km/h: measure every {needed_mm:.2g} mm or closer"
    ]
