"""Welds with all that is known of them, from a recording or from force maps: what a report shows."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec.structs import replace as changed

from weld_force_ros.assessment.judge import judge_vehicles
from weld_force_ros.errors import InputError, MessageError, WeldForceError
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    GrindingAdvice,
    Rejection,
    SimulationSettings,
    Verdict,
    WeldProfile,
    decode,
    identity,
)
from weld_force_ros.recording.recording import Recording, judged_together, simulation_key

Grind = Callable[[WeldProfile, SimulationSettings, AssessmentSettings], GrindingAdvice]


@dataclass(frozen=True)
class WeldRecord:
    """A verdict and what it rests on, as far as that is known."""

    verdict: Verdict
    force_map: ForceMap | None = None
    profile: WeldProfile | None = None
    history: ForceHistory | None = None
    settings: SimulationSettings | None = None
    limits: AssessmentSettings | None = None
    grinding: GrindingAdvice | None = None


@dataclass(frozen=True)
class RejectedRecord:
    """An input that ended in a rejection."""

    rejection: Rejection


Record = WeldRecord | RejectedRecord


def records_of_recording(
    recording: Recording, limits: AssessmentSettings | None, fallback: AssessmentSettings
) -> list[Record]:
    """Return the welds of a recording in the order judged, then its rejections; of each file the last version.

    Args:
        recording: what was recorded.
        limits: to judge every map anew with; None leaves recorded verdicts as they are.
        fallback: to judge maps with that have no verdict, where the recording holds no limits.
    """
    maps = {simulation_key(force_map): force_map for force_map in recording.force_maps}
    histories = {simulation_key(history): history for history in recording.histories}
    last_limits = next(reversed(recording.limits.values()), fallback)

    def weld(verdict: Verdict, by: AssessmentSettings | None) -> WeldRecord:
        key = simulation_key(verdict)
        return WeldRecord(
            verdict=verdict,
            force_map=maps.get(key),
            profile=recording.profiles.get(key[:2]),
            history=histories.get(key),
            settings=recording.settings.get(verdict.config_sha256),
            limits=by,
        )

    records: list[Record] = []
    if limits is None:
        verdicts = [v for v in recording.verdicts if identity(v) not in recording.superseded]
        records += [weld(v, recording.limits.get(v.limits_sha256)) for v in verdicts]
    judged = {simulation_key(verdict) for verdict in recording.verdicts} if limits is None else set()
    by, old = limits or last_limits, recording.superseded
    for group in judged_together(recording.force_maps):
        if judged.isdisjoint(map(simulation_key, group)) and identity(group[0]) not in old:
            records.append(weld(judge_vehicles(group, by), by))
    return records + [RejectedRecord(r) for r in recording.rejections if r.profile_id not in old]


def read_maps(path: Path) -> list[ForceMap]:
    """Read force maps from JSON lines, as `weld-force simulate --json FILE` writes them.

    Raises:
        InputError: not readable, or a line is no force map.
    """
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise InputError(
            f"{path}: {error.strerror or error}", "name a bag, or a file of `weld-force simulate --json FILE`"
        ) from None
    maps = []
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        try:
            maps.append(decode(ForceMap, line))
        except MessageError as error:
            raise InputError(
                f"{path}, line {number}: {error.reason}", "name a bag, or a file of `weld-force simulate --json FILE`"
            ) from None
    if not maps:
        raise InputError(f"{path} holds no force map", "write one with `weld-force simulate PROFILE --json FILE`")
    return maps


def records_of_maps(maps: Sequence[ForceMap], limits: AssessmentSettings) -> list[Record]:
    """Return welds of which only the force maps are known, judged now."""
    records: list[Record] = []
    for group in judged_together(maps):
        verdict = judge_vehicles(group, limits)
        deciding = next(one for one in group if one.config_sha256 == verdict.config_sha256)
        records.append(WeldRecord(verdict, deciding, limits=limits))
    return records


def with_grinding(
    records: Sequence[Record],
    grind: Grind,
    *,
    on_done: Callable[[], None],
    on_failed: Callable[[WeldRecord, WeldForceError], None],
) -> Iterator[Record]:
    """Yield the same records, with advice on grinding for each weld that is not accepted and has a known geometry.

    Args:
        records: of a recording.
        grind: finds the least grinding that brings a weld within limits.
        on_done: called after each record.
        on_failed: called for a weld of which no advice can be given; it stays as it was.
    """
    for record in records:
        advised = record
        if isinstance(record, WeldRecord) and record.verdict.decision != "accept":
            try:
                advised = _with_advice(record, grind)
            except WeldForceError as error:
                on_failed(record, error)
        yield advised
        on_done()


def _with_advice(weld: WeldRecord, grind: Grind) -> WeldRecord:
    if weld.profile is None or weld.settings is None or weld.limits is None:
        return weld
    profile, at = weld.profile, weld.force_map
    if at is not None:  # the profile may have been stated anew since; its line speed and place are those of the map
        profile = changed(profile, line_speed_kmh=at.line_speed_kmh, weld_position_m=at.weld_position_m)
    return replace(weld, grinding=grind(profile, weld.settings, weld.limits))
