"""What the report is about: welds with all that is known of them, gathered from a recording or from force maps."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec.structs import replace as changed

from weld_force_ros.assessment.judge import judge
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
)
from weld_force_ros.recording.replay import Recording

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


def recorded(recording: Recording, limits: AssessmentSettings | None, fallback: AssessmentSettings) -> list[Record]:
    """The welds of a recording in the order judged, then its rejections.

    Args:
        recording: of the suite.
        limits: to judge every map anew with; None leaves recorded verdicts as they are.
        fallback: to judge maps with that have no verdict, where the recording holds no limits.
    """
    maps = {(m.weld_id, m.profile_sha256, m.config_sha256): m for m in recording.force_maps}
    histories = {(h.weld_id, h.profile_sha256, h.config_sha256): h for h in recording.histories}
    last_limits = next(reversed(recording.limits.values()), fallback)

    def weld(verdict: Verdict, by: AssessmentSettings | None) -> WeldRecord:
        key = (verdict.weld_id, verdict.profile_sha256, verdict.config_sha256)
        return WeldRecord(
            verdict=verdict,
            force_map=maps.get(key),
            profile=recording.profiles.get(key[:2]),
            history=histories.get(key),
            settings=recording.settings.get(verdict.config_sha256),
            limits=by,
        )

    entries: list[Record] = []
    if limits is None:
        entries += [weld(v, recording.limits.get(v.limits_sha256)) for v in recording.verdicts]
    judged = {(v.weld_id, v.profile_sha256, v.config_sha256) for v in recording.verdicts} if limits is None else set()
    by = limits or last_limits
    entries += [weld(judge(m, by), by) for key, m in maps.items() if key not in judged]
    return entries + [RejectedRecord(r) for r in recording.rejections]


def read_maps(path: Path) -> list[ForceMap]:
    """Force maps from JSON lines, as `weld-force simulate --json FILE` writes them.

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


def mapped(maps: Sequence[ForceMap], limits: AssessmentSettings) -> list[Record]:
    """Welds of which only the force map is known, judged now."""
    return [WeldRecord(verdict=judge(m, limits), force_map=m, limits=limits) for m in maps]


def with_grinding(
    entries: Sequence[Record],
    grind: Grind,
    *,
    on_done: Callable[[], None],
    on_failed: Callable[[WeldRecord, WeldForceError], None],
) -> Iterator[Record]:
    """The same entries, with advice on grinding for every weld that is not accepted and whose geometry is known.

    Args:
        entries: of a recording.
        grind: finds the least grinding that brings a weld within limits.
        on_done: called after each entry.
        on_failed: called for a weld of which no advice can be given; it stays as it was.
    """
    for entry in entries:
        advised = entry
        if isinstance(entry, WeldRecord) and entry.verdict.decision != "accept":
            try:
                advised = _ground(entry, grind)
            except WeldForceError as error:
                on_failed(entry, error)
        yield advised
        on_done()


def _ground(weld: WeldRecord, grind: Grind) -> WeldRecord:
    if weld.profile is None or weld.settings is None or weld.limits is None:
        return weld
    # A recording's profile may have been stated anew since; its line speed and place are those of the map.
    return replace(weld, grinding=grind(_as_mapped(weld.profile, weld.force_map), weld.settings, weld.limits))


def _as_mapped(profile: WeldProfile, force_map: ForceMap | None) -> WeldProfile:
    if force_map is None:
        return profile
    return changed(profile, line_speed_kmh=force_map.line_speed_kmh, weld_position_m=force_map.weld_position_m)
