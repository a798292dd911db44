"""A vehicle by name, file or numbers."""

import math
from pathlib import Path
from typing import Self

from weld_force_ros.errors import InputError
from weld_force_ros.library.notebook import table
from weld_force_ros.simulation import vehicle_file


class Vehicle:
    """A vehicle as the rail feels it: one wheel, its static load and the unsprung mass that moves with it.

    Args:
        name_or_path: a bundled vehicle (`Vehicle.bundled()`), or the path of a vehicle file (YAML).

    Raises:
        InputError: there is no such vehicle, or the file does not describe one.

    Examples:
        >>> import weld_force_ros as wf
        >>> wf.Vehicle("passenger")
        Vehicle('passenger', static_load_n=54500, unsprung_mass_kg=906.5, wheel_radius_m=0.46)
    """

    def __init__(self, name_or_path: str | Path) -> None:
        self.definition = vehicle_file.load(str(name_or_path))

    @classmethod
    def from_parts(
        cls,
        *,
        static_load_n: float,
        unsprung_mass_kg: float,
        wheel_radius_m: float,
        hertz_n_per_m15: float | None = None,
        name: str = "own vehicle",
    ) -> Self:
        """Make a vehicle of its wheel's numbers.

        Args:
            static_load_n: of one wheel, N.
            unsprung_mass_kg: of half a wheelset, kg.
            wheel_radius_m: rolling radius, m.
            hertz_n_per_m15: Hertz constant, N/m^1.5; that of the track if not given.
            name: of the vehicle, as results give it.

        Raises:
            InputError: a number that is not positive, or a name that is empty.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Vehicle.from_parts(static_load_n=40e3, unsprung_mass_kg=450, wheel_radius_m=0.3, name="tram")
            Vehicle('tram', static_load_n=40000, unsprung_mass_kg=450, wheel_radius_m=0.3)
        """
        numbers = {"static_load_n": static_load_n, "unsprung_mass_kg": unsprung_mass_kg}
        numbers |= {"wheel_radius_m": wheel_radius_m}
        stated = numbers if hertz_n_per_m15 is None else numbers | {"hertz_n_per_m15": hertz_n_per_m15}
        for number, value in stated.items():
            if not math.isfinite(value) or value <= 0:
                raise InputError(f"vehicle {name!r}: {number} is {value:g}", "give a positive number")
        if not name:
            raise InputError("a vehicle without a name", "give it one: results name the vehicle that decides")
        made = cls.__new__(cls)
        made.definition = vehicle_file.Vehicle(
            name=name,
            description="",
            static_load_n=float(static_load_n),
            unsprung_mass_kg=float(unsprung_mass_kg),
            wheel_radius_m=float(wheel_radius_m),
            hertz_n_per_m15=None if hertz_n_per_m15 is None else float(hertz_n_per_m15),
            wheel_transverse_radius_m=None,
            sources=(),
        )
        return made

    @staticmethod
    def bundled() -> list[str]:
        """Return the names of the vehicles that come with the package.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Vehicle.bundled()
            ['freight-22.5t', 'high-speed', 'locomotive', 'metro', 'passenger']
        """
        return vehicle_file.bundled()

    @property
    def name(self) -> str:
        """Return the vehicle's name, as results give it.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Vehicle("metro").name
            'metro'
        """
        return self.definition.name

    @property
    def static_load_n(self) -> float:
        """Return the static load of one wheel in N.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Vehicle("passenger").static_load_n
            54500.0
        """
        return self.definition.static_load_n

    @property
    def unsprung_mass_kg(self) -> float:
        """Return the unsprung mass of one wheel, half a wheelset, in kg.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Vehicle("passenger").unsprung_mass_kg
            906.5
        """
        return self.definition.unsprung_mass_kg

    @property
    def wheel_radius_m(self) -> float:
        """Return the rolling radius in m.

        Examples:
            >>> import weld_force_ros as wf
            >>> wf.Vehicle("passenger").wheel_radius_m
            0.46
        """
        return self.definition.wheel_radius_m

    def __repr__(self) -> str:
        return (
            f"Vehicle({self.name!r}, static_load_n={self.static_load_n:g}, "
            f"unsprung_mass_kg={self.unsprung_mass_kg:g}, wheel_radius_m={self.wheel_radius_m:g})"
        )

    def _repr_html_(self) -> str:
        hertz = self.definition.hertz_n_per_m15
        facts = {
            "what": self.definition.description or None,
            "static wheel load": f"{self.static_load_n / 1e3:g} kN",
            "unsprung mass": f"{self.unsprung_mass_kg:g} kg, half a wheelset",
            "wheel radius": f"{self.wheel_radius_m:g} m",
            "Hertz constant": "the track's" if hertz is None else f"{hertz / 1e9:g} GN/m^1.5",
            "sources": "; ".join(self.definition.sources) or None,
        }
        return table(f"Vehicle {self.name}", facts)
