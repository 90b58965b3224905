"""Small mechanisms made here, their lengths given, and their closed forms."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin

from rbd.constraints.loop import LoopClosure
from rbd.model.checked_model import CheckedModel

IDENTITY = pin.SE3.Identity()


def at(x: float, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    """A placement without a turn."""
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def bar(
    model: pin.Model, parent: int, placement: pin.SE3, name: str, length: float, joint: pin.JointModel | None = None
) -> int:
    """A uniform bar of 1 kg a metre on a hinge about z, with a frame "<name>_tip" at its end."""
    out = model.addJoint(parent, joint or pin.JointModelRZ(), placement, name)
    inertia = pin.Inertia(max(length, 1e-3), np.array([0.5 * length, 0.0, 0.0]), np.diag([1e-4, 1.0, 1.0]) * length**3 / 12.0)
    model.appendBodyToJoint(out, inertia, IDENTITY)
    model.addFrame(pin.Frame(f"{name}_tip", out, 0, at(length), pin.FrameType.OP_FRAME))
    return out


def checked(model: pin.Model, name: str) -> CheckedModel:
    """The model with no limits of position, as hinges that turn for ever."""
    model.lowerPositionLimit = np.full(model.nq, -np.inf)
    model.upperPositionLimit = np.full(model.nq, np.inf)
    return CheckedModel(model, name=name)


def four_bar(a: float, b: float, c: float, d: float, *, continuous: bool = False) -> tuple[CheckedModel, list[LoopClosure]]:
    """Crank a, coupler b on its tip, rocker c from (d, 0): the joints' angles are from the bar before, along the ground."""
    model = pin.Model()
    kind = pin.JointModelRUBZ if continuous else pin.JointModelRZ
    crank = bar(model, 0, IDENTITY, "crank", a, kind())
    bar(model, crank, at(a), "coupler", b, kind())
    bar(model, 0, at(d), "rocker", c, kind())
    return checked(model, "four bar"), [LoopClosure("loop", "coupler_tip", "rocker_tip", kind="planar")]


def four_bar_angles(a: float, b: float, c: float, d: float, crank: float) -> list[tuple[float, float]]:
    """(coupler, rocker) from the ground in (-pi, pi], both branches, coupler up first: where two circles meet."""
    tip = np.array([a * math.cos(crank), a * math.sin(crank)])
    way = np.array([d, 0.0]) - tip
    far = math.hypot(*way)
    along = (b * b - c * c + far * far) / (2.0 * far)
    across = math.sqrt(b * b - along * along)
    out = []
    for side in (1.0, -1.0):
        pin_at = tip + (along * way + side * across * np.array([-way[1], way[0]])) / far
        coupler, rocker = pin_at - tip, pin_at - np.array([d, 0.0])
        out.append((math.atan2(coupler[1], coupler[0]), math.atan2(rocker[1], rocker[0])))
    return out


def absolute(q: np.ndarray) -> np.ndarray:
    """(crank, coupler, rocker) from the ground, of a four-bar's q, in (-pi, pi]."""
    turned = np.array([q[0], q[0] + q[1], q[2]])
    return np.remainder(turned + math.pi, 2.0 * math.pi) - math.pi


def six_bar() -> tuple[CheckedModel, list[LoopClosure]]:
    """Watt's six-bar: a four-bar 1 / 3 / 2.5 / 3, and on its rocker's tip a dyad 2 / 2 to the ground at (6, 0)."""
    model = pin.Model()
    crank = bar(model, 0, IDENTITY, "crank", 1.0)
    bar(model, crank, at(1.0), "coupler", 3.0)
    rocker = bar(model, 0, at(3.0), "rocker", 2.5)
    bar(model, rocker, at(2.5), "link", 2.5)
    bar(model, 0, at(6.0), "output", 2.0)
    loops = [
        LoopClosure("first", "coupler_tip", "rocker_tip", kind="planar"),
        LoopClosure("second", "link_tip", "output_tip", kind="planar"),
    ]
    return checked(model, "six bar"), loops


def slider_crank(r: float, length: float) -> tuple[CheckedModel, list[LoopClosure]]:
    """Crank r, rod, slider along x: x = r cos t +- sqrt(l^2 - r^2 sin^2 t)."""
    model = pin.Model()
    crank = bar(model, 0, IDENTITY, "crank", r)
    bar(model, crank, at(r), "rod", length)
    slider = model.addJoint(0, pin.JointModelPX(), IDENTITY, "slider")
    model.appendBodyToJoint(slider, pin.Inertia(1.0, np.zeros(3), 0.1 * np.eye(3)), IDENTITY)
    model.addFrame(pin.Frame("slider_pin", slider, 0, IDENTITY, pin.FrameType.OP_FRAME))
    return checked(model, "slider crank"), [LoopClosure("loop", "rod_tip", "slider_pin", kind="planar")]
