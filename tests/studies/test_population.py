"""Studies of the wheel flats and of the synthetic population, on coarse grids."""

import os

# A second BLAS thread slows small factorisations down on a busy machine.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import pytest

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.messages import WeldProfile, profile_sha256
from weld_force_ros.studies import population_study, validation_study
from weld_force_ros.studies.simulated_population import (
    CurveShape,
    InvertedDips,
    count_falling,
    curve_shape,
    ratios_by_frequency,
)
from weld_force_ros.studies.study_context import StudyContext, StudyResult

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def flats() -> StudyResult:
    return validation_study.run(StudyContext(coarse=True))


@pytest.fixture(scope="module")
def welds() -> StudyResult:
    return population_study.run(StudyContext(coarse=True))


@pytest.fixture(scope="module")
def own() -> StudyContext:
    x = np.linspace(-0.5, 0.5, 501)
    z = cosine_dip(x, 0.3, 0.2e-3)
    profile = WeldProfile(
        weld_id="own", source="test", x_m=x.tolist(), z_m=z.tolist(), profile_sha256=profile_sha256(x, z)
    )
    return StudyContext(own_weld=profile, coarse=True)


def column(found: StudyResult, table: str, name: str) -> list:
    names = [c.name for c in found.tables[table].columns]
    return [row[names.index(name)] for row in found.tables[table].rows]


def test_flats_measure_what_the_claims_ask_for(flats: StudyResult):
    assert set(flats.measured) == {
        "validation.first_maximum_kmh",
        "validation.minimum_kmh",
        "validation.fall_n",
        "validation.rise_after_minimum_n",
        "validation.first_maximum_shift_longer_kmh",
    }
    maximum, minimum = flats.measured["validation.first_maximum_kmh"], flats.measured["validation.minimum_kmh"]
    assert 10 < maximum < minimum < 300


def test_measured_extrema_stand_in_the_envelope(flats: StudyResult):
    speeds, forces = (np.array(column(flats, "envelope", name)) for name in ("speed_kmh", "peak_force_n"))
    grid = np.unique(speeds)
    upper = np.array([forces[speeds == speed].max() for speed in grid])
    step_kmh = grid[1] - grid[0]
    first = next(i for i in range(1, len(upper) - 1) if upper[i - 1] < upper[i] > upper[i + 1])
    lowest = first + int(np.argmin(upper[first:]))
    assert flats.measured["validation.first_maximum_kmh"] == pytest.approx(grid[first], abs=step_kmh)
    assert flats.measured["validation.minimum_kmh"] == pytest.approx(grid[lowest], abs=step_kmh)
    assert flats.measured["validation.fall_n"] == pytest.approx(upper[first] - upper[lowest], rel=0.2)


def test_a_deeper_flat_gives_more_force(flats: StudyResult):
    one, two = (np.array(column(flats, "deeper", f"upper_n_wheel-flat-{depth}mm")) for depth in (1, 2))
    assert np.all(two > one)


def test_population_measures_what_the_claims_ask_for(welds: StudyResult):
    assert set(welds.measured) == {
        f"population.{name}"
        for name in (
            "non_monotonic_share_dips", "non_monotonic_share_protrusions", "linearity_dips", "linearity_protrusions",
            "dip_below_protrusion_share", "parametric_dominates_share_smooth",
        )
    }  # fmt: skip
    assert all(0 <= value <= 1 for value in welds.measured.values())


def test_counts_add_up_and_are_those_of_the_welds(welds: StudyResult):
    counts = {(row[0], row[1]): row[2:5] for row in welds.tables["classes"].rows}
    thirds = ("smoothest third", "middle third", "roughest third")
    for kind in ("dip", "protrusion"):
        curves, monotonic, falling = counts[kind, "all"]
        assert curves == monotonic + falling == sum(counts[kind, third][0] for third in thirds)
        of_kind = [m for k, m in zip(column(welds, "welds", "class"), column(welds, "welds", "monotonic"), strict=True)
                   if k == kind]  # fmt: skip
        assert (len(of_kind), sum(of_kind)) == (curves, monotonic)
        share = welds.measured[f"population.non_monotonic_share_{kind}s"]
        assert share == pytest.approx(falling / curves)
    assert counts["both", "all"][0] == 2 * population_study.COARSE_COUNT


def test_the_class_is_the_geometrys_not_the_makers(welds: StudyResult):
    depth, height = (np.array(column(welds, "welds", name)) for name in ("dip_m", "protrusion_m"))
    said = np.array(column(welds, "welds", "class")) == "protrusion"
    np.testing.assert_array_equal(said, height > 2 * depth)


def test_at_least_five_hundred_welds():
    assert population_study.COUNT >= 500


def test_a_fall_is_relative_to_the_curves_range():
    speeds = np.linspace(20, 300, 29)
    rise = np.where(speeds <= 200, 100e3 + 1e3 * (speeds - 20), 280e3 - 0.5e3 * (speeds - 200))
    found = curve_shape(speeds, rise)
    assert not found.monotonic
    assert found.fall == pytest.approx(50 / 180, rel=0.01)
    level = curve_shape(speeds, 100e3 + 1e3 * speeds)
    assert level == CurveShape(True, 0.0, pytest.approx(1.0))
    assert count_falling([found, level, found]) == 2


def test_ratios_are_those_of_the_frequency_and_of_true_inversions():
    frequency = np.linspace(10, 500, 100).reshape(4, 25)
    rise = np.ones((4, 25, 2))
    dip = frequency[..., None] * rise / 100
    dip[0] = 1e6  # not a protrusion upside down: not counted
    centres, (low, median, high) = ratios_by_frequency(
        InvertedDips(dip, rise, np.array([False, True, True, True]), frequency)
    )
    np.testing.assert_allclose(median, centres / 100, rtol=1e-6)
    assert np.all((low <= median) & (median <= high))


def test_an_own_weld_is_shown_and_the_paper_is_not_judged(own: StudyContext):
    for study in (validation_study, population_study):
        found = study.run(own)
        assert found.measured == {}
        assert found.pictures
    flats = validation_study.run(own)
    assert "own" in flats.pictures[0].title
    assert "deeper" not in flats.tables
