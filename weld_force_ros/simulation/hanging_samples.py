"""Let sleepers beside the weld hang in some samples of what is uncertain.

Each of the two hangs by itself with the share of sleepers that do. What that does is simulated once for each of the
three ways, over the nominal geometry; a sample's forces are multiplied by the ratio found at its position, and what can
be zero is moved by the difference.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace as changed
from numpy.typing import NDArray

from weld_force_ros.messages import HANGING_SHARE, SupportState, Uncertainty, UncertaintyResult, known
from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.simulation.force_map_view import Passages

_SLEEPERS = (0, 1)
_OWN_SEED = 1  # beside that of the other quantities, whose samples stay as they are
_FORCE_DECIMALS, _TIME_DECIMALS = 1, 6


def drawn(unknown: Uncertainty) -> NDArray[np.int64]:
    """Return which sleepers hang in each sample, (n_sample,): 1 for the one before the weld, plus 2 for the next."""
    share = known(unknown.hanging_share) or 0.0
    chance = np.random.default_rng([unknown.seed, _OWN_SEED]).random((unknown.samples, len(_SLEEPERS)))
    return np.asarray((chance < share) @ np.array([1, 2]))


def states(which: int) -> tuple[SupportState, ...]:
    """Return the supports of a way of hanging, as of `drawn`."""
    return tuple(SupportState(sleeper=sleeper, share=HANGING_SHARE) for sleeper in _SLEEPERS if which >> sleeper & 1)


def hung(
    spread: UncertaintyResult, which: NDArray[np.int64], usual: Passages, hanging: Mapping[int, Passages]
) -> UncertaintyResult:
    """Return samples in which sleepers hang.

    Args:
        spread: with all sleepers at rest.
        which: (n_sample,), as of `drawn`.
        usual: the worst of the nominal geometry, (n_position,), with all sleepers at rest.
        hanging: the same for each way that was drawn.
    """
    columns: dict[str, Any] = {}
    for name, rest in usual.columns.items():
        values = np.array(getattr(spread, name)).reshape(len(which), -1)
        for way, passages in hanging.items():
            rows = which == way
            values[rows] = _moved(name, values[rows], rest, passages.columns[name])
        decimals = _TIME_DECIMALS if name == "contact_loss_s" else _FORCE_DECIMALS
        columns[name] = np.round(values, decimals).ravel().tolist()
    return changed(spread, hanging=which.tolist(), **columns)


def _moved(name: str, values: FloatArray, usual: FloatArray, hanging: FloatArray) -> FloatArray:
    if name in ("min_force_n", "contact_loss_s"):
        return np.asarray(np.maximum(0.0, values + hanging - usual))
    return np.asarray(values * hanging / usual)
