"""Turn messages into xarray Datasets: dimensions with units, and where every number comes from in the attributes."""

from typing import Any

import numpy as np
import xarray as xr
from msgspec import UnsetType

from weld_force_ros import SOFTWARE
from weld_force_ros.messages import (
    ForceHistory,
    ForceMap,
    OppositeDirection,
    SimulationSettings,
    SpeedCurve,
    UncertaintyResult,
    known,
)
from weld_force_ros.simulation.force_map_view import COLUMNS, force_curve, relevant_range

_QUANTITIES = {
    "peak_force_n": ("N", "peak force"),
    "peak_x_m": ("m", "place of the peak after the sleeper"),
    "min_force_n": ("N", "minimum force"),
    "contact_loss_s": ("s", "contact loss"),
    "p2_force_n": ("N", "P2 force, below 120 Hz"),
    "force_20hz_n": ("N", "Qmax, below 20 Hz"),
    "force_n": ("N", "contact force"),
    "wheel_m": ("m", "wheel displacement, positive up"),
    "rail_m": ("m", "rail displacement, positive up"),
    "irregularity_m": ("m", "path of the wheel's centre, positive up"),
    "speed_kmh": ("km/h", "speed"),
    "position_m": ("m", "weld's centre after the sleeper"),
    "judged_position_m": ("m", "weld's centre after the sleeper"),
    "worst_position_m": ("m", "weld's centre after the sleeper, at the peak"),
    "x_m": ("m", "distance from the sleeper before the weld"),
    "support_factor": ("1", "factor on the stiffness of pads and ballast"),
    "hertz_factor": ("1", "factor on the Hertz constant"),
    "wheel_radius_m": ("m", "wheel radius"),
}
_SAMPLED_INPUTS = ("support_factor", "hertz_factor", "wheel_radius_m")

_Variables = dict[str, tuple[Any, ...]]


def of_force_map(force_map: ForceMap, settings: SimulationSettings | None) -> xr.Dataset:
    """Return a force map's passages over speed, position and running direction, and its Monte-Carlo samples if any.

    Args:
        force_map: to show.
        settings: it was computed by, for the attributes; None if they are not known.
    """
    own, shape = known(force_map.running), (len(force_map.speeds_kmh), len(force_map.positions_m))
    directions = ["with", "against"] if own == "both" else [own or "with"]
    both = [force_map, *([force_map.against] if isinstance(force_map.against, OppositeDirection) else [])]
    variables: _Variables = {}
    for name in OppositeDirection.__struct_fields__:
        columns = [getattr(passages, name) for passages in both]
        if not any(isinstance(column, UnsetType) for column in columns):
            cells = np.stack([np.array(column).reshape(shape) for column in columns], axis=-1)
            variables[name] = _variable(name, ("speed_kmh", "position_m", "running"), cells)
    coordinates: _Variables = {
        "speed_kmh": _variable("speed_kmh", ("speed_kmh",), force_map.speeds_kmh),
        "position_m": _variable("position_m", ("position_m",), force_map.positions_m),
        "running": ("running", directions, {"long_name": "running direction"}),
    }
    if isinstance(force_map.spread, UncertaintyResult):
        variables |= _samples(force_map.spread)
        judged = _variable("judged_position_m", ("judged_position_m",), force_map.spread.positions_m)
        coordinates["judged_position_m"] = judged
    return xr.Dataset(variables, coordinates, _provenance(force_map, settings))


def of_curve(force_map: ForceMap, settings: SimulationSettings | None) -> xr.Dataset:
    """Return the worst over positions and running directions at each speed, with the passage of the peak."""
    relevant = relevant_range(force_map, up_to_line=False)
    speeds, worst = force_curve(relevant)
    curve = force_map.curve
    if isinstance(curve, SpeedCurve):
        at_m = np.array(curve.at_m)
        against = None if isinstance(curve.against, UnsetType) else np.array(curve.against)
    else:
        column = relevant.passages.peak_force_n.argmax(axis=1)
        at_m = relevant.positions_m[column]
        against = relevant.against["peak_force_n"][np.arange(len(column)), column]
    if against is None:
        against = np.full(len(speeds), force_map.running == "against")
    variables = {name: _variable(name, ("speed_kmh",), values) for name, values in worst.columns.items()}
    variables["worst_position_m"] = _variable("worst_position_m", ("speed_kmh",), at_m)
    running = np.where(against, "against", "with")
    if isinstance(curve, SpeedCurve) and not isinstance(curve.estimated, UnsetType):
        told = {"long_name": "estimated between simulated speeds: advice by the verdict's limits does not depend on it"}
        variables["estimated"] = (("speed_kmh",), np.array(curve.estimated), told)
    variables["worst_running"] = ("speed_kmh", running, {"long_name": "running direction at the peak"})
    axis = _variable("speed_kmh", ("speed_kmh",), speeds)
    return xr.Dataset(variables, {"speed_kmh": axis}, _provenance(force_map, settings))


def of_history(history: ForceHistory, settings: SimulationSettings | None) -> xr.Dataset:
    """Return one passage along the rail."""
    names = ("force_n", "wheel_m", "rail_m", "irregularity_m")
    variables = {name: _variable(name, ("x_m",), getattr(history, name)) for name in names}
    attributes = _provenance(history, settings)
    attributes |= {"speed_kmh": history.speed_kmh, "position_m": history.position_m}
    attributes["running"] = known(history.running) or "with"
    return xr.Dataset(variables, {"x_m": _variable("x_m", ("x_m",), history.x_m)}, attributes)


def _samples(spread: UncertaintyResult) -> _Variables:
    count = len(spread.support_factor)
    variables: _Variables = {}
    for name in COLUMNS:
        column = getattr(spread, name)
        if not isinstance(column, UnsetType):
            cells = np.array(column).reshape(count, -1)
            unit, words = _QUANTITIES[name]
            about = {"units": unit, "long_name": f"{words}, worst over speeds up to the line's"}
            variables[f"sampled_{name}"] = (("sample", "judged_position_m"), cells, about)
    return variables | {name: _variable(name, ("sample",), getattr(spread, name)) for name in _SAMPLED_INPUTS}


def _variable(name: str, dims: tuple[str, ...], values: Any) -> tuple[Any, ...]:
    unit, words = _QUANTITIES[name]
    return dims, np.asarray(values), {"units": unit, "long_name": words}


def _provenance(message: ForceMap | ForceHistory, settings: SimulationSettings | None) -> dict[str, Any]:
    """Return what a result rests on, as attributes that netCDF can hold; what is not known is left out."""
    names = (
        "weld_id", "profile_sha256", "config_sha256", "track", "vehicle", "engine", "static_load_n", "span_m",
        "model_error", "line_speed_kmh", "weld_position_m", "chainage_m", "rail",
    )  # fmt: skip
    of_settings = ("track", "vehicle", "engine", "static_load_n", "wheel_mass_kg", "wheel_radius_m", "hertz_n_per_m15")
    stated = {name: getattr(message, name, None) for name in names}
    if settings is not None:
        stated |= {name: getattr(settings, name) for name in of_settings}
    present = {name: known(value) for name, value in stated.items()}
    return {name: value for name, value in present.items() if value is not None} | {"software": SOFTWARE}
