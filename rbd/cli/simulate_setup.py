"""What `rbd simulate` simulates by default: a robot on its feet, a mechanism, an arm, or a body in the air."""

from __future__ import annotations

import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from rbd.cli.mechanism_report import assembled
from rbd.cli.terminal import numbers_of
from rbd.constraints import joint_limits
from rbd.constraints.collision import CollisionContacts
from rbd.constraints.constraint import Constraint
from rbd.control.posture import HoldPosture
from rbd.control.schedules import Controller, Push
from rbd.errors import InputError
from rbd.model.state import State
from rbd.robots.loading import load_robot
from rbd.robots.loop_file import Root
from rbd.robots.robot import Robot

Value = TypeVar("Value")

BODIES = "bodies_on_ground"
"""Name of the contacts of all bodies but the feet."""
FAR = 1e5
"""Distance from the ground [m] within which shapes are searched when a body is placed on it."""


@dataclass(frozen=True, eq=False)
class Setup:
    """Setup of a simulation.

    Attributes:
        state: Where it starts.
        constraints: In force throughout.
        feet: Names of its feet; empty if it does not stand.
        controller: Controller of the motors; None for none.
        summary: What it does, in short.
        limits: What the model neglects, a sentence each.
    """

    state: State
    constraints: tuple[Constraint, ...]
    feet: tuple[str, ...]
    controller: Controller | None
    summary: str
    limits: tuple[str, ...]


def loaded(
    name: str,
    *,
    root: Root | None = None,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    feet: Sequence[str] | None = None,
) -> Robot:
    """The robot; one with motors that neither has feet nor loops nor wheels has a fixed base, unless `root` gives another."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        robot = load_robot(name, root=root, package_dirs=package_dirs, feet=feet)
    said = root is not None or robot.mechanism.file.root is not None
    stands = bool(robot.source.feet or robot.loops() or robot.wheels())
    if said or stands or not robot.floating or not robot.nu or robot.urdf.suffix != ".urdf":
        for warning in caught:
            warnings.warn(warning.message, warning.category, stacklevel=2)
        return robot
    return load_robot(name, root="fixed", package_dirs=package_dirs)  # which warns of the robot as it is used


def setup(
    robot: Robot,
    *,
    posture: str | None = None,
    friction: float = 0.7,
    hold: bool | None = None,
    bodies: bool | None = None,
    stops: bool = False,
) -> Setup:
    """Default setup for a robot.

    On feet, where they are known: frictional soles or points, the posture held. With loops or wheels: these hold, and its
    motors without torque. Else the posture of a fixed arm, held.

    Args:
        robot: The robot.
        posture: Where it starts, by name; the standing one, else the file's first, else neutral.
        friction: Coulomb's coefficient of its feet.
        hold: Whether its motors hold the posture; None: as above.
        bodies: Whether all other collision shapes of its file may touch the ground z = 0 too; what has no feet and floats is
            then laid on it. None: where a robot on feet has such shapes, so that one that falls ends on the ground.
        stops: Whether its joints stop at the limits of its file.

    Raises:
        CannotHold: the posture cannot be held; names the limit that prevents it.
        CannotAssemble: its loops do not close.
        InputError: unknown names, a friction that is none.
    """
    held = (*robot.loops(), *robot.wheels())
    feet: tuple[Constraint, ...] = ()
    if robot.source.feet and robot.floating:
        state, feet = robot.standing(posture), tuple(robot.feet(friction))
    else:
        name = posture or robot.source.posture or next(iter(robot.postures), None)
        state = assembled(robot, held, robot.at(name))
    if bodies is None:
        bodies = bool(feet) and bool(_other_shapes(robot, feet))
    constraints = (*feet, *held)
    holds = bool(feet) or not (held or robot.floating) if hold is None else hold
    controller = HoldPosture(state, constraints) if holds and robot.nu else None
    limits = []
    if feet and not bodies:
        limits.append("only its feet touch the ground: the run stops where it falls through it (--bodies: all shapes touch)")
    elif not feet and not robot.wheels() and not bodies and robot.root != "fixed":
        limits.append("it touches nothing (--bodies lets all shapes touch the ground)")
    if bodies:
        others = _others(robot, feet, friction)
        constraints = (*constraints, others)
        if robot.floating and not (feet or held):
            state = _laid(state, others)
    if stops:
        constraints = (*constraints, *joint_limits(robot))
    limits.append("bodies do not touch each other" + ("" if stops else ", and joints do not stop at their limits (--stops)"))
    limits.append("rigid bodies; damping and friction of the joints in the robot's file are left out")
    summary = _summary(state, feet, held, controller)
    return Setup(state, constraints, tuple(c.name for c in feet), controller, summary, tuple(limits))


def pushes(
    forces: Sequence[str], frames: Sequence[str], starts: Sequence[float], durations: Sequence[float]
) -> tuple[Push, ...]:
    """The pushes of the command line: one of each a push, or one for all.

    Raises:
        InputError: numbers of options that do not fit, a force that is not three numbers.
    """
    n = len(forces)
    if not n:
        for option, given in (("--at", frames), ("--from", starts), ("--for", durations)):
            if given:
                raise InputError(f"{option} came without --push X,Y,Z; e.g. --push 0,80,0 --at torso_2_link.")
        return ()
    if not frames:
        raise InputError("--push came without --at FRAME; a push wants both, e.g. --push 0,80,0 --at torso_2_link.")
    at = _one_each("--at", frames, n)
    start = _one_each("--from", starts or (0.0,), n)
    lasting = _one_each("--for", durations or (0.1,), n)
    vectors = [numbers_of("--push", force, "newtons", names="X,Y,Z") for force in forces]
    return tuple(Push(f, v, start=s, duration=d) for f, v, s, d in zip(at, vectors, start, lasting, strict=True))


def _one_each(option: str, given: Sequence[Value], n: int) -> Sequence[Value]:
    if len(given) not in (1, n):
        raise InputError(f"{option} came {len(given)} times with {n} times --push; give it once for all, or once a push.")
    return list(given) * n if len(given) == 1 else given


def _others(robot: Robot, feet: Sequence[Constraint], friction: float) -> CollisionContacts:
    """Contacts of all moving shapes, except those that the feet's contacts represent."""
    return CollisionContacts(BODIES, robot, friction=friction, ground=_other_shapes(robot, feet))


def _other_shapes(robot: Robot, feet: Sequence[Constraint]) -> tuple[str, ...]:
    """Names of the moving collision shapes, except those of the feet's bodies."""
    soles = {robot.site(contact.frame)[0] for contact in feet}  # type: ignore[attr-defined]
    return tuple(g.name for g in robot.collision_model.geometryObjects if g.parentJoint not in {0, *soles})


def _laid(state: State, contacts: CollisionContacts) -> State:
    """Moved up or down until its lowest shape touches the ground."""
    gaps = contacts.with_margin(FAR).points(state).gaps
    if not len(gaps):
        return state
    q = state.q.copy()
    q[2] -= float(gaps.min())
    return State(state.robot, q)


def _summary(state: State, feet: Sequence[Constraint], held: Sequence[Constraint], controller: Controller | None) -> str:
    robot = state.robot
    on = ", ".join(c.name for c in (*feet, *held))
    where = "fixed" if not robot.floating and not held else ""
    where = f"on {on}" if on else where or "free"
    return f"{where}, {'holding its posture' if controller else 'motors without torque' if robot.nu else 'without motors'}"
