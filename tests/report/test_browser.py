"""The report in Debian's Chromium, on a desk and on a phone: what people do with it, and what must never happen."""

import json
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

from tests.harness.reports import answered, entries, hostile, not_assessed, unusable, weld
from weld_force_ros.recording.weld_records import Record
from weld_force_ros.report import pdf as printing
from weld_force_ros.report.html_page import page
from weld_force_ros.report.table_row import row
from weld_force_ros.report.weld_detail import detail

pytestmark = pytest.mark.slow

BROWSER = printing.find_browser()
if BROWSER is None:
    pytest.skip("no Chromium was found on PATH (apt install chromium)", allow_module_level=True)
playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

DESK: dict[str, Any] = {"viewport": {"width": 1280, "height": 800}}
PHONE: dict[str, Any] = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
DRAWN = "#weld .js-plotly-plot .main-svg"

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
    html = page([row(n, e) for n, e in enumerate(of, 1)], [detail(e) for e in of], title="Rail welds", about="a test")
    path.write_text(html, encoding="utf-8")
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
    """One page for many tests: unpacking Plotly takes seconds."""
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


def until(page: Any, condition: str, argument: object = None) -> None:
    """Wait without Playwright's own way, which evaluates strings in the page: its policy forbids that."""
    for _ in range(400):
        if page.evaluate(condition, argument):
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"never came true: {condition}")


def drawn(page: Any) -> None:
    until(
        page,
        "() => document.querySelector('#weld article')"
        " && [...document.querySelectorAll('#weld .chart')].every((c) => c.querySelector('.main-svg'))",
    )


def shown(page: Any) -> list[str]:
    return page.locator(".welds tbody a").all_text_contents()


def quiet(watched: Watched, file: Path) -> None:
    assert watched.complaints == []
    # The page itself, its icon of no bytes, and the pictures that Plotly makes of maps.
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
    page.get_by_role("button", name="Peak").click()
    peaks = [float(t.split()[0]) for t in page.locator(".welds tbody .c-peak").all_text_contents() if t != "–"]
    assert peaks == sorted(peaks, reverse=True)
    page.get_by_label("Find").fill("grind km12")
    assert shown(page) == ["KM12-ground"]
    page.get_by_label("Find").fill("")
    page.locator(".chip", has_text="Undecided").click()
    assert shown(page) == ["KM12-undecided"]
    assert "1 of 6" in page.locator(".count").text_content()
    page.locator(".chip", has_text="All").click()
    assert len(shown(page)) == 6
    page.locator(".welds thead button", has_text="Decision").click()
    quiet(desk, file)


def test_a_weld_opens_by_keyboard_and_back_returns_to_its_row(desk, file):
    page = open_page(desk, file)
    page.get_by_label("Find").focus()
    for _ in range(8):  # over the headings to the first weld
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


def test_the_map_answers_to_pointer_and_arrow_keys(desk, file):
    page = open_page(desk, file, "#weld-2")
    drawn(page)
    page.locator("#weld .chart.high").scroll_into_view_if_needed()
    area = page.locator("#weld .chart.high .nsewdrag").first.bounding_box()
    for share in (0.3, 0.4, 0.5):
        page.mouse.move(area["x"] + area["width"] * share, area["y"] + area["height"] * share)
        page.wait_for_timeout(100)
    page.wait_for_selector("#weld .chart.high .hoverlayer .hovertext")
    assert "km/h" in page.locator("#weld .chart.high .hovertext").first.text_content()
    said = page.locator(".readout").text_content()
    page.locator("#weld .chart.high").focus()
    page.keyboard.press("ArrowUp")
    page.keyboard.press("ArrowRight")
    assert page.locator(".readout").text_content() not in ("", said)
    quiet(desk, file)


def test_a_tap_opens_a_weld_and_a_tap_reads_the_map(phone, file):
    page = open_page(phone, file)
    page.locator(".welds tbody tr", has_text="KM12-ground").locator(".c-advice").tap()
    drawn(page)
    assert page.evaluate("location.hash") == "#weld-2"
    before = page.locator(".readout").text_content()
    area = page.locator("#weld .chart.high")
    area.scroll_into_view_if_needed()
    box = area.bounding_box()
    area.tap(position={"x": box["width"] * 0.4, "y": box["height"] * 0.7})
    until(page, "(was) => document.querySelector('.readout').textContent !== was", before)
    page.locator("#weld nav").get_by_text("All welds").tap()
    page.wait_for_selector(".welds tbody tr", state="visible")
    quiet(phone, file)


def test_the_restriction_tool_tells_what_the_verdict_tells(desk, file):
    judged = weld("wheel-flat-0.9mm").verdict
    page = open_page(desk, file, "#weld-3")
    page.wait_for_selector(DRAWN)
    worse = max(judged.restrictions, key=lambda r: r.change)
    slider = page.locator("#weld input[type=range]")
    slider.evaluate(
        "(at, value) => { at.value = value; at.dispatchEvent(new Event('input')); }", str(int(worse.speed_kmh) - 40)
    )
    assert f"restriction to {worse.speed_kmh:g} km/h" in page.locator(".restrict label").text_content()
    answer = page.locator(".restrict .answer").text_content()
    assert ("Within limits" in answer) == worse.within_limits
    if round(100 * worse.change) > 1:
        assert f"{worse.change * 100:.0f} % MORE" in answer
    slider.focus()
    page.keyboard.press("ArrowLeft")
    assert f"{worse.speed_kmh - 1:g} km/h" in page.locator(".restrict label").text_content()
    quiet(desk, file)


@pytest.mark.parametrize("number", range(1, 7))
def test_every_kind_of_weld_is_shown_without_scrolling_sideways(either, file, number):
    page = open_page(either, file, f"#weld-{number}")
    drawn(page)
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    assert page.locator("#weld .badge").first.text_content().strip("✓◐✕?!") in (
        "Accept", "Grind", "Reject", "Undecided", "Unreadable",
    )  # fmt: skip
    unverified = page.locator("#weld .unverified").count()
    assert unverified > 0 or number == 6
    quiet(either, file)


@pytest.fixture(params=[DESK, PHONE], ids=["desk", "phone"])
def unused(request: pytest.FixtureRequest, chromium: Any) -> Iterator[Watched]:
    """A page that nobody used before, of either kind."""
    yield from watch(chromium, request.param)


def test_both_answers_stand_side_by_side_or_below_each_other(unused, tmp_path):
    file = written(tmp_path / "answers.html", [answered(), not_assessed(), unusable()])
    page = open_page(unused, file)
    basis = page.locator(".basis").inner_text()
    for words in ("banenor-531", "5 % of exceeding", "bilbao", "100 kN", "600 kg", "2026-11-20", "160 km/h"):
        assert words in basis
    assert page.locator(".welds .c-geometry .badge").all_text_contents() == ["◐Grind", "–Not assessed"]
    assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
    for number in (1, 2):
        open_page(unused, file, f"#weld-{number}")
        drawn(page)
        assert page.evaluate("document.documentElement.scrollWidth <= window.innerWidth")
        geometry, force = (box.bounding_box() for box in page.locator("#weld .question").all())
        assert (geometry["y"] == force["y"]) == (page.viewport_size["width"] > 800)
        assert page.locator("#weld .headline").bounding_box()["y"] > force["y"]
        assert 1 <= page.locator("body").inner_text().count("UNVERIFIED") <= 2
        assert [text for ratio, text in page.evaluate(CONTRASTS) if ratio < 4.5] == []
    assert "weld-force limits list" in page.locator("#weld .question").first.inner_text()
    quiet(unused, file)


def test_basics_of_accessibility(either, file):
    page = open_page(either, file)
    for fragment in ("#", "#weld-2"):
        if fragment != "#":
            open_page(either, file, fragment)
            drawn(page)
            page.locator("#weld details summary").last.click()
        assert page.evaluate("document.documentElement.lang") == "en"
        unlabelled = """[...document.querySelectorAll('input, select, button')].filter((e) => e.offsetParent)
            .filter((e) => !e.labels?.length && !e.textContent.trim() && !e.getAttribute('aria-label')).length"""
        assert page.evaluate(unlabelled) == 0
        levels = page.evaluate(
            "[...document.querySelectorAll('h1, h2, h3, h4')].filter((h) => h.offsetParent).map((h) => +h.tagName[1])"
        )
        assert levels[0] == 1
        assert all(b <= a + 1 for a, b in pairwise(levels))
        weak = [(ratio, text) for ratio, text in page.evaluate(CONTRASTS) if ratio < 4.5]
        assert weak == []
        targets = page.evaluate(
            "[...document.querySelectorAll('.button, .chip, input, select')].filter((e) => e.offsetParent)"
            ".map((e) => e.getBoundingClientRect().height)"
        )
        assert min(targets) >= 44


def test_hostile_names_are_shown_and_run_nothing(fresh, tmp_path):
    file = written(tmp_path / "hostile.html", hostile())
    for fragment in ("#", "#weld-1", "#weld-2", "#print"):
        page = open_page(fresh, file, fragment)
        if fragment == "#weld-1":
            drawn(page)
            for option in page.locator("#weld select option").all():
                page.locator("#weld select").select_option(index=option.evaluate("o => o.index"))
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


def test_all_welds_are_printed(desk, file, tmp_path):
    page = open_page(desk, file, "#print")
    page.wait_for_selector("body[data-printed]")
    assert page.locator("#all article").count() == 6
    assert page.locator("#all .chart:not(:has(.main-svg))").count() == 0
    pdf = tmp_path / "report.pdf"
    printing.print_pdf(file, pdf)
    assert pdf.read_bytes().startswith(b"%PDF")
    # The table, five welds of a page or two, and a rejection.
    assert pdf.read_bytes().count(b"/Type /Page\n") >= 7
    quiet(desk, file)


class Server(BaseHTTPRequestHandler):
    """What a live dashboard answers."""

    def __init__(self, rows: list[dict[str, Any]], details: Sequence[bytes], newest: int | None, *args: Any) -> None:
        self.rows, self.details, self.newest = rows, details, newest
        super().__init__(*args)

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?after=")
        if path == "/":
            self.answer(page([], [], title="Rail welds", live=True, newest=self.newest).encode(), "text/html")
        elif path == "/rows":
            self.answer(json.dumps([r for r in self.rows if r["n"] > int(query)]).encode(), "application/json")
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
    with serving(rows, [detail(e) for e in of]) as home:
        fresh.page.goto(home)
        fresh.page.wait_for_selector(".welds tbody tr")
        assert len(shown(fresh.page)) == 1
        rows.append(row(2, of[1]))
        fresh.page.wait_for_selector("text=KM12-ground")
        fresh.page.get_by_role("link", name="KM12-ground").click()
        fresh.page.wait_for_selector(DRAWN)
        assert {u.removeprefix(home).partition("=")[0] for u in fresh.asked if u.startswith("http")} == {
            "", "rows?after", "weld/2",
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
