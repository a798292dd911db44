"""Continuous tracks that the paper may mean: whose receptance is "similar" to the discrete track's up to some 800 Hz.

The text gives that property and no parameters. Smeared supports have it, and so has what is fitted to the discrete
track's receptance: to its mean over the span, by magnitude or with phase, or in one section; and what lies between.
"""

from dataclasses import dataclass

import numpy as np

from weld_force_ros.physics.analysis.spectra import resonances_hz, wheelset_track_receptance
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.studies import dip_speeds
from weld_force_ros.studies.dip_speeds import DipSpeeds
from weld_force_ros.studies.paper_variant import ALIKE_BAND_HZ, Section, fractions_of, support_factors, with_factors
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import BILBAO, CONTINUOUS, StudyContext

_STARTS = 5
_BETWEEN = (0.25, 0.5, 0.75)  # of the way from the smeared to the fitted supports, on logarithms
_RESONANCE_HZ = np.arange(10.0, 1500.5, 1.0)


@dataclass(frozen=True)
class Reading:
    """A continuous track, and what comes of it.

    Attributes:
        name: how it was found.
        difference: of magnitudes from those of the discrete track's mean over the span, relative RMS to 800 Hz.
        second_resonance_hz: of the wheelset on it; NaN if it does not stand out.
        speeds_kmh: over both dips.
        spread: of five least-squares fits from different starts, the largest factor's; 0 where nothing was fitted.
    """

    name: str
    difference: float
    second_resonance_hz: float
    speeds_kmh: DipSpeeds
    spread: float


def readings(context: StudyContext) -> list[Reading]:
    """Fit the continuous tracks and roll over both dips on each, by fractions of degree 7 over 8."""
    discrete, smeared = context.track(BILBAO).track, context.track(CONTINUOUS).track
    factors, spread = _fitted(discrete, smeared, "mean", phase=False)
    found = [
        _reading(context, "smeared", smeared),
        *(
            _reading(context, f"{part:g} of the way to fitted", with_factors(smeared, factors**part))
            for part in _BETWEEN
        ),
        _reading(context, "fitted to the mean", with_factors(smeared, factors), spread),
    ]
    others: tuple[tuple[str, Section, bool], ...] = (
        ("the same, with phase", "mean", True),
        ("fitted in mid-span", "mid-span", False),
        ("fitted over a sleeper", "sleeper", False),
    )
    for name, section, phase in others:
        factors, spread = _fitted(discrete, smeared, section, phase=phase)
        found.append(_reading(context, name, with_factors(smeared, factors), spread))
    return found


def table(found: list[Reading]) -> Table:
    """Return a row a track."""
    columns = (
        Column("continuous_track", "continuous track"), Column("difference", "from the span's mean, RMS", 3),
        Column("spread", "spread of five starts"), Column("second_resonance_hz", "2nd resonance, Hz", 1),
        *dip_speeds.COLUMNS,
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (one.name, one.difference, one.spread, one.second_resonance_hz, *dip_speeds.cells(one.speeds_kmh))
        for one in found
    ]
    return Table("Continuous tracks that the text may mean", columns, rows)


def _fitted(discrete: Track, smeared: Track, section: Section, *, phase: bool) -> tuple[np.ndarray, float]:
    starts = np.random.default_rng(1).uniform(-0.7, 0.7, (_STARTS, 5))
    starts[0] = 0.0
    several = np.array([support_factors(discrete, smeared, section, phase=phase, start=one) for one in starts.tolist()])
    return several[0], float(np.max(np.ptp(several, axis=0)))


def _reading(context: StudyContext, name: str, track: Track, spread: float = 0.0) -> Reading:
    frequency_hz = np.arange(ALIKE_BAND_HZ[0], ALIKE_BAND_HZ[1] + 0.5)
    discrete = context.track(BILBAO).track
    mean = np.abs(beam.receptance(discrete, frequency_hz, beam.sections(discrete, 15)).mean(axis=0))
    ratio = np.abs(beam.receptance(track, frequency_hz, 0.0)[0]) / mean
    with_wheel = wheelset_track_receptance(track, context.track(CONTINUOUS).wheel, _RESONANCE_HZ, 0.0)[0]
    _, second, *_ = [*resonances_hz(_RESONANCE_HZ, with_wheel), np.nan, np.nan]
    return Reading(
        name, float(np.sqrt(np.mean((ratio - 1) ** 2))), float(second),
        dip_speeds.dip_speeds(context, fractions_of(track)), spread,
    )  # fmt: skip
