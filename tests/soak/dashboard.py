"""A weld a second on the dashboard, with a browser open: `python -m tests.soak.dashboard [--minutes 10]`.

Messages of one simulated weld, as large as real ones, are published under ever new names, as simulator and assessment
node would; the dashboard runs in a process of its own, the page in a headless Chromium that opens a weld each minute.
"""

import argparse
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Any

import msgspec
import rclpy
from rclpy.signals import SignalHandlerOptions
from std_msgs.msg import String

from weld_force_ros.assessment.judge import assess
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement import profile_file
from weld_force_ros.messages import (
    TOPICS,
    AssessmentSettings,
    ForceHistory,
    ForceMap,
    Message,
    SimulationSettings,
    Stamp,
    Verdict,
    WeldProfile,
    encode,
    measurement_id,
)
from weld_force_ros.report.pdf import find_browser
from weld_force_ros.ros import environment, qos
from weld_force_ros.ros.environment import use_own_domain
from weld_force_ros.simulation.settings import (
    DEFAULT_POSITIONS,
    DEFAULT_SPEEDS,
    load_uncertainty,
    parse_positions,
    parse_speeds,
    simulation_settings,
)
from weld_force_ros.simulation.simulator import Simulator

# When each weld was first in the page, on the clock that this process has, too.
WATCH = """
window.seen = {};
new MutationObserver(() => requestAnimationFrame(() => {
  const now = Date.now();
  for (const link of document.querySelectorAll('a[href^="#weld-"]')) seen[link.textContent] ??= now;
})).observe(document, {childList: true, subtree: true});
"""
PUBLISHED = (SimulationSettings, AssessmentSettings, WeldProfile, ForceMap, Verdict, ForceHistory)
SAMPLES = 200
_SOON_MS = 1000.0
_START_S = 60.0
_DETAIL_S = 3.0


@dataclass
class Result:
    """What came of a run.

    Attributes:
        delays_ms: from a verdict's being published to its row in the page.
        memory_mb: resident memory of the dashboard's process, minute by minute.
        heap_mb: of the page's JavaScript after its garbage was collected, likewise.
        first_opened_ms: until the first weld was drawn, for which Plotly is unpacked; that is before the run.
        sent_kb: of one weld's messages.
    """

    welds: int = 0
    shown: int = 0
    sent_kb: float = 0.0
    delays_ms: list[float] = field(default_factory=list)
    memory_mb: list[float] = field(default_factory=list)
    heap_mb: list[float] = field(default_factory=list)
    details_on_disk_mb: float = 0.0
    first_opened_ms: float = 0.0
    complaints: list[str] = field(default_factory=list)

    @property
    def figures(self) -> dict[str, Any]:
        """What is reported; memory from the first minute's end to the run's."""
        delays = sorted(self.delays_ms)
        return {
            "welds published": self.welds,
            "rows shown": self.shown,
            "kB of messages a weld": self.sent_kb,
            "delay ms, median": round(median(delays)),
            "delay ms, 99 of 100 within": round(delays[int(0.99 * (len(delays) - 1))]),
            "delay ms, longest": round(delays[-1]),
            "later than a second": {n: round(ms) for n, ms in enumerate(self.delays_ms, 1) if ms > _SOON_MS},
            "ms to draw a weld, first": round(self.first_opened_ms),
            "dashboard MB, each minute": self.memory_mb,
            "page's heap MB, each minute": self.heap_mb,
            "details on disk MB": self.details_on_disk_mb,
            "complaints of the page": self.complaints,
        }

    @property
    def passed(self) -> bool:
        """Whether every weld came to the page, each within a second, and the process grew by less than 10 MB."""
        grown_mb = self.memory_mb[-1] - self.memory_mb[0]
        return not self.complaints and self.shown == self.welds and max(self.delays_ms) < _SOON_MS and grown_mb < 10


def run(minutes: float, *, rate_hz: float = 1.0, samples: int = SAMPLES, show: bool = False) -> Result:
    """So many minutes at so many welds a second.

    Args:
        minutes: duration; memory is looked at ten times, at most once a minute.
        rate_hz: welds a second.
        samples: of what is not known, behind the verdict's probabilities: they make maps large.
        show: print the figures as they come.
    """
    use_own_domain()
    environment.prepare()
    result = Result()
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        process, url = stack.enter_context(_dashboard(scratch))
        weld = _Weld(samples)
        publish = stack.enter_context(_publisher())
        page = stack.enter_context(_open_page(url, result.complaints))
        for message in weld.settings:
            publish(message)
        result.first_opened_ms = _open_first(weld, publish, page)
        heap = page.context.new_cdp_session(page)
        look_s = min(60.0, 6.0 * minutes)
        began_s, looked_s = time.monotonic(), time.monotonic()
        sent_ms: dict[str, float] = {}
        while (now_s := time.monotonic()) < began_s + 60 * minutes:
            if now_s - looked_s >= look_s:
                looked_s = now_s
                result.memory_mb.append(_resident_mb(process.pid))
                heap.send("HeapProfiler.collectGarbage")
                result.heap_mb.append(round(heap.send("Runtime.getHeapUsage")["usedSize"] / 1e6, 1))
                if show:
                    print(f"{result.welds} welds; MB {result.memory_mb[-1]}, heap {result.heap_mb[-1]}", flush=True)
            if result.welds % 60 == 5:
                page.evaluate(f"location.hash = 'weld-{result.welds}'")
            elif result.welds % 60 == 5 + int(_DETAIL_S):
                page.evaluate("location.hash = ''")
            result.welds += 1
            weld_id, at_ms = weld.send(result.welds, publish)
            sent_ms[weld_id] = at_ms
            page.wait_for_timeout(max(0.0, 1e3 * (began_s + result.welds / rate_hz - time.monotonic())))
        page.wait_for_timeout(2_000)
        seen = page.evaluate("seen")
        result.shown = len(seen.keys() & sent_ms.keys())
        result.delays_ms = [seen[weld_id] - sent for weld_id, sent in sent_ms.items() if weld_id in seen]
        result.sent_kb = round(weld.sent_bytes / 1e3)
        result.memory_mb.append(_resident_mb(process.pid))
        result.details_on_disk_mb = round(sum(f.stat().st_size for f in scratch.rglob("*.gz")) / 1e6, 2)
    return result


def _open_first(weld: "_Weld", publish: Callable[[Message], int], page: Any) -> float:
    """Open the first weld and go back; how long it took in ms."""
    weld.send(0, publish)
    page.wait_for_selector('a[href="#weld-1"]')
    began_s = time.monotonic()
    page.click('a[href="#weld-1"]')
    page.wait_for_selector("#weld article svg.figure")
    took_ms = 1e3 * (time.monotonic() - began_s)
    page.evaluate("location.hash = ''")
    page.wait_for_selector("table.welds")
    return took_ms


class _Weld:
    """The messages of one weld, sent under ever new names in the order of the nodes: the history comes last."""

    def __init__(self, samples: int) -> None:
        settings = simulation_settings(
            track="bilbao",
            engine="common-poles",
            speeds_kmh=parse_speeds(DEFAULT_SPEEDS),
            positions=parse_positions(DEFAULT_POSITIONS),
            uncertainty=load_uncertainty(samples),
        )
        limits = load_limits()
        self._profile = profile_file.read_profile(profile_file.find("weld-4-steep-ramp"))
        assessed = assess(self._profile, Simulator(settings), limits)
        self.settings: list[Message] = [settings, limits]
        self._before, self._verdict, self._after = (
            [self._profile, assessed.force_map],
            assessed.verdict,
            assessed.history,
        )
        self.sent_bytes = 0

    def send(self, number: int, publish: Callable[[Message], int]) -> tuple[str, float]:
        """The weld's name, and when its verdict was published, in ms since the epoch."""
        weld_id = f"soak-{number}"
        about = {"weld_id": weld_id, "profile_id": measurement_id(weld_id, self._profile.profile_sha256)}
        self.sent_bytes = sum(publish(msgspec.structs.replace(message, **about)) for message in self._before)
        sent_ms = 1e3 * time.time()
        self.sent_bytes += publish(msgspec.structs.replace(self._verdict, **about))
        self.sent_bytes += publish(msgspec.structs.replace(self._after, **about))
        return weld_id, sent_ms


@contextmanager
def _dashboard(scratch: Path) -> Iterator[tuple["subprocess.Popen[bytes]", str]]:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "weld_force_ros.ros.launcher", "dashboard", "--ros-args", "-p", f"port:={port}"]
    as_the_supervisor_does = {"MALLOC_ARENA_MAX": "2"}
    process = subprocess.Popen(command, env={**os.environ, **as_the_supervisor_does, "TMPDIR": str(scratch)})
    url, deadline_s = f"http://127.0.0.1:{port}/", time.monotonic() + _START_S
    while True:
        try:
            with urllib.request.urlopen(f"{url}rows") as answer:  # noqa: S310
                assert json.load(answer) == []
            break
        except OSError:
            assert process.poll() is None, "the dashboard does not start"
            assert time.monotonic() < deadline_s, "the dashboard does not answer"
            time.sleep(0.1)
    try:
        yield process, url
    finally:
        process.terminate()
        assert process.wait(60.0) == 0, "the dashboard did not end well"


@contextmanager
def _publisher() -> Iterator[Callable[[Message], int]]:
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("soak", context=context)
    publishers = {
        kind: node.create_publisher(String, TOPICS[kind].name, qos.publisher_qos(TOPICS[kind])) for kind in PUBLISHED
    }
    sequence = dict.fromkeys(PUBLISHED, 0)
    deadline_s = time.monotonic() + _START_S
    while not all(publisher.get_subscription_count() for publisher in publishers.values()):
        assert time.monotonic() < deadline_s, "the dashboard does not listen"
        time.sleep(0.1)

    def publish(message: Message) -> int:
        kind, now_ns = type(message), time.time_ns()
        message.publisher, message.sequence = "/soak#1", sequence[kind]
        message.stamp = Stamp(sec=now_ns // 10**9, nanosec=now_ns % 10**9)
        sequence[kind] += 1
        text = encode(message).decode()
        publishers[kind].publish(String(data=text))
        return len(text)

    yield publish
    node.destroy_node()
    context.try_shutdown()


@contextmanager
def _open_page(url: str, complaints: list[str]) -> Iterator[Any]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-dev-shm-usage"]
        browser = playwright.chromium.launch(executable_path=find_browser(), args=arguments)
        page = browser.new_page()
        page.add_init_script(WATCH)
        page.on("console", lambda message: complaints.append(message.text) if message.type == "error" else None)
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.goto(url)
        page.wait_for_selector("html[data-ready]")
        yield page
        browser.close()


def _resident_mb(pid: int) -> float:
    status = Path(f"/proc/{pid}/status").read_text().splitlines()
    return round(sum(int(line.split()[1]) for line in status if line.startswith("VmRSS")) / 1024, 1)


def main() -> int:
    """Run and print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rate", type=float, default=1.0, help="welds a second")
    given = parser.parse_args()
    result = run(given.minutes, rate_hz=given.rate, show=True)
    for name, value in result.figures.items():
        print(f"{name:28} {value}")
    print("passed" if result.passed else "FAILED")
    return 0 if result.passed else 1


if __name__ == "__main__":
    raise SystemExit(main())
