import html
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import dask
import duckdb
import numpy as np
import pandas as pd
import polars as pl
import psutil
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import xarray as xr
from msgspec import UNSET
from msgspec.structs import replace

from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.campaign import (
    batch_records,
    batch_task,
    campaign_file,
    dask_run,
    plan,
    profile_table,
    query,
    sources,
    synthetic_network,
    tables,
)
from weld_force_ros.campaign.profile_table import RejectedRow
from weld_force_ros.cli import main
from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.measurement import profile_file
from weld_force_ros.recording.recording import open_recording
from weld_force_ros.simulation.settings import DEFAULT_TRACK
from weld_force_ros.simulation.simulator import Simulator

pytestmark = pytest.mark.slow

HOSTILE = "</script><img src=x onerror=alert(1)>"
CAMPAIGN = """
name: northern lines
sources:
  - {table: north.parquet, line: north}
  - {folder: south, line: south}
vehicles:
  freight: {static_load_n: 110.0e+3}
  light: {static_load_n: 70.0e+3, mass_kg: 600.0}
sections:
  - {name: first, track: bilbao, lines: [north], chainage_m: [0, 180], vehicles: [freight, light]}
  - {name: rest, track: bilbao-viscous, vehicles: [light]}
speeds: [100, 160, 220]
positions: 3
batch_welds: 12
"""
COMMAND = [sys.executable, "-m", "weld_force_ros.cli", "campaign"]
# The first line's 20 welds lie in the section that two vehicles run over, 3 of its rows and 1 of 9 files are unusable.
WELDS, VERDICTS, UNDER_VEHICLES, REJECTIONS = 32, 20 + 8, 20 + 20 + 8, 4


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    made = tmp_path_factory.mktemp("network")
    welds = list(synthetic_network.network(20, seed=1))
    welds[3].weld_id = HOSTILE
    profile_table.write(made / "north.parquet", [*welds, *(RejectedRow("bag", "no such", "remedy") for _ in range(3))])
    (made / "south").mkdir()
    for weld in synthetic_network.network(8, seed=2):
        profile_file.write_profile(weld, made / "south" / f"{weld.weld_id}.csv")
    (made / "south" / "zz.csv").write_text("x,z\n0,0\n", encoding="utf-8")
    (made / "north.yaml").write_text(CAMPAIGN, encoding="utf-8")
    return made


def planned(folder, out, file="north.yaml"):
    campaign = replace(campaign_file.read(folder / file), out=out)
    return plan.make(campaign, sources.find(campaign)), out


def computed(folder, out, but=(), file="north.yaml"):
    """The campaign in this process, without Dask; batches in `but` are left open."""
    its_plan, _ = planned(folder, out, file)
    finished = {record.batch for record in dask_run.prepare(its_plan, out)}
    for batch in sources.batches(its_plan.sources, its_plan.batch_welds):
        if batch.number not in finished and batch.number not in but:
            batch_task.assess_batch(str(out), its_plan.sha256, batch)
    return its_plan


@pytest.fixture(scope="module")
def results(folder):
    out = folder / "here"
    dask_run.complete(computed(folder, out), out)
    return out


def manifest(out):
    return json.loads((out / batch_records.MANIFEST).read_text(encoding="utf-8"))


def workers(client):
    return [child for child in client.children(recursive=True) if "spawn_main" in " ".join(child.cmdline())]


def wait_until(true, seconds=120.0):
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_killed_worker_and_client_change_nothing(folder, tmp_path):
    (folder / "fine.yaml").write_text(CAMPAIGN.replace("batch_welds: 12", "batch_welds: 1"), encoding="utf-8")
    out = tmp_path / "killed"
    command = [*COMMAND, "fine.yaml", "--workers", "1", "--no-page", "--out", str(out)]
    with (tmp_path / "said").open("w") as said, subprocess.Popen(command, cwd=folder, stderr=said) as process:
        client = psutil.Process(process.pid)
        wait_until(lambda: list((out / batch_records.FOLDER).glob("*.json")) or process.poll() is not None)
        for worker in workers(client):
            worker.send_signal(signal.SIGKILL)
        at_the_kill = len(list((out / batch_records.FOLDER).glob("*.json")))
        wait_until(
            lambda: len(list((out / batch_records.FOLDER).glob("*.json"))) > at_the_kill or process.poll() is not None
        )
        process.send_signal(signal.SIGKILL)
    whole = tmp_path / "whole"
    found = [dask_run.complete(computed(folder, to, file="fine.yaml"), to) for to in (out, whole)]
    assert found[0].results_sha256 == found[1].results_sha256
    assert len(pd.read_parquet(out / "verdicts")) == VERDICTS
    assert not [*out.rglob("*.part"), *out.rglob("*.partial")]
    assert "dashboard: http://127.0.0.1:" in (tmp_path / "said").read_text(encoding="utf-8")


def test_resumed_is_identical_and_finished_batches_stay(folder, results, tmp_path):
    out = tmp_path / "resumed"
    computed(folder, out, but=(1,))
    kept = {path: path.stat().st_mtime_ns for path in (out / "verdicts").rglob("*.parquet")}
    chunk = next(path for path in (out / "maps.zarr").rglob("c/0/0/0"))
    damaged = chunk.read_bytes()
    chunk.write_bytes(damaged[:-1])
    its_plan = computed(folder, out)
    assert chunk.read_bytes() == damaged
    assert [path for path, at in kept.items() if path.stat().st_mtime_ns == at], "a finished batch was computed again"
    assert dask_run.complete(its_plan, out).results_sha256 == manifest(results)["results_sha256"]


def test_results_read_by_pandas_polars_duckdb_and_xarray(results):
    by_pandas = pd.read_parquet(results / "verdicts")
    by_polars = pl.read_parquet(results / "verdicts" / "**" / "*.parquet")
    by_duckdb = duckdb.sql(f"SELECT count(*), sum(peak_force_n) FROM '{results}/verdicts/**/*.parquet'").fetchall()[0]  # noqa: S608
    assert len(by_pandas) == len(by_polars) == by_duckdb[0] == VERDICTS
    assert by_pandas.peak_force_n.sum() == pytest.approx(by_duckdb[1]) == by_polars["peak_force_n"].sum()
    assert set(by_pandas.section.astype(str)) == {"first", "rest"}
    maps = xr.open_zarr(results / "maps.zarr", group="first/freight", consolidated=False)
    assert maps.peak_force_n.dims == ("weld", "speed_kmh", "position_m")
    assert (maps.peak_force_n.units, maps.speed_kmh.units, maps.position_m.units) == ("N", "km/h", "m")
    assert maps.sizes["weld"] == WELDS
    row = query.connect(results).sql("FROM vehicles WHERE section = 'first' AND vehicle = 'freight'").df().iloc[0]
    at = maps.isel(weld=int(row.weld_number)).sel(
        speed_kmh=row.worst_speed_kmh, position_m=row.worst_position_m, method="nearest"
    )
    assert float(at.peak_force_n) == pytest.approx(row.peak_force_n, rel=1e-6)
    assert float(at.chainage_m) == row.chainage_m


@pytest.mark.parametrize(
    ("kind", "schema"), [("verdicts", tables.VERDICTS), ("other_vehicles", tables.VERDICTS), ("speeds", tables.SPEEDS)]
)
def test_schema_of_every_part(results, kind, schema):
    parts = list((results / kind).rglob("*.parquet"))
    assert parts
    assert all(pq.read_schema(part).equals(schema) for part in parts)


def test_verdicts_are_those_of_the_one_composition(folder, results):
    its_plan, _ = planned(folder, results)
    settings = its_plan.sections[0].vehicles["freight"]
    weld = next(synthetic_network.network(1, seed=1))
    verdict = judge(Simulator(settings, curves=False).force_map(weld), load_limits())
    row = query.ask(results, "SELECT * FROM vehicles WHERE weld_number = 0 AND vehicle = 'freight'").records[0]
    assert (row["decision"], row["reason"]) == (verdict.decision, verdict.reason)
    assert (row["peak_force_n"], row["config_sha256"]) == (verdict.peak_force_n, settings.config_sha256)
    assert {f"value_{c.name}": row[f"value_{c.name}"] for c in verdict.criteria} == {
        f"value_{c.name}": c.value for c in verdict.criteria
    }


def test_a_weld_has_the_verdict_of_the_vehicle_that_decides(folder, results):
    its_plan, _ = planned(folder, results)
    simulators = {name: Simulator(one, curves=False) for name, one in its_plan.sections[0].vehicles.items()}
    grave = ["accept", "undecided", "grind", "reject"].index
    expected = []
    for number, weld in enumerate(profile_table.read(folder / "north.parquet", 0, 20)):
        under = {name: judge(simulator.force_map(weld), load_limits()) for name, simulator in simulators.items()}
        rank = {n: (grave(v.decision), v.force.exceeding, v.peak_force_n / v.static_load_n) for n, v in under.items()}
        deciding = sorted(rank, key=rank.__getitem__)[-1]
        expected.append((number, deciding, under[deciding].decision, under[deciding].peak_force_n))
    assert len({vehicle for _, vehicle, _, _ in expected}) == 2, "both decide somewhere, or the test says nothing"
    asked = "SELECT weld_number, vehicle, decision, peak_force_n FROM verdicts WHERE line = 'north' ORDER BY 1"
    assert query.ask(results, asked).rows == expected
    assert len(pd.read_parquet(results / "other_vehicles")) == UNDER_VEHICLES - VERDICTS
    counted = "SELECT count(*), count(DISTINCT (weld_number, vehicle)), count(section) FROM vehicles"
    assert query.ask(results, counted).rows == [(UNDER_VEHICLES,) * 3]


def test_a_weld_with_a_vehicle_that_cannot_be_assessed_has_no_verdict(folder, monkeypatch):
    assessor = batch_task.Assessor(planned(folder, folder)[0])
    (batch, *_) = sources.batches(assessor.plan.sources, 3)
    welds = list(assessor.welds(batch))

    def force_maps_but_of_the_light_vehicle(simulator, profiles):
        light = simulator.settings.static_load_n < 100e3
        return [
            NumericalError("diverged", "x") if light and p is welds[1].weld else simulator.force_map(p)
            for p in profiles
        ]

    monkeypatch.setattr(batch_task, "_force_maps", force_maps_but_of_the_light_vehicle)
    outcomes = assessor.assess(welds)
    (rejected,) = (one.row for one in outcomes if isinstance(one, batch_task.RejectedWeld))
    assert (rejected["weld_number"], rejected["vehicle"], rejected["reason"]) == (1, "light", "diverged")
    assessed = [(one.number, one.vehicle) for one in outcomes if isinstance(one, batch_task.AssessedWeld)]
    assert assessed == [(0, "freight"), (0, "light"), (2, "freight"), (2, "light")]
    assert sum(one.decides for one in outcomes if isinstance(one, batch_task.AssessedWeld)) == 2


def test_results_of_an_earlier_layout_are_refused_in_a_line(folder, results, tmp_path, capsys):
    older = tmp_path / "older"
    older.mkdir()
    content = json.loads((results / "plan.json").read_text(encoding="utf-8"))
    del content["layout"]
    (older / "plan.json").write_text(json.dumps(content), encoding="utf-8")
    for command in (
        [str(folder / "north.yaml"), "--out", str(older)],
        ["summary", str(older)],
        ["query", "changed", str(older), str(results)],
    ):
        assert main.main(["campaign", *command]) == 2
        said = capsys.readouterr().err.splitlines()[-1]
        assert "laid out otherwise" in said
        assert "--out" in said


def test_rejections_say_why(results):
    rows = query.ask(results, "SELECT source, reason FROM rejections ORDER BY weld_number").rows
    assert rows[:3] == [("bag", "no such", "remedy")[:2]] * 3
    assert rows[3] == ("zz.csv", "x_unit, z_unit, z_positive not stated")


def test_questions(results):
    speeds = pd.read_parquet(results / "speeds")
    at_160 = speeds[speeds.speed_kmh == 160.0]
    over = query.over(results, 170.0, peak_n=100e3)
    worst = at_160.sort_values("peak_force_n").groupby("weld_number").tail(1)
    beyond = worst[worst.peak_force_n > 100e3].sort_values("peak_force_n", ascending=False)
    assert [row["peak_force_n"] for row in over.records] == beyond.peak_force_n.tolist() != []
    assert [row["vehicle"] for row in over.records] == beyond.vehicle.tolist()
    assert len(query.over(results, 160.0).rows) == at_160[~at_160.within_limits].weld_number.nunique()
    rises = query.worse_if_restricted(results, 110.0)
    assert len({row["weld_id"] for row in rises.records}) == len(rises.rows) > 0
    for row in rises.records:
        assert row["to_kmh"] == 100.0
        assert row["peak_restricted_n"] > row["peak_now_n"]
    assert query.changed(results, results).rows == []
    with pytest.raises(InputError, match="views"):
        query.ask(results, "SELECT nonsense")


def test_query_on_the_command_line(results, capsys):
    assert (
        main.main(["campaign", "query", "sql", str(results), "SELECT count(*) AS n FROM verdicts", "--json", "-"]) == 0
    )
    assert json.loads(capsys.readouterr().out) == {"n": VERDICTS}
    assert main.main(["campaign", "query", "over", str(results.parent), "--at", "160"]) == 2
    assert "holds no results" in capsys.readouterr().err


def test_rows_that_cannot_be_used(tmp_path):
    good = next(synthetic_network.network(1, seed=1))
    x, z = good.x_m, good.z_m
    rows = [
        {"x_m": x, "z_m": z},
        {"x_m": x, "z_m": [float("nan"), *z[1:]]},
        {"x_m": x[:5], "z_m": z[:5]},
        {"x_m": x, "z_m": z[:-1]},
        {"x_m": x, "z_m": z, "profile_sha256": "0" * 64},
        {"x_m": x, "z_m": z, "line_speed_kmh": -1.0},
        {"x_m": None, "z_m": z},
    ]
    pq.write_table(pa.Table.from_pylist(rows, profile_table.SCHEMA), tmp_path / "welds.parquet")
    read = list(profile_table.read(tmp_path / "welds.parquet", 0, len(rows)))
    assert [isinstance(weld, RejectedRow) for weld in read] == [False] + [True] * 6
    assert read[0].profile_sha256 == good.profile_sha256
    assert list(profile_table.read(tmp_path / "welds.parquet", 2, 2)) == read[2:4]
    whole = (tmp_path / "welds.parquet").read_bytes()
    (tmp_path / "welds.parquet").write_bytes(whole[: len(whole) // 2])
    assert all(isinstance(weld, RejectedRow) for weld in profile_table.read(tmp_path / "welds.parquet", 0, 7))
    with pytest.raises(InputError, match="columns x_m and z_m"):
        profile_table.count_rows(tmp_path / "welds.parquet")


def test_batches_hold_every_weld_once(folder):
    its_plan, _ = planned(folder, folder)
    cut = list(sources.batches(its_plan.sources, 12))
    assert [(batch.first, batch.welds) for batch in cut] == [(0, 12), (12, 12), (24, 8)]
    assert len(cut) == its_plan.batches
    assert [part.source for part in cut[1].slices] == [0, 1]


def scan(*chainages_m):
    """A file of several welds, with the noise of an instrument, at chainages: the records of a trolley one by one."""
    x_m = np.arange(-0.6, 0.6025, 0.005)
    noise_um = np.random.default_rng(1).normal(0.0, 3.0, (len(chainages_m), len(x_m)))
    rows = [
        f"W{chainage:.0f},{chainage + x:.3f},{z:.1f}"
        for chainage, own in zip(chainages_m, noise_um, strict=True)
        for x, z in zip(x_m, own - 200.0 * (np.abs(x_m) < 0.1) * (1 + np.cos(10 * np.pi * x_m)) / 2, strict=True)
    ]
    return "\n".join(
        ["# x_unit: m", "# z_unit: um", "# z_positive: up", "# line_speed_kmh: 160", "weld,x,z", *rows, ""]
    )


@pytest.fixture
def scanned(tmp_path):
    """A campaign of two welds a batch over a folder with a file of one weld, one of three, and one of none."""
    (tmp_path / "scans" / "sub").mkdir(parents=True)
    (tmp_path / "scans" / "a.csv").write_text(scan(900.0), encoding="utf-8")
    (tmp_path / "scans" / "sub" / "b.csv").write_text(scan(1000.0, 1018.0, 1036.0), encoding="utf-8")
    (tmp_path / "scans" / "sub" / "c.csv").write_text("x,z\n0,0\n", encoding="utf-8")
    (tmp_path / "scans" / "sub" / "d.csv.part").write_text(scan(2000.0), encoding="utf-8")
    text = "name: c\nsources: [{folder: scans}]\nspeeds: [100, 160]\npositions: 2\nbatch_welds: 2\n"
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    return tmp_path


def test_every_weld_of_a_file_is_one_of_the_campaign(scanned):
    names = ("a.csv", "sub/b.csv")
    alone = [weld for name in names for weld in profile_file.read_profiles(scanned / "scans" / name)]
    assert [weld.chainage_m for weld in alone] == pytest.approx([900.0, 1000.0, 1018.0, 1036.0], abs=5e-3)
    out = scanned / "results"
    its_plan = computed(scanned, out, file="c.yaml")
    batches = list(sources.batches(its_plan.sources, 2))
    assert [batch.welds for batch in batches] == [2, 2, 1], "a batch ends within a file"
    read = [row for batch in batches for part in batch.slices for row in sources.read(its_plan.sources[0], part)]
    unlike = ("schema_version", "publisher", "sequence", "stamp", "conditioning")
    for weld, expected in zip(read[:4], alone, strict=True):
        for name in set(weld.__struct_fields__) - set(unlike):
            assert getattr(weld, name) == getattr(expected, name), name
    simulator = Simulator(its_plan.sections[0].vehicles["own"], curves=False)
    verdicts = [judge(simulator.force_map(weld), load_limits()) for weld in alone]
    asked = "SELECT weld_number, weld_id, chainage_m, decision, peak_force_n FROM verdicts ORDER BY weld_number"
    assert query.ask(out, asked).rows == [
        (n, v.weld_id, v.chainage_m, v.decision, v.peak_force_n) for n, v in enumerate(verdicts)
    ]
    assert query.ask(out, "SELECT weld_number, source FROM rejections").rows == [(4, "sub/c.csv")]


def test_processes_read_a_folder_as_one_does(scanned, monkeypatch):
    def tables(out):
        campaign = replace(campaign_file.read(scanned / "c.yaml"), out=out)
        return [Path(source.path).read_bytes() for source in sources.find(campaign)]

    one = tables(scanned / "one")
    monkeypatch.setattr(sources, "_WORTH_PROCESSES", 1)
    assert tables(scanned / "many") == one


def test_a_folder_is_read_once_for_all_runs(scanned):
    said = []
    campaign = campaign_file.read(scanned / "c.yaml")
    first = sources.find(campaign, said.append)
    assert said == ["reading scans: 3 files"]
    assert sources.find(campaign, said.append) == first
    assert len(said) == 1
    (scanned / "scans" / "a.csv").write_text(scan(900.0, 918.0), encoding="utf-8")
    (changed,) = sources.find(campaign, said.append)
    assert changed.welds == first[0].welds + 1
    assert changed.path != first[0].path


def test_bags_are_sources(tmp_path):
    recording = Path(__file__).parents[2] / "bags" / "demo"
    (tmp_path / "c.yaml").write_text(f"name: c\nsources: [{{bag: {recording}}}]\n", encoding="utf-8")
    campaign = campaign_file.read(tmp_path / "c.yaml")
    (found,) = sources.find(campaign)
    (batch,) = sources.batches([found], 256)
    welds = list(sources.read(found, batch.slices[0]))
    assert len(welds) == found.welds > 0
    assert len({weld.profile_sha256 for weld in welds}) == len(welds)
    recorded = open_recording(recording).profiles
    for weld in welds:
        assert weld.noise == recorded[weld.weld_id, weld.profile_sha256].noise
        assert weld.noise is not UNSET


@pytest.mark.parametrize(
    ("text", "vehicles"),
    [
        ("", [("own", 100e3)]),
        ("vehicles: [passenger, freight-22.5t]\n", [("passenger", 54.5e3), ("freight-22.5t", 110.4e3)]),
        ("vehicles: {heavy: {vehicle: passenger, static_load_n: 120.0e+3}}\n", [("heavy", 120e3)]),
        ("sections: [{name: a, vehicles: [freight-22.5t]}]\n", [("freight-22.5t", 110.4e3)]),
    ],
)
def test_vehicles_are_named_or_described(tmp_path, text, vehicles):
    (tmp_path / "c.yaml").write_text(f"name: c\nsources: [{{folder: a}}]\n{text}", encoding="utf-8")
    (section,) = campaign_file.read(tmp_path / "c.yaml").sections
    assert [(name, settings.static_load_n) for name, settings in section.vehicles.items()] == vehicles
    assert {settings.track for settings in section.vehicles.values()} == {DEFAULT_TRACK}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("name: c\n", "sources"),
        ("name: c\nsources: [{folder: absent}]\n", "not there"),
        ("name: c\nsources: [{folder: a, table: b}]\n", "one of folder, table and bag"),
        ("name: c\nsources: [{folder: a}]\nspeed: 1\n", "speed"),
        ("name: c\nsources: [{folder: a}]\nsections: [{name: a/b}]\n", "name"),
        ("name: c\nsources: [{folder: a}]\nsections: [{name: a, vehicles: [v]}]\n", "vehicle v"),
        ("name: c\nsources: [{folder: a}]\nvehicles: [v]\n", "vehicle v"),
        ("name: c\nsources: [{folder: a}]\nvehicles: [../v]\n", "vehicles"),
    ],
)
def test_what_cannot_be_done_is_said_in_a_line(tmp_path, capsys, text, said):
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    assert main.main(["campaign", str(tmp_path / "c.yaml")]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_another_campaign_leaves_results_alone(folder, results, tmp_path):
    (folder / "other.yaml").write_text(CAMPAIGN.replace("[100, 160, 220]", "[100, 160]"), encoding="utf-8")
    before = {path: path.read_bytes() for path in results.rglob("*.parquet")}
    assert main.main(["campaign", str(folder / "other.yaml"), "--out", str(results)]) == 2
    assert before == {path: path.read_bytes() for path in results.rglob("*.parquet")}


def test_plan_is_computed_and_nothing_else(folder, capsys):
    assert main.main(["campaign", str(folder / "north.yaml"), "--plan", "--workers", "64", "--json", "-"]) == 0
    line = json.loads(capsys.readouterr().out)
    low, high = line["seconds_range"]
    assert low <= line["seconds"] <= high
    assert line["welds"] == WELDS
    assert line["bytes"] > 0


def test_population_is_seeded(tmp_path, capsys):
    assert main.main(["population", "3", "--out", str(tmp_path / "files"), "--seed", "7"]) == 0
    assert main.main(["population", "5", "--out", str(tmp_path / "t.parquet"), "--seed", "7"]) == 0
    capsys.readouterr()
    files = [profile_file.read_profile(path) for path in sorted((tmp_path / "files").iterdir())]
    table = list(profile_table.read(tmp_path / "t.parquet", 0, 3))
    assert [weld.profile_sha256 for weld in files] == [weld.profile_sha256 for weld in table]
    assert np.all(np.diff([weld.chainage_m for weld in table]) >= 0)


def test_a_scheduler_that_nobody_started_is_said_in_a_line(folder, tmp_path, capsys):
    command = ["campaign", str(folder / "north.yaml"), "--out", str(tmp_path / "none")]
    with dask.config.set({"distributed.comm.timeouts.connect": "1s"}):
        assert main.main([*command, "--scheduler", "tcp://127.0.0.1:9"]) == 2
    assert "scheduler tcp://127.0.0.1:9" in capsys.readouterr().err.splitlines()[-1]


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """A Dask scheduler with a worker, started as by hand, and its address."""
    address = tmp_path_factory.mktemp("dask") / "scheduler.json"
    dask_command = [sys.executable, "-m", "dask"]
    here = ["--scheduler-file", str(address), "--host", "127.0.0.1", "--no-dashboard"]
    quiet = {"stderr": subprocess.DEVNULL, "stdout": subprocess.DEVNULL}
    with subprocess.Popen([*dask_command, "scheduler", "--port", "0", *here], **quiet) as scheduler:
        wait_until(address.exists)
        with subprocess.Popen([*dask_command, "worker", "--nthreads", "1", *here], **quiet) as worker:
            yield scheduler, json.loads(address.read_text())["address"]
            worker.kill()
        scheduler.kill()


def test_command_on_a_scheduler_gives_what_one_process_gives(folder, results, scheduler):
    command = [*COMMAND, "north.yaml", "--scheduler", scheduler[1], "--json", "-"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    line = json.loads(done.stdout)
    assert (line["welds"], line["verdicts"], line["rejections"]) == (WELDS, VERDICTS, REJECTIONS)
    assert line["results_sha256"] == manifest(results)["results_sha256"]
    page = (folder / "north-results" / "summary.html").read_text(encoding="utf-8")
    assert "connect-src" not in page
    assert "script-src 'sha256-" in html.unescape(page)
    assert HOSTILE not in page
    assert "http://" not in page.partition('<script type="text/plain"')[0]


def test_a_lost_scheduler_is_said_and_the_same_command_goes_on(folder, tmp_path, scheduler):
    """Last in this file: the scheduler is gone afterwards."""
    (folder / "fine.yaml").write_text(CAMPAIGN.replace("batch_welds: 12", "batch_welds: 1"), encoding="utf-8")
    (process, address), out = scheduler, tmp_path / "lost"
    command = [*COMMAND, "fine.yaml", "--no-page", "--out", str(out), "--scheduler", address]
    with subprocess.Popen(command, cwd=folder, stderr=subprocess.PIPE, text=True) as client:
        wait_until(lambda: list((out / batch_records.FOLDER).glob("*.json")) or client.poll() is not None)
        process.kill()
        said = client.communicate(timeout=120)[1]
    assert client.returncode == 2, said
    assert "scheduler was lost" in said.splitlines()[-1]
    its_plan = computed(folder, out, file="fine.yaml")
    assert dask_run.complete(its_plan, out).verdicts == VERDICTS
