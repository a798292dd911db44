"""A recording's profiles, settings, force maps and verdicts, sorted by kind."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from weld_force_ros.errors import BagError
from weld_force_ros.messages import (
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Rejection,
    SimulationSettings,
    Verdict,
    WeldProfile,
    identity,
)
from weld_force_ros.recording.contract_messages import contract_messages
from weld_force_ros.recording.reader import open_bag

SimulationKey = tuple[str, str, str]
"""Weld, profile and simulation settings: what force map, history and verdict share; see `simulation_key`."""


@dataclass
class Recording:
    """The contract messages of a bag in log order.

    Attributes:
        path: the bag folder or file.
        damage: what is wrong with its files, in a clause; None if nothing is.
        profiles: by weld and `profile_sha256`, as two welds may have the same geometry.
        settings: by `config_sha256`.
        limits: by `limits_sha256`.
        unreadable: an error for each message that breaks the contract.
        superseded: identities of outcomes whose file was later read again: a newer version, or by other options.
    """

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
    superseded: set[str] = field(default_factory=set)

    def welds_without_outcome(self) -> Iterator[str]:
        """Yield the weld of each profile that has neither a verdict nor a rejection."""
        judged = {(verdict.weld_id, verdict.profile_sha256) for verdict in self.verdicts}
        rejected = {r.profile_sha256 for r in self.rejections if isinstance(r.profile_sha256, str)}
        for weld_id, sha256 in self.profiles:
            if sha256 not in rejected and (weld_id, sha256) not in judged:
                yield weld_id


def open_recording(path: Path) -> Recording:
    """Read a bag folder or one of its files, intact or cut, and sort its messages by kind.

    Raises:
        BagError: not a readable bag, or one without a message of this package.
    """
    bag = open_bag(path)
    recording = Recording(path, bag.damage)
    versions: dict[tuple[str, str], str] = {}
    for _, message, _ in contract_messages(bag):
        match message:
            case WeldProfile():
                recording.profiles[message.weld_id, message.profile_sha256] = message
                if isinstance(message.file_version_of, str):
                    recording.superseded |= _older_versions(message, message.file_version_of, versions, recording)
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
                if isinstance(message.file_version_of, str):
                    recording.superseded |= _outcomes_before(message, message.file_version_of, versions, recording)
                recording.rejections.append(message)
            case BagError():
                recording.unreadable.append(message)
    if not (recording.profiles or recording.rejections or recording.force_maps or recording.unreadable):
        raise BagError(f"{path} holds no message of this suite", "record with `weld-force up` or `weld-force demo`")
    return recording


def _older_versions(
    profile: WeldProfile, file: str, versions: dict[tuple[str, str], str], recording: Recording
) -> set[str]:
    """Return the earlier measurements that the same file held of a weld, and rejections of it, and note this one."""
    now = identity(profile)
    before = versions.get((file, profile.weld_id), now)
    versions[file, profile.weld_id] = now
    return ({before} | _rejections_of(file, recording)) - {now}


def _outcomes_before(
    rejection: Rejection, file: str, versions: dict[tuple[str, str], str], recording: Recording
) -> set[str]:
    """Return all earlier measurements and rejections of a file that is now refused, and forget them."""
    welds = [version for version in versions if version[0] == file]
    return ({versions.pop(version) for version in welds} | _rejections_of(file, recording)) - {
        str(rejection.profile_id)
    }


def _rejections_of(file: str, recording: Recording) -> set[str]:
    return {str(r.profile_id) for r in recording.rejections if r.source == file and isinstance(r.profile_id, str)}


def judged_together(force_maps: Iterable[ForceMap]) -> list[list[ForceMap]]:
    """Return force maps in groups of one verdict: a weld's under each vehicle, in the order of the vehicles.

    Of a map that was computed twice the last counts. A group is left out if one of its maps is missing, as that vehicle
    might decide.
    """
    groups: dict[tuple[str, ...], dict[str, ForceMap]] = {}
    for force_map in force_maps:
        group = (force_map.weld_id, force_map.profile_sha256, *force_map.configs_judged)
        groups.setdefault(group, {})[force_map.config_sha256] = force_map
    return [
        [by_config[config] for config in configs]
        for (_, _, *configs), by_config in groups.items()
        if by_config.keys() >= set(configs)
    ]


def simulation_key(message: ForceMap | ForceHistory | Verdict) -> SimulationKey:
    """Return the weld, profile and simulation settings that a message is about."""
    return message.weld_id, message.profile_sha256, message.config_sha256
