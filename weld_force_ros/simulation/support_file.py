"""The supports of a track file: `pad`, `half_sleeper_mass_kg` or `sleeper`, and `ballast`; or `layers` of any kind."""

from itertools import pairwise
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from weld_force_ros.physics.track.bending_sleeper import Bed, BendingSleeper
from weld_force_ros.physics.track.support import Spring, Support, TabulatedSpring
from weld_force_ros.physics.track.timoshenko import TimoshenkoBeam
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


class SleeperFile(msgspec.Struct, forbid_unknown_fields=True):
    """A sleeper that bends, from end to end: a beam of one cross-section, loaded alike by both rails.

    `bed` says whether what it rests on is spread along it, or stands below the seats; `shear_coefficient` is that of a
    rectangle of concrete (Cowper, J. Appl. Mech. 33 (1966) 335).
    """

    mass_kg: Number
    length_m: Number
    seat_spacing_m: Number
    area_cm2: Number
    second_moment_cm4: Number
    youngs_modulus_gpa: Number
    shear_modulus_gpa: Number
    shear_coefficient: Number = 0.85
    loss_factor: Number = 0.0
    bed: Bed = "spread"


class LayerFile(msgspec.Struct, forbid_unknown_fields=True):
    """A layer: a spring, a mass or a sleeper that bends."""

    spring: SpringFile | None = None
    mass_kg: Number | None = None
    sleeper: SleeperFile | None = None


class SupportsFile(msgspec.Struct, forbid_unknown_fields=True):
    """What a track file says under `supports`."""

    kind: Literal["periodic", "continuous"]
    spacing_m: Number
    pad: SpringFile | None = None
    half_sleeper_mass_kg: Number | None = None
    sleeper: SleeperFile | None = None
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
        tuple(
            _sleeper(reader, name, mass) if isinstance(mass, SleeperFile) else reader.within(name, mass, least_kg, 1e6)
            for name, mass in masses
        ),
    )
    return support, reader.within(f"{pad_name}.width_m", pad.width_m, 0.0, 0.4)


_Springs = list[tuple[str, SpringFile]]
_Masses = list[tuple[str, Number | SleeperFile]]


def _by_name(reader: Reader, file: SupportsFile) -> tuple[_Springs, _Masses]:
    """Return springs and the mass of a sleeper between pad and ballast, each with its name."""
    mass = file.half_sleeper_mass_kg
    if mass is not None and file.sleeper is not None:
        raise reader.error("supports has half_sleeper_mass_kg beside sleeper", "give either")
    if file.pad is None or (mass is None and file.sleeper is None) or file.ballast is None:
        names = ("pad", "half_sleeper_mass_kg", "ballast")
        missing = next(name for name in names if getattr(file, name) is None)
        raise reader.error(
            f"supports.{missing} is missing", "give pad, half_sleeper_mass_kg or sleeper, and ballast; or layers"
        )
    springs = [("supports.pad", file.pad), ("supports.ballast", file.ballast)]
    if file.sleeper is not None:
        return springs, [("supports.sleeper", file.sleeper)]
    assert mass is not None, "either is there"  # noqa: S101
    return springs, [("supports.half_sleeper_mass_kg", mass)]


def _by_layers(reader: Reader, file: SupportsFile) -> tuple[_Springs, _Masses]:
    """Return springs and masses of a list of layers, each with its name."""
    if any(one is not None for one in (file.pad, file.half_sleeper_mass_kg, file.sleeper, file.ballast)):
        raise reader.error("supports has layers beside pad, half_sleeper_mass_kg, sleeper or ballast", "give either")
    layers = file.layers or []
    springs: _Springs = []
    masses: _Masses = []
    for number, layer in enumerate(layers, 1):
        name = f"supports.layers[{number}]"
        match layer:
            case LayerFile(SpringFile() as spring, None, None):
                springs.append((f"{name}.spring", spring))
            case LayerFile(None, None, SleeperFile() as sleeper):
                masses.append((f"{name}.sleeper", sleeper))
            case LayerFile(None, mass_kg, None) if mass_kg is not None:
                masses.append((f"{name}.mass_kg", mass_kg))
            case _:
                raise reader.error(f"{name} is not one spring, mass_kg or sleeper", "give one of them a layer")
    is_spring = [layer.spring is not None for layer in layers]
    if not (is_spring[0] and is_spring[-1]) or any(upper == lower for upper, lower in pairwise(is_spring)):
        raise reader.error(
            f"supports.layers are {', '.join('spring' if one else 'mass' for one in is_spring)}",
            "from rail to ground give spring, mass, spring and so on, a spring at both ends",
        )
    return springs, masses


def _sleeper(reader: Reader, name: str, file: SleeperFile) -> BendingSleeper:
    length_m = reader.within(f"{name}.length_m", file.length_m, 0.5, 5.0)
    return BendingSleeper(
        TimoshenkoBeam(
            mass_kg_per_m=reader.positive(f"{name}.mass_kg", file.mass_kg) / length_m,
            area_m2=reader.positive(f"{name}.area_cm2", file.area_cm2) * 1e-4,
            second_moment_m4=reader.positive(f"{name}.second_moment_cm4", file.second_moment_cm4) * 1e-8,
            youngs_modulus_pa=reader.positive(f"{name}.youngs_modulus_gpa", file.youngs_modulus_gpa) * 1e9,
            shear_modulus_pa=reader.positive(f"{name}.shear_modulus_gpa", file.shear_modulus_gpa) * 1e9,
            shear_coefficient=reader.within(f"{name}.shear_coefficient", file.shear_coefficient, 0.05, 1.0),
            loss_factor=reader.within(f"{name}.loss_factor", file.loss_factor, 0.0, 0.5),
        ),
        length_m=length_m,
        seats_m=reader.within(f"{name}.seat_spacing_m", file.seat_spacing_m, 0.1, length_m),
        bed=file.bed,
    )


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
