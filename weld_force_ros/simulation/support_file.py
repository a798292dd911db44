"""The supports of a track file: `pad`, `half_sleeper_mass_kg` and `ballast`, or `layers` of any number."""

from itertools import pairwise
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from weld_force_ros.physics.track.support import Spring, Support, TabulatedSpring
from weld_force_ros.simulation.stated_number import Number, Reader

_Row = tuple[float, float, float]
_Rows = Annotated[list[_Row], Meta(min_length=2, max_length=500)]


class _SourcedRows(msgspec.Struct, forbid_unknown_fields=True):
    value: _Rows
    source: str


class SpringFile(msgspec.Struct, forbid_unknown_fields=True):
    """A spring: stiffness with loss factor, dashpot or both, or a `table` of [Hz, kN/mm, loss factor]."""

    stiffness_kn_per_mm: Number | None = None
    loss_factor: Number = 0.0
    damping_kns_per_m: Number = 0.0
    table: _Rows | _SourcedRows | None = None
    width_m: Number = 0.0


class LayerFile(msgspec.Struct, forbid_unknown_fields=True):
    """A layer: a spring or a mass."""

    spring: SpringFile | None = None
    mass_kg: Number | None = None


class SupportsFile(msgspec.Struct, forbid_unknown_fields=True):
    """What a track file says under `supports`."""

    kind: Literal["periodic", "continuous"]
    spacing_m: Number
    pad: SpringFile | None = None
    half_sleeper_mass_kg: Number | None = None
    ballast: SpringFile | None = None
    layers: Annotated[list[LayerFile], Meta(min_length=1, max_length=15)] | None = None


def read(reader: Reader, file: SupportsFile) -> tuple[Support, float]:
    """Return the chain of layers, and the width of the pad along the rail in m, 0 if it is a point.

    Raises:
        TrackError: layers that make no chain, or a number out of its range.
    """
    springs, masses = _by_layers(reader, file) if file.layers else _by_name(reader, file)
    for name, spring in springs[1:]:
        if spring.width_m:
            raise reader.error(f"{name}.width_m is not of the spring under the rail", "leave it out")
    least_kg = 0.0 if file.layers else 1e-6  # none puts two springs in series
    pad_name, pad = springs[0]
    support = Support(
        tuple(_spring(reader, name, spring) for name, spring in springs),
        tuple(reader.within(name, mass, least_kg, 1e6) for name, mass in masses),
    )
    return support, reader.within(f"{pad_name}.width_m", pad.width_m, 0.0, 0.4)


_Springs = list[tuple[str, SpringFile]]
_Masses = list[tuple[str, Number]]


def _by_name(reader: Reader, file: SupportsFile) -> tuple[_Springs, _Masses]:
    """Return springs and masses of a sleeper between pad and ballast, each with its name."""
    if file.pad is None or file.half_sleeper_mass_kg is None or file.ballast is None:
        names = ("pad", "half_sleeper_mass_kg", "ballast")
        missing = next(name for name in names if getattr(file, name) is None)
        raise reader.error(f"supports.{missing} is missing", f"give {', '.join(names)}, or layers")
    springs = [("supports.pad", file.pad), ("supports.ballast", file.ballast)]
    return springs, [("supports.half_sleeper_mass_kg", file.half_sleeper_mass_kg)]


def _by_layers(reader: Reader, file: SupportsFile) -> tuple[_Springs, _Masses]:
    """Return springs and masses of a list of layers, each with its name."""
    if file.pad is not None or file.half_sleeper_mass_kg is not None or file.ballast is not None:
        raise reader.error("supports has layers beside pad, half_sleeper_mass_kg or ballast", "give either")
    layers = file.layers or []
    springs: _Springs = []
    masses: _Masses = []
    for number, layer in enumerate(layers, 1):
        name = f"supports.layers[{number}]"
        if layer.spring is not None and layer.mass_kg is None:
            springs.append((f"{name}.spring", layer.spring))
        elif layer.mass_kg is not None and layer.spring is None:
            masses.append((f"{name}.mass_kg", layer.mass_kg))
        else:
            raise reader.error(f"{name} is not one spring or mass_kg", "give one of them a layer")
    is_spring = [layer.spring is not None for layer in layers]
    if not (is_spring[0] and is_spring[-1]) or any(upper == lower for upper, lower in pairwise(is_spring)):
        raise reader.error(
            f"supports.layers are {', '.join('spring' if one else 'mass' for one in is_spring)}",
            "from rail to ground give spring, mass, spring and so on, a spring at both ends",
        )
    return springs, masses


def _spring(reader: Reader, name: str, file: SpringFile) -> Spring | TabulatedSpring:
    if file.table is not None:
        return _tabulated(reader, name, file)
    if file.stiffness_kn_per_mm is None:
        raise reader.error(f"{name}.stiffness_kn_per_mm is missing", "give it, or a table")
    spring = Spring(
        stiffness_n_per_m=reader.positive(f"{name}.stiffness_kn_per_mm", file.stiffness_kn_per_mm) * 1e6,
        loss_factor=reader.within(f"{name}.loss_factor", file.loss_factor, 0.0, 3.0),
        damping_ns_per_m=reader.within(f"{name}.damping_kns_per_m", file.damping_kns_per_m, 0.0, 1e5) * 1e3,
    )
    if spring.loss_factor == 0.0 and spring.damping_ns_per_m == 0.0:
        raise reader.error(f"{name} has no damping", "give loss_factor or damping_kns_per_m")
    return spring


def _tabulated(reader: Reader, name: str, file: SpringFile) -> TabulatedSpring:
    if file.stiffness_kn_per_mm is not None or file.loss_factor or file.damping_kns_per_m:
        raise reader.error(f"{name} has a table beside other numbers", "give either")
    stated = file.table.value if isinstance(file.table, _SourcedRows) else file.table or []
    rows = []
    for number, (hz, stiffness, loss) in enumerate(stated, 1):
        row = f"{name}.table[{number}]"
        rows.append(
            (
                reader.within(f"{row} Hz", hz, 1e-3, 1e5),
                reader.positive(f"{row} kN/mm", stiffness) * 1e6,
                reader.within(f"{row} loss factor", loss, 0.0, 3.0),
            )
        )
    for number, (upper, lower) in enumerate(pairwise(rows), 2):
        if lower[0] <= upper[0]:
            raise reader.error(f"{name}.table[{number}] has {lower[0]:g} Hz after {upper[0]:g}", "let frequencies rise")
    if not any(loss for _, _, loss in rows):
        raise reader.error(f"{name} has no damping", "give loss factors in its table")
    return TabulatedSpring(tuple(rows))
