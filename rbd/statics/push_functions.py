"""Functions for studies, as `rbd stand --sweep` runs them: a standing robot that is pushed, of arguments to sweep."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from rbd.answers.least_constraint import solve
from rbd.answers.solution import Solution
from rbd.arrays import Array, as_vector3, check_number
from rbd.errors import InputError
from rbd.errors.inputs import check_kind
from rbd.model.external import ExternalForce
from rbd.model.state import State
from rbd.problem.cones import check_friction
from rbd.robots.loading import load_robot
from rbd.robots.robot import Robot
from rbd.statics.actuation import Actuation
from rbd.statics.equilibrium import hold

_KEPT = 64
"""Robots, postures and torques that a process keeps."""


def withstand_push(
    robot: Robot | str,
    *,
    posture: str | None = None,
    friction: float = 0.7,
    facets: int | None = None,
    margin: float | None = None,
    at: str | None = None,
    push: float = 0.0,
    push_angle: float | None = None,
    direction: Sequence[float] = (1.0, 0.0, 0.0),
    push_x: float = 0.0,
    push_y: float = 0.0,
    push_z: float = 0.0,
) -> Actuation:
    """The motor torques of least effort with which a robot on its feet withstands a push, as `rbd.hold` finds them.

    Each argument is a number or a name, so that a study can vary it; a robot by its name is loaded once in a process.

    Args:
        robot: The robot, or a name or path that `rbd.load_robot` takes.
        posture: Posture by name; that of the catalogue by default.
        friction: Coulomb's coefficient of its feet.
        facets: None: circular friction cones; else the pyramids of so many facets that are inside of them.
        margin: As of `rbd.hold`.
        at: The frame at whose origin it is pushed; the heaviest link by default.
        push: Size of the push along `direction` [N].
        push_angle: Direction of `push` in the level plane, from x towards y [deg]; takes the place of `direction`.
        direction: Direction of `push` in W; its length does not matter.
        push_x: Force along x of W, added to `push` [N].
        push_y: Force along y of W, added to `push` [N].
        push_z: Force along z of W, added to `push` [N].

    Raises:
        CannotHold: no torques within the motors' limits withstand it; names the limits that prevent it.
        InputError, ModelError: unknown names, numbers that are none.

    Example:
        >>> held = rbd.studies.withstand_push("solo12", friction=0.6, push_y=3.0)
        >>> print(f"{held.margins.friction['front_left']:.3f} of the friction is left")
        0.708 of the friction is left
        >>> from functools import partial
        >>> samples = rbd.grid(friction=[0.1, 0.6], push_y=[0.0, 3.0, 6.0])
        >>> found = rbd.study(partial(rbd.studies.withstand_push, "solo12"), samples, executor=0)
        >>> found.ok.values
        array([[ True, False, False],
               [ True,  True,  True]])
    """
    check_friction(friction, 4)
    stands, state = _standing(robot, posture)
    feet = stands.feet(friction, facets=4 if facets is None else facets, at=state)
    external = _external(stands, at, push, push_angle, direction, (push_x, push_y, push_z))
    return hold(state, feet, external=external, friction="cone" if facets is None else "inscribed", margin=margin)


def move_under_push(
    robot: Robot | str,
    *,
    posture: str | None = None,
    friction: float = 0.7,
    law: str = "coulomb",
    at: str | None = None,
    push: float = 0.0,
    push_angle: float | None = None,
    direction: Sequence[float] = (1.0, 0.0, 0.0),
    push_x: float = 0.0,
    push_y: float = 0.0,
    push_z: float = 0.0,
) -> Solution:
    """The motion and forces of a pushed robot whose motors keep the torques that hold it unpushed, as `rbd.solve` finds them.

    Args:
        robot: As of `withstand_push`, and so are all others but the law.
        posture: Posture by name.
        friction: Coulomb's coefficient of its feet.
        law: Of contacts that slip, "coulomb" or "convex".
        at: The frame that is pushed.
        push: Size of the push along `direction` [N].
        push_angle: Direction of `push` in the level plane, from x towards y [deg].
        direction: Direction of `push` in W.
        push_x: Force along x of W [N].
        push_y: Force along y of W [N].
        push_z: Force along z of W [N].

    Raises:
        CannotHold: it cannot be held without the push.
        NoSolution, InputError, ModelError: as `rbd.solve`; unknown names, numbers that are none.

    Example:
        >>> for law in ("coulomb", "convex"):
        ...     moved = rbd.studies.move_under_push("solo12", friction=0.1, push_x=40.0, law=law)
        ...     print(f"{moved.law}: the base sinks at {-1e3 * moved.a[2]:.1f} mm/s2")
        coulomb: the base sinks at 38.2 mm/s2
        convex: the base sinks at 46.0 mm/s2
    """
    check_friction(friction, 4)
    stands, state = _standing(robot, posture)
    external = _external(stands, at, push, push_angle, direction, (push_x, push_y, push_z))
    tau = _unpushed(robot, posture, float(friction))
    return solve(state, tau, stands.feet(friction, at=state), law=law, external=external)


def heaviest_link(robot: Robot) -> str:
    """The link with the largest mass, fixed ones joined to it counted: where a push acts unless said otherwise."""
    model = robot.model
    joint = int(np.argmax([inertia.mass for inertia in model.inertias]))
    links = [frame.name for frame in model.frames if frame.parentJoint == joint and frame.type == pin.BODY]
    return links[0]


def _standing(robot: Robot | str, posture: str | None) -> tuple[Robot, State]:
    """The robot, and where it stands, both kept by the process.

    Raises:
        InputError: what is no robot and no name; as `Robot.standing`.
    """
    check_kind("robot", robot, Robot | str, "a robot of rbd.load_robot, or its name")
    check_kind("posture", posture, str | None, "a posture's name, or None")
    return _kept(robot, posture)


@lru_cache(_KEPT)
def _kept(robot: Robot | str, posture: str | None) -> tuple[Robot, State]:
    found = robot if isinstance(robot, Robot) else _loaded(robot)
    return found, found.standing(posture)


@lru_cache(_KEPT)
def _loaded(name: str) -> Robot:
    return load_robot(name)


@lru_cache(_KEPT)
def _unpushed(robot: Robot | str, posture: str | None, friction: float) -> Array:
    stands, state = _kept(robot, posture)
    return hold(state, stands.feet(friction, at=state)).tau


def _external(
    robot: Robot,
    at: str | None,
    push: float,
    push_angle: float | None,
    direction: Sequence[float],
    components: tuple[float, float, float],
) -> list[ExternalForce]:
    """The push, as a list of one force.

    Raises:
        InputError: a direction that is none, numbers that are not finite; as `Robot.frame`.
    """
    sizes = {"push": push, "push_angle": 0.0 if push_angle is None else push_angle}
    sizes |= dict(zip(("push_x", "push_y", "push_z"), components, strict=True))
    found = {name: check_number(name, value, -1e100, 1e100, expected="a finite number") for name, value in sizes.items()}
    along = as_vector3("direction", direction)
    if push_angle is not None:
        angle = math.radians(found["push_angle"])
        along = np.array([math.cos(angle), math.sin(angle), 0.0])
    length = float(np.linalg.norm(along))
    if not 1e-100 < length < math.inf:
        raise InputError(f"direction is {direction!r:.80}; expected three numbers, not all zero, e.g. (0, 1, 0).")
    force = found["push"] * along / length + np.array([found["push_x"], found["push_y"], found["push_z"]])
    frame = heaviest_link(robot) if at is None else at
    robot.frame(frame)  # an unknown one is refused by its name
    return [ExternalForce(frame, force)]
