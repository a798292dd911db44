"""Cross-sections and waves along them, held against closed forms of bars and rods, and the standard's numbers."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import jv
from skfem import MeshQuad1, MeshQuad2

from weld_force_ros.errors import InputError, TrackError
from weld_force_ros.physics.track.cross_section import Mesh, part_heights, rail_mesh
from weld_force_ros.physics.track.outline import outline
from weld_force_ros.physics.track.waveguide_rail import REFINE, FreeRail, Steel
from weld_force_ros.simulation import section_file

STEEL = Steel(210e9, 81e9, 7850.0)
LONGITUDINAL, SHEAR = np.sqrt((STEEL.lame_pa + 2 * 81e9) / 7850), np.sqrt(81e9 / 7850)
ROD_M = 0.02


def rod(divisions: int = 6) -> Mesh:
    """A disc: a square, each of whose sides is drawn out to a quarter of the circle."""
    ticks = np.linspace(-1, 1, divisions + 1)
    square = MeshQuad2.from_mesh(MeshQuad1.init_tensor(ticks, ticks))
    x, y = square.doflocs
    disc = ROD_M * np.stack([x * np.sqrt(1 - y**2 / 2), y * np.sqrt(1 - x**2 / 2)])
    return Mesh(replace(square, doflocs=disc), half=False)


def bar(width_m: float, height_m: float) -> Mesh:
    ticks = np.linspace(-0.5, 0.5, 5)
    square = MeshQuad2.from_mesh(MeshQuad1.init_tensor(ticks, ticks))
    return Mesh(replace(square, doflocs=square.doflocs * [[width_m], [height_m]]), half=False)


def wavenumbers(mesh: Mesh, frequency_hz: float) -> list[float]:
    whole = mesh.mean_height(lambda y, z: y < np.inf)
    free = FreeRail(mesh, whole, whole, STEEL)
    return [wave.wavenumber_per_m for wave in free.travelling(frequency_hz)]


def pochhammer(k: float, omega: float, around: int) -> float:
    """What vanishes at a rod's waves with `around` periods round it: the tractions of three solutions on its surface.

    They are the gradient of a potential and the single and double curl of one along the rod, each a Bessel function
    of the radius; rows are tractions outwards, round and along.
    """
    n, a, mu = around, ROD_M, STEEL.shear_modulus_pa
    p, q = (np.sqrt(omega**2 / c**2 - k**2 + 0j) for c in (LONGITUDINAL, SHEAR))

    def bessel(s: complex) -> tuple[complex, complex]:
        first = s * (jv(n - 1, s * a) - jv(n + 1, s * a)) / 2 / jv(n, s * a)  # derivatives over the function
        return first, -first / a - (s**2 - n**2 / a**2)

    d, dd = bessel(p)
    e, ee = bessel(q)
    #        outwards, its slope,             round, its slope,                 along, its slope
    motions = (
        (d, dd, -n / a, -n * (d / a - 1 / a**2), -1j * k, -1j * k * d),
        (n / a, n * (e / a - 1 / a**2), -e, -ee, 0.0, 0.0),
        (-1j * k * e, -1j * k * ee, 1j * k * n / a, 1j * k * n * (e / a - 1 / a**2), q**2, q**2 * e),
    )
    dilation = (-(p**2 + k**2), 0.0, 0.0)
    tractions = np.array([
        [STEEL.lame_pa * div + 2 * mu * dr, mu * (-n / a * r + dt - t / a), mu * (-1j * k * r + dx)]
        for (r, dr, t, dt, _, dx), div in zip(motions, dilation, strict=True)
    ]).T  # fmt: skip
    tractions[2] *= 1j
    tractions[:, 2] *= 1j
    kept = [0, 2] if n == 0 else [0, 1, 2]  # without variation round the rod, it does not twist
    return float(np.linalg.det(tractions[np.ix_(kept, kept)] / mu).real)


def extension(k: float, omega: float) -> float:
    return pochhammer(k, omega, 0)


def flexure(k: float, omega: float) -> float:
    return pochhammer(k, omega, 1)


@pytest.mark.parametrize("frequency_hz", [5e3, 20e3, 40e3])
@pytest.mark.parametrize("equation", [extension, flexure])
def test_rods_first_branches_are_pochhammers(equation, frequency_hz):
    omega = 2 * np.pi * frequency_hz
    near = [k for k in wavenumbers(rod(), frequency_hz) if equation(0.995 * k, omega) * equation(1.005 * k, omega) < 0]
    assert near


def test_rods_torsion_travels_at_the_speed_of_shear():
    found = wavenumbers(rod(), 20e3)
    assert min(abs(k * SHEAR / (2 * np.pi * 20e3) - 1) for k in found) < 1e-3


def test_bars_waves_at_low_frequency_are_the_textbooks():
    width, height, omega = 0.03, 0.06, 2 * np.pi * 50.0
    found = np.array(wavenumbers(bar(width, height), 50.0))
    odd = np.arange(1, 40, 2)
    twist = (
        width**3
        * height
        * (1 / 3 - 64 / np.pi**5 * width / height * np.sum(np.tanh(odd * np.pi * height / width / 2) / odd**5))
    )
    polar = width * height * (width**2 + height**2) / 12
    expected = [
        omega * np.sqrt(7850 / 210e9),
        omega * np.sqrt(7850 * polar / (81e9 * twist)),
        *((omega**2 * 7850 * 12 / (210e9 * side**2)) ** 0.25 for side in (width, height)),
    ]
    for k in expected:
        assert np.abs(found / k - 1).min() < 5e-3
    assert len(found) == 4


@pytest.mark.parametrize("name", section_file.drawn())
def test_section_is_the_standards(name):
    found, standard = (
        rail_mesh(outline(section_file.outline_of(name)), refine=REFINE),
        section_file.load(name).standard,
    )
    assert found.area_m2 * 1e4 == pytest.approx(standard.area_cm2, rel=3e-3)
    assert found.centroid_m * 1e3 == pytest.approx(standard.centroid_mm, rel=3e-3)
    assert found.second_moment_m4 * 1e8 == pytest.approx(standard.second_moment_cm4, rel=3e-3)
    assert found.lateral_second_moment_m4 * 1e8 == pytest.approx(standard.lateral_second_moment_cm4, rel=3e-3)


def test_worn_head_loses_what_was_worn():
    dimensions = section_file.outline_of("60E1")
    new, worn = outline(dimensions), outline(dimensions, wear_m=3e-3)
    assert worn.points_m[0, 1] == pytest.approx(new.points_m[0, 1] - 3e-3)
    lost_m2 = new.area_m2 - worn.area_m2
    assert 3e-3 * 0.065 < lost_m2 < 3e-3 * 0.075  # about the head's width
    with pytest.raises(InputError, match="crosses itself"):
        outline(dimensions, wear_m=30e-3)


def test_rigid_motion_costs_nothing_and_weighs_what_the_rail_weighs():
    mesh = rail_mesh(outline(section_file.outline_of("60E1")), half=False)
    m = mesh.matrices(STEEL.lame_pa, STEEL.shear_modulus_pa)
    y, z = mesh.nodes
    lifted = np.concatenate([np.zeros_like(y), np.ones_like(y)])
    turned = np.concatenate([-z, y])
    for motion in (lifted, turned):
        stiffest = np.abs(m.a_t).max() * (motion @ motion)
        assert abs(motion @ (m.a_t @ motion)) < 1e-10 * stiffest
    assert lifted @ (m.mass_t @ lifted) == pytest.approx(mesh.area_m2)
    assert np.ones_like(y) @ (m.c_u @ np.ones_like(y)) == pytest.approx((STEEL.lame_pa + 2 * 81e9) * mesh.area_m2)


def harmonic(mesh: Mesh, head: np.ndarray, k: float, frequency_hz: float) -> np.ndarray:
    """Displacement t under a force on the head that varies along the rail with wavenumber k."""
    m, inertia = mesh.matrices(STEEL.lame_pa, STEEL.shear_modulus_pa), 7850 * (2 * np.pi * frequency_hz) ** 2
    along = (m.a_u + k**2 * m.c_u - inertia * m.mass).toarray()
    across_up = (m.a_t + k**2 * m.c_t - inertia * m.mass_t).toarray()
    cross = k * m.b.toarray()
    return np.linalg.solve(across_up - cross.T @ np.linalg.solve(along, cross), head)


@pytest.mark.parametrize(("k", "frequency_hz"), [(3.0, 100.0), (12.0, 2500.0), (80.0, 4000.0)])
def test_symmetric_section_moves_upwards_under_a_force_in_its_axis(k, frequency_hz):
    shape = outline(section_file.outline_of("60E1"))
    head_m = part_heights(shape)[1]
    responses = []
    for half in (True, False):
        mesh = rail_mesh(shape, half=half)
        head = mesh.mean_height(lambda y, z: z > head_m)
        moved = harmonic(mesh, head, k, frequency_hz)
        responses.append(head @ moved)
        across, up = mesh.displacement(moved)
        if not half:
            lateral = mesh.mean_height(lambda y, z: z > head_m)[len(moved) // 2 :] @ across
            assert abs(lateral) < 1e-9 * np.abs(up).max()
            assert np.abs(across).max() > 1e-3 * np.abs(up).max()
    assert responses[0] == pytest.approx(responses[1], rel=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("height_mm: 172", "height_mm: -172", "height_mm"),
        ("thickness_mm: 16.5", "thickness_in: 0.65", "thickness_in"),
        ("radius_mm: 40", "radius_mm: wide", "radius_mm"),
        ("turn_deg: 14", "turn_deg: 400", "turn_deg"),
        ("name: 60E1", "name: &a [*a]", "anchors"),
    ],
)
def test_bad_section_file_is_refused_with_one_line(old, new, said):
    from importlib import resources

    text = (resources.files("weld_force_ros.data") / "sections" / "60E1.yaml").read_text(encoding="utf-8")
    assert old in text
    with pytest.raises(TrackError, match=said) as caught:
        section_file.parse(text.replace(old, new, 1).encode(), "mine")
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("rail section mine:")


@pytest.mark.parametrize("change", [{"web_m": 0.2}, {"foot_top": (0.2, 2.75)}, {"fishing": (0.02, 2.75)}])
def test_dimensions_that_make_no_section_are_refused(change):
    with pytest.raises(InputError, match="crosses itself"):
        outline(replace(section_file.outline_of("60E1"), **change))


@pytest.mark.parametrize(
    "change",
    [
        {"crown": ((0.3, 0.5), (0.013, None))},
        {"crown": ((0.3, 0.02), (0.08, 0.01), (0.013, None))},
        {"crown": ((0.3, 0.01), (0.08, None), (0.013, None))},
        {"crown": ((0.3, 0.01), (0.013, 0.036))},
        {"fillets": (((0.003, 0.5),), *section_file.outline_of("60E1").fillets[1:])},
    ],
)
def test_arcs_that_lead_nowhere_are_refused(change):
    with pytest.raises(InputError, match=r"crown|fillet"):
        outline(replace(section_file.outline_of("60E1"), **change))
