"""What passages of a batch have in common with those that they are simulated beside: nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.passage import batch
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.simulation import fit_store, track_file


@given(st.sets(st.tuples(st.integers(0, 40), st.integers(0, 6)), min_size=1, max_size=80))
def test_every_passage_is_in_an_octet_of_its_place(passages):
    speeds, places = np.array(sorted(passages)).T
    octets = batch._octets(speeds, places)
    assert set(octets.ravel().tolist()) == set(range(len(speeds)))
    assert (places[octets] == places[octets[:, :1]]).all()
    assert len(octets) == sum(-(-count // 8) for count in np.bincount(places).tolist())
    assert (np.diff(speeds[octets][:, -1]) >= 0).all()


@pytest.mark.parametrize("name", ["bilbao-causal", "johansson-nielsen"])
def test_any_passages_of_a_map_are_those_of_the_whole_map(name):
    definition = track_file.load(name)
    model = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel, threads=2)
    x = np.linspace(-0.15, 0.15, 201)
    path = wheel_path_over(x, cosine_dip(x, 0.3, 0.6e-3), 0.45)
    speeds, positions = np.arange(40.0, 300.0, 9.0), np.arange(7) * 0.09
    whole = model.peak_map(path, speeds, positions, low_passed=True)
    selected = np.random.default_rng(3).random((len(speeds), len(positions))) < 0.2
    some = model.peak_map(path, speeds, positions, low_passed=True, selected=selected)
    for column in ("peak_force_n", "peak_x_m", "min_force_n", "contact_loss_s"):
        np.testing.assert_array_equal(getattr(some, column)[selected], getattr(whole, column)[selected])
        assert np.isnan(getattr(some, column)[~selected]).all()
    np.testing.assert_array_equal(some.low_passed_n[:, selected], whole.low_passed_n[:, selected])
