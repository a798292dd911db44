"""Recordings of others: every form that `ros2 bag record` gives, read with the content that is in it."""

import dataclasses
import sys
from pathlib import Path

import pytest
import yaml
import zstandard
from rosbags.rosbag2 import CompressionFormat, CompressionMode
from rosbags.rosbag2 import Writer as RosbagsWriter

from tests.harness.bag_forms import FORMS, one_file, remade
from tests.harness.bags import read_by_rosbags, record, rejection
from weld_force_ros import recording
from weld_force_ros.cli.main import main
from weld_force_ros.errors import BagError
from weld_force_ros.messages import Verdict
from weld_force_ros.recording.replay import replay

DEMO = Path(__file__).parents[2] / "bags" / "demo"
MESSAGES = yaml.safe_load((DEMO / "metadata.yaml").read_text())["rosbag2_bagfile_information"]["message_count"]


@pytest.fixture(scope="module")
def bags(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("forms")
    return {form: remade(DEMO, form, folder / f"bag{number}") for number, form in enumerate(FORMS)}


def content(bag: Path) -> recording.Recording:
    return dataclasses.replace(recording.open_recording(bag), path=Path())


def run(capfd, *words: object) -> tuple[int, str, str]:
    code = main([str(word) for word in words])
    printed = capfd.readouterr()
    return code, printed.out, " ".join((printed.out + printed.err).split())


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_every_message(bags, form):
    demo = [(m.topic, m.log_time_ns, m.data) for m in recording.open_bag(DEMO).messages()]
    assert len(demo) == MESSAGES
    opened = recording.open_bag(bags[form])
    assert [(m.topic, m.log_time_ns, m.data) for m in opened.messages()] == demo
    assert (opened.damage, opened.truncated, opened.lossy) == (None, False, False)
    assert content(bags[form]) == content(DEMO)


LIKE_IT = ("mcap file zstd", "sqlite3 file zstd", "schemas IDL")
"""Forms that the commands read by the same code, once their messages are read, which every form's are."""


@pytest.mark.slow
def test_every_form_replays_equal(bags):
    """What is computed again depends on what was read alone, and that is the same: one form is computed."""
    results = list(replay(recording.open_recording(bags["sqlite3 message zstd"])))
    assert [r.differences for r in results] == [()] * 16
    for form, bag in bags.items():
        assert content(bag) == content(bags["sqlite3 message zstd"]), form


@pytest.mark.slow
@pytest.mark.parametrize(
    "form",
    ["mcap message zstd", *(pytest.param(form, marks=pytest.mark.long) for form in LIKE_IT)],
)
def test_commands_read_it(bags, form, tmp_path, capfd):
    bag = bags[form]
    code, _, said = run(capfd, "replay", "verify", bag)
    assert (code, "force_map: 8 of 8 equal" in said, "verdict: 8 of 8 equal" in said) == (0, True, True), said
    code, lines, _ = run(capfd, "show", bag, "--json", "-")
    assert (code, lines) == (0, run(capfd, "show", DEMO, "--json", "-")[1])
    code, _, said = run(capfd, "bag", "info", bag)
    assert (code, f"{MESSAGES} messages" in said, "without either" in said) == (0, True, True)
    code, _, said = run(capfd, "bag", "export", bag, tmp_path / "out.mcap")
    assert (code, recording.export_json(DEMO, tmp_path / "demo.mcap").message_count) == (
        0,
        recording.summary(tmp_path / "out.mcap").message_count,
    )
    code, _, said = run(capfd, "report", bag, "--out", tmp_path / "page.html")
    assert (code, "8 welds" in said) == (0, True), said


@pytest.mark.parametrize("form", FORMS)
def test_recovered_it_is_read_by_everybody(bags, form, tmp_path):
    report = recording.recover(bags[form], tmp_path / "rescued")
    assert (report.message_count, report.lossy, report.unread_by_others) == (MESSAGES, False, None)
    assert content(tmp_path / "rescued") == content(DEMO)
    clauses = " ".join(report.rewritten)
    assert ("one by one" in clauses, "as a whole" in clauses, "sqlite3" in clauses) == (
        "message" in form,
        "file" in form,
        "sqlite3" in form,
    )
    if not form.startswith("schemas"):  # rosbags decodes nothing without a definition
        assert len(read_by_rosbags(tmp_path / "rescued")) == MESSAGES


def test_file_alone_is_read_without_its_folder(bags):
    for form in FORMS:
        bag = bags[form]
        (file,) = [bag] if bag.is_file() else (path for path in bag.iterdir() if path.suffix != ".yaml")
        assert content(file) == content(DEMO), form


def test_file_unpacked_beside_the_packed_one_counts_once(bags, tmp_path):
    bag = remade(DEMO, "mcap file zstd", tmp_path / "bag")
    packed = bag / "bag.mcap.zstd"
    (bag / "bag.mcap").write_bytes(zstandard.ZstdDecompressor().stream_reader(packed.read_bytes()).read())
    assert recording.summary(bag).message_count == MESSAGES


def test_cut_packed_file_gives_what_stood_before_the_cut(bags, tmp_path):
    whole = (bags["mcap file zstd"] / f"{bags['mcap file zstd'].name}.mcap.zstd").read_bytes()
    (tmp_path / "cut.mcap.zstd").write_bytes(whole[: len(whole) * 2 // 3])
    opened = recording.open_bag(tmp_path / "cut.mcap.zstd")
    found = list(opened.messages())
    assert opened.truncated
    assert 0 < len(found) < MESSAGES
    assert found == list(recording.open_bag(bags["mcap file zstd"]).messages())[: len(found)]


def test_damaged_compressed_message_is_lost_and_counted(tmp_path):
    good, cut = (zstandard.compress(recording.string_cdr(rejection(word))) for word in ("good", "cut"))
    messages = [recording.Recorded("/n", recording.STRING, data, 1, 1) for data in (good, cut[:-5], good)]
    opened = recording.open_bag(one_file(messages, tmp_path / "bag" / "bag_0.mcap"))
    assert len(list(opened.messages())) == 2
    assert (opened.lost_messages, opened.lost_bytes) == (1, len(cut) - 5)


def test_killed_sqlite3_recorder_leaves_what_is_not_read(bags, tmp_path):
    bag = remade(DEMO, "sqlite3", tmp_path / "bag")
    (bag / "bag.db3-wal").write_bytes(b"x" * 4152)
    assert recording.open_bag(bag).damage == "bag.db3 was not closed and has 4152 unreadable bytes"


# What cannot be read says why, in one line, and what would help


def refusal(path: Path) -> str:
    with pytest.raises(BagError) as refused:
        recording.open_bag(path)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_sqlite3_without_rosbags_names_the_extra_and_the_conversion(bags, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.rosbag2", None)
    said = refusal(bags["sqlite3"])
    assert "pip install 'weld_force_ros[foreign]'" in said
    assert "ros2 bag convert" in said
    assert "storage_id: mcap" in said


def test_other_compression_is_named(tmp_path):
    bag = record(tmp_path / "run", [("/n", "x", 0)])
    metadata = yaml.safe_load((bag / "metadata.yaml").read_text())
    metadata["rosbag2_bagfile_information"] |= {"compression_format": "lz4", "compression_mode": "MESSAGE"}
    (bag / "metadata.yaml").write_text(yaml.safe_dump(metadata))
    said = refusal(bag)
    assert "compressed by 'lz4', message by message" in said
    assert "ros2 bag convert" in said


@pytest.mark.parametrize(
    ("name", "data", "words"),
    [
        ("x.db3", b"SQLite format 3\x00" + bytes(600), "cannot be read"),
        ("x.db3", b"", "cannot be read"),
        ("x.mcap.zstd", b"no frame", "is not compressed by zstd"),
        ("x.mcap.zstd", zstandard.compress(b"no recording"), "is not an MCAP file"),
        ("x.db3.zstd", zstandard.compress(b"no database" * 99), "cannot be read"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    said = refusal(tmp_path / name)
    assert words in said
    assert name in said


def test_type_that_nobody_defines_is_an_unreadable_message(tmp_path):
    definition = recording.MessageDefinition("my_msgs/msg/Own", "", schema_encoding="")
    with recording.Recorder(tmp_path / "run") as recorder:
        recorder.write("/own", definition, b"\0\1\0\0", log_time_ns=1, publish_time_ns=1)
    (message,) = recording.open_bag(tmp_path / "run").messages()
    with pytest.raises(BagError, match="no definition of my_msgs/msg/Own"):
        message.content  # noqa: B018


def test_known_type_without_definition_is_decoded_unless_its_hash_is_another(tmp_path):
    data = b"\0\1\0\0" + (b"\0\0\0\0" * 2) + (b"\1\0\0\0\0\0\0\0")
    for number, (digest, known) in enumerate((("", True), ("RIHS01_" + "0" * 64, False))):
        definition = recording.MessageDefinition("std_msgs/msg/Header", "", digest, schema_encoding="ros2idl")
        message = recording.Recorded("/h", definition, data, number, number)
        if known:
            assert (message.content.stamp.sec, message.content.frame_id) == (0, "")
        else:
            with pytest.raises(BagError, match="no definition of std_msgs/msg/Header"):
                message.content  # noqa: B018


def test_verify_that_compared_nothing_is_no_success(tmp_path, capfd):
    bag = record(tmp_path / "run", [("/rejection", rejection("no samples"), 0)])
    code, out, said = run(capfd, "replay", "verify", bag)
    assert (code, out, said.count("weld-force:")) == (2, "", 1)
    assert "holds no force map and no verdict to compare" in said
    assert run(capfd, "replay", bag)[0] == 0


def test_bag_of_an_older_distribution_is_read(tmp_path):
    """Version 8 as Iron writes it: numbers for the quality of service, no hash."""
    writer = RosbagsWriter(tmp_path / "bag", version=8)
    writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    verdict = next(m for m in recording.open_bag(DEMO).messages() if m.topic.endswith("verdict"))
    with writer:
        connection = writer.add_connection("/verdict", "std_msgs/msg/String", msgdef="string data\n", rihs01="RIHS01_0")
        writer.write(connection, 5, verdict.data)
    ((_, message, time_ns),) = recording.contract_messages(recording.open_bag(tmp_path / "bag"))
    assert (isinstance(message, Verdict), time_ns) == (True, 5)
