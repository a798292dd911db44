"""A sleeper that bends: a free beam on its bed, loaded alike by both rails, as each of them feels it.

The response to two forces is that of the infinite beam and two waves more, even about the middle, that leave the ends
free of moment and shear force: closed form (Grassie & Cox, Proc. Inst. Mech. Eng. 198D (1984) 117, of sleepers as
Timoshenko beams; Thompson, "Railway Noise and Vibration", 2nd ed. 2024, ch. 3).
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.track.timoshenko import BeamWaves, TimoshenkoBeam

Bed = Literal["spread", "seats"]


@dataclass(frozen=True)
class BendingSleeper:
    """A sleeper of one cross-section.

    Attributes:
        beam: its section and material.
        length_m: from end to end.
        seats_m: from rail seat to rail seat.
        bed: whether what it rests on is spread along it, or stands below the seats.
    """

    beam: TimoshenkoBeam
    length_m: float
    seats_m: float
    bed: Bed = "spread"

    @property
    def half_mass_kg(self) -> float:
        """Return the mass under one rail."""
        return self.beam.mass_kg_per_m * self.length_m / 2

    def undamped(self) -> "BendingSleeper":
        """Return it without loss."""
        return replace(self, beam=replace(self.beam, loss_factor=0.0))

    def stiffness_at_seat(self, below: ComplexArray, omega: FloatArray | ComplexArray) -> ComplexArray:
        """Return the dynamic stiffness at a rail seat as both rails load it, N/m.

        Args:
            below: (n_frequency,), dynamic stiffness of its bed under one rail, N/m.
            omega: (n_frequency,), rad/s, not zero where it has no bed.
        """
        spread = self.bed == "spread"
        waves = BeamWaves(self.beam, omega, 2 * below / self.length_m if spread else 0.0)
        decay, strength, curvature = waves.decay, waves.strength, waves.curvature
        end, seat = self.length_m / 2, self.seats_m / 2
        # Even waves exp(-k (end - x)) + exp(-k (end + x)), which both forces send to an end, too.
        at_seat = np.exp(-decay * (end - seat)) + np.exp(-decay * (end + seat))
        met, round_trip = strength * at_seat, np.exp(-2 * decay * end)
        moment, shear = curvature * (1 + round_trip), (1 - round_trip) / decay
        moment_met, shear_met = (curvature * met).sum(axis=0), (met / decay).sum(axis=0)
        back = np.stack(
            [-moment_met * shear[1] - shear_met * moment[1], moment_met * shear[0] + shear_met * moment[0]]
        ) / (moment[0] * shear[1] - moment[1] * shear[0])
        receptance = (strength * (1 + np.exp(-2 * decay * seat)) + back * at_seat).sum(axis=0)
        return np.asarray(1 / receptance if spread else 1 / receptance + below)
