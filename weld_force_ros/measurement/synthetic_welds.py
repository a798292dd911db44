"""A synthetic population of rail welds, seeded: geometries in their hundreds, where measured ones are not public.

Each weld is read by a straightedge of 1 m, level at both ends, and is the sum of

- a main wave: a dip or a protrusion of one cosine wave, whose two flanks may differ in length,
- a ramp early in the metre, with a long way back: one rail's end stands higher than the other's,
- an angular misalignment: the rails' ends make a peak or a dip over the whole metre,
- short waves of random phase, left by the grinder,

and a random one in two is run over from the other side. What is drawn is stated in `STATISTICS`. The ranges are
assumptions, set to what one reads of welds before and after finishing; they are fitted to no network, and no force was
looked at to choose them. Two in five welds are made as dips, two in five as protrusions, one in five is ground smooth,
with either sign. How a weld was made is not its class: that is for
`weld_force_ros.physics.analysis.geometry.classify` to say.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from weld_force_ros.errors import InputError
from weld_force_ros.measurement.shapes import STRAIGHTEDGE_LENGTH_M, Array, cosine_dip, ramp

Making = Literal["dip", "protrusion", "ground"]

MAKING_SHARES: Mapping[Making, float] = {"dip": 0.4, "protrusion": 0.4, "ground": 0.2}
SPACING_M = 2e-3

_SHORT_WAVES = 12
_RAMP_ENDS_M = 0.45  # where its long way back ends, from the weld's centre
_TAPER_M = 0.05  # over which short waves fade at the ends


@dataclass(frozen=True)
class LogNormal:
    """A quantity whose logarithm is normal: its median, and the standard deviation of its natural logarithm."""

    median: float
    deviation: float

    def drawn(self, generator: np.random.Generator) -> float:
        """Return one value."""
        return float(self.median * np.exp(self.deviation * generator.standard_normal()))


@dataclass(frozen=True)
class Uniform:
    """A quantity that may be anything between two bounds."""

    low: float
    high: float

    def drawn(self, generator: np.random.Generator) -> float:
        """Return one value."""
        return float(generator.uniform(self.low, self.high))


@dataclass(frozen=True)
class Statistics:
    """The distributions that welds are drawn from; `Parameters` says what each parameter means."""

    amplitude_m: LogNormal
    wavelength_m: Uniform
    asymmetry: Uniform
    centre_m: Uniform
    ramp_m: Uniform
    ramp_length_m: Uniform
    misalignment_m: Uniform
    roughness_m: LogNormal


AS_WELDED = Statistics(
    amplitude_m=LogNormal(0.12e-3, 0.5),
    wavelength_m=Uniform(0.08, 0.50),
    asymmetry=Uniform(-0.8, 0.8),
    centre_m=Uniform(-0.05, 0.05),
    ramp_m=Uniform(-0.05e-3, 0.05e-3),
    ramp_length_m=Uniform(0.05, 0.20),
    misalignment_m=Uniform(-0.05e-3, 0.05e-3),
    roughness_m=LogNormal(4e-6, 0.5),
)
GROUND_SMOOTH = replace(
    AS_WELDED,
    amplitude_m=LogNormal(0.03e-3, 0.5),
    ramp_m=Uniform(-0.015e-3, 0.015e-3),
    misalignment_m=Uniform(-0.02e-3, 0.02e-3),
    roughness_m=LogNormal(2e-6, 0.5),
)
STATISTICS: Mapping[Making, Statistics] = {"dip": AS_WELDED, "protrusion": AS_WELDED, "ground": GROUND_SMOOTH}
SHORT_WAVELENGTH_M = Uniform(0.02, 0.10)


@dataclass(frozen=True)
class Parameters:
    """Parameters of a synthetic weld.

    Attributes:
        making: what it was made as.
        height_m: of the main wave, negative for a dip; its size is the amplitude.
        wavelength_m: length of the main wave.
        asymmetry: difference of its flanks over their sum; negative if the first is the shorter and steeper one.
        centre_m: middle of the main wave from the weld's centre.
        ramp_m: height of the ramp, negative downwards.
        ramp_length_m: of its steep part.
        misalignment_m: height of the peak, negative for a dip, that the rails' angle makes in the metre.
        roughness_m: expected RMS of the short waves.
        reversed: whether the whole weld is run over from the other side.
    """

    making: Making
    height_m: float
    wavelength_m: float
    asymmetry: float
    centre_m: float
    ramp_m: float
    ramp_length_m: float
    misalignment_m: float
    roughness_m: float
    reversed: bool


@dataclass(frozen=True)
class SyntheticWeld:
    """A weld of a population: positions from its centre and heights, positive up, each (n,)."""

    weld_id: str
    x_m: Array
    z_m: Array
    parameters: Parameters


def population(count: int, seed: int) -> Iterator[SyntheticWeld]:
    """Yield synthetic welds; weld k of a seed is the same in a population of any size.

    Raises:
        InputError: a negative count or seed.
    """
    if count < 0 or seed < 0:
        raise InputError(f"{count} welds of seed {seed} cannot be made", "give whole numbers from 0 on")
    return (_weld(number, seed) for number in range(count))


def without_short_waves(weld: SyntheticWeld) -> SyntheticWeld:
    """Return the same weld as a grinder that leaves no waves would have left it."""
    smooth = replace(weld.parameters, roughness_m=0.0)
    return replace(weld, z_m=_long_waves(weld.x_m, smooth), parameters=smooth)


def _weld(number: int, seed: int) -> SyntheticWeld:
    generator = np.random.default_rng([seed, number])
    parameters = _parameters(generator)
    half_m = STRAIGHTEDGE_LENGTH_M / 2
    x = np.linspace(-half_m, half_m, round(STRAIGHTEDGE_LENGTH_M / SPACING_M) + 1)
    z = _long_waves(x, parameters) + parameters.roughness_m * _short_waves(x, generator)
    return SyntheticWeld(f"synthetic-{seed}-{number:05d}", x, z, parameters)


def _parameters(generator: np.random.Generator) -> Parameters:
    making = list(MAKING_SHARES)[int(generator.choice(len(MAKING_SHARES), p=list(MAKING_SHARES.values())))]
    upwards = {"dip": -1.0, "protrusion": 1.0, "ground": 1.0 - 2.0 * int(generator.integers(2))}[making]
    statistics = STATISTICS[making]
    return Parameters(
        making=making,
        height_m=upwards * statistics.amplitude_m.drawn(generator),
        wavelength_m=statistics.wavelength_m.drawn(generator),
        asymmetry=statistics.asymmetry.drawn(generator),
        centre_m=statistics.centre_m.drawn(generator),
        ramp_m=statistics.ramp_m.drawn(generator),
        ramp_length_m=statistics.ramp_length_m.drawn(generator),
        misalignment_m=statistics.misalignment_m.drawn(generator),
        roughness_m=statistics.roughness_m.drawn(generator),
        reversed=bool(generator.integers(2)),
    )


def _long_waves(x: Array, p: Parameters) -> Array:
    x = -x if p.reversed else x
    top_m = p.centre_m + p.asymmetry * p.wavelength_m / 2
    begin_m, end_m = p.centre_m - p.wavelength_m / 2, p.centre_m + p.wavelength_m / 2
    main = ramp(x, begin_m, top_m, p.height_m) - ramp(x, top_m, end_m, p.height_m)
    ramp_ends_m = p.ramp_length_m - _RAMP_ENDS_M
    ramped = ramp(x, -_RAMP_ENDS_M, ramp_ends_m, p.ramp_m) - ramp(x, ramp_ends_m, _RAMP_ENDS_M, p.ramp_m)
    return np.asarray(main + ramped + cosine_dip(x, STRAIGHTEDGE_LENGTH_M, -p.misalignment_m))


def _short_waves(x: Array, generator: np.random.Generator) -> Array:
    """Return waves of equal amplitude with an expected RMS of 1, faded to zero at both ends."""
    wavelengths = generator.uniform(SHORT_WAVELENGTH_M.low, SHORT_WAVELENGTH_M.high, _SHORT_WAVES)
    phases = generator.uniform(0, 2 * np.pi, _SHORT_WAVES)
    waves = np.sin(2 * np.pi * x[:, None] / wavelengths + phases).sum(axis=1) * np.sqrt(2 / _SHORT_WAVES)
    fade = ramp(x, x[0], x[0] + _TAPER_M, 1.0) - ramp(x, x[-1] - _TAPER_M, x[-1], 1.0)
    return np.asarray(waves * fade)
