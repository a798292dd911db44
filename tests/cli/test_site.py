"""`weld-force init` and `--site`: what a site states once, every command uses."""

import json
from pathlib import Path

import pytest

from weld_force_ros.assessment.rule_books import load_limits
from weld_force_ros.cli.main import main
from weld_force_ros.cli.site import read_site
from weld_force_ros.errors import InputError
from weld_force_ros.measurement import instruments
from weld_force_ros.simulation import vehicle_file

QUICK = ("--track", "bilbao-viscous", "--speeds", "80,160", "--positions", "2", "--uncertainty-samples", "0")


@pytest.fixture
def site(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> Path:
    assert main(["init", str(tmp_path / "site")]) == 0
    capfd.readouterr()
    return tmp_path / "site" / "site.yaml"


def assessed(capfd: pytest.CaptureFixture[str], *options: object) -> dict:
    main(["assess", "weld-5-ramp-protrusion", *QUICK, *map(str, options), "--json", "-"])
    return json.loads(capfd.readouterr().out)


def test_what_is_written_can_be_used_as_it_is(site: Path):
    limits, bundled = load_limits(site.parent / "limits.yaml"), load_limits("force")
    assert [limit.limit for limit in limits.limits] == [limit.limit for limit in bundled.limits]
    assert vehicle_file.load(str(site.parent / "vehicle.yaml")).static_load_n == 54.5e3
    assert instruments.load(str(site.parent / "instrument.yaml")).z_unit == "0.01mm"
    assert read_site(site) == {
        "limits": str(site.parent / "limits.yaml"),
        "vehicle": [str(site.parent / "vehicle.yaml")],
    }


def test_assess_uses_it_and_options_go_before(site: Path, capfd: pytest.CaptureFixture[str]):
    site.write_text(site.read_text().replace("# line_speed_kmh: 160", "line_speed_kmh: 160"))
    by_site = assessed(capfd, "--site", site)
    assert (by_site["vehicle"], by_site["judged_speed_kmh"], by_site["static_load_n"]) == ("vehicle", 160, 54.5e3)
    assert by_site["force"]["rule_books"] == ["limits"]
    by_option = assessed(capfd, "--site", site, "--line-speed", "100km/h", "--limits", "force")
    assert (by_option["judged_speed_kmh"], by_option["force"]["rule_books"]) == (80, ["force"])


def test_every_commented_line_is_a_setting(site: Path):
    text = "".join(
        line.removeprefix("# ")
        for line in site.read_text().splitlines(keepends=True)
        if line.removeprefix("# ").partition(":")[0]
        in ("track", "running", "line_speed_kmh", "format", "limits", "vehicle")
    )
    site.write_text(text)
    assert set(read_site(site)) == {"track", "running", "line_speed_kmh", "format", "limits", "vehicle"}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("line_sped_kmh: 160", "'line_sped_kmh' is no setting of a site; write line_speed_kmh"),
        ("colour: red", "'colour' is no setting of a site; use limits, vehicle, track"),
        ("line_speed_kmh: fast", "Expected `float | null`, got `str` - at `$.line_speed_kmh`"),
        ("- limits", "Expected `object`, got `array`"),
    ],
)
def test_what_is_wrong_in_it_is_one_line(text: str, complaint: str, tmp_path: Path):
    (tmp_path / "site.yaml").write_text(text)
    with pytest.raises(InputError) as refused:
        read_site(tmp_path / "site.yaml")
    assert complaint in str(refused.value)
    assert "\n" not in str(refused.value)


def test_nothing_is_written_over(site: Path, capfd: pytest.CaptureFixture[str]):
    before = site.read_text()
    assert main(["init", str(site.parent)]) == 2
    assert "is there already" in capfd.readouterr().err
    assert site.read_text() == before
