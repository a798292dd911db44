"""The report in Debian's Chromium, on a desk and on a phone: what people do with it, and what must never happen."""

import csv
import dataclasses
import gzip
import json
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.harness.reports import answered, entries, hostile, not_assessed, unusable, weld
from weld_force_ros._words import english
from weld_force_ros.recording.weld_records import Record
from weld_force_ros.report import pdf as printing
from weld_force_ros.report.html_page import Report, page, page_of_records, paper, report_of
from weld_force_ros.report.page_header import header
from weld_force_ros.report.table_row import row, row_html
from weld_force_ros.report.weld_section import section

pytestmark = pytest.mark.slow

BROWSER = printing.find_browser()
if BROWSER is None:
    pytest.skip("no Chromium was found on PATH (apt install chromium)", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

DESK: dict[str, Any] = {"viewport": {"width": 1280, "height": 800}}
PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
TWO_SCREENS_PX = 1_700
DRAWN = "#weld article svg.figure"

# Contrast of what is written with what lies behind it, by WCAG 2.1, of every text that is shown.
CONTRASTS = """() => {
  const channels = (colour) => (colour.match(/[\\d.]+/g) ?? []).map(Number);
  const luminance = ([r, g, b]) => [r, g, b].map((c) => c / 255)
    .map((c) => (c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4))
    .reduce((sum, c, i) => sum + c * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (node) => {
    for (let at = node; at; at = at.parentElement) {
      const [r, g, b, a = 1] = channels(getComputedStyle(at).backgroundColor);
      if (a === 1 && r !== undefined) return [r, g, b];
    }
    return [255, 255, 255];
  };
  const found = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode.parentElement;
    if (!walker.currentNode.data.trim() || node.closest("script, style, noscript, svg") || !node.offsetParent) continue;
    const [a, b] = [luminance(channels(getComputedStyle(node).color)), luminance(behind(node))];
    found.push([(Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05), walker.currentNode.data.trim().slice(0, 40)]);
  }
  return found;
}"""


@dataclass
class Watched:
    """A page with all that it complained of and asked for."""

    page: Any
    complaints: list[str] = field(default_factory=list)
    asked: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with playwright.sync_playwright() as started:
        browser = started.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-dev-shm-usage"])
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("report") / "report.html", entries())


def written(path: Path, of: list[Record]) -> Path:
    path.write_text(page_of_records(of, about="a test"), encoding="utf-8")
    return path


def watch(chromium: Any, how: dict[str, Any]) -> Iterator[Watched]:
    context = chromium.new_context(**how)
    watched = Watched(context.new_page())
    watched.page.on("console", lambda m: watched.complaints.append(m.text) if m.type in ("error", "warning") else None)
    watched.page.on("pageerror", lambda error: watched.complaints.append(str(error)))
    watched.page.on("request", lambda request: watched.asked.append(request.url))
    yield watched
    context.close()


@pytest.fixture
def fresh(chromium: Any) -> Iterator[Watched]:
    """A page of a desk that nobody used before."""
    yield from watch(chromium, DESK)


@pytest.fixture(scope="module")
def desk(chromium: Any) -> Iterator[Watched]:
    """One page for many tests."""
    yield from watch(chromium, DESK)


@pytest.fixture(scope="module")
def phone(chromium: Any) -> Iterator[Watched]:
    """One page for many tests, as on a phone."""
    yield from watch(chromium, PHONE)


@pytest.fixture(params=["desk", "phone"])
def either(request: pytest.FixtureRequest) -> Watched:
    watched: Watched = request.getfixturevalue(request.param)
    return watched


def open_page(watched: Watched, file: Path, fragment: str = "#") -> Any:
    if watched.page.url.startswith(file.as_uri()):
        watched.page.evaluate("to => { location.hash = to; }", fragment)
    else:
        watched.page.goto(file.as_uri() + fragment)
    watched.page.wait_for_selector("html[data-ready]")
    number = fragment.removeprefix("#weld-")
    if number.isdecimal():
        watched.page.wait_for_selector(f'#weld article[data-number="{number}"]')
    return watched.page


def shown(page: Any) -> list[str]:
    return page.locator(".welds tbody a").all_text_contents()


def quiet(watched: Watched, file: Path) -> None:
    assert watched.complaints == []
    assert [u for u in watched.asked if not u.startswith((file.as_uri(), "data:", "blob:"))] == []


def test_the_table_sorts_by_every_column_both_ways_and_filters(desk, file):
    page = open_page(desk, file)
    assert shown(page)[0] == "wheel-flat-0.9mm"
    for heading in page.locator(".welds thead button:visible").all():
        heading.click()
        once = shown(page)
        heading.click()
        assert sorted(once) == sorted(shown(page))
        assert page.locator(".welds th[aria-sort]").count() == 1
    page.get_by_role("button", name="Peak", exact=True).click()
    peaks = [float(t.split()[0]) for t in page.locator(".welds tbody .c-peak").all_text_contents() if t != "–"]
    assert peaks == sorted(peaks, reverse=True)
    page.get_by_label("Find", exact=True).fill("grind km12")
    assert shown(page) == ["KM12-ground"]
    page.get_by_label("Find", exact=True).fill("")
    page.locator(".chip", has_text="Undecided").click()
    assert shown(page) == ["KM12-undecided"]
    assert "1 of 6" in page.locator(".count").text_content()
    page.locator(".chip", has_text="All").click()
    assert len(shown(page)) == 6
    page.locator(".welds thead button", has_text="Decision").click()
    quiet(desk, file)


@pytest.fixture(scope="module")
def line_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Welds on two lines, one measured on a stated day; another's place is not known."""
    base = weld("weld-1-dip")
    of: list[Record] = [unusable()]
    for name, line, rail, at, day in (
        ("a", "1750", "left", 900.0, "2026-11-20"), ("b", "1750", "right", 12500.0, "21.11.2026"),
        ("c", "1801", "left", 13000.0, None),
    ):  # fmt: skip
        profile = replace(base.profile, line=line, measured_on=day or UNSET)
        verdict = replace(base.verdict, weld_id=name, rail=rail, chainage_m=at)
        of.append(dataclasses.replace(base, profile=profile, verdict=verdict))
    return written(tmp_path_factory.mktemp("line") / "line.html", of)


def test_lines_rails_chainages_and_dates_filter_and_sort(fresh, line_file):
    page = open_page(fresh, line_file)
    page.locator(".filters summary").click()
    page.get_by_label("Line", exact=True).select_option("1750")
    assert sorted(shown(page)) == ["a", "b"]
    page.get_by_label("Rail", exact=True).select_option("right")
    assert shown(page) == ["b"]
    for label in ("Line", "Rail"):
        page.get_by_label(label, exact=True).select_option("")
    page.get_by_label("From km").fill("10")
    page.get_by_label("to km").fill("12.5")
    assert shown(page) == ["b"]
    page.get_by_label("From km").fill("")
    page.get_by_label("to km").fill("")
    page.get_by_label("Measured from").fill("2026-11-21")
    assert shown(page) == ["b"]
    page.get_by_label("Measured from").fill("")
    page.get_by_label("Sort by").select_option("chainage")
    assert shown(page)[:3] == ["a", "b", "c"]
    page.get_by_role("button", name="Reverse").click()
    assert shown(page)[1:] == ["c", "b", "a"]
    quiet(fresh, line_file)


def test_the_csv_holds_what_is_shown(fresh, line_file):
    page = open_page(fresh, line_file)
    page.get_by_label("Find", exact=True).fill("1750")
    page.get_by_label("Sort by").select_option("chainage")
    with page.expect_download() as download:
        page.get_by_role("link", name="Save as CSV").click()
    with open(download.value.path(), encoding="utf-8-sig", newline="") as file:
        lines = list(csv.DictReader(file))
    assert {(line["weld"], line["chainage_m"]) for line in lines} == {("a", "900"), ("b", "12500")}
    assert lines[0]["decision"] == weld("weld-1-dip").verdict.decision
    assert float(lines[0]["peak_force_n"]) == pytest.approx(weld("weld-1-dip").verdict.peak_force_n, rel=1e-4)
    page.get_by_label("Find", exact=True).fill("")


def test_a_weld_opens_by_keyboard_and_back_returns_to_its_row(desk, file):
    page = open_page(desk, file)
    page.locator(".welds thead button:visible").last.focus()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "wheel-flat-0.9mm"
    page.keyboard.press("Enter")
    page.wait_for_selector(DRAWN)
    assert page.evaluate("location.hash") == "#weld-3"
    assert page.evaluate("document.activeElement.textContent") == "wheel-flat-0.9mm"
    page.go_back()
    page.wait_for_selector(".welds tbody tr", state="visible")
    assert page.evaluate("document.activeElement.textContent") == "wheel-flat-0.9mm"
    assert not page.locator("#weld").is_visible()
    page.go_forward()
    page.wait_for_selector(DRAWN)
    quiet(desk, file)


def test_figures_are_read_by_pointer_and_arrow_keys(desk, file):
    page = open_page(desk, file, "#weld-2")
    page.locator("#weld details summary", has_text="More figures").click()
    for heading, words in (
        ("Geometry and quality index", "rail"), ("Peak force over speed", "kN"), ("Peak force by speed", "km/h"),
    ):  # fmt: skip
        card = page.locator("#weld figure", has=page.get_by_role("heading", name=heading))
        card.locator("svg").scroll_into_view_if_needed()
        card.locator("svg").hover()
        pointed = card.locator(".readout").text_content()
        assert words in pointed
        card.locator(".plot").focus()
        for _ in range(8):
            page.keyboard.press("ArrowRight")
        assert card.locator(".readout").text_content() != pointed
    quiet(desk, file)


def test_a_tap_opens_a_weld_and_a_tap_reads_the_map(phone, file):
    page = open_page(phone, file)
    page.locator(".welds tbody tr", has_text="KM12-ground").locator(".c-advice").tap()
    page.wait_for_selector(DRAWN)
    assert page.evaluate("location.hash") == "#weld-2"
    page.locator("#weld details summary", has_text="More figures").tap()
    card = page.locator("#weld figure", has=page.get_by_role("heading", name="Peak force by speed"))
    card.locator("svg").tap()
    assert "km/h, weld" in card.locator(".readout").text_content()
    page.locator("#weld nav").get_by_text("All welds").tap()
    page.wait_for_selector(".welds tbody tr", state="visible")
    quiet(phone, file)


@pytest.mark.parametrize("number", range(1, 7))
def test_every_kind_of_weld_is_shown_without_scrolling_sideways(either, file, number):
    page = open_page(either, file, f"#weld-{number}")
    for summary in page.locator("#weld details summary").all():
        summary.click()
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert page.locator("#weld .badge").first.text_content().strip("✓◐✕?!") in (
        "Accept", "Grind", "Reject", "Undecided", "Unreadable",
    )  # fmt: skip
    assert "UNVERIFIED" not in page.locator("#weld").inner_text()
    quiet(either, file)


@pytest.fixture(params=[DESK, PHONE], ids=["desk", "phone"])
def unused(request: pytest.FixtureRequest, chromium: Any) -> Iterator[Watched]:
    """A page that nobody used before, of either kind."""
    yield from watch(chromium, request.param)


def test_both_answers_action_and_why_stand_on_the_first_screens(unused, tmp_path):
    file = written(tmp_path / "answers.html", [answered(), not_assessed(), unusable()])
    page = open_page(unused, file)
    basis = page.locator(".basis").inner_text()
    for words in ("banenor-531", "5 % of exceeding", "bilbao", "100 kN", "600 kg", "2026-11-20", "160 km/h"):
        assert words in basis
    answers = page.locator(".welds .c-geometry .badge").all_text_contents()
    assert answers == ["◐Grind", "–Not assessed"]
    for number in (1, 2):
        open_page(unused, file, f"#weld-{number}")
        page.wait_for_selector(DRAWN)
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        geometry, force = (box.bounding_box() for box in page.locator("#weld .question").all())
        assert (geometry["y"] == force["y"]) == (page.viewport_size["width"] > 800)
        assert page.locator("#weld .headline").bounding_box()["y"] < geometry["y"]
        for part in (".headline", ".question", ".facts"):
            box = page.locator(f"#weld {part}").last.bounding_box()
            assert box["y"] + box["height"] + page.evaluate("scrollY") < TWO_SCREENS_PX, part
        assert [text for ratio, text in page.evaluate(CONTRASTS) if ratio < 4.5] == []
    assert "weld-force limits list" in page.locator("#weld .question").first.inner_text()
    quiet(unused, file)


@pytest.mark.parametrize("how", [DESK, PHONE], ids=["desk", "phone"])
def test_without_a_script_the_page_is_whole(chromium, file, how):
    context = chromium.new_context(java_script_enabled=False, **how)
    opened = context.new_page()
    opened.goto(file.as_uri())
    assert shown(opened)[0] == "wheel-flat-0.9mm"  # the worst first
    assert opened.locator("article.weld").count() == 6
    assert opened.locator("article.weld svg.figure").count() >= 15
    assert opened.locator(".js-only:visible").count() == 0
    opened.get_by_role("link", name="KM12-ground").click()
    assert opened.url.endswith("#weld-2")
    part = opened.locator("#weld-2")
    assert "Grind this weld: remove at most 0.30 mm." in part.inner_text()
    part.locator("summary", has_text="All criteria").click()
    assert "Contact loss" in part.locator("table.criteria").inner_text()
    width = opened.locator("article.weld").first.bounding_box()["width"]
    assert width <= how["viewport"]["width"]
    context.close()


def test_basics_of_accessibility(either, file):
    page = open_page(either, file)
    for fragment in ("#", "#weld-2"):
        if fragment != "#":
            open_page(either, file, fragment)
            page.wait_for_selector(DRAWN)
        closed = page.locator("details:not([open]) > summary:visible")
        while closed.count():
            closed.first.click()
        assert page.evaluate("document.documentElement.lang") == "en"
        unlabelled = """[...document.querySelectorAll('input, select, button, [tabindex="0"], svg[role]')]
            .filter((e) => e.checkVisibility() && !e.labels?.length && !e.textContent.trim()
              && !e.getAttribute('aria-label')).length"""
        assert page.evaluate(unlabelled) == 0
        levels = page.evaluate(
            "[...document.querySelectorAll('h1, h2, h3, h4')].filter((h) => h.offsetParent).map((h) => +h.tagName[1])"
        )
        assert levels[0] == 1
        assert all(b <= a + 1 for a, b in pairwise(levels))
        weak = [(ratio, text) for ratio, text in page.evaluate(CONTRASTS) if ratio < 4.5]
        assert weak == []
        targets = page.evaluate(
            "[...document.querySelectorAll('.button, .chip, input, select, summary')].filter((e) => e.offsetParent)"
            ".map((e) => e.getBoundingClientRect().height)"
        )
        assert min(targets) >= 44


def test_hostile_names_are_shown_and_run_nothing(fresh, tmp_path):
    file = written(tmp_path / "hostile.html", hostile())
    for fragment in ("#", "#weld-1", "#weld-2", "#print"):
        page = open_page(fresh, file, fragment)
        if fragment == "#weld-1":
            for summary in page.locator("#weld details summary").all():
                summary.click()
            for plot in page.locator("#weld svg.figure").all():
                plot.hover()
        if fragment == "#print":
            page.wait_for_selector("body[data-printed]")
        assert page.evaluate("window.pwned") is None
        assert page.locator("img").count() == 0
        assert "onerror" in page.locator("body").inner_text()
    assert fresh.complaints == []


def test_the_policy_stops_a_script_that_came_in_all_the_same(fresh, file):
    page = open_page(fresh, file)
    page.evaluate(
        """() => { const s = document.createElement('script'); s.textContent = 'window.pwned = 1';
        document.head.append(s); const d = document.createElement('div');
        d.innerHTML = '<b onclick="window.pwned=2"></b>'; d.firstChild.click(); }"""
    )
    assert page.evaluate("window.pwned") is None
    assert any("Content Security Policy" in complaint for complaint in fresh.complaints)


def pages_of(pdf: Path) -> int:
    return len(re.findall(rb"/Type /Page[^s]", pdf.read_bytes()))


def test_paper_has_a_front_a_sheet_a_weld_and_the_hashes_last(fresh, tmp_path):
    of = [answered(), not_assessed(), *entries()]
    file, pdf = tmp_path / "paper.html", tmp_path / "report.pdf"
    report = report_of(of, about="a test")
    file.write_text(paper(report), encoding="utf-8")
    printing.print_pdf(paper(report), pdf)
    assert pages_of(pdf) == 1 + len(of) + 1
    fresh.page.emulate_media(media="print")
    fresh.page.set_viewport_size({"width": 703, "height": 1000})
    fresh.page.goto(file.as_uri())
    for sheet in fresh.page.locator("article.weld").all():
        # Nothing is cut off: each sheet has what it stands for, and room to sign.
        assert sheet.evaluate("e => e.scrollHeight <= e.clientHeight + 1")
        assert "Signature" in sheet.inner_text()
        assert sheet.locator(".paper-head").is_visible()
    front = fresh.page.locator("#front")
    assert "weld-4-steep-ramp" in front.inner_text()
    assert of[0].verdict.profile_sha256 in fresh.page.locator(".annex").inner_text()
    quiet(fresh, file)


def test_sixty_welds_stand_on_one_front(tmp_path):
    pdf = tmp_path / "report.pdf"
    report = report_of([answered(), not_assessed()], about="a test")
    report.rows = [{**report.rows[n % 2], "n": n + 1} for n in range(60)]
    report.sections, report.hashes = ["a weld"] * 60, report.hashes * 30
    printing.print_pdf(paper(report), pdf)
    assert pages_of(pdf) == 1 + 60 + 1


def test_all_that_is_shown_can_be_printed_from_the_page(desk, file):
    page = open_page(desk, file, "#print")
    page.wait_for_selector("body[data-printed]")
    assert page.locator("#all article svg.figure").count() >= 15
    quiet(desk, file)


class Server(BaseHTTPRequestHandler):
    """What a live dashboard answers."""

    def __init__(self, rows: list[dict[str, Any]], details: Sequence[bytes], newest: int | None, *args: Any) -> None:
        self.rows, self.details, self.newest = rows, details, newest
        super().__init__(*args)

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?after=")
        if path == "/":
            self.answer(page(Report(), live=True, newest=self.newest).encode(), "text/html")
        elif path == "/rows":
            found = [{**r, "html": row_html(r, english())} for r in self.rows if r["n"] > int(query)]
            self.answer(json.dumps(found).encode(), "application/json")
        elif path == "/header":
            self.answer(header([r["basis"] for r in self.rows if "basis" in r], [], english()).encode(), "text/html")
        else:
            self.answer(self.details[int(path.rpartition("/")[2]) - 1], "application/gzip")

    def answer(self, body: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        pass


@contextmanager
def serving(rows: list[dict[str, Any]], details: Sequence[bytes] = (), newest: int | None = None) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Server, rows, details, newest))
    Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        server.server_close()


def test_a_live_page_takes_rows_as_they_come_and_details_on_demand(fresh):
    of = entries()
    rows: list[dict[str, Any]] = [row(1, of[0])]
    with serving(rows, [gzip.compress(section(e, english()).encode()) for e in of]) as home:
        fresh.page.goto(home)
        fresh.page.wait_for_selector(".welds tbody tr")
        assert len(shown(fresh.page)) == 1
        rows.append(row(2, of[1]))
        fresh.page.wait_for_selector("text=KM12-ground")
        fresh.page.get_by_role("link", name="KM12-ground").click()
        fresh.page.wait_for_selector(DRAWN)
        assert "bilbao" in fresh.page.locator(".basis").text_content()
        assert {u.removeprefix(home).partition("=")[0] for u in fresh.asked if u.startswith("http")} == {
            "", "rows?after", "header", "weld/2",
        }  # fmt: skip
        assert fresh.complaints == []
    fresh.page.wait_for_selector("text=connection lost")


def test_a_live_page_keeps_as_many_rows_as_its_server(fresh):
    rows = [row(n, unusable(f"weld-{n}.csv")) for n in range(1, 6)]
    with serving(rows, newest=3) as home:
        fresh.page.goto(home)
        fresh.page.wait_for_selector(".welds tbody tr")
        assert shown(fresh.page) == ["weld-5.csv", "weld-4.csv", "weld-3.csv"]
        rows.append(row(6, unusable("weld-6.csv")))
        fresh.page.wait_for_selector("text=weld-6.csv")
        assert shown(fresh.page) == ["weld-6.csv", "weld-5.csv", "weld-4.csv"]
        assert fresh.page.locator(".chip .number").all_text_contents() == ["3", "3"]
