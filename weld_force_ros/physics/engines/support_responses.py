"""What single supports that differ do to a rail under a moving contact, in time: tables of the `reference` engine.

Each support answers a contact force with a force of its own on the rail (`local_support`, R h(S, x')), and the rail
answers that along the moving contact (h(x, S)). Both are sums over frequency as in `greens_function`, tabulated for
contacts `NODE_M` apart in a window of spans about the supports; beyond it they are too far away to be felt.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.engines.cubic_weights import cubic_weights
from weld_force_ros.physics.passage._convolution import Gaps, MovingSupports
from weld_force_ros.physics.track.beam import Track, Waves
from weld_force_ros.physics.track.local_support import LocalSupports, responses_at
from weld_force_ros.physics.track.support import Spring

NODE_M = 0.02
REACH_SPANS = 8


@dataclass(frozen=True)
class Spectrum:
    """Frequencies of the inverse transform.

    Attributes:
        resting: the track's waves at rest.
        moving: the track's waves at all other frequencies.
        resting_omega: (1,), rad/s, of `resting`.
        moving_omega: (n,), rad/s, complex where the exponential window is used.
        pulse: (1 + n,), weight of each frequency in the response to a triangle of force.
        decay_per_s: of the exponential window; 0: none, and what is missing at rest is spread over the response.
        period_s: after which the sum repeats.
    """

    resting: Waves
    moving: Waves
    resting_omega: FloatArray | ComplexArray
    moving_omega: ComplexArray
    pulse: FloatArray
    decay_per_s: float
    period_s: float

    def in_time(self, spectra: ComplexArray, lag_s: FloatArray) -> FloatArray:
        """Return responses (..., n_lag) to a triangle of force from transfer functions (..., 1 + n)."""
        phase = 2j * np.pi / self.period_s * np.outer(np.arange(len(self.pulse)), lag_s)
        turned, weighted = np.exp(phase), spectra * self.pulse
        found = (weighted.real @ turned.real - weighted.imag @ turned.imag) * np.exp(self.decay_per_s * lag_s)
        if self.decay_per_s == 0.0:
            found += (spectra[..., :1].real - found.sum(axis=-1, keepdims=True)) / len(lag_s)
        return np.asarray(found, dtype=np.float32)


def unchanged(lags: int) -> MovingSupports:
    """Return no supports that differ."""
    nothing = np.empty((0, 0, lags), dtype=np.float32)
    return MovingSupports(
        0, np.empty((0, 4), dtype=np.int64), np.empty((0, 4)), nothing, nothing, _gaps(nothing, nothing, [], [], [])
    )


def _gaps(
    responses: FloatArray, mutual: FloatArray, stiffness: list[float], damping: list[float], gap_m: list[float]
) -> Gaps:
    return Gaps(responses, mutual, *(np.array(values, dtype=np.float64) for values in (stiffness, damping, gap_m)))


def moving_supports(
    track: Track, at_rest: Track, supports: LocalSupports, spectrum: Spectrum, grid: int, lag_s: FloatArray
) -> MovingSupports:
    """Tabulate what the supports do to a contact that moves.

    Args:
        track: with its usual supports.
        at_rest: the track that `spectrum.resting` belongs to.
        supports: those that differ.
        spectrum: frequencies and the track's waves.
        grid: steps a span.
        lag_s: (n_lag,), s.
    """
    span, places = track.spacing_m, supports.places_m(track)
    first = int(np.floor(places[0] / span)) - REACH_SPANS
    spans = int(np.floor(places[-1] / span)) + REACH_SPANS - first
    a_span = max(4, round(span / NODE_M))
    at = first * span + span / a_span * np.arange(spans * a_span + 1)
    motion, drive = (
        np.concatenate(parts, axis=-1)
        for parts in zip(
            _transfer(at_rest, supports, spectrum.resting, spectrum.resting_omega, at),
            _transfer(track, supports, spectrum.moving, spectrum.moving_omega, at),
            strict=True,
        )
    )
    nodes, weights = _interpolation(grid, a_span, spans)
    gaps = unchanged(len(lag_s)).gaps
    if hanging := supports.hanging:
        ballast = track.support.springs[-1]
        assert isinstance(ballast, Spring), "ballast over a gap has a dashpot"  # noqa: S101
        resting, each_resting = supports.sleeper_responses(at_rest, spectrum.resting, spectrum.resting_omega, at)
        moving, each_moving = supports.sleeper_responses(track, spectrum.moving, spectrum.moving_omega, at)
        gaps = _gaps(
            spectrum.in_time(np.concatenate([resting, moving], axis=-1), lag_s),
            spectrum.in_time(np.concatenate([each_resting, each_moving], axis=-1), lag_s),
            [change.below * ballast.stiffness_n_per_m for change in hanging],
            [change.below * ballast.damping_ns_per_m for change in hanging],
            [change.gap_m for change in hanging],
        )
    return MovingSupports(
        first * grid, nodes, weights, spectrum.in_time(drive, lag_s), spectrum.in_time(motion, lag_s), gaps
    )


def _transfer(
    track: Track, supports: LocalSupports, waves: Waves, omega: FloatArray | ComplexArray, at_m: FloatArray
) -> tuple[ComplexArray, ComplexArray]:
    """Return motion of the contact by forces at the supports, and their forces by contact forces (n_s, n_at, n_f)."""
    motion = responses_at(waves, supports.places_m(track), at_m)
    return motion, np.einsum("ijf,jaf->iaf", supports.reactions(track, waves, omega), motion)


def _interpolation(grid: int, a_span: int, spans: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return four nodes (grid * spans, 4) and their Lagrange weights for each step, all of the step's own span."""
    nodes, weights = cubic_weights(np.arange(grid) * (a_span / grid), a_span)
    every = a_span * np.arange(spans)[:, None, None] + nodes
    return every.reshape(-1, 4), np.tile(weights, (spans, 1))
