"""The README's pictures of the report, from the demo's bag: `python -m tests.report_screenshots [FOLDER]`."""

import sys
import tempfile
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from weld_force_ros.cli import main as weld_force
from weld_force_ros.report_page import printing

ROOT = Path(__file__).parent.parent
WELD = "weld-4-steep-ramp"


def take(browser: Any, file: Path, out: Path) -> None:
    """The table, a weld on a desk, and the same on a phone."""
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
    """Open the weld and wait for its charts."""
    page.get_by_role("link", name=WELD).click()
    page.wait_for_selector("#weld .chart .main-svg")
    while page.locator("#weld .chart:not(:has(.main-svg))").count():
        page.wait_for_timeout(50)
    page.wait_for_timeout(300)


def shrink(png: Path) -> None:
    """256 colours: a third of the size."""
    from PIL import Image  # comes with matplotlib

    Image.open(png).convert("RGB").quantize(256).save(png, "PNG", optimize=True)


def main() -> None:
    """Write the three pictures into a folder, docs by default."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "docs"
    path = printing.find_browser()
    if path is None:
        sys.exit("no Chromium was found on PATH")
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as started:
        file = Path(folder) / "report.html"
        if weld_force(["report", str(ROOT / "bags" / "demo"), "-o", str(file)]) != 0:
            sys.exit("the demo's bag makes no report")
        browser = started.chromium.launch(executable_path=path, args=["--no-sandbox"])
        take(browser, file, out)
        browser.close()
    for name in ("table", "weld", "phone"):
        shrink(out / f"report-{name}.png")


if __name__ == "__main__":
    main()
