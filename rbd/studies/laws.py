"""The two contact laws side by side: where the convex relaxation parts from Coulomb's law, and by how much."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.constraints.constraint import Constraint
from rbd.least_constraint import answered, assembled
from rbd.model.dynamics import External
from rbd.model.state import State
from rbd.problem.answer import CARRIES_NOTHING_N
from rbd.problem.contact_motion import REST_SPEED
from rbd.problem.force_set import at_rest
from rbd.solution import Solution
from rbd.solvers.default import solver_of

SAME = 1e-7
"""Accelerations of the two laws that differ by less, over max(1, the largest), are the same."""


@dataclass(frozen=True)
class ContactUnderLaw:
    """What one contact does under one law, summed over its points.

    At rest no power flows yet; these are the rates at which it starts to flow [N m/s2 = W/s].

    Attributes:
        normal: Normal force [N].
        slip: Largest tangential acceleration of its points [m/s2].
        lift_off: Largest normal acceleration of its loaded points [m/s2]: zero under Coulomb's law.
        dissipation: What friction takes, -sum f_t . c_t [W/s].
        lifted: What the normal forces put back by lifting, sum f_n c_n [W/s]: under the convex law all that friction takes.
    """

    normal: float
    slip: float
    lift_off: float
    dissipation: float
    lifted: float


@dataclass(frozen=True, eq=False, repr=False)
class LawComparison:
    """Convex and Coulomb's law at one state, both with circular cones, as `rbd.solve` answers under each.

    Attributes:
        convex: The answer of the associated (convex) law.
        coulomb: The answer of Coulomb's law; where it is one of several motions, the rest are in `coulomb.others`.
        under_convex: {contact: what it does under the convex law}.
        under_coulomb: {contact: what it does under Coulomb's law}.
    """

    convex: Solution
    coulomb: Solution
    under_convex: dict[str, ContactUnderLaw]
    under_coulomb: dict[str, ContactUnderLaw]

    @property
    def difference(self) -> float:
        """Largest difference of the accelerations, over max(1, the largest entry)."""
        scale = max(1.0, float(np.abs(self.coulomb.a).max()), float(np.abs(self.convex.a).max()))
        return float(np.abs(self.convex.a - self.coulomb.a).max()) / scale

    @property
    def agree(self) -> bool:
        """Whether the robot moves the same way under both, to `SAME`, and no other motion of Coulomb's law was found."""
        return self.difference <= SAME and not self.coulomb.others

    @property
    def normal_ratio(self) -> dict[str, float]:
        """{contact: normal force of the convex law over Coulomb's}; NaN where Coulomb's carries nothing."""
        pairs = ((name, self.under_convex[name].normal, c.normal) for name, c in self.under_coulomb.items())
        return {name: convex / normal if normal > CARRIES_NOTHING_N else float("nan") for name, convex, normal in pairs}

    def __repr__(self) -> str:
        return f"LawComparison(difference {self.difference:.2g}, contacts {list(self.under_coulomb)})"

    def __str__(self) -> str:
        parts = f"they part: accelerations differ by {self.difference:.2g}, relative"
        verdict = "the same motion" if self.difference <= SAME else parts
        if self.coulomb.others:
            verdict += f"; Coulomb's law has {1 + len(self.coulomb.others)} motions"
        heads = ("normal", "ratio", "slip", "lift-off", "dissipation", "put back")
        units = ("[N]", "", "[m/s2]", "[m/s2]", "[W/s]", "[W/s]")
        lines = [f"convex against Coulomb's law, circular cones: {verdict}"]
        lines.append(f"  {'contact':<16}{'law':<9}" + "".join(f"{x:>13}" for x in heads))
        lines.append(" " * 27 + "".join(f"{x:>13}" for x in units))
        for name, ratio in self.normal_ratio.items():
            for law, found in (("convex", self.under_convex[name]), ("coulomb", self.under_coulomb[name])):
                shown = "-" if law == "coulomb" or ratio != ratio else f"{ratio:.4f}"
                rest = (found.slip, found.lift_off, found.dissipation, found.lifted)
                # + 0.0 turns the -0.000 of rounding into 0.000
                numbers = "".join(f"{round(x, 3) + 0.0:>13.3f}" for x in rest)
                lines.append(f"  {name if law == 'convex' else '':<16}{law:<9}{found.normal:>13.3f}{shown:>13}{numbers}")
        return "\n".join(lines)


def compare_laws(
    state: State,
    tau: Array,
    constraints: Sequence[Constraint],
    *,
    external: External = None,
    rest_speed: float = REST_SPEED,
) -> LawComparison:
    """Convex and Coulomb's law side by side, both with circular cones: the gauge of the relaxation.

    Where a loaded point starts to slip, the convex law lets it lift at mu times its tangential acceleration, gives it another
    normal force, and puts back by lifting what friction takes. The two differ too where a point without load breaks with
    c_n < mu |c_t|, and where Coulomb's law has several motions: then a `NonUniqueMotionWarning` warns of it, and
    `coulomb.others` has the others. Elsewhere they agree.

    Args:
        state: The robot, its contacts at rest.
        tau: Motor torques, shape (nu,).
        constraints: Contacts and other constraints.
        external: Other forces of the world, as in `rbd.solve`.
        rest_speed: Up to which speed a contact is at rest [m/s, rad/s], as in `rbd.solve`.

    Returns:
        Both answers with their certificates, and what each contact does under each; print it.

    Raises:
        NoSolution, ContactMoves, InputError: as `rbd.solve`; a contact that already slides has no convex law.
    """
    problem = assembled(state, tau, constraints, external, rest_speed)
    convex, coulomb = (answered(problem, solver_of(law, None)) for law in ("convex", "coulomb"))
    return LawComparison(convex, coulomb, _under(convex), _under(coulomb))


def _under(solution: Solution) -> dict[str, ContactUnderLaw]:
    P = solution.problem
    T = P.force_set
    y = T.accelerations(P.J @ solution.a + P.offset)
    out = {}
    for i, rows in enumerate(P.rows):
        if rows.patch is None:
            continue
        f = solution.corner_forces[rows.name] @ rows.patch.axes
        motion = np.zeros_like(f) if at_rest(rows.cone).bilateral else T.at_points(y, i)  # what holds keeps still
        loaded = f[:, 2] > CARRIES_NOTHING_N
        out[rows.name] = ContactUnderLaw(
            normal=float(f[:, 2].sum()),
            slip=float(np.hypot(motion[:, 0], motion[:, 1]).max(initial=0.0)),
            lift_off=float(motion[loaded, 2].max(initial=0.0)),
            dissipation=-float((f[:, :2] * motion[:, :2]).sum()),
            lifted=float((f[:, 2] * motion[:, 2]).sum()),
        )
    return out
