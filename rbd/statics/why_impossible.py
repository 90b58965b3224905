"""Why a motion is not possible, or a pose cannot be held: the error with its limits, its certificate and what is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rbd.arrays import largest_first
from rbd.constraints.constraint import Constraint, has_friction, rows_of
from rbd.constraints.convex.polygons import convex_hull, inside_distance
from rbd.constraints.distance_warnings import warn_of_opening
from rbd.errors import CannotHold, CannotMove, Reason
from rbd.model.checked_model import on_its_line
from rbd.model.world import LEAST_FALL, along_gravity, is_along_z
from rbd.problem.conic import Conic, Unknowns
from rbd.problem.force_set import at_rest
from rbd.problem.programs import CONIC_STEPS, FRICTION_PROGRAMS
from rbd.statics.actuation import Actuation
from rbd.statics.force_balance import ForceBalance
from rbd.statics.least_friction import Balance, LimitReached, rounded_up
from rbd.statics.limits import Limit, Relaxable
from rbd.statics.nearest_possible_motion import Excess, Missing, excess, missing
from rbd.statics.wanted_motion import WantedMotion, warned

_NOTHING = 1e-7
"""What is missing below this, over the body weight, is nothing."""
_TOLD = 8  # limits, contacts or joints that a message names


def actuation_of(wanted: WantedMotion, *, stacklevel: int) -> Actuation:
    """The torques and forces of least effort of a wanted motion; a warning names what opens, or is inaccurate.

    Raises:
        ContactMoves: the velocity is none that the contacts allow.
        CannotMove: the acceleration is none that they allow, or there are no such torques and forces.
    """
    if wanted.quick is not None:
        return wanted.quick
    warn_of_opening(wanted.state.robot, wanted.sets.openings, wanted.choice.rest_speed, stacklevel=stacklevel)
    for margin in wanted.choice.margins:
        found = wanted.sought(margin)
        if isinstance(found, Actuation) and (good := warned(found, stacklevel + 1)) is not None:
            return good
    raise Refusal(wanted, wanted.loads(margin), margin).error()


@dataclass(frozen=True, eq=False)
class Refusal:
    """A motion that is not possible.

    Attributes:
        wanted: The motion, its contacts, and what its forces must keep to.
        loads: The equations of motion and the sets of forces.
        margin: Of friction.
    """

    wanted: WantedMotion
    loads: ForceBalance
    margin: float

    def error(self) -> CannotMove:
        """What to raise."""
        holds, effort = self.wanted.choice.holds, self.wanted.choice.effort
        kind = CannotHold if holds else CannotMove
        name, does = self.loads.state.robot.name, "be held" if holds else "move so"
        nearest, relaxable = partial(WantedMotion.nearest, self.wanted, self.margin), Relaxable(self.loads, effort)
        certificate = relaxable.refuted()
        if certificate is None:
            return kind(
                f"{name}: whether it can {does} was not found within {CONIC_STEPS} steps of a conic program: it is within 1e-6 "
                "of a limit, or its contacts are nearly redundant. Change the pose, the push or the friction a little.",
                nearest=nearest,
                reason=self._reason("undecided"),
            )
        limits, irreducible = relaxable.irreducible(certificate)
        lack = missing(self.loads, effort)
        beyond = None
        if lack is not None and lack.size <= _NOTHING * self.loads.unit:
            beyond = excess(self.loads, effort)
        detail, why = self._why(limits if irreducible else (), lack, beyond)
        words = f"{name} cannot {does}{self._on()}: {why}"
        if limits:
            together = "Together these limits prevent it" if irreducible else "All or some of these limits prevent it"
            words += f" {together}: {_listed([str(limit) for limit in limits])}."
        if lack is not None and lack.size > _NOTHING * self.loads.unit:
            words += f" {(told := str(lack))[:1].upper()}{told[1:]}."
        if not holds:
            words += " `error.nearest()` is the nearest acceleration that is possible with the contacts kept."
        return kind(
            words, limits=limits, irreducible=irreducible, certificate=certificate, missing=lack,
            excess=None if beyond is None else beyond.share, nearest=nearest,
            reason=self._reason(detail),
        )  # fmt: skip

    def _reason(self, detail: str) -> Reason:
        return Reason(f"cannot_{'hold' if self.wanted.choice.holds else 'move'}{detail and ': '}{detail}")

    def _on(self) -> str:
        return " on " + _listed([f"{r.name!r:.80}" for r in self.loads.rows], ", ") if self.loads.rows else ""

    def _why(self, limits: Sequence[Limit], lack: Missing | None, over: Excess | None) -> tuple[str, str]:
        """(detail of the `Reason`, sentences): the first of all possible reasons that is shown to be one."""
        robot = self.loads.state.robot
        if over is not None:
            beyond = np.flatnonzero(over.share > 1e-7)
            beyond = beyond[largest_first(over.share[beyond])][:4]
            words = {int(i): on_its_line(robot, int(i), float(over.tau[i]), self.loads.state.v) for i in beyond}
            if told := [f"{robot.actuated_names[i]!r:.80} needs {text}" for i, text in words.items() if text]:
                return "motor", f"the torque-speed line of a motor prevents it. At best {_listed(told)}."
            needs = ", ".join(f"{robot.actuated_names[i]!r} needs {100 * (1 + over.share[i]):.4g} %" for i in beyond)
            return "motor", f"a torque limit prevents it. At best {needs} of its limit."
        passive = [repr(limit.name) for limit in limits if limit.kind == "passive"]
        if passive and not any(limit.kind == "base" for limit in limits):
            return "passive joint", f"{_listed(passive, ', ')} would need torque, and is passive."
        if not self.loads.rows:
            return "no contact", "it has no contact, so nothing carries its weight. Give contacts, e.g. robot.feet()."
        if asked := [repr(limit.name) for limit in limits if limit.kind == "normal force"]:
            at = _listed(asked, ", ")
            return "request", f"what the objective asks of normal forces or centres of pressure at {at} prevents it."
        if self.margin and isinstance(without := self.wanted.sought(0.0), Actuation) and warned(without, 6) is not None:
            kept = f"{100 * self.margin:g} % from its limit"
            return "friction margin", f"friction is kept {kept}, and prevents it; with margin=0 it could."
        if self.wanted.choice.holds and (found := self._why_friction()) is not None:
            return found
        if any(limit.kind == "friction" for limit in limits):
            return "friction", "friction prevents it."
        return "support", self._unbalanced()

    def _unbalanced(self) -> str:
        state, holds = self.loads.state, self.wanted.choice.holds
        pushed = float(np.abs(self.loads.need - state.M @ self.wanted.a - state.h).max()) > 1e-9
        x, y, _ = np.round(state.com, 3) + 0.0
        what = "its weight" if holds else "this motion and its weight"
        advice = "Push less, or move the centre of mass against the push." if pushed else "Move it over its feet."
        return (
            f"no forces that its contacts can give balance {what}{' and the external forces' if pushed else ''} "
            f"(centre of mass at x = {x:.3f}, y = {y:.3f} m{self._outside()}).{f' {advice}' if holds else ''}"
        )

    def _outside(self) -> str:
        patches = [r.patch for r in self.loads.rows if r.patch is not None and r.patch.against is None]
        ground = [patch.point + patch.corners @ patch.axes.T for patch in patches]
        if not ground:
            return ""
        g = self.loads.state.robot.gravity
        if not abs(g[2]) > LEAST_FALL * np.linalg.norm(g):
            return ""
        points = along_gravity(g, np.concatenate([self.loads.state.com[None], *ground]))
        d = inside_distance(points[0], convex_hull(points[1:]))
        seen = "from above" if is_along_z(g) else "along gravity"
        return f", seen {seen} {-1e3 * d:.1f} mm outside the hull of the contact points" if d < -1e-4 else ""

    def _why_friction(self) -> tuple[str, str] | None:
        """(detail, sentences): whether more friction would do, and how much; None where none would."""
        if not any(has_friction(c) for c in self.wanted.contacts):
            return None
        try:
            return self._more_friction()
        except LimitReached:
            return "", (
                f"whether more friction would do was not found within {FRICTION_PROGRAMS} conic programs. "
                "Try friction=10.0 at its contacts."
            )

    def _more_friction(self) -> tuple[str, str] | None:
        inside = self.wanted.choice.friction == "inscribed"
        if inside and self._circular(limits=True, as_given=True).holds():
            mu = self._least(limits=True, from_zero=True)
            enough = "" if mu is None else f" from a coefficient of {rounded_up(mu)} at every contact on"
            return "friction", (
                f"friction prevents it: circular cones would hold it{enough}, but the pyramids inside them do not. Use "
                "friction='cone', or give the contacts more facets, e.g. facets=16."
            )
        if (mu := self._least(limits=True)) is not None:
            more = " with circular cones; the pyramids inside them ask for more, unless they have many facets" if inside else ""
            least = f"a coefficient {self._told(mu)} at every contact would do (the least is {mu:.6g})"
            return "friction", f"friction prevents it; {least}{more}."
        if (mu := self._least(limits=False)) is not None:
            return "friction and motor", (
                f"friction prevents it, and then a torque limit: from a coefficient of {rounded_up(mu)} at every contact "
                "on, forces balance it, but motors would need more than their limits."
            )
        return None

    def _told(self, mu: float) -> str:
        """In words; where it is in all its digits what is given, that it is above."""
        given = min(c.friction for c in self.wanted.contacts if has_friction(c))  # type: ignore[attr-defined]
        rounded = rounded_up(mu)
        above = float(rounded) > given or self.wanted.choice.friction == "inscribed"
        return f"of {rounded}" if above else f"just above {rounded}"

    def _least(self, *, limits: bool, from_zero: bool = False) -> float | None:
        """The least coefficient that would do, the margin kept."""
        mu = self._circular(limits=limits, from_zero=from_zero).least()
        return None if mu is None else mu / (1.0 - self.margin)

    def _circular(self, *, limits: bool, as_given: bool = False, from_zero: bool = False) -> Balance:
        """The same question under circular cones: as given, of coefficients to be found above those given, or from zero on."""
        L, robot, contacts = self.loads, self.loads.state.robot, self.wanted.contacts
        rows = rows_of(L.state, [c if as_given else _with_friction(c, 1.0) for c in contacts])
        P = at_rest(*[r.cone for r in rows])
        per_weight = np.concatenate([r.J for r in rows]).T @ P.G * L.unit
        own, yields = P.mu * (1.0 - self.margin), np.zeros(len(P.mu), bool)
        for c, span in zip(contacts, P.slices, strict=True):
            at = (span.start <= P.cone_at) & (P.cone_at < span.stop)
            if has_friction(c):
                yields[at] = not as_given
                own[at] = 0.0 if from_zero else c.friction * (1.0 - self.margin)  # type: ignore[attr-defined]
        limited = L.limited if limits else np.zeros_like(L.limited)
        T, t, limit = per_weight[robot.actuated][limited], L.t[limited], L.limit[limited]
        forces = Unknowns(P.size, 0.0, 0.0, P.lower / L.unit, P.upper / L.unit, P.cone_columns, own)
        balance = {"forces": per_weight[robot.unactuated] / L.unit}, L.need[robot.unactuated] / L.unit
        torques = {"forces": T / limit[:, None]}, t - 1.0, t + 1.0
        return Balance(Conic.of({"forces": forces}, [balance], [torques]), yields)


def _with_friction(contact: Constraint, mu: float) -> Constraint:
    """The contact with at least this coefficient, if it has one."""
    return contact.with_friction(max(mu, contact.friction)) if has_friction(contact) else contact  # type: ignore[attr-defined]


def _listed(words: Sequence[str], between: str = "; ") -> str:
    """The first few, and how many more."""
    more = f"{between}and {len(words) - _TOLD} more" if len(words) > _TOLD else ""
    return between.join(words[:_TOLD]) + more
