"""Studies of the paper's section 6: what they give, on a coarse grid, for the paper's welds and for the user's own."""

import importlib
import math
import re
from collections.abc import Iterator

import msgspec
import numpy as np
import pytest

from weld_force_ros.measurement import profile_file
from weld_force_ros.physics.analysis.spectra import Bands, Spectrum
from weld_force_ros.physics.passage.passage import History
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.studies import claims, passage_records, variants
from weld_force_ros.studies.band_split import BandSplit
from weld_force_ros.studies.study_context import BILBAO, CONTINUOUS, Quantities, StudyContext, StudyResult

pytestmark = pytest.mark.slow

STUDIES = ("length", "hertz", "spectrum", "bands")
UNITS = ("_kmh", "_m", "_n", "_hz", "_m_per_n", "_gn_per_m15")
WITHOUT_UNIT = ("weld",)
OWN = r"km 12/3, $\rail_{"  # neither a file's name nor a formula


@pytest.fixture(scope="module")
def papers() -> dict[str, StudyResult]:
    context = StudyContext(coarse=True)
    return {name: importlib.import_module(f"weld_force_ros.studies.{name}_study").run(context) for name in STUDIES}


@pytest.fixture(scope="module")
def own() -> StudyContext:
    weld = profile_file.read_profile(profile_file.find("weld-4-steep-ramp"))
    return StudyContext(own_weld=msgspec.structs.replace(weld, weld_id=OWN), coarse=True)


@pytest.fixture(scope="module")
def measured(papers: dict[str, StudyResult]) -> Quantities:
    return {key: value for study in papers.values() for key, value in study.measured.items()}


def required(study: str) -> Iterator[str]:
    """The quantities that the claims evaluated by a study need."""
    return (condition.key for claim in claims.load() if claim.study == study for condition in claim.all_criteria)


@pytest.mark.parametrize("name", STUDIES)
def test_every_quantity_that_a_claim_requires_is_there_and_a_plain_number(name, papers):
    found = papers[name].measured
    assert not set(required(name)) - set(found)
    for value in found.values():
        for number in value if isinstance(value, list) else [value]:
            assert type(number) in (float, bool)
            assert not math.isinf(number)


@pytest.mark.parametrize("name", STUDIES)
def test_tables_name_their_units_and_are_filled(name, papers):
    assert papers[name].tables
    for table in papers[name].tables.values():
        assert table.rows
        for column in table.columns:
            assert column.name.endswith(UNITS) or column.name in WITHOUT_UNIT
        assert {len(row) for row in table.rows} == {len(table.columns)}


@pytest.mark.parametrize("name", STUDIES)
def test_figures_have_units_on_their_axes_and_a_caption(name, papers):
    for picture in papers[name].pictures:
        assert picture.caption.endswith(".")
        labels = [label for axes in picture.figure.axes for label in (axes.get_xlabel(), axes.get_ylabel()) if label]
        assert labels
        assert all(re.search(r",\s|relative|half its speed", label) for label in labels)


@pytest.mark.parametrize("name", STUDIES)
def test_an_own_weld_is_shown_and_nothing_is_said_about_the_paper(name, own):
    study = importlib.import_module(f"weld_force_ros.studies.{name}_study").run(own)
    assert study.pictures
    for picture in study.pictures:
        picture.figure.draw_without_rendering()
    assert not study.measured
    welds = {row[0] for table in study.tables.values() if table.columns[0].name == "weld" for row in table.rows}
    assert welds
    assert all(str(weld).startswith(OWN) for weld in welds)


# Figures of the paper, section 6.1, to what a speed grid of 3 km/h resolves.
@pytest.mark.parametrize(
    ("key", "papers_value"),
    [
        ("length.first_maximum_48mm_kmh", 53.0),
        ("length.first_maximum_96mm_kmh", 107.0),
        ("length.first_kink_48mm_kmh", 74.0),
        ("length.first_kink_96mm_kmh", 151.0),
    ],
)
def test_the_papers_figures_come_out(key, papers_value, measured):
    assert measured[key] == pytest.approx(papers_value, rel=0.04)


def test_a_stiffer_contact_gives_more_force_and_over_a_rise_both_bands_add_up(measured):
    assert measured["hertz.change_of_static"] > 0
    assert all(part > 0 for part in measured["bands.inverted_parts_at_peak_n"])
    assert measured["bands.high_at_low_maximum_80kmh_n"] < 0


def test_an_own_welds_variants_are_its_profile_stretched_and_upside_down(own):
    x_m, z_m = np.array(own.own_weld.x_m), np.array(own.own_weld.z_m)
    itself, longer = variants.by_length(own)
    _, inverse = variants.by_sign(own)
    radius_m = own.track(CONTINUOUS).wheel.radius_m
    at = np.linspace(-0.9, 0.9, 301)
    for variant, expected in (
        (itself, wheel_path_over(x_m, z_m, radius_m)),
        (longer, wheel_path_over(2 * x_m, z_m, radius_m)),
        (inverse, wheel_path_over(x_m, -z_m, radius_m)),
    ):
        assert variant.wheel_path.at(at) == pytest.approx(expected.at(at), abs=1e-9)


@pytest.mark.parametrize("track", [CONTINUOUS, BILBAO])
def test_a_record_rests_on_either_side_of_the_weld(track):
    context = StudyContext()
    vehicle_track = context.vehicle_track(track)
    passage = passage_records.record(vehicle_track, variants.by_sign(context)[0].wheel_path, 200.0)
    assert passage.x_m[0] <= -passage_records.MARGIN_M
    assert passage.x_m[-1] >= passage_records.MARGIN_M
    ends = passage.force_n[np.abs(passage.x_m) > 0.9 * passage_records.MARGIN_M]
    assert ends == pytest.approx(vehicle_track.wheel.static_load_n, rel=1e-5)


def test_spectral_peaks_of_a_spectrum_by_hand():
    frequency = np.arange(10.0, 1000.0)
    hills = [(60.0, 1.0), (240.0, 5.0), (700.0, 2.0)]
    amplitude = sum(height * np.exp(-(((frequency - at) / 20) ** 2)) for at, height in hills)
    spectrum = Spectrum(frequency, 30.0 / frequency, amplitude)
    assert passage_records.strongest_hz(spectrum, 300, 900) == pytest.approx(700, abs=0.1)
    assert passage_records.first_two_hz(passage_records.peaks_between(spectrum, 0, 530)) == pytest.approx(
        (60, 240), abs=0.1
    )
    assert passage_records.first_two_hz(passage_records.peaks_between(spectrum, 100, 530))[0] == pytest.approx(
        240, abs=0.1
    )
    assert math.isnan(passage_records.first_two_hz(passage_records.peaks_between(spectrum, 100, 530))[1])
    assert math.isnan(passage_records.strongest_hz(spectrum, 400, 600))


def test_an_exponent_is_the_power_of_speed_and_missing_if_a_value_is():
    speeds = [50.0, 80.0, 200.0]
    assert passage_records.exponent(speeds, [3 * v**1.5 for v in speeds]) == pytest.approx(1.5)
    assert math.isnan(passage_records.exponent(speeds, [1.0, math.nan, 2.0]))


def test_the_leading_peaks_place_is_that_of_the_nearest_speed():
    places = np.array([[0.01], [0.02], [0.03]])
    peak_map = PeakMap(places, places, places, places)
    assert passage_records.peak_location_at(np.array([20.0, 30.0, 40.0]), peak_map, 32.0) == 0.02
    assert math.isnan(passage_records.peak_location_at(np.array([20.0, 30.0, 40.0]), peak_map, math.nan))


def test_a_split_force_by_hand():
    """A slow half wave of 10 kN, 0.2 m long, and on it a fast one of 4 kN, downwards at the slow one's summit."""
    x = np.arange(-1.0, 1.0, 0.25e-3)
    low = np.where(np.abs(x) < 0.15, 10e3 * np.cos(np.pi * x / 0.2), 0.0)
    high = np.where(np.abs(x) < 0.03, -4e3 * np.cos(np.pi * x / 0.02), 0.0)
    passage = History(x, 100e3 + low + high, x, x, x)
    split = BandSplit(80.0, passage, Bands(x, 100e3 + low, high, 80.0), 100e3)
    assert split.low_peak_m == pytest.approx(0.0, abs=1e-6)
    assert split.low_width_m == pytest.approx(0.2, abs=1e-5)
    assert split.high_share == pytest.approx(0.4)
    assert abs(split.high_peak_m) == pytest.approx(0.02, abs=1e-6)
    at_summit = 10e3 * math.cos(math.pi * 0.1)
    assert split.at_peak_n == pytest.approx([at_summit, 4e3], rel=5e-3)
