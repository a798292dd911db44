"""Tracks, wheels and shapes that the core's tests share."""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor

# Fits are many small least squares: a second BLAS thread makes them up to twenty times slower on a busy machine.
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import numpy as np
import pytest
from hypothesis import settings

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics import threads
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.simulation.track_file import TrackDefinition

# A shared machine's pauses are no property of the code.
settings.register_profile("core", deadline=None, max_examples=40)
settings.load_profile("core")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--long", action="store_true", help="also run what is marked long")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what is marked long, unless it is asked for."""
    if not config.getoption("--long"):
        left_out = [item for item in items if any(item.iter_markers("long"))]
        config.hook.pytest_deselected(items=left_out)
        items[:] = [item for item in items if item not in left_out]


def pytest_runtest_setup() -> None:
    """Let tables be as wide as in a file, wherever tests run and whatever a library makes of the terminal."""
    os.environ["COLUMNS"] = "120"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Trace single fast tests only, for coverage: it doubles the time of slow and property tests, for few more lines.

    The fixtures that such a test is the first to need are not traced either. A test marked `untraced` is fast, and slow
    if it is traced.
    """
    coverage = item.config.pluginmanager.getplugin("_cov")
    tracer = coverage.cov_controller if coverage else None
    is_property = getattr(getattr(item, "obj", None), "is_hypothesis_test", False)
    if tracer is None or not (is_property or any(item.iter_markers("slow")) or any(item.iter_markers("untraced"))):
        return (yield)
    tracer.pause()
    try:
        return (yield)
    finally:
        tracer.resume()


@pytest.fixture(scope="session")
def definitions() -> dict[str, TrackDefinition]:
    return {name: track_file.load(name) for name in track_file.shipped()}


@pytest.fixture(scope="session")
def vehicle_tracks(definitions: dict[str, TrackDefinition]) -> dict[str, VehicleTrackModel]:
    return {name: VehicleTrackModel(fit_store.fitted(d).model(), d.wheel) for name, d in definitions.items()}


@pytest.fixture(scope="session")
def smooth_rail() -> WheelPath:
    return WheelPath(0.0, np.zeros(9))


@pytest.fixture(scope="session")
def dip() -> Callable[..., WheelPath]:
    """WheelPath of a wheel of 0.45 m radius over a cosine dip; a negative depth makes it a rise."""

    def over(length_m: float, depth_m: float) -> WheelPath:
        x = np.linspace(-length_m / 2, length_m / 2, round(length_m / 0.5e-3) + 1)
        return wheel_path_over(x, cosine_dip(x, length_m, depth_m), 0.45)

    return over


@pytest.fixture
def workers_of_pools(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The number of threads of each pool that physics makes, as they are made."""
    workers: list[int] = []
    pool = threads.ThreadPoolExecutor

    def noted(count: int, *, thread_name_prefix: str) -> ThreadPoolExecutor:
        workers.append(count)
        return pool(count, thread_name_prefix)

    monkeypatch.setattr(threads, "ThreadPoolExecutor", noted)
    return workers
