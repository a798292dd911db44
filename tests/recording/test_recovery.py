"""What `bag recover` keeps of a recording, read by others' readers, and what it says of the rest."""

import shutil
import sys
from pathlib import Path

import pytest
import yaml
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader

from tests.harness.bags import numbered, read_by_rosbags, record, texts, write
from weld_force_ros import recording
from weld_force_ros.errors import BagError
from weld_force_ros.recording.second_reader import check_by_others


def rich_bag(folder: Path, profile: str = "ros2") -> Path:
    """A file with all that the format holds; with another distribution's metadata.yaml."""
    folder.mkdir()
    file = folder / "rich_0.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, chunk_size=500, compression=CompressionType.LZ4)
        writer.start(profile, "libmcap 1.1.0")
        writer.add_metadata("trolley", {"serial": "T-17", "operator": "Weiß"})
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data\n")
        writer.register_schema("std_msgs/msg/Empty", "ros2msg", b"")  # of no channel
        about = {"offered_qos_profiles": "", "topic_type_hash": "", "frame": "rail"}
        talking, silent = (writer.register_channel(topic, "cdr", schema, about) for topic in ("/n", "/silent"))
        for i in range(60):
            writer.add_message(talking, i, recording.string_cdr(f"n{i}"), i + 1, sequence=1000 + i)
        writer.add_attachment(5, 6, "photo.jpg", "image/jpeg", bytes(range(256)) * 40)
        writer.add_metadata("weather", {"t": "-4"})
        writer.finish()
        assert silent != talking
    content = {"version": 5, "ros_distro": "humble", "custom_data": {"line": "6401"}}
    content |= {"relative_file_paths": [file.name], "storage_identifier": "mcap"}
    (folder / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": content}))
    return folder


def test_all_that_the_format_holds_is_kept(tmp_path):
    report = recording.recover(rich_bag(tmp_path / "rich"), tmp_path / "rescued")
    with (tmp_path / "rescued" / "rescued_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        channels = {channel.topic: channel for channel in reader.get_summary().channels.values()}
        assert {topic: channel.metadata for topic, channel in channels.items()} == {
            "/n": {"frame": "rail"},
            "/silent": {"frame": "rail"},
        }
        assert {chunk.compression for chunk in reader.get_summary().chunk_indexes} == {"lz4"}
        assert [(m.sequence, m.log_time, m.publish_time) for _, _, m in reader.iter_messages()] == [
            (1000 + i, i, i + 1) for i in range(60)
        ]
        (attachment,) = reader.iter_attachments()
        assert (attachment.name, attachment.media_type, attachment.data) == (
            "photo.jpg",
            "image/jpeg",
            bytes(range(256)) * 40,
        )
        assert (attachment.create_time, attachment.log_time) == (5, 6)
        own = {m.name: m.metadata for m in reader.iter_metadata() if m.name != "rosbag2"}
        assert own == {"trolley": {"serial": "T-17", "operator": "Weiß"}, "weather": {"t": "-4"}}
    assert (report.message_count, report.lossy, report.unread_by_others) == (60, False, None)
    assert report.rewritten == ("rich_0.mcap: 1 schemas of no channel are left out",)
    with Reader(tmp_path / "rescued") as reader:
        assert reader.ros_distro == "humble"
        assert reader.storage.metadata.custom["line"] == "6401"
        assert {c.topic: c.msgcount for c in reader.connections} == {"/n": 60, "/silent": 0}


def test_second_time_finds_the_same_and_a_lacking_attachment_is_noticed(tmp_path):
    first = recording.recover(rich_bag(tmp_path / "rich"), tmp_path / "rescued")
    assert not first.already
    assert recording.recover(tmp_path / "rich", tmp_path / "rescued").already
    plain = recording.open_bag(tmp_path / "rich").messages()
    with recording.Recorder(tmp_path / "plain") as recorder:
        for message in plain:
            recorder.write(*message[:3], log_time_ns=message.log_time_ns, publish_time_ns=message.publish_time_ns)
    with pytest.raises(BagError, match="holds something else"):
        recording.recover(tmp_path / "rich", tmp_path / "plain")


def test_profile_of_other_recorders_is_kept(tmp_path):
    report = recording.recover(rich_bag(tmp_path / "rich", profile=""), tmp_path / "rescued")
    with (tmp_path / "rescued" / "rescued_0.mcap").open("rb") as stream:
        assert make_reader(stream).get_header().profile == ""
    assert report.unread_by_others is None


def test_other_readers_do_not_find_what_is_not_there(tmp_path):
    bag = record(tmp_path / "run", numbered(5))
    messages = list(recording.open_bag(bag).messages())
    assert check_by_others(bag, messages, recording.open_bag(bag).form) is None
    with pytest.raises(BagError, match="MCAP's own reader finds something else"):
        check_by_others(bag, [*messages, messages[0]], recording.open_bag(bag).form)
    (bag / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 99}")
    assert "rosbags cannot read it" in str(check_by_others(bag, messages, recording.open_bag(bag).form))


def test_without_rosbags_one_other_reader_is_asked(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    report = recording.recover(record(tmp_path / "run", numbered(5)))
    assert (report.message_count, report.unread_by_others) == (5, None)


# The identity of a recording


def test_recording_is_continued_whatever_its_folder_is_called(tmp_path):
    first = record(tmp_path / "monday", [("/n", "first", 0)])
    renamed = first.rename(tmp_path / "tuesday")
    with recording.Recorder(renamed) as recorder:
        write(recorder, [("/n", "second", 1)])
    copied = Path(shutil.copytree(renamed, tmp_path / "copy"))
    (copied / "metadata.yaml").unlink()
    with recording.Recorder(copied) as recorder:
        write(recorder, [("/n", "third", 2)])
    assert texts(copied) == ["first", "second", "third"]
    assert [m.data for _, _, m in read_by_rosbags(copied)] == ["first", "second", "third"]
    assert sorted(path.name for path in copied.iterdir()) == [
        "metadata.yaml", "monday_0.mcap", "monday_1.mcap", "monday_2.mcap",
    ]  # fmt: skip


def test_recovered_recording_takes_the_place_of_the_first_and_is_continued(tmp_path):
    recorder = recording.Recorder(tmp_path / "run")
    write(recorder, [("/n", "first", 0)])
    shutil.copytree(tmp_path / "run", tmp_path / "killed")
    recorder.close()
    recording.recover(tmp_path / "killed")
    shutil.rmtree(tmp_path / "run")
    (tmp_path / "killed-recovered").rename(tmp_path / "run")
    with recording.Recorder(tmp_path / "run") as recorder:
        write(recorder, [("/n", "second", 1)])
    assert texts(tmp_path / "run") == ["first", "second"]


def test_identity_stays_and_others_recordings_have_none(tmp_path):
    def identity(bag: Path) -> str:
        content = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
        return content["custom_data"]["weld_force_ros.recording_id"]

    first = record(tmp_path / "run", [("/n", "first", 0)])
    known = identity(first)
    record(tmp_path / "run", [("/n", "second", 1)])
    recording.recover(first)
    assert identity(first) == identity(tmp_path / "run-recovered") == known
    assert identity(record(tmp_path / "other", [("/n", "first", 0)])) != known

    (first / "metadata.yaml").write_text("rosbag2_bagfile_information: {version: 5}")  # as written anew by others
    recording.recover(first, tmp_path / "again")
    assert identity(tmp_path / "again") == known
    with Reader(tmp_path / "again") as reader:
        assert reader.ros_distro == "jazzy"

    rich_bag(tmp_path / "rich").rename(tmp_path / "others")
    with pytest.raises(BagError, match="exists and is not overwritten"):
        recording.Recorder(tmp_path / "others")
