"""The page on paper: printed to PDF by a browser that is installed, without a window."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from weld_force_ros.errors import InputError

BROWSER_VARIABLE = "WELD_FORCE_BROWSER"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_SECONDS_AT_MOST = 600
_VIRTUAL_MS = 60_000


def find_browser() -> str | None:
    """The path of a Chromium: what the environment names, or the first on PATH."""
    named = os.environ.get(BROWSER_VARIABLE)
    candidates = (named,) if named else BROWSERS
    return next((found for name in candidates if name and (found := shutil.which(name))), None)


def print_pdf(page: Path, pdf: Path) -> None:
    """Print all welds of a page.

    Raises:
        InputError: no browser, or it wrote nothing.
    """
    browser = find_browser()
    if browser is None:
        raise InputError(
            f"no Chromium was found to print {pdf}", f"install one, or name it in {BROWSER_VARIABLE}; {page} is written"
        )
    pdf.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="weld-force-print-") as profile:
        done = subprocess.run(
            [
                browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                "--no-first-run", "--window-size=1000,1400", "--disable-background-networking",
                f"--user-data-dir={profile}",
                f"--virtual-time-budget={_VIRTUAL_MS}", "--no-pdf-header-footer", f"--print-to-pdf={pdf.absolute()}",
                f"{page.absolute().as_uri()}#print",
            ],
            capture_output=True, timeout=_SECONDS_AT_MOST, check=False,
        )  # fmt: skip
    if not pdf.exists():
        said = done.stderr.decode(errors="replace").strip().splitlines()
        raise InputError(f"{browser} printed no {pdf}: {said[-1] if said else 'it said nothing'}", "print it by hand")
