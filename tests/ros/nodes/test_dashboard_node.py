"""The dashboard beside the suite: rows as verdicts come, whenever it joins; nothing else changes by it."""

import gzip
import json
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.harness.ros import DEADLINE_S, Outcomes, Probe, QuickSimulator, profile_text, wait_until
from tests.ros.test_node_suite import profile
from weld_force_ros.cli.main import main
from weld_force_ros.errors import InputError
from weld_force_ros.messages import Verdict, encode
from weld_force_ros.report.pdf import find_browser
from weld_force_ros.ros.node_suite import KINDS, Kind, NodeSuite, in_flow_order

pytestmark = pytest.mark.slow

pytest.importorskip("jinja2")

COUNT_REMOVED = """
  window.removed = 0;
  new MutationObserver((changes) => { for (const change of changes) removed += change.removedNodes.length; })
    .observe(document.querySelector("table.welds tbody"), {childList: true});
"""


@contextmanager
def running(
    folder: Path,
    kinds: tuple[Kind, ...] = in_flow_order(["dashboard"]),
    outcomes: Outcomes | None = None,
    bag: str = "",
) -> Iterator[NodeSuite]:
    parameters: dict[Kind, dict[str, Any]] = {
        "profile": {"folder": str(folder), "settle_s": 0.05, "unfinished_s": 0.3},
        "simulator": {"uncertainty_samples": 0, "speeds": "40,80,120", "positions": "0.15,0.30"},
        "assessment": {"bag": bag},
        "dashboard": {"port": 0},
    }
    collected = outcomes or Outcomes()
    with NodeSuite(
        kinds, parameters=parameters, load_simulator=QuickSimulator, on_verdict=collected, on_rejection=collected
    ) as suite:
        yield suite


def get(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=DEADLINE_S) as answer:  # noqa: S310
        return bytes(answer.read())


def rows(url: str, count: int, after: int = 0) -> list[dict[str, Any]]:
    """The rows, once there are so many."""
    found: list[dict[str, Any]] = []

    def enough() -> bool:
        found[:] = json.loads(get(f"{url}rows?after={after}"))
        return len(found) >= count

    wait_until(enough)
    return found


def whole(url: str, number: int) -> str:
    """A weld's part of the page, once its history has come."""
    found = ""

    def complete() -> bool:
        nonlocal found
        found = gzip.decompress(get(f"{url}weld/{number}")).decode()
        return "One passage at" in found and "Geometry and quality index" in found

    wait_until(complete)
    return found


def test_every_outcome_gets_its_row_and_its_details(domain_id: int, folder: Path, tmp_path: Path) -> None:
    for i in range(5):
        (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
    (folder / "bad.csv").write_text("x,z\n1,nonsense\n")
    outcomes = Outcomes()
    with running(folder, outcomes=outcomes, bag=str(tmp_path / "bag")) as suite:
        url = suite.nodes["dashboard"].url
        assert "<title>Rail welds</title>" in get(url).decode()
        found = rows(url, 6)
        assert [row["n"] for row in found] == [1, 2, 3, 4, 5, 6]
        by_weld = {row["weld"]: row for row in found}
        assert by_weld.keys() == {"bad.csv", *(f"weld-{i}" for i in range(5))}
        assert by_weld["bad.csv"]["decision"] == "unusable"
        for verdict in outcomes.of(Verdict):
            row = by_weld[verdict.weld_id]
            assert row["decision"] == verdict.decision
            part = whole(url, row["n"])
            assert f"{verdict.peak_force_n / 1e3:.0f} kN at {verdict.worst_speed_kmh:g} km/h" in part
            assert "Peak force by speed and position" in part
        assert "bilbao" in get(f"{url}header").decode()
        assert rows(url, 1, after=5) == found[5:]
        assert suite.drain(10.0) == 0
    with pytest.raises(urllib.error.URLError):
        get(url)


def test_it_may_join_late_and_come_again(domain_id: int, folder: Path) -> None:
    for i in range(8):
        (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
    outcomes = Outcomes()
    with running(folder, KINDS, outcomes):
        outcomes.wait(8)
        for _ in range(2):
            with running(folder, ("dashboard",)) as late:
                url = late.nodes["dashboard"].url
                found = rows(url, 8)
                assert sorted(row["weld"] for row in found) == [f"weld-{i}" for i in range(8)]
                for row in found:
                    assert "Peak force by speed and position" in whole(url, row["n"])


def test_malformed_messages_neither_show_nor_stop_it(domain_id: int, folder: Path, probe: Probe) -> None:
    with running(folder, ("simulator", "assessment", "dashboard")) as suite:
        url = suite.nodes["dashboard"].url
        for text in ("{not json", "", '{"schema_version": "2.0"}', "[" * 100_000):
            probe.publish("verdict", text)
            probe.publish("force_map", text)
        probe.publish("weld_profile", encode(profile("good")).decode())
        wait_until(lambda: any(row["weld"] == "good" for row in rows(url, 1)))


def test_details_are_in_a_folder_that_is_gone_afterwards(domain_id: int, folder: Path, tmp_path: Path) -> None:
    (folder / "weld.csv").write_text(profile_text(200))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tempfile.tempdir", str(tmp_path))
        with running(folder) as suite:
            whole(suite.nodes["dashboard"].url, rows(suite.nodes["dashboard"].url, 1)[0]["n"])
            (kept,) = tmp_path.glob("weld-force-dashboard-*")
            assert [path.name for path in kept.iterdir()] == ["1.gz"]
    assert not kept.exists()


@pytest.fixture
def used_port() -> Iterator[int]:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        yield taken.getsockname()[1]


def test_a_used_port_keeps_the_node_from_starting(domain_id: int, used_port: int) -> None:
    with (
        pytest.raises(InputError, match=f"port {used_port} is in use"),
        NodeSuite(("dashboard",), parameters={"dashboard": {"port": used_port}}),
    ):
        pass


def up_arguments(folder: Path, *more: str) -> list[str]:
    grid = ("--speeds", "40,80", "--positions", "2", "--uncertainty-samples", "0")
    return ["up", "--folder", str(folder), *grid, *more]


@contextmanager
def up(folder: Path, *arguments: str) -> Iterator["subprocess.Popen[str]"]:
    """The command, ended with its nodes: left alone they would publish into the domain of a later test."""
    command = [sys.executable, "-m", "weld_force_ros.cli", *up_arguments(folder, *arguments)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


def test_a_used_port_is_one_line_and_code_2(
    domain_id: int, folder: Path, used_port: int, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(up_arguments(folder, "--dashboard", "--dashboard-port", str(used_port))) == 2
    err = capfd.readouterr().err
    (line,) = [line for line in err.splitlines() if line.startswith("weld-force:")]
    assert f"port {used_port} is in use; give another one with --dashboard-port" in line
    assert "Traceback" not in err


@pytest.mark.parametrize("arguments", [("--dashboard-port", "8765"), ("--dashboard", "--dashboard-port", "70000")])
def test_a_port_without_dashboard_or_out_of_range_is_refused(
    domain_id: int, folder: Path, arguments: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(up_arguments(folder, *arguments)) == 2
    assert len(capfd.readouterr().err.splitlines()) == 1


@pytest.mark.parametrize("how", [(), ("--processes",)])
def test_up_serves_a_page_until_it_is_stopped(domain_id: int, folder: Path, how: tuple[str, ...]) -> None:
    (folder / "weld.csv").write_text(profile_text(200))
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    url = f"http://127.0.0.1:{port}/"
    with up(folder, "--dashboard", "--dashboard-port", str(port), *how) as process:

        def served() -> bool:
            assert process.poll() is None
            try:
                return bool(json.loads(get(f"{url}rows")))
            except urllib.error.URLError:
                return False

        wait_until(served)
        (row,) = json.loads(get(f"{url}rows"))
        assert row["weld"] == "weld"
        process.send_signal(signal.SIGTERM)
        _, err = process.communicate(timeout=DEADLINE_S)
    assert process.returncode == 0, err
    assert re.search(rf"dashboard: {url}", err)
    assert "Traceback" not in err


def test_the_page_shows_a_verdict_within_a_second(domain_id: int, folder: Path) -> None:
    browser = find_browser()
    if browser is None:
        pytest.skip("no Chromium was found on PATH (apt install chromium)")
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    outcomes = Outcomes()
    with running(folder, outcomes=outcomes) as suite, playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=browser, args=["--no-sandbox", "--disable-dev-shm-usage"])
        page, complaints, requested = chromium.new_page(), [], []
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: requested.append(request.url))
        url = suite.nodes["dashboard"].url
        page.goto(url)
        for i in range(3):
            (folder / f"weld-{i}.csv").write_text(profile_text(100 + i))
            outcomes.wait(i + 1)
            page.wait_for_selector(f'a[href="#weld-{i + 1}"]', timeout=5_000 if i == 0 else 1_000)
            if i == 0:
                page.evaluate(COUNT_REMOVED)
        assert page.evaluate("removed") == 0  # rows that are there stay: two thousand laid out anew take seconds
        page.click('a[href="#weld-1"]')
        page.wait_for_selector("#weld article svg.figure", timeout=30_000)
        chromium.close()
    assert complaints == []
    assert all(request.startswith((url, "data:", "blob:")) for request in requested)
