"""Small models and starts for tests of smooth motion."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

import rbd
from rbd.model.checked_model import CheckedModel

URDF = Path(__file__).parents[2] / "urdf"


def bar(model: pin.Model, parent: int, name: str, at: float, mass: float, com: float, inertia: float) -> int:
    """A bar in the x-z plane that turns counter-clockwise as seen from -y, its mass `com` along it."""
    placement = pin.SE3(np.eye(3), np.array([at, 0.0, 0.0]))
    joint = model.addJoint(parent, pin.JointModelRevoluteUnaligned(np.array([0.0, -1.0, 0.0])), placement, name)
    spread = np.diag([0.0, inertia, inertia])
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.array([com, 0.0, 0.0]), spread), pin.SE3.Identity())
    return joint


def chain(links: int, *, mass: float = 1.0, com: float = 1.0, inertia: float = 0.0) -> CheckedModel:
    """Bars of 1 m in a row, hung from the world."""
    model, joint = pin.Model(), 0
    for i in range(links):
        joint = bar(model, joint, f"bar_{i}", 1.0 if i else 0.0, mass, com, inertia)
    return CheckedModel(model, name="chain")


def body(joint: pin.JointModel, inertia: pin.Inertia, gravity: tuple[float, float, float]) -> CheckedModel:
    """One body on one joint."""
    model = pin.Model()
    model.addJoint(0, joint, pin.SE3.Identity(), "joint")
    model.appendBodyToJoint(1, inertia, pin.SE3.Identity())
    model.addFrame(pin.Frame("body", 1, 0, pin.SE3.Identity(), pin.FrameType.OP_FRAME))
    model.gravity.linear = np.array(gravity)
    return CheckedModel(model, name="body", passive=["joint"])


def two_links(gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> CheckedModel:
    """A floating bar of 1 m and 1 kg with a second one hinged to its end, along y: nv = 7."""
    model, inertia = pin.Model(), pin.Inertia.FromBox(1.0, 1.0, 0.1, 0.1)
    middle, end = (pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])) for x in (0.5, 1.0))
    base = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "base")
    hinge = model.addJoint(base, pin.JointModelRY(), end, "hinge")
    for joint, name in ((base, "first"), (hinge, "second")):
        model.appendBodyToJoint(joint, inertia, middle)
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3.Identity(), pin.FrameType.BODY))
    model.gravity.linear = np.array(gravity)
    return CheckedModel(model, name="two links")


def along(state: rbd.State, constraints: object, drive: np.ndarray) -> rbd.State:
    """The state with the velocity nearest to `drive`, plainly, that the constraints allow."""
    rows = [c.rows(state) for c in constraints]  # type: ignore[attr-defined]
    J = np.vstack([r.J for r in rows])
    return rbd.State(state.robot, state.q, drive - np.linalg.pinv(J) @ (J @ drive))


def swinging(robot: rbd.Robot, posture: str, rate: float) -> rbd.State:
    """A mechanism of one freedom whose first joint turns at a rate."""
    state = robot.at(posture)
    J = np.vstack([c.rows(state).J for c in robot.loops()])
    _, _, Vt = np.linalg.svd(J)
    return rbd.State(robot, state.q, rate * Vt[-1] / Vt[-1][0])


def off(one: rbd.State, other: rbd.State) -> float:
    """How far two states are from each other, the largest entry of both differences."""
    model = one.robot.model
    return float(max(np.abs(pin.difference(model, one.q, other.q)).max(), np.abs(one.v - other.v).max()))


def bricard() -> CheckedModel:
    """Bricard's mechanism (A04 of the benchmark library): five square bars of 1 m, 0.1 m and 1 kg along edges of a cube.

    Each of its six hinges has the direction of the cube's third edge there. It moves, though it is counted rigid: the hinge
    between the frames "tip" and "pivot", along x, closes the ring with five rows of which four are independent.
    """
    x, y, z = np.eye(3)
    model, parent, at = pin.Model(), 0, np.zeros(3)
    for i, (along, axis) in enumerate(zip((x, y, z, -x, -y), (y, z, x, y, z), strict=True)):
        joint = pin.JointModelRevoluteUnaligned(axis)
        parent = model.addJoint(parent, joint, pin.SE3(np.eye(3), at), f"hinge_{i}")
        lengths = np.abs(along) + 0.1 * (1.0 - np.abs(along))
        spread = np.diag(lengths @ lengths - lengths**2) / 12.0
        model.appendBodyToJoint(parent, pin.Inertia(1.0, 0.5 * along, spread), pin.SE3.Identity())
        at = along
    for name, joint, place in (("tip", parent, at), ("pivot", 0, z)):
        model.addFrame(pin.Frame(name, joint, 0, pin.SE3(np.eye(3), place), pin.FrameType.OP_FRAME))
    return CheckedModel(model, name="bricard")
