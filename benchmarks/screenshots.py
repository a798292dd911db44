"""The pictures of report and campaign in README and docs, from the demo's bag and a population: `make screenshots`."""

import sys
import tempfile
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from weld_force_ros.cli.main import main as weld_force
from weld_force_ros.report import pdf

ROOT = Path(__file__).parent.parent
WELD = "weld-4-steep-ramp"


def take(browser: Any, file: Path, out: Path) -> None:
    """Take pictures of the table, a weld on a desk, and the same on a phone."""
    desk = browser.new_page(viewport={"width": 1280, "height": 860})
    desk.goto(file.as_uri())
    desk.screenshot(path=out / "report-table.png")
    open_weld(desk)
    desk.screenshot(path=out / "report-weld.png", clip={"x": 0, "y": 0, "width": 1280, "height": 1320}, full_page=True)
    phone = browser.new_page(
        viewport={"width": 390, "height": 844}, has_touch=True, is_mobile=True, device_scale_factor=2
    )
    phone.goto(file.as_uri())
    open_weld(phone)
    phone.screenshot(path=out / "report-phone.png")


def open_weld(page: Any) -> None:
    """Open the weld and wait for its figures."""
    page.get_by_role("link", name=WELD).click()
    page.wait_for_selector("#weld article svg.figure")


CAMPAIGN = """
name: northern network
sources: [{folder: welds, line: north}]
vehicles:
  freight: {static_load_n: 110.0e+3}
  passenger: {static_load_n: 70.0e+3, mass_kg: 600.0}
sections:
  - {name: plain-line, lines: [north], chainage_m: [0, 9000], track: bilbao-causal}
  - {name: slab-like, track: bilbao-continuous, vehicles: [passenger]}
speeds: 80:300:20
positions: 5
"""


def take_campaign(browser: Any, folder: Path, out: Path) -> None:
    """Take a picture of the summary that docs/whole-network.md leads to, made as it says there."""
    (folder / "network.yaml").write_text(CAMPAIGN, encoding="utf-8")
    commands = (["population", "2000", "--out", str(folder / "welds")], ["campaign", str(folder / "network.yaml")])
    if any(weld_force(command) != 0 for command in commands):
        sys.exit("the campaign did not run")
    page = browser.new_page(viewport={"width": 1280, "height": 860})
    page.goto((folder / "network-results" / "summary.html").as_uri())
    page.screenshot(
        path=out / "network-summary.png", clip={"x": 0, "y": 0, "width": 1280, "height": 1500}, full_page=True
    )


def shrink(png: Path) -> None:
    """256 colours: a third of the size."""
    from PIL import Image  # comes with matplotlib

    Image.open(png).convert("RGB").quantize(256).save(png, "PNG", optimize=True)


def main() -> None:
    """Write the pictures into a folder, docs by default."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs"
    path = pdf.find_browser()
    if path is None:
        sys.exit("no Chromium was found on PATH")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        file = Path(folder) / "report.html"
        if weld_force(["report", str(ROOT / "bags" / "demo"), "-o", str(file)]) != 0:
            sys.exit("the demo's bag makes no report")
        browser = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        take(browser, file, out)
        take_campaign(browser, Path(folder), out)
        browser.close()
    for name in ("report-table", "report-weld", "report-phone", "network-summary"):
        shrink(out / f"{name}.png")


if __name__ == "__main__":
    main()
