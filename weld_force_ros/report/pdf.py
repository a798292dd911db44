"""Print a page to PDF by an installed Chromium, without a window."""

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from weld_force_ros.errors import InputError

BROWSER_VARIABLE = "WELD_FORCE_BROWSER"
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
_SECONDS_AT_MOST = 600


def find_browser() -> str | None:
    """Return the path of a Chromium: the one named by the environment, or the first on PATH; None if there is none."""
    named = os.environ.get(BROWSER_VARIABLE)
    candidates = (named,) if named else BROWSERS
    return next((found for name in candidates if name and (found := shutil.which(name))), None)


def print_pdf(html: str, pdf: Path) -> None:
    """Print a page to PDF.

    Args:
        html: of `html_page.paper`.
        pdf: file to write.

    Raises:
        InputError: there is no browser, it takes too long, or it writes nothing.
    """
    browser = find_browser()
    if browser is None:
        raise InputError(f"no Chromium was found to print {pdf}", f"install one, or name it in {BROWSER_VARIABLE}")
    try:
        pdf.unlink(missing_ok=True)
        last_words = _print(browser, html, pdf)
    except subprocess.TimeoutExpired:
        raise InputError(f"printing {pdf} took longer than {_SECONDS_AT_MOST} s", "print fewer welds") from None
    except OSError as error:
        raise InputError(f"{pdf}: {error.strerror or error}", "name a file in a writable folder") from None
    if not pdf.exists():
        raise InputError(f"{browser} printed no {pdf}: {last_words}", "open the page and print it from there")


def _print(browser: str, html: str, pdf: Path) -> str:
    """Run the browser and return the last line of its standard error."""
    with tempfile.TemporaryDirectory(prefix="weld-force-print-") as folder:
        page = Path(folder) / "page.html"
        page.write_text(html, encoding="utf-8")
        done = subprocess.run(
            [
                browser, "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage",
                "--no-first-run", "--disable-background-networking", f"--user-data-dir={folder}/profile",
                "--no-pdf-header-footer", f"--print-to-pdf={pdf.absolute()}", page.as_uri(),
            ],
            capture_output=True, timeout=_SECONDS_AT_MOST, check=False,
        )  # fmt: skip
    lines = done.stderr.decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else "it said nothing"
