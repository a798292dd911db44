"""Signs of a window's shapes beyond their nodes, by what a moving load finds.

A point receptance holds the square of a shape, and so not whether it changes its sign where it passes through zero: as
that of a rail does which rocks on two sleepers that hang, between them. The deflection under a constant load on its way
through the window does: it is made of transfer receptances, h(x, x - v t; t), t after the load was at x - v t.
"""

from dataclasses import dataclass, replace

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.engines.common_poles import PoleModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.track import beam, local_support
from weld_force_ros.physics.track.beam import Track
from weld_force_ros.physics.track.local_support import LocalSupports

SPEEDS_KMH = (100.0, 200.0, 300.0)
_A_SPAN, _SEARCHED_A_SPAN = 8, 64  # places where deflections are compared, and where nodes are looked for
_NEAR_SPANS = 2  # within which of the supports that differ deflections count
_BEHIND_SPANS = 3  # of the load, from which motion still comes
_PERIOD_S, _WINDOW = 0.125, 4.6  # of the sum over frequencies, as in `greens_function`
_PASSED_HZ = (150.0, 450.0)  # up to which motion counts whole, and above which none: the load takes 1 ms a place
_NODE = 0.15  # of a residue's greatest, below which its shape may have a node
_CLEARLY = 0.9  # of the error without, below which a sign is changed


def with_signs(model: PoleModel, track: Track, supports: LocalSupports, wheel: Wheel) -> PoleModel:
    """Return the model of a window with the signs of its shapes chosen by the deflection under a moving load.

    Args:
        model: of both ways; see `window_fit`.
        track: with its usual supports, without loss factors.
        supports: those that differ.
        wheel: which meets a deflection as it does an irregularity: by that errors are weighed.
    """
    load = _MovingLoad.over(track, supports)
    exact = load.deflection(load.receptance(track, supports))
    weight = load.weight(track, wheel)
    parts = np.stack([load.deflections(part) for part in load.parts(model)])

    def error(nodes: tuple[tuple[int, float], ...]) -> float:
        found = np.zeros_like(exact)
        for pole, part in enumerate(parts):
            signs = _signs([at for one, at in nodes if one == pole], load.at_m, load.there_m)
            found += (part * signs).sum(axis=2)
        spectrum = np.fft.rfft(found - exact, 2 * exact.shape[1], axis=1)
        return float(np.linalg.norm(spectrum * weight))

    nodes: tuple[tuple[int, float], ...] = ()
    least = error(nodes)
    for node in _possible_nodes(model, load.at_m):
        if (tried := error((*nodes, node))) < _CLEARLY * least:
            nodes, least = (*nodes, node), tried
    return replace(model, nodes=tuple(both for node in nodes for both in _both_ways(model, node)), _grids={})


def _signs(nodes_m: list[float], here_m: FloatArray, there_m: FloatArray) -> FloatArray:
    """Return -1 where an odd number of nodes lies between two places, else 1, (n_at, n_behind)."""
    passed = sum(((there_m < at) & (here_m[:, None] >= at) for at in nodes_m), np.zeros(there_m.shape, dtype=np.intp))
    return 1.0 - 2.0 * (passed % 2)


def _possible_nodes(model: PoleModel, at_m: FloatArray) -> list[tuple[int, float]]:
    """Return poles and places where the shape may change its sign, the deepest first."""
    place = np.arange(at_m[0], at_m[-1], model.spacing_m / _SEARCHED_A_SPAN)
    share = np.abs(model.residues_at(place)) / np.abs(model.residues).max(axis=0)
    low = (share[1:-1] <= share[:-2]) & (share[1:-1] < share[2:]) & (share[1:-1] < _NODE)
    found = [(share[row + 1, pole], int(pole), float(place[row + 1])) for row, pole in np.argwhere(low)]
    return [(pole, at) for _, pole, at in sorted(found)]


def _both_ways(model: PoleModel, node: tuple[int, float]) -> list[tuple[int, float]]:
    """Return a node and that of the mirror image, in one period."""
    pole, at = node
    return [(pole, place % model.period_m) for place in (at, model.opposite_m - at)]


@dataclass(frozen=True)
class _MovingLoad:
    """A unit load on its way, and the places behind it that it set in motion.

    Attributes:
        at_m: (n_at,), where it is looked at.
        there_m: (n_at, n_behind), where it was, in steps of `step_m`.
        step_m: from place to place.
        omega: (n_frequency,), rad/s, complex: motion dies out before the sum over frequencies repeats.
    """

    at_m: FloatArray
    there_m: FloatArray
    step_m: float
    omega: ComplexArray

    @classmethod
    def over(cls, track: Track, supports: LocalSupports) -> "_MovingLoad":
        step_m, places = track.spacing_m / _A_SPAN, supports.places_m(track)
        around_m = _NEAR_SPANS * track.spacing_m
        at = np.arange(places[0] - around_m, places[-1] + around_m + step_m / 2, step_m)
        there = at[:, None] - step_m * np.arange(_BEHIND_SPANS * _A_SPAN)
        frequency = np.arange(int(_PASSED_HZ[1] * _PERIOD_S) + 1) / _PERIOD_S
        return cls(at, there, step_m, 2 * np.pi * frequency - 1j * _WINDOW / _PERIOD_S)

    def receptance(self, track: Track, supports: LocalSupports) -> ComplexArray:
        """Return the exact receptance at the load to a force where it was, (n_at, n_behind, n_frequency)."""
        here, there = np.broadcast_arrays(self.at_m[:, None], self.there_m)
        waves = beam.waves(track, self.omega)
        found = local_support.response(track, supports, waves, self.omega, here.ravel(), there.ravel())
        return found.reshape(*there.shape, -1)

    def parts(self, model: PoleModel) -> ComplexArray:
        """Return the same of each pole of a model, (n_pole, n_at, n_behind, n_frequency)."""
        here, there = model.shapes_at(self.at_m), model.shapes_at(self.there_m.ravel())
        residues = 0.5 * model.pair_weight * here[:, None] * there.reshape(*self.there_m.shape, -1)
        poles, residues = model.poles_rad_s[:, None, None, None], np.moveaxis(residues, -1, 0)[..., None]
        s = 1j * self.omega
        return np.asarray(residues / (s - poles) + residues.conj() / (s - poles.conj()))

    def deflections(self, receptance: ComplexArray) -> FloatArray:
        """Return the deflection at the load by what it did at each place, (n_speed, n_at, n_behind), m/N."""
        frequency = self.omega.real / (2 * np.pi)
        passed = np.clip((_PASSED_HZ[1] - frequency) / (_PASSED_HZ[1] - _PASSED_HZ[0]), 0.0, 1.0)
        sides = np.where(frequency == 0.0, 1.0, 2.0) * passed / _PERIOD_S
        share = np.full(self.there_m.shape[1], self.step_m)
        share[0] /= 2  # what it does where it is acts from now on
        found = []
        for speed_m_s in np.array(SPEEDS_KMH) / 3.6:
            after_s = self.step_m * np.arange(len(share)) / speed_m_s
            turned = np.exp(1j * np.outer(after_s, self.omega)) * sides
            found.append(np.einsum("abf,bf->ab", receptance, turned).real * share / speed_m_s)
        return np.stack(found)

    def deflection(self, receptance: ComplexArray) -> FloatArray:
        """Return the deflection at the load, (n_speed, n_at), m/N."""
        return np.asarray(self.deflections(receptance).sum(axis=2))

    def weight(self, track: Track, wheel: Wheel) -> FloatArray:
        """Return the force by a deflection of each wavelength, (n_speed, n_at + 1), N/m."""
        waves_per_m = np.fft.rfftfreq(2 * len(self.at_m), self.step_m)
        found = []
        for speed_m_s in np.array(SPEEDS_KMH) / 3.6:
            frequency = np.maximum(speed_m_s * waves_per_m, 1.0)
            seen = beam.receptance(track, frequency, [track.spacing_m / 4])[0] + wheel.compliance(2 * np.pi * frequency)
            found.append(1 / np.abs(seen))
        return np.stack(found)
