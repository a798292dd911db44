"""How large a report of 500 welds is, and how soon it can be used: `python -m benchmarks.report`."""

import json
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from weld_force_ros.assessment.judge import assess
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile, shipped
from weld_force_ros.recording.weld_records import WeldRecord
from weld_force_ros.report import pdf
from weld_force_ros.report.html_page import page
from weld_force_ros.report.table_row import row
from weld_force_ros.report.weld_detail import detail
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

WELDS = 500
LOADS = 5
SIZES: dict[str, dict[str, Any]] = {
    "desk": {"viewport": {"width": 1280, "height": 800}},
    "phone": {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True},
}


def report() -> str:
    """500 welds of the full grid with probabilities: the shipped profiles in turn."""
    simulator = Simulator(simulation_settings(uncertainty=load_uncertainty(4), running="with"))
    limits = load_limits()
    welds = []
    for name in shipped():
        profile = read_profile(find(name))
        found = assess(profile, simulator, limits)
        welds.append(WeldRecord(found.verdict, found.force_map, profile, found.history, simulator.settings, limits))
    details = [detail(weld) for weld in welds]
    return page(
        [row(n + 1, welds[n % len(welds)]) for n in range(WELDS)],
        [details[n % len(details)] for n in range(WELDS)],
        title="Rail welds",
    )


def loads(browser: Any, file: Path, how: dict[str, Any]) -> dict[str, float]:
    """Milliseconds until the table can be used, until all has been read, and until a first weld is drawn."""
    context = browser.new_context(**how)
    opened = context.new_page()
    opened.goto(file.as_uri())
    times = opened.evaluate(
        """() => ({interactive: Number(document.documentElement.dataset.ready),
          all: performance.getEntriesByType("navigation")[0].domContentLoadedEventEnd})"""
    )
    first = opened.evaluate(
        """async () => {
          const began = performance.now();
          location.hash = "#weld-1";
          const charts = () => [...document.querySelectorAll("#weld .chart")];
          while (!charts().length || !charts().every((c) => c.querySelector(".main-svg"))) {
            await new Promise((done) => setTimeout(done, 5));
          }
          return performance.now() - began;
        }"""
    )
    context.close()
    return {"interactive_ms": times["interactive"], "all_read_ms": times["all"], "first_weld_ms": first}


def main() -> None:
    """Print one JSON object; medians of several loads."""
    path = pdf.find_browser()
    if path is None:
        sys.exit("no Chromium was found on PATH")
    html = report()
    found: dict[str, Any] = {"welds": WELDS, "megabytes": round(len(html.encode()) / 1e6, 2)}
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        file = Path(folder) / "report.html"
        file.write_text(html, encoding="utf-8")
        browser = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        found["browser"] = f"Chromium {browser.version}"
        for name, how in SIZES.items():
            measured = [loads(browser, file, how) for _ in range(LOADS)]
            for what in measured[0]:
                found[f"{name}_{what}"] = round(statistics.median(m[what] for m in measured))
        browser.close()
    sys.stdout.write(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
