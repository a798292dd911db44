"""The report without a browser: what goes into the page, and what may not."""

import html as markup
import json
import re
import subprocess
from collections import Counter
from dataclasses import replace as replace_record
from html.parser import HTMLParser
from importlib import resources
from pathlib import Path
from string import Formatter

import numpy as np
import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.harness.limits import OF_1_3, by_value
from tests.harness.reports import (
    HOSTILE,
    ancient,
    answered,
    entries,
    ground,
    hostile,
    not_assessed,
    undecided,
    unusable,
    weld,
)
from weld_force_ros._words import english
from weld_force_ros.assessment.criteria import CRITERIA, WORDS
from weld_force_ros.assessment.judge import assess, judge
from weld_force_ros.cli.main import main
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.messages import OppositeDirection, UncertaintyResult, encode, parse_support
from weld_force_ros.recording import weld_records
from weld_force_ros.recording.recording import Recording, open_recording
from weld_force_ros.recording.weld_records import Record, WeldRecord
from weld_force_ros.report import html_page
from weld_force_ros.report import pdf as printing
from weld_force_ros.report.html_page import Report, page, page_of_records, paper, report_of
from weld_force_ros.report.table_row import row
from weld_force_ros.report.weld_detail import content
from weld_force_ros.report.weld_section import section
from weld_force_ros.simulation.settings import DEFAULT_TRACK, simulation_settings
from weld_force_ros.simulation.simulator import Simulator

BAG = Path(__file__).parents[2] / "bags" / "demo"
SNAPSHOT = Path(__file__).with_name("words_snapshot.txt")
FIVE_HUNDRED_BYTES = 15_000_000
WELD_BYTES = 28_000


def run(capfd: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str], str]:
    code = main(list(arguments))
    out, err = capfd.readouterr()
    return code, out.splitlines(), err


def made(of: list[Record]) -> str:
    return page_of_records(of, about="a test")


def said(entry: Record) -> str:
    """The words of a weld's part, without markup."""
    return words_of(section(entry, english()))


def words_of(html: str) -> str:
    return " ".join(markup.unescape(re.sub(r"<[^>]*>", " ", html)).split())


def rows_of(html: str) -> list[dict]:
    return [json.loads(markup.unescape(found)) for found in re.findall(r"data-row='([^']*)'", html)]


class Elements(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def elements(html: str) -> list[tuple[str, dict[str, str | None]]]:
    parser = Elements()
    parser.feed(html)
    return parser.found


def test_a_row_says_what_to_do_and_names_the_criterion_nearest_to_its_limit():
    judged = weld("wheel-flat-0.9mm")
    shown = row(3, judged)
    assert (shown["n"], shown["weld"], shown["decision"]) == (3, "wheel-flat-0.9mm", "reject")
    assert shown["worst"] == {"name": "contact_loss", "ratio": None, "passed": False, "verified": False}
    assert shown["advice"].startswith("Replace it (re-weld)")


def test_a_row_of_a_ground_weld_says_how_much_and_of_an_undecided_one_what_to_measure():
    assert re.match(r"Grind off up to \d\.\d\d mm", row(1, ground())["advice"])
    measure = "measure the weld's distance from the sleeper before it"
    assert row(1, undecided())["advice"] == f"Further measurement required: {measure}"
    assert row(1, unusable())["advice"] == "sample 12: z is not a finite number: measure again"


def test_a_row_of_two_answers_holds_both_and_what_they_rest_on():
    shown = row(1, answered())
    assert (shown["decision"], shown["geometry"]["decision"], shown["force"]["decision"]) == (
        "grind", "grind", "undecided",
    )  # fmt: skip
    assert 0.05 < shown["force"]["exceeding"] < 0.95
    assert shown["worst"]["base_m"] == 1.0
    basis = shown["basis"]
    assert [book.partition(":")[0] for book in basis["rule_books"]] == ["force", "banenor-531"]
    assert (basis["risk"], basis["static_n"], basis["line_kmh"]) == (0.05, 100e3, 160.0)
    assert (basis["track"], basis["unsprung_kg"], basis["date"]) == (DEFAULT_TRACK, 600.0, "2026-11-20")


def test_speeds_in_a_rows_words_are_rounded_down():
    base = answered()
    slow = row(1, replace_record(base, verdict=replace(base.verdict, permitted_speed_kmh=109.0)))
    assert slow["advice"] == "Grind; computed forces are within limits up to 105 km/h"
    assert slow["permitted_kmh"] == 109.0


def test_a_weld_that_no_grinding_helps_is_to_be_replaced():
    tried = replace(ground().grinding, reached=False)
    advice = row(1, replace_record(answered(), grinding=tried))["advice"]
    assert advice.startswith("No grinding was found that helps: replace it (re-weld); computed forces are within")


def test_an_undecided_weld_is_advised_what_to_measure_next():
    base = answered()
    undecided = replace(base.verdict, decision="undecided", measure_next="no measurement of the weld decides p2_force")
    assert row(1, replace_record(base, verdict=undecided))["advice"] == (
        "No measurement of the weld decides P2 force"
    )  # fmt: skip
    shown = row(1, not_assessed())
    assert (shown["decision"], shown["geometry"]) == ("undecided", {"decision": "not assessed"})
    assert shown["advice"].startswith("Choose a rule book on the geometry: `--limits force,NAME`")


def test_a_part_of_two_answers_names_criterion_margin_error_and_authority():
    words = said(answered())
    geometry, force = words.partition("Force, by model")[::2]
    assert "Peak under a straightedge of 1 m: 0.4 mm of 0.3 mm" in geometry
    assert "0.1 mm beyond the limit (33 %)" in geometry
    assert "banenor-531; that limit: read in the standard" in geometry
    value, error = re.search(r"Peak force: (\d+) kN of 150 kN .*?model error ± ([\d.]+) kN", force).groups()
    share = content(answered())["curves"]["error_share"]
    assert float(error) == pytest.approx(share * (float(value) - 100), rel=0.03)
    assert "force; that limit: engineering judgement, no standard" in force
    assert "peak_force" not in words
    about = dict(content(answered())["provenance"])
    assert about["limits"] == "force (0 of 6 numbers verified), banenor-531 (3 of 3 numbers verified)"
    assert "How limits become a decision: accepted risk 5%; " in words_of(made([answered()]))


def test_a_part_without_a_rule_book_says_how_to_choose_one():
    words = said(not_assessed()).partition("Force, by model")[0]
    assert "Geometry, by standard – Not assessed No limit of this kind was chosen." in words
    assert "weld-force limits list" in words


def test_what_nobody_verified_is_said_once_a_page():
    html = words_of(made([answered(), not_assessed(), weld("weld-1-dip")]))
    assert html.lower().count("limits not verified") == 1
    assert "UNVERIFIED" not in html
    assert "Limits not verified" not in words_of(made([unusable()]))


def test_the_front_says_what_is_stated_and_what_is_not():
    front = words_of(made([answered()]).partition('class="chips"')[0])
    for words in (
        "Line not stated", "Measured on 2026-11-20", "Inspector not stated", "Instrument trolley 7",
        "Calibration not stated", "Line speed 160 km/h", "5 % of exceeding a limit", "3 of 9 numbers verified",
        "static wheel load 100 kN, unsprung mass per wheel 600 kg", "towards rising x", DEFAULT_TRACK,
    ):  # fmt: skip
        assert words in front, words
    base = answered()
    stated = replace(base.profile, line="1750", operator="A. Inspector", calibration="2026-03-01, certificate 7")
    front = words_of(made([replace_record(base, profile=stated), base]))
    for words in ("Line 1750 not stated for 1 of 2", "Inspector A. Inspector", "Calibration 2026-03-01, certificate 7"):
        assert words in front, words
    assert "line 1750 · left · km 12.034 · measured on 2026-11-20" in front


def test_who_verified_a_limit_is_named():
    base = answered()
    limits = [replace(limit, verified=True, verified_by="B. Checker, 2026-01-02") for limit in base.limits.limits]
    words = words_of(made([replace_record(base, limits=replace(base.limits, limits=limits))]))
    assert "9 of 9 numbers verified, by B. Checker, 2026-01-02" in words
    assert "that limit: verified by B. Checker, 2026-01-02" in words
    assert "Limits not verified" not in words


@pytest.mark.parametrize("running", ["with", "against", "both", None])
def test_every_figure_has_an_arrow_of_the_running_direction(running):
    base = ground()
    against = base.force_map.against
    if running == "both":
        columns = {name: getattr(base.force_map, name) for name in OppositeDirection.__struct_fields__}
        against = OppositeDirection(**columns)
    turned = replace(base.force_map, running=UNSET if running is None else running, against=against)
    html = section(replace_record(base, force_map=turned), english())
    figures = re.findall(r'<svg class="figure.*?</svg>', html, re.DOTALL)
    assert len(figures) >= 4
    heads = {"with": 1, "against": 1, "both": 2, None: 1}[running]
    for one in figures:
        (arrow,) = re.findall(r'class="arrow" d="([^"]*)"', one)
        if "Contact force along the track" not in one:  # of one passage, which has a direction of its own
            assert arrow.count("M") == 1 + heads
            assert ("direction not stated" in one) == (running is None)


def test_what_is_not_told_depends_on_what_was_stated():
    words = said(ground())
    for part in ("Cracks and flaws", "Hardness", "Lateral geometry", "Hanging sleepers", "any other direction"):
        assert part in words
    base = ground()
    stated = replace(base.force_map, support=parse_support("0=0.02"))
    assert "Hanging sleepers" not in said(replace_record(base, force_map=stated))


def test_below_the_first_computed_speed_is_not_no_speed():
    base = answered()
    none = replace_record(base, verdict=replace(base.verdict, permitted_speed_kmh=UNSET))
    assert "below the first computed speed" in said(none)
    assert "no speed" not in said(none)
    assert row(1, none)["permitted_kmh"] == 0.0


def test_grinding_is_marked_where_and_how_deep():
    html = section(ground(), english())
    assert "−400 … −100 mm against rising chainage 0.30 mm, at −300 mm" in words_of(html)
    geometry = html.partition('aria-label="Height of the rail')[2].partition("</svg>")[0]
    x_low, x_high, first, last = map(float, re.search(r'data-x="([^"]*)"', geometry).group(1).split())
    left, width = (float(v) for v in re.search(r'class="spot" x="(\d+)" y="\d+" width="(\d+)"', geometry).groups())
    mm = [x_low + (at - first) / (last - first) * (x_high - x_low) for at in (left, left + width)]
    assert mm == pytest.approx([-400, -100], abs=1)
    assert ">0.30 mm</text>" in geometry


def test_what_stands_in_the_way_of_accepting_is_told_apart():
    assert "The line's speed is not stated: forces are within" in said(
        weld("weld-4-steep-ramp", rule_books="force")
    )  # fmt: skip
    assert "Forces hold up to 300 km/h" in said(weld("cosine-dip-48mm", line_speed_kmh=310.0, rule_books="force"))


def test_limits_are_drawn_at_what_they_come_to():
    series = {s["name"]: s for s in content(answered())["curves"]["series"]}
    assert [(one["limit"], one["reject_limit"]) for one in series["peak_force"]["limits"]] == [(150e3, 200e3)]


def test_no_local_minimum_below_the_models_error_is_outlined():
    cells = {books: content(weld("weld-1-dip", rule_books=books))["map"]["hollow"] for books in (None, "force")}
    assert cells[None].count("1") > cells["force"].count("1")
    assert content(answered())["curves"]["error_share"] > 0.1
    assert "error_share" not in content(weld("weld-1-dip"))["curves"]


def test_older_verdicts_have_no_answers_and_are_not_green():
    assert not {"geometry", "force"} & row(1, undecided()).keys()
    assert "rule_books" not in row(1, undecided())["basis"]
    html = section(weld("cosine-dip-48mm", line_speed_kmh=160.0, at_m=0.13), english())
    assert "one answer for geometry and force together" in html
    assert 'class="badge accept alone"' in html


def test_the_page_has_words_for_every_criterion():
    assert set(english().section("criterion")) == set(CRITERIA)
    assert WORDS.keys() == set(CRITERIA)


def test_nothing_said_about_speed_is_not_a_speed_of_nought():
    assert "permitted_kmh" not in row(1, ancient())
    assert row(1, weld("wheel-flat-0.9mm"))["permitted_kmh"] in (0.0, *range(1, 301))


def test_a_criterion_that_does_not_decide_is_not_the_worst_of_a_row():
    beside = {c.name for c in weld("wheel-flat-0.9mm").verdict.criteria if not c.decides}
    assert beside
    assert row(1, weld("wheel-flat-0.9mm"))["worst"]["name"] not in beside


def test_the_quality_index_along_a_weld_is_its_inclination_over_the_norm_of_the_line():
    """By hand: heights 25 mm apart, less the chord of 1 m; the norm at 140 km/h is 3.2 - 2.2 * 100 / 260 mrad."""
    base = ground()
    profile = replace(base.profile, line_speed_kmh=140.0)
    shown = content(replace_record(base, profile=profile, limits=replace(base.limits, gradient_norm=[])))["profile"]
    assert shown["norm_rad"] == pytest.approx((3.2 - 2.2 * 100 / 260) * 1e-3, rel=1e-3)
    x, z = np.array(profile.x_m), np.array(profile.z_m)
    at = np.arange(-0.5, 0.4751, 0.0005)
    chord = np.interp(0.5, x, z) - np.interp(-0.5, x, z)
    index = np.abs((np.interp(at + 0.025, x, z) - np.interp(at, x, z)) / 0.025 - chord) / shown["norm_rad"]
    assert max(shown["index"]) == pytest.approx(index.max(), abs=2e-3)
    worst_m = shown["index_from_m"] + shown["index_step_m"] * int(np.argmax(shown["index"]))
    assert worst_m == pytest.approx(at[index.argmax()] + 0.0125, abs=6e-3)
    assert len(shown["index"]) < 200


def test_the_share_of_what_differs_from_sleeper_to_sleeper_is_said():
    base = ground()
    effect = np.linspace(0.97, 1.03, 40)
    spread = UncertaintyResult(
        positions_m=[0.0], peak_force_n=(150e3 * effect).tolist(), min_force_n=[0.0] * 40, contact_loss_s=[0.0] * 40,
        gradient_rad=[0.0] * 40, straightedge_m=[0.0] * 40, support_factor=[1.0] * 40, hertz_factor=[1.0] * 40,
        wheel_radius_m=[0.45] * 40, sleeper_effect=effect.tolist(),
    )  # fmt: skip
    said = content(replace_record(base, force_map=replace(base.force_map, spread=spread)))["support"]
    share = int(said[-1].partition(": ")[2].partition("%")[0])
    assert 95 <= share <= 100  # groups of five leave some of it within
    assert "% of the peak force's variance" in said[-1]
    assert len(content(base)["support"]) == len(said) - 1


def test_what_the_wheel_bridges_is_drawn():
    base = ground()
    x = np.linspace(-0.1, 0.1, 401)
    z = np.where(np.abs(x) < 0.02, -4e-4, 0.0)  # a slot of 40 mm: a wheel of 0.45 m comes down by 0.44 mm at most
    slot = replace(base.profile, x_m=x.tolist(), z_m=z.tolist())
    shown = content(replace_record(base, profile=slot))["profile"]
    deepest = np.array(shown["underside_m"])
    sagitta = base.settings.wheel_radius_m - np.sqrt(base.settings.wheel_radius_m**2 - 0.02**2)
    assert deepest.min() == pytest.approx(-min(4e-4, sagitta), rel=0.03)
    assert 0.01 < shown["bridged_m"] < 0.045
    assert np.all(deepest >= np.array(shown["z_m"]) - 1e-7)
    follows = replace_record(base, profile=slot, settings=replace(base.settings, rolling="none"))
    assert not {"underside_m", "bridged_m"} & content(follows)["profile"].keys()
    assert "follows the rail as it stands" in dict(content(follows)["provenance"])["wheel"]


def test_figures_hold_what_a_passage_and_a_map_say():
    found = content(ground())
    assert {"map", "curves", "history", "profile", "grinding", "provenance"} <= found.keys()
    history, force_map = found["history"], found["map"]
    assert len(history["x_m"]) <= 160
    row = force_map["speeds_kmh"].index(history["speed_kmh"])
    peak_n = force_map["peak_n"][
        row * len(force_map["positions_m"]) + force_map["positions_m"].index(history["position_m"])
    ]
    assert max(history["force_n"]) == pytest.approx(peak_n, rel=2e-3)
    assert {s["name"] for s in found["curves"]["series"]} >= {"peak_force", "dynamic_factor", "unloading"}
    assert dict(found["provenance"])["limits, sha256"] == ground().verdict.limits_sha256


def test_a_line_can_be_read_off_its_path():
    """The path of the force over speed, read back, is the curve: what hovering shows is what was computed."""
    curves = content(ground())["curves"]
    html = section(ground(), english())
    figure = html.partition('aria-label="Peak force over speed')[2].partition("</svg>")[0]
    d, axis = re.search(r'class="force" d="([^"]*)"[^>]*data-y="([^"]*)"', figure).groups()
    steps = np.array([int(v) for v in re.findall(r"-?\d+", d)]).reshape(-1, 2).cumsum(axis=0)
    x_low, x_high, left, right = map(float, re.search(r'data-x="([^"]*)"', figure).group(1).split())
    y_low, y_high, bottom, top = map(float, axis.split())
    speeds = x_low + (steps[:, 0] - left) / (right - left) * (x_high - x_low)
    forces = y_low + (steps[:, 1] - bottom) / (top - bottom) * (y_high - y_low)
    peak = next(s for s in curves["series"] if s["name"] == "peak_force")["values"]
    assert forces == pytest.approx(np.interp(speeds, curves["speeds_kmh"], peak) / 1e3, abs=0.3)


def test_a_part_copes_with_all_that_old_recordings_lack():
    assert content(ancient()).keys() == {"map", "curves", "support", "provenance"}
    assert content(WeldRecord(ancient().verdict)).keys() == {"provenance"}
    assert "ancient" in said(WeldRecord(ancient().verdict))
    assert "Peak force by speed and position" in said(ancient())


def test_the_page_is_the_same_for_the_same_welds():
    assert made(entries()) == made(entries())


def test_text_from_outside_never_becomes_markup():
    """With scripts parts of welds are text; on paper they are elements: neither has one more than of benign welds."""
    benign = [e for e in entries() if not isinstance(e, WeldRecord)] + [weld("weld-1-dip")]
    for to_html in (page, paper):
        names = Counter(tag for tag, _ in elements(to_html(report_of(hostile(), about="a test"))))
        ours = Counter(tag for tag, _ in elements(to_html(report_of([benign[-1], benign[0]], about="a test"))))
        # Its further criterion, one not judged, and another unit on the axis.
        assert set(names - ours) <= {"tr", "th", "td", "span", "strong", "small", "p", "text"}
        assert (names - ours)["tr"] == 1
    html = page(Report(title=HOSTILE, about=HOSTILE))
    assert [tag for tag, _ in elements(html)].count("script") == 2
    assert "<img" not in html
    assert "{{7*7}}" in html


def test_only_the_script_of_the_page_may_run_and_nothing_may_be_asked_of_a_network():
    html = made(entries())
    policy = next(a["content"] for tag, a in elements(html) if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe" not in policy
    assert "connect-src" not in policy
    assert not [a for _, a in elements(html) if str(a.get("src") or a.get("href") or "").startswith(("http", "//"))]
    assert not [a for _, a in elements(html) if "style" in a or any(name.startswith("on") for name in a)]
    assert "connect-src 'self'" in page(Report(), live=True).replace("&#39;", "'")
    assert "<script" not in paper(report_of(entries(), about="a test"))


@pytest.mark.slow
def test_five_hundred_welds_of_the_full_grid_stay_within_budget():
    profile = read_profile(find("weld-4-steep-ramp"))
    simulator, limits = Simulator(simulation_settings()), by_value()
    found = assess(profile, simulator, limits)
    full = WeldRecord(found.verdict, found.force_map, profile, found.history, simulator.settings, limits)
    made = report_of([full], about="a test")
    assert len(made.sections[0].encode()) < WELD_BYTES
    made.sections *= 500
    made.rows = [{**made.rows[0], "n": n} for n in range(1, 501)]
    assert len(page(made).encode()) < FIVE_HUNDRED_BYTES


def test_a_bag_becomes_a_page(capfd, tmp_path):
    out = tmp_path / "report.html"
    code, (line,), _ = run(capfd, "report", str(BAG), "-o", str(out))
    assert code == 0
    assert "report.html, 8 welds, " in line
    verdicts = open_recording(BAG).verdicts
    rows = rows_of(out.read_text())
    assert sorted((r["weld"], r["decision"]) for r in rows) == sorted((v.weld_id, v.decision) for v in verdicts)


def test_a_bag_is_judged_anew_with_limits_of_ones_own(capfd, tmp_path):
    limits, out = tmp_path / "limits.yaml", tmp_path / "report.html"
    limits.write_text(
        "limits:\n- {name: peak_force, limit: 1.0, reject_limit: 2.0, unit: N, source: mine, "
        "verified_by: {by: A. Name, date: 2026-11-28, document: our rules}}\n"
    )
    assert run(capfd, "report", str(BAG), "-o", str(out), "--limits", str(limits))[0] == 0
    assert {r["decision"] for r in rows_of(out.read_text())} == {"reject"}
    assert "Limits not verified" not in out.read_text()


def test_force_maps_alone_become_a_page(capfd, tmp_path):
    maps, out = tmp_path / "maps.jsonl", tmp_path / "report.html"
    lines = [encode(e.force_map).decode() for e in (weld("weld-1-dip"), weld("wheel-flat-0.9mm"))]
    maps.write_text("\n".join(lines) + "\n\n")
    assert run(capfd, "report", str(maps), "-o", str(out), "--limits", str(OF_1_3))[0] == 0
    assert {r["weld"]: r["decision"] for r in rows_of(out.read_text())} == {
        "weld-1-dip": weld("weld-1-dip").verdict.decision,
        "wheel-flat-0.9mm": "reject",
    }


def test_maps_without_verdict_are_judged_and_rejections_stand_last(tmp_path):
    found = weld("weld-1-dip")
    recording = Recording(tmp_path, None)
    recording.force_maps.append(found.force_map)
    recording.histories.append(found.history)
    recording.rejections.append(unusable().rejection)
    judged, refused = weld_records.records_of_recording(recording, None, by_value())
    assert judged.verdict.decision == found.verdict.decision
    assert judged.history is found.history
    assert refused == unusable()


def test_grinding_is_searched_for_what_is_not_accepted_and_known():
    asked, done, failed = [], [], []

    def grind(profile, settings, limits):
        asked.append(profile.weld_id)
        if profile.weld_id == "wheel-flat-0.9mm":
            raise InputError("the grinder reaches no place", "measure more")
        return ground().grinding

    found = list(
        weld_records.with_grinding(
            entries(),
            grind,
            on_done=lambda: done.append(1),
            on_failed=lambda one, error: failed.append((one.verdict.weld_id, str(error))),
        )
    )
    assert len(found) == len(done) == len(entries())
    assert [name for name, _ in failed] == ["wheel-flat-0.9mm"]
    assert len(asked) == 1 + sum(e.grinding is not None for e in found if isinstance(e, WeldRecord))
    assert not any(e.grinding for e in found if isinstance(e, WeldRecord) and e.verdict.decision == "accept")


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (None, "No such file"),
        ("", "holds no force map"),
        ("not json\n", "line 1"),
        ('{"schema_version": "9.0"}\n', "schema version 9.0"),
        ('\n{"schema_version": "1.2"}\n', "line 2"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(capfd, tmp_path, text, part):
    source = tmp_path / "maps.jsonl"
    if text is not None:
        source.write_text(text)
    code, lines, err = run(capfd, "report", str(source), "-o", str(tmp_path / "report.html"))
    assert (code, lines) == (2, [])
    assert err.startswith("weld-force: ")
    assert err.count("\n") == 1
    assert part in err or text is None
    assert not (tmp_path / "report.html").exists()


def test_an_unwritable_place_or_bad_limits_are_one_line(capfd, tmp_path):
    for arguments in (
        ["-o", "/proc/none/r.html"],
        ["-o", str(tmp_path / "r.html"), "--limits", str(tmp_path / "no.yaml")],
    ):
        code, _, err = run(capfd, "report", str(BAG), *arguments)
        assert code == 2
        assert err.count("\n") == 1


def test_without_a_browser_there_is_no_pdf_and_nothing_is_computed(capfd, tmp_path, monkeypatch):
    monkeypatch.setenv(printing.BROWSER_VARIABLE, str(tmp_path / "no-browser"))
    pdf, out = tmp_path / "report.pdf", tmp_path / "report.html"
    code, _, err = run(capfd, "report", str(BAG), "-o", str(out), "--pdf", str(pdf))
    assert code == 2
    assert "no Chromium" in err
    assert err.count("\n") == 1
    assert not out.exists()


def test_a_browser_that_prints_nothing_is_said(tmp_path, monkeypatch):
    browser = tmp_path / "browser"
    browser.write_text("#!/bin/sh\necho cannot open display >&2\nexit 1\n")
    browser.chmod(0o755)
    monkeypatch.setenv(printing.BROWSER_VARIABLE, str(browser))
    with pytest.raises(InputError, match="cannot open display"):
        printing.print_pdf("<p>page</p>", tmp_path / "page.pdf")
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: (_ for _ in ()).throw(subprocess.TimeoutExpired("b", 1)))
    with pytest.raises(InputError, match="took longer"):
        printing.print_pdf("<p>page</p>", tmp_path / "page.pdf")


def test_a_translation_is_a_file(capfd, tmp_path):
    words, out = tmp_path / "xx.json", tmp_path / "report.html"
    words.write_text(json.dumps({"decision": {"accept": "Goed"}, "page": {"language": "nl"}}))
    assert run(capfd, "report", str(BAG), "-o", str(out), "--words", str(words))[0] == 0
    html = out.read_text()
    assert '<html lang="nl">' in html
    assert ">Goed</span>" in html
    assert "Measured on" in html  # what is not translated stays English


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (None, "No such file"),
        ("[]", "Expected `object`"),
        ('{"decision": {"acept": "x"}}', "no word is called decision.acept"),
        ('{"answer": {"of_limit": "van {grens}"}}', "answer.of_limit: cannot be filled in"),
    ],
)
def test_a_bad_translation_is_one_line(capfd, tmp_path, text, part):
    words, out = tmp_path / "xx.json", tmp_path / "report.html"
    if text is not None:
        words.write_text(text)
    code, _, err = run(capfd, "report", str(BAG), "-o", str(out), "--words", str(words))
    assert (code, err.count("\n")) == (2, 1)
    assert part in err
    assert not out.exists()


def keys_of_catalogue() -> str:
    """Every key with the values that its sentence takes."""
    content = json.loads((resources.files("weld_force_ros.data") / "words" / "en.json").read_text())
    lines = [
        f"{section}.{name} {' '.join(sorted({value for _, value, _, _ in Formatter().parse(text) if value}))}".rstrip()
        for section, sentences in content.items()
        for name, text in sentences.items()
    ]
    return "\n".join(lines) + "\n"


def test_the_catalogues_keys_are_those_of_the_snapshot():
    """Translations outside of this repository rely on them: write the file anew, and say so in the changelog."""
    assert keys_of_catalogue() == SNAPSHOT.read_text()


def test_every_word_is_used_and_none_is_missing(monkeypatch):
    package = Path(html_page.__file__).parents[1]
    files = [*package.glob("report/**/*"), *package.glob("campaign/*.py"), package / "assessment" / "criteria.py"]
    code = "".join(f.read_text() for f in files if f.suffix in (".py", ".html", ".js"))
    written = set(re.findall(r"""\b(?:words?|t)\(\s*f?["']([a-z_]+\.[a-z_0-9]+)["']""", code))
    keys = {line.split()[0] for line in SNAPSHOT.read_text().splitlines()}
    assert sorted(key for key in written if key not in keys) == []


def test_a_map_of_one_speed_or_one_position_is_drawn_without_broken_paths():
    base = weld("weld-1-dip").force_map
    cells = ("peak_force_n", "peak_x_m", "min_force_n", "contact_loss_s", "p2_force_n", "force_20hz_n")
    one = {name: getattr(base, name)[:1] for name in (*cells, "speeds_kmh", "positions_m")}
    lone = replace(base, **one, curve=UNSET, spread=UNSET)
    html = section(WeldRecord(judge(lone, by_value()), lone), english())
    paths = re.findall(r'<path[^>]* d="([^"]*)"', html)
    assert len(paths) >= 6
    assert all(re.fullmatch(r"([MLHVlhvmz](-?\d+[ ]?)*)+", path) and not path.endswith("l") for path in paths)
    assert not re.search(r"\bnan\b", html, re.IGNORECASE)


def test_limits_that_could_not_be_applied_are_not_said_to_be_missing():
    base = not_assessed()
    short = replace_record(base, verdict=replace(base.verdict, unjudged=["straightedge_peak"]))
    words = said(short)
    assert "No limit of this kind was chosen" not in words
    assert "The limits that were chosen could not be applied: measure more of the rail on both sides" in words
    assert row(1, short)["advice"].startswith("Measure more of the rail on both sides of the weld")
