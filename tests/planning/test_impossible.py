"""What no robot can do is refused, and by the right limits: 50 tasks in an exhaustive run, one of each kind otherwise."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import CannotMove, CannotPlan, CannotReach, RbdError
from rbd.planning.stays import centre_of

robot_of = cache(rbd.load_robot)


class Task(NamedTuple):
    """A task that is impossible.

    Attributes:
        robot: Whose task it is.
        kind: What makes it so.
        size: How much of it.
        named: Kinds of limits, one of which the error has to name; none: it is out of reach.
    """

    robot: str
    kind: str
    size: float
    named: tuple[str, ...] = ()

    def __str__(self) -> str:
        return f"{self.robot}, {self.kind} {self.size:g}"


def carried_over(robot: rbd.Robot, ahead: float, up: float, **given: Any) -> None:
    """One foot is put down elsewhere."""
    stand, feet = robot.standing(), robot.feet()
    foot = feet[0]
    X = centre_of(stand, foot)
    place = X.translation + [ahead, 0.0, up]
    there = place if len(foot.corners) == 1 else pin.SE3(X.rotation, place)
    contacts = {f.name: True for f in feet} | {foot.name: [(0.0, 0.8), (1.6, 2.4)]}
    rbd.plan(robot, {0.0: stand, 2.4: {foot.name: there}}, contacts, progress=False, **given)


def too_high(robot: rbd.Robot, size: float) -> None:
    """A box of that height."""
    terrain = rbd.Terrain.boxes(((-1.0, -1.0, -1.0), (2.0, 1.0, 0.0)), ((0.25, -1.0, 0.0), (1.5, 1.0, size)))
    carried_over(robot, 0.35, size, ground=terrain)


def too_far(robot: rbd.Robot, size: float) -> None:
    """A gap of that width."""
    carried_over(robot, size, 0.0)


def too_heavy(robot: rbd.Robot, size: float) -> None:
    """That mass in one hand."""
    loaded = robot.carrying(rbd.Carried(size, ["gripper_left_base_link"]))
    on_feet(loaded, loaded.at(robot.standing().q))


def too_weak(robot: rbd.Robot, size: float) -> None:
    """That share of all torque limits."""
    on_feet(robot, robot.standing(), limits=size)


def on_feet(robot: rbd.Robot, stand: rbd.State, **given: Any) -> None:
    """Standing for a second."""
    rbd.plan(robot, {0.0: stand, 1.0: stand}, {foot.name: True for foot in robot.feet()}, progress=False, **given)


def too_steep(robot: rbd.Robot, size: float) -> None:
    """A slope whose tangent is that much larger than the coefficient of friction, 0.2."""
    angle = np.arctan(0.2 + size)
    slope = rbd.Ground(normal=(-np.sin(angle), 0.0, np.cos(angle)))
    feet = {foot.name: True for foot in robot.feet()}
    rbd.plan(robot, {0.0: {}, 1.0: {}}, feet, ground=slope, friction=0.2, progress=False)


def too_fast(robot: rbd.Robot, size: float) -> None:
    """That time to move by half of a sole, or 8 cm, and back."""
    stand = robot.standing()
    aside = {"com": stand.com + [0.08, 0.0, 0.0]}
    rbd.plan(robot, {0.0: stand, size: aside, 2.0 * size: stand}, {f.name: True for f in robot.feet()}, progress=False)


def unbalanced(robot: rbd.Robot, size: float) -> None:
    """Half of the feet are lifted at that time, and the centre of mass stays over the middle of all."""
    stand, feet = robot.standing(), [foot.name for foot in robot.feet()]
    left = {name: True if "left" in name.lower() or name.startswith(("FL", "RL")) else [(0.0, size)] for name in feet}
    rbd.plan(robot, {0.0: stand, 1.0: stand.q}, left, progress=False)


def too_long_a_flight(robot: rbd.Robot, size: float) -> None:
    """Nothing stands for that time, before which all stand for 0.4 s."""
    stand = robot.standing()
    stays = [(0.0, 0.4), (0.4 + size, 0.8 + size)]
    rbd.plan(robot, {0.0: stand, 0.8 + size: stand}, {foot.name: stays for foot in robot.feet()}, progress=False)


KINDS: dict[str, Callable[[rbd.Robot, float], None]] = {
    "box [m]": too_high, "gap [m]": too_far, "kg in a hand": too_heavy, "share of torques": too_weak, "slope": too_steep,
    "fast [s]": too_fast, "unbalanced [s]": unbalanced, "flight [s]": too_long_a_flight,
}  # fmt: skip
BALANCE = ("edge", "push", "base", "friction")
TASKS = [
    *(Task(name, "box [m]", h) for name, sizes in {"talos": (0.8, 0.9, 1.0, 1.3), "g1": (1.0, 1.3)}.items() for h in sizes),
    *(Task(name, "box [m]", h) for name in ("solo12", "go2") for h in (0.9, 1.2)),
    *(Task(name, "gap [m]", d) for name, sizes in {"talos": (1.6, 1.8, 2.0), "g1": (1.2, 1.6)}.items() for d in sizes),
    *(Task(name, "gap [m]", d) for name in ("solo12", "go2") for d in (0.5, 0.7, 0.9)),
    *(Task("talos", "kg in a hand", m, ("motor", *BALANCE)) for m in (40.0, 50.0, 60.0, 90.0)),
    *(Task(name, "share of torques", x, ("motor",)) for name in ("talos", "g1", "go2") for x in (0.02, 0.05, 0.08)),
    *(Task(name, "slope", x, ("friction",)) for name in ("solo12", "go2") for x in (0.05, 0.1, 0.15, 0.2)),
    *(Task(name, "fast [s]", T, ("motor", *BALANCE)) for name in ("talos", "g1") for T in (0.08, 0.12)),
    *(Task(name, "unbalanced [s]", 0.5, BALANCE) for name in ("talos", "g1")),
    *(Task(name, "flight [s]", T, ("motor", *BALANCE)) for name in ("solo12", "go2") for T in (0.9, 1.2)),
]
FEW = (
    "go2, gap [m] 0.7", "talos, kg in a hand 40", "g1, share of torques 0.05", "solo12, slope 0.1", "talos, unbalanced [s] 0.5",
)  # fmt: skip


def test_there_are_fifty():
    """Each of its own."""
    assert len(set(map(str, TASKS))) == len(TASKS) >= 50
    assert set(FEW) <= set(map(str, TASKS)) and {task.kind for task in TASKS} == set(KINDS)


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_it_is_refused_by_the_right_limits(task: Task, exhaustive: bool):
    """Out of reach with the nearest pose, or with limits that the task exceeds, and the certificate or the nearest plan."""
    if not exhaustive and str(task) not in FEW:
        pytest.skip("run by make exhaustive")
    with pytest.raises(RbdError) as caught:
        KINDS[task.kind](robot_of(task.robot), task.size)
    error = caught.value
    if not task.named:
        assert isinstance(error, CannotReach) and "out of reach" in str(error)
        assert error.q is not None and np.isfinite(error.q).all()
        return
    assert isinstance(error, CannotPlan | CannotMove)
    assert {limit.kind for limit in error.limits} & set(task.named)
    assert error.certificate is not None or error.plan is not None
    if task.kind == "slope":
        assert error.helps["friction"] == pytest.approx((0.2 + task.size) / 0.2, rel=0.01)
    if task.kind == "share of torques":  # at least what the task takes away is missing
        assert 1.0 < error.helps["torque"] < 1.0 / task.size
