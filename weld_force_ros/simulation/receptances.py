"""Compute point receptances of a track: exactly, or as an engine fits them."""

from collections.abc import Callable
from typing import cast, get_args

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.errors import InputError
from weld_force_ros.physics.arrays import ComplexArray
from weld_force_ros.physics.track.beam import receptance
from weld_force_ros.simulation import fit_store
from weld_force_ros.simulation.track_file import TrackDefinition

EXACT = "exact"


def point_receptance(
    definition: TrackDefinition,
    frequency_hz: ArrayLike,
    at_m: ArrayLike,
    *,
    engine: str = EXACT,
    on_fit: Callable[[str], None] | None = None,
) -> ComplexArray:
    """Return the point receptance of the rail, m/N, (n_at, n_frequency).

    Args:
        definition: the track.
        frequency_hz: (n_frequency,), positive.
        at_m: (n_at,), metres after a sleeper.
        engine: `exact`, or the engine whose fit is evaluated.
        on_fit: called with a line of text if the fit has to be made.

    Raises:
        InputError: a frequency that is not positive, or an engine without receptances.
    """
    frequency, at = np.atleast_1d(np.asarray(frequency_hz, float)), np.atleast_1d(np.asarray(at_m, float))
    if not np.all(np.isfinite(frequency) & (frequency > 0)):
        raise InputError("a frequency is not positive", "give frequencies in Hz above 0")
    if engine == EXACT:
        return receptance(definition.track, frequency, at)
    if engine not in get_args(fit_store.FittedEngine):
        raise InputError(f"engine {engine!r} has no receptance of its own", "use exact, common-poles or rfp")
    fit = fit_store.fitted(definition, cast(fit_store.FittedEngine, engine), on_fit=on_fit)
    return fit.model().receptance(frequency, at)
