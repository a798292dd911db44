"""Compute a recording again, without ROS, and say what differs."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros.errors import WeldForceError
from weld_force_ros.messages import ForceMap, Message, SpeedCurve, UncertaintyResult, Verdict, known
from weld_force_ros.recording.recomputation import Recomputation
from weld_force_ros.recording.recording import Recording, SimulationKey, judged_together, simulation_key
from weld_force_ros.simulation.force_map_view import at_speeds, simulated_part

# Another processor may round differently, and the contact magnifies it; a real difference is far larger.
FORCE_TOLERANCE = 1e-6
PLACE_TOLERANCE_M = 1e-3
TIME_TOLERANCE_S = 1e-4

_NOT_COMPARED = ("at_m", "against", "limits_sha256")  # of a curve


@dataclass(frozen=True)
class Replayed:
    """A recorded result beside the same computed again.

    Attributes:
        weld_id: the weld that both are about; `?` for a message that cannot be read.
        kind: `force_map`, `verdict` or `message`.
        computed: the result computed again, if it could be.
        differences: a clause each; none if both agree.
    """

    weld_id: str
    kind: str
    computed: Message | None
    differences: tuple[str, ...]


def replay(recording: Recording, *, on_result: Callable[[], None] | None = None) -> Iterator[Replayed]:
    """Yield every force map and verdict of a recording, computed again in log order, then what is missing."""
    again = Recomputation(recording)
    groups = {simulation_key(one): group for group in judged_together(recording.force_maps) for one in group}
    verdicts: dict[SimulationKey, list[Verdict]] = {}
    for verdict in recording.verdicts:
        verdicts.setdefault(simulation_key(verdict), []).append(verdict)
    by_key: dict[SimulationKey, ForceMap] = {}
    for recorded in recording.force_maps:
        computed = None
        try:
            computed = again.force_map(recorded)
        except WeldForceError as error:
            yield Replayed(recorded.weld_id, "force_map", None, (str(error),))
        else:
            yield Replayed(recorded.weld_id, "force_map", computed, tuple(_map_differences(recorded, computed)))
        # Judged on what was computed now; a map that cannot be computed is reported above.
        by_key[simulation_key(recorded)] = computed or recorded
        keys = [simulation_key(one) for one in groups.get(simulation_key(recorded), [])]
        if all(key in by_key for key in keys):
            for verdict in (verdict for key in keys for verdict in verdicts.get(key, [])):
                yield _replayed_verdict(verdict, [by_key[key] for key in keys], again)
        if on_result:
            on_result()
    yield from _missing(recording)


def _replayed_verdict(recorded: Verdict, force_maps: Sequence[ForceMap], again: Recomputation) -> Replayed:
    try:
        computed = again.verdict(recorded, force_maps)
    except WeldForceError as error:
        return Replayed(recorded.weld_id, "verdict", None, (str(error),))
    return Replayed(recorded.weld_id, "verdict", computed, tuple(_verdict_differences(recorded, computed)))


def _map_differences(recorded: ForceMap, computed: ForceMap) -> Iterator[str]:
    if recorded.speeds_kmh != computed.speeds_kmh or recorded.positions_m != computed.positions_m:
        yield "speeds or positions differ"
        return
    force_n = FORCE_TOLERANCE * recorded.static_load_n
    tolerances = {
        "peak_force_n": force_n,
        "min_force_n": force_n,
        "peak_x_m": PLACE_TOLERANCE_M,
        "contact_loss_s": TIME_TOLERANCE_S,
        "p2_force_n": force_n,
        "force_20hz_n": force_n,
    }
    for name, tolerance in tolerances.items():
        if getattr(recorded, name) is UNSET:  # of a version that did not compute it
            continue
        difference = np.abs(np.array(getattr(recorded, name)) - np.array(getattr(computed, name)))
        if difference.max() > tolerance:
            row, column = divmod(int(difference.argmax()), len(recorded.positions_m))
            count = np.count_nonzero(difference > tolerance)
            yield (
                f"{name} differs by {difference.max():.6g} at {recorded.speeds_kmh[row]:g} km/h, "
                f"{recorded.positions_m[column]:g} m ({count} of {difference.size} passages)"
            )

    curves = _simulated_in_both(recorded, computed)
    for name, (was, now) in {"curve": curves, "spread": (recorded.spread, computed.spread)}.items():
        if not isinstance(was, UnsetType) and (isinstance(now, UnsetType) or not _columns_agree(was, now, force_n)):
            yield f"{name} differs"


def _simulated_in_both(recorded: ForceMap, computed: ForceMap) -> tuple[SpeedCurve | UnsetType, SpeedCurve | UnsetType]:
    """Return both curves without speeds at which either was estimated: rounding may have chosen other ones."""
    was, now = recorded.curve, computed.curve
    if isinstance(was, UnsetType) or isinstance(now, UnsetType):
        return was, now
    was, now = simulated_part(was), simulated_part(now)
    return at_speeds(was, {*now.speeds_kmh}), at_speeds(now, {*was.speeds_kmh})


def _columns_agree(
    was: SpeedCurve | UncertaintyResult, now: SpeedCurve | UncertaintyResult, tolerance_n: float
) -> bool:
    """Return whether all columns agree: forces as those of the map, all else within the tolerance of places.

    A column that an earlier version did not compute is absent or empty. Where the largest force is, is not compared: of
    places and directions with the same force, as a symmetric weld has them, rounding picks one.
    """
    names = [name for name in was.__struct_fields__ if name not in _NOT_COMPARED]
    columns = ((getattr(was, name), getattr(now, name), name.endswith("_n")) for name in names)
    return all(
        a is UNSET
        or not a
        or (len(a) == len(b) and np.allclose(a, b, rtol=0.0, atol=tolerance_n if force else PLACE_TOLERANCE_M))
        for a, b, force in columns
    )


def _verdict_differences(recorded: Verdict, computed: Verdict) -> Iterator[str]:
    if recorded.decision != computed.decision:
        yield f"decision was {recorded.decision}, is {computed.decision}"
    if recorded.config_sha256 != computed.config_sha256:
        yield f"vehicle that decides was {known(recorded.vehicle)}, is {known(computed.vehicle)}"
    ours = {c.name: c for c in computed.criteria}
    theirs = {c.name: c for c in recorded.criteria}
    if ours.keys() != theirs.keys():
        yield f"criteria were {', '.join(theirs)}, are {', '.join(ours)}"
        return
    permitted = (recorded.permitted_speed_kmh, computed.permitted_speed_kmh)
    if recorded.advice and permitted[0] != permitted[1]:
        yield f"highest speed within limits was {permitted[0]} km/h, is {permitted[1]} km/h"
    for name, was in theirs.items():
        now = ours[name]
        if was.passed != now.passed or not np.isclose(was.value, now.value, rtol=FORCE_TOLERANCE, atol=1e-9):
            yield f"{name} was {was.value:.6g} {was.unit}, is {now.value:.6g}"


def _missing(recording: Recording) -> Iterator[Replayed]:
    for weld_id in recording.welds_without_outcome():
        yield Replayed(weld_id, "verdict", None, ("no verdict was recorded for this profile",))
    whole = {simulation_key(one) for group in judged_together(recording.force_maps) for one in group}
    mapped = {simulation_key(force_map) for force_map in recording.force_maps}
    for key in sorted({simulation_key(verdict) for verdict in recording.verdicts} - whole):
        which = "not every vehicle's force map" if key in mapped else "no force map"
        yield Replayed(key[0], "verdict", None, (f"{which} was recorded for this verdict",))
    for error in recording.unreadable:
        yield Replayed("?", "message", None, (str(error),))
