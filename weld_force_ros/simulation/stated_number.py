"""Numbers of track files: bare or as `{value, source}`, and held to their range with one clear line."""

import math
from dataclasses import dataclass

import msgspec

from weld_force_ros.errors import TrackError


class Sourced(msgspec.Struct, forbid_unknown_fields=True):
    """A number with where it was found."""

    value: float
    source: str


Number = float | Sourced


@dataclass(frozen=True)
class Reader:
    """Reads the numbers of one file, which `source` names in errors."""

    source: str

    def error(self, what: str, remedy: str) -> TrackError:
        """Return the error that says what is wrong in this file."""
        return TrackError(f"track file {self.source}: {what}", remedy)

    def within(self, name: str, number: Number, least: float, most: float) -> float:
        """Return the value of the field `name`.

        Raises:
            TrackError: not from `least` to `most`.
        """
        value = number.value if isinstance(number, Sourced) else number
        if not math.isfinite(value) or not least <= value <= most:
            raise self.error(f"{name} is {value:g}", f"give a number from {least:g} to {most:g}")
        return value

    def positive(self, name: str, number: Number) -> float:
        """Return the value of a field that must be positive; see `within`."""
        return self.within(name, number, 1e-6, 1e6)
