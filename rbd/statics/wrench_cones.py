"""The wrenches that all contacts together can apply about a point: rays, faces, and whether a wrench is among them.

Forces in friction pyramids at the corners make a polyhedral cone of wrenches: all sums of its rays with weights >= 0, or all
wrenches with faces . wrench >= 0 [CaronPhamNakamura2015]. The faces come from a section across the rays, a polytope of one
dimension less, whose convex hull qhull finds; each is then fitted anew to the rays on it, so that it is exact to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rbd.arrays import Array, as_array, check_positive, is_finite, null_space, range_of, rank_of
from rbd.constraints.constraint import Constraint
from rbd.constraints.convex.polygons import clipped, convex_hull
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError, NoSolution
from rbd.model.state import State
from rbd.problem.programs import linear_program
from rbd.statics.force_balance import force_sets, friction_words, given_rows, place
from rbd.statics.planar_projection import different
from rbd.statics.zero_moment_point import wrench_map

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

MOST_RAYS = 400
"""More rays than this are not taken: the faces of a six-dimensional cone grow with a power of their number."""
_ON = 1e-9
"""A ray of length one that is no farther from a face is on it."""
_FLAT = 1e-8
"""Directions with less than this of the largest are none."""


@dataclass(frozen=True, eq=False)
class ContactWrenchCone(Displayed):
    """All wrenches (force, moment about a point), on the robot, world axes, that contacts can apply within friction pyramids.

    Attributes:
        about: The point in W, shape (3,) [m].
        names: The contacts.
        pyramids: Which pyramids stand for the cones, in words.
        length: By which moments are divided where they are compared with forces [m].
        rays: Extreme rays, shape (k, 6), of unit length with moments over `length`; wrenches are sums of them with weights
            >= 0, and of `lines` with any weights.
        lines: Wrenches that can be applied both ways, orthonormal with moments over `length`, shape (l, 6).
        faces: Inequalities without the redundant ones, faces @ wrench >= 0 [N], shape (m, 6).
        equalities: What every wrench keeps to, equalities @ wrench = 0, shape (e, 6); of two or more soles, none.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> cone = rbd.statics.wrench_cone(solo.standing(), solo.feet(friction=0.7))
        >>> cone.rays.shape, cone.faces.shape, cone.contains([0, 0, 24.5, 0, 0, 0]), cone.contains([0, 0, -24.5, 0, 0, 0])
        ((16, 6), (16, 6), True, False)
    """

    about: Array
    names: tuple[str, ...]
    pyramids: str
    length: float
    rays: Array
    lines: Array
    faces: Array
    equalities: Array

    def margin(self, wrench: Sequence[float] | Array) -> float:
        """How far inside a wrench is [N]: its least distance to a face, moments over `length`; negative outside.

        On equalities that are violated it is minus the violation.
        """
        w = as_array("wrench", wrench)
        if w.shape != (6,) or not is_finite(w):
            raise InputError(f"wrench is {wrench!r:.80}; expected six finite numbers, force [N] and moment [N m].")
        off = float(np.abs(self.equalities @ w).max(initial=0.0))
        inside = float((self.faces @ w).min(initial=np.inf))
        return -off if off > _ON * max(1.0, float(np.abs(w).max())) else inside

    def contains(self, wrench: Sequence[float] | Array) -> bool:
        """Whether forces within the pyramids make this wrench, to rounding of its size."""
        size = float(np.abs(as_array("wrench", wrench)).max(initial=0.0))
        return self.margin(wrench) >= -_ON * max(1.0, size)

    def leans(self, within: float = 10.0) -> Array:
        """Corners of all (f_x / f_z, f_y / f_z) of forces through the point that push up, without a moment, shape (k, 2).

        None where no such force is in the cone.

        Args:
            within: Larger ones are cut off.
        """
        side = check_positive("within", within, 1e6)
        corners = [(-side, -side), (side, -side), (side, side), (-side, side)]
        for x, y, level in [*self.faces[:, :3].tolist(), *self.equalities[:, :3].tolist(), *(-self.equalities[:, :3]).tolist()]:
            size = math.hypot(x, y)
            if size > _ON * max(1.0, abs(level)):
                corners = clipped(corners, x / size, y / size, -level / size)
            elif level < -_ON:
                return np.zeros((0, 2))
        return convex_hull(np.array(corners).reshape(-1, 2))

    def plot(self, ax: Axes) -> list[Artist]:
        """Draw how far a force through the point may lean: see `rbd.visual.plot_wrench_cone`."""
        return drawing("plot_wrench_cone")(ax, self)

    def __str__(self) -> str:
        flat = f", in a space of {6 - len(self.equalities)} dimensions" if len(self.equalities) else ""
        both = f", {len(self.lines)} lines" if len(self.lines) else ""
        return (
            f"wrench cone of {', '.join(self.names)} about ({', '.join(f'{x:.3f}' for x in self.about + 0.0)}) m: "
            f"{len(self.rays)} rays{both}, {len(self.faces)} faces{flat}; {self.pyramids}."
        )


def wrench_cone(
    state: State,
    contacts: Sequence[Constraint],
    *,
    about: Sequence[float] | Array | None = None,
    friction: str = "inscribed",
    margin: float = 0.0,
) -> ContactWrenchCone:
    """The cone of wrenches that contacts can apply to the robot about a point, by its rays and by its faces.

    Bilateral contacts add lines. Contacts between two bodies of the robot, and what is no contact, apply nothing from outside.
    Torque limits are left out: see `push_limits` and `support_region` for them.

    Args:
        state: Where the robot is; its velocity does not count.
        contacts: What it touches, at least one.
        about: The point in W, shape (3,) [m]; the centre of mass if not given.
        friction: "inscribed", the pyramids inside the friction cones with each contact's facets, or "circumscribed".
        margin: Share of each coefficient of friction that is left unused.

    Raises:
        InputError: no contacts, no pyramids, more than `MOST_RAYS` rays, numbers that are not finite.
        NoSolution: the faces were not found.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> cone = rbd.statics.wrench_cone(solo.standing(), solo.feet(friction=0.7))
        >>> weight = [0.0, 0.0, 9.81 * solo.mass, 0.0, 0.0, 0.0]
        >>> cone.contains(weight), round(cone.margin(weight), 3)
        (True, 8.197)
    """
    if isinstance(friction, str) and friction == "cone":
        raise InputError("friction is 'cone', which has no faces; expected 'inscribed' or 'circumscribed'.")
    rows = given_rows(state, contacts)
    sets = force_sets(rows, friction, margin)
    point = state.com.copy() if about is None else place("about", about)
    W = wrench_map(rows, sets.G, point)
    reach = [float(np.linalg.norm(r.patch.corners_W - point, axis=1).max()) for r in rows if r.patch is not None]
    length = max([x for x in reach if x > 1e-6], default=1.0)
    W[3:] /= length
    free, up, down = sets.is_line, sets.below & ~sets.above, sets.above & ~sets.below
    R = np.hstack([W[:, up], -W[:, down]]).T
    R = R[np.linalg.norm(R, axis=1) > _FLAT]
    if len(R) > MOST_RAYS:
        raise InputError(f"the contacts have {len(R)} rays; at most {MOST_RAYS} are taken. Use fewer facets.")
    shape = polyhedral_cone(R / np.linalg.norm(R, axis=1, keepdims=True), W[:, free].T)
    out, back = np.append(np.ones(3), np.full(3, length)), np.append(np.ones(3), np.full(3, 1.0 / length))
    rays, lines, faces, equalities = shape
    names = tuple(r.name for r in rows)
    return ContactWrenchCone(
        point, names, friction_words(sets), length, rays * out, lines * out, faces * back, equalities * back
    )  # fmt: skip


def polyhedral_cone(rays: Array, lines: Array) -> tuple[Array, Array, Array, Array]:
    """(extreme rays, lines, faces, equalities) of the cone of given rays (>= 0) and lines (any sign), rows of dimension n.

    Faces are unit vectors a with a . x >= 0 on the cone, none of them redundant.

    Args:
        rays: Unit vectors, shape (k, n).
        lines: Shape (l, n).

    Raises:
        NoSolution: the faces were not found.
    """
    n = rays.shape[1]
    span = range_of(np.vstack([lines, rays[_both_ways(rays, lines)]]).T, _FLAT)
    rest = rays - (rays @ span) @ span.T
    length = np.linalg.norm(rest, axis=1)
    rest = rest[length > _FLAT] / length[length > _FLAT, None]
    basis = range_of(rest.T, _FLAT) if len(rest) else np.zeros((n, 0))
    equalities = null_space(np.hstack([span, basis]).T, _FLAT).T if span.shape[1] + basis.shape[1] else np.eye(n)
    if not len(rest):
        return np.zeros((0, n)), span.T, np.zeros((0, n)), equalities
    # Rays seen from a foot's height away are nearly alike: coordinates in which they are not keep qhull's facets apart.
    U, sizes, V = np.linalg.svd(rest @ basis, full_matrices=False)
    P = U / np.linalg.norm(U, axis=1, keepdims=True)
    faces = _faces(P)
    on = np.abs(P @ faces.T) <= _ON
    d = basis.shape[1]
    extreme = [i for i in range(len(P)) if rank_of(faces[on[i]], _FLAT) == d - 1] if d > 1 else [0]
    kept = [extreme[i] for i in different(P[extreme], 1e-10)]
    back = (faces / sizes) @ V @ basis.T
    return rest[kept], span.T, back / np.linalg.norm(back, axis=1, keepdims=True), equalities


def _both_ways(rays: Array, lines: Array) -> Array:
    """Which rays' opposites are in the cone too: those with a weight in some sum of rays and lines that is zero."""
    k, l = len(rays), len(lines)
    if not k:
        return np.zeros(0, bool)
    # Most sum of s with s <= w, s <= 1, rays^T w + lines^T u = 0, w >= 0.
    A = np.hstack([rays.T, lines.T, np.zeros((rays.shape[1], k))])
    C = np.hstack([-np.eye(k), np.zeros((k, l)), np.eye(k)])
    bounds = [(0.0, None)] * k + [(None, None)] * l + [(0.0, 1.0)] * k
    found = linear_program(np.append(np.zeros(k + l), -np.ones(k)), C, np.zeros(k), A, np.zeros(rays.shape[1]), bounds=bounds)
    if not found.solved:
        raise NoSolution("which wrenches can be applied both ways was not found. Use fewer contacts.")
    return np.asarray(found.x[k + l :] > 0.5)


def _faces(P: Array) -> Array:
    """Faces of the pointed cone of rays that span their space, unit vectors, shape (m, d)."""
    from scipy.spatial import ConvexHull, QhullError

    d = P.shape[1]
    if d == 1:
        return np.sign(P[:1])
    # A direction that all rays have a part of: most t with P u >= t, |u| <= 1.
    cost = np.append(np.zeros(d), -1.0)
    sides = [(-1.0, 1.0)] * d + [(None, 1.0)]
    found = linear_program(cost, np.hstack([-P, np.ones((len(P), 1))]), np.zeros(len(P)), bounds=sides)
    if not found.solved or not found.x[d] > _FLAT:
        raise NoSolution("the faces of the wrench cone were not found: it is not pointed to rounding.")
    u = found.x[:d] / np.linalg.norm(found.x[:d])
    across = null_space(u[None])
    section = (P @ across) / (P @ u)[:, None]
    if d == 2:
        ends = [int(np.argmin(section)), int(np.argmax(section))]
        rough = np.array([[-P[i, 1], P[i, 0]] for i in ends])
    else:
        try:
            equations = ConvexHull(section).equations
        except (QhullError, ValueError):
            raise NoSolution("the faces of the wrench cone were not found by qhull. Use fewer facets.") from None
        rough = -(equations[:, :-1] @ across.T + equations[:, -1:] * u)
    return _fitted(rough / np.linalg.norm(rough, axis=1, keepdims=True), P, u)


def _fitted(rough: Array, P: Array, inside: Array) -> Array:
    """Faces through the rays that they touch, each once."""
    out: list[Array] = []
    seen: set[bytes] = set()
    for a in rough:
        on = np.abs(P @ a) <= 1e3 * _ON
        if on.tobytes() in seen:
            continue
        seen.add(on.tobytes())
        _, s, V = np.linalg.svd(P[on])
        if len(s) < P.shape[1] - 1 or (s > _FLAT * s[0]).sum() < P.shape[1] - 1:
            continue
        face = V[-1] if V[-1] @ inside > 0.0 else -V[-1]
        if (P @ face).min() >= -_ON:
            out.append(face)
    return np.array(out).reshape(-1, P.shape[1])
