"""The figures that the physics must reach, each with its target: `python -m benchmarks.physics` prints them."""

import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.signal import find_peaks

from weld_force_ros.measurement.shapes import cosine_dip
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.peak_map import PeakMap
from weld_force_ros.physics.passage.wheel_path import WheelPath, wheel_path_over
from weld_force_ros.physics.track.beam import pinned_pinned_hz, receptance, static_compliance
from weld_force_ros.simulation import fit_store, track_file

SPEEDS_KMH = np.arange(20.0, 301.0)


@dataclass(frozen=True)
class Figure:
    """A number of physics.md and the range it has to lie in."""

    name: str
    compute: Callable[[], float]
    least: float
    most: float
    unit: str

    def ok(self, measured: float) -> bool:
        return self.least <= measured <= self.most


@cache
def _definition(name: str) -> track_file.TrackDefinition:
    return track_file.load(name)


def _vehicle_track(track: str, **wheel: float) -> VehicleTrackModel:
    definition = _definition(track)
    return VehicleTrackModel(fit_store.fitted(definition).model(), replace(definition.wheel, **wheel))


def _cosine(length_m: float, depth_m: float) -> WheelPath:
    x = np.linspace(-length_m / 2, length_m / 2, round(length_m / 0.5e-3) + 1)
    return wheel_path_over(x, cosine_dip(x, length_m, depth_m), 0.45)


@cache
def _on_continuous(length_m: float, depth_m: float, hertz_n_per_m15: float = 93.7e9) -> PeakMap:
    vehicle_track = _vehicle_track("bilbao-continuous", hertz_n_per_m15=hertz_n_per_m15)
    return vehicle_track.peak_map(_cosine(length_m, depth_m), SPEEDS_KMH, [0.0])


def first_maximum_kmh(length_m: float) -> float:
    """Return the speed of the first local maximum of the peak force over a 40 um dip."""
    return float(SPEEDS_KMH[find_peaks(_on_continuous(length_m, 40e-6).peak_force_n[:, 0])[0][0]])


def first_kink_kmh(length_m: float) -> float:
    """Return the speed at which another peak becomes the largest, more than a tenth of the dip away."""
    jumps = np.abs(np.diff(_on_continuous(length_m, 40e-6).peak_x_m[:, 0])) > length_m / 10
    return float(SPEEDS_KMH[np.argmax(jumps)]) + 0.5


def least_rise_of_inverted_dip_n() -> float:
    """Return the smallest step of the peak force from one km/h to the next over a 48 mm rise."""
    return float(np.diff(_on_continuous(0.048, -40e-6).peak_force_n[:, 0]).min())


def hertz_change_percent() -> float:
    """Return the largest change of peak force, % of static load, between Hertz 50 and 100, 20 to 250 km/h."""
    soft, hard = (_on_continuous(0.048, 40e-6, hertz).peak_force_n[:, 0] for hertz in (50e9, 100e9))
    change = np.abs(hard - soft)[SPEEDS_KMH <= 250.0].max()
    return float(100.0 * change / _definition("bilbao-continuous").wheel.static_load_n)


@cache
def _flat_envelope() -> np.ndarray:
    """Return the largest force of 15 positions over speed: the 0.9 mm flat on johansson-nielsen."""
    positions = np.arange(15) * _definition("johansson-nielsen").track.spacing_m / 15
    peak_map = _vehicle_track("johansson-nielsen").peak_map(_cosine(0.100, 0.9e-3), SPEEDS_KMH[:181:2], positions)
    return peak_map.peak_force_n.max(axis=1)


def flat_maximum_kmh() -> float:
    envelope = _flat_envelope()
    return float(SPEEDS_KMH[:181:2][find_peaks(envelope, prominence=5e3)[0][0]])


def flat_minimum_kmh() -> float:
    envelope = _flat_envelope()
    return float(SPEEDS_KMH[:181:2][find_peaks(-envelope, prominence=5e3)[0][0]])


def static_stiffness_mn_per_m(track: str, share_of_span: float) -> float:
    definition = _definition(track)
    return float(1e-6 / static_compliance(definition.track, [share_of_span * definition.track.spacing_m])[0])


def wheel_on_track_peak_hz(which: int) -> float:
    """Return the receptance of the wheel's mass on `bilbao` at mid-span: |1 / (1/h - M w^2)|."""
    definition = _definition("bilbao")
    frequency = np.arange(20.0, 600.0)
    h = receptance(definition.track, frequency, [definition.track.spacing_m / 2])[0]
    coupled = np.abs(1 / (1 / h - definition.wheel.mass_kg * (2 * np.pi * frequency) ** 2))
    return float(frequency[find_peaks(coupled)[0][which]])


def least_shift_of_smooth_rail_peak_mm() -> float:
    """Return the least shift of smooth rail's largest force in the span, from one speed to the next."""
    peak_map = _vehicle_track("bilbao").peak_map(WheelPath(0.0, np.zeros(9)), np.arange(20.0, 161.0, 10.0), [0.0])
    return float(1e3 * np.diff(np.mod(peak_map.peak_x_m[:, 0], _definition("bilbao").track.spacing_m)).min())


def _within(name: str, target: float, tolerance: float, unit: str, compute: Callable[..., float], *args) -> Figure:
    return Figure(name, lambda: compute(*args), target - tolerance, target + tolerance, unit)


FIGURES = (
    _within("pinned-pinned, 0.60 m", 1067, 5, "Hz", lambda: pinned_pinned_hz(_definition("bilbao").track)),
    _within("pinned-pinned, 0.65 m", 939, 5, "Hz", lambda: pinned_pinned_hz(_definition("johansson-nielsen").track)),
    *(
        _within(f"static stiffness, {track}, {place}", k, k / 100, "MN/m", static_stiffness_mn_per_m, track, share)
        for track, place, share, k in (
            ("bilbao", "over sleeper", 0.0, 107.0),
            ("bilbao", "mid-span", 0.5, 103.1),
            ("johansson-nielsen", "over sleeper", 0.0, 135.1),
            ("johansson-nielsen", "mid-span", 0.5, 126.9),
        )
    ),
    _within("wheel on track, first peak", 60, 6, "Hz", wheel_on_track_peak_hz, 0),
    _within("wheel on track, second peak", 240, 20, "Hz", wheel_on_track_peak_hz, 1),
    _within("48 mm dip, first maximum", 53, 1, "km/h", first_maximum_kmh, 0.048),
    _within("96 mm dip, first maximum", 107, 2, "km/h", first_maximum_kmh, 0.096),
    _within("48 mm dip, first kink", 74, 2, "km/h", first_kink_kmh, 0.048),
    _within("96 mm dip, first kink", 151, 3, "km/h", first_kink_kmh, 0.096),
    Figure("48 mm rise, least change per km/h", least_rise_of_inverted_dip_n, 0.0, np.inf, "N"),
    Figure("Hertz 50 to 100, largest change", hertz_change_percent, 5.0, 15.0, "%"),
    Figure("wheel flat, local maximum", flat_maximum_kmh, 35.0, 45.0, "km/h"),
    Figure("wheel flat, local minimum", flat_minimum_kmh, 70.0, 100.0, "km/h"),
    Figure("smooth rail, least peak shift per 10 km/h", least_shift_of_smooth_rail_peak_mm, 0.0, np.inf, "mm"),
)


def main() -> int:
    """Print every figure with its target; 1 if one is missed."""
    missed = 0
    for figure in FIGURES:
        measured = figure.compute()
        missed += not figure.ok(measured)
        target = f"{figure.least:g} to {figure.most:g} {figure.unit}"
        print(f"{figure.name:46}{measured:10.2f}   {target:26}{'ok' if figure.ok(measured) else 'MISSED'}")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
