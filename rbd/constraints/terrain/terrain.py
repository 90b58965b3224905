"""`Terrain`: ground that is not a plane: boxes, stairs, slopes, convex meshes, grids of heights; lifts and conveyors."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from rbd.arrays import ABOVE_ZERO, Array, as_array, as_finite, check_finite, check_flag, check_number, check_whole, lazy
from rbd.constraints.terrain.pieces import LEAST_M, Heights, Piece, Plates, Polytopes, overlaps_of, piece_of, plane_at
from rbd.constraints.terrain.terrain_files import file_path, mesh_pieces, world_pieces
from rbd.constraints.terrain.touches import Touches
from rbd.displayed import Displayed, drawing
from rbd.errors import InputError
from rbd.errors.inputs import check_known, listed_items
from rbd.problem.cones import check_friction
from rbd.problem.ground import Ground
from rbd.problem.motions import Motion

SUNK_M = 0.02
"""A point that is less than this below a piece's top is on that piece; deeper, the next piece below counts [m]."""
DEEP_M = 2.0
"""How far boxes of stairs go below their first step [m]."""


class Terrain(Displayed):
    """Convex pieces, at rest or moving, on which contacts stand: `on=` of a contact, `robot.feet`, `robot.soles`.

    A contact touches each piece along that piece's own normal: a sole half over an edge rests on its part over the tread, a toe
    beside a riser touches nothing. Pieces that meet at the same level are one surface: their seams have no contact points, but
    where the pieces move differently.

    A piece moves, as a lift or a conveyor, by `with_motion`; contacts on it take it at the time of the state. What asks for
    heights, planes or distances takes pieces where they were given: `terrain.at(t)` has them where they are at a time.

    Attributes:
        names: Of the pieces.
        solids: The pieces as they were given, grids of heights whole.
        friction: Coulomb's coefficient of all contacts on it; None: each contact's own.

    Args:
        pieces: {name: `rbd.Ground` with a point, a half-space; a Coal shape (box, cylinder, convex mesh: its hull); or (shape,
            pose in W as pin.SE3, 4 x 4, or a place (3,))}.
        friction: Of all contacts on it.

    Raises:
        InputError: no pieces, round shapes, grounds with a velocity, numbers that are not finite.

    Example:
        >>> terrain = rbd.Terrain.stairs(rise=0.1, depth=0.3, n=3)
        >>> terrain.heights_of([[0.1, 0.0, 0.15], [0.7, 0.0, 0.15]]).round(3), terrain.ground_at(0.4, 0.0).point
        (array([ 0.05, -0.15]), array([0.4, 0. , 0.2]))
    """

    def __init__(self, pieces: Mapping[str, object], friction: float | None = None) -> None:
        if not isinstance(pieces, Mapping) or not pieces:
            raise InputError(
                f"the pieces of a terrain are {pieces!r:.80}; expected {{name: rbd.Ground(...) or (shape, pose)}}, or use "
                "rbd.Terrain.boxes, .stairs, .heights, .mesh."
            )
        if friction is not None:
            check_friction(friction, 4)
        self.friction = None if friction is None else float(friction)
        self.solids: tuple[Piece | Heights, ...] = tuple([piece_of(str(name), given) for name, given in pieces.items()])
        self._fields = tuple(piece for piece in self.solids if isinstance(piece, Heights))
        self._pieces = [piece for piece in self.solids if isinstance(piece, Piece)]
        self._known: set[tuple[Any, ...]] = set()
        self._arrays: Polytopes | None = None
        self._now: tuple[float, Polytopes] | None = None
        self._planes: dict[tuple[int, ...], int] = {}
        self._plane_of: dict[tuple[int, int], int] = {}
        self.names = tuple(str(name) for name in pieces)

    @classmethod
    def boxes(cls, *ends: Sequence[Sequence[float]] | Array, friction: float | None = None) -> Terrain:
        """Boxes along W's axes.

        Args:
            ends: (lowest corner, highest corner) of each, shapes (3,) [m].
            friction: As of the class.

        Raises:
            InputError: a box without size.

        Example:
            >>> rbd.Terrain.boxes([(-1, -1, -0.5), (0, 1, 0)], [(0, -1, -0.5), (1, 1, 0.1)]).names
            ('box 0', 'box 1')
        """
        out: dict[str, object] = {}
        for i, given in enumerate(ends):
            low, high = as_finite(f"ends of box {i}", given, (2, 3))
            if not (high > low).all():
                raise InputError(f"box {i} goes from {low} to {high}; expected its lowest corner, then its highest.")
            out[f"box {i}"] = coal.Box(*(high - low).tolist()), pin.SE3(np.eye(3), 0.5 * (low + high))
        return cls(out, friction)

    @classmethod
    def stairs(
        cls,
        rise: float,
        depth: float,
        n: int,
        *,
        start: Sequence[float] = (0.0, 0.0, 0.0),
        width: float = 2.0,
        landing: float = 2.0,
        down: bool = False,
        friction: float | None = None,
    ) -> Terrain:
        """A floor and n steps up along x, with a landing behind the last one.

        Args:
            rise: Height of a step [m]; negative: down.
            depth: Of a tread [m].
            n: Number of steps.
            start: The foot of the first riser, at the level of the floor, shape (3,) [m].
            width: Along y, `start` in the middle [m].
            landing: Length of the floor before the first step, and of the last step or of the floor behind [m].
            down: Whether n - 1 more steps lead down again, to the floor.
            friction: As of the class.

        Raises:
            InputError: sizes that are not positive.

        Example:
            >>> up_and_down = rbd.Terrain.stairs(0.1, 0.3, 3, down=True)
            >>> [round(float(up_and_down.ground_at(x, 0.0).point[2]), 2) for x in (-0.1, 0.1, 0.4, 0.7, 1.0, 1.3, 1.6)]
            [0.0, 0.1, 0.2, 0.3, 0.2, 0.1, 0.0]
        """
        x, y, z = as_finite("start of stairs", start, (3,)).tolist()
        sizes = {"depth": depth, "width": width, "landing": landing}
        depth, width, landing = (
            check_number(f"{what} of stairs", s, LEAST_M, 1e4, expected="a length > 0 [m]") for what, s in sizes.items()
        )
        check_number("rise of stairs", rise, -10.0, 10.0, expected="a height [m]")
        check_whole("number n of steps of stairs", n, 10_000)
        check_flag("down of stairs", down)
        levels = [*range(1, n + 1), *(range(n - 1, -1, -1) if down else ())]
        base = z + min(0.0, n * rise) - DEEP_M
        out = [[(x - landing, y - width / 2, base), (x, y + width / 2, z)]]
        for i, level in enumerate(levels):
            far = x + i * depth + (landing if i == len(levels) - 1 else depth)
            out.append([(x + i * depth, y - width / 2, base), (far, y + width / 2, z + level * rise)])
        return cls.boxes(*out, friction=friction)

    @classmethod
    def heights(
        cls, z: Array, spacing: float | Sequence[float], *, origin: Sequence[float] = (0.0, 0.0), friction: float | None = None
    ) -> Terrain:
        """A grid of heights: two triangles a cell, or one square where its corners are in one plane.

        Args:
            z: Height at (x, y) = origin + spacing (i, j), shape (n, m) [m].
            spacing: Along x and y [m], one number for both.
            origin: Place of z[0, 0], shape (2,) [m].
            friction: As of the class.

        Raises:
            InputError: heights that are not finite, fewer than two rows or columns.

        Example:
            >>> x = np.arange(5) * 0.25
            >>> slope = rbd.Terrain.heights(np.repeat(0.2 * x[:, None], 3, axis=1), 0.25)
            >>> slope.ground_at(0.3, 0.1).normal.round(3)
            array([-0.196,  0.   ,  0.981])
        """
        return cls({"heights": Heights.of("heights", z, spacing, origin)}, friction)

    @classmethod
    def mesh(
        cls, path: str | Path, *, pose: pin.SE3 | None = None, scale: float = 1.0, friction: float | None = None
    ) -> Terrain:
        """The connected parts of a mesh file, each of which is convex.

        Args:
            path: .stl, .obj or .dae.
            pose: Of the mesh in W; None: the identity.
            scale: Of its lengths.
            friction: As of the class.

        Raises:
            InputError: a file that cannot be read; a part that is not convex.
        """
        check_number("scale of a mesh", scale, ABOVE_ZERO, 1e6, expected="a number > 0")
        return cls(mesh_pieces(file_path(path), pose, float(scale)), friction)

    @classmethod
    def read(cls, path: str | Path, *, friction: float | None = None, package_dirs: Sequence[str | Path] = ()) -> Terrain:
        """The collision shapes of a world of fixed bodies in URDF, or in MJCF (boxes, planes, meshes, grids of heights).

        Args:
            path: The file; MJCF needs the extra `mujoco`.
            friction: As of the class; that of the file is not read.
            package_dirs: Where `package://` begins.

        Raises:
            ModelError: a file that cannot be read.
            InputError: bodies that move, no shapes, shapes that are round.
        """
        folders = listed_items("package_dirs", package_dirs, "a list of folders")
        return cls(world_pieces(file_path(path), [file_path(each) for each in folders]), friction)

    @property
    def pieces(self) -> tuple[Piece, ...]:
        """Its pieces, of a grid of heights those that were needed so far."""
        return tuple(self._pieces)

    def __reduce__(self) -> tuple[type[Terrain], tuple[dict[str, Piece | Heights], float | None]]:
        return Terrain, (dict(zip(self.names, self.solids, strict=True)), self.friction)  # less the prisms that were needed

    def __str__(self) -> str:
        friction = "each contact's own friction" if self.friction is None else f"friction {self.friction:g}"
        shown = ", ".join(self.names[:6]) + (", ..." if len(self.names) > 6 else "")
        (a, b), depth = max(self.overlaps.items(), key=lambda each: each[1], default=(("", ""), 0.0))
        more = f", and {len(self.overlaps) - 1} more do" if len(self.overlaps) > 1 else ""
        deep = f"; {a!r:.80} and {b!r:.80} overlap by {depth:.3g} m{more}" if depth else ""
        return f"terrain of {len(self.names)} piece{'s' * (len(self.names) != 1)} ({shown}), {friction}{deep}"

    def export(self, path: str | os.PathLike[str]) -> Path:
        """Write it as one page on which it can be turned, which needs no network; returns its path.

        Of planes 2 m around the other pieces are drawn, or around the world's origin.

        Raises:
            PictureError: a name that does not end in .html, or a file that cannot be written.

        Example:
            >>> rbd.Terrain.stairs(0.1, 0.3, 3).export("stairs.html").name
            'stairs.html'
        """
        return drawing("export_terrain")(self, path)

    def show(self) -> Path:
        """Open such a page in the browser; returns its path, in the folder of temporary files. Notebooks show it anyway."""
        return drawing("show_terrain")(self)

    @lazy
    def overlaps(self) -> dict[tuple[str, str], float]:
        """{names of two pieces: how deep they are in each other [m]}, where they were given, by more than 1e-6 m; no grids.

        `print(terrain)` says it. What is above of both is touched as that of one solid, so it does no harm but to what begins
        or comes deep inside of them: each pushes that out along its own nearest face, which can lead into the other.

        Example:
            >>> import coal
            >>> print(rbd.Terrain({"floor": rbd.Ground(point=(0, 0, 0)), "step": coal.Box(0.4, 0.4, 0.2)}))
            terrain of 2 pieces (floor, step), each contact's own friction; 'floor' and 'step' overlap by 0.1 m
        """
        return overlaps_of([solid for solid in self.solids if isinstance(solid, Piece)])

    @property
    def moves(self) -> bool:
        """Whether a piece has a motion, or a velocity of its surface."""
        return any(piece.kind is not None for piece in self._pieces)

    @property
    def carries(self) -> bool:
        """Whether the surface of a piece runs over it, and takes along what stands there."""
        return any(piece.rates is not None for piece in self._pieces)

    @property
    def jump(self) -> Callable[[float, float], float | None] | None:
        """Gives a time in an interval at which a motion jumps [s], None if there is none; None where no piece moves."""
        motions = [piece.moved for piece in self._pieces if piece.moved is not None]

        def first(since: float, t: float) -> float | None:
            return min((at for moved in motions if (at := moved.jump(since, t)) is not None), default=None)

        return first if motions else None

    def with_motion(
        self, name: str, *, motion: Motion | None = None, velocity: Sequence[float] | Array | None = None
    ) -> Terrain:
        """The same terrain, of which a piece moves as a whole, or its surface runs over it.

        Args:
            name: Of the piece.
            motion: How far it has moved from where it was given: t -> (3,) in W [m], or with its two derivatives (3, 3), a
                spline, or `rbd.Speed`; as of `rbd.Ground`, at the time of the state, `State.t`. A lift, a shaker, a cart.
            velocity: Of its surface, in W, shape (3,) [m/s]; on each face the part along that face. A conveyor.

        Raises:
            UnknownName: with the nearest names.
            InputError: both or neither of the two, or what is no motion and no velocity; a grid of heights.

        Example:
            >>> floor = rbd.Terrain.boxes([(-1, -1, -1), (0, 1, 0)], [(0, -1, -1), (1, 1, 0)])
            >>> lift = floor.with_motion("box 1", motion=lambda t: (0, 0, 0.1 * t**2))
            >>> [round(float(lift.at(t).ground_at(0.5, 0.0).point[2]), 3) for t in (0.0, 2.0)]
            [0.0, 0.4]
        """
        check_known("no piece", name, self.names)
        solids = dict(zip(self.names, self.solids, strict=True))
        piece = solids[name]
        if not isinstance(piece, Piece):
            raise InputError(f"piece {name!r:.80} of a terrain is a grid of heights, which stays; expected a convex piece.")
        return Terrain(solids | {name: piece.moving(motion, velocity)}, self.friction)

    def apart(self) -> list[Terrain]:
        """Its pieces that stay, as one terrain, then each that has a motion, alone; itself where none has one."""
        if self.jump is None:
            return [self]
        known = dict(zip(self.names, self.solids, strict=True))
        moving = {piece.name for piece in self._pieces if piece.moved is not None}
        still = {name: solid for name, solid in known.items() if name not in moving}
        alone = [{name: known[name]} for name in self.names if name in moving]
        return [Terrain(some, self.friction) for some in [still, *alone] if some]

    def at(self, t: float) -> Terrain:
        """The terrain as it is at a time [s]: its pieces where they are then; itself where none has a motion."""
        if self.jump is None:
            return self
        solids = [solid.at(t) if isinstance(solid, Piece) else solid for solid in self.solids]
        return Terrain(dict(zip(self.names, solids, strict=True)), self.friction)

    def polytopes(self, points: Array, far: float, t: float = 0.0) -> Polytopes:
        """All pieces as arrays, of grids of heights those that reach near to some points.

        Args:
            points: Shape (k, 3) [m].
            far: How near, along x and y [m].
            t: Time at which pieces that move are taken [s].
        """
        for number, grid in enumerate(self._fields):
            across = grid.cells(points.min(axis=0) - far, points.max(axis=0) + far)
            if (number, *across) in self._known:
                continue
            self._known.add((number, *across))
            for i, j in product(*across):
                if (number, i, j) not in self._known:
                    self._known.add((number, i, j))
                    self._pieces += grid.prisms(i, j)
                    self._arrays = self._now = None
        if self._arrays is None:
            self._arrays = Polytopes.of(self._pieces)
        if not len(self._arrays.rates):
            return self._arrays
        if self._now is None or self._now[0] != t:
            self._now = t, self._arrays.at(self._pieces, t)
        return self._now[1]

    def plane(self, piece: int, face: int) -> int:
        """A number that faces of all pieces in one plane share; that of a piece's own for no face, -1."""
        known = self._plane_of.get((piece, face))
        if known is None:
            own = self._pieces[piece]
            key = tuple(np.round(own.faces[face] * 1e7).astype(int).tolist()) if face >= 0 else (piece,)
            key = key if own.moved is None else (*key, id(own.moved))  # one that moves is in a plane of its own
            known = self._plane_of[piece, face] = self._planes.setdefault(key, len(self._planes))
        return known

    def heights_of(self, points: Array) -> Array:
        """How far points are above the surface under them, along z, shape (...) [m]; inf where there is none.

        The surface under a point is the highest top that is no more than 2 cm above it; if all are higher, the lowest one.

        Args:
            points: In W, shape (..., 3) [m].

        Raises:
            InputError: points of another shape, or that are not finite.
        """
        P = as_array("points", points)
        if P.shape[-1:] != (3,):
            raise InputError(f"points have shape {P.shape}; expected (..., 3): x, y, z in W [m].")
        check_finite("points", P)
        tops = np.array([solid.tops(P[..., :2]) for solid in self.solids])
        under = np.where(tops <= P[..., 2] + SUNK_M, tops, -np.inf).max(axis=0)
        over = np.where(np.isneginf(tops), np.inf, tops).min(axis=0)
        return np.asarray(P[..., 2] - np.where(np.isneginf(under) & np.isfinite(over), over, under))

    def distances(self, points: Array) -> Array:
        """Distances of points from the nearest piece, negative inside, shape (k,) [m].

        Args:
            points: In W, shape (k, 3) [m].
        """
        P, point = as_finite("points", points, ("k", 3)), (np.arange(2), np.array([[0.0, 0.0, 1.0]]), np.zeros(1))
        each = (Touches.of(self.polytopes, Plates(np.array(p[None]), *point), 1e6) for p in P)
        out = np.array([found.gaps.min(initial=np.inf) for found in each])
        within = np.min([piece.depths(P) for piece in self._pieces], axis=0)  # where pieces meet they have no surface
        return np.where(np.isinf(out) & (within <= 0.0), within, out)

    def ground_at(self, x: float, y: float) -> Ground:
        """The plane of the highest top at (x, y).

        Raises:
            InputError: if there is no terrain at that place.
        """
        xy = as_finite("(x, y)", (x, y), (2,))
        tops = [float(solid.tops(xy[None])[0]) for solid in self.solids]
        i = int(np.argmax(tops))
        if not np.isfinite(tops[i]):
            raise InputError(f"there is no terrain at x = {x:.4g}, y = {y:.4g} m.")
        near = self.solids[i]
        cells = () if isinstance(near, Piece) else product(*near.cells(xy, xy + 1e-9))
        pieces = [near] if isinstance(near, Piece) else [p for cell in cells for p in near.prisms(*cell)]
        p = np.array([x, y, tops[i]])
        best = min((abs(float(f[:3] @ p - f[3])), tuple(f[:3])) for piece in pieces for f in piece.faces if f[2] > 1e-9)
        return plane_at(p, np.array(best[1]), pieces[0].rates)


def check_still(terrain: Terrain) -> None:
    """Refuse a terrain of which a piece moves, where contacts are sought or checked in a whole motion on ground at rest.

    Raises:
        InputError: with the name of the piece.
    """
    for piece in terrain.pieces:
        if piece.moved is not None or (piece.rates is not None and piece.rates[6:].any()):
            raise InputError(
                f"the ground of a motion is a terrain of which {piece.name!r:.80} moves; expected one at rest, or as it is "
                "at a time: terrain.at(t)."
            )


def terrains_of(constraints: Iterable[object]) -> tuple[Terrain, ...]:
    """The terrains on which constraints stand, each once."""
    found = [on for constraint in constraints if isinstance(on := getattr(constraint, "on", None), Terrain)]
    return tuple({id(on): on for on in found}.values())


def moving_planes_of(constraints: Iterable[object]) -> tuple[Terrain, ...]:
    """The planes with a place and a motion on which constraints stand, each once, as a terrain of one half-space."""
    found = {id(on): on for c in constraints if isinstance(on := getattr(c, "on", None), Ground)}
    return tuple(Terrain({"ground": on}) for on in found.values() if on.motion is not None and on.point is not None)
