"""Common poles against the reference on every bundled track that has no loss factor."""

import pytest

from benchmarks.tracks import accuracy
from weld_force_ros.simulation import track_file

CAUSAL = [name for name in track_file.shipped() if track_file.load(name).track.causal]


@pytest.mark.slow
@pytest.mark.parametrize("name", CAUSAL)
def test_peaks_by_common_poles_are_those_of_the_reference(name: str):
    """Bounds of the issue; `python -m benchmarks.tracks` has five speeds, here are the slowest one and a fast one."""
    found = accuracy(name, (30.0, 220.0))
    assert found.rms < 0.5
    assert found.largest < 1.5
