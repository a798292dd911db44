"""The weights of the `rfp` engine's least squares, searched by NSGA-II.

NSGA-II: Deb et al., IEEE Trans. Evol. Comput. 6 (2002) 182. Two objectives, the paper's: a small error of the
receptance, and coefficients that change little along the span. Constraints: stable poles on and between all sections; a
wheel on smooth rail whose motion does not grow, whatever the stiffness of its contact; a force on smooth rail that
swings little more than with the denominator that all sections can share; and an error not far above that one's. The
swing is the sharp one: at degree 12 a change of a_12 by half a per cent between sections lets the static load alone
swing the force by its own size, although nothing grows.

Beside the weights, one more number is searched: how strongly the sections' denominators are tied to the shared one.
Weights alone are enough for degree 8 on viscous tracks. They were not on `bilbao`, with its loss factors, where
passages at high speed grew or the static load swung the force by its own size, nor from degree 10 up, where poles hop:
peaks came out 7 to 10 % off, or nothing bounded was found.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from threadpoolctl import threadpool_limits

from weld_force_ros.errors import InputError, NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.cubics import monotone_cubics
from weld_force_ros.physics.engines.common_poles import BAND_HZ
from weld_force_ros.physics.engines.rational_fractions import (
    STEPS_PER_SECTION,
    RfpModel,
    common_denominator,
    fit_sections,
    smooth_rail,
)
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track

DEGREE = 8
DEGREES = range(4, 13)
SECTIONS = 15
POPULATION = 40
GENERATIONS = 40
VARIABLES = 8  # logarithms: of the weights at seven knots, of the regularisation

_FREQUENCIES = 200
_LOWEST = np.array([-3.0] * (VARIABLES - 1) + [-7.0])
_HIGHEST = np.array([3.0] * (VARIABLES - 1) + [4.0])
_LEAST_DECAY = 1e-3  # of all poles, in units of the scale
_LEAST_SHRINKAGE = 0.01  # from span to span
_MOST_SWING = (1.25, 0.05)  # times the shared denominator's, plus a share of the static load
_MOST_ERROR = 1.5  # times the shared denominator's
_FAILED = 1e3
# Searched at a few, the chosen fit checked at all: speeds, and contact stiffness relative to that at the static load.
_SEARCHED = ((40.0, 100.0, 160.0, 220.0, 300.0), (0.1, 0.4, 1.0))
_CHECKED = (tuple(float(v) for v in range(10, 310, 10)), (0.03, 0.1, 0.2, 0.4, 0.7, 1.0, 1.5, 2.5, 5.0))


class Wheel(Protocol):
    """A wheel as fits need to know it."""

    @property
    def mass_kg(self) -> float: ...  # noqa: D102
    @property
    def contact_stiffness_n_per_m(self) -> float: ...  # noqa: D102
    def compliance(self, omega: FloatArray) -> ComplexArray:
        """Return the compliance of contact and wheel in series with the track, m/N."""


class FitTask:
    """Everything that a fit of one track depends on but the decision vector.

    Its numbers are logarithms: of factors on the base weight 1 / |h + c|, what the contact sees, at knots equidistant
    on the logarithm of frequency with monotone cubics between, the same for all sections (only their differences
    count); and of the regularisation towards the shared denominator, see `fit_sections`.
    """

    def __init__(self, track: Track, wheel: Wheel, *, degree: int = DEGREE, section_count: int = SECTIONS) -> None:
        """Compute what all fits share.

        Args:
            track: the track.
            wheel: weighs the errors and closes the loop over smooth rail.
            degree: the denominator's, 4 to 12.
            section_count: sections over the span; continuous support needs one and gets one.

        Raises:
            InputError: a degree or count out of range.
        """
        if degree not in DEGREES or section_count < 3:
            raise InputError(
                f"a fit of degree {degree} at {section_count} sections",
                f"use a degree from {DEGREES[0]} to {DEGREES[-1]} and at least 3 sections",
            )
        self.track, self.wheel, self.degree = track, wheel, degree
        at = beam.sections(track, section_count)
        half = at[: len(at) // 2 + 1]  # the span is symmetric about its middle
        self._mirror = np.minimum(np.arange(len(at)), len(at) - np.arange(len(at)))
        self._frequency = np.linspace(np.sqrt(BAND_HZ[0]), np.sqrt(BAND_HZ[1]), _FREQUENCIES) ** 2
        self._exact = beam.receptance(track, self._frequency, half)
        self._static = beam.static_compliance(track, half)
        self._base = 1 / np.abs(self._exact + wheel.compliance(2 * np.pi * self._frequency))
        self._start = common_denominator(self._frequency, self._exact, self._base, degree)
        self._error_hz = np.geomspace(*BAND_HZ, 200)
        self._error_m = np.linspace(0.0, track.spacing_m / 2, 1 if track.continuous else 25)
        self._error_exact = beam.receptance(track, self._error_hz, self._error_m)
        self._seen = self._error_exact + wheel.compliance(2 * np.pi * self._error_hz)
        shared = self.fit_at(np.append(np.zeros(VARIABLES - 1), 12.0))
        self._most_error = _MOST_ERROR * self.error(shared)
        factor, share = _MOST_SWING
        self._most_swing = [factor * self._swing(shared, speeds) + share for speeds, _ in (_SEARCHED, _CHECKED)]

    def weights(self, decision_vector: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Return frequencies, Hz, and the factors of a decision vector on the base weight, (n_frequency,) each."""
        logarithms = np.asarray(decision_vector, dtype=np.float64)[:-1]
        knots = np.linspace(np.log(BAND_HZ[0]), np.log(BAND_HZ[1]), len(logarithms))
        return self._frequency, np.exp(monotone_cubics(knots, logarithms)(np.log(self._frequency)))

    def fit_at(self, decision_vector: ArrayLike) -> RfpModel:
        """Return the fit of a decision vector, (n_variable,).

        Raises:
            NumericalError: no finite coefficients.
        """
        regularisation = float(np.exp(np.asarray(decision_vector, dtype=np.float64)[-1]))
        return self._fit(self._base * self.weights(decision_vector)[1], regularisation)

    def unweighted_fit(self) -> RfpModel:
        """Return the fit with relative weights, 1 / |h|, and no regularisation: what a search has to beat."""
        return self._fit(1 / np.abs(self._exact), 0.0)

    def _fit(self, weight: FloatArray, regularisation: float) -> RfpModel:
        a, b = fit_sections(
            self._frequency,
            self._exact,
            weight,
            self._static,
            self.degree,
            start=self._start,
            regularisation=regularisation,
        )
        return RfpModel(a[self._mirror], b[self._mirror], self.track.spacing_m)

    def error(self, model: RfpModel) -> float:
        """Return the contact-weighted RMS error over band and span, as `common_poles.relative_error` does."""
        difference = model.receptance(self._error_hz, self._error_m) - self._error_exact
        return float(np.sqrt(np.mean(np.abs(difference / self._seen) ** 2)))

    def objectives(self, decision_vector: ArrayLike) -> FloatArray:
        """Return error and variation, to be small, and four constraints, to be at most 0: (6,).

        The constraints: stability, growth, swing, error.
        """
        try:
            model = self.fit_at(decision_vector)
        except NumericalError:
            return np.full(6, _FAILED)
        values = [self.error(model), model.variation, *self._constraints(model, *_SEARCHED, self._most_swing[0])]
        values.append(values[0] - self._most_error)
        return np.minimum(values, _FAILED)

    def is_feasible(self, model: RfpModel) -> bool:
        """Return whether the constraints hold from 10 to 300 km/h and from an almost open to a loaded contact."""
        return max(self._constraints(model, *_CHECKED, self._most_swing[1])) <= 0

    def _constraints(
        self, model: RfpModel, speeds_kmh: Sequence[float], stiffness: Sequence[float], most_swing: FloatArray
    ) -> tuple[float, float, float]:
        steps = STEPS_PER_SECTION * len(model.denominator)
        poles = model.poles(np.arange(steps) * (model.spacing_m / steps))
        smooth_rails = [
            smooth_rail(model, self.wheel.mass_kg, k * self.wheel.contact_stiffness_n_per_m, speeds_kmh)
            for k in stiffness
        ]
        growth = max(float(rail.growth.max()) for rail in smooth_rails)
        swing = smooth_rails[list(stiffness).index(1.0)].swing
        return (
            float(poles.real.max()) / model.scale_rad_s + _LEAST_DECAY,
            float(np.log(growth)) + _LEAST_SHRINKAGE,
            float(np.max(swing - most_swing)),
        )

    def _swing(self, model: RfpModel, speeds_kmh: Sequence[float]) -> FloatArray:
        return smooth_rail(model, self.wheel.mass_kg, self.wheel.contact_stiffness_n_per_m, speeds_kmh).swing


@dataclass(frozen=True)
class Population:
    """All that a search needs to go on: decision vectors (n, n_variable) after `generation` generations."""

    generation: int
    decision_vectors: FloatArray


@dataclass(frozen=True)
class Progress:
    """After a generation: the best values among fits that hold the constraints, infinite if there is none yet."""

    population: Population
    generations: int
    feasible: int
    least_error: float
    least_variation: float


@dataclass(frozen=True)
class Front:
    """Fits that no other one found beats in both objectives, least error first.

    Attributes:
        decision_vectors: (n, n_variable), for `FitTask.fit_at`.
        error: (n,), the first objective.
        variation: (n,), the second.
        chosen: index of the chosen fit: of those that are feasible, the one farthest below the line between the ends
            of the front, objectives scaled to its extent.
        unweighted: both objectives of the fit with weights 1 / |h|.
    """

    decision_vectors: FloatArray
    error: FloatArray
    variation: FloatArray
    chosen: int
    unweighted: tuple[float, float]


def search(
    task: FitTask,
    *,
    seed: int = 1,
    population: int = POPULATION,
    generations: int = GENERATIONS,
    on_generation: Callable[[Progress], None] | None = None,
    resume_from: Population | None = None,
) -> Front:
    """Search decision vectors by NSGA-II; needs pymoo (extra `fit`).

    Each generation draws its own random numbers, from the seed and its number, and depends on nothing but the
    decision vectors before it: a search that is resumed ends exactly as one that was never interrupted.

    Args:
        task: the track to be fitted.
        seed: of all random numbers.
        population: fits in a generation; a resumed search keeps its own.
        generations: how many.
        on_generation: called after each.
        resume_from: the population that `on_generation` last got.

    Raises:
        InputError: pymoo is missing, the population is under 4 or cannot be resumed.
        NumericalError: no fit found that holds the constraints.
    """
    now = resume_from or _first_population(seed, population)
    if (
        now.decision_vectors.ndim != 2
        or now.decision_vectors.shape[1] != VARIABLES
        or not np.all(np.isfinite(now.decision_vectors))
    ):
        raise InputError("the kept state of the search does not fit", "start the search anew")
    # Many small factorisations: a second BLAS thread makes them many times slower where another program computes.
    with threadpool_limits(limits=1, user_api="blas"):
        evaluated = np.stack([task.objectives(decision_vector) for decision_vector in now.decision_vectors])
        while now.generation < generations:
            now, evaluated = _next_generation(task, now, evaluated, seed)
            if on_generation:
                on_generation(_progress(now, evaluated, generations))
        return _front(task, now, evaluated)


def _first_population(seed: int, size: int) -> Population:
    if size < 4:
        raise InputError(f"a population of {size}", "use at least 4")
    decision_vectors = np.random.default_rng([seed, 0]).uniform(_LOWEST / 2, _HIGHEST / 2, (size, VARIABLES))
    # What the contact sees with each section on its own, and with the shared denominator.
    decision_vectors[0] = np.append(np.zeros(VARIABLES - 1), _LOWEST[-1])
    decision_vectors[1] = np.append(np.zeros(VARIABLES - 1), _HIGHEST[-1])
    return Population(0, decision_vectors)


def _next_generation(task: FitTask, now: Population, evaluated: FloatArray, seed: int) -> tuple[Population, FloatArray]:
    problem, individuals, algorithm = _nsga2(now.decision_vectors, evaluated)
    algorithm.setup(problem, termination=("n_gen", 3), seed=[seed, now.generation + 1])
    algorithm.ask()
    algorithm.tell(infills=individuals)
    offspring = algorithm.ask()
    values = np.stack([task.objectives(decision_vector) for decision_vector in offspring.get("X")])
    offspring.set("F", values[:, :2], "G", values[:, 2:])
    algorithm.tell(infills=offspring)
    survivors = algorithm.pop
    evaluated = np.concatenate([survivors.get("F"), survivors.get("G")], axis=1)
    return Population(now.generation + 1, np.array(survivors.get("X"), dtype=np.float64)), evaluated


def _nsga2(decision_vectors: FloatArray, evaluated: FloatArray) -> tuple[Any, Any, Any]:
    """Return problem, evaluated individuals and algorithm; the one place that knows pymoo."""
    try:
        from pymoo.algorithms.moo.nsga2 import NSGA2
        from pymoo.core.population import Population as Individuals
        from pymoo.core.problem import Problem
    except ImportError:
        raise InputError("searching a fit needs pymoo", "pip install 'weld_force_ros[fit]'") from None
    problem = Problem(n_var=VARIABLES, n_obj=2, n_ieq_constr=evaluated.shape[1] - 2, xl=_LOWEST, xu=_HIGHEST)
    individuals = Individuals.new(X=decision_vectors, F=evaluated[:, :2], G=evaluated[:, 2:])
    return problem, individuals, NSGA2(pop_size=len(decision_vectors), sampling=individuals)


def _feasible(evaluated: FloatArray) -> NDArray[np.bool_]:
    return np.asarray(np.all(evaluated[:, 2:] <= 0, axis=1))


def _progress(now: Population, evaluated: FloatArray, generations: int) -> Progress:
    good = evaluated[_feasible(evaluated)]
    least = good[:, :2].min(axis=0) if len(good) else np.full(2, np.inf)
    return Progress(now, generations, len(good), float(least[0]), float(least[1]))


def _front(task: FitTask, now: Population, evaluated: FloatArray) -> Front:
    feasible = _feasible(evaluated)
    decision_vectors, objectives = now.decision_vectors[feasible], evaluated[feasible, :2]
    order = np.lexsort((objectives[:, 1], objectives[:, 0]))
    kept: list[int] = []
    for i in order:
        if not kept or objectives[i, 1] < objectives[kept[-1], 1]:
            kept.append(int(i))
    decision_vectors, objectives = decision_vectors[kept], objectives[kept]
    unweighted = task.unweighted_fit()
    for chosen in _by_distance(objectives):
        if task.is_feasible(task.fit_at(decision_vectors[chosen])):
            return Front(
                decision_vectors,
                objectives[:, 0],
                objectives[:, 1],
                int(chosen),
                (task.error(unweighted), unweighted.variation),
            )
    raise NumericalError(
        f"no fit of degree {task.degree} found that stays bounded on track {task.track.name}; "
        "search longer or with another degree"
    )


def _by_distance(objectives: FloatArray) -> NDArray[np.intp]:
    """Return indices, the one farthest below the line between the front's ends first."""
    if len(objectives) == 0:
        return np.empty(0, dtype=np.intp)
    extent = np.ptp(objectives, axis=0)
    scaled = (objectives - objectives.min(axis=0)) / np.where(extent > 0, extent, 1.0)
    return np.argsort(scaled.sum(axis=1), kind="stable")
