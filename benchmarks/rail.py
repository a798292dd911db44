"""Figures of the rail by finite strips: `python -m benchmarks.rail`."""

import time
from dataclasses import replace

import numpy as np

from tests.physics.track.test_cross_section import ROD_M, extension, flexure, rod, wavenumbers
from tests.physics.track.test_waveguide_rail import by_mesh, free_rail, with_strips
from weld_force_ros.cli import terminal
from weld_force_ros.physics.track import waveguide_rail
from weld_force_ros.physics.track.beam import free_decay, receptance, static_compliance
from weld_force_ros.physics.track.cross_section import rail_mesh
from weld_force_ros.physics.track.outline import outline
from weld_force_ros.simulation import section_file, track_file


def section_errors(name: str, refine: int) -> list[str]:
    found, standard = (
        rail_mesh(outline(section_file.load(name).dimensions), refine=refine),
        section_file.load(name).standard,
    )
    pairs = (
        (found.area_m2 * 1e4, standard.area_cm2), (found.centroid_m * 1e3, standard.centroid_mm),
        (found.second_moment_m4 * 1e8, standard.second_moment_cm4),
        (found.lateral_second_moment_m4 * 1e8, standard.lateral_second_moment_cm4),
    )  # fmt: skip
    return [f"{100 * (ours / its - 1):+.2f} %" for ours, its in pairs]


def rod_error(equation, frequency_hz: float) -> float:
    """Return the relative distance of the nearest wavenumber from the exact one, by bisection about it."""
    omega, best = 2 * np.pi * frequency_hz, np.inf
    for k in wavenumbers(rod(), frequency_hz):
        low, high = 0.99 * k, 1.01 * k
        if equation(low, omega) * equation(high, omega) < 0:
            for _ in range(60):
                middle = (low + high) / 2
                low, high = (middle, high) if equation(low, omega) * equation(middle, omega) > 0 else (low, middle)
            best = min(best, abs(k / low - 1))
    return best


def main() -> None:
    rows = [
        [f"{name}, {'as used' if refine == waveguide_rail.REFINE else 'refined'}", *section_errors(name, refine)]
        for name in section_file.shipped()
        for refine in (waveguide_rail.REFINE, 2 * waveguide_rail.REFINE)
    ]
    terminal.table(
        "Sections against the standard's numbers",
        [("section", ""), *((n, "right") for n in ("area", "centroid", "vertical I", "lateral I"))],
        rows,
    )
    bilbao = track_file.load("bilbao").track
    strips = with_strips(bilbao)
    hz = np.linspace(20, 300, 29)
    beam, ours = (
        np.nanmax(np.where(d.real < 1e-6 * np.abs(d), d.imag, np.nan), axis=0)
        for d in (free_decay(replace(one.rail, loss_factor=0.0), hz) for one in (bilbao, strips))
    )
    at, low = np.linspace(0, 0.3, 16), np.arange(5.0, 500.0, 2.5)
    apart = np.abs(receptance(strips, low, at) / receptance(bilbao, low, at) - 1)
    wide = np.abs(receptance(with_strips(bilbao, 0.15), low, at) / receptance(bilbao, low, at) - 1)
    static = static_compliance(strips, at) / static_compliance(bilbao, at) - 1
    high = np.arange(50.0, 3001.0, 25.0)
    coarse = receptance(strips, high, at)
    refined = {refine: np.abs(coarse / by_mesh(strips, high, at, refine) - 1).max() for refine in (8, 16)}
    waveguide_rail.rail.cache_clear()
    began = time.perf_counter()
    free_rail(strips)
    made = time.perf_counter() - began
    began = time.perf_counter()
    receptance(strips, np.linspace(5, 5000, 1000), np.arange(15) * 0.04)
    first = time.perf_counter() - began
    began = time.perf_counter()
    receptance(strips, np.linspace(5, 5000, 1000), np.arange(15) * 0.04)
    again = time.perf_counter() - began
    head, cross, foot = free_rail(strips).local_compliance
    terminal.table(
        "Finite strips",
        [("figure", ""), ("measured", "right")],
        [
            ("bending wave to 300 Hz against the beam's", f"{100 * np.abs(ours / beam - 1).max():.2f} %"),
            ("bilbao below 500 Hz against the beam, most over 16 positions", f"{100 * apart.max():.2f} %"),
            ("the same with pads of 15 cm", f"{100 * wide.max():.1f} %"),
            ("static, most", f"{100 * np.abs(static).max():.2f} %"),
            ("mesh refined once, to 3 kHz", f"{100 * refined[8]:.2f} %"),
            ("mesh refined twice, to 3 kHz", f"{100 * refined[16]:.2f} %"),
            *((f"rod of {2e3 * ROD_M:.0f} mm, {equation.__name__}, {f / 1e3:g} kHz",
               f"{100 * rod_error(equation, f):.3f} %")
              for equation in (extension, flexure) for f in (5e3, 20e3, 40e3)),
            ("15 sections x 1,000 frequencies: rail, receptances, again", f"{made:.1f} + {first:.1f} s, {again:.1f} s"),
            ("subtracted local compliance, head, cross, foot", f"{head:.3g}, {cross:.3g}, {foot:.3g} m/N"),
        ],
    )  # fmt: skip


if __name__ == "__main__":
    main()
