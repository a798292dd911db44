"""A rail's cross-section as finite elements: mesh, and the matrices of waves along the rail.

Displacements are interpolated over the section and exp(-i k x) along the rail (semi-analytical or "2.5-D" finite
elements: Gavric, "Computation of propagative waves in free rail using a finite element technique", J. Sound Vib. 185
(1995); Ryue, Thompson, White & Thompson, "Investigations of propagating wave types in railway tracks", J. Sound Vib.
315 (2008)). With the displacement along the rail written as i U, the stiffness at a wavenumber k is real and symmetric,

    [ A_u + k^2 C_u     k B         ]   for U and, as one vector t, the displacements across and upwards.
    [ k B^T             A_t + k^2 C_t ]

Elements are quadrangles with nine nodes on an outline of arcs; a section that is symmetric and loaded in its axis moves
symmetrically, so that half of it serves.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from skfem import Basis, BilinearForm, ElementQuad2, LinearForm, MeshQuad1, MeshQuad2

from weld_force_ros.physics.arrays import FloatArray
from weld_force_ros.physics.track.outline import Outline

# Of an undivided mesh: columns of half the web, of the foot's wing and of the head's; rows of foot, web and head.
_COLUMNS, _FOOT_WING, _HEAD_WING = 1, 5, 2
_ROWS = (2, 5, 3)
_QUADRATURE = 6
_EDGE = 1e-9


@dataclass(frozen=True)
class Matrices:
    """A section's wave stiffness and mass without density, sparse, or dense in a basis; see the module's text.

    `mass` (n_u, n_u) is that of U, `mass_t` that of t.
    """

    a_u: Any
    c_u: Any
    b: Any
    a_t: Any
    c_t: Any
    mass: Any
    mass_t: Any


class Mesh:
    """A section's mesh, and what is integrated over it.

    Args:
        mesh: of quadrangles with nine nodes, y across from the axis and z upwards.
        half: whether it is one half of a section that moves symmetrically.
    """

    def __init__(self, mesh: MeshQuad2, *, half: bool) -> None:
        self.mesh, self.half, self._times = mesh, half, 2.0 if half else 1.0
        self._basis = Basis(mesh, ElementQuad2(), intorder=_QUADRATURE)
        self.nodes: FloatArray = self._basis.doflocs

    def _integrated(self, form: Callable[..., Any]) -> Any:
        return self._times * BilinearForm(form).assemble(self._basis)

    @cached_property
    def inner(self) -> Any:
        """Return the integral of the product of two fields over the section: (n_node, n_node)."""
        return self._integrated(lambda u, v, w: u * v)

    @property
    def area_m2(self) -> float:
        """Return the section's area."""
        return float(self.inner.sum())

    @property
    def centroid_m(self) -> float:
        """Return the height above the underside."""
        return float((self.inner @ self.nodes[1]).sum()) / self.area_m2

    @property
    def second_moment_m4(self) -> float:
        """Return the second moment of vertical bending."""
        z = self.nodes[1] - self.centroid_m
        return float(z @ (self.inner @ z))

    @property
    def lateral_second_moment_m4(self) -> float:
        """Return the second moment of lateral bending, about the axis."""
        return float(self.nodes[0] @ (self.inner @ self.nodes[0]))

    def matrices(self, lame_pa: float, shear_pa: float) -> Matrices:
        """Return the matrices of an isotropic section with Lamé's constants."""
        m = self.inner
        yy = self._integrated(lambda u, v, w: u.grad[0] * v.grad[0])
        zz = self._integrated(lambda u, v, w: u.grad[1] * v.grad[1])
        yz = self._integrated(lambda u, v, w: u.grad[1] * v.grad[0])  # rows: derivative across
        y = self._integrated(lambda u, v, w: u.grad[0] * v)  # columns: derivative across
        z = self._integrated(lambda u, v, w: u.grad[1] * v)
        stiff = lame_pa + 2 * shear_pa
        across_up = lame_pa * yz + shear_pa * yz.T
        kept = self._kept
        twice = sparse.block_diag([m, m], "csr")[kept][:, kept]
        return Matrices(
            a_u=shear_pa * (yy + zz),
            c_u=stiff * m,
            b=sparse.hstack([lame_pa * y - shear_pa * y.T, lame_pa * z - shear_pa * z.T], "csr")[:, kept],
            a_t=sparse.bmat(
                [[stiff * yy + shear_pa * zz, across_up], [across_up.T, stiff * zz + shear_pa * yy]], "csr"
            )[kept][:, kept],
            c_t=shear_pa * twice,
            mass=m,
            mass_t=twice,
        )

    @cached_property
    def _kept(self) -> Any:
        """Return which displacements across and upwards symmetry leaves free."""
        across = np.ones(self.nodes.shape[1], dtype=bool)
        if self.half:
            across = self.nodes[0] > _EDGE
        return np.flatnonzero(np.concatenate([across, np.ones_like(across)]))

    def displacement(self, t: FloatArray) -> FloatArray:
        """Return the displacements across and upwards, (2, n_node), from the vector `t` of the module's text."""
        full = np.zeros(2 * self.nodes.shape[1])
        full[self._kept] = t
        return full.reshape(2, -1)

    def lines(self) -> NDArray[np.int64]:
        """Return the nodes (3, n) of the elements' sides: ends and middle."""
        ends = self.mesh.facets
        middles = self._basis.dofs.facet_dofs[0]
        return np.stack([ends[0], middles, ends[1]])

    def mean_height(self, within: Callable[[FloatArray, FloatArray], NDArray[np.bool_]]) -> FloatArray:
        """Return the weights (n_t,) whose product with t is the mean vertical displacement of a part of the section.

        Args:
            within: of y and z in m, whether a point belongs to the part; its edge has to be one of elements.
        """
        weights = self._times * LinearForm(lambda v, w: within(np.abs(w.x[0]), w.x[1]) * v).assemble(self._basis)
        return np.asarray(np.concatenate([np.zeros_like(weights), weights / weights.sum()])[self._kept])


def rail_mesh(outline: Outline, *, refine: int = 1, half: bool = True) -> Mesh:
    """Return the the mesh of a rail's section.

    Args:
        outline: of half of it.
        refine: into how many each side of an element is divided.
        half: whether half of the section is enough.
    """
    unmapped = _plan(refine, (1,) if half else (-1, 1))
    flat = MeshQuad2.from_mesh(unmapped)
    side = np.where(flat.doflocs[0] < 0, -1.0, 1.0)
    y, z = _Blocks(outline).at(np.abs(flat.doflocs[0]), flat.doflocs[1])
    return Mesh(replace(flat, doflocs=np.stack([side * y, z])), half=half)


def part_heights(outline: Outline) -> tuple[float, float]:
    """Return the height in m up to which the foot reaches, and from which on the head: those of the web's fillets."""
    return float(outline.points_m[outline.corners[3], 1]), float(outline.points_m[outline.corners[2], 1])


def _plan(refine: int, sides: tuple[int, ...]) -> MeshQuad1:
    """Return the mesh as unit squares: foot, web and head next to the axis, wings of foot and head beside."""
    blocks = [
        (0, 0, _COLUMNS, _ROWS[0]), (1, 0, _FOOT_WING, _ROWS[0]), (0, 1, _COLUMNS, _ROWS[1]),
        (0, 2, _COLUMNS, _ROWS[2]), (1, 2, _HEAD_WING, _ROWS[2]),
    ]  # fmt: skip
    corners = []
    for left, low, columns, rows in blocks:
        a, b = np.linspace(0, 1, refine * columns + 1), np.linspace(low, low + 1, refine * rows + 1)
        a = left + (a * (1.7 - 0.7 * a) if left else a)  # wings are divided finer where their edges are round
        for i in range(len(a) - 1):
            for j in range(len(b) - 1):
                for side in sides:
                    cell = np.array([(a[i], b[j]), (a[i + 1], b[j]), (a[i + 1], b[j + 1]), (a[i], b[j + 1])])
                    corners.append(cell if side > 0 else (cell * (-1, 1))[::-1])
    points, places = np.unique(np.round(np.concatenate(corners), 9), axis=0, return_inverse=True)
    return MeshQuad1(points.T.copy(), places.reshape(-1, 4).T.copy())


class _Blocks:
    """Maps the plan's squares onto the section: each by its four sides, below, above, left and right (Coons)."""

    def __init__(self, outline: Outline) -> None:
        points = outline.points_m
        crown, lower, upper_fillet, lower_fillet, foot_upper, foot_lower = outline.corners
        # On the crown and on the underside, straight above and below the web's sides.
        above = int(np.argmin(np.abs(points[:crown, 0] - points[upper_fillet, 0])))
        below = foot_lower + int(np.argmin(np.abs(points[foot_lower:, 0] - points[lower_fillet, 0])))

        def outer(first: int, last: int) -> _Curve:
            step = 1 if first < last else -1
            return _Curve(points[first : last + step : step])

        def line(begin: FloatArray, end: FloatArray) -> _Curve:
            return _Curve(np.stack([begin, end]))

        foot, head = points[lower_fillet], points[upper_fillet]
        axis = [np.array([0.0, z]) for z in (0.0, foot[1], head[1], points[0, 1])]
        web_below, web_above = line(axis[1], foot), line(axis[2], head)
        foot_inside, head_inside = line(points[below], foot), line(head, points[above])
        self._sides = {
            (0, 0): (line(axis[0], points[below]), web_below, line(axis[0], axis[1]), foot_inside),
            (1, 0): (outer(below, foot_lower), outer(lower_fillet, foot_upper), foot_inside,
                     outer(foot_lower, foot_upper)),
            (0, 1): (web_below, web_above, line(axis[1], axis[2]), outer(lower_fillet, upper_fillet)),
            (0, 2): (web_above, outer(0, above), line(axis[2], axis[3]), head_inside),
            (1, 2): (outer(upper_fillet, lower), outer(above, crown), head_inside, outer(lower, crown)),
        }  # fmt: skip

    def at(self, a: FloatArray, b: FloatArray) -> FloatArray:
        """Return the points (2, n) of the section from those of the plan, each (n,)."""
        places = np.empty((2, len(a)))
        for (left, low), (below, above, before, behind) in self._sides.items():
            inside = (a >= left - _EDGE) & (a <= left + 1 + _EDGE) & (b >= low - _EDGE) & (b <= low + 1 + _EDGE)
            s, t = a[inside] - left, b[inside] - low
            corners = (1 - s) * ((1 - t) * below.begin + t * above.begin) + s * ((1 - t) * below.end + t * above.end)
            between = (1 - t) * below.at(s) + t * above.at(s) + (1 - s) * before.at(t) + s * behind.at(t)
            places[:, inside] = between - corners
        return places


class _Curve:
    """A polyline (n, 2), by the share of its length."""

    def __init__(self, points: FloatArray) -> None:
        length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        self._points, self._share = points, length / length[-1]
        self.begin, self.end = points[0][:, None], points[-1][:, None]

    def at(self, share: FloatArray) -> FloatArray:
        """Return points (2, n)."""
        return np.stack([np.interp(share, self._share, column) for column in self._points.T])
