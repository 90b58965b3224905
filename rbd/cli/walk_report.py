"""The report of `rbd walk`: how far it came, and how near to its limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
from rich.console import Group
from rich.text import Text

from rbd.arrays import Array
from rbd.cli.simulate_report import FALLEN, busiest_motor
from rbd.cli.terminal import TerminalTable, facts
from rbd.control.schedules import Push
from rbd.control.walking.plan import WalkPlan
from rbd.control.walking.walk import Walk
from rbd.records import Field, counted, fixed, share
from rbd.simulation.trajectory import Trajectory

LOADED = 0.05
"""Friction is looked at where a foot carries more than this share of the weight."""


class StepTaken(NamedTuple):
    """A footstep: where it was planned at first and at last, and where the foot stands at the end of its stay."""

    foot: str
    landing: float
    planned: Array
    changed: float
    error: float


@dataclass(frozen=True, eq=False)
class WalkReport:
    """A walk that was simulated.

    Attributes:
        trajectory: The motion.
        walk: Its controller.
        plan: As it was made before.
        pushes: What pushed it.
        seconds: {what: time taken [s]}.
    """

    trajectory: Trajectory
    walk: Walk
    plan: WalkPlan
    pushes: Sequence[Push]
    seconds: Mapping[str, float]

    fields: ClassVar[tuple[Field, ...]] = (
        Field("robot", (), "", "its name", lambda found: found.trajectory.robot.name),
        Field("gait", (), "", "order and times of swings", lambda found: vars(found.walk.gait)),
        Field("pushes", (), "", "what pushed it"),
        Field("answer", (), "", "how it ended"),
        Field("fallen", (), "", "whether it fell"),
        Field("footsteps", (), "1", "number of footsteps", lambda found: len(found.walk.plan.footsteps)),
        Field("duration", (), "s", "how long it walked", lambda found: found.trajectory.duration),
        Field("distance", (), "m", "from where the centre of mass was to where it is, along the ground"),
        Field("rise", (), "m", "how much higher the centre of mass is at the end"),
        Field("plans", (), "1", "how often it planned again on the way", lambda found: len(found.walk.plans)),
        Field("violated_steps", (), "1", "steps of control that left a limit", lambda found: found.walk.log.violations),
        Field("control_steps", (), "1", "steps of control", lambda found: len(found.walk.log)),
        Field("torque_share", (), "1", "largest torque over its limit", lambda found: found.walk.log.torque_share.max()),
        Field(
            "friction_use", (), "1", "largest friction over what the cone allows, by foot, where it carries 5 % of the weight"
        ),
        Field("foot_error", (), "m", "largest distance of a foot from where it was planned, at the end"),
        Field("steps", (), "", "footsteps: when and where the foot lands, by how much that was changed on the way, its error"),
        Field("seconds", (), "s", "how long each part took"),
    )

    @property
    def distance(self) -> float:
        """How far the centre of mass moved along the ground [m]."""
        return float(np.linalg.norm((self.trajectory.com[-1] - self.trajectory.com[0])[:2]))

    @property
    def rise(self) -> float:
        """How much higher the centre of mass is at the end [m]."""
        return float(self.trajectory.com[-1, 2] - self.trajectory.com[0, 2])

    @property
    def fallen(self) -> bool:
        """Whether the centre of mass is below 60 % of its height over the feet at the start."""
        plan, x = self.walk.plan, self.trajectory
        height = float(plan.centroid.com[-1, 2] - np.mean([plan.placed(foot, 1e9).translation[2] for foot in plan.poses]))
        return float(plan.com(float(x.t[-1])).value[2] - x.com[-1, 2]) > (1.0 - FALLEN) * height

    @property
    def friction_use(self) -> dict[str, float]:
        """{foot: largest share of its friction cone}."""
        x, found = self.trajectory, {}
        for contact in self.walk.contacts:
            f = x.forces[contact.name][:, :3]
            n = np.array([self.walk.plan.placed(contact.name, t).rotation[:, 2] for t in x.t])
            normal = np.einsum("ij,ij->i", f, n)
            along = np.linalg.norm(f - normal[:, None] * n, axis=1)
            on = normal > LOADED * x.robot.force_unit
            found[contact.name] = float((along[on] / (contact.friction * normal[on])).max(initial=0.0))
        return found

    @property
    def steps(self) -> list[StepTaken]:
        """Footsteps in the order of their landing, those that came to stand."""
        x, walk, out = self.trajectory, self.walk, []
        first = {foot: [s.end.translation for s in own] for foot, own in self.plan.swings.items()}
        contacts = {contact.name: contact for contact in walk.contacts}
        for foot in walk.plan.swings:
            stays = walk.plan.stays(foot)[1:]
            for place, (pose, lands, lifted) in zip(first[foot], stays, strict=True):
                end = min(lifted, float(x.t[-1]))
                if end <= lands:
                    continue
                c = contacts[foot]
                at = x.at(0.5 * (lands + end)).frame(c.frame, c.placement.act(c.corners.mean(axis=0))).X_WF.translation
                off = float(np.linalg.norm(at - pose.translation))
                out.append(
                    StepTaken(foot, float(lands), pose.translation, float(np.linalg.norm(pose.translation - place)), off)
                )
        return sorted(out, key=lambda step: (step.landing, step.foot))

    @property
    def foot_error(self) -> float:
        """Largest distance of a foot from where it was planned, at the end [m]."""
        end, plan = self.trajectory.state(-1), self.walk.plan
        return max(
            float(np.linalg.norm(end.frame(c.frame, c.placement.act(c.corners.mean(axis=0))).X_WF.translation
                                 - plan.placed(c.name, 1e9).translation))
            for c in self.walk.contacts
        )  # fmt: skip

    @property
    def answer(self) -> str:
        """How it ended."""
        x, name = self.trajectory, self.trajectory.robot.name
        if self.fallen:
            return f"{name} has fallen after {x.duration:g} s."
        rises = "" if abs(self.rise) < 5e-3 else f" and {abs(self.rise):.3f} m {'higher' if self.rise > 0 else 'lower'}"
        return f"{name} took {counted(len(self.steps), 'step')} in {x.duration:.2f} s and is {self.distance:.3f} m away{rises}."

    def __rich__(self) -> Group:
        """How it ended, its footsteps, and how near to its limits it came."""
        x, log = self.trajectory, self.walk.log
        table = TerminalTable(None, ("step", "foot"), ("lands [s]", "x [m]", "y [m]", "z [m]", "moved [mm]", "error [mm]"))
        for i, step in enumerate(self.steps):
            place = [fixed(value, 3) for value in step.planned]
            table.add_row(
                str(i + 1), step.foot, fixed(step.landing, 2), *place, fixed(1e3 * step.changed, 0), fixed(1e3 * step.error, 2)
            )
        use = self.friction_use
        most = max(use, key=lambda foot: use[foot])
        rows: list[tuple[str, str]] = [
            ("violated steps", f"{log.violations} of {len(log)}, residuals of at most {log.residual.max():.1g}"),
            ("largest torque", busiest_motor(x)),
            ("largest friction use", f"{share(use[most])} of the cone, {most}"),
            ("feet at the end", f"{1e3 * self.foot_error:.2f} mm from where they were planned"),
        ]
        if self.walk.plans:
            rows.append(("planned again", f"{counted(len(self.walk.plans), 'time')}, first at {self.walk.plans[0][0]:.3f} s"))
        lines: list[Any] = [Text(f"  pushed with {push}") for push in self.pushes]
        return Group(Text(self.answer, style="bold"), *lines, table, facts(None, rows))
