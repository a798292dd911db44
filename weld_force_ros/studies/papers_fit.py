"""The paper's fit as its section 2.1 describes it, on continuous support, and where that puts the cosine dips' speeds.

Rule, written down before any of it was run: eq. (2) as printed, which sums wt |h - G|^2, errors of the receptance
itself; equidistant frequencies from 10 to 1500 Hz; degree 5 over 6, which section 2.1 names for continuous support; wt
by NSGA-II with that section's two targets, the error of eq. (2) with wt = 1 and bounded coefficients (here: the largest
magnitude of those of s / 2 pi 500 Hz). Of the front the member of least error; its knee beside it, over several seeds.

As printed this cannot be used: with wt = 1 the minimum has a pole in the right half plane, and searches over wt with
stability as a constraint found no member. So the static compliance is held and poles are mirrored, as in all fits here.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.cubics import monotone_cubics
from weld_force_ros.physics.engines.rational_fractions import RfpModel, common_denominator, fit_sections
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.studies import dip_speeds
from weld_force_ros.studies.dip_speeds import DipSpeeds
from weld_force_ros.studies.paper_variant import FIT_BAND_HZ, fractions_of, relative_difference
from weld_force_ros.studies.result_table import Cell, Column, Table
from weld_force_ros.studies.study_context import CONTINUOUS, StudyContext

DEGREE = 6
SEEDS = (1, 2, 3)
POPULATION, GENERATIONS = 32, 20
_FREQUENCIES = 200
_KNOTS = 7
_MOST = 3.0  # logarithm of wt at a knot
_FAILED = 1e3


@dataclass(frozen=True)
class PapersFit:
    """A fit of the continuous track.

    Attributes:
        name: how it was found.
        error: of eq. (2) with wt = 1, relative to the receptance's own RMS.
        relative_error: RMS of the relative error of the receptance.
        largest_coefficient: the second target.
        growth_hz: largest real part of its poles over 2 pi; of a fit above 0 passages grow without bound.
        speeds_kmh: over both dips; NaN if passages do so.
    """

    name: str
    error: float
    relative_error: float
    largest_coefficient: float
    growth_hz: float
    speeds_kmh: DipSpeeds


class FitTask:
    """Eq. (2) on a continuous track, for any wt."""

    def __init__(self, track: Track, degree: int = DEGREE) -> None:
        """Compute what all fits share."""
        at = np.zeros(1)
        self.track, self.degree = track, degree
        self._frequency_hz = np.linspace(*FIT_BAND_HZ, _FREQUENCIES)
        self._exact = beam.receptance(track, self._frequency_hz, at)
        self._static = beam.static_compliance(track, at)
        self._unit = np.full(self._exact.shape, 1 / np.abs(self._exact).max())
        self._start = common_denominator(self._frequency_hz, self._exact, self._unit, degree)

    def fit(self, logarithms: FloatArray) -> RfpModel:
        """Return the fit with wt of these logarithms at knots equidistant on the logarithm of frequency.

        Raises:
            NumericalError: no finite coefficients.
        """
        knots = np.linspace(np.log(FIT_BAND_HZ[0]), np.log(FIT_BAND_HZ[1]), len(logarithms))
        weight = self._unit * np.exp(monotone_cubics(knots, logarithms)(np.log(self._frequency_hz)) / 2)
        a, b = fit_sections(self._frequency_hz, self._exact, weight, self._static, self.degree, start=self._start)
        return RfpModel(a, b, self.track.spacing_m)

    def objectives(self, model: RfpModel) -> tuple[float, float]:
        """Return the relative error of eq. (2) with wt = 1, and the largest coefficient of numerator or denominator."""
        difference = model.receptance(self._frequency_hz, 0.0) - self._exact
        error = np.linalg.norm(difference) / np.linalg.norm(self._exact)
        return float(error), float(max(np.abs(model.denominator).max(), np.abs(model.numerator / self._static).max()))

    def free_minimum(self) -> RfpModel:
        """Return the minimum of eq. (2) with wt = 1 and nothing held, by Levenberg-Marquardt from the stable fit."""
        start = self.fit(np.zeros(_KNOTS))
        s = 2j * np.pi * self._frequency_hz / start.scale_rad_s
        powers, unit = s[:, None] ** np.arange(self.degree, -1, -1), float(np.abs(self._exact).max())

        def misfit(coefficients: FloatArray) -> FloatArray:
            a, b = np.split(coefficients, 2)
            error: ComplexArray = powers[:, 1:] @ b / (powers @ np.append(1.0, a)) - self._exact[0] / unit
            return np.concatenate([error.real, error.imag])

        first = np.concatenate([start.denominator[0], start.numerator[0] / unit])
        a, b = np.split(least_squares(misfit, first, method="lm", x_scale="jac", max_nfev=20000).x, 2)
        return RfpModel(a[None], b[None] * unit, self.track.spacing_m)


def papers_fits(context: StudyContext) -> list[PapersFit]:
    """Fit the context's continuous track; one search only on a coarse grid."""
    track = context.track(CONTINUOUS).track
    task = FitTask(track)
    found = [
        _papers_fit(context, task, "relative errors", fractions_of(track, degree=DEGREE)),
        _papers_fit(context, task, "eq. (2), wt = 1, nothing held", task.free_minimum()),
        _papers_fit(context, task, "eq. (2), wt = 1", task.fit(np.zeros(_KNOTS))),
    ]
    for seed in SEEDS[:1] if context.coarse else SEEDS:
        least, knee = _ends(search(task, seed))
        found.append(_papers_fit(context, task, f"NSGA-II, seed {seed}, least error", task.fit(least)))
        found.append(_papers_fit(context, task, f"NSGA-II, seed {seed}, knee", task.fit(knee)))
    return found


def table(found: dict[str, list[PapersFit]]) -> Table:
    """Return a row a fit, under the name of its track."""
    columns = (
        Column("continuous_track", "continuous track"), Column("fit", "fit"), Column("error", "error, eq. (2)", 3),
        Column("relative_error", "relative error", 3), Column("largest_coefficient", "coefficient", 1),
        Column("growth_hz", "growth, Hz", 1), *dip_speeds.COLUMNS,
    )  # fmt: skip
    rows: list[tuple[Cell, ...]] = [
        (track, one.name, one.error, one.relative_error, one.largest_coefficient, one.growth_hz,
         *dip_speeds.cells(one.speeds_kmh))
        for track, several in found.items()
        for one in several
    ]  # fmt: skip
    return Table(f"The paper's fit, degree {DEGREE - 1} over {DEGREE}", columns, rows)


def search(task: FitTask, seed: int) -> tuple[FloatArray, FloatArray]:
    """Search wt by NSGA-II, and return the front, least error first: logarithms at the knots, and targets (n, 2).

    Raises:
        InputError: pymoo is missing.
    """
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.problem import ElementwiseProblem
        from pymoo.optimize import minimize
    except ImportError:
        raise InputError("searching a fit needs pymoo", "pip install 'weld_force_ros[fit]'") from None

    class Weights(ElementwiseProblem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=_KNOTS, n_obj=2, xl=-_MOST, xu=_MOST)

        def _evaluate(self, logarithms: FloatArray, out: dict[str, Any]) -> None:
            try:
                out["F"] = task.objectives(task.fit(logarithms))
            except NumericalError:
                out["F"] = (_FAILED, _FAILED)

    with threadpool_limits(limits=1, user_api="blas"):
        result = minimize(Weights(), NSGA2(pop_size=POPULATION), ("n_gen", GENERATIONS), seed=seed)
    order = np.argsort(result.F[:, 0])
    return np.asarray(result.X[order]), np.asarray(result.F[order])


def _ends(front: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the front's member of least error, and its knee: farthest below the line between the front's ends."""
    logarithms, targets = front
    extent = np.ptp(targets, axis=0)
    scaled = (targets - targets.min(axis=0)) / np.where(extent > 0, extent, 1.0)
    return logarithms[0], logarithms[np.argmin(scaled.sum(axis=1))]


def _papers_fit(context: StudyContext, task: FitTask, name: str, model: RfpModel) -> PapersFit:
    error, largest = task.objectives(model)
    growth_hz = float(model.poles().real.max() / (2 * np.pi))
    speeds = dip_speeds.dip_speeds(context, model) if growth_hz < 0 else dip_speeds.NONE
    return PapersFit(name, error, relative_difference(model, task.track), largest, growth_hz, speeds)
