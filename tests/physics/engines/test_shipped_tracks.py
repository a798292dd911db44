"""Common poles against the reference on bundled tracks that have no loss factor."""

import pytest

from benchmarks.tracks import accuracy


# The one nearest to its bounds; `python -m benchmarks.tracks` has all.
@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("name", ["under-sleeper-pads"])
def test_peaks_by_common_poles_are_those_of_the_reference(name: str):
    """Bounds of the issue; `python -m benchmarks.tracks` has five speeds, here are the slowest one and a fast one."""
    found = accuracy(name, (30.0, 220.0))
    assert found.rms < 0.5
    assert found.largest < 1.5
