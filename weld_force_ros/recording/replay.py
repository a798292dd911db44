"""Compute a recording again, without ROS, and say what differs."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from msgspec import UNSET
from msgspec.structs import replace

from weld_force_ros.assessment.judge import judge
from weld_force_ros.errors import BagError, WeldForceError
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Message,
    Rejection,
    SimulationSettings,
    SpeedCurve,
    UncertaintyResult,
    Verdict,
    WeldProfile,
)
from weld_force_ros.recording import contract_messages, open_bag
from weld_force_ros.simulation.simulator import Simulator

# Another processor may round differently, and the contact magnifies it; a real difference is far larger.
FORCE_TOLERANCE = 1e-6
PLACE_TOLERANCE_M = 1e-3
TIME_TOLERANCE_S = 1e-4


@dataclass(frozen=True)
class Replayed:
    """A recorded result beside the same computed again; `differences` is empty if they agree."""

    weld_id: str
    kind: str
    computed: Message | None
    differences: tuple[str, ...]


@dataclass
class Recording:
    """What a bag holds of the suite's messages, in log order; profiles by weld and hash, as welds may be alike."""

    path: Path
    damage: str | None
    profiles: dict[tuple[str, str], WeldProfile] = field(default_factory=dict)
    settings: dict[str, SimulationSettings] = field(default_factory=dict)
    limits: dict[str, AssessmentSettings] = field(default_factory=dict)
    force_maps: list[ForceMap] = field(default_factory=list)
    histories: list[ForceHistory] = field(default_factory=list)
    verdicts: list[Verdict] = field(default_factory=list)
    rejections: list[Rejection] = field(default_factory=list)
    unreadable: list[BagError] = field(default_factory=list)


def open_recording(path: Path) -> Recording:
    """Sort a bag's messages by kind.

    Raises:
        BagError: not a readable bag, or one without a message of the suite.
    """
    bag = open_bag(path)
    recording = Recording(path, bag.damage)
    for _, message, _ in contract_messages(bag):
        match message:
            case WeldProfile():
                recording.profiles[message.weld_id, message.profile_sha256] = message
            case SimulationSettings():
                recording.settings[message.config_sha256] = message
            case AssessmentSettings():
                recording.limits[message.limits_sha256] = message
            case ForceMap():
                recording.force_maps.append(message)
            case ForceHistory():
                recording.histories.append(message)
            case Verdict():
                recording.verdicts.append(message)
            case Rejection():
                recording.rejections.append(message)
            case BagError():
                recording.unreadable.append(message)
    if not (recording.profiles or recording.rejections or recording.force_maps or recording.unreadable):
        raise BagError(f"{path} holds no message of this suite", "record with `weld-force up` or `weld-force demo`")
    return recording


def replay(recording: Recording, *, on_result: Callable[[], None] | None = None) -> Iterator[Replayed]:
    """Every force map and verdict of a recording, computed again in log order, then what is missing."""
    simulators: dict[str, Simulator] = {}
    for recorded in recording.force_maps:
        replayed, computed = _replayed_map(recorded, recording, simulators)
        yield replayed
        for verdict in (v for v in recording.verdicts if _belongs(v, recorded)):
            # Judged on what was computed now; a map that cannot be computed is reported above.
            yield _replayed_verdict(verdict, computed or recorded, recording)
        if on_result:
            on_result()
    yield from _missing(recording)


def _belongs(verdict: Verdict, force_map: ForceMap) -> bool:
    return (verdict.weld_id, verdict.profile_sha256, verdict.config_sha256) == (
        force_map.weld_id, force_map.profile_sha256, force_map.config_sha256,
    )  # fmt: skip


def _replayed_map(
    recorded: ForceMap, recording: Recording, simulators: dict[str, Simulator]
) -> tuple[Replayed, ForceMap | None]:
    profile = recording.profiles.get((recorded.weld_id, recorded.profile_sha256))
    settings = recording.settings.get(recorded.config_sha256)
    if profile is None or settings is None:
        absent = "profile" if profile is None else "simulation settings"
        return Replayed(recorded.weld_id, "force_map", None, (f"its {absent} is not in the recording",)), None
    try:
        if recorded.config_sha256 not in simulators:
            simulators[recorded.config_sha256] = Simulator(settings)
        computed = again(recorded, profile, simulators[recorded.config_sha256])
    except WeldForceError as error:
        return Replayed(recorded.weld_id, "force_map", None, (str(error),)), None
    return Replayed(recorded.weld_id, "force_map", computed, tuple(_map_differences(recorded, computed))), computed


def again(recorded: ForceMap, profile: WeldProfile, simulator: Simulator) -> ForceMap:
    """A recorded map computed anew; place and line speed as they were then, whatever was stated of the weld since."""
    return replace(
        simulator.force_map(profile),
        line_speed_kmh=recorded.line_speed_kmh,
        weld_position_m=recorded.weld_position_m,
        chainage_m=recorded.chainage_m,
        rail=recorded.rail,
    )


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
        apart = np.abs(np.array(getattr(recorded, name)) - np.array(getattr(computed, name)))
        if apart.max() > tolerance:
            row, column = divmod(int(apart.argmax()), len(recorded.positions_m))
            yield (
                f"{name} differs by {apart.max():.6g} at {recorded.speeds_kmh[row]:g} km/h, "
                f"{recorded.positions_m[column]:g} m ({np.count_nonzero(apart > tolerance)} of {apart.size} passages)"
            )

    for name in ("curve", "spread"):
        was, now = getattr(recorded, name), getattr(computed, name)
        if was is not UNSET and (now is UNSET or not _alike(was, now, force_n)):
            yield f"{name} differs"


def _alike(was: SpeedCurve | UncertaintyResult, now: SpeedCurve | UncertaintyResult, tolerance_n: float) -> bool:
    """Whether all columns agree: forces as those of the map, what is no force within the tolerance of places."""
    columns = ((getattr(was, name), getattr(now, name), name.endswith("_n")) for name in was.__struct_fields__)
    return all(
        a is UNSET
        or (len(a) == len(b) and np.allclose(a, b, rtol=0.0, atol=tolerance_n if force else PLACE_TOLERANCE_M))
        for a, b, force in columns
    )


def _replayed_verdict(recorded: Verdict, force_map: ForceMap, recording: Recording) -> Replayed:
    limits = recording.limits.get(recorded.limits_sha256)
    if limits is None:
        return Replayed(recorded.weld_id, "verdict", None, ("its limits are not in the recording",))
    computed = judge(force_map, limits)
    return Replayed(recorded.weld_id, "verdict", computed, tuple(_verdict_differences(recorded, computed)))


def _verdict_differences(recorded: Verdict, computed: Verdict) -> Iterator[str]:
    if recorded.decision != computed.decision:
        yield f"decision was {recorded.decision}, is {computed.decision}"
    ours = {c.name: c for c in computed.criteria}
    theirs = {c.name: c for c in recorded.criteria}
    if ours.keys() != theirs.keys():
        yield f"criteria were {', '.join(theirs)}, are {', '.join(ours)}"
        return
    permitted = (recorded.permitted_speed_kmh, computed.permitted_speed_kmh)
    if recorded.advice and permitted[0] != permitted[1]:
        yield f"permitted speed was {permitted[0]} km/h, is {permitted[1]} km/h"
    for name, was in theirs.items():
        now = ours[name]
        if was.passed != now.passed or not np.isclose(was.value, now.value, rtol=FORCE_TOLERANCE, atol=1e-9):
            yield f"{name} was {was.value:.6g} {was.unit}, is {now.value:.6g}"


def _missing(recording: Recording) -> Iterator[Replayed]:
    mapped = {(m.weld_id, m.profile_sha256) for m in recording.force_maps}
    judged = {(v.weld_id, v.profile_sha256) for v in recording.verdicts}
    refused = {r.profile_sha256 for r in recording.rejections if isinstance(r.profile_sha256, str)}
    for weld_id, sha256 in recording.profiles:
        if sha256 not in refused and (weld_id, sha256) not in judged:
            yield Replayed(weld_id, "verdict", None, ("no verdict was recorded for this profile",))
    for weld_id, _ in sorted(judged - mapped):
        yield Replayed(weld_id, "verdict", None, ("no force map was recorded for this verdict",))
    for error in recording.unreadable:
        yield Replayed("?", "message", None, (str(error),))
