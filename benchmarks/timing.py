"""Timings whose ratios can be trusted: what is compared takes turns, so that a busy spell of the machine hits all."""

import statistics
import time
from collections.abc import Callable, Mapping
from typing import Any


def seconds(work: Callable[[], object]) -> float:
    """Return the wall time of one call."""
    began = time.perf_counter()
    work()
    return time.perf_counter() - began


def interleaved(kinds: Mapping[str, Callable[[], object]], repetitions: int) -> dict[str, list[float]]:
    """Return seconds of each kind of work, taken in turn; a first round warms up and is not counted."""
    rounds = [{name: seconds(work) for name, work in kinds.items()} for _ in range(repetitions + 1)][1:]
    return {name: [taken[name] for taken in rounds] for name in kinds}


def figure(name: str, values: list[float]) -> dict[str, Any]:
    """Return median, least and most of repetitions, as entries of the result."""
    return {name: float(statistics.median(values)), f"{name}_spread": [float(min(values)), float(max(values))]}
