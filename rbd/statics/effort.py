"""`Effort`: the criterion that chooses torques and contact forces, and the conic program of least effort.

    minimise sum_i p_i (tau_i / limit_i)^2 + sum_j r_j (w_j / body weight)^2

over torques within their limits and weights w of the forces that the motion allows, with M a + h = S^T tau + tau_ext + J^T G w.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rbd.arrays import Array, as_array, as_float, check_number
from rbd.constraints.convex.polygons import convex_hull, half_planes
from rbd.displayed import Displayed
from rbd.errors import InputError, JointNotFound
from rbd.errors.inputs import check_kind, check_known
from rbd.problem.conic import Conic
from rbd.problem.force_set import ForceSet
from rbd.problem.rows import Patch, by_rows
from rbd.statics.force_balance import ForceBalance

FORCE_WEIGHT = 1e-4
"""Weight of sum (ray weight / body weight)^2 beside sum (tau / limit)^2: it chooses among forces that cost no torque."""
POSSIBLE = 1e-9
"""Torques and forces whose equations and limits are missed by no more, of numbers around one, are possible."""
_MOST = 1e12
_ALIKE = 1.0


def checked_bounds(name: str, bounds: object) -> tuple[float, float]:
    """(least, most) normal force of a contact [N].

    Raises:
        InputError: no two numbers, bounds that cross, a largest force below zero.
    """
    pair = [as_float(x) for x in bounds] if isinstance(bounds, Sequence) and not isinstance(bounds, str) else []
    if len(pair) != 2 or not pair[0] <= pair[1] or pair[1] < 0.0 or pair[0] > _MOST:
        raise InputError(f"normal_force of {name!r:.80} is {bounds!r:.80}; expected (least, most) [N], e.g. (50, inf).")
    return pair[0], pair[1]


@dataclass(frozen=True, eq=False)
class Effort(Displayed):
    """What `hold` and `inverse_dynamics` minimise, and bounds on normal forces and centres of pressure.

    Attributes:
        torques: Weight of (tau / limit)^2: one number >= 0, one a motor (nu,), or {joint: number}, 1 of the others. A motor
            without a stated limit is weighed against the body weight times one metre.
        forces: Weight of (force / body weight)^2 at each point: one number > 0, or {constraint: number}, 1e-4 of the others.
        normal_force: {contact: (least, most)}: bounds on its normal force [N].
        edge_margin: The centre of pressure of each sole stays this far inside its edge [m].

    Raises:
        InputError: on numbers that are none, negative, or bounds that cross.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> light = rbd.statics.Effort(normal_force={"front_left": (0.0, 3.0)})  # at most 3 N there
        >>> held = rbd.hold(solo.standing(), solo.feet(friction=0.7), objective=light)
        >>> print({foot: f"{force[2]:.2f} N" for foot, force in held.forces.items()})
        {'front_left': '3.00 N', 'front_right': '9.26 N', 'hind_left': '9.26 N', 'hind_right': '3.00 N'}
    """

    torques: float | Sequence[float] | Array | Mapping[str, float] = _ALIKE
    forces: float | Mapping[str, float] = FORCE_WEIGHT
    normal_force: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    edge_margin: float = 0.0

    def __post_init__(self) -> None:
        check_number("edge_margin", self.edge_margin, 0.0, _MOST, expected="a length of 0 or more [m]")
        check_kind("normal_force", self.normal_force, Mapping, "{contact: (least, most)} [N]")
        for name, bounds in self.normal_force.items():
            checked_bounds(name, bounds)
        for what, least in (("torques", 0.0), ("forces", 1e-12)):
            value = getattr(self, what)
            if isinstance(value, Mapping):
                values = list(value.values())
            else:
                values = [value] if what == "forces" else np.ravel(as_array(what, value)).tolist()
            if not all(least <= as_float(x) < _MOST for x in values):
                raise InputError(
                    f"{what} is {value!r:.80}; expected weights {'above' if least else 'of'} 0 {'' if least else 'or more'}."
                )

    def torque_weights(self, names: Sequence[str]) -> Array:
        """One of each motor, shape (nu,).

        Raises:
            JointNotFound: a name that no motor has.
            InputError: another number of weights than of motors.
        """
        if isinstance(self.torques, Mapping):
            for name in self.torques:
                check_known("torques has a weight for what is no motor,", name, names, JointNotFound)
            return np.array([float(self.torques.get(name, 1.0)) for name in names])
        given = as_array("torques", self.torques)
        if given.ndim and given.shape != (len(names),):
            raise InputError(f"torques has shape {given.shape}; expected one weight, or ({len(names)},), one a motor.")
        return np.full(len(names), float(given)) if not given.ndim else given

    def force_weights(self, sets: ForceSet, names: Sequence[str]) -> Array:
        """One of each column of the force sets of some constraints, shape (p,).

        Raises:
            UnknownName: a name that no constraint has.
        """
        if not isinstance(self.forces, Mapping):
            return np.full(sets.size, float(self.forces))
        out = np.full(sets.size, FORCE_WEIGHT)
        for name in self.forces:
            check_known("forces speaks of what is no contact here,", name, names)
        for name, span in zip(names, sets.slices, strict=True):
            out[span] = self.forces.get(name, FORCE_WEIGHT)
        return out

    def rows(self, loads: ForceBalance) -> tuple[dict[str, Array], Array, Array]:
        """({"forces": C}, low, high): what the contacts must keep to beside their cones, of weights over the unit.

        Raises:
            UnknownName: a name that no contact has.
        """
        C, low, high = [np.zeros((0, loads.sets.size))], list[float](), list[float]()
        for name in self.normal_force:
            check_known(
                "normal_force speaks of what is no contact here,", name, [r.name for r in loads.rows if r.patch is not None]
            )
        for r, G in by_rows(loads.rows, loads.sets.G):
            if r.patch is not None and r.name in self.normal_force:
                assert r.resultant is not None
                least, most = (float(x) / loads.unit for x in self.normal_force[r.name])
                C.append(r.patch.axes[None, :, 2] @ r.resultant[:3] @ G)
                low.append(least)
                high.append(most)
            if self.edge_margin and r.patch is not None and len(r.patch.corners) > 1:
                assert r.resultant is not None
                C.append(_inside(r.patch, r.resultant @ G, self.edge_margin))
                low += [0.0] * len(C[-1])
                high += [math.inf] * len(C[-1])
        return {"forces": np.concatenate(C)}, np.array(low), np.array(high)

    @property
    def bounded(self) -> bool:
        """Whether normal forces or centres of pressure have bounds."""
        return bool(self.normal_force or self.edge_margin)

    def program(self, loads: ForceBalance) -> Conic:
        """Least effort: the rows between bounds are those of `rows`, then the torques of the limited motors."""
        p = 1.0 if self.torques is _ALIKE else self.torque_weights(loads.state.robot.actuated_names)
        weighed, limited, (low, high), T = loads.T.T * p, loads.limited, loads.within, loads.T
        H = 2.0 * (weighed @ T)
        H.flat[:: len(H) + 1] += 2.0 * (
            self.forces if isinstance(self.forces, float) else self.force_weights(loads.sets, [r.name for r in loads.rows])
        )
        if not limited.all():
            T, low, high = T[limited], low[limited], high[limited]
        if self.bounded:
            rows, least, most = self.rows(loads)
            T, low, high = np.vstack([rows["forces"], T]), np.concatenate([least, low]), np.concatenate([most, high])
        sets = loads.sets  # one block: without `Conic.of`, a tenth of what `hold` takes
        return Conic(
            H, -2.0 * (weighed @ loads.t), loads.A, loads.b, T, low, high, loads.lower, loads.upper, sets.cone_columns, sets.mu
        )


DEFAULT = Effort()
"""Least squares of torques over their limits."""


def _inside(patch: Patch, W: Array, margin: float) -> Array:
    """Rows that are >= 0 where the centre of pressure is inside the corners' hull by a margin; a line has two ends.

    Args:
        patch: With corners.
        W: Force and moment at its point of unit weights, world axes, shape (6, p).
        margin: The margin.
    """
    force, about = (patch.axes.T @ part for part in np.split(W, 2))
    normals, offsets = half_planes(convex_hull(patch.corners[:, :2]))
    x, y = -about[1], about[0]  # times the normal force
    return normals[:, :1] * x + normals[:, 1:] * y - (offsets + margin)[:, None] * force[2]
