"""How large a report of 500 welds is, how soon it can be used, and a PDF of 60: `python -m benchmarks.report`."""

import json
import re
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from msgspec.structs import replace
from playwright.sync_api import sync_playwright

from benchmarks.noise import SHAPES, measured
from weld_force_ros.assessment.judge import assess, assess_vehicles
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.measurement.profile_file import find, read_profile, shipped
from weld_force_ros.recording.weld_records import WeldRecord
from weld_force_ros.report import pdf
from weld_force_ros.report.html_page import page, paper, report_of
from weld_force_ros.simulation.settings import load_uncertainty, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

WELDS = 500
PRINTED = 60
LOADS = 5
VEHICLES = ("passenger", "freight-22.5t")
NOISE_M = 10e-6
SIZES: dict[str, dict[str, Any]] = {
    "desk": {"viewport": {"width": 1280, "height": 800}},
    "phone": {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True},
}


def records(count: int) -> list[WeldRecord]:
    """Return welds of the full grid with probabilities: the bundled profiles in turn."""
    simulator = Simulator(simulation_settings(uncertainty=load_uncertainty(4), running="with"))
    limits = load_limits()
    welds = []
    for name in shipped():
        profile = read_profile(find(name))
        found = assess(profile, simulator, limits)
        welds.append(WeldRecord(found.verdict, found.force_map, profile, found.history, simulator.settings, limits))
    return [welds[n % len(welds)] for n in range(count)]


def largest_of_noisy_welds() -> WeldRecord:
    """Return the weld with the largest part of a page: measured every millimetre with noise, under two vehicles."""
    uncertainty, limits = load_uncertainty(60), load_limits("force,banenor-531")
    simulators = [Simulator(simulation_settings(vehicle=name, uncertainty=uncertainty)) for name in VEHICLES]
    settings = {one.settings.config_sha256: one.settings for one in simulators}
    welds = []
    for shape in SHAPES.values():
        profile = replace(measured(shape, 1e-3, NOISE_M, seed=1), line_speed_kmh=160.0)
        found = assess_vehicles(profile, simulators, limits)
        own = settings[found.force_map.config_sha256]
        welds.append(WeldRecord(found.verdict, found.force_map, profile, found.history, own, limits))
    return max(welds, key=lambda weld: len(report_of([weld], about="a benchmark").sections[0]))


def megabytes(html: str) -> float:
    """Return the size of a page."""
    return round(len(html.encode()) / 1e6, 2)


def loads(browser: Any, file: Path, how: dict[str, Any]) -> dict[str, float]:
    """Milliseconds until the table can be used, until all has been read, and until a first weld is shown."""
    context = browser.new_context(**how)
    opened = context.new_page()
    opened.goto(file.as_uri())
    times = opened.evaluate(
        """() => ({ready: Number(document.documentElement.dataset.ready),
          painted: performance.getEntriesByName("first-contentful-paint")[0]?.startTime ?? 0})"""
    )
    first = opened.evaluate(
        """async () => {
          const began = performance.now();
          location.hash = "#weld-1";
          while (!document.querySelector("#weld article svg")) await new Promise((done) => setTimeout(done, 1));
          await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
          return performance.now() - began;
        }"""
    )
    pixels = opened.evaluate(PIXELS)
    context.close()
    return {"table_ms": times["ready"], "first_paint_ms": times["painted"], "first_weld_ms": first, **pixels}


PIXELS = """() => {
  const bottom = (at) => Math.round([...document.querySelectorAll(at)].at(-1).getBoundingClientRect().bottom + scrollY);
  return {action_and_why_px: bottom("#weld .headline"), both_answers_px: bottom("#weld .question"),
    vehicle_direction_speed_px: bottom("#weld .facts")};
}"""
"""Where the decision with its reason, both answers, and the facts end on the page."""


def without_script(browser: Any, file: Path) -> dict[str, Any]:
    """Return how many rows, welds and figures are there without JavaScript."""
    context = browser.new_context(java_script_enabled=False, **SIZES["phone"])
    opened = context.new_page()
    opened.goto(file.as_uri())
    counts = {name: opened.locator(at).count() for name, at in COUNTED.items()}
    context.close()
    return counts


COUNTED = {"rows": ".welds tbody tr", "welds": "article.weld", "figures": "svg.figure"}


def printed(welds: list[WeldRecord], folder: Path) -> dict[str, float]:
    """Return how long a PDF takes, and its pages."""
    began = time.perf_counter()
    pdf.print_pdf(paper(report_of(welds, about="a benchmark")), folder / "report.pdf")
    seconds = time.perf_counter() - began
    pages = len(re.findall(rb"/Type /Page[^s]", (folder / "report.pdf").read_bytes()))
    return {"pdf_welds": len(welds), "pdf_pages": pages, "pdf_s": round(seconds, 1)}


def main() -> None:
    """Print one JSON object; medians of several loads."""
    path = pdf.find_browser()
    if path is None:
        sys.exit("no Chromium was found on PATH")
    welds = records(WELDS)
    began = time.perf_counter()
    html = page(report_of(welds, about="a benchmark"))
    made_s = time.perf_counter() - began
    found: dict[str, Any] = {
        "welds": WELDS,
        "megabytes": megabytes(html),
        "made_s": round(made_s, 1),
    }
    noisy = largest_of_noisy_welds()
    found["megabytes_if_all_were_the_largest_noisy_one"] = megabytes(page(report_of([noisy] * WELDS, about="noise")))
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        file = Path(folder) / "report.html"
        file.write_text(html, encoding="utf-8")
        browser = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        found["browser"] = f"Chromium {browser.version}"
        for name, how in SIZES.items():
            measured = [loads(browser, file, how) for _ in range(LOADS)]
            for what in measured[0]:
                found[f"{name}_{what}"] = round(statistics.median(m[what] for m in measured))
        found |= {f"without_script_{name}": count for name, count in without_script(browser, file).items()}
        browser.close()
        found |= printed(welds[:PRINTED], Path(folder))
    sys.stdout.write(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
