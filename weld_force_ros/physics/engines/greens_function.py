"""Moving Green's functions: the `reference` engine, slow and free of any fit.

The rail's displacement under the wheel is the sum of its responses to all earlier contact forces, each followed along
the moving contact: z(t) = integral of g(x(t), x(t'), t - t') f(t') dt', with g from the exact transfer receptances.
Nothing is fitted and nothing assumed quasi-stationary; wheel, contact and trajectory are those of the other engines
(after Nordborg, Acta Acustica 84 (1998) 854, and Pieringer, 2011, with which the paper validates itself).

What the inverse transform needs, and how it is met:

- Pulses. The force is linear within a step, so that each step's pulse is a triangle; its spectrum goes into the sum.
- Band. Frequencies to `BAND_HZ`, the last fifth tapered. What lies above is the jump of the rail's velocity under a
  force, 1 / (2 sqrt(shear stiffness x mass per length)): it is taken out of the sum as a decaying exponential and put
  back exactly, as its missing tail would ring ahead of the pulse and take a tenth of the contact's compliance away.
- Window. The sum repeats after `MEMORY_S`. On causal tracks it is evaluated at complex frequencies, which lets what
  comes round again arrive a hundred times smaller (the exponential window method).
- Rest. A constant load sees no loss: responses add up to the undamped static receptance. On hysteretic tracks the cut
  (see below) would change that by a quarter; the difference is spread evenly over the window, where only the slowest
  motion meets it.
- Grid. A step is a whole fraction of the span, at most `STEP_S` and `STEP_M`. Responses are computed for pulses
  `NODE_M` apart and interpolated between (cubic, never across a sleeper, where the rail's slope has a kink).
- Causality. A loss factor answers before its cause. On hysteretic tracks that part, some per cent of the energy, is
  cut off at the pulse, as no model in time can keep it. A loss factor of the rail itself is treated alike, but is tiny.

Convergence on `johansson-nielsen` (0.9 mm flat, cosine dip, rise and long dip, 40 to 300 km/h): `tests/physics/
engines/test_greens_function.py` halves step and grid, widens band and window, and holds each to 0.3 % in every peak;
the figures stand there.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from weld_force_ros.errors import NumericalError
from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.engines.cubic_weights import cubic_weights
from weld_force_ros.physics.engines.support_responses import Spectrum, moving_supports, unchanged
from weld_force_ros.physics.passage import _convolution, lowpass
from weld_force_ros.physics.passage.passage import History, checked_axis, checked_positions, checked_speeds
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import WheelPath
from weld_force_ros.physics.threads import executor
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.physics.track.local_support import LocalSupports

STEP_S = 25e-6
STEP_M = 1.0e-3
NODE_M = 0.01
BAND_HZ = 6500.0
MEMORY_S = 0.125
LEAD_IN_S = 0.12
RUN_OUT_S = 0.08
_MOST_REMEMBERED = 8  # speeds, up to 5 MB each
DEFLECTIONS = 64
_IMAGE_SPANS = 1000
"""Where the mirror image of a track lies whose supports differ: far from the track itself."""
_WINDOW = 4.6  # ln 100
_AROUND_SPANS = 3.0  # of rail about supports that differ, whose peaks count
_SETTLED = 1e-3  # of the static load: from one span of smooth rail to the next
_JUMP_DECAY_RAD_S = 2 * np.pi * 1000.0


@dataclass(frozen=True)
class _Responses:
    """Responses along the moving contact, at one speed.

    Attributes:
        dt: step, s.
        grid: steps a span.
        rows: (n_node, n_lag), displacement under the contact, step by step after a unit pulse at the node, m/N.
        nodes: (n_grid, 4), which rows make the response to a pulse at each grid point.
        weights: (n_grid, 4), and how much of each.
        supports: those that differ from the track's.
        settling: steps of smooth rail until the force repeats from span to span.
    """

    dt: float
    grid: int
    rows: FloatArray
    nodes: NDArray[np.int64]
    weights: FloatArray
    supports: _convolution.MovingSupports
    settling: int = 0


class MovingReceptance(NamedTuple):
    """What a force finds that acts at a place while the contact moves on.

    Attributes:
        speed_m_s: of the contact.
        at_m: (n_at,), where the force acts, after the sleeper.
        receptance: (n_at, n_frequency), the transform of the contact's displacement after an impulse there, m/N.
        deflection: (`DEFLECTIONS`,), the contact's under a constant unit force, from the sleeper on, m/N.
    """

    speed_m_s: float
    at_m: FloatArray
    receptance: ComplexArray
    deflection: FloatArray


@dataclass(frozen=True)
class _Passage:
    """A passage in time steps, from the start of its window; `columns` is force, wheel, rail, positive down.

    `force_n` (n,) begins earlier, at rest.
    """

    x_m: FloatArray
    irregularity_m: FloatArray
    columns: FloatArray
    force_n: FloatArray


class GreensFunctionModel:
    """A wheel on the exact track: the calls of `VehicleTrackModel`, some thousand times slower.

    Args:
        track: with its usual supports.
        wheel: that runs over it.
        supports: those that differ from the track's.
        threads: as of `VehicleTrackModel`: they compute responses and passages, and the waves of a rail by strips.
    """

    def __init__(
        self, track: Track, wheel: Wheel, supports: LocalSupports | None = None, *, threads: int | None = None
    ) -> None:
        self.track, self.supports = track, supports
        self._threads = threads
        self.wheel = wheel
        self._physics = np.array([wheel.mass_kg, wheel.static_load_n, wheel.hertz_n_per_m15])
        self._remembered: dict[tuple[float, bool], _Responses] = {}

    @property
    def opposite_m(self) -> float:
        """Return what a place x is met at against rising x, plus x; see `VehicleTrackModel`."""
        return self.track.spacing_m * (1 if self.supports is None else 1 + _IMAGE_SPANS)

    def _from_sleeper_0(self, position_m: float) -> tuple[float, bool]:
        """Return how far sleeper 0 is from the origin of a position, and whether it is that of the mirror image."""
        image_m = self.opposite_m - self.track.spacing_m
        return (image_m, True) if image_m and position_m > image_m / 2 else (0.0, False)

    def peak_map(
        self,
        wheel_path: WheelPath,
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        low_passed: bool = False,
        on_speed: Callable[[], None] = lambda: None,
    ) -> PeakMap:
        """Return peaks as `VehicleTrackModel.peak_map` does."""
        return self.peak_maps([wheel_path], speeds_kmh, positions_m, low_passed=low_passed, on_speed=on_speed)[0]

    def maps_of_few(
        self,
        wheel_paths: Sequence[WheelPath],
        speeds_kmh: ArrayLike,
        positions_m: FloatArray,
        *,
        low_passed: bool = False,
        on_speed: Callable[[], None] = lambda: None,
    ) -> list[PeakMap]:
        """Return peaks as `VehicleTrackModel.maps_of_few` does."""
        return self.peak_maps(wheel_paths, speeds_kmh, positions_m, low_passed=low_passed, on_speed=on_speed)

    def peak_maps(
        self,
        wheel_paths: Sequence[WheelPath],
        speeds_kmh: ArrayLike,
        positions_m: ArrayLike,
        *,
        low_passed: bool = False,
        on_speed: Callable[[], None] = lambda: None,
    ) -> list[PeakMap]:
        """Return peak maps of several welds, which share the responses of each speed; see `peak_map`."""
        speeds, given = checked_speeds(speeds_kmh), checked_positions(positions_m)
        positions = np.broadcast_to(given, (len(wheel_paths), given.shape[-1]))
        filters = len(lowpass.CUTOFFS_HZ) if low_passed else 0
        results = np.empty((len(wheel_paths), len(speeds), positions.shape[1], 4 + filters))
        with executor(self._threads) as pool:
            for row, speed in enumerate(speeds):
                images = {self._from_sleeper_0(position)[1] for position in positions.ravel().tolist()}
                either = {image: self._responses(speed, image, pool) for image in images}

                def peak(
                    cell: tuple[int, int],
                    either: dict[bool, _Responses] = either,
                    row: int = row,
                    speed: float = speed,
                ) -> None:
                    weld, column = cell
                    from_m, image = self._from_sleeper_0(float(positions[weld, column]))
                    responses = either[image]
                    passage = self._over_weld(responses, wheel_paths[weld], speed, positions[weld, column] - from_m)
                    results[weld, row, column, :4] = _peak(passage, responses.dt)
                    results[weld, row, column, 1] += from_m
                    if low_passed:
                        results[weld, row, column, 4:] = _greatest_low_passed(passage, responses.dt)

                list(pool.map(peak, np.ndindex(*positions.shape)))
                on_speed()
        if not np.all(np.isfinite(results)):
            raise NumericalError("a passage did not stay finite; the reference cannot follow this track")
        return [PeakMap.of(weld) for weld in results]

    def history(self, wheel_path: WheelPath, speed_kmh: float, position_m: float, *, until_m: float = 0.0) -> History:
        """Return one passage as `VehicleTrackModel.history` does."""
        speed, position = float(checked_speeds(speed_kmh)[0]), float(checked_axis("position", position_m)[0])
        span, (from_m, image) = self.track.spacing_m, self._from_sleeper_0(position)
        with executor(self._threads) as pool:
            responses = self._responses(speed, image, pool)
        position -= from_m
        last = max(position + wheel_path.end_m + span, until_m - from_m)
        passage = self._simulate(responses, wheel_path, position, position + wheel_path.start_m - span, last)
        force, wheel, rail = passage.columns.T
        return History(passage.x_m + from_m, force, -wheel, -rail, passage.irregularity_m)

    def moving_receptance(self, speed_kmh: float, frequency_hz: FloatArray, count: int) -> MovingReceptance:
        """Return the receptance that a force finds which moves on with the contact.

        Args:
            speed_kmh: the contact's.
            frequency_hz: (n_frequency,).
            count: places at which the force acts; a quarter of a step after those from the sleeper on, so that none is
                the mirror image of another.
        """
        with executor(self._threads) as pool:
            responses = self._responses(speed_kmh, False, pool)
        points = np.round((np.arange(count) + 0.25) * responses.grid / count).astype(np.intp)
        nodes, weights = responses.nodes, responses.weights
        after = np.arange(responses.rows.shape[1])
        heard = np.round(np.arange(DEFLECTIONS) * responses.grid / DEFLECTIONS).astype(np.intp)
        begun = (heard[:, None] - after) % responses.grid  # where the force acted
        return MovingReceptance(
            speed_kmh / 3.6,
            self.track.spacing_m / responses.grid * points,
            np.einsum("aq,aqt->at", weights[points], responses.rows[nodes[points]])
            @ np.exp(-2j * np.pi * responses.dt * np.outer(after, frequency_hz))
            / np.sinc(frequency_hz * responses.dt) ** 2,
            np.einsum("atq,atq->a", weights[begun], responses.rows[nodes[begun], after[None, :, None]]),
        )

    def _over_weld(self, responses: _Responses, wheel_path: WheelPath, speed_kmh: float, position_m: float) -> _Passage:
        first, last = position_m + wheel_path.start_m, position_m + wheel_path.end_m
        last += max(self.track.spacing_m, RUN_OUT_S * speed_kmh / 3.6)
        # What takes longer to settle takes longer to die out, too.
        longer = responses.settling - int(np.ceil(LEAD_IN_S / responses.dt))
        last += longer * self.track.spacing_m / responses.grid
        if self.supports is not None:  # the rail near them is part of what is asked for
            places, around_m = self.supports.places_m(self.track), _AROUND_SPANS * self.track.spacing_m
            first, last = min(first, places[0] - around_m), max(last, places[-1] + around_m)
        return self._simulate(responses, wheel_path, position_m, first, last)

    def _simulate(
        self, responses: _Responses, wheel_path: WheelPath, position_m: float, first_m: float, last_m: float
    ) -> _Passage:
        step_m = self.track.spacing_m / responses.grid
        memory, settling = responses.rows.shape[1], responses.settling
        first = int(np.floor(first_m / step_m))
        begin = first - settling - memory
        x = step_m * np.arange(begin, int(np.ceil(last_m / step_m)) + 1)
        irregularity = wheel_path.at(x - position_m)
        columns = np.empty((len(x), 3))
        _convolution.passage_by_convolution(
            responses.rows, responses.nodes, responses.weights, responses.supports, begin, memory, -irregularity,
            self._physics, responses.dt, columns,
        )  # fmt: skip
        shown = slice(settling + memory, None)
        return _Passage(x[shown], irregularity[shown], columns[shown], columns[:, 0])

    def _responses(self, speed_kmh: float, image: bool, pool: Executor) -> _Responses:
        """Return the responses, remembered: welds are checked one after the other at the same few speeds."""
        responses = self._remembered.get((speed_kmh, image))
        if responses is None:
            if len(self._remembered) >= (_MOST_REMEMBERED if self.supports is None else 2):
                self._remembered.clear()
            responses = self._compute_responses(speed_kmh, image, pool)
            responses = self._remembered[speed_kmh, image] = replace(responses, settling=self._settling(responses))
        return responses

    def _compute_responses(self, speed_kmh: float, image: bool, pool: Executor) -> _Responses:
        span, speed = self.track.spacing_m, speed_kmh / 3.6
        node_count = round(span / NODE_M)
        every = max(1, int(np.ceil(span / node_count / min(speed * STEP_S, STEP_M))))
        grid = node_count * every
        dt = span / grid / speed
        nodes = every * np.arange(1 if self.track.continuous else node_count)
        lag = dt * np.arange(int(0.95 * MEMORY_S / dt))
        spectrum = _Spectrum(self.track, dt, self._threads)
        at = span / grid * np.arange(grid)
        tables = [
            part for array in (spectrum.shape(at).transpose(1, 0, 2), spectrum.multiplier) for part in _parts(array)
        ]
        phase_step = _parts(np.exp(1j * spectrum.omega * dt))
        strength = spectrum.pulse * spectrum.strength
        behind = spectrum.shape(-at[nodes])
        rows = np.empty((len(nodes), len(lag)))

        def respond(n: int) -> None:
            _convolution.moving_response(*_parts(strength * behind[:, n]), *tables, *phase_step, int(nodes[n]), rows[n])

        list(pool.map(respond, range(len(nodes))))
        in_band, exact = spectrum.jump(lag)
        rows = (rows - in_band) * np.exp(spectrum.alpha * lag) + exact
        if spectrum.alpha == 0.0:
            short = np.mean(beam.static_compliance(self.track, at[nodes])) - np.mean(rows.sum(axis=1))
            rows += short / len(lag)
        supports = unchanged(len(lag))
        if self.supports is not None:
            met = self.supports.mirrored if image else self.supports
            supports = moving_supports(self.track, spectrum.at_rest, met, spectrum.transform, grid, lag)
        return _Responses(dt, grid, rows, *_interpolation(grid, every, len(nodes)), supports)

    def _settling(self, responses: _Responses) -> int:
        """Return the steps that a wheel let go on smooth rail needs: as many as usual, more on little damping."""
        memory, usual = responses.rows.shape[1], int(np.ceil(LEAD_IN_S / responses.dt))
        for steps in (usual, 4 * usual, 10 * usual):
            columns = np.empty((memory + steps + responses.grid, 3))
            _convolution.passage_by_convolution(
                responses.rows, responses.nodes, responses.weights, unchanged(memory), 0, memory,
                np.zeros(len(columns)), self._physics, responses.dt, columns,
            )  # fmt: skip
            force = columns[memory:, 0]
            change = np.abs(force[responses.grid :] - force[: -responses.grid])
            unsettled = np.flatnonzero(change > _SETTLED * self.wheel.static_load_n)
            if len(unsettled) == 0 or unsettled[-1] < usual - responses.grid:
                return usual
        return int(unsettled[-1]) + responses.grid


class _Spectrum:
    """The track's waves and the pulse's weight at every frequency of the sum, zero included.

    Attributes:
        at_rest: the track whose waves stand for those at zero, where loss does not act.
    """

    def __init__(self, track: Track, dt: float, threads: int | None) -> None:
        self.track, self.dt = track, dt
        self.alpha = _WINDOW / MEMORY_S if track.causal else 0.0
        moving = 2 * np.pi * np.arange(1, int(BAND_HZ * MEMORY_S) + 1) / MEMORY_S
        self.omega = np.append(0.0, moving)
        moving_omega = moving - 1j * self.alpha
        self._moving = beam.waves(track, moving_omega, threads=threads)
        if self.alpha == 0.0:
            resting_omega: FloatArray | ComplexArray = beam.STATIC_OMEGA
            self.at_rest, self._resting = track.undamped(), beam.static_waves(track, threads=threads)
        else:
            resting_omega = np.array([-1j * self.alpha])
            self.at_rest = replace(track, rail=replace(track.rail, loss_factor=0.0))
            self._resting = beam.waves(self.at_rest, resting_omega, threads=threads)
        self.multiplier = np.concatenate([self._resting.multiplier, self._moving.multiplier], axis=1)
        self.strength = np.concatenate([self._resting.strength, self._moving.strength], axis=1)
        taper = np.clip((BAND_HZ - self.omega / (2 * np.pi)) / (0.2 * BAND_HZ), 0.0, 1.0)
        sides = np.where(self.omega == 0.0, 1.0, 2.0)
        triangle = np.sinc(self.omega * dt / (2 * np.pi)) ** 2
        self.pulse = sides * dt / MEMORY_S * triangle * (0.5 - 0.5 * np.cos(np.pi * taper))
        self.transform = Spectrum(
            self._resting, self._moving, resting_omega, moving_omega, self.pulse, self.alpha, MEMORY_S
        )

    def shape(self, x_m: FloatArray) -> ComplexArray:
        return np.concatenate([self._resting.shape(x_m), self._moving.shape(x_m)], axis=2)

    def jump(self, lag: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the response to the pulse of a / (i omega + b), a the jump: as the sum has it, and exact."""
        a, b = beam.velocity_jump(self.track.rail), _JUMP_DECAY_RAD_S
        terms = self.pulse * a / (1j * self.omega + self.alpha + b)
        in_band = np.array([(np.exp(1j * self.omega * t) @ terms).real for t in lag])
        z = b * self.dt
        exact = 2 * a * np.exp(-b * lag) * (np.cosh(z) - 1) / (b * z)
        exact[0] = a * (z - 1 + np.exp(-z)) / (b * z)  # the pulse's first half
        return in_band, exact


def _peak(passage: _Passage, dt: float) -> tuple[float, float, float, float]:
    """Return the peak force, its place, least force and contact loss."""
    force = passage.columns[:, 0]
    n = int(np.argmax(force[1:-1])) + 1
    before, top, after = force[n - 1 : n + 2]
    curvature = before - 2 * top + after
    offset = 0.5 * (before - after) / curvature if curvature < 0 else 0.0
    place = passage.x_m[n] + offset * (passage.x_m[1] - passage.x_m[0])
    loss = float(np.count_nonzero(force == 0.0) * dt)
    return float(top - 0.25 * (before - after) * offset), float(place), float(force.min()), loss


def _greatest_low_passed(passage: _Passage, dt: float) -> FloatArray:
    """Return the greatest low-passed forces, (n_filter,)."""
    return np.asarray(lowpass.low_passed(passage.force_n, dt)[:, -len(passage.x_m) :].max(axis=1))


def _parts(values: ComplexArray) -> tuple[FloatArray, FloatArray]:
    return np.ascontiguousarray(values.real), np.ascontiguousarray(values.imag)


def _interpolation(grid: int, every: int, node_count: int) -> tuple[NDArray[np.int64], FloatArray]:
    """Return four nodes and their Lagrange weights for each grid point, all of the point's own span."""
    if node_count == 1:
        return np.zeros((grid, 1), dtype=np.int64), np.ones((grid, 1))
    nodes, weights = cubic_weights(np.arange(grid) / every, node_count)
    return nodes % node_count, weights
