"""Waves of a free rail by finite strips, and its response to forces on head and foot.

At a frequency, every wave exp(-kappa x) of the section solves a linear eigenvalue problem in k^2 = -kappa^2, as
`weld_force_ros.physics.track.cross_section` couples displacement along the rail and in the section by k alone:

    ( [A_u - w^2 M    B         ]       [C_u    0  ] ) [U / k]
    ( [0              A_t - w^2 M]  + k^2 [B^T    C_t] ) [t    ] = 0

Its left eigenvectors are (k U, t), so that the response is a sum over waves, decaying ones included:

    g_ab(x) = sum_m (a . t_m) (b . t_m) / (2 kappa_m n_m) exp(-kappa_m |x|)

Waves are wanted at a thousand frequencies. They are computed in the space of those of a few frequencies and of the
static response to the forces at a few wavenumbers, in which the sum runs over all waves that there are.

Forces act on the head, and are observed, as the mean over its area, and pads on the foot as that over its area, so that
nothing depends on how fine the mesh is at a point. What remains of local deformation at rest - head, web and foot of
the loaded cross-section against its neighbours - is subtracted: it is in the Hertz spring, which stands for all that
gives way near the contact, and in the stiffness of pads, which were identified with beams that have no such compliance.
It is the response at rest of all waves but the three that remain (bending, its near field, extension); that those waves
answer otherwise at higher frequencies is kept. Its size is `FreeRail.local_compliance`.

Loss is hysteretic and the same everywhere, which turns squared frequency and response by 1 + i eta.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from scipy import sparse
from threadpoolctl import threadpool_limits

from weld_force_ros.physics.arrays import ComplexArray, FloatArray
from weld_force_ros.physics.threads import executor
from weld_force_ros.physics.track.cross_section import Matrices, Mesh, part_heights, rail_mesh
from weld_force_ros.physics.track.outline import Dimensions, outline

_BASIS_HZ = (20.0, 600.0, 1400.0, 2400.0, 3600.0, 5000.0, 6500.0)
_BASIS_WAVES = 24
_SHIFT = 41.0  # 1/m^2, from which slow waves are counted: no wave's k^2
_STATIC_PER_M = (5.0, 20.0, 60.0, 120.0, 240.0, 500.0, 1000.0, 2000.0)
_BASIS_TOLERANCE = 1e-7
REFINE = 4
"""Into how many an element's sides are divided: with twice as many, receptances to 3 kHz change by half a per cent."""
_RESTING_HZ = 60j  # at which waves that end near a force are as at rest, and no wave is the same as in motion
_LASTING = 3
WAVES = 11
"""Of a rail's waves, those that decay slowest: the others answer as at rest, which is subtracted anyway."""
_REACHING = 9  # of those, how many reach from support to support
COUPLED = 15
"""With those that are subtracted and reach as far."""


@dataclass(frozen=True)
class Steel:
    """A rail's material, without its loss: waves at any loss are found in one reduction."""

    youngs_modulus_pa: float
    shear_modulus_pa: float
    density_kg_per_m3: float

    @property
    def lame_pa(self) -> float:
        """Return Lamé's first constant."""
        e, g = self.youngs_modulus_pa, self.shear_modulus_pa
        return g * (e - 2 * g) / (3 * g - e)


@dataclass(frozen=True)
class FreeWaves:
    """Waves of a free rail at many frequencies, those that decay towards +x.

    A response, of head or foot to a force on either, is the sum of products over the norm. The first `COUPLED` of them
    reach from support to support. Those that stand for what is subtracted have a negative norm.

    Attributes:
        decay: (n_wave, n_frequency), 1/m.
        head, foot: (n_wave, n_frequency), mean vertical displacement of either.
        norm: (n_wave, n_frequency), N/m for displacements without unit.
    """

    decay: ComplexArray
    head: ComplexArray
    foot: ComplexArray
    norm: ComplexArray

    def head_head(self, distance_m: FloatArray) -> ComplexArray:
        """Return the response (*distance, n_frequency) of the head to a force on it, m/N."""
        return self._between(self.head, self.head, distance_m)

    def head_foot(self, distance_m: FloatArray) -> ComplexArray:
        """Return the response of one to a force on the other, as `head_head`."""
        return self._between(self.head, self.foot, distance_m)

    def foot_foot(self, distance_m: FloatArray) -> ComplexArray:
        """Return the response of the foot to a force on it, as `head_head`."""
        return self._between(self.foot, self.foot, distance_m)

    def _between(self, at: ComplexArray, force_at: ComplexArray, distance_m: FloatArray) -> ComplexArray:
        parts, distance = at * force_at / self.norm, np.asarray(distance_m)[..., None]
        found = np.zeros(np.broadcast_shapes(distance.shape, parts[0].shape), dtype=np.complex128)
        for part, decay in zip(parts, self.decay, strict=True):
            found += part * np.exp(-decay * distance)
        return found

    def _part(self, waves: slice, sign: int = 1) -> "FreeWaves":
        return FreeWaves(self.decay[waves], self.head[waves], self.foot[waves], sign * self.norm[waves])

    def _with(self, others: "FreeWaves") -> "FreeWaves":
        pairs = (
            (self.decay, others.decay),
            (self.head, others.head),
            (self.foot, others.foot),
            (self.norm, others.norm),
        )
        count = self.decay.shape[1]
        return FreeWaves(*(np.concatenate([own, np.broadcast_to(its, (len(its), count))]) for own, its in pairs))


class WaveProblem:
    """The waves of a section in the space of a basis, whose matrices are small and dense.

    Args:
        matrices: in that space.
        density: kg/m3.
        observed: (n_t, n_force), weights of the displacements that are acted on and looked at.
    """

    def __init__(self, matrices: Matrices, density: float, observed: FloatArray) -> None:
        m = matrices
        self._m, self._observed, self._n_u = m, observed, len(m.mass)
        zero = np.zeros((self._n_u, len(m.mass_t)))
        factors = scipy.linalg.lu_factor(np.block([[m.c_u, zero], [m.b.T, m.c_t]]))
        founded = np.zeros((self._n_u + len(m.mass_t),) * 2)
        founded[self._n_u :, self._n_u :] = np.outer(observed[:, -1], observed[:, -1])
        self._stiff = -scipy.linalg.lu_solve(factors, np.block([[m.a_u, m.b], [zero.T, m.a_t]]))
        self._inert = density * scipy.linalg.lu_solve(factors, scipy.linalg.block_diag(m.mass, m.mass_t))
        self._founded = -scipy.linalg.lu_solve(factors, founded)

    def solve(self, square: complex, foundation: complex = 0.0) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
        """Return the waves at a squared angular frequency, on a foundation in N/m^2 under the last of what is observed.

        Returns:
            Decay constants kappa (n,); eigenvectors (n_u + n_t, n) as the module's text has them; their norms
            2 kappa n (n,).
        """
        operator = self._stiff + (square.real if square.imag == 0 else square) * self._inert
        if foundation:
            operator = operator + foundation * self._founded
        values, vectors = np.linalg.eig(operator)
        decay, m = decays(values), self._m
        u, t = self.parts(vectors)
        scale = values * np.einsum("im,im->m", u, m.c_u @ u)
        scale += np.einsum("im,im->m", u, m.b @ t) + np.einsum("im,im->m", t, m.c_t @ t)
        return decay, vectors, 2 * decay * scale

    def parts(self, vectors: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
        """Return the displacement along the rail over k, and in the section, of eigenvectors."""
        return vectors[: self._n_u], vectors[self._n_u :]

    def observed(self, vectors: ComplexArray) -> ComplexArray:
        """Return the mean displacements (n_force, n) of waves."""
        return np.asarray(self._observed.T @ self.parts(vectors)[1])


def _reduced(m: Matrices, density: float, observed: FloatArray) -> tuple[Matrices, FloatArray, FloatArray]:
    """Return the matrices in the space of a basis, see the module's text; and the basis (n, n_basis) of U and of t."""
    found = [_slow_waves(m, density, (2 * np.pi * hz) ** 2) for hz in _BASIS_HZ]
    found += [_static(m, observed, k) for k in _STATIC_PER_M]
    along, across_up = np.split(np.hstack(found), [m.mass.shape[0]])
    v, w = _basis(along, m.mass), _basis(across_up, m.mass_t)
    reduced = Matrices(
        a_u=v.T @ (m.a_u @ v), c_u=v.T @ (m.c_u @ v), b=v.T @ (m.b @ w), a_t=w.T @ (m.a_t @ w),
        c_t=w.T @ (m.c_t @ w), mass=v.T @ (m.mass @ v), mass_t=w.T @ (m.mass_t @ w),
    )  # fmt: skip
    return reduced, v, w


def _slow_waves(m: Matrices, density: float, square: float) -> ComplexArray:
    """Return eigenvectors (n_u + n_t, n_wave) of the waves that decay and turn slowest, by shift and inverse."""
    n_u, n_t = m.mass.shape[0], m.mass_t.shape[0]
    here = sparse.bmat([[m.a_u - square * density * m.mass, m.b], [None, m.a_t - square * density * m.mass_t]], "csc")
    slope = sparse.bmat([[m.c_u, None], [m.b.T, m.c_t]], "csc")
    solve = scipy.sparse.linalg.factorized(here + _SHIFT * slope)
    operator = scipy.sparse.linalg.LinearOperator((n_u + n_t,) * 2, lambda x: solve(slope @ x))
    return np.asarray(scipy.sparse.linalg.eigs(operator, _BASIS_WAVES, v0=np.ones(n_u + n_t))[1])


def _static(m: Matrices, observed: FloatArray, k: float) -> ComplexArray:
    """Return displacements (n_u + n_t, n_force) under resting forces that vary along the rail by wavenumber k."""
    stiffness = sparse.bmat([[m.a_u + k**2 * m.c_u, k * m.b], [k * m.b.T, m.a_t + k**2 * m.c_t]], "csc")
    force = np.vstack([np.zeros((m.mass.shape[0], observed.shape[1])), observed])
    return np.asarray(scipy.sparse.linalg.spsolve(stiffness, force))


def decays(squares: ComplexArray) -> ComplexArray:
    """Return decay constants kappa of waves from their k^2; of a travelling wave the one that lags with distance."""
    decay = np.sqrt(-squares + 0j)
    travelling = np.abs(decay.real) <= 1e-9 * np.abs(decay)
    return np.asarray(np.where(travelling, 1j * np.abs(decay.imag), decay))


def _basis(vectors: ComplexArray, mass: "FloatArray | sparse.spmatrix") -> FloatArray:
    """Return orthonormal vectors, by mass, of the space that complex ones span."""
    parts = np.hstack([vectors.real, vectors.imag])
    lengths = np.sqrt(np.einsum("im,im->m", parts, mass @ parts))
    parts = (parts / np.where(lengths > 0, lengths, 1.0))[:, lengths > 1e-9 * lengths.max()]
    gram = parts.T @ (mass @ parts)
    values, mixes = np.linalg.eigh(gram)
    kept = values > _BASIS_TOLERANCE**2 * values[-1] * len(values)
    return np.asarray(parts @ (mixes[:, kept] / np.sqrt(values[kept])))


@dataclass(frozen=True)
class WaveShape:
    """A travelling wave: `displacement` (3, n_node) along the rail (a quarter period ahead), across and upwards."""

    wavenumber_per_m: float
    displacement: FloatArray


class FreeRail:
    """A free rail of a section and a steel."""

    def __init__(self, mesh: Mesh, head: FloatArray, foot: FloatArray, steel: Steel) -> None:
        self.mesh = mesh
        matrices = mesh.matrices(steel.lame_pa, steel.shear_modulus_pa)
        observed = np.stack([head, foot], axis=1)
        reduced, self._along, self._across_up = _reduced(matrices, steel.density_kg_per_m3, observed)
        self._problem = WaveProblem(reduced, steel.density_kg_per_m3, self._across_up.T @ observed)

        at_rest = self.moving(np.array([2 * np.pi * _RESTING_HZ]), loss_factor=0.0)
        self._resting = at_rest._part(slice(_LASTING, None), -1)

    @property
    def local_compliance(self) -> tuple[float, float, float]:
        """Return what is subtracted at rest of head to head, head to foot and foot to foot, m/N."""
        resting, here = self._resting, np.zeros(())
        head, cross, foot = (
            -float(found[0].real)
            for found in (resting.head_head(here), resting.head_foot(here), resting.foot_foot(here))
        )
        return head, cross, foot

    def waves(
        self,
        omega: FloatArray | ComplexArray,
        foundation: "ComplexArray | None" = None,
        *,
        loss_factor: float = 0.0,
        threads: int | None = None,
    ) -> FreeWaves:
        """Return the waves at angular frequencies (n_frequency,), rad/s.

        Args:
            omega: (n_frequency,).
            foundation: (n_frequency,), of the foot, N/m^2, if any.
            loss_factor: acts on all stress.
            threads: that frequencies are shared out to; one a core, if not given.
        """
        moving = self.moving(omega, foundation, loss_factor, threads=threads)
        near, pair = moving._part(slice(_REACHING)), self._resting._part(slice(COUPLED - _REACHING))
        far, rest = moving._part(slice(_REACHING, None)), self._resting._part(slice(COUPLED - _REACHING, None))
        return near._with(pair)._with(far)._with(rest)

    def moving(
        self,
        omega: FloatArray | ComplexArray,
        foundation: "ComplexArray | None" = None,
        loss_factor: float = 0.0,
        *,
        threads: int | None = None,
    ) -> FreeWaves:
        """Return the same with nothing subtracted."""
        loss = 1 + 1j * loss_factor
        squares = np.asarray(omega, dtype=np.complex128) ** 2 / loss
        founded = np.zeros_like(squares) if foundation is None else np.asarray(foundation) / loss

        def slowest(square: complex, below: complex) -> tuple[ComplexArray, ComplexArray, ComplexArray]:
            decay, vectors, norm = self._problem.solve(square, below)
            chosen = np.argsort(decay.real, kind="stable")[:WAVES]
            return decay[chosen], self._problem.observed(vectors[:, chosen]), norm[chosen]

        with threadpool_limits(limits=1), executor(threads) as pool:
            found = list(pool.map(slowest, squares.tolist(), founded.tolist()))
        decay, observed, norm = (np.stack(parts, axis=-1) for parts in zip(*found, strict=True))
        return FreeWaves(decay, observed[0], observed[1], norm * loss)

    def travelling(self, frequency_hz: float) -> list[WaveShape]:
        """Return the the waves that travel at a frequency without loss, the longest first."""
        decay, vectors, _ = self._problem.solve(complex((2 * np.pi * frequency_hz) ** 2))
        found = []
        for n in np.flatnonzero(np.abs(decay.real) <= 1e-6 * np.abs(decay)):
            k, (along, across_up) = float(decay[n].imag), self._problem.parts(vectors[:, n])
            displacement = k * (self._along @ along.real), self.mesh.displacement(self._across_up @ across_up.real)
            found.append(WaveShape(k, np.vstack(displacement)))
        return sorted(found, key=lambda shape: shape.wavenumber_per_m)


@lru_cache(8)
def rail(section: Dimensions, wear_m: float, steel: Steel, refine: int = REFINE) -> FreeRail:
    """Return a free rail; making one takes seconds."""
    shape = outline(section, wear_m)
    mesh = rail_mesh(shape, refine=refine)
    foot_m, head_m = part_heights(shape)
    return FreeRail(mesh, mesh.mean_height(lambda y, z: z > head_m), mesh.mean_height(lambda y, z: z < foot_m), steel)
