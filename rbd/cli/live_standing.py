"""`rbd stand --show`: a standing robot whose push, friction and law are set on the page, and which answers while they move."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from rbd.answers.least_constraint import solve
from rbd.arrays import Array
from rbd.cli.robot_reports import gives_way, strain
from rbd.cli.terminal import in_options
from rbd.constraints.constraint import Constraint
from rbd.constraints.surface import On
from rbd.errors import RbdError
from rbd.model.external import ExternalForce
from rbd.model.state import State
from rbd.records import vector
from rbd.robots.robot import Robot
from rbd.statics.actuation import Actuation
from rbd.statics.equilibrium import hold_many
from rbd.statics.push_functions import heaviest_link
from rbd.visual.live import Choice, Control, Slider, Verdict
from rbd.visual.scene import Scene
from rbd.visual.shapes import round_number

LAWS = ("coulomb", "convex")
UNPUSHED, BRACED = "as without the push", "withstand it"
LARGEST_PUSH = 0.5
"""The push goes up to this share of the weight, rounded."""
LEAST_FRICTION, MOST_FRICTION = 0.05, 1.5
MOST_LINKS = 12
LEAST_ACCELERATION = 5e-3
"""An acceleration below this is written as zero [m/s2]."""
SLOW = ("joint torques",)
"""Layers that are drawn when the sliders rest."""
_LEVEL = 90.0
_ALWAYS = ("base", "passive")
"""Kinds of limits that are no reason: a base has no motor."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A robot on its feet, pushed as the page's sliders say.

    Attributes:
        scene: Where it is drawn.
        robot: The robot.
        state: Its pose.
        facets: Of the friction pyramids.
        ground: Under its feet.
    """

    scene: Scene
    robot: Robot
    state: State
    facets: int
    ground: On = 0.0

    def controls(self, force: Array | None, at: str | None, friction: float, law: str, braced: bool) -> list[Control]:
        """The sliders, set to what the command was given.

        Args:
            force: The push in W, shape (3,) [N]; None for none.
            at: The frame that is pushed; None for the heaviest link.
            friction: Coefficient at the feet.
            law: Of contacts that slip.
            braced: Whether motors withstand the push; without one they would.
        """
        robot = self.robot
        weight = float(robot.mass * np.linalg.norm(robot.gravity))
        push = np.zeros(3) if force is None else force
        size = float(np.linalg.norm(push))
        most = max([round_number(scale) for scale in (LARGEST_PUSH * weight, 1.2 * size) if scale > 0.0], default=1.0)
        around = math.degrees(math.atan2(push[1], push[0]))
        up = math.degrees(math.atan2(push[2], math.hypot(push[0], push[1])))
        links = pushed_links(self.state)
        where = at if at is not None else heaviest_link(robot)
        return [
            Slider("push", 0.0, max(most, size), size, unit="N"),
            Slider("direction", -180.0, 180.0, around, unit="° from x to y", step=1.0),
            Slider("upwards", -_LEVEL, _LEVEL, up, unit="°", step=1.0),
            Choice("at", tuple(dict.fromkeys([where, *links])), where),
            Slider("friction", min(LEAST_FRICTION, friction), max(MOST_FRICTION, friction), friction, step=0.01),
            Choice("law of slip", LAWS, law),
            Choice("motors", (UNPUSHED, BRACED), UNPUSHED if force is not None and not braced else BRACED),
        ]

    def answer(self, values: Mapping[str, Any]) -> Iterator[Verdict | None]:
        """Draws the forces; says whether any motor torques withstand the push, then what prevents it."""
        push = push_of(values)
        external = [ExternalForce(values["at"], push)] if push.any() else []
        feet = self._feet(values["friction"])
        many = hold_many(self.robot, self.state.q[None], feet, external=external or None)
        possible = bool(many.answered[0])
        free = many[0] if possible and not external else self._unpushed(feet)
        if free is None:
            self.scene.show(self.state, None, external=external)
            yield Verdict("Does not stand", ("The pose cannot be held on these feet, pushed or not.",), False)
            yield self._refused(many, ())
            return
        held = many[0] if possible and values["motors"] == BRACED else free
        solution = solve(self.state, held.tau, feet, law=values["law of slip"], external=external)
        self.scene.show(self.state, solution, external=external, without=SLOW)
        shares = {name: c.friction_used for name, c in solution.contacts.items() if c.friction_used is not None}
        told = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares.items())
        used = [f"friction used: {told}"] if told else []
        braced = possible and values["motors"] == BRACED
        total = sum((c.force for c in solution.contacts.values()), push) / self.robot.mass + self.robot.gravity
        moves = _moves(total, braced)
        if possible:
            words = "Holds" if not external else "Motors can withstand the push"
            verdict = Verdict(words, (*strain(many[0]), *moves, *used), True)
        else:
            verdict = Verdict("Cannot be held: no motor torques withstand the push", (*moves, *used), False)
        yield verdict
        self.scene.show(self.state, solution, external=external)
        yield verdict if possible else self._refused(many, (*moves, *used))

    def _feet(self, friction: float) -> Sequence[Constraint]:
        return self.robot.feet(friction, facets=self.facets, on=self.ground, at=self.state)

    def _unpushed(self, feet: Sequence[Constraint]) -> Actuation | None:
        found = hold_many(self.robot, self.state.q[None], feet)
        return found[0] if found.answered[0] else None

    def _refused(self, many: Any, more: Sequence[str]) -> Verdict:
        """Which limits prevent it: found by linear programs that take longer than all else."""
        try:
            many[0]
        except RbdError as error:
            limits = [limit for limit in getattr(error, "limits", ()) if limit.kind not in _ALWAYS]
            names = ", ".join(dict.fromkeys(limit.name for limit in limits if limit.name))
            why = "no forces of its contacts balance it" if getattr(error, "limits", ()) else "the reason was not found"
            title = f"Cannot be held: {' and '.join(gives_way(limits)) or why}"
            lack = getattr(error, "missing", None)
            missing = () if lack is None or not lack.size else (f"missing: a force of {vector(lack.force, 1)} N",)
            named = (f"what gives way: {names}",) if names else (in_options(str(error)),)
            return Verdict(title, (*named, *missing, *more), False)
        return Verdict("Within 1e-6 of a limit", tuple(more), None)


def push_of(values: Mapping[str, Any]) -> Array:
    """The push in W of the sliders' size and angles, shape (3,) [N]."""
    size, around, up = (values["push"], math.radians(values["direction"]), math.radians(values["upwards"]))
    level = size * math.cos(up)
    exact = np.array([level * math.cos(around), level * math.sin(around), size * math.sin(up)])
    return np.where(np.abs(exact) < 1e-12 * max(size, 1.0), 0.0, exact)


def pushed_links(state: State) -> list[str]:
    """Links to push, from the top down: the heaviest ones, one for each joint."""
    model = state.robot.model
    masses = np.array([inertia.mass for inertia in model.inertias])
    first: dict[int, str] = {}
    for frame in model.frames:
        if frame.type == pin.BODY and frame.parentJoint:
            first.setdefault(frame.parentJoint, frame.name)
    heavy = sorted(first, key=lambda joint: -masses[joint])[:MOST_LINKS]
    height = {first[joint]: float(state.frame(first[joint]).X_WF.translation[2]) for joint in heavy}
    return sorted(height, key=lambda name: -height[name])


def _moves(acceleration: Array, braced: bool) -> list[str]:
    """What the torques that act do."""
    if float(np.linalg.norm(acceleration)) < LEAST_ACCELERATION:
        return []
    which = "these torques" if braced else "the torques of the unpushed pose"
    return [f"under {which} the centre of mass accelerates at {vector(acceleration, 2)} m/s²"]
