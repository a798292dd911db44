"""The software against what others published, each number with where it was read, and against closed forms.

What cannot be compared, as its numbers are not public here, is named instead of left out.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from importlib import resources

import msgspec
import numpy as np

from weld_force_ros import _yaml
from weld_force_ros.physics.analysis.peaks import P2_WITHIN_S, p1_p2, vertex
from weld_force_ros.physics.passage.passage import VehicleTrackModel
from weld_force_ros.physics.passage.wheel import Wheel
from weld_force_ros.physics.passage.wheel_path import wheel_path_over
from weld_force_ros.physics.track.beam import Rail, Track, pinned_pinned_hz, receptance, static_compliance
from weld_force_ros.physics.track.support import Spring, Support
from weld_force_ros.simulation import fit_store, track_file
from weld_force_ros.studies.result_table import Column, Table

_JENKINS = "Jenkins 1974: H. H. Jenkins et al., Railway Engineering Journal 3 (1974) 2 to 16; the formula from memory"
_NO_MASS = "Jenkins 1974: not compared, as the effective mass of track for P1 could not be read"
_NO_NUMBERS = "TRACK v3.0: TU Delft; not compared, as their numbers are not public here"
_HETENYI = "Hetényi 1946: M. Hetényi, Beams on Elastic Foundation, University of Michigan Press; beta / (2 k)"
_FOURIER = "closed form: the Fourier integral of a Timoshenko beam on an elastic foundation"
_TIMOSHENKO = "Timoshenko 1921: S. P. Timoshenko, Philosophical Magazine 41 (1921) 744; a beam on two pins"
_CONTINUOUS = ("bilbao-continuous", "embedded-rail")
_DISCRETE = ("bilbao", "johansson-nielsen")
_JOINTED = ("bilbao-viscous", "johansson-nielsen", "concrete-soft-pads", "concrete-stiff-pads")
_SPEEDS_KMH = (60.0, 100.0, 160.0)
_RIGID = Support((Spring(1e13, loss_factor=1e-3),))
_SHEAR_STIFF = 1e6

JOINT_ANGLE_RAD = 0.02
"""Of a dipped joint: between the two rail ends."""
_JOINT_REACH_M = 0.5
_JOINT_AT_SPANS = 0.25


class Comparison(msgspec.Struct, frozen=True):
    """One number of this software beside another's; what was not compared has neither, and its source says why.

    Attributes:
        what: the quantity, with its unit.
        source: of the other number.
        ours: by this software.
        theirs: the other's.
        difference: ours over theirs, less one.
        allowed: magnitude of the difference.
        within: whether it is.
    """

    what: str
    source: str
    ours: float | None = None
    theirs: float | None = None
    difference: float | None = None
    allowed: float | None = None
    within: bool | None = None


class PublishedSupport(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """A support and the mobilities published for it, (n_frequency,), m/(N s), of the rail over it."""

    layers: str
    springs: list[Spring]
    masses_kg: list[float]
    mobility_m_per_ns: list[float]


class PublishedMobilities(msgspec.Struct, forbid_unknown_fields=True, frozen=True):
    """Published mobilities of a rail on supports `spacing_m` apart."""

    source: str
    licence: str
    rail: Rail
    spacing_m: float
    frequency_hz: list[float]
    supports: list[PublishedSupport]

    def track(self, support: PublishedSupport) -> Track:
        """Return the track with one of the supports."""
        chain = Support(tuple(support.springs), tuple(support.masses_kg))
        return Track(support.layers, self.rail, chain, self.spacing_m)


@cache
def rolland() -> PublishedMobilities:
    """Return what rolland publishes, from `data/benchmark/rolland.yaml`."""
    path = resources.files("weld_force_ros.data") / "benchmark" / "rolland.yaml"
    return _yaml.decode(_yaml.read(path), PublishedMobilities)


def compare(what: str, source: str, ours: float, theirs: float, allowed: float) -> Comparison:
    """Return a comparison of two numbers."""
    difference = ours / theirs - 1
    return Comparison(what, source, ours, theirs, difference, allowed, abs(difference) <= allowed)


def run() -> Iterator[Comparison]:
    """Compare everything; a few seconds."""
    yield from mobilities()
    yield from deflections()
    yield from pinned_pinned()
    yield from dipped_joints()
    yield Comparison("P1, dipped joint, kN", _NO_MASS)
    yield Comparison("peak force, squat and wheel flat, kN", _NO_NUMBERS)


def mobilities() -> Iterator[Comparison]:
    """Compare mobilities over a support with rolland's."""
    published = rolland()
    hz = np.array(published.frequency_hz)
    for support in published.supports:
        ours = np.abs(receptance(published.track(support), hz, [0.0])[0]) * 2 * np.pi * hz
        for f, own, theirs in zip(hz, ours, support.mobility_m_per_ns, strict=True):
            what = f"mobility, {support.layers}, {f:.0f} Hz, m/(N s)"
            yield compare(what, f"{published.source}; {published.licence}", float(own), theirs, 2e-4)


def deflections() -> Iterator[Comparison]:
    """Compare static deflections of continuous tracks with those of beams on an elastic foundation."""
    for name in _CONTINUOUS:
        definition = track_file.load(name)
        track, load = definition.track, definition.wheel.static_load_n
        rail = replace(track.rail, shear_modulus_pa=_SHEAR_STIFF * track.rail.shear_modulus_pa)
        for beam, theirs, source, of in (
            ("Euler beam", euler_deflection_m, _HETENYI, rail),
            ("Timoshenko beam", timoshenko_deflection_m, _FOURIER, track.rail),
        ):
            ours = load * float(static_compliance(replace(track, rail=of), [0.0])[0])
            what = f"deflection at rest, {beam}, {name}, mm"
            yield compare(what, source, 1e3 * ours, 1e3 * theirs(replace(track, rail=of), load), 1e-5)


def pinned_pinned() -> Iterator[Comparison]:
    """Compare resonances of the rail between rigid supports with a Timoshenko beam's on two pins."""
    for name in _DISCRETE:
        track = track_file.load(name).track
        theirs = pinned_pinned_hz(track)
        pinned = replace(track, support=_RIGID, rail=replace(track.rail, loss_factor=1e-4))
        hz = np.arange(0.95 * theirs, 1.05 * theirs, 0.25)
        response = np.abs(receptance(pinned, hz, [track.spacing_m / 2])[0])
        ours, _ = vertex(hz, response, int(response.argmax()))
        yield compare(f"pinned-pinned frequency, {name}, Hz", _TIMOSHENKO, ours, theirs, 2e-4)


def dipped_joints() -> Iterator[Comparison]:
    """Compare simulated P2 with Jenkins' over tracks and speeds."""
    for name in _JOINTED:
        definition = track_file.load(name)
        vehicle_track = VehicleTrackModel(fit_store.fitted(definition).model(), definition.wheel)
        for speed_kmh in _SPEEDS_KMH:
            ours = simulated_p2_n(vehicle_track, definition.track, definition.wheel, speed_kmh)
            theirs = jenkins_p2_n(definition.track, definition.wheel, speed_kmh, JOINT_ANGLE_RAD)
            what = f"P2, dipped joint, {name}, {speed_kmh:g} km/h, kN"
            yield compare(what, _JENKINS, ours / 1e3, theirs / 1e3, 0.15)


@dataclass(frozen=True)
class Foundation:
    """A track as a beam on an elastic foundation: stiffness k per length, and beta, the inverse of its reach."""

    stiffness_n_per_m2: float
    beta_per_m: float


def foundation(track: Track) -> Foundation:
    """Return the foundation that the track's springs are when smeared over their spacing."""
    springs = track.support.springs
    k = 1 / sum(1 / spring.stiffness_n_per_m for spring in springs) / track.spacing_m
    bending = track.rail.youngs_modulus_pa * track.rail.second_moment_m4
    return Foundation(k, float((k / (4 * bending)) ** 0.25))


def euler_deflection_m(track: Track, load_n: float) -> float:
    """Return the deflection of a beam without shear under a load at rest, beta / (2 k) per newton."""
    on = foundation(track)
    return load_n * on.beta_per_m / (2 * on.stiffness_n_per_m2)


def timoshenko_deflection_m(track: Track, load_n: float) -> float:
    """Return the deflection of a Timoshenko beam on an elastic foundation under a load at rest.

    The integral of (1 + q^2 EI / S) / (k + k q^2 EI / S + EI q^4) over all wave numbers q, S the shear stiffness.
    """
    rail, k = track.rail, foundation(track).stiffness_n_per_m2
    bending = rail.youngs_modulus_pa * rail.second_moment_m4
    shear = rail.shear_coefficient * rail.shear_modulus_pa * rail.area_m2
    root = np.sqrt(k / bending)
    return float(load_n * (1 / root + bending / shear) / (2 * bending * np.sqrt(k / shear + 2 * root)))


def jenkins_p2_n(track: Track, wheel: Wheel, speed_kmh: float, angle_rad: float) -> float:
    """Return P2 over a dipped joint after Jenkins et al. (1974).

    The wheel of mass Mu meets a mass Mt, spring Kt and dashpot Ct, those of the track below it in the shape of a beam
    on an elastic foundation at rest: Kt = 2 k / beta, Mt = 3 m / (2 beta), Ct = 3 c / (2 beta), with m of rail and
    sleepers. The damping c is that of the whole support at the frequency of P2: dashpots in series with springs do
    less than alone.

    Args:
        track: on springs and masses.
        wheel: its mass and static load.
        speed_kmh: constant.
        angle_rad: between the two rail ends.
    """
    on, support = foundation(track), track.support
    smeared = 1.5 / (on.beta_per_m * track.spacing_m)
    stiffness = 2 * on.stiffness_n_per_m2 / on.beta_per_m
    moved = wheel.mass_kg + smeared * (track.rail.mass_kg_per_m * track.spacing_m + support.mass_kg)
    omega = np.sqrt(np.array([stiffness / moved]))
    damping = smeared * float(support.dynamic_stiffness(omega)[0].imag / omega[0])
    impact = angle_rad * speed_kmh / 3.6 * np.sqrt(stiffness * wheel.mass_kg * wheel.mass_kg / moved)
    return float(wheel.static_load_n + impact * (1 - np.pi * damping / (4 * np.sqrt(stiffness * moved))))


def simulated_p2_n(vehicle_track: VehicleTrackModel, track: Track, wheel: Wheel, speed_kmh: float) -> float:
    """Return P2 of a simulated passage over a dipped joint: rail ends that bend down over `_JOINT_REACH_M`."""
    share = np.linspace(-1.0, 1.0, 2001)
    depth = JOINT_ANGLE_RAD / 4 * _JOINT_REACH_M
    path = wheel_path_over(_JOINT_REACH_M * share, -depth * (1 - np.abs(share)) ** 2, wheel.radius_m)
    at, speed = _JOINT_AT_SPANS * track.spacing_m, speed_kmh / 3.6
    history = vehicle_track.history(path, speed_kmh, at, until_m=at + 2 * P2_WITHIN_S * speed)
    return p1_p2((history.x_m - at) / speed, history.force_n, 0.0).p2_n


def table(comparisons: Iterable[Comparison]) -> Table:
    """Return what is shown of comparisons: sources by name, differences in per cent."""
    columns = (
        Column("what", "what"),
        Column("source", "source"),
        Column("ours", "ours"),
        Column("theirs", "theirs"),
        Column("difference_percent", "difference %"),
        Column("allowed_percent", "allowed %"),
        Column("within", "within"),
    )
    return Table("Against what others published", columns, [_row(one) for one in comparisons])


def _row(one: Comparison) -> tuple[str | float | bool | None, ...]:
    numbers = [None if number is None else float(f"{number:.5g}") for number in (one.ours, one.theirs)]
    shares = [None if share is None else float(f"{100 * share:.2g}") for share in (one.difference, one.allowed)]
    return (one.what, one.source.partition(":")[0], *numbers, *shares, one.within)
