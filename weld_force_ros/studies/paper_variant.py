"""The paper's own way, beside ours: rational fractions of degree 7 over 8, and a continuous track that is fitted.

The text names the degrees (eq. 1) but neither weights nor band, and says of its continuous track only that its
receptance is similar to the discrete track's up to some 800 Hz (section 6). Read here as: relative errors from 10 to
1500 Hz; and support parameters such that magnitudes are those of the mean over the span.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import least_squares

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.engines.common_poles import relative_error
from weld_force_ros.physics.engines.rational_fractions import RfpModel, common_denominator, fit_sections
from weld_force_ros.physics.passage.state_space import StateModel
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation import fit_store
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.studies.study_context import BILBAO, CONTINUOUS, StudyContext

DEGREE = 8
FIT_BAND_HZ = (10.0, 1500.0)
ALIKE_BAND_HZ = (20.0, 800.0)
_FIT_FREQUENCIES, _ALIKE_FREQUENCIES, _SECTIONS = 600, 120, 15
_MOST_FACTOR = 4.0  # between a fitted parameter and the smeared one


Section: TypeAlias = Literal["mean", "mid-span", "sleeper"]
"""Where in the discrete track's span the receptance is taken that a continuous track is fitted to."""


@dataclass(frozen=True)
class PaperVariant(StudyContext):
    """The paper's tracks by rational fractions.

    Attributes:
        fitted_continuous: take the continuous track that is fitted to the discrete one, in place of its supports
            smeared.
        fractions: take rational fractions in place of our poles.
    """

    fitted_continuous: bool = False
    fractions: bool = True

    def track(self, name: str) -> TrackDefinition:
        """Return a track of the paper, the continuous one fitted if so chosen."""
        if not (self.fitted_continuous and name == CONTINUOUS):
            return super().track(name)
        if CONTINUOUS not in self._definitions:
            smeared, discrete = super().track(name), super().track(BILBAO)
            fitted = continuous_like(discrete.track, smeared.track)
            self._definitions[CONTINUOUS] = replace(smeared, track=fitted, text=f"{smeared.text}\n# fitted to {BILBAO}")
        return self._definitions[CONTINUOUS]

    def rfp_error(self, name: str) -> float:
        """Return the error of the fractions, as fits state it."""
        definition = self.track(name)
        return relative_error(self._fractions(name), definition.track, definition.wheel.compliance)

    def model(self, name: str) -> StateModel:
        """Return the model of a track."""
        return self._fractions(name) if self.fractions else super().model(name)

    def _fractions(self, name: str) -> RfpModel:
        """Return the fractions of a track: those that ship, or of the continuous one by least squares."""
        definition = self.track(name)
        if not definition.track.continuous:
            found = fit_store.fitted(definition, "rfp").model()
            assert isinstance(found, RfpModel)  # noqa: S101
            return found
        return fractions_of(definition.track)


def continuous_like(discrete: Track, smeared: Track) -> Track:
    """Return a continuous track whose receptance is the discrete one's mean over the span, in magnitude, to 800 Hz.

    Pad, sleeper and ballast are fitted by least squares of log magnitudes, each within a factor of four of those that
    are given.
    """
    return with_factors(smeared, support_factors(discrete, smeared))


def support_factors(
    discrete: Track,
    smeared: Track,
    section: Section = "mean",
    *,
    phase: bool = False,
    start: Sequence[float] = (0.0,) * 5,
) -> FloatArray:
    """Return by what the smeared supports are multiplied to have a discrete track's receptance: see `with_factors`.

    Args:
        discrete: the track to resemble, up to 800 Hz.
        smeared: its supports smeared.
        section: where in its span.
        phase: compare complex receptances, relative, instead of log magnitudes.
        start: logarithms of the factors that the least squares start from, (5,).
    """
    frequency_hz = np.geomspace(*ALIKE_BAND_HZ, _ALIKE_FREQUENCIES)
    at_m = {
        "mean": beam.sections(discrete, _SECTIONS),
        "mid-span": np.array([discrete.spacing_m / 2]),
        "sleeper": np.zeros(1),
    }[section]
    wanted = beam.receptance(discrete, frequency_hz, at_m).mean(axis=0)

    def misfit(logarithms: FloatArray) -> FloatArray:
        ratio = beam.receptance(with_factors(smeared, np.exp(logarithms)), frequency_hz, 0.0)[0] / wanted
        error = ratio - 1
        return np.concatenate([error.real, error.imag]) if phase else np.asarray(np.log(np.abs(ratio)))

    most = np.log(_MOST_FACTOR)
    return np.asarray(np.exp(least_squares(misfit, start, bounds=(-most, most)).x))


def with_factors(track: Track, factors: FloatArray) -> Track:
    """Return the track with its supports multiplied by factors (5,).

    In turn: the pad's stiffness and loss factor, the sleeper's mass, the ballast's stiffness and loss factor.
    """
    pad, ballast = track.support.springs
    (mass,) = track.support.masses_kg
    if not (isinstance(pad, Spring) and isinstance(ballast, Spring) and isinstance(mass, float)):
        raise TypeError("the paper's track has two springs and a rigid sleeper")
    pad_factor, pad_loss, mass_factor, ballast_factor, ballast_loss = factors.tolist()
    support = Support(
        (
            replace(pad.stiffer(pad_factor), loss_factor=pad.loss_factor * pad_loss),
            replace(ballast.stiffer(ballast_factor), loss_factor=ballast.loss_factor * ballast_loss),
        ),
        (mass * mass_factor,),
    )
    return replace(track, support=support)


def fractions_of(track: Track, *, favour_low: float = 0.0, degree: int = DEGREE) -> RfpModel:
    """Return rational fractions of a continuous track by least squares, static compliance exact.

    Errors have the weight 1 / (|h| f^n), n being `favour_low`: 0 makes them relative. `degree` is the denominator's.
    """
    frequency_hz = np.linspace(*FIT_BAND_HZ, _FIT_FREQUENCIES)
    at = np.zeros(1)
    exact = beam.receptance(track, frequency_hz, at)
    weight = (FIT_BAND_HZ[0] / frequency_hz) ** favour_low / np.abs(exact)
    denominator, numerator = fit_sections(
        frequency_hz, exact, weight, beam.static_compliance(track, at), degree,
        start=common_denominator(frequency_hz, exact, weight, degree),
    )  # fmt: skip
    return RfpModel(denominator, numerator, track.spacing_m)


def relative_difference(model: RfpModel, track: Track) -> float:
    """Return the RMS of a model's error relative to a continuous track's receptance, over the fits' band."""
    frequency_hz = np.linspace(*FIT_BAND_HZ, _FIT_FREQUENCIES)
    ratio = model.receptance(frequency_hz, 0.0) / beam.receptance(track, frequency_hz, 0.0)
    return float(np.sqrt(np.mean(np.abs(ratio - 1) ** 2)))
