import dataclasses
import json
import random
import shutil
import signal
import struct
import subprocess
import sys
import textwrap
from collections.abc import Callable
from io import BytesIO
from pathlib import Path

import pytest
import yaml
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Chunk
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosHistory
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from tests.harness.bags import EPOCH_NS, numbered, read_by_rosbags, record, texts, write
from tests.soak.second_reader import check_bag
from weld_force_ros import recording
from weld_force_ros.errors import BagError

ROS = get_typestore(Stores.ROS2_JAZZY)
SHARE = Path(sys.prefix) / "share"


# Other readers


def test_another_reader_decodes_every_message_of_a_closed_bag(tmp_path):
    sent = [*numbered(50, "/a"), ("/b", "Weißstraße ✓", 60_000)]
    directory = record(tmp_path / "run", sent)
    assert [(t, ns - EPOCH_NS, m.data) for t, ns, m in read_by_rosbags(directory)] == [(t, ns, s) for t, s, ns in sent]


def test_another_reader_accepts_metadata_and_quality_of_service(tmp_path):
    directory = record(tmp_path / "run", numbered(10))
    with AnyReader([directory]) as reader:
        (connection,) = reader.connections
        (quality,) = connection.ext.offered_qos_profiles
        assert (connection.msgtype, connection.digest, connection.msgcount) == (
            "std_msgs/msg/String",
            ROS.hash_rihs01("std_msgs/msg/String"),
            10,
        )
        assert (quality.durability, quality.history) == (QosDurability.TRANSIENT_LOCAL, QosHistory.KEEP_ALL)
        assert (reader.start_time, reader.duration) == (EPOCH_NS, 9000 + 1)  # rosbags counts to after the last
        assert reader.readers[0].ros_distro == "jazzy"
    stored = yaml.safe_load((directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert (stored["version"], stored["relative_file_paths"]) == (9, ["run_0.mcap"])


def test_file_carries_the_same_metadata_twice_and_an_index(tmp_path):
    directory = record(tmp_path / "run", numbered(10))
    stored = yaml.safe_load((directory / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    with (directory / "run_0.mcap").open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        assert [
            (m.name, yaml.safe_load(m.metadata["serialized_metadata"]) == stored) for m in reader.iter_metadata()
        ] == [("rosbag2", True)] * 2
        assert [c.compression for c in reader.get_summary().chunk_indexes] == ["zstd"]
        assert set(reader.get_summary().channels[1].metadata) == {"offered_qos_profiles", "topic_type_hash"}


@pytest.mark.skipif(not (SHARE / "geometry_msgs").is_dir(), reason="the ROS wheels are not installed")
def test_type_with_dependencies_is_decoded_by_both_readers(tmp_path):
    wrench_type = "geometry_msgs/msg/WrenchStamped"
    names = ["std_msgs/Header", "builtin_interfaces/Time", "geometry_msgs/Wrench", "geometry_msgs/Vector3"]

    def text(name: str) -> str:
        package, kind = name.split("/")
        return (SHARE / package / "msg" / f"{kind}.msg").read_text()

    hashes = json.loads((SHARE / "geometry_msgs/msg/WrenchStamped.json").read_text())["type_hashes"]
    definition = recording.MessageDefinition(
        name=wrench_type,
        text="\n".join(
            [text("geometry_msgs/WrenchStamped"), *(f"{'=' * 80}\nMSG: {n}\n{text(n)}" for n in names)],
        ),
        type_hash=next(h["hash_string"] for h in hashes if h["type_name"] == wrench_type),
        offered_qos_profiles=recording.offered_qos(depth=100),
    )
    kinds = ROS.types
    vector = kinds["geometry_msgs/msg/Vector3"]
    header = kinds["std_msgs/msg/Header"](kinds["builtin_interfaces/msg/Time"](5, 6), "rail")
    wrench = kinds[wrench_type](header, kinds["geometry_msgs/msg/Wrench"](vector(0, 0, 123e3), vector(0, 0, 0)))
    with recording.Recorder(tmp_path / "run") as recorder:
        cdr = bytes(ROS.serialize_cdr(wrench, wrench_type))
        recorder.write("/peak_force", definition, cdr, log_time_ns=7, publish_time_ns=6)

    (other,) = read_by_rosbags(tmp_path / "run")
    assert (other[2].wrench.force.z, other[2].header.frame_id) == (123e3, "rail")
    (own,) = recording.open_bag(tmp_path / "run").messages()
    assert (own.content.wrench.force.z, own.content.header.stamp.nanosec) == (123e3, 6)


def test_string_is_serialized_as_ros_does():
    for text in ("", "abc", "ü✓", "x" * 1001):
        expected = bytes(ROS.serialize_cdr(ROS.types["std_msgs/msg/String"](text), "std_msgs/msg/String"))
        assert recording.string_cdr(text) == expected


@pytest.mark.parametrize("mode", [CompressionMode.NONE, CompressionMode.STORAGE])
def test_bag_of_another_writer_is_read(tmp_path, mode):
    writer = RosbagsWriter(tmp_path / "other", version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connection = writer.add_connection("/chatter", "std_msgs/msg/String", typestore=ROS)
        for i in range(20):
            writer.write(connection, i, recording.string_cdr(f"n{i}"))
    assert texts(tmp_path / "other") == [f"n{i}" for i in range(20)]
    assert recording.open_bag(tmp_path / "other").damage is None


@pytest.mark.parametrize("compression", list(CompressionType))
def test_every_compression_of_mcap_is_read(tmp_path, compression):
    path = tmp_path / "other.mcap"
    with path.open("wb") as stream:
        writer = Writer(stream, chunk_size=1000, compression=compression)
        writer.start("ros2")
        schema = writer.register_schema(recording.STRING.name, "ros2msg", b"string data")
        channel = writer.register_channel("/n", "cdr", schema)
        for i in range(100):
            writer.add_message(channel, i, recording.string_cdr(f"n{i}"), i)
        writer.finish()
    assert texts(path) == [f"n{i}" for i in range(100)]


# Interrupted recordings


def test_killed_process_loses_nothing_it_wrote(tmp_path):
    program = f"""
        import os, signal
        from pathlib import Path
        from weld_force_ros import recording
        recorder = recording.Recorder(Path({str(tmp_path / "run")!r}))
        for i in range(100):
            recorder.write("/n", recording.STRING, recording.string_cdr(str(i)), log_time_ns=i, publish_time_ns=i)
        os.kill(os.getpid(), signal.SIGKILL)
    """
    ended = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], timeout=60, check=False)
    assert ended.returncode == -signal.SIGKILL
    assert texts(tmp_path / "run") == [str(i) for i in range(100)]
    opened = recording.open_bag(tmp_path / "run")
    assert (opened.truncated, opened.lost_bytes, opened.damage) == (True, 0, "run_0.mcap was not closed")


def test_running_recording_is_readable_and_recoverable(tmp_path):
    with recording.Recorder(tmp_path / "run") as recorder:
        write(recorder, numbered(30))
        report = recording.recover(tmp_path / "run", tmp_path / "rescued")
        write(recorder, [("/late", "after", 10**6)])
    assert (report.message_count, report.lossy, report.damage) == (30, False, "run_0.mcap was not closed")
    assert [m.data for _, _, m in read_by_rosbags(tmp_path / "rescued")] == [t for _, t, _ in numbered(30)]
    assert len(texts(tmp_path / "run")) == 31


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> dict[str, bytes]:
    """The bytes of one recording, as a killed process leaves them and as closed (in more chunks than one)."""
    directory = tmp_path_factory.mktemp("whole") / "run"
    noise = random.Random(1)  # noqa: S311
    with recording.Recorder(directory) as recorder:
        write(recorder, [("/n", f"{i} {noise.randbytes(40_000).hex()}", i) for i in range(40)])
        plain = recorder.path.read_bytes()
    return {"plain": plain, "closed": recorder.path.read_bytes()}


def attempt(read: Callable[[], list]) -> tuple[list, str]:
    """What was read, or why not; anything but a BagError fails the test."""
    try:
        return read(), ""
    except BagError as error:
        return [], str(error)


def first_words(path: Path) -> list[int]:
    return [int(text.split()[0]) for text in texts(path)]


@pytest.mark.parametrize("form", ["plain", "closed"])
@settings(deadline=None, max_examples=40, database=None)
@given(data=st.data())
def test_cut_file_gives_what_stood_before_the_cut(tmp_path_factory, whole, form, data):
    content = whole[form]
    cut = data.draw(st.integers(0, len(content) - 1) | st.integers(0, 2000) | st.integers(1, 2000).map(lambda n: -n))
    path = tmp_path_factory.mktemp("cut") / "cut.mcap"
    path.write_bytes(content[:cut])
    found, refusal = attempt(lambda: first_words(path))
    if refusal:
        assert refusal.count("\n") == 0
        assert len(content[:cut]) < len(content) / 2
    else:
        assert found == list(range(len(found)))
        assert recording.open_bag(path).truncated
        # 80 kB a message, chunks of 1 MiB at half their size: no more than a record is missing.
        assert len(content[:cut]) - len(found) * len(content) / 40 < (82_000 if form == "plain" else 700_000)
    shutil.rmtree(path.parent)


@pytest.mark.parametrize("form", ["plain", "closed"])
@settings(deadline=None, max_examples=40, database=None)
@given(data=st.data())
def test_flipped_bytes_never_crash_or_reorder(tmp_path_factory, whole, form, data):
    content = bytearray(whole[form])
    places = (
        st.integers(0, len(content) - 1) | st.integers(0, 3000) | st.integers(len(content) - 2000, len(content) - 1)
    )
    for place in data.draw(st.lists(places, min_size=1, max_size=5)):
        content[place] ^= data.draw(st.integers(1, 255))
    path = tmp_path_factory.mktemp("flip") / "flip.mcap"
    path.write_bytes(content)
    times, refusal = attempt(lambda: [m.log_time_ns for m in recording.open_bag(path).messages()])
    assert times == sorted(times)
    assert len(times) <= 40
    _, undecodable = attempt(lambda: texts(path))
    assert (refusal + undecodable).count("\n") == 0
    shutil.rmtree(path.parent)


def test_damaged_chunk_costs_only_itself(tmp_path, whole):
    content = bytearray(whole["closed"])
    with BytesIO(content) as stream:
        chunks = make_reader(stream).get_summary().chunk_indexes
    assert len(chunks) >= 3
    content[chunks[1].chunk_start_offset + chunks[1].chunk_length // 2] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(content)

    times = [(c.message_start_time - EPOCH_NS, c.message_end_time - EPOCH_NS) for c in chunks]
    assert first_words(path) == [i for i in range(40) if not times[1][0] <= i <= times[1][1]]
    report = recording.recover(path, tmp_path / "rescued")
    assert report.lossy
    assert report.lost_bytes == chunks[1].compressed_size
    assert report.lost_messages == 40 - report.message_count > 0


def test_recovering_twice_changes_nothing(tmp_path, whole):
    (tmp_path / "cut.mcap").write_bytes(whole["plain"][:1_000_000])
    first = recording.recover(tmp_path / "cut.mcap")
    target = tmp_path / "cut-recovered"
    before = {p: p.read_bytes() for p in target.iterdir()}
    again = recording.recover(tmp_path / "cut.mcap")
    assert (first.lossy, first.already, again) == (True, False, dataclasses.replace(first, already=True))
    assert {p: p.read_bytes() for p in target.iterdir()} == before
    clean = recording.recover(target, tmp_path / "clean")
    assert (clean.damage, clean.lossy, clean.message_count) == (None, False, first.message_count)
    assert list(recording.open_bag(target).messages()) == list(recording.open_bag(tmp_path / "clean").messages())
    assert check_bag(target) == {"/n": 1_000_000 // 80_050}

    record(tmp_path / "other", numbered(3))
    with pytest.raises(BagError, match="holds something else and is not overwritten"):
        recording.recover(tmp_path / "cut.mcap", tmp_path / "other")
    assert texts(tmp_path / "other") == [text for _, text, _ in numbered(3)]


def test_bad_file_does_not_keep_the_others_from_being_recovered(tmp_path):
    for number in range(3):
        with recording.Recorder(tmp_path / "run") as recorder:
            write(recorder, [("/n", f"{number}.{i}", 100 * number + i) for i in range(10)])
    (tmp_path / "run" / "run_1.mcap").write_bytes(b"no recording at all")
    report = recording.recover(tmp_path / "run")
    assert (report.message_count, report.lossy, report.lost_bytes, report.lost_messages) == (20, True, 19, 10)
    assert report.damage == "run_1.mcap is not an MCAP file"
    assert check_bag(tmp_path / "run-recovered") == {"/n": 20}


# Reading


@settings(deadline=None, max_examples=25, database=None)
@given(times=st.lists(st.integers(0, 20), max_size=40))
def test_messages_come_in_log_order_and_equal_times_as_recorded(tmp_path_factory, times):
    directory = tmp_path_factory.mktemp("order") / "run"
    recorder = recording.Recorder(directory)
    write(recorder, [("/n", f"{i}", t) for i, t in enumerate(times)])
    plain = shutil.copy(recorder.path, directory.with_name("plain.mcap"))
    recorder.close()
    expected = [str(i) for i, _ in sorted(enumerate(times), key=lambda item: item[1])]
    assert texts(directory) == expected
    if times:
        assert texts(plain) == expected
    shutil.rmtree(directory.parent)


def test_topics_can_be_chosen(tmp_path):
    directory = record(tmp_path / "run", [("/a", "1", 0), ("/b", "2", 1), ("/a", "3", 2)])
    assert [m.content.data for m in recording.open_bag(directory).messages({"/a"})] == ["1", "3"]


def test_summary_says_what_a_recording_holds(tmp_path):
    directory = record(tmp_path / "run", [("/a", "1", 0), ("/b", "2", 1), ("/a", "3", 2 * 10**9)])
    found = recording.summary(directory)
    assert (found.message_count, found.start_ns, found.duration_s) == (3, EPOCH_NS, 2.0)
    assert [(t.topic, t.type_name, t.message_count) for t in found.topics] == [
        ("/a", "std_msgs/msg/String", 2),
        ("/b", "std_msgs/msg/String", 1),
    ]
    assert (found.closed, found.indexed, found.lost_bytes, found.damage) == (True, True, 0, None)
    assert found.size_bytes == (directory / "run_0.mcap").stat().st_size


@pytest.mark.parametrize("metadata", [True, False])
def test_split_bag_is_one_recording(tmp_path, metadata):
    split = tmp_path / "split"
    split.mkdir()
    order = [0, 1, 10, 2]
    for part in order:
        rank = sorted(order).index(part)
        record(tmp_path / f"part{part}", [("/n", f"{part}", 100 * rank)])
        shutil.copy(tmp_path / f"part{part}" / f"part{part}_0.mcap", split / f"split_{part}.mcap")
    if metadata:
        names = [f"split/split_{part}.mcap" for part in sorted(order)]
        (split / "metadata.yaml").write_text(
            yaml.safe_dump({"rosbag2_bagfile_information": {"relative_file_paths": names}})
        )
    assert texts(split) == ["0", "1", "2", "10"]
    if metadata:
        (split / "split_2.mcap").unlink()
        assert (recording.summary(split).damage, texts(split)) == ("split_2.mcap is missing", ["0", "1", "10"])


def test_file_that_metadata_does_not_know_is_read(tmp_path):
    directory = record(tmp_path / "run", numbered(3))
    shutil.copy(directory / "run_0.mcap", tmp_path / "kept.mcap")
    known = (directory / "metadata.yaml").read_text()
    with recording.Recorder(directory) as recorder:
        write(recorder, [("/n", "after the crash", 10**6)])
    (directory / "metadata.yaml").write_text(known)
    (directory / "exported.mcap").write_bytes((tmp_path / "kept.mcap").read_bytes())  # of another series
    assert texts(directory) == [text for _, text, _ in numbered(3)] + ["after the crash"]


@settings(deadline=None, max_examples=15, database=None)
@given(files=st.lists(st.lists(st.integers(0, 20), max_size=8), min_size=1, max_size=5))
def test_files_that_overlap_in_time_are_merged_in_log_order(tmp_path_factory, files):
    directory = tmp_path_factory.mktemp("merge") / "run"
    for number, times in enumerate(files):
        with recording.Recorder(directory) as recorder:
            write(recorder, [("/n", f"{number}.{i}", t) for i, t in enumerate(times)])
    written = [(t, f"{number}.{i}") for number, times in enumerate(files) for i, t in enumerate(times)]
    in_time = [text for _, text in sorted(written, key=lambda item: item[0])]
    assert texts(directory) == in_time
    # Each file was brought into log order when it was closed.
    of_files = [[text for text in in_time if text.startswith(f"{number}.")] for number in range(len(files))]
    assert [r.content.data for r in recording.stored(directory)] == [text for file in of_files for text in file]
    shutil.rmtree(directory.parent)


def test_unreadable_file_of_several_is_damage_and_alone_it_is_refused(tmp_path):
    directory = record(tmp_path / "run", numbered(3))
    (directory / "run_1.mcap").write_bytes(bomb(HUGE, HUGE))
    (directory / "run_2.mcap").write_bytes(b"")
    found = recording.open_bag(directory)
    assert found.damage == f"run_1.mcap: claims a record of {HUGE} bytes; run_2.mcap is empty"
    assert (found.lossy, found.statistics.message_count) == (True, 3)
    assert [r.content.data for r in recording.stored(directory)] == [text for _, text, _ in numbered(3)]
    with pytest.raises(BagError, match=f"claims a record of {HUGE} bytes"):
        list(recording.stored(directory / "run_1.mcap"))


def test_broken_metadata_does_not_hide_the_messages(tmp_path):
    directory = record(tmp_path / "run", numbered(3))
    for content in (b"", b"[1, 2", b"\xff\xfe", b"a: 1", b"rosbag2_bagfile_information: {relative_file_paths: 3}"):
        (directory / "metadata.yaml").write_bytes(content)
        assert len(texts(directory)) == 3


def mcap_with(chunk: Chunk) -> bytes:
    stream = BytesIO()
    writer = Writer(stream)
    writer.start("ros2")
    records = RecordBuilder()
    chunk.write(records)
    return stream.getvalue() + records.end()


def bomb(claimed: int, actual: int, compression: str = "zstd") -> bytes:
    data = zstandard.compress(bytes(actual))
    return mcap_with(Chunk(compression, data, 0, 0, 0, claimed))


HUGE = 2**28
RECORD_OF_3_TIB = struct.pack("<BQ", 0x05, 3 * 2**40)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\x89MC", "is not an MCAP file"),
        (b"SQLite format 3\x00" * 9, "is not an MCAP file"),
        (bomb(0, 0)[:40], "holds no readable message"),
        (bomb(HUGE, HUGE), f"claims a record of {HUGE} bytes"),
        (bomb(1000, HUGE), "holds no readable message"),
        (bomb(100, 100, "brotli"), "unknown compression 'brotli'"),
        (bomb(0, 0) + RECORD_OF_3_TIB, "holds no readable message"),
        (bomb(0, 0) + struct.pack("<BQ", 0x05, 2**27) + bytes(2**27), f"claims a record of {2**27 - 22} bytes"),
    ],
    ids=["empty", "short", "other", "header only", "bomb", "lying bomb", "compression", "absurd length", "huge record"],
)
def test_unusable_file_is_refused_in_one_line(tmp_path, content, message):
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(BagError, match=message) as refused:
        recording.open_bag(path)
    assert "\n" not in str(refused.value)
    assert "x.mcap" in str(refused.value)


def test_missing_recording_is_refused_in_one_line(tmp_path):
    with pytest.raises(BagError, match="does not exist"):
        recording.open_bag(tmp_path / "nowhere")
    with pytest.raises(BagError, match=r"holds no \.mcap file"):
        recording.open_bag(tmp_path)


def test_undecodable_message_is_named_and_the_rest_readable(tmp_path):
    with recording.Recorder(tmp_path / "run") as recorder:
        for time_ns, cdr in enumerate((b"", b"\x00\x01\x00\x00\x03\x00\x00\x00\xff\xfe\x00")):
            recorder.write("/n", recording.STRING, cdr, log_time_ns=time_ns, publish_time_ns=0)
        write(recorder, [("/n", "fine", 0)])
    *broken, fine = recording.open_bag(tmp_path / "run").messages()
    for time_ns, message in enumerate(broken):
        with pytest.raises(BagError, match=f"/n at log time {time_ns} ns: "):
            message.content  # noqa: B018
    assert fine.content.data == "fine"
