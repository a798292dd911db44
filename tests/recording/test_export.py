import csv
import json
import shutil
import sys
from pathlib import Path

import msgspec
import pyarrow.parquet
import pytest
from mcap.reader import make_reader

from tests.harness.bags import EPOCH_NS, numbered, profile, record, rejection
from tests.soak.second_reader import check_bag, check_export
from weld_force_ros import recording
from weld_force_ros.cli import main
from weld_force_ros.errors import BagError, InputError
from weld_force_ros.messages import (
    ForceMap,
    Message,
    Rejection,
    Verdict,
    WeldProfile,
    decode,
    encode,
    identity,
    measurement_id,
)
from weld_force_ros.recording import table_export

DEMO = Path(__file__).parents[2] / "bags" / "demo"


def test_broken_message_stands_in_its_place_among_the_others(tmp_path):
    directory = record(
        tmp_path / "run",
        [
            ("/line_2/weld_profile", profile(), 0),
            ("/line_2/rejection", '{"schema_version": "1.0", "source": 5}', 1),
            ("/chatter", "not ours", 2),
            ("/rejection", rejection("too short", 4), 3),
        ],
    )
    first, broken, last = recording.contract_messages(recording.open_bag(directory))
    assert isinstance(first.message, WeldProfile)
    assert (first.topic, first.log_time_ns) == ("/line_2/weld_profile", EPOCH_NS)
    assert isinstance(broken.message, BagError)
    assert f"/line_2/rejection at log time {EPOCH_NS + 1} ns: Rejection: " in str(broken.message)
    assert isinstance(last.message, Rejection)
    assert (last.message.reason, last.message.sequence) == ("too short", 4)


def test_export_validates_against_the_schemas_it_carries(tmp_path):
    with_unknown_field = json.dumps({**json.loads(rejection("x")), "extra": None})
    sent = [("/weld_profile", profile(), 0), ("/rejection", with_unknown_field, 1), ("/rejection", "{}", 2)]
    directory = record(tmp_path / "run", sent)
    refused = []
    report = recording.export_json(directory, tmp_path / "run.mcap", on_invalid=refused.append)
    assert (report.message_count, report.invalid_count) == (2, 1)
    assert [f"/rejection at log time {EPOCH_NS + 2} ns" in str(error) for error in refused] == [True]
    assert check_export(tmp_path / "run.mcap") == 2
    with (tmp_path / "run.mcap").open("rb") as stream:
        found = list(make_reader(stream).iter_messages())
    assert not any(b"null" in message.data for _, _, message in found)
    assert [(s.name, c.topic, m.log_time - EPOCH_NS) for s, c, m in found] == [
        ("weld_force_ros/WeldProfile", "/weld_profile", 0),
        ("weld_force_ros/Rejection", "/rejection", 1),
    ]
    assert json.loads(found[0][2].data) == json.loads(profile())


def test_export_of_nothing_leaves_no_file(tmp_path):
    directory = record(tmp_path / "run", numbered(3))
    with pytest.raises(BagError, match="holds no usable message of this suite"):
        recording.export_json(directory, tmp_path / "run.mcap")
    assert [p.name for p in tmp_path.iterdir()] == ["run"]


@pytest.mark.slow
def test_export_of_the_demo_is_read_by_others(tmp_path):
    report = recording.export_json(DEMO, tmp_path / "demo.mcap")
    assert report.invalid_count == 0
    assert check_export(tmp_path / "demo.mcap") == report.message_count > 20


# Tables


@pytest.fixture(scope="module")
def exported(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("tables") / "demo"
    report = recording.export_tables(DEMO, folder, ["csv", "parquet"])
    assert report.invalid_count == 0
    return folder


def demo_messages(kind: type[Message]) -> list:
    return [m for _, m, _ in recording.contract_messages(recording.open_bag(DEMO)) if isinstance(m, kind)]


def csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_tables_hold_what_was_recorded(exported):
    maps = csv_rows(exported / "force_maps.csv")
    profiles = csv_rows(exported / "profiles.csv")
    samples = csv_rows(exported / "profile_samples.csv")
    verdicts = csv_rows(exported / "verdicts.csv")
    by_place = {
        (r["profile_id"], r["running"], float(r["speed_kmh"]), float(r["position_m"])): float(r["peak_force_n"])
        for r in maps
    }
    expected = {
        (identity(m), running, speed, position): of.peak_force_n[i * len(m.positions_m) + k]
        for m in demo_messages(ForceMap)
        for running, of in (("with", m), ("against", m.against))
        for i, speed in enumerate(m.speeds_kmh)
        for k, position in enumerate(m.positions_m)
    }
    assert by_place == expected  # to the last digit
    assert len(maps) == len(expected)
    for found, message in zip(profiles, demo_messages(WeldProfile), strict=True):
        heights_m = [float(r["z_m"]) for r in samples if r["profile_id"] == found["profile_id"]]
        assert (found["weld_id"], int(found["sample_count"]), heights_m) == (
            message.weld_id, len(message.z_m), message.z_m,
        )  # fmt: skip
    assert [(v["weld_id"], v["decision"]) for v in verdicts] == [
        (v.weld_id, v.decision) for v in demo_messages(Verdict)
    ]
    assert len(csv_rows(exported / "criteria.csv")) == sum(len(v.criteria) for v in demo_messages(Verdict))


@pytest.mark.parametrize("table", [table.name for table in table_export.TABLES])
def test_parquet_and_csv_say_the_same(exported, table):
    found = pyarrow.parquet.read_table(exported / f"{table}.parquet").to_pylist()

    def as_text(cell: object) -> str:
        return "" if cell is None else str(cell).lower() if isinstance(cell, bool) else str(cell)

    expected = csv_rows(exported / f"{table}.csv")
    assert [{name: as_text(cell) for name, cell in row.items()} for row in found] == expected


def test_tables_are_written_in_parts_and_alike(exported, tmp_path, monkeypatch):
    monkeypatch.setattr(table_export, "ROWS_AT_ONCE", 100)
    recording.export_tables(DEMO, tmp_path / "parts", ["parquet"])
    path = tmp_path / "parts" / "profile_samples.parquet"
    assert pyarrow.parquet.ParquetFile(path).num_row_groups > 1
    assert pyarrow.parquet.read_table(path) == pyarrow.parquet.read_table(exported / path.name)


def test_text_with_separators_comes_back_from_csv(tmp_path):
    reason = 'line 3: "1,2";\n=1+1 ✓'
    directory = record(tmp_path / "run", [("/left/rejection", rejection(reason), 5)])
    recording.export_tables(directory, tmp_path / "tables")
    (row,) = csv_rows(tmp_path / "tables" / "rejections.csv")
    assert (row["reason"], row["topic"], row["log_time_ns"]) == (reason, "/left/rejection", str(EPOCH_NS + 5))
    assert (row["profile_id"], row["raw_truncated"]) == ("", "false")


def test_tables_need_a_new_folder_a_known_format_and_something_to_tell(tmp_path, monkeypatch):
    (tmp_path / "mine").mkdir()
    with pytest.raises(BagError, match="mine exists and is not overwritten"):
        recording.export_tables(DEMO, tmp_path / "mine")
    with pytest.raises(InputError, match="format 'xlsx' is unknown; use csv or parquet"):
        recording.export_tables(DEMO, tmp_path / "new", ["xlsx"])
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "pyarrow", None)
        patch.setitem(sys.modules, "pyarrow.parquet", None)
        with pytest.raises(InputError, match=r"need pyarrow; install .*weld_force_ros\[tables\]"):
            recording.export_tables(DEMO, tmp_path / "new", ["parquet"])
    with pytest.raises(BagError, match="holds no usable message of this suite"):
        recording.export_tables(record(tmp_path / "run", numbered(3)), tmp_path / "new")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "run"]


# Outcomes


def test_outcomes_are_counted_by_measurement(tmp_path):
    verdict = demo_messages(Verdict)[0]
    ids = [measurement_id(f"{i}.csv", "0" * 64) for i in range(4)]

    def measured(i: int) -> str:
        return encode(changed(profile(), profile_id=ids[i])).decode()

    def judged(i: int) -> str:
        return encode(msgspec.structs.replace(verdict, profile_id=ids[i])).decode()

    refused = Rejection(source="2.csv", reason="r", remedy="m", profile_id=ids[2])
    sent = [
        *[("/weld_profile", measured(i), 2 * i) for i in (0, 0, 1, 2, 3)],
        ("/verdict", judged(0), 10),
        ("/verdict", judged(1), 11),
        ("/verdict", judged(1), 12),
        ("/rejection", encode(refused).decode(), 13),
        ("/rejection", rejection("no profile at all"), 14),
        ("/rejection", "{", 15),
    ]
    found = recording.count_outcomes(recording.open_bag(record(tmp_path / "run", sent)))
    assert found == recording.OutcomeCounts(measurements=4, verdicts=3, rejections=2, open=1, doubled=1)
    assert recording.count_outcomes(recording.open_bag(record(tmp_path / "other", numbered(2)))) is None


def changed(text: str, **fields: str) -> WeldProfile:
    return msgspec.structs.replace(decode(WeldProfile, text), **fields)


# Commands


def run(capfd, *arguments: object) -> tuple[int, str, str]:
    code = main.main([str(argument) for argument in arguments])
    printed = capfd.readouterr()
    return code, printed.out, printed.out + printed.err


def unfolded(said: str) -> str:
    """Return sentences without the line breaks that a long path has made."""
    return " ".join(said.split())


def test_recover_says_what_was_lost_and_says_the_same_again(tmp_path, capfd):
    directory = record(tmp_path / "run", numbered(50))
    code, _, said = run(capfd, "bag", "recover", directory)
    assert (code, "50 messages recovered to" in said, "nothing lost" in unfolded(said)) == (0, True, True)
    assert check_bag(tmp_path / "run-recovered") == {"/notes": 50}

    whole = (directory / "run_0.mcap").read_bytes()
    (directory / "run_0.mcap").write_bytes(whole[:500])
    shutil.copy(DEMO / "bag_0.mcap", directory / "run_1.mcap")
    for words in ("recovered to", "already"):
        code, _, said = run(capfd, "bag", "recover", directory, tmp_path / "rescued")
        assert (code, words in said, "run_0.mcap was not closed" in unfolded(said)) == (3, True, True)
        assert "lost: 50 messages" in unfolded(said)
    code, _, said = run(capfd, "bag", "recover", directory)
    assert (code, said.count("\n")) == (1, 1)
    assert "holds something else and is not overwritten" in said


def test_info_shows_files_state_and_outcomes(tmp_path, capfd):
    directory = tmp_path / "bag"
    shutil.copytree(DEMO, directory)
    with recording.Recorder(directory):
        code, out, said = run(capfd, "bag", "info", directory, "--json", "-")
    found = json.loads(out)
    assert code == 0
    assert [(file["name"], file["damage"]) for file in found["files"]] == [
        ("bag_0.mcap", None),
        ("bag_1.mcap", "bag_1.mcap was not closed"),
    ]
    assert found["outcomes"]["verdicts"] == len(demo_messages(Verdict))
    assert found["outcomes"]["open"] == 0
    assert "bag_1.mcap was not closed" in said
    assert f"{found['outcomes']['verdicts']} verdicts" in said


@pytest.mark.slow
def test_export_chooses_the_form_by_the_targets_name(tmp_path, capfd):
    assert run(capfd, "bag", "export", DEMO, tmp_path / "demo.mcap")[0] == 0
    assert check_export(tmp_path / "demo.mcap") > 20
    formats = ("--format", "csv", "--format", "parquet")
    assert run(capfd, "bag", "export", DEMO, tmp_path / "tables", *formats)[0] == 0
    assert {p.suffix for p in (tmp_path / "tables").iterdir()} == {".csv", ".parquet"}
    code, _, said = run(capfd, "bag", "export", DEMO, tmp_path / "other.mcap", "--format", "csv")
    assert (code, said.count("\n")) == (2, 1)
