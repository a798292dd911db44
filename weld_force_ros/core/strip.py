"""Waves of a free rail by finite strips, and its response to forces on head and foot.

At a frequency, every wave exp(-kappa x) of the section solves a linear eigenvalue problem in k^2 = -kappa^2, as
`weld_force_ros.core.section` couples displacement along the rail and in the section by k alone:

    ( [A_u - w^2 M    B         ]       [C_u    0  ] ) [U / k]
    ( [0              A_t - w^2 M]  + k^2 [B^T    C_t] ) [t    ] = 0

Its left eigenvectors are (k U, t), so that the response is a sum over waves, decaying ones included:

    g_ab(x) = sum_m (a . t_m) (b . t_m) / (2 kappa_m n_m) exp(-kappa_m |x|)

Waves are wanted at a thousand frequencies. They are computed in the space of those of a few frequencies and of the
static response to the forces at a few wavenumbers, in which the sum runs over all waves that there are.

Forces act on the head, and are observed, as the mean over its area, and pads on the foot as that over its area, so that
nothing depends on how fine the mesh is at a point. What remains of local deformation at rest - head, web and foot of the
loaded cross-section against its neighbours - is subtracted: it is in the Hertz spring, which stands for all that gives
way near the contact, and in the stiffness of pads, which were identified with beams that have no such compliance. It is
the response at rest of all waves but the three that remain (bending, its near field, extension); that these waves
answer otherwise at higher frequencies is kept. Its size is `FreeRail.local_compliance`. Loss is hysteretic and the same everywhere, which turns frequency and response by 1 + i eta.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy.linalg
import scipy.sparse.linalg
from scipy import sparse
from threadpoolctl import threadpool_limits

from weld_force_ros.core.arrays import Complex, Real
from weld_force_ros.core.outline import Dimensions, outline
from weld_force_ros.core.section import Matrices, Mesh, part_heights, rail_mesh

_BASIS_HZ = (20.0, 600.0, 1400.0, 2400.0, 3600.0, 5000.0, 6500.0)
_BASIS_PER_M = 70.0  # waves that decay or turn no faster
_STATIC_PER_M = (5.0, 20.0, 60.0, 120.0, 240.0, 500.0, 1000.0, 2000.0)
_BASIS_TOLERANCE = 1e-7
_RESTING_HZ = 60j  # at which waves that end near a force are as at rest, and no wave is the same as in motion
_LASTING = 3
WAVES = 11
"""Of a rail's waves, those that decay slowest: the others answer as at rest, which is subtracted anyway."""
_REACHING = 9  # of those, how many reach from support to support
COUPLED = 15
"""With those that are subtracted and reach as far."""


@dataclass(frozen=True)
class Steel:
    """What a rail is made of; `loss_factor` acts on all stress."""

    youngs_modulus_pa: float
    shear_modulus_pa: float
    density_kg_per_m3: float
    loss_factor: float = 0.0

    @property
    def lame_pa(self) -> float:
        """Lamé's first constant."""
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

    decay: Complex
    head: Complex
    foot: Complex
    norm: Complex

    def head_head(self, distance_m: Real) -> Complex:
        """Response (*distance, n_frequency) of the head to a force on it, m/N."""
        return self._between(self.head, self.head, distance_m)

    def head_foot(self, distance_m: Real) -> Complex:
        """As `head_head`, of one to a force on the other."""
        return self._between(self.head, self.foot, distance_m)

    def foot_foot(self, distance_m: Real) -> Complex:
        """As `head_head`, of the foot to a force on it."""
        return self._between(self.foot, self.foot, distance_m)

    def _between(self, at: Complex, force_at: Complex, distance_m: Real) -> Complex:
        parts, distance = at * force_at / self.norm, np.asarray(distance_m)[..., None]
        found = np.zeros(np.broadcast_shapes(distance.shape, parts[0].shape), dtype=np.complex128)
        for part, decay in zip(parts, self.decay, strict=True):
            found += part * np.exp(-decay * distance)
        return found

    def _part(self, waves: slice, sign: int = 1) -> "FreeWaves":
        return FreeWaves(self.decay[waves], self.head[waves], self.foot[waves], sign * self.norm[waves])

    def _with(self, others: "FreeWaves") -> "FreeWaves":
        pairs = ((self.decay, others.decay), (self.head, others.head), (self.foot, others.foot), (self.norm, others.norm))
        count = self.decay.shape[1]
        return FreeWaves(*(np.concatenate([own, np.broadcast_to(its, (len(its), count))]) for own, its in pairs))


class WaveProblem:
    """The waves of a section, in all its degrees of freedom or in the space of a basis."""

    def __init__(self, matrices: Matrices, density: float, observed: Real) -> None:
        """Of `observed` (n_t, n_force): weights of the displacements that are acted on and looked at."""
        self._m, self._density, self._observed = matrices, density, observed
        self._n_u = matrices.mass.shape[0]
        c_u, b, c_t = (_dense(matrix) for matrix in (matrices.c_u, matrices.b, matrices.c_t))
        self._c_u, self._b, self._c_t = c_u, b, c_t
        zero = np.zeros((self._n_u, c_t.shape[0]))
        factors = scipy.linalg.lu_factor(np.block([[c_u, zero], [b.T, c_t]]))
        a = np.block([[_dense(matrices.a_u), b], [zero.T, _dense(matrices.a_t)]])
        mass = scipy.linalg.block_diag(_dense(matrices.mass), _dense(matrices.mass_t))
        self._stiff = -scipy.linalg.lu_solve(factors, a)
        self._inert = density * scipy.linalg.lu_solve(factors, mass)
        founded = np.zeros_like(a)
        founded[self._n_u :, self._n_u :] = np.outer(observed[:, -1], observed[:, -1])
        self._founded = -scipy.linalg.lu_solve(factors, founded)

    def solve(self, square: complex, foundation: complex = 0.0) -> tuple[Complex, Complex, Complex]:
        """Waves at a squared angular frequency, on a foundation in N/m^2 under the last of what is observed.

        Returns:
            Decay constants kappa (n,); eigenvectors (n_u + n_t, n) as the module's text has them; their norms
            2 kappa n (n,).
        """
        operator = self._stiff + (square.real if square.imag == 0 else square) * self._inert
        if foundation:
            operator = operator + foundation * self._founded
        values, vectors = scipy.linalg.eig(operator, overwrite_a=True, check_finite=False)
        decay = decays(values)
        u, t = vectors[: self._n_u], vectors[self._n_u :]
        scale = values * np.einsum("im,im->m", u, self._c_u @ u)
        scale += np.einsum("im,im->m", u, self._b @ t) + np.einsum("im,im->m", t, self._c_t @ t)
        return decay, vectors, 2 * decay * scale

    def observed(self, vectors: Complex) -> Complex:
        """Mean displacements (n_force, n) of waves."""
        return np.asarray(self._observed.T @ vectors[self._n_u :])

    def reduced(self) -> "WaveProblem":
        """The same in the space of a basis: see the module's text."""
        u, t = [], []
        for frequency in _BASIS_HZ:
            decay, vectors, _ = self.solve(complex((2 * np.pi * frequency) ** 2))
            chosen = vectors[:, np.abs(decay) < _BASIS_PER_M]
            u.append(chosen[: self._n_u])
            t.append(chosen[self._n_u :])
        for k in _STATIC_PER_M:
            static = self._static(k)
            u.append(static[: self._n_u])
            t.append(static[self._n_u :])
        m = self._m
        v, w = _basis(np.hstack(u), m.mass), _basis(np.hstack(t), m.mass_t)
        within = Matrices(
            a_u=v.T @ (m.a_u @ v), c_u=v.T @ (m.c_u @ v), b=v.T @ (m.b @ w), a_t=w.T @ (m.a_t @ w),
            c_t=w.T @ (m.c_t @ w), mass=v.T @ (m.mass @ v), mass_t=w.T @ (m.mass_t @ w),
        )  # fmt: skip
        return WaveProblem(within, self._density, w.T @ self._observed)

    def _static(self, k: float) -> Real:
        """Displacement under the observed forces, resting and varying along the rail with wavenumber k."""
        m = self._m
        stiffness = sparse.bmat([[m.a_u + k**2 * m.c_u, k * m.b], [k * m.b.T, m.a_t + k**2 * m.c_t]], "csc")
        force = np.vstack([np.zeros((self._n_u, self._observed.shape[1])), self._observed])
        return np.asarray(scipy.sparse.linalg.spsolve(stiffness, force))


def _dense(matrix: "Real | sparse.spmatrix") -> Real:
    return matrix.toarray() if sparse.issparse(matrix) else np.asarray(matrix)


def decays(squares: Complex) -> Complex:
    """Decay constants kappa of waves from their k^2; of an undamped travelling wave the one that lags with distance."""
    decay = np.sqrt(-squares + 0j)
    travelling = np.abs(decay.real) <= 1e-9 * np.abs(decay)
    return np.asarray(np.where(travelling, 1j * np.abs(decay.imag), decay))


def _basis(vectors: Complex, mass: "Real | sparse.spmatrix") -> Real:
    """Orthonormal vectors, by mass, of the space that complex ones span."""
    parts = np.hstack([vectors.real, vectors.imag])
    lengths = np.sqrt(np.einsum("im,im->m", parts, mass @ parts))
    parts = (parts / np.where(lengths > 0, lengths, 1.0))[:, lengths > 1e-9 * lengths.max()]
    gram = parts.T @ (mass @ parts)
    values, mixes = np.linalg.eigh(gram)
    kept = values > _BASIS_TOLERANCE**2 * values[-1] * len(values)
    return np.asarray(parts @ (mixes[:, kept] / np.sqrt(values[kept])))


class FreeRail:
    """A free rail of a section and a steel."""

    def __init__(self, mesh: Mesh, head: Real, foot: Real, steel: Steel) -> None:
        self.mesh, self.steel = mesh, steel
        matrices = mesh.matrices(steel.lame_pa, steel.shear_modulus_pa)
        self.problem = WaveProblem(matrices, steel.density_kg_per_m3, np.stack([head, foot], axis=1))
        self._reduced = self.problem.reduced()

        at_rest = self._waves(np.array([2 * np.pi * _RESTING_HZ]), None, loss_factor=0.0)
        self._resting = at_rest._part(slice(_LASTING, None), -1)

    @property
    def local_compliance(self) -> tuple[float, float, float]:
        """What is subtracted of the response at rest of head to head, head to foot and foot to foot, m/N."""
        resting, here = self._resting, np.zeros(())
        head, cross, foot = (
            -float(found[0].real)
            for found in (resting.head_head(here), resting.head_foot(here), resting.foot_foot(here))
        )
        return head, cross, foot

    def waves(self, omega: Real | Complex, foundation: "Complex | None" = None) -> FreeWaves:
        """Waves at angular frequencies (n_frequency,), rad/s, with a foundation of the foot in N/m^2, if any."""
        moving = self._waves(omega, foundation, self.steel.loss_factor)
        near, pair = moving._part(slice(_REACHING)), self._resting._part(slice(COUPLED - _REACHING))
        far, rest = moving._part(slice(_REACHING, None)), self._resting._part(slice(COUPLED - _REACHING, None))
        return near._with(pair)._with(far)._with(rest)

    def _waves(self, omega: Real | Complex, foundation: "Complex | None", loss_factor: float) -> FreeWaves:
        loss = 1 + 1j * loss_factor
        squares = np.asarray(omega, dtype=np.complex128) ** 2 / loss
        founded = np.zeros_like(squares) if foundation is None else np.asarray(foundation) / loss

        def slowest(square: complex, below: complex) -> tuple[Complex, Complex, Complex]:
            decay, vectors, norm = self._reduced.solve(square, below)
            chosen = np.argsort(decay.real, kind="stable")[:WAVES]
            return decay[chosen], self._reduced.observed(vectors[:, chosen]), norm[chosen]

        with threadpool_limits(limits=1), ThreadPoolExecutor() as pool:
            found = list(pool.map(slowest, squares.tolist(), founded.tolist()))
        decay, observed, norm = (np.stack(parts, axis=-1) for parts in zip(*found, strict=True))
        return FreeWaves(decay, observed[0], observed[1], norm * loss)


@lru_cache(8)
def rail(section: Dimensions, wear_m: float, steel: Steel, refine: int = 1) -> FreeRail:
    """A free rail; making one takes seconds."""
    shape = outline(section, wear_m)
    mesh = rail_mesh(shape, refine=refine)
    foot_m, head_m = part_heights(shape)
    return FreeRail(mesh, mesh.mean_height(lambda y, z: z > head_m), mesh.mean_height(lambda y, z: z < foot_m), steel)
