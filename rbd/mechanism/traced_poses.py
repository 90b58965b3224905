"""`Trace`: the poses of a driven mechanism, with the limits and the singular poses that it passed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.mechanism.poses import LimitViolation, measured
from rbd.model.joints import ANGLE

_SHOWN = 6


@dataclass(frozen=True, eq=False)
class Limit:
    """A limit of the driven joint's motion: J2 is singular, and the mechanism turns back there.

    Attributes:
        value: Value of the driven joint [rad, m].
        greatest: Whether it is a maximum of the joint's value; else a minimum.
        q: The pose, shape (nq,).
    """

    value: float
    greatest: bool
    q: Array


@dataclass(frozen=True, eq=False)
class Bifurcation:
    """A singular pose that the motion passes, where another branch crosses, to 1e-5.

    Attributes:
        value: Value of the driven joint [rad, m].
        q: The pose, shape (nq,).
        sigma: Least singular value of J there, of those that are not zero along the motion.
    """

    value: float
    q: Array
    sigma: float


@dataclass(frozen=True, eq=False)
class Trace(Displayed):
    """Poses of a mechanism while one joint is driven, in order, with the limits and singular poses that it passes.

    Attributes:
        joint: The driven joint.
        input: Its values, shape (n,) [rad, m]; a continuous joint's are not wrapped.
        q: Poses, shape (n, nq).
        residual: Largest entry of the errors, shape (n,) [m, rad].
        sigma_min: Least singular value of J2, the columns of all other free joints, shape (n,).
        condition: Condition number of J2, shape (n,); inf where it is singular.
        limits: Limits at which the driven joint turned back, or would have.
        crossings: Singular poses that were passed.
        unreached: Requested values that were not reached, shape (k,).
        stopped_by: Name of the joint limit that ended the motion, or "".
        closed: Whether the motion returned to its first pose.
        beyond_limits: Joints outside the limits of the robot's file somewhere along the motion, at the first such pose.
        moved: Distance of the first pose from the start, as in `Assembly`.
        steps: Steps tried.
        unit: Of the driven joint's values: "rad" or "m".

    Example:
        >>> robot = rbd.mechanism.four_bar(2.0, 2.0, 2.0, 3.0)  # its crank does not turn round
        >>> path = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(1.0, 3.0), steps=20)
        >>> path.complete, path.q.shape, [round(limit.value, 4) for limit in path.limits]
        (False, (10, 6), [1.8235])
    """

    joint: str
    input: Array
    q: Array
    residual: Array
    sigma_min: Array
    condition: Array
    limits: tuple[Limit, ...]
    crossings: tuple[Bifurcation, ...]
    unreached: Array
    stopped_by: str
    closed: bool
    beyond_limits: tuple[LimitViolation, ...]
    moved: float
    steps: int
    unit: str = ANGLE

    def __len__(self) -> int:
        return len(self.input)

    @property
    def complete(self) -> bool:
        """Whether every requested value was reached."""
        return not len(self.unreached)

    def __str__(self) -> str:
        def told(value: float) -> str:
            return measured(value, self.unit)

        worst = int(np.argmin(self.sigma_min))
        start = f"; its first pose is {self.moved:.3g} [rad, m] from the start" if self.moved > 0.1 else ""
        lines = [
            f"{self.joint} from {told(self.input[0])} to {told(self.input[-1])}: {len(self)} poses, each closed to "
            f"{self.residual.max():.0e} m or rad{start}",
            f"  nearest to singular at {told(self.input[worst])}: least singular value of J2 {self.sigma_min[worst]:.3g}",
        ]
        for limit in self.limits[:_SHOWN]:
            lines.append(f"  limit: {'at most' if limit.greatest else 'at least'} {told(limit.value)}")
        lines += [f"  passes a singular pose at {told(crossing.value)}: branches meet" for crossing in self.crossings[:_SHOWN]]
        more = max(0, len(self.limits) - _SHOWN) + max(0, len(self.crossings) - _SHOWN)
        lines += [f"  and {more} more of these"] * bool(more)
        if self.stopped_by:
            lines.append(f"  stopped by {self.stopped_by!r} at {told(self.input[-1])}")
        if len(self.unreached):
            first, last = self.unreached[0], self.unreached[-1]
            lines.append(f"  not reached: {told(first)}" + f" to {told(last)}" * (len(self.unreached) > 1))
        lines += ["  back where it began"] * self.closed
        lines += [f"  beyond its limits: {joint}" for joint in self.beyond_limits]
        return "\n".join(lines)
