"""A few supports that differ from those of an otherwise periodic track, exactly: hanging sleepers, missing ones, pads.

What a support holds more or less than the track's is a spring of complex dynamic stiffness dK between rail and ground.
Such springs at places S change the receptance between any two points by a term of low rank,

    h'(x, x') = h(x, x') - h(x, S) R h(S, x'),    R = [1 + dK h(S, S)]^-1 dK,

with transfer receptances h of the periodic track (Sherman, Morrison & Woodbury; in this field e.g. Nordborg, Acta
Acustica 84 (1998) 854). A missing support is no special case: dK is then minus the whole support.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track import beam
from weld_force_ros.physics.track.beam import Track, Waves
from weld_force_ros.physics.track.support import Support


@dataclass(frozen=True)
class SupportChange:
    """One support as shares of the track's own.

    Attributes:
        sleeper: which; 0 is the last before the weld's centre, 1 the next, -1 the one before.
        below: share of the stiffness and damping beneath the sleeper; 0 hangs free.
        pad: share of the pad's; 0 is no support at all.
        gap_m: how far the sleeper comes down until it rests; 0: it always does. Receptances, being linear, are those
            of a sleeper that hangs free.
    """

    sleeper: int
    below: float = 1.0
    pad: float = 1.0
    gap_m: float = 0.0

    def on(self, support: Support) -> Support:
        """Return a support with the change; without ballast over a gap."""
        changed = support.with_lowest(0.0 if self.gap_m else self.below)
        return replace(changed, springs=(changed.pad.scaled(self.pad), *changed.springs[1:]))


@dataclass(frozen=True)
class LocalSupports:
    """Supports that differ from the track's, each sleeper once, in order along the rail."""

    changes: tuple[SupportChange, ...]

    @property
    def hanging(self) -> tuple[SupportChange, ...]:
        """Return those over a gap."""
        return tuple(change for change in self.changes if change.gap_m)

    @classmethod
    def of(cls, changes: Iterable[SupportChange]) -> "LocalSupports":
        """Return the changes in order along the rail."""
        return cls(tuple(sorted(changes, key=lambda change: change.sleeper)))

    @property
    def mirrored(self) -> "LocalSupports":
        """Return the supports as a train against rising x meets them: sleeper 1 is the last before the weld then."""
        return LocalSupports(tuple(replace(change, sleeper=1 - change.sleeper) for change in reversed(self.changes)))

    def places_m(self, track: Track) -> FloatArray:
        """Return where they are, (n_support,), m, 0 at sleeper 0."""
        return track.spacing_m * np.array([change.sleeper for change in self.changes], dtype=np.float64)

    def added_stiffness(self, track: Track, omega: FloatArray | ComplexArray) -> ComplexArray:
        """Return what each holds more than the track's support, (n_support, n_frequency), N/m."""
        usual = track.support.dynamic_stiffness(omega)
        return np.stack([change.on(track.support).dynamic_stiffness(omega) - usual for change in self.changes])

    def sleeper_responses(
        self, track: Track, waves: Waves, omega: FloatArray | ComplexArray, at_m: FloatArray
    ) -> tuple[ComplexArray, ComplexArray]:
        """Return how sleepers over a gap, on a pad and else free, move with the rail and with each other.

        Args:
            track: the track with its usual supports.
            waves: of that track at `omega`.
            omega: (n_frequency,), rad/s.
            at_m: (n_at,), points of the rail.

        Returns:
            (n_hanging, n_at, n_frequency), m/N: displacement of a sleeper by a force on the rail, and the reverse;
            (n_hanging, n_hanging, n_frequency), m/N: of a sleeper by a force on a sleeper.
        """
        reactions, places = self.reactions(track, waves, omega), self.places_m(track)
        rows = [self.changes.index(change) for change in self.hanging]
        own = places[rows]
        to_rail, to_each = responses_at(waves, places, at_m), responses_at(waves, places, own)
        taken = np.einsum("iaf,ijf->jaf", to_each, reactions)
        rail = responses_at(waves, own, at_m) - np.einsum("jaf,jbf->abf", taken, to_rail)
        each = responses_at(waves, own, own) - np.einsum("jaf,jbf->abf", taken, to_each)
        pad = np.stack([change.pad * track.support.pad.dynamic_stiffness(omega) for change in self.hanging])
        sleeper_kg = track.support.masses_kg[0]
        assert isinstance(sleeper_kg, float), "a sleeper over a gap is rigid"  # noqa: S101
        whole = pad - sleeper_kg * omega**2
        followed = pad / whole
        each = followed[:, None] * followed * each
        each[np.arange(len(rows)), np.arange(len(rows))] += 1 / whole
        return followed[:, None] * rail, each

    def reactions(self, track: Track, waves: Waves, omega: FloatArray | ComplexArray) -> ComplexArray:
        """Return R: forces on the rail, upwards positive as it goes down, per displacement that it would have without.

        Args:
            track: the track with its usual supports.
            waves: of that track at `omega`.
            omega: (n_frequency,), rad/s.

        Returns:
            (n_support, n_support, n_frequency), N/m.
        """
        places = self.places_m(track)
        between = np.stack([beam.response(waves, places, np.full(len(places), place)) for place in places], axis=1)
        added = self.added_stiffness(track, omega)
        one = np.eye(len(places))
        system = one + np.moveaxis(added[:, None] * between, -1, 0)
        return np.moveaxis(np.linalg.solve(system, np.moveaxis(added[:, None] * one[..., None], -1, 0)), 0, -1)


def receptance(track: Track, supports: LocalSupports, frequency_hz: ArrayLike, at_m: ArrayLike) -> ComplexArray:
    """Return the point receptance of the rail, m/N, (n_at, n_frequency); see `transfer_receptance`."""
    return transfer_receptance(track, supports, frequency_hz, at_m, at_m)


def transfer_receptance(
    track: Track, supports: LocalSupports, frequency_hz: ArrayLike, at_m: ArrayLike, force_at_m: ArrayLike
) -> ComplexArray:
    """Return the receptance of the rail at `at_m` to a force at `force_at_m`, m/N.

    Args:
        track: the track with its usual supports.
        supports: those that differ.
        frequency_hz: (n_frequency,), positive.
        at_m: (n_at,), metres, 0 at sleeper 0.
        force_at_m: (n_at,) or scalar, metres in the same coordinate.

    Returns:
        (n_at, n_frequency).
    """
    omega = 2 * np.pi * np.atleast_1d(np.asarray(frequency_hz, dtype=np.float64))
    at, force_at = np.broadcast_arrays(
        np.atleast_1d(np.asarray(at_m, dtype=np.float64)), np.asarray(force_at_m, dtype=np.float64)
    )
    return response(track, supports, beam.waves(track, omega), omega, at, force_at)


def static_compliance(track: Track, supports: LocalSupports, at_m: ArrayLike) -> FloatArray:
    """Return the deflection under a resting unit load, m/N, (n_at,), of the undamped track: no loss at rest."""
    at = np.atleast_1d(np.asarray(at_m, dtype=np.float64))
    still = track.undamped()
    return response(still, supports, beam.static_waves(track), beam.STATIC_OMEGA, at, at)[:, 0].real


def response(
    track: Track,
    supports: LocalSupports,
    waves: Waves,
    omega: FloatArray | ComplexArray,
    at_m: FloatArray,
    force_at_m: FloatArray,
) -> ComplexArray:
    """Return the receptance as `transfer_receptance`, at any frequencies of which the track's waves are known."""
    reactions = supports.reactions(track, waves, omega)
    here, there = (responses_at(waves, supports.places_m(track), x_m) for x_m in (at_m, force_at_m))
    whole = beam.response(waves, at_m, force_at_m) - np.einsum("iaf,ijf,jaf->af", here, reactions, there)
    return np.asarray(whole)


def responses_at(waves: Waves, places_m: FloatArray, at_m: FloatArray) -> ComplexArray:
    """Return the transfer receptances between places and points, m/N, (n_place, n_at, n_frequency)."""
    return np.stack([beam.response(waves, at_m, np.full(len(at_m), place)) for place in places_m])
