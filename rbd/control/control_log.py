"""`ControlLog`: what a whole-body controller did at each of its steps, and where its contacts were not those that touch."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from typing import NamedTuple

import numpy as np

from rbd.arrays import Array
from rbd.displayed import Displayed

MEANING = {
    "late": "planned, and does not touch",
    "partial": "taken as a contact, and not all of it touches",
    "early": "touches before it is planned, and is taken as a contact",
    "overdue": "is not planned any more, and is kept as the only contact that carries the robot",
    "unplanned": "touches, and is not planned",
    "slips": "taken as a contact, and slides",
}
"""How what touches can differ from what a step of control assumes."""


class ControlStep(NamedTuple):
    """One step of control: the entries of `ControlLog`, and how contacts differed, as (contact, kind)."""

    t: float
    residual: float
    violation: float
    torque_share: float
    missed: Mapping[str, float]
    planned: Collection[str]
    touching: Collection[str]
    assumed: Collection[str]
    different: Iterable[tuple[str, str]]


class ControlLog(Displayed):
    """What a `WholeBodyController` did since the start of a motion: arrays with one entry a step of control.

    Args:
        tasks: Names of its tasks.
        contacts: Names of its contacts.

    Attributes:
        disagreements: {contact: {kind: in how many steps}} where what touches is not what was assumed. Kinds: "late", planned
            and does not touch; "partial", taken as a contact though not all its points touch; "early", touches before it is
            planned, late in its swing, and is taken as a contact; "overdue", not planned any more, and kept as the only one
            that carries the robot; "unplanned", touches and is not planned (of a contact that
            the controller does not have, too); "slips", taken as a contact and slides.
        first: {(contact, kind): when that was first seen [s]}.

    Example:
        >>> arm = rbd.load_robot("ur5", root="fixed")
        >>> reach = rbd.control.WholeBodyController([rbd.control.PostureTask(arm.at().q)])
        >>> reach.accepted(rbd.control.AcceptedStep(arm.at(), 0.0, 1e-3, {}))
        >>> print(reach.log.t, reach.log.missed["posture"].round(6), reach.log.violations)
        [0.] [0.] 0
    """

    def __init__(self, tasks: Iterable[str], contacts: Iterable[str]) -> None:
        self._tasks, self._contacts = tuple(tasks), tuple(contacts)
        self._steps: list[ControlStep] = []
        self.disagreements: dict[str, dict[str, int]] = {}
        self.first: dict[tuple[str, str], float] = {}

    def add(self, step: ControlStep) -> None:
        """Record a step."""
        self._steps.append(step)
        for contact, kind in step.different:
            kinds = self.disagreements.setdefault(contact, {})
            kinds[kind] = kinds.get(kind, 0) + 1
            self.first.setdefault((contact, kind), step.t)

    def __len__(self) -> int:
        return len(self._steps)

    def _column(self, i: int) -> Array:
        return np.array([step[i] for step in self._steps], float)

    @property
    def t(self) -> Array:
        """Times of the steps, shape (n,) [s]."""
        return self._column(0)

    @property
    def residual(self) -> Array:
        """The largest residual of each step, scaled, shape (n,)."""
        return self._column(1)

    @property
    def violation(self) -> Array:
        """How far each step had to leave contacts' accelerations or joint limits, shape (n,) [m/s2, rad/s2]; 0: not at all."""
        return self._column(2)

    @property
    def torque_share(self) -> Array:
        """The largest motor torque of each step over its limit, shape (n,)."""
        return self._column(3)

    @property
    def missed(self) -> dict[str, Array]:
        """{task: |wanted less reached| of each step, shape (n,)}; NaN where the task was left out."""
        return {name: np.array([step.missed.get(name, math.nan) for step in self._steps], float) for name in self._tasks}

    @property
    def planned(self) -> dict[str, Array]:
        """{contact: whether the schedule wants it, shape (n,) of truth values}."""
        return self._which(step.planned for step in self._steps)

    @property
    def touching(self) -> dict[str, Array]:
        """{contact: whether any of its points touch, shape (n,) of truth values}."""
        return self._which(step.touching for step in self._steps)

    @property
    def assumed(self) -> dict[str, Array]:
        """{contact: whether the step counts on it, shape (n,) of truth values}."""
        return self._which(step.assumed for step in self._steps)

    def _which(self, named: Iterable[Collection[str]]) -> dict[str, Array]:
        chosen = list(named)
        return {name: np.array([name in each for each in chosen], bool) for name in self._contacts}

    @property
    def violations(self) -> int:
        """In how many steps contacts or joint limits were not kept."""
        return sum(step.violation > 0.0 for step in self._steps)

    def __str__(self) -> str:
        if not self._steps:
            return "no step of control yet"
        t, worst = self.t, int(np.argmax(self.residual))
        lines = [
            f"{_steps(len(t))} of control from {t[0]:.6g} to {t[-1]:.6g} s",
            f"worst residual {self.residual[worst]:.2g} (scaled) at t = {t[worst]:.6g} s",
            f"largest torque {100.0 * self.torque_share.max():.0f} % of its limit",
        ]
        if n := self.violations:
            worst = int(np.argmax(self.violation))
            lines.append(
                f"{_steps(n)} could not keep contacts or joint limits, by at most {self.violation[worst]:.3g} m/s2 or rad/s2, "
                f"at t = {t[worst]:.6g} s"
            )
        else:
            lines.append("contacts and joint limits were kept in all steps")
        for contact, kinds in self.disagreements.items():
            for kind, n in kinds.items():
                lines.append(f"{contact}: {MEANING[kind]}, in {_steps(n)}, first at t = {self.first[contact, kind]:.6g} s")
        if not self.disagreements:
            lines.append("what touches is what was planned, in all steps")
        return "\n".join(lines)


def _steps(n: int) -> str:
    return f"{n} step{'s' * (n != 1)}"
