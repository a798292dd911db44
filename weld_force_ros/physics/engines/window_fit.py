"""Common poles of a track of which a few supports differ: the `common-poles` engine over a window of spans.

Poles are shared by all sections of the window; residues change along it, most near the supports that differ, and tend
to those of the periodic track at its ends. A model's period is two windows: the track as it is met with rising x, and
its mirror image, as it is met against. What the wheel left behind in one has died out before it comes to the other.
"""

from collections.abc import Callable

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.engines.common_poles import (
    BAND_HZ,
    SECTIONS,
    PoleModel,
    common_poles,
    fit_frequencies,
    residues_of,
)
from weld_force_ros.physics.track import local_support
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.physics.track.local_support import LocalSupports

SPANS_BEFORE, SPANS_BEHIND = 5, 5
ORDERS = (16, 20, 24)
_GOOD_ENOUGH = 0.005
_NEAR_SPANS = 2  # within which sections differ so much that poles are fitted to more of them
_EVERY_NEAR, _EVERY = 4, 2  # sections that poles are fitted to
_CHECKED_SECTIONS = 101


def window_fit(
    track: Track,
    supports: LocalSupports,
    contact_compliance: Callable[[FloatArray], ComplexArray],
    *,
    on_order: Callable[[], None] = lambda: None,
) -> PoleModel:
    """Fit a track with supports that differ: the lowest order that is good enough, or the best.

    Args:
        track: with its usual supports.
        supports: those that differ.
        contact_compliance: c(omega), m/N, of contact and wheel, by which errors are weighed.
        on_order: called after each order that was tried.

    Raises:
        NumericalError: the fit did not end with finite, stable poles.
    """
    models, errors = [], []
    for order in ORDERS:
        models.append(fit_window(track, supports, contact_compliance, order))
        errors.append(window_error(models[-1], track, supports, contact_compliance))
        on_order()
        if errors[-1] <= _GOOD_ENOUGH:
            break
    return models[int(np.argmin(errors))]


def fit_window(
    track: Track, supports: LocalSupports, contact_compliance: Callable[[FloatArray], ComplexArray], order: int
) -> PoleModel:
    """Fit common poles of one order; see `window_fit`."""
    first, last = _extent(supports)
    section = (first - SPANS_BEFORE) * SECTIONS + np.arange(window_spans(supports) * SECTIONS)
    at = track.spacing_m / SECTIONS * section
    frequency = fit_frequencies()
    exact = local_support.receptance(track, supports, frequency, at)
    weight = 1 / np.abs(exact + contact_compliance(2 * np.pi * frequency))
    near = (section >= (first - _NEAR_SPANS) * SECTIONS) & (section <= (last + _NEAR_SPANS) * SECTIONS)
    far_half_span = section <= (first - SPANS_BEFORE) * SECTIONS + SECTIONS // 2
    fitted = (near & (section % _EVERY_NEAR == 0)) | (far_half_span & (section % _EVERY == 0))
    poles = common_poles(frequency, exact[fitted], weight[fitted], order)
    static = local_support.static_compliance(track, supports, at)
    return _both_ways(track, supports, poles, residues_of(frequency, exact, weight, poles, static))


def window_spans(supports: LocalSupports) -> int:
    """Return the number of spans of a window."""
    first, last = _extent(supports)
    return SPANS_BEFORE + last - first + SPANS_BEHIND


def _extent(supports: LocalSupports) -> tuple[int, int]:
    """Return the first and last sleeper about which the window lies: those that differ, and those beside the weld."""
    return min(supports.changes[0].sleeper, 0), max(supports.changes[-1].sleeper, 1)


def _both_ways(track: Track, supports: LocalSupports, poles: ComplexArray, residues: ComplexArray) -> PoleModel:
    """Return the model of a window (n_section, n) and its mirror image behind it, section 0 at sleeper 0."""
    count, before = len(residues), (SPANS_BEFORE - _extent(supports)[0]) * SECTIONS
    # A section k of the image is SECTIONS - k of the window, both counted from sleeper 0; the window's ends are alike.
    first = (1 - _extent(supports)[1] - SPANS_BEFORE) * SECTIONS
    image = residues[(SECTIONS - (first + np.arange(count)) + before) % count]
    spans = window_spans(supports)
    return PoleModel(
        poles_rad_s=poles,
        residues=np.roll(np.concatenate([residues, image]), -before, axis=0),
        section_m=track.spacing_m / SECTIONS * np.arange(2 * count),
        spacing_m=track.spacing_m,
        spans=2 * spans,
        image_m=track.spacing_m * (spans + sum(_extent(supports)) - 1),
    )


def window_error(
    model: PoleModel,
    track: Track,
    supports: LocalSupports,
    contact_compliance: Callable[[FloatArray], ComplexArray],
    band_hz: tuple[float, float] = BAND_HZ,
) -> float:
    """Return the RMS of |fit - exact| / |exact + c| over a band and near the supports, between fitted sections too."""
    frequency = np.geomspace(*band_hz, 200)
    first, last = _extent(supports)
    ends = (first - _NEAR_SPANS, last + _NEAR_SPANS)
    at = track.spacing_m * np.linspace(*ends, _CHECKED_SECTIONS)
    exact = local_support.receptance(track, supports, frequency, at)
    seen = exact + contact_compliance(2 * np.pi * frequency)
    return float(np.sqrt(np.mean(np.abs((model.receptance(frequency, at) - exact) / seen) ** 2)))
