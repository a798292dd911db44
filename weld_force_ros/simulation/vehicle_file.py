"""Vehicle files: static wheel load, unsprung mass and wheel radius by a vehicle's name, each number with its source."""

from dataclasses import dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from weld_force_ros import _yaml
from weld_force_ros.errors import InputError
from weld_force_ros.messages import legible
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.simulation.stated_number import Number, Sourced

_REMEDY = "write it after data/vehicles/passenger.yaml"


class _Sourced(msgspec.Struct, forbid_unknown_fields=True):
    value: Annotated[float, Meta(gt=0.0)]
    source: str


_Number = Annotated[float, Meta(gt=0.0)] | _Sourced


class _VehicleFile(msgspec.Struct, forbid_unknown_fields=True):
    name: Annotated[str, Meta(min_length=1, max_length=100)]
    static_load_kn: _Number
    unsprung_mass_kg: _Number
    wheel_radius_m: _Number
    hertz_gn_per_m15: _Number | None = None
    wheel_transverse_radius_m: Number | None = None
    description: str = ""


@dataclass(frozen=True)
class Vehicle:
    """A vehicle as the rail feels it: one wheel, its load and what moves with it.

    Attributes:
        name: as verdicts give it.
        description: what vehicle it is.
        static_load_n: of one wheel.
        unsprung_mass_kg: of half a wheelset.
        wheel_radius_m: of a new wheel.
        hertz_n_per_m15: None: that of the track file, or of the radii.
        wheel_transverse_radius_m: of its treads; None: not stated.
        sources: of each number, in words.
    """

    name: str
    description: str
    static_load_n: float
    unsprung_mass_kg: float
    wheel_radius_m: float
    hertz_n_per_m15: float | None
    wheel_transverse_radius_m: float | None
    sources: tuple[str, ...]

    def on(self, wheel: Wheel) -> Wheel:
        """Return the vehicle's wheel on a track whose own wheel is given."""
        return replace(
            wheel,
            mass_kg=self.unsprung_mass_kg,
            static_load_n=self.static_load_n,
            radius_m=self.wheel_radius_m,
            hertz_n_per_m15=self.hertz_n_per_m15 or wheel.hertz_n_per_m15,
        )


def bundled() -> list[str]:
    """Return the names of the bundled vehicles."""
    folder = resources.files("weld_force_ros.data") / "vehicles"
    return sorted(file.name.removesuffix(".yaml") for file in folder.iterdir() if file.name.endswith(".yaml"))


def load(name_or_path: str) -> Vehicle:
    """Return a bundled vehicle, or that of a YAML file of the same form.

    Raises:
        InputError: there is none of that name, or the file is not of that form.
    """
    file: Traversable = Path(name_or_path).expanduser()
    if name_or_path in bundled():
        file = resources.files("weld_force_ros.data") / "vehicles" / f"{name_or_path}.yaml"
    elif not file.is_file() and not name_or_path.endswith((".yaml", ".yml")):
        raise InputError(f"vehicle {name_or_path!r} is unknown", f"use {', '.join(bundled())}, or the path of a file")
    try:
        stated = _yaml.decode(_yaml.read(file), _VehicleFile)
    except (OSError, msgspec.DecodeError, ValueError) as error:
        raise InputError(f"vehicle {name_or_path}: {legible(str(error))}", _REMEDY) from None
    across = stated.wheel_transverse_radius_m
    if across is not None and stated.hertz_gn_per_m15 is not None:
        raise InputError(f"vehicle {name_or_path}: hertz_gn_per_m15 beside wheel_transverse_radius_m", "give either")
    numbers = (stated.static_load_kn, stated.unsprung_mass_kg, stated.wheel_radius_m)
    return Vehicle(
        name=stated.name,
        description=stated.description.strip(),
        static_load_n=1e3 * _value(stated.static_load_kn),
        unsprung_mass_kg=_value(stated.unsprung_mass_kg),
        wheel_radius_m=_value(stated.wheel_radius_m),
        hertz_n_per_m15=None if stated.hertz_gn_per_m15 is None else 1e9 * _value(stated.hertz_gn_per_m15),
        wheel_transverse_radius_m=across.value if isinstance(across, Sourced) else across,
        sources=tuple(number.source for number in numbers if isinstance(number, _Sourced)),
    )


def _value(number: float | _Sourced) -> float:
    return number.value if isinstance(number, _Sourced) else number
