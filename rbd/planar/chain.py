"""A chain of n links in a plane, in symbols: one object from which all of `rbd.planar` is asked.

The links have lengths ell_1..ell_n and are hinged end to end at the origin; x points to the right, y up, angles are
counterclockwise. What a chain is asked is computed in the module that carries its name; this one only keeps the symbols.
Source: [Duarte2021].
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import sympy
from sympy.physics.mechanics import dynamicsymbols

from rbd.arrays import Array, lazy
from rbd.planar import expressions, kinematics
from rbd.planar.angles import JOINT, AngleMap, Symbols, angle_map, check_convention, to_segments
from rbd.planar.compiled import Compiled, compile_expression
from rbd.planar.ellipse import Ellipse, end_point_ellipse
from rbd.planar.lengths import check_count, check_lengths
from rbd.planar.numeric import ChainNumbers
from rbd.planar.split import Split, split_acceleration

if TYPE_CHECKING:
    from rbd.planar.bodies import Shapes
    from rbd.planar.constrained import ConstrainedChain
    from rbd.planar.dynamics import Dynamics
    from rbd.planar.inverse import Inverse
    from rbd.planar.inverse_path import InversePath
    from rbd.planar.rates import JointRates
    from rbd.planar.urdf import Plane, RobotCoordinates
    from rbd.planar.words import PlanarWords
    from rbd.robots.robot import Robot


@dataclass(frozen=True, init=False)
class Chain:
    """n links in a plane, hinged end to end, the base at the origin.

    Joint 0 is the base, joint i the far end of link i, joint n the end point P. Wherever a method takes `i`, None is the
    end point, and what is none of 0..n raises InputError. Two chains are equal if they have the same links and measure
    angles alike.

    Args:
        n: How many links, 1 to 50.
        lengths: Their lengths [m]: None for symbols ell_1..ell_n; or n numbers or positive SymPy expressions, as
            `(ell, ell)`. Decimal numbers are kept exactly: 0.1 is 1/10.
        angles: How theta_i is measured: "joint" from the previous link, "segment" from x, "vertical" from the downward
            vertical (the pendulum's; zero hangs).

    Raises:
        InputError: on a number of links that is not whole and positive, on lengths that are not n positive finite ones, or
            on another word for the angles.

    >>> Chain(2).determinant()
    ell_1*ell_2*sin(theta_2(t))
    """

    n: int
    lengths: tuple[sympy.Expr, ...]
    angles: str

    def __init__(self, n: int, *, lengths: Sequence[Any] | Array | None = None, angles: str = JOINT) -> None:
        count = check_count(n)
        object.__setattr__(self, "n", count)
        object.__setattr__(self, "angles", check_convention(angles))
        object.__setattr__(self, "lengths", check_lengths(count, lengths))

    # The symbols

    @property
    def t(self) -> sympy.Symbol:
        """Time [s]; all angles are functions of it."""
        return dynamicsymbols._t

    @lazy
    def q(self) -> Symbols:
        """Angles theta_1(t)..theta_n(t) [rad], shape (n, 1), measured as `angles` says."""
        return sympy.ImmutableMatrix([dynamicsymbols(f"theta_{k + 1}", real=True) for k in range(self.n)])

    @lazy
    def qd(self) -> Symbols:
        """Angular velocities [rad/s], shape (n, 1)."""
        return self.q.diff(self.t)

    @lazy
    def qdd(self) -> Symbols:
        """Angular accelerations [rad/s^2], shape (n, 1)."""
        return self.q.diff(self.t, 2)

    @lazy
    def qddd(self) -> Symbols:
        """Angular jerks [rad/s^3], shape (n, 1)."""
        return self.q.diff(self.t, 3)

    @lazy
    def segment_angles(self) -> Symbols:
        """Angle of every link from x [rad], shape (n, 1): phi = A q + b, see `rbd.planar.angles`."""
        matrix, offset = to_segments(self.n, self.angles)
        return (matrix * self.q + offset).as_immutable()

    @property
    def is_numeric(self) -> bool:
        """Whether all lengths are numbers."""
        return all(length.is_number for length in self.lengths)

    def with_lengths(self, lengths: Sequence[Any] | Array | None) -> Chain:
        """The same chain with other lengths [m], numbers for instance.

        Raises:
            InputError: as the constructor does.
        """
        return Chain(self.n, lengths=lengths, angles=self.angles)

    def with_angles(self, angles: str) -> Chain:
        """The same chain with its angles measured in another way; values are carried over by `convert`.

        Raises:
            InputError: on a word that is none of the three.
        """
        return Chain(self.n, lengths=self.lengths, angles=angles)

    def angle_map(self, to: str) -> AngleMap:
        """The affine map of this chain's angles to another convention: `matrix`, `offset`, and a call for values.

        Raises:
            InputError: on a word that is none of the three.
        """
        return angle_map(self.n, self.angles, to)

    def convert(self, values: Any, to: str = "segment") -> Any:
        """Angles of this chain in another convention [rad], nothing wrapped; rates go through `angle_map(to).rates`.

        Args:
            values: Shape (n,) or (samples, n) [rad]; or n expressions in a SymPy matrix.
            to: "joint", "segment" or "vertical".

        Raises:
            InputError: on another shape, numbers that are not finite, or another word.
        """
        return self.angle_map(to)(values)

    # Kinematics

    def position(self, i: int | None = None) -> Symbols:
        """Position of joint i [m], shape (2, 1): r = sum_k ell_k (cos phi_k, sin phi_k) over the links before it."""
        return kinematics.motion(self, i, 0)

    def velocity(self, i: int | None = None) -> Symbols:
        """Velocity of joint i by differentiation [m/s], shape (2, 1), one term per link."""
        return kinematics.motion(self, i, 1)

    def acceleration(self, i: int | None = None) -> Symbols:
        """Acceleration of joint i by differentiation [m/s^2], shape (2, 1), one term per link."""
        return kinematics.motion(self, i, 2)

    def jerk(self, i: int | None = None) -> Symbols:
        """Jerk of joint i by differentiation [m/s^3], shape (2, 1), one term per link."""
        return kinematics.motion(self, i, 3)

    def jacobian(self, i: int | None = None) -> Symbols:
        """Jacobian J of joint i [m], shape (2, n): J[a, j] = d r_a / d theta_j, so that v = J qd."""
        return kinematics.jacobian(self, i, 0)

    def jacobian_rate(self, i: int | None = None) -> Symbols:
        """Time derivative of the Jacobian of joint i [m/s], shape (2, n)."""
        return kinematics.jacobian(self, i, 1)

    def velocity_by_jacobian(self, i: int | None = None) -> Symbols:
        """J qd [m/s], shape (2, 1): the velocity again, its terms grouped by angle."""
        return kinematics.by_jacobian(self, i, 1)

    def acceleration_by_jacobian(self, i: int | None = None) -> Symbols:
        """Jd qd + J qdd [m/s^2], shape (2, 1): the acceleration again, its terms grouped by angle."""
        return kinematics.by_jacobian(self, i, 2)

    def jerk_by_jacobian(self, i: int | None = None) -> Symbols:
        """Jdd qd + 2 Jd qdd + J qddd [m/s^3], shape (2, 1): the jerk again, its terms grouped by angle."""
        return kinematics.by_jacobian(self, i, 3)

    def determinant(self) -> sympy.Expr:
        """How the end-point Jacobian fills space; zero where it is singular.

        Two links: det J = ell_1 ell_2 sin theta_2 [m^2]. More: det(J J^T) [m^4], the sum of its squared 2 x 2 minors. One
        link: det(J^T J) = ell_1^2 [m^2], since J J^T of a column is always singular.
        """
        return kinematics.determinant(self)

    def singular_configurations(self) -> tuple[sympy.Eq, ...]:
        """Conditions that make the end-point Jacobian lose rank, all of them at once: every link on one line.

        sin(phi_{k+1} - phi_k) = 0 for k = 1..n-1: each link continues the one before it or folds back on it. A single link
        has none: its end point always moves along the circle, and never off it.
        """
        return kinematics.singular_configurations(self)

    def split(self, i: int | None = None) -> Split[Symbols]:
        """Acceleration of joint i in tangential, centripetal and Coriolis parts [m/s^2]; see `rbd.planar.split`."""
        return split_acceleration(self, i)

    # Numbers and words

    def function(self, expr: Any, *, parameters: Mapping[Any, float] | None = None) -> Compiled:
        """A fast NumPy function f(q, qd, qdd, qddd) of any expression of this chain, vectorised over samples.

        Args:
            expr: SymPy expression, matrix or array in the angles and their first three derivatives.
            parameters: {symbol or its name: number} for all other symbols, as lengths and masses.

        Returns:
            Function of arrays of shape (n,) or (samples, n); rates that do not occur may be left out. A column (r, 1) gives
            (r,) or (samples, r); other matrices keep their two axes.

        Raises:
            InputError: if symbols are left without a number, or a number is not finite.
        """
        return compile_expression(self, expr, parameters or {})

    @lazy
    def numeric(self) -> ChainNumbers:
        """Ready numeric functions: positions, velocity, acceleration, jerk, jacobian, split; linear in n, for samples.

        Raises:
            InputError: if lengths are symbols; `with_lengths` gives numbers.
        """
        return ChainNumbers.of(self)

    def ellipse(self, q: Sequence[float] | Array, kind: str = "velocity", *, i: int | None = None) -> Ellipse:
        """Velocity or force ellipse of joint i at a configuration; see `rbd.planar.ellipse`.

        Args:
            q: Angles, shape (n,) [rad], measured as this chain does.
            kind: "velocity" (what |qd| <= 1 rad/s reaches [m/s]) or "force" (what |tau| <= 1 N m balances [N]).
            i: The joint, 1..n; None is the end point.

        Raises:
            InputError: on another word or shape, or where lengths are symbols.
        """
        return end_point_ellipse(self, q, kind, i)

    def latex(self, expr: Any) -> str:
        r"""LaTeX of an expression, in Newton's dots: \ell_{1}, \theta_{1}, \dot{\theta}_{1}.

        Args:
            expr: A SymPy expression, matrix or equation, a `Split`, or several in a tuple.

        Raises:
            InputError: on what is none of these.
        """
        return expressions.latex(expr)

    def formula(self, expr: Any) -> expressions.Formula:
        """The same expression, shown typeset by a notebook.

        Raises:
            InputError: as `latex` does.
        """
        return expressions.Formula(expr)

    def _repr_latex_(self) -> str:
        """Where the end point is, for notebooks."""
        return expressions.in_dollars(rf"\mathbf{{r}}_P = {self.latex(self.position())}")

    # In modules of their own, imported when asked: there stand the formulas and what they raise.

    def inverse(
        self, target: Sequence[float] | Array, *, start: Sequence[float] | Array | None = None, tolerance: float = 1e-12
    ) -> Inverse:
        """Angles that bring the end point to a target [m]: all branches of one and two links; see `rbd.planar.inverse`."""
        from rbd.planar.inverse import inverse

        return inverse(self, target, start=start, tolerance=tolerance)

    def inverse_formulas(self, x: Any = None, y: Any = None) -> tuple[Symbols, ...]:
        """The angles of one or two links in symbols, one column per branch; see `rbd.planar.inverse`."""
        from rbd.planar.inverse import inverse_formulas

        return inverse_formulas(self, x, y)

    def inverse_path(
        self,
        points: Sequence[Sequence[float]] | Array,
        *,
        start: Sequence[float] | Array | None = None,
        branch: int = 0,
        tolerance: float = 1e-12,
        check: bool = True,
    ) -> InversePath:
        """Angles along a path of the end point, shape (samples, 2) [m], continuous; see `rbd.planar.inverse_path`."""
        from rbd.planar.inverse_path import inverse_path

        return inverse_path(self, points, start=start, branch=branch, tolerance=tolerance, check=check)

    def joint_rates(
        self,
        q: Sequence[float] | Array,
        velocity: Sequence[float] | Array,
        acceleration: Sequence[float] | Array | None = None,
        jerk: Sequence[float] | Array | None = None,
        *,
        at_singular: str = "raise",
    ) -> JointRates:
        """Rates of the angles that give the end point a velocity, acceleration and jerk; see `rbd.planar.rates`."""
        from rbd.planar.rates import joint_rates

        return joint_rates(self, q, velocity, acceleration, jerk, at_singular=at_singular)

    def constrained(self, relation: Any, *, branch: int | None = None) -> ConstrainedChain:
        """The chain under a relation of its angles, as a joint held; see `rbd.planar.constrained`."""
        from rbd.planar.constrained import constrained

        return constrained(self, relation, branch=branch)

    def words(self, *, pinned: Any = None) -> PlanarWords:
        """What the text calls this chain: open, serial, its mobility and redundancy; see `rbd.planar.words`."""
        from rbd.planar.words import words

        return words(self, pinned=pinned)

    def dynamics(
        self,
        *,
        bodies: Shapes | None = None,
        masses: Iterable[Any] | None = None,
        centres: Iterable[Any] | None = None,
        inertias: Iterable[Any] | None = None,
        gravity: Any = None,
    ) -> Dynamics:
        """Lagrange's equations of motion, M, C, g in symbols; see `rbd.planar.dynamics`."""
        from rbd.planar.dynamics import dynamics

        return dynamics(self, bodies=bodies, masses=masses, centres=centres, inertias=inertias, gravity=gravity)

    def to_urdf(
        self,
        path: str | os.PathLike[str] | None = None,
        *,
        masses: Iterable[Any] | None = None,
        lengths: Iterable[Any] | None = None,
        centres: Iterable[Any] | None = None,
        inertias: Iterable[Any] | None = None,
        bodies: Shapes | None = None,
        plane: Plane = "xz",
        values: Mapping[Any, Any] | None = None,
        name: str = "chain",
    ) -> str:
        """The text of a URDF file of the chain, written to `path` too; arguments as `rbd.planar.urdf.to_urdf`."""
        from rbd.planar.urdf import to_urdf

        return to_urdf(
            self, path, masses=masses, lengths=lengths, centres=centres, inertias=inertias, bodies=bodies, plane=plane,
            values=values, name=name,
        )  # fmt: skip

    def robot(
        self,
        *,
        masses: Iterable[Any] | None = None,
        lengths: Iterable[Any] | None = None,
        centres: Iterable[Any] | None = None,
        inertias: Iterable[Any] | None = None,
        bodies: Shapes | None = None,
        plane: Plane = "xz",
        values: Mapping[Any, Any] | None = None,
        name: str = "chain",
    ) -> Robot:
        """The chain as a robot, for `rbd.solve` and `rbd.simulate`; arguments as `rbd.planar.urdf.to_urdf`."""
        from rbd.planar.urdf import robot

        return robot(
            self, masses=masses, lengths=lengths, centres=centres, inertias=inertias, bodies=bodies, plane=plane,
            values=values, name=name,
        )  # fmt: skip

    def robot_coordinates(self) -> RobotCoordinates:
        """The map between the chain's angles, rates and torques and its robot's; see `rbd.planar.urdf`."""
        from rbd.planar.urdf import robot_coordinates

        return robot_coordinates(self)
