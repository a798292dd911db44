"""Turn a record's samples into the geometry of a weld: as they are, or estimated from them with their noise."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import Any

import numpy as np
from msgspec import UNSET

from weld_force_ros.errors import ProfileError
from weld_force_ros.measurement import noise, plausibility
from weld_force_ros.measurement.centre import chosen_centre, levelled
from weld_force_ros.measurement.instruments import InstrumentError
from weld_force_ros.measurement.numbers import in_metres, number
from weld_force_ros.measurement.record import Record
from weld_force_ros.measurement.statements import Stated, stated_number
from weld_force_ros.messages import FormError, MeasurementNoise
from weld_force_ros.physics.arrays import FloatArray

_RESOLUTION_M = Decimal("1e-12")
_ESTIMATE_DECIMALS = 9
_AS_THEY_ARE = {"noise": MeasurementNoise(method="none", noise_m=0.0)}


@dataclass
class Geometry:
    """A weld's geometry about its centre, as messages hold it.

    Attributes:
        x_m: positions, 0 at the weld's centre.
        z_m: heights.
        centre: of the weld, where the record has it, in m.
        done: what was done to the samples, a line each.
        measured: fields of the message about the samples as measured.
    """

    x_m: list[float]
    z_m: list[float]
    centre: Decimal
    done: list[str]
    measured: dict[str, Any]


def _converted(header: Mapping[str, Stated]) -> str:
    turned = "" if header["z_positive"].text == "up" else ", z turned positive up"
    return f"x converted from {header['x_unit'].text} and z from {header['z_unit'].text} to m{turned}"


def _repeatability_m(mended: Record, x_m: FloatArray) -> float | None:
    """Return the standard deviation of one pass about the mean of all, level and tilt apart; None of a single pass."""
    heights = np.array([[float(z or 0) for z in sample.z] for sample in mended.samples])
    passes = heights.shape[1]
    if passes == 1:
        return None
    apart = heights - heights.mean(axis=1, keepdims=True)
    apart -= np.column_stack([np.polyval(np.polyfit(x_m, column, 1), x_m) for column in apart.T])
    return float(np.sqrt((apart**2).sum() / ((len(x_m) - 2) * (passes - 1))))


def _heights(mended: Record, header: Mapping[str, Stated]) -> list[Decimal]:
    """Return the heights positive up; of several passes the mean."""
    sign = 1 if header["z_positive"].text == "up" else -1
    heights = [[z for z in sample.z if z is not None] for sample in mended.samples]
    return [sign * sum(of_all[1:], of_all[0]) / len(of_all) for of_all in heights]  # 0 + -0 would not be -0


def exact(mended: Record, header: Mapping[str, Stated]) -> Geometry:
    """Take the samples as they are: sign, line, centre, in exact decimals."""
    x, z = [sample.x for sample in mended.samples], _heights(mended, header)
    x_m = np.array(x, dtype=np.float64)
    centre, origin = _centre(x, header, x_m, levelled(x_m, np.array(z, dtype=np.float64)))
    done = [_converted(header), f"centred on x = {float(centre):.12g} m, {origin}"]
    if "detrend" in header and header["detrend"].text == "none":
        done.append("not detrended, as stated")
        if origin == "as stated" and centre == 0:
            return Geometry([float(v) for v in x], [float(v) for v in z], centre, done, _AS_THEY_ARE)
    else:
        z, line = _without_line(x, z)
        done.append(line)
    done.append("rounded to 1e-12 m")
    return Geometry([_rounded(v - centre) for v in x], [_rounded(v) for v in z], centre, done, _AS_THEY_ARE)


def estimated(mended: Record, header: Mapping[str, Stated], error: InstrumentError | None = None) -> Geometry:
    """Estimate the geometry from the samples: wrong ones set aside, noise taken out, levelled between the ends.

    Args:
        mended: the record.
        header: what is stated of it.
        error: of the instrument's form, which stays in the geometry.

    Raises:
        ProfileError: the samples are not those of a rail.
    """
    x = [sample.x for sample in mended.samples]
    units = {"x_unit": header["x_unit"].text, "z_unit": header["z_unit"].text}
    x_m, raw_m = np.array(x, dtype=np.float64), np.array([float(v) for v in _heights(mended, header)])
    origin_m = x_m[0]
    plausibility.check_measured(x_m, raw_m, **units)
    noise_m = _stated_noise_m(header)
    done = [_converted(header)]
    if repeatability_m := _repeatability_m(mended, x_m - origin_m):
        passes = len(mended.samples[0].z)
        done.append(f"{passes} passes averaged, repeatability {repeatability_m * 1e6:.2g} um")
        noise_m = noise_m or repeatability_m / passes**0.5
    resolution_m = float(_written_step(mended) or 0)
    estimate = noise.estimate(x_m - origin_m, raw_m, resolution_m=resolution_m, noise_m=noise_m)
    grid_m, z_m = estimate.x_m + origin_m, estimate.z_m
    done += estimate.notes
    level = np.zeros_like(z_m), np.zeros_like(raw_m)
    if "detrend" in header and header["detrend"].text == "none":
        done.append("not detrended, as stated")
    else:
        slope = (z_m[-1] - z_m[0]) / (grid_m[-1] - grid_m[0])
        level = z_m[0] + slope * (grid_m - grid_m[0]), z_m[0] + slope * (x_m - grid_m[0])
        done.append(f"line between the ends removed: {z_m[0] * 1e6:.6g} um at the start, slope {slope * 1e3:.6g} mm/m")
    z_m, measured_m = z_m - level[0], raw_m - level[1]
    plausibility.check_estimate(grid_m, z_m, **units)
    centre, origin = _centre(x, header, grid_m, z_m)
    done.insert(1, f"centred on x = {float(centre):.12g} m, {origin}")

    def about_centre(values: Any) -> list[float]:
        return [round(float(v), _ESTIMATE_DECIMALS) + 0.0 for v in values - float(centre)]

    about = MeasurementNoise(
        method=noise.METHOD,
        noise_m=round(estimate.noise_m, 10),
        stated=noise_m is not None,
        resolution_m=resolution_m or UNSET,
        outliers_m=about_centre(estimate.outliers_m + origin_m),
        form_error=UNSET
        if error is None
        else FormError(deviation_m=error.deviation, length_m=error.length, source=error.source),
    )
    measured = {
        "measured_x_m": about_centre(x_m),
        "measured_z_m": [round(float(v), 12) + 0.0 for v in measured_m],
        "noise": about,
    }
    z = [round(float(v), _ESTIMATE_DECIMALS) + 0.0 for v in z_m]
    return Geometry(about_centre(grid_m), z, centre, done, measured)


def _stated_noise_m(header: Mapping[str, Stated]) -> float | None:
    """Return the standard deviation of the noise as stated; None if it is to be estimated."""
    stated = header.get("noise")
    if stated is None or stated.text == "auto":
        return None
    noise_m = stated_number(stated, "noise")
    if noise_m <= 0:
        raise ProfileError(f"{stated.where}noise {noise_m:g}", "state auto, none, or metres such as 5e-6")
    return noise_m


def _centre(x: list[Decimal], header: Mapping[str, Stated], x_m: FloatArray, z_m: FloatArray) -> tuple[Decimal, str]:
    """Return the weld's centre as stated, or as it is chosen; the record's middle exactly."""
    if "centre" not in header:
        centre_m, origin = chosen_centre(x_m, z_m)
        exact = (x[0] + x[-1]) / 2 if "middle" in origin else Decimal(repr(centre_m))
        return exact, origin
    text, where = header["centre"]
    centre = in_metres(number(text, where + "centre"), header["x_unit"].text, where + "centre")
    if not min(x) <= centre <= max(x):
        raise ProfileError(
            f"{where}centre {text} lies outside the samples",
            f"state the weld's centre in x_unit ({header['x_unit'].text}), within the measured range",
        )
    return centre, "as stated"


def _written_step(mended: Record) -> Decimal | None:
    """Return the step in which heights were written: the largest that all of them are multiples of."""
    heights = [z for sample in mended.samples if sample.texts for z in sample.z if z is not None]
    scale = max((-int(z.as_tuple().exponent) for z in heights), default=0)
    step = math.gcd(*(abs(int(z.scaleb(scale))) for z in heights)) if heights else 0
    return Decimal(step).scaleb(-scale) if step else None


def _without_line(x: list[Decimal], z: list[Decimal]) -> tuple[list[Decimal], str]:
    """Return the heights less the line between the two ends, and what was done."""
    if len(x) < 2:
        return z, "not detrended"  # so few are refused with the bounds
    run, rise = x[-1] - x[0], z[-1] - z[0]
    offset_um, slope_mm_per_m = float(z[0]) * 1e6, float(rise / run) * 1e3
    line = f"line between the ends removed: {offset_um:.6g} um at the start, slope {slope_mm_per_m:.6g} mm/m"
    return [height - z[0] - rise * (at - x[0]) / run for at, height in zip(x, z, strict=True)], line


def _rounded(metres: Decimal) -> float:
    return float(metres.quantize(_RESOLUTION_M)) + 0.0  # no negative zero: it would change the hash
