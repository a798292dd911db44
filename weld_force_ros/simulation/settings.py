"""Complete and check the settings of a simulation."""

from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import Any, Literal, cast, get_args

import msgspec
import numpy as np
from msgspec import UNSET, UnsetType

from weld_force_ros import _yaml
from weld_force_ros.errors import InputError, MessageError
from weld_force_ros.messages import (
    MAX_VEHICLES,
    Engine,
    Running,
    SimulationSettings,
    Uncertainty,
    config_sha256,
    encode,
    legible,
    parse_support,
)
from weld_force_ros.physics.passage.hertz import CROWN_RADII_M, ContactRadii
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.simulation import track_file, vehicle_file
from weld_force_ros.simulation.track_file import TrackDefinition
from weld_force_ros.simulation.vehicle_file import Vehicle

DEFAULT_TRACK = "bilbao-causal"
DEFAULT_SPEEDS = "20:300:5"
DEFAULT_POSITIONS = "15"
DEFAULT_UNCERTAINTY_SAMPLES = 32
DEFAULT_RUNNING = "both"
ROLLINGS = ("circle", "none")
ENGINES: tuple[str, ...] = get_args(get_args(Engine)[0])
RUNNINGS: tuple[str, ...] = get_args(get_args(Running)[0])


def parse_speeds(text: str) -> list[float]:
    """Read speeds in km/h from `FIRST:LAST:STEP` (the last included) or a list `40,80`.

    Raises:
        InputError: not of that form, or not positive and increasing.
    """
    remedy = "write FIRST:LAST:STEP or a list such as 40,80, in km/h, increasing"
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            if not step > 0 or not last >= first or (last - first) / step > 1e4:
                raise ValueError
            speeds = [first + i * step for i in range(int((last - first) / step + 1e-9) + 1)]
        else:
            speeds = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"speeds {text!r} cannot be read", remedy) from None
    if not all(np.isfinite(speeds)) or speeds[0] <= 0 or np.any(np.diff(speeds) <= 0):
        raise InputError(f"speeds {text!r} are not positive and increasing", remedy)
    return speeds


def parse_positions(text: str) -> int | list[float]:
    """Read positions: one whole number N for N equal steps over a span, else metres after the sleeper, `0.15,0.30`.

    Raises:
        InputError: not of that form, or not increasing.
    """
    remedy = "write a whole number of steps over the span, or metres after the sleeper such as 0.15,0.30, increasing"
    if text.strip().isdecimal():
        count = int(text) if len(text) < 10 else 0
        if not 1 <= count <= 1000:
            raise InputError(f"positions {text!r}: 1 to 1000 steps can be computed", remedy)
        return count
    try:
        positions = [float(part) for part in text.split(",")]
    except ValueError:
        raise InputError(f"positions {text!r} cannot be read", remedy) from None
    if not all(np.isfinite(positions)) or np.any(np.diff(positions) <= 0):
        raise InputError(f"positions {text!r} are not finite and increasing", remedy)
    return positions


def parse_vehicles(text: str) -> list[str | None]:
    """Return the vehicles of a text with commas between them; the track's own wheel, None, of an empty one.

    Raises:
        InputError: a vehicle is named twice, or there are too many.
    """
    vehicles = [name for part in text.split(",") if (name := part.strip())]
    if len(set(vehicles)) < len(vehicles):
        raise InputError(f"vehicles {text!r}: one is named twice", "name each vehicle once")
    if len(vehicles) > MAX_VEHICLES:
        raise InputError(f"{len(vehicles)} vehicles", f"name at most {MAX_VEHICLES}")
    return [*vehicles] or [None]


def simulation_settings(
    *,
    track: str | TrackDefinition = DEFAULT_TRACK,
    vehicle: str | Vehicle | None = None,
    engine: str = "common-poles",
    speeds_kmh: Sequence[float] | None = None,
    positions: int | Sequence[float] = int(DEFAULT_POSITIONS),
    wheel_mass_kg: float | None = None,
    static_load_n: float | None = None,
    wheel_radius_m: float | None = None,
    hertz_n_per_m15: float | None = None,
    crown_radius_m: float | None = None,
    contact_patch: str = "on",
    rolling: str = "circle",
    running: str = DEFAULT_RUNNING,
    support: str = "",
    uncertainty: Uncertainty | None = None,
) -> SimulationSettings:
    """Complete and check the settings of a simulation; what is not given for the wheel is the vehicle's.

    Args:
        track: a shipped track's name, the path of a track file, or what one of them defines.
        vehicle: a bundled vehicle's name, the path of a vehicle file, or what one of them defines; the wheel of the
            track file if not given.
        engine: how the track is represented in time.
        speeds_kmh: increasing; default 20 to 300 in steps of 5.
        positions: number of equal steps over the span, or metres after the sleeper.
        wheel_mass_kg: half a wheelset.
        static_load_n: static wheel load.
        wheel_radius_m: rolling radius.
        hertz_n_per_m15: Hertz constant.
        crown_radius_m: transverse radius of the rail head, from which and the wheel's radii the Hertz constant follows.
        contact_patch: `on`: the rail's heights are averaged over the patch that Hertz' theory gives; `off`: not.
        rolling: `circle`: the wheel's circle rolls over the rail and bridges what is sharper; `none`: it does not.
        running: how trains run over welds that do not state it: `with` rising x, `against` it, or `both`.
        support: supports that differ from the track's at welds that do not state them, such as `0=0.02,1=0.5`.
        uncertainty: what is drawn for verdicts with probabilities; none if not given.

    Raises:
        InputError: anything that cannot be simulated.
    """
    if engine not in ENGINES:
        raise InputError(f"engine {engine!r} is not available", f"use {', '.join(ENGINES)}")
    definition = track_file.load(track) if isinstance(track, str) else track
    chosen = vehicle_file.load(vehicle) if isinstance(vehicle, str) else vehicle
    stated_wheel = _wheel(
        definition.wheel if chosen is None else chosen.on(definition.wheel),
        mass_kg=wheel_mass_kg,
        static_load_n=static_load_n,
        radius_m=wheel_radius_m,
        hertz_n_per_m15=hertz_n_per_m15,
    )
    wheel, radii = _contact(definition, chosen, stated_wheel, hertz_n_per_m15, crown_radius_m)
    if contact_patch not in ("on", "off"):
        raise InputError(f"contact_patch {contact_patch!r} is unknown", "use on or off")
    if rolling not in ROLLINGS:
        raise InputError(f"rolling {rolling!r} is unknown", f"use {', '.join(ROLLINGS)}")
    if running not in RUNNINGS:
        raise InputError(f"running {running!r} is unknown", f"use {', '.join(RUNNINGS)}")
    spacing = definition.track.spacing_m
    at = [i * spacing / positions for i in range(positions)] if isinstance(positions, int) else list(positions)
    settings = SimulationSettings(
        config_sha256="0" * 64,
        track=definition.track.name,
        track_definition=definition.text,
        vehicle=UNSET if chosen is None else chosen.name,
        engine=cast(Engine, engine),
        speeds_kmh=list(map(float, speeds_kmh)) if speeds_kmh is not None else parse_speeds(DEFAULT_SPEEDS),
        positions_m=list(map(float, at)),
        wheel_mass_kg=wheel.mass_kg,
        static_load_n=wheel.static_load_n,
        wheel_radius_m=wheel.radius_m,
        hertz_n_per_m15=wheel.hertz_n_per_m15,
        contact_patch_m=round(radii.half_length_m(wheel.static_load_n), 6) if contact_patch == "on" else UNSET,
        rolling="none" if rolling == "none" else UNSET,
        running=cast(Running, running),
        support=parse_support(support) or UNSET,
        uncertainty=uncertainty or UNSET,
        poles=poles_of(definition, engine),
    )
    return _identified(settings)


def poles_of(definition: track_file.TrackDefinition, engine: str) -> Literal["moving"] | UnsetType:
    """Return what settings say of poles: those of a moving contact where engine and track have such."""
    return "moving" if engine == "common-poles" and definition.moving else UNSET


def _identified(settings: SimulationSettings) -> SimulationSettings:
    """Put in the identity of settings, and check that they keep the contract."""
    settings.config_sha256 = config_sha256(settings)
    try:
        encode(settings)
    except MessageError as error:
        raise InputError(error.reason, "check track, grid and wheel") from None
    return settings


def _wheel(default: Wheel, **given: float | None) -> Wheel:
    for name, value in given.items():
        if value is not None and (not np.isfinite(value) or value <= 0):
            raise InputError(f"wheel {name} is {value:g}", "give a positive number")
    return replace(default, **{name: float(value) for name, value in given.items() if value is not None})


def _contact(
    definition: TrackDefinition,
    vehicle: Vehicle | None,
    wheel: Wheel,
    hertz_n_per_m15: float | None,
    crown_radius_m: float | None,
) -> tuple[Wheel, ContactRadii]:
    """Return the wheel, its Hertz constant that of the radii where they are stated, and the radii of its contact.

    Raises:
        InputError: both stated, a crown that no rail has, or a tread as hollow as the crown is round.
    """
    least_m, most_m = CROWN_RADII_M
    if hertz_n_per_m15 is not None and crown_radius_m is not None:
        raise InputError("hertz_n_per_m15 beside crown_radius_m, which gives it", "give either")
    if crown_radius_m is not None and not least_m <= crown_radius_m <= most_m:
        raise InputError(f"crown_radius_m is {crown_radius_m:g}", f"give a number from {least_m:g} to {most_m:g}")
    of_track = definition.radii or ContactRadii(wheel.radius_m)
    across_m = of_track.wheel_transverse_m if vehicle is None else vehicle.wheel_transverse_radius_m
    radii = ContactRadii(wheel.radius_m, crown_radius_m or of_track.crown_m, np.inf if across_m is None else across_m)
    if not radii.touch_in_a_point:
        raise InputError(
            f"a tread of {across_m:g} m is hollower than the crown of {radii.crown_m:g} m",
            "state a tread and a crown that touch in one point",
        )
    is_stated = crown_radius_m is not None or definition.radii is not None or np.isfinite(radii.wheel_transverse_m)
    of_vehicle = None if vehicle is None else vehicle.hertz_n_per_m15
    if not is_stated or hertz_n_per_m15 is not None or (of_vehicle is not None and crown_radius_m is None):
        return wheel, radii
    return replace(wheel, hertz_n_per_m15=radii.hertz_n_per_m15), radii


def load_uncertainty(samples: int, path: Path | None = None) -> Uncertainty | None:
    """Read what is uncertain from a YAML file of the form of `data/uncertainty/default.yaml`, which is the default.

    Args:
        samples: how many are simulated, instead of the file's; 0: none, and None is returned.
        path: of the file.

    Raises:
        InputError: not readable or not of that form.
    """
    if samples == 0:
        return None
    source = str(path or "data/uncertainty/default.yaml")
    file = path or resources.files("weld_force_ros.data") / "uncertainty" / "default.yaml"
    try:
        stated = _yaml.decode(_yaml.read(file), dict[str, Any])
        unknown = stated.keys() - set(Uncertainty.__struct_fields__)
        if unknown:
            raise ValueError(f"{', '.join(sorted(unknown))} is unknown")
        return msgspec.convert({**stated, "samples": samples}, Uncertainty)
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise InputError(
            f"uncertainty {source}: {legible(str(error))}", "write it after data/uncertainty/default.yaml"
        ) from None
