"""Linkages to test with, built joint by joint: the lengths and axes are all there is to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

import rbd
from rbd.model.checked_model import CheckedModel

UNIT = pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3))


def at(x: float = 0.0, y: float = 0.0, z: float = 0.0, R: np.ndarray | None = None) -> pin.SE3:
    """A pose."""
    return pin.SE3(np.eye(3) if R is None else R, np.array([x, y, z], float))


def about(axis: str, angle: float) -> np.ndarray:
    """A rotation about x, y or z."""
    return np.asarray(pin.utils.rotate(axis, angle))


class Builder:
    """Joints and frames, added one by one."""

    def __init__(self, name: str = "linkage") -> None:
        self.model = pin.Model()
        self.model.name = name

    def joint(self, name: str, kind: object, placement: pin.SE3, parent: str | None = None) -> Builder:
        """A joint, on the body of another or on the ground."""
        j = self.model.addJoint(0 if parent is None else self.model.getJointId(parent), kind, placement, name)
        self.model.addJointFrame(j)
        self.model.appendBodyToJoint(j, UNIT, pin.SE3.Identity())
        return self

    def frame(self, name: str, parent: str | None, placement: pin.SE3) -> Builder:
        """A frame on a joint's body, or on the ground."""
        j = 0 if parent is None else self.model.getJointId(parent)
        self.model.addFrame(pin.Frame(name, j, 0, placement, pin.FrameType.OP_FRAME))
        return self

    def robot(self) -> CheckedModel:
        """The robot."""
        return CheckedModel(self.model)


def free(*kinds: object) -> CheckedModel:
    """Joints in a row without lengths, j0, j1, ..."""
    build = Builder("free")
    for i, kind in enumerate(kinds):
        build.joint(f"j{i}", kind, pin.SE3.Identity(), None if i == 0 else f"j{i - 1}")
    return build.robot()


def planar_chain(lengths: Sequence[float], ground: float) -> CheckedModel:
    """Bars in a plane from the origin, j0, j1, ...; frame "end" at the last one's tip, "pivot" on the ground at x = ground."""
    build = Builder(f"{len(lengths) + 1}-bar")
    for i, x in enumerate([0.0, *lengths[:-1]]):
        build.joint(f"j{i}", pin.JointModelRZ(), at(x), None if i == 0 else f"j{i - 1}")
    return build.frame("end", f"j{len(lengths) - 1}", at(lengths[-1])).frame("pivot", None, at(ground)).robot()


def pinned(kind: str = "planar") -> rbd.constraints.LoopClosure:
    """The closure of `planar_chain` and of the spatial loops."""
    return rbd.constraints.LoopClosure("pin", "pivot", "end", kind=kind)


def four_bar_pose(a: float, b: float, c: float, d: float, crank: float, elbow: float = 1.0) -> np.ndarray:
    """The q of `planar_chain((a, b, c), d)` at a crank angle, by the intersection of two circles; elbow +1 or -1."""
    A, D = a * np.array([np.cos(crank), np.sin(crank)]), np.array([d, 0.0])
    r = np.linalg.norm(D - A)
    along = (b * b - c * c + r * r) / (2.0 * r)
    e = (D - A) / r
    B = A + along * e + elbow * np.sqrt(b * b - along * along) * np.array([-e[1], e[0]])
    coupler, rocker = np.arctan2(*(B - A)[::-1]), np.arctan2(*(D - B)[::-1])
    return np.array([crank, coupler - crank, rocker - coupler])


def spatial_loop(links: Sequence[tuple[float, float]]) -> CheckedModel:
    """A closed chain of hinges about z: link i is a distance along x and a twist about x to the next hinge.

    The last link is the ground: "pivot" is where the last hinge stands on it.
    """
    build = Builder("loop")
    build.joint("j0", pin.JointModelRZ(), pin.SE3.Identity())
    for i, (length, twist) in enumerate(links[:-2]):
        build.joint(f"j{i + 1}", pin.JointModelRZ(), at(length) * at(R=about("x", twist)), f"j{i}")
    length, twist = links[-2]
    build.frame("end", f"j{len(links) - 2}", at(length) * at(R=about("x", twist)))
    length, twist = links[-1]
    return build.frame("pivot", None, (at(length) * at(R=about("x", twist))).inverse()).robot()


def bennett(a: float = 1.0, alpha: float = 0.6, b: float = 1.4) -> CheckedModel:
    """Bennett's four hinges in space: opposite links alike, a / sin(alpha) = b / sin(beta)."""
    beta = float(np.arcsin(b / a * np.sin(alpha)))
    return spatial_loop([(a, alpha), (b, beta), (a, alpha), (b, beta)])


def sarrus() -> tuple[CheckedModel, rbd.constraints.LoopClosure]:
    """Sarrus' linkage: a platform on two folding legs whose hinges are at right angles; it goes straight up and down."""
    build = Builder("sarrus")
    build.joint("x0", pin.JointModelRX(), at(0.0, 0.5, 0.0))
    build.joint("x1", pin.JointModelRX(), at(0.0, 1.0, 0.0), "x0")
    build.joint("x2", pin.JointModelRX(), at(0.0, 1.0, 0.0), "x1")
    build.joint("y0", pin.JointModelRY(), at(0.5, 0.0, 0.0))
    build.joint("y1", pin.JointModelRY(), at(1.0, 0.0, 0.0), "y0")
    build.frame("tip", "y1", at(1.0, 0.0, 0.0)).frame("edge", "x2", at(0.5, -0.5, 0.0))
    return build.robot(), rbd.constraints.LoopClosure("hinge", "edge", "tip", kind="revolute", axis=(0, 1, 0))


def sarrus_pose(fold: float) -> np.ndarray:
    """The q of `sarrus` with its legs raised by an angle."""
    return np.array([fold, np.pi - 2.0 * fold, fold - np.pi, -fold, 2.0 * fold - np.pi])


def closed(robot: CheckedModel, constraints: Sequence[object], q: np.ndarray) -> rbd.State:
    """The state at a configuration brought onto the constraints."""
    held = rbd.constraints.manifold.ConstraintManifold(rbd.State(robot, q), constraints)
    found = held.project(q)
    assert np.abs(found.error).max(initial=0.0) < 1e-13
    return rbd.State(robot, found.q)
