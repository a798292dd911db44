"""How fast and how exact, measured on this machine: each module measures one thing, `run` all of them."""

from collections.abc import Callable
from functools import partial
from typing import Any

from benchmarks import arithmetic, engines, growth, nodes, solver, starts

QUICK_SUSTAINED_S = 10.0
SUSTAINED_S = 60.0


def run(
    *, repetitions: int = 3, quick: bool = False, on_step: Callable[[str], None] = lambda _: None
) -> dict[str, Any]:
    """Measure everything; keys name what they hold, with units, and `_spread` the least and most of repetitions.

    Args:
        repetitions: of each timing; what is compared takes turns.
        quick: without what takes minutes: every passage's accuracy, fresh processes, growth, and a minute of welds.
        on_step: told what is measured next.
    """
    measurements: dict[str, Callable[[], dict[str, Any]]] = {
        "the study against solve_ivp": partial(solver.speed_against_solver, repetitions),
        "other engines": partial(engines.engines, repetitions),
        "threads": partial(engines.threads, 4 * repetitions),
        "operations of a step": partial(arithmetic.arithmetic, 4 * repetitions),
        "files through the nodes": nodes.latencies,
        "welds at a steady rate": partial(nodes.sustained, QUICK_SUSTAINED_S if quick else SUSTAINED_S),
    }
    if not quick:
        measurements |= {
            "accuracy of every passage": solver.accuracy,
            "500 to 50,000 passages": partial(growth.growth, repetitions),
            "fresh processes": partial(starts.starts, repetitions),
        }
    found: dict[str, Any] = {}
    for name, measure in measurements.items():
        on_step(name)
        found |= measure()
    return found
