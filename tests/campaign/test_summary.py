"""A campaign's summary page over results made by hand: what it says, and in the browser how its strips are used."""

import html as markup
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import duckdb
import pandas as pd
import pytest

from tests.harness.reports import HOSTILE
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.campaign import summary
from weld_force_ros.report.pdf import find_browser

WELDS = 40
FIELDS = """weld_number, weld_id, line, section, vehicle, rail, chainage_m, decision, geometry_answer, force_answer,
    peak_force_n, worst_speed_kmh, worst_criterion, worst_ratio, permitted_speed_kmh, judged_speed_kmh, geometry_kind,
    curve_class, line_speed_kmh, worst_position_m"""


def weld(number: int) -> tuple[Any, ...]:
    """Every tenth weld is over its limit at the first computed speed already."""
    bad = number % 10 == 0
    name = HOSTILE if number == 20 else f"weld-{number}"
    return (
        number, name, "north", "plain", "passenger", "left", 1000.0 + 10 * number, "grind" if bad else "accept",
        "accept", "grind" if bad else "accept", 220e3 + number if bad else 120e3, 160.0, "peak_force",
        1.5 + number / 100 if bad else 0.8, None if bad else 160.0, 160.0, "dip", "rises", 160.0, 0.3,
    )  # fmt: skip


@pytest.fixture
def page(monkeypatch: pytest.MonkeyPatch) -> str:
    def connect(_: Path) -> duckdb.DuckDBPyConnection:
        connection = duckdb.connect()
        rows = pd.DataFrame([weld(number) for number in range(WELDS)], columns=FIELDS.replace(",", " ").split())
        connection.register("rows", rows)
        connection.execute("CREATE TABLE verdicts AS FROM rows")
        connection.execute("CREATE VIEW vehicles AS FROM verdicts")
        connection.execute(
            "CREATE TABLE speeds AS SELECT weld_number, vehicle, speed_kmh, peak_force_n * speed_kmh / 160 AS"
            " peak_force_n FROM verdicts, (VALUES (80.0), (160.0)) AS s(speed_kmh)"
        )
        connection.execute("CREATE TABLE rejections AS SELECT 'no units' AS reason, ? AS source", [HOSTILE])
        return connection

    plan = SimpleNamespace(
        name="north", welds=WELDS + 1, software="here", limits=load_limits(),
        sections=[SimpleNamespace(vehicles={"passenger": None})],
    )  # fmt: skip
    monkeypatch.setattr(summary.query, "connect", connect)
    monkeypatch.setattr(summary.plans, "results", lambda _: plan)
    return summary.html(Path())


def words_of(html: str) -> str:
    return " ".join(markup.unescape(re.sub(r"<[^>]*>", " ", html)).split())


def test_a_weld_is_a_row_under_the_vehicle_that_decides(page):
    rows = re.findall(r"<tr><th scope=\"row\">(weld-\d+|&lt;.*?)<span", page)
    assert (rows[0], len(rows)) == ("weld-30", WELDS)
    (worst,) = re.findall(r'<tr><th scope="row">weld-30<.*?</tr>', page, re.DOTALL)
    words = words_of(worst)
    assert words == (
        "weld-30 line north · left · plain · km 1.300 ◐ Grind ✓ Accept ◐ Grind passenger Peak force: 1.80 × limit"
        " 220 kN at 160 km/h below the first computed speed"
    )
    assert "no speed" not in page


def test_what_nobody_verified_is_said_once(page):
    assert words_of(page).count("Limits not verified") == 1


def test_stretches_hold_their_decisions_and_their_worst(page):
    """40 welds in stretches of eight: five, each with its own."""
    rows = [words_of(row) for row in re.findall(r'<tr id="line-0-\d+">.*?</tr>', page, re.DOTALL)]
    assert [row.split()[:4] for row in rows] == [
        ["km", f"{1 + 0.078 * i:.3f}", "to", f"{1 + 0.078 * (i + 1):.3f}"] for i in range(5)
    ]
    assert rows[0].split(" ", 4)[4] == (
        "8 Grind 1, Accept 7 220 kN ◐ Grind weld-0, km 1.000 ✓ Accept weld-1, km 1.010 ✓ Accept weld-2, km 1.020"
    )
    links = re.findall(r'<a href="#(line-0-\d+)"', page)
    assert links == re.findall(r'<tr id="(line-0-\d+)"', page)


def test_nothing_from_outside_is_markup_and_nothing_runs_but_the_pages_own(page):
    assert "<img" not in page
    assert page.count("<script") == 2
    assert "unsafe" not in page.partition("<style>")[0]
    assert " style=" not in page


@pytest.mark.slow
@pytest.mark.parametrize("width", [1280, 390])
def test_a_strip_zooms_and_a_stretch_is_pressed(page, tmp_path, width):
    browser = find_browser()
    if browser is None:
        pytest.skip("no Chromium was found on PATH (apt install chromium)")
    playwright = pytest.importorskip("playwright.sync_api")
    (tmp_path / "summary.html").write_text(page, encoding="utf-8")
    with playwright.sync_playwright() as started:
        chromium = started.chromium.launch(executable_path=browser, args=["--no-sandbox"])
        opened = chromium.new_page(viewport={"width": width, "height": 800})
        complaints: list[str] = []
        opened.on("console", lambda m: complaints.append(m.text) if m.type in ("error", "warning") else None)
        opened.on("pageerror", lambda error: complaints.append(str(error)))
        opened.goto((tmp_path / "summary.html").as_uri())
        assert opened.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        ends = opened.locator(".ends span")
        assert ends.all_text_contents() == ["1.000 km", "1.390 km"]
        opened.locator("svg.strip a").nth(2).focus()
        opened.keyboard.press("Enter")
        assert "Grind 1, Accept 7" in opened.locator(".chosen").text_content()
        assert HOSTILE in opened.locator(".chosen").text_content()
        opened.get_by_role("button", name="Zoom in").click()
        first, last = (float(text.split()[0]) for text in ends.all_text_contents())
        assert 1.0 < first < last < 1.39
        opened.get_by_role("button", name="Whole line").click()
        assert ends.all_text_contents() == ["1.000 km", "1.390 km"]
        assert opened.evaluate("window.pwned") is None
        assert complaints == []
        # Cards, not nine columns, on a phone.
        cells = opened.locator("table.worst tbody tr").first.locator("td").all()
        lines = {round(cell.bounding_box()["y"]) for cell in cells}
        assert (len(lines) > 1) == (width < 800)
        chromium.close()
