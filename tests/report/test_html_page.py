"""The report without a browser: what goes into the page, and what may not."""

import base64
import gzip
import json
import re
import subprocess
from dataclasses import replace as replace_record
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
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
from weld_force_ros.assessment.criteria import CRITERIA, WORDS
from weld_force_ros.assessment.judge import assess
from weld_force_ros.cli.main import main
from weld_force_ros.errors import InputError
from weld_force_ros.measurement.profile_file import find, read_profile
from weld_force_ros.messages import UncertaintyResult, encode
from weld_force_ros.recording import weld_records
from weld_force_ros.recording.recording import Recording, open_recording
from weld_force_ros.recording.weld_records import Record, WeldRecord
from weld_force_ros.report import html_page
from weld_force_ros.report import pdf as printing
from weld_force_ros.report.html_page import page
from weld_force_ros.report.table_row import row
from weld_force_ros.report.weld_detail import detail
from weld_force_ros.simulation.settings import simulation_settings
from weld_force_ros.simulation.simulator import Simulator

BAG = Path(__file__).parents[2] / "bags" / "demo"
FIVE_HUNDRED_BYTES = 15_000_000
WELD_BYTES = 25_000


def run(capfd: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, list[str], str]:
    code = main(list(arguments))
    out, err = capfd.readouterr()
    return code, out.splitlines(), err


def made(of: list[Record]) -> str:
    return page([row(n, e) for n, e in enumerate(of, 1)], [detail(e) for e in of], title="Rail welds", about="a test")


def content(entry: Record) -> dict:
    return json.loads(gzip.decompress(detail(entry)))


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
    assert shown["unverified"] == shown["criteria"] == len(judged.verdict.criteria)


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
    assert (basis["track"], basis["unsprung_kg"], basis["measured_on"]) == ("bilbao", 600.0, "2026-11-20")


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


def test_details_of_two_answers_name_criterion_and_authority():
    found = content(answered())
    geometry, force = found["verdict"]["geometry"], found["verdict"]["force"]
    assert (geometry["nearest"]["name"], geometry["nearest"]["base_m"]) == ("straightedge_peak", 1.0)
    assert geometry["verified"]
    assert geometry["nearest"]["source_kind"] == "standard"
    assert (force["nearest"]["source_kind"], force["doubts"]) == ("judgement", [])
    assert found["basis"] == row(1, answered())["basis"]
    assert "peak_force" not in found["verdict"]["reason"]
    about = dict(found["provenance"])
    assert about["limits"] == "force (0 of 6 numbers verified), banenor-531 (3 of 3 numbers verified)"
    assert about["rules"].startswith("accepted risk 5%; ")
    assert "UNVERIFIED" not in str(about)
    unasked = content(not_assessed())["verdict"]["geometry"]
    assert "nearest" not in unasked
    assert "weld-force limits list" in unasked["to_choose"]


def test_what_stands_in_the_way_of_accepting_is_told_apart():
    base = weld("weld-4-steep-ramp", rule_books="force")
    assert content(base)["verdict"]["force"]["doubts"][0].startswith(
        "the line's speed is not stated: forces are within"
    )
    short = weld("cosine-dip-48mm", line_speed_kmh=310.0, rule_books="force")
    assert content(short)["verdict"]["force"]["doubts"][0].startswith("forces hold up to 300 km/h")


def test_limits_are_drawn_at_what_they_come_to():
    series = {s["name"]: s for s in content(answered())["curves"]["series"]}
    assert [(one["limit"], one["reject_limit"]) for one in series["peak_force"]["limits"]] == [(150e3, 200e3)]
    speeds = content(answered())["curves"]["speeds_kmh"]
    permitted = answered().verdict.permitted_speed_kmh
    within = [speed for i, speed in enumerate(speeds) if all(s["within"][i] == "1" for s in series.values())]
    assert max(within) == permitted


def test_no_local_minimum_below_the_models_error_is_outlined():
    cells = {books: content(weld("weld-1-dip", rule_books=books))["map"]["hollow"] for books in (None, "force")}
    assert cells[None].count("1") > cells["force"].count("1")
    assert content(answered())["curves"]["error_share"] > 0.1
    assert "error_share" not in content(weld("weld-1-dip"))["curves"]


def test_older_verdicts_have_neither_answers_nor_their_basis():
    assert not {"geometry", "force", "basis"} & row(1, undecided()).keys()
    found = content(undecided())
    assert "basis" not in found
    assert not {"geometry", "force"} & found["verdict"].keys()


def test_the_page_has_words_for_every_criterion():
    words = (Path(html_page.__file__).parent / "assets" / "words.js").read_text()
    assert [name for name in CRITERIA if f"  {name}: " not in words] == []
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


def test_details_hold_what_a_section_shows():
    found = content(ground())
    assert {"verdict", "map", "curves", "history", "profile", "grinding", "provenance"} <= found.keys()
    assert len(found["history"]["x_m"]) <= 400
    history, verdict, force_map = found["history"], found["verdict"], found["map"]
    deciding = max(
        [c for c in verdict["criteria"] if c["decides"]],
        key=lambda c: float("inf") if c["ratio"] is None else c["ratio"],
    )
    assert (history["speed_kmh"], history["position_m"]) == (deciding["speed_kmh"], deciding["position_m"])
    row = force_map["speeds_kmh"].index(history["speed_kmh"])
    peak_n = force_map["peak_n"][
        row * len(force_map["positions_m"]) + force_map["positions_m"].index(history["position_m"])
    ]
    assert max(history["force_n"]) == pytest.approx(peak_n, rel=2e-3)
    assert {s["name"] for s in found["curves"]["series"]} >= {"peak_force", "dynamic_factor", "unloading"}
    assert dict(found["provenance"])["limits, sha256"] == ground().verdict.limits_sha256


def test_within_limits_over_speed_is_what_the_verdict_says():
    judged = weld("wheel-flat-0.9mm")
    curves = content(judged)["curves"]
    for restriction in judged.verdict.restrictions:
        at = curves["speeds_kmh"].index(restriction.speed_kmh)
        assert all(s["within"][at] == "1" for s in curves["series"]) == restriction.within_limits


def test_details_cope_with_all_that_old_recordings_lack():
    found = content(ancient())
    assert found.keys() == {"verdict", "map", "curves", "support", "provenance"}
    assert content(WeldRecord(ancient().verdict)).keys() == {"verdict", "provenance"}


def test_the_page_is_the_same_for_the_same_welds():
    assert made(entries()) == made(entries())


def test_text_from_outside_never_becomes_markup():
    benign = [e for e in entries() if not isinstance(e, WeldRecord)] + [weld("weld-1-dip")]
    names = [tag for tag, _ in elements(made(hostile()))]
    assert "img" not in names
    assert names == [tag for tag, _ in elements(made([benign[-1], benign[0]]))]
    html = page([], [], title=HOSTILE, about=HOSTILE)
    assert [tag for tag, _ in elements(html)].count("script") == 4
    assert "<img" not in html


def test_only_the_scripts_of_the_page_may_run_and_nothing_may_be_asked_of_a_network():
    html = made(entries())
    policy = next(a["content"] for tag, a in elements(html) if a.get("http-equiv") == "Content-Security-Policy")
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "unsafe-inline" not in policy.partition("style-src")[0]
    assert "unsafe-eval" not in policy
    assert "connect-src" not in policy
    assert not [a for _, a in elements(html) if str(a.get("src") or a.get("href") or "").startswith(("http", "//"))]
    assert "connect-src 'self'" in page([], [], title="t", live=True).replace("&#39;", "'")


def test_plotly_is_packed_and_whole():
    from plotly.offline import get_plotlyjs

    packed = made([]).partition('id="plotly">')[2].partition("<")[0]
    assert gzip.decompress(base64.b64decode(packed)).decode() == get_plotlyjs()


@pytest.mark.slow
def test_five_hundred_welds_of_the_full_grid_stay_within_budget():
    profile = read_profile(find("weld-4-steep-ramp"))
    simulator, limits = Simulator(simulation_settings()), by_value()
    found = assess(profile, simulator, limits)
    full = WeldRecord(found.verdict, found.force_map, profile, found.history, simulator.settings, limits)
    packed = detail(full)  # takes long: packed once for all
    assert len(base64.b64encode(packed)) < WELD_BYTES
    html = page([row(n, full) for n in range(1, 501)], [packed] * 500, title="Rail welds")
    assert len(html.encode()) < FIVE_HUNDRED_BYTES


def test_a_bag_becomes_a_page(capfd, tmp_path):
    out = tmp_path / "report.html"
    code, (line,), _ = run(capfd, "report", str(BAG), "-o", str(out))
    assert code == 0
    assert "report.html, 8 welds, " in line
    verdicts = open_recording(BAG).verdicts
    rows = json.loads(re.search(r'id="rows">(.*?)</script>', out.read_text()).group(1))
    assert [(r["weld"], r["decision"]) for r in rows] == [(v.weld_id, v.decision) for v in verdicts]


def test_a_bag_is_judged_anew_with_limits_of_ones_own(capfd, tmp_path):
    limits, out = tmp_path / "limits.yaml", tmp_path / "report.html"
    limits.write_text(
        "limits:\n- {name: peak_force, limit: 1.0, reject_limit: 2.0, unit: N, source: mine, "
        "verified_by: {by: A. Name, date: 2026-11-28, document: our rules}}\n"
    )
    assert run(capfd, "report", str(BAG), "-o", str(out), "--limits", str(limits))[0] == 0
    rows = json.loads(re.search(r'id="rows">(.*?)</script>', out.read_text()).group(1))
    assert {r["decision"] for r in rows} == {"reject"}
    assert {r["unverified"] for r in rows} == {0}


def test_force_maps_alone_become_a_page(capfd, tmp_path):
    maps, out = tmp_path / "maps.jsonl", tmp_path / "report.html"
    lines = [encode(e.force_map).decode() for e in (weld("weld-1-dip"), weld("wheel-flat-0.9mm"))]
    maps.write_text("\n".join(lines) + "\n\n")
    assert run(capfd, "report", str(maps), "-o", str(out), "--limits", str(OF_1_3))[0] == 0
    rows = json.loads(re.search(r'id="rows">(.*?)</script>', out.read_text()).group(1))
    assert [(r["weld"], r["decision"]) for r in rows] == [
        ("weld-1-dip", weld("weld-1-dip").verdict.decision),
        ("wheel-flat-0.9mm", "reject"),
    ]


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
        printing.print_pdf(tmp_path / "page.html", tmp_path / "page.pdf")
    monkeypatch.setattr(subprocess, "run", lambda *a, **k: (_ for _ in ()).throw(subprocess.TimeoutExpired("b", 1)))
    with pytest.raises(InputError, match="took longer"):
        printing.print_pdf(tmp_path / "page.html", tmp_path / "page.pdf")
