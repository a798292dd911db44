"""`weld-force show`: what stands on the terminal, at any width, for any recording."""

import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import pytest
from msgspec import UNSET
from msgspec.structs import replace

from tests.harness.bags import record, rejection
from tests.harness.limits import by_value
from weld_force_ros.assessment.judge import judge
from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.cli import terminal
from weld_force_ros.cli.main import main
from weld_force_ros.messages import (
    TOPICS,
    AssessmentSettings,
    EdgeReading,
    ForceMap,
    Message,
    ProfileMeasures,
    SpeedCurve,
    Verdict,
    decode,
    encode,
)

DEMO = Path(__file__).parents[2] / "bags" / "demo"
HOSTILE = "[bold]km 12[/] \x1b]0;owned\x07\x1b[2J‮evil‬ <b>"
SPEEDS = [20.0, 60.0, 100.0, 140.0]


def force_map(weld_id: str = "KM12", peaks_kn: tuple[float, ...] = (110, 240, 150, 230), **fields) -> ForceMap:
    """A map of one position, with its most force at 60 km/h."""
    peaks = [1e3 * peak for peak in peaks_kn]
    curve = SpeedCurve(
        speeds_kmh=SPEEDS,
        peak_force_n=peaks,
        min_force_n=[60e3] * 4,
        contact_loss_s=[0.0] * 4,
        at_m=[0.3] * 4,
    )
    about = {"curve": curve, "static_load_n": 100e3, **fields}
    return ForceMap(
        weld_id=weld_id,
        profile_sha256="a" * 64,
        config_sha256="b" * 64,
        track="bilbao",
        engine="common-poles",
        speeds_kmh=SPEEDS,
        positions_m=[0.3],
        peak_force_n=peaks,
        peak_x_m=[0.3] * 4,
        min_force_n=[60e3] * 4,
        contact_loss_s=[0.0] * 4,
        span_m=0.6,
        elapsed_s=0.0,
        **about,
    )


def recording(folder: Path, *maps: ForceMap, limits: bool = True, by: AssessmentSettings | None = None) -> Path:
    by = by or by_value()
    messages: list[Message] = [by] if limits else []
    for one in maps:
        messages += [one, judge(one, by)]
    topics = TOPICS
    sent = [(f"/{topics[type(m)].name}", encode(m).decode(), i) for i, m in enumerate(messages)]
    return record(folder, [*sent, ("/rejection", rejection("no units stated"), len(sent))])


def show(capfd: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    code = main(["show", *map(str, arguments)])
    out, err = capfd.readouterr()
    return code, out, err


def test_worst_weld_comes_first_and_with_its_curve(capfd, tmp_path):
    fine = force_map("fine", (101, 102, 103, 104), p2_force_n=[101e3] * 4, force_20hz_n=[101e3] * 4)
    bag = recording(tmp_path / "bag", fine, force_map("mild", (101, 102, 103, 104)), force_map("bad"))
    code, out, err = show(capfd, bag)
    assert (code, err) == (0, "")
    assert out.index("bad") < out.index("mild") < out.index("UNREADABLE") < out.index("fine")
    assert "weld.csv" in out
    assert "peak_force 240 of" in out
    shown = out[out.rindex("peak 240 kN at 60 km/h") :]
    assert "limit" in shown
    assert "static" in shown
    assert "⡠" in shown
    assert "forces are within limits up to 20 km/h" in shown
    assert "* UNVERIFIED" in shown


def test_a_named_weld_stands_alone(capfd, tmp_path):
    bag = recording(tmp_path / "bag", force_map("mild", (101, 102, 103, 104)), force_map("bad"))
    code, out, err = show(capfd, bag, "mild", "--json", "-")
    assert code == 0
    assert [decode(Verdict, line).weld_id for line in out.splitlines()] == ["mild"]
    assert "bad" not in err


def test_restriction_is_judged_as_a_line_of_that_speed(capfd, tmp_path):
    """110 kN at 20 km/h is within all limits; at 60 the force is larger than at 140."""
    bag = recording(tmp_path / "bag", force_map())
    for kmh, decision, change in ((60, "GRIND", "+0 %"), (59, "UNDECIDED", "-54 %")):
        _, out, err = show(capfd, bag, "--restrict", kmh, "--json", "-")
        said = json.loads(out)
        assert said["at_most_kmh"] == kmh
        assert said["recorded"]["peak_force_n"] == 240e3
        assert said["restricted"]["decision"].upper() == decision
        assert f"running at most at {kmh} km/h: {decision}, peak" in err
        assert change in err


@pytest.mark.parametrize(
    ("kmh", "said"),
    [(140, "no change, judged up to 140 km/h"), (10, "not known, nothing was computed below 20 km/h")],
)
def test_restrictions_that_say_nothing(capfd, tmp_path, kmh, said):
    code, out, _ = show(capfd, recording(tmp_path / "bag", force_map()), "--restrict", kmh)
    assert code == 0
    assert said in out


def test_a_recording_without_limits_tells_no_restriction(capfd, tmp_path):
    _, out, _ = show(capfd, recording(tmp_path / "bag", force_map(), limits=False), "--restrict", 80)
    assert "running at most at 80 km/h: not known, its limits not recorded" in out


def test_a_map_of_one_speed_is_a_point(capfd, tmp_path):
    one = replace(
        force_map(),
        speeds_kmh=[80.0],
        curve=UNSET,
        peak_x_m=[0.3],
        **{name: [1e5] for name in ("peak_force_n", "min_force_n", "contact_loss_s")},
    )
    code, out, _ = show(capfd, recording(tmp_path / "bag", replace(one, contact_loss_s=[0.0])))
    assert code == 0
    assert "static" in out


@pytest.mark.parametrize("bag", sorted(DEMO.parent.iterdir()), ids=lambda bag: bag.name)
@pytest.mark.parametrize("arguments", [(), ("weld-4-steep-ramp",), ("--restrict", "80")])
def test_recordings_of_every_version_are_shown(capfd, bag, arguments):
    code, out, err = show(capfd, bag, *arguments)
    assert (code, err) == (0, "")
    assert "weld-4-steep-ramp" in out
    assert "static" in out


def test_hostile_names_neither_style_nor_steer_the_terminal(capfd, tmp_path):
    code, out, _ = show(capfd, recording(tmp_path / "bag", force_map(HOSTILE)))
    assert code == 0
    assert "[bold]km 12[/]" in out
    assert all(c.isprintable() or c == "\n" for c in out)


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("nowhere",), "does not exist"),
        ((DEMO, "weld-9"), "holds no verdict on 'weld-9'; name "),
        ((DEMO, "--restrict", "fast"), "--restrict 'fast' cannot be read; write 80 or 80km/h"),
        ((DEMO, "--restrict", "-5"), "give 1 to 1000 km/h"),
        ((DEMO, "--restrict", "2000"), "give 1 to 1000 km/h"),
    ],
)
def test_bad_input_is_one_line_and_code_2(capfd, arguments, part):
    code, out, err = show(capfd, *arguments)
    assert (code, out) == (2, "")
    assert part in err
    assert err.count("\n") == 1


def on_a_terminal(columns: int, *command: str, **environment: str) -> str:
    main_end, terminal = pty.openpty()
    process = subprocess.Popen(
        command,
        stdout=terminal,
        env={**os.environ, "COLUMNS": str(columns), "TERM": "xterm-256color", **environment},
    )
    os.close(terminal)
    shown = b""
    try:
        while part := os.read(main_end, 4096):
            shown += part
    except OSError:  # the other end was closed
        pass
    os.close(main_end)
    assert process.wait() == 0
    return re.sub(r"\x1b\[[0-9;]*m", "", shown.decode().replace("\r", ""))


def test_80_columns_hold_it_and_names_stay_whole():
    command = (sys.executable, "-m", "weld_force_ros.cli", "show", str(DEMO))
    shown = on_a_terminal(80, *command)
    assert max(map(len, shown.splitlines())) <= 80
    assert "…" not in shown


RULE_BOOKS = load_limits("force,banenor-531")


def answered(folder: Path) -> Path:
    """A recording of verdicts with two answers: one of each decision that a map by hand can have."""
    measures = ProfileMeasures(
        kind="dip", dip_m=1e-3, protrusion_m=0.0, gradient_rad=1e-3, straightedge_m=1e-3, spacing_m=2e-3,
        edges=[EdgeReading(base_m=1.0, peak_m=0.1e-3, dip_m=0.3e-3)],
    )  # fmt: skip
    low_passed = {"p2_force_n": [101e3] * 4, "force_20hz_n": [101e3] * 4, "line_speed_kmh": 140.0, "running": "against"}
    names = {
        "weld-2-rise-between-shrinkages": (101, 102, 103, 104), "KM12": (110, 140, 150, 155),
        "bad": (110, 240, 250, 260),
    }  # fmt: skip
    maps = [force_map(name, peaks, measures=measures, **low_passed) for name, peaks in names.items()]
    maps.append(force_map("unasked", (110, 140, 150, 155), **low_passed))
    return recording(folder, *maps, by=RULE_BOOKS)


def test_verdicts_with_two_answers_show_both_and_why_each_is_not_accepted(capfd, tmp_path):
    code, out, _ = show(capfd, answered(tmp_path / "bag"))
    assert code == 0
    shown = " ".join(out.split())
    assert " REJECT bad grind replace 260 100 % " in shown
    assert "KM12: Geometry grind: dip under a straightedge of 1 m is 1.50 of its limit" in shown
    assert "weld.csv: unreadable. No units stated." in shown
    assert "Force, by model (force): replace. Peak force is 1.73 of its limit" in shown
    assert "Decided at an accepted risk of 5 %." in shown


def test_80_columns_hold_both_answers_and_no_word_breaks(tmp_path):
    bag = answered(tmp_path / "bag")
    shown = on_a_terminal(80, sys.executable, "-m", "weld_force_ros.cli", "show", str(bag), "--restrict", "80")
    assert max(map(len, shown.splitlines())) <= 80
    assert "…" not in shown
    words = set(shown.split())
    assert {"decision", "geometry", "force", "exceeding", "shrinkages", "UNDECIDED", "UNREADABLE", "REJECT"} <= words
    assert {"criterion", "running", "against", "straightedge", "(informative)*", "unloading*"} <= words
    assert "KM12 running at most at 80 km/h" in shown


@pytest.mark.parametrize(
    ("share", "words"), [(0.0, "0 %"), (1e-9, "<1 %"), (0.5, "50 %"), (0.999, ">99 %"), (1.0, "100 %")]
)
def test_a_probability_is_neither_none_nor_all_unless_it_is(share, words):
    assert terminal.percent(share) == words


def test_a_terminal_without_unicode_gets_ascii():
    command = (sys.executable, "-m", "weld_force_ros.cli", "show", str(DEMO))
    shown = on_a_terminal(80, *command, PYTHONIOENCODING="ascii")
    assert shown.isascii()
    assert "\\u" not in shown
    assert "static" in shown


def test_piped_it_has_no_colours():
    command = [sys.executable, "-m", "weld_force_ros.cli", "show", str(DEMO)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "\x1b" not in done.stdout
    assert done.stderr == ""
