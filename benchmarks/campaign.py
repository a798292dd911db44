"""Measure campaigns on this machine, each figure as a JSON line: `python -m benchmarks.campaign`.

Campaigns run as a user runs them, each in processes of its own. Rates are of the time from when every worker has
finished a batch to the end, as starting takes as long for few welds as for many; `whole_s` has everything. The bare
kernel simulates prepared wheel paths over the same grid, in as many processes, right before and after.
"""

import hashlib
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import msgspec
import psutil  # type: ignore[import-untyped]
import typer

from weld_force_ros.campaign import (
    batch_records,
    campaign_file,
    estimate,
    plan,
    profile_table,
    sources,
    synthetic_network,
)
from weld_force_ros.simulation.settings import parse_speeds, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

_SPEEDS = "80:300:20"
_POSITIONS = 5
_GRID = f"speeds: {_SPEEDS}\npositions: {_POSITIONS}\n"
_SMALL_GRID = "speeds: [100, 200]\npositions: 2\n"
_KERNEL_WELDS = 1500
_KILLS = 20
_REPEATED_WELDS = 5000  # smaller campaigns are run until they have as many, as their time is short and uncertain
_KILLED_WELDS = 3000
_COMMAND = [sys.executable, "-m", "weld_force_ros.cli", "campaign"]


@dataclass(frozen=True)
class _Run:
    """A finished campaign."""

    welds: int
    whole_s: float
    welds_per_s: float
    peak_mb: dict[str, float]
    results_sha256: str

    def figures(self) -> dict[str, Any]:
        return {
            "welds": self.welds, "whole_s": round(self.whole_s, 1), "welds_per_s": round(self.welds_per_s, 1),
            "peak_memory_mb": self.peak_mb, "results_sha256": self.results_sha256[:16],
        }  # fmt: skip


class Bench:
    """Campaigns over one population, in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def campaign(self, welds: int, grid: str = _GRID) -> Path:
        """Write the file of a campaign over so many welds, and their table unless it is there."""
        table, file = self._folder / f"{welds}.parquet", self._folder / f"{welds}.yaml"
        if not table.exists():
            profile_table.write(table, synthetic_network.network(welds, seed=1))
        sources_line = f"sources: [{{table: {table.name}, line: bench}}]\n"
        file.write_text(f"name: bench\n{sources_line}{grid}", encoding="utf-8")
        return file

    def new_out(self) -> Path:
        """Return a new folder for results."""
        return Path(tempfile.mkdtemp(dir=self._folder)) / "results"

    def run(self, welds: int, workers: int = 2, scheduler: str | None = None, grid: str = _GRID) -> _Run:
        """Run a campaign to its end."""
        options = ("--workers", str(workers)) if scheduler is None else ("--scheduler", scheduler)
        file, out = self.campaign(welds, grid), self.new_out()
        began = time.perf_counter()
        with _started(file, out, *options) as process, _watched(process.pid) as peaks:
            if process.wait():
                raise RuntimeError(f"the campaign ended with {process.returncode}")
        return _Run(welds, time.perf_counter() - began, _rate(out, welds, workers), dict(peaks), _results(out))

    def whole(self, welds: int) -> dict[str, Any]:
        """Compare the throughput of two workers with the bare kernel in two processes."""
        self.campaign(welds)
        before = _bare(2)
        ran = self.run(welds)
        after = _bare(2)
        bare = (before + after) / 2
        expected = self._expected(welds, 2)
        return ran.figures() | {
            "bare_kernel_welds_per_s": [round(before, 1), round(after, 1)],
            "share_of_bare_kernel": round(ran.welds_per_s / bare, 3),
            "planned_s": [round(seconds, 1) for seconds in expected.seconds],
            "planned_over_measured": round(expected.seconds[1] / ran.whole_s, 3),
        }  # fmt: skip

    def scaling(self, welds: int) -> dict[str, Any]:
        """Compare two workers with one, in turn."""
        one, two, again = (self.run(welds, workers) for workers in (1, 2, 1))
        single = (one.welds_per_s + again.welds_per_s) / 2
        return {
            "welds": welds, "one_worker_welds_per_s": [round(one.welds_per_s, 1), round(again.welds_per_s, 1)],
            "two_workers_welds_per_s": round(two.welds_per_s, 1), "two_over_one": round(two.welds_per_s / single, 3),
            "same_results": len({one.results_sha256, two.results_sha256}) == 1,
        }  # fmt: skip

    def growth(self, sizes: list[int]) -> dict[str, Any]:
        """Measure time and memory over the number of welds, at four passages each: all but the kernel weighs most."""
        ran = [[self.run(size, grid=_SMALL_GRID) for _ in range(max(1, _REPEATED_WELDS // size))] for size in sizes]
        each_ms = [1e3 / statistics.median(one.welds_per_s for one in same) for same in ran]
        return {
            "welds": sizes, "runs": [len(same) for same in ran], "weld_ms": [round(ms, 3) for ms in each_ms],
            "most_over_least": round(max(each_ms) / min(each_ms), 3),
            "client_mb": [same[-1].peak_mb["client"] for same in ran],
            "worker_mb": [same[-1].peak_mb["worker"] for same in ran],
        }  # fmt: skip

    def kills(self, count: int) -> dict[str, Any]:
        """Kill a worker or the client (SIGKILL) at random moments, in turn, then run the same command to its end."""
        whole = self.run(_KILLED_WELDS)
        chance = random.Random(1)  # noqa: S311
        same = 0
        for number in range(count):
            out = self.new_out()
            kill = _kill_client if number % 2 else _kill_worker
            with _started(self.campaign(_KILLED_WELDS), out, "--workers", "2") as process:
                time.sleep(chance.uniform(0.3, 1.0) * whole.whole_s * 0.95)
                kill(process)
                process.wait()
            if process.returncode:
                with _started(self.campaign(_KILLED_WELDS), out, "--workers", "2") as process:
                    process.wait()
            same += _results(out) == whole.results_sha256 and not _doubled(out)
        return {"kills": count, "welds": _KILLED_WELDS, "same_results_and_nothing_doubled": same}

    def own_scheduler(self, welds: int) -> dict[str, Any]:
        """Compare the results with those on a scheduler and two workers started by Dask's own commands."""
        here = self.run(welds)
        with _own_scheduler(self._folder) as address:
            there = self.run(welds, scheduler=address)
        return {"welds": welds, "same_results": here.results_sha256 == there.results_sha256, "address": address}

    def network(self) -> dict[str, Any]:
        """Estimate a million welds on 64 workers, from welds timed here."""
        expected = self._expected(_KERNEL_WELDS, 64, of=1_000_000)
        low, about, high = expected.seconds
        return {
            "welds": expected.welds, "workers": 64, "weld_ms": round(1e3 * expected.weld_s[0], 2),
            "seconds": round(about), "seconds_range": [round(low), round(high)],
            "gigabytes": round(expected.bytes / 1e9, 2),
        }  # fmt: skip

    def _expected(self, welds: int, workers: int, of: int | None = None) -> estimate.Estimate:
        campaign = campaign_file.read(self.campaign(welds))
        planned = plan.make(campaign, sources.find(campaign))
        found = estimate.estimate(planned, workers)
        if of is None:
            return found
        return replace(found, welds=of, batches=-(-of // planned.batch_welds))


@contextmanager
def _started(file: Path, out: Path, *options: str) -> Iterator[subprocess.Popen[bytes]]:
    command = [*_COMMAND, str(file), "--out", str(out), "--no-page", *options]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        yield process


@contextmanager
def _watched(pid: int) -> Iterator[dict[str, float]]:
    """Yield the largest memory in MB of the client and of a worker, updated while the body runs."""
    peaks, over = {"client": 0.0, "worker": 0.0}, threading.Event()

    def watch() -> None:
        while not over.wait(0.3):
            try:
                client = psutil.Process(pid)
                _update_peak(peaks, "client", client)
                for child in client.children(recursive=True):
                    _update_peak(peaks, "worker", child)
            except psutil.Error:
                continue

    thread = threading.Thread(target=watch, daemon=True)
    thread.start()
    try:
        yield peaks
    finally:
        over.set()
        thread.join()


def _update_peak(peaks: dict[str, float], role: str, process: psutil.Process) -> None:
    peaks[role] = max(peaks[role], round(process.memory_info().rss / 1e6, 1))


def _rate(out: Path, welds: int, workers: int) -> float:
    """Return welds a second from when each worker has finished a batch until the last is finished."""
    done = sorted((out / batch_records.FOLDER).glob("*.json"), key=lambda path: path.stat().st_mtime)
    first = sum(msgspec.json.decode(path.read_bytes())["welds"] for path in done[:workers])
    return float((welds - first) / max(done[-1].stat().st_mtime - done[workers - 1].stat().st_mtime, 1e-9))


def _results(out: Path) -> str:
    found: str = msgspec.json.decode((out / batch_records.MANIFEST).read_bytes())["results_sha256"]
    return found


def _doubled(out: Path) -> bool:
    from weld_force_ros.campaign import query

    counted = "SELECT count(*) > count(DISTINCT weld_number) FROM verdicts"
    return bool(query.ask(out, counted).rows[0][0])


def _kill_worker(process: subprocess.Popen[bytes]) -> None:
    try:
        workers = [
            c for c in psutil.Process(process.pid).children(recursive=True) if "spawn_main" in " ".join(c.cmdline())
        ]
        if workers:
            workers[-1].send_signal(signal.SIGKILL)
    except psutil.Error:
        return


def _kill_client(process: subprocess.Popen[bytes]) -> None:
    process.send_signal(signal.SIGKILL)


@contextmanager
def _own_scheduler(folder: Path) -> Iterator[str]:
    address_file = folder / f"scheduler-{hashlib.sha256(str(time.time()).encode()).hexdigest()[:8]}.json"
    dask = [sys.executable, "-m", "dask"]
    scheduler = [*dask, "scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard",
                 "--scheduler-file", str(address_file)]  # fmt: skip
    worker = [*dask, "worker", "--scheduler-file", str(address_file), "--nthreads", "1", "--host", "127.0.0.1",
              "--no-dashboard", "--local-directory", str(folder)]  # fmt: skip
    started = [subprocess.Popen(scheduler, stderr=subprocess.DEVNULL)]
    try:
        while not address_file.exists():
            time.sleep(0.2)
        started += [subprocess.Popen(worker, stderr=subprocess.DEVNULL) for _ in range(2)]
        yield msgspec.json.decode(address_file.read_bytes())["address"]
    finally:
        for process in reversed(started):
            process.terminate()
            process.wait()


def _bare(processes: int) -> float:
    """Return welds a second that so many processes simulate when they do nothing else."""
    with get_context("spawn").Pool(processes) as pool:
        return sum(pool.map(_kernel_rate, range(processes), chunksize=1))


def _kernel_rate(part: int) -> float:
    settings = simulation_settings(speeds_kmh=parse_speeds(_SPEEDS), positions=_POSITIONS, running="with")
    simulator = Simulator(settings, threads=1, curves=False)
    wheel_paths = [simulator.wheel_path(weld) for weld in synthetic_network.network(_KERNEL_WELDS, seed=1)]

    def simulate(paths: list[Any]) -> None:
        for _ in simulator.vehicle_track.peak_maps(paths, settings.speeds_kmh, settings.positions_m, low_passed=True):
            pass

    simulate(wheel_paths[:8])
    began = time.perf_counter()
    simulate(wheel_paths)
    return len(wheel_paths) / (time.perf_counter() - began)


def main(
    parts: Annotated[list[str] | None, typer.Argument(help="whole, scaling, growth, kills, apart, network.")] = None,
    welds: Annotated[int, typer.Option(min=500, help="Of the largest campaign.")] = 20_000,
    growth: Annotated[str, typer.Option(help="Sizes of growing campaigns.")] = "1000,10000,100000",
    kills: Annotated[int, typer.Option(min=1)] = _KILLS,
) -> None:
    """Print the figures of campaigns."""
    with tempfile.TemporaryDirectory(prefix="weld-force-bench-") as folder:
        bench = Bench(Path(folder))
        measured: dict[str, Callable[[], dict[str, Any]]] = {
            "network": bench.network,
            "whole": lambda: bench.whole(welds),
            "scaling": lambda: bench.scaling(max(500, welds // 4)),
            "apart": lambda: bench.own_scheduler(max(500, welds // 20)),
            "kills": lambda: bench.kills(kills),
            "growth": lambda: bench.growth([int(size) for size in growth.split(",")]),
        }
        for part in parts or measured:
            print(msgspec.json.encode({"figure": part, **measured[part]()}).decode(), flush=True)


if __name__ == "__main__":
    typer.run(main)
