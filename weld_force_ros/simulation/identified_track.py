"""Write the track that was identified from a measurement as a track file, each number with where it comes from."""

from dataclasses import dataclass
from typing import Any

import yaml

from weld_force_ros.errors import TrackError
from weld_force_ros.physics.track.beam import StripRail
from weld_force_ros.physics.track.identification import Identified
from weld_force_ros.simulation import track_file
from weld_force_ros.simulation.track_file import TrackDefinition

# Parameters as track files name them, and their units there.
_FIELDS = {
    "pad_n_per_m": ("pad", "stiffness_kn_per_mm", 1e-6),
    "pad_ns_per_m": ("pad", "damping_kns_per_m", 1e-3),
    "pad_loss_factor": ("pad", "loss_factor", 1.0),
    "ballast_n_per_m": ("ballast", "stiffness_kn_per_mm", 1e-6),
    "ballast_ns_per_m": ("ballast", "damping_kns_per_m", 1e-3),
    "ballast_loss_factor": ("ballast", "loss_factor", 1.0),
}
_DIGITS = 5


@dataclass(frozen=True)
class Basis:
    """What a track has that is not identified: rail, spacing, wheel and the mass of half a sleeper.

    Attributes:
        definition: a track with them.
        document: the content of its file.
    """

    definition: TrackDefinition
    document: dict[str, Any]


def basis(like: str, rail: str | None = None, spacing_m: float | None = None) -> Basis:
    """Return a bundled track or a user's own as the basis of another, with another rail or spacing if given.

    Raises:
        TrackError: no such track or rail, a spacing out of its range, or a rail by strips.
    """
    document = yaml.safe_load(track_file.load(like).text)
    if rail is not None:
        document["rail"] = {"section": rail}
    if spacing_m is not None:
        document["supports"]["spacing_m"] = spacing_m
    definition = track_file.parse(yaml.safe_dump(document), like)
    if isinstance(definition.track.rail, StripRail):
        raise TrackError(f"track {like}: layers are found below a rail that is a beam", "write `model: timoshenko`")
    return Basis(definition, document)


def track_text(found: Identified, base: Basis, *, name: str, measurement: str, kept_mass_source: str) -> str:
    """Return the text of the track file of what was identified.

    Args:
        found: layers of the track.
        base: what else the track has.
        name: of the track.
        measurement: what it was identified from, in words.
        kept_mass_source: where the mass of half a sleeper comes from, if it was not found.
    """
    (sleeper_kg,) = found.track.support.masses_kg
    assert isinstance(sleeper_kg, float), "identified sleepers are rigid"  # noqa: S101
    layers: dict[str, Any] = {"pad": {}, "ballast": {}}
    mass = {"value": _rounded(sleeper_kg), "source": kept_mass_source}
    for one in found.estimates:
        source = f"identified from {measurement}; standard error {100 * one.standard_error:.2g} %"
        if one.at_bound:
            source += ", at the end of the range searched: not told by the measurement"
        if one.name == "half_sleeper_kg":
            mass["source"] = source
        else:
            layer, field, size = _FIELDS[one.name]
            layers[layer][field] = {"value": _rounded(one.value * size), "source": source}
    supports = {
        "kind": "periodic",
        "spacing_m": base.document["supports"]["spacing_m"],
        "pad": layers["pad"],
        "half_sleeper_mass_kg": mass,
        "ballast": layers["ballast"],
    }
    document = {
        "name": name,
        "description": f"Pads and ballast identified from {measurement}: the track as it is unloaded.",
        "rail": base.document["rail"],
        "supports": supports,
        "wheel": base.document["wheel"],
    }
    return yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120)


def _rounded(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
