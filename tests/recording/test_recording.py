"""What counts of a recording in which a file was read more than once."""

from pathlib import Path

from msgspec.structs import replace

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import shipped_profile
from weld_force_ros.messages import TOPICS, Message, Rejection, encode, measurement_id, profile_sha256
from weld_force_ros.recording import STRING, Recorder, string_cdr
from weld_force_ros.recording.recording import Recording, open_recording
from weld_force_ros.recording.weld_records import RejectedRecord, WeldRecord, records_of_recording
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

SETTINGS = simulation_settings(speeds_kmh=[60.0, 120.0], positions=[0.1, 0.4])
LIMITS = load_limits()


def version(scale: float, file: str = "w7.csv", weld_id: str = "W7") -> list[Message]:
    """A measurement of a weld as one version of a file, its map and its verdict."""
    shape = shipped_profile("weld-1-dip")
    z_m = [scale * z for z in shape.z_m]
    sha256 = profile_sha256(shape.x_m, z_m)
    profile = replace(
        shape, weld_id=weld_id, z_m=z_m, profile_sha256=sha256, profile_id=measurement_id(file, sha256),
        file_version_of=file,
    )  # fmt: skip
    force_map = Simulator(SETTINGS).force_map(profile)
    verdict = judge(force_map, LIMITS)
    force_map.profile_id = verdict.profile_id = profile.profile_id
    return [profile, force_map, verdict]


def recorded(folder: Path, messages: list[Message]) -> Recording:
    with Recorder(folder) as recorder:
        for at, message in enumerate([SETTINGS, LIMITS, *messages]):
            text = string_cdr(encode(message).decode())
            recorder.write(TOPICS[type(message)].name, STRING, text, log_time_ns=at, publish_time_ns=at)
    return open_recording(folder)


def test_the_last_version_of_a_file_counts_and_all_are_kept(tmp_path: Path) -> None:
    half, whole, other = version(0.5), version(1.0), version(0.8, "w8.csv", "W8")
    recording = recorded(tmp_path / "bag", [*half, *other, *whole])
    records = records_of_recording(recording, None, LIMITS)
    assert [r.verdict.weld_id for r in records if isinstance(r, WeldRecord)] == ["W8", "W7"]
    assert len(recording.verdicts) == 3
    again = records_of_recording(recording, LIMITS, LIMITS)
    assert {(r.verdict.weld_id, r.verdict.profile_sha256) for r in again if isinstance(r, WeldRecord)} == {
        (message.weld_id, message.profile_sha256) for message in (whole[2], other[2])
    }


def test_a_rejected_half_of_a_file_gives_way_to_the_whole(tmp_path: Path) -> None:
    rejection = Rejection(source="w7.csv", reason="half", remedy="wait", profile_id=measurement_id("w7.csv", "0" * 64))
    stays = Rejection(source="w9.csv", reason="binary", remedy="export", profile_id=measurement_id("w9.csv", "1" * 64))
    recording = recorded(tmp_path / "bag", [rejection, stays, *version(1.0)])
    records = records_of_recording(recording, None, LIMITS)
    assert [r.rejection.source for r in records if isinstance(r, RejectedRecord)] == ["w9.csv"]


def test_before_and_after_grinding_are_two_measurements_of_one_weld(tmp_path: Path) -> None:
    before, after = version(0.5, "before-grinding.csv"), version(0.2, "after-grinding.csv")
    messages = [*before, *after]
    records = records_of_recording(recorded(tmp_path / "bag", messages), None, LIMITS)
    assert [r.verdict.weld_id for r in records if isinstance(r, WeldRecord)] == ["W7", "W7"]


def refused(number: int) -> Rejection:
    profile_id = measurement_id("w7.csv", f"{number:064}")
    return Rejection(source="w7.csv", reason="no", remedy="look", profile_id=profile_id, file_version_of="w7.csv")


def test_of_the_outcomes_of_a_file_the_last_counts_whichever_it_is(tmp_path: Path) -> None:
    def shown(name: str, *messages: Message) -> list[str]:
        records = records_of_recording(recorded(tmp_path / name, list(messages)), None, LIMITS)
        return [r.verdict.profile_id if isinstance(r, WeldRecord) else str(r.rejection.profile_id) for r in records]

    first, second, accepted, later = refused(1), refused(2), version(0.5), version(1.0)
    other = version(0.8, "w8.csv", "W8")
    assert shown("refused twice", first, second) == [second.profile_id]
    assert shown("at last accepted", first, second, *accepted) == [accepted[0].profile_id]
    assert shown("at last refused", *other, *accepted, first) == [other[0].profile_id, first.profile_id]
    assert shown("back again", *accepted, first, *later) == [later[0].profile_id]
    assert shown("one more", first, *accepted, second, *later, *other) == [later[0].profile_id, other[0].profile_id]
