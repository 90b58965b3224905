"""Users' own rows: a rattleback by functions of q. Growth: a chain of 200 links without contact. Run by `make bench`."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from bench_timing import Row, interleaved, once

import rbd
from rbd.model.checked_model import CheckedModel

Array = np.ndarray
HALF_AXES = np.array([0.1, 0.02, 0.015])
"""Of its ellipsoid [m]."""
OBLIQUE = 0.1
"""Angle between its longest axis and that of its inertia [rad]."""
SPIN, DURATION, STEP = -3.0, 3.0, 1e-3
MARK_S = 3.0
LINKS, CHAIN_MARK = 200, 3.0
DRAWS, STEPS = 40, 40


def turned(q: Array) -> Array:
    """R of the base, shape (3, 3), or (3, 3, k) of columns of q."""
    x, y, z, w = q[3], q[4], q[5], q[6]
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def lowest(R: Array) -> tuple[Array, Array]:
    """(p, depth): the lowest point of the ellipsoid from its centre, in its axes, and how much it is below."""
    a, b, c = HALF_AXES**2
    x, y, z = R[2]
    depth = np.sqrt(a * x * x + b * y * y + c * z * z)
    return np.array([-a * x / depth, -b * y / depth, -c * z / depth]), depth


def height(q: Array) -> Array:
    """Of the lowest point above the floor [m]."""
    return q[2] - lowest(turned(q))[1]


def slip(q: Array) -> Array:
    """A(q) of the velocity of the point that touches, along the floor, shape (2, 6), or (2, 6, k) of columns of q."""
    R = turned(q)
    (x, y, z), _ = lowest(R)
    turns = [R[:2, 2] * y - R[:2, 1] * z, R[:2, 0] * z - R[:2, 2] * x, R[:2, 1] * x - R[:2, 0] * y]
    return np.stack([R[:2, 0], R[:2, 1], R[:2, 2], *turns], axis=1)


def rattleback() -> tuple[rbd.State, list[rbd.FunctionConstraint | rbd.VelocityConstraint]]:
    """An ellipsoid whose inertia is turned about the vertical, spun against its sense; rolling by rows of its own."""
    model = pin.Model()
    joint = model.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    oblique = pin.SE3(pin.rpy.rpyToMatrix(0.0, 0.0, OBLIQUE), np.zeros(3))
    body = pin.Inertia.FromBox(0.1, *(2.0 * HALF_AXES))
    model.appendBodyToJoint(joint, oblique.act(body), pin.SE3.Identity())
    model.addBodyFrame("rattleback", joint, pin.SE3.Identity(), 0)
    robot = CheckedModel(model, name="rattleback")
    q = np.array([0.0, 0.0, 0.0, *pin.Quaternion(pin.rpy.rpyToMatrix(0.02, 0.01, 0.0)).coeffs()])
    q[2] = -height(q)
    omega = turned(q).T @ [0.0, 0.0, SPIN]
    v = np.concatenate([-np.cross(omega, lowest(turned(q))[0]), omega])
    return rbd.State(robot, q, v), [rbd.FunctionConstraint("touches", height), rbd.VelocityConstraint("rolls", slip)]


def rolled(duration: float = DURATION) -> rbd.Trajectory:
    """Its motion."""
    state, rows = rattleback()
    return rbd.simulate(state, rows, duration=duration, step=STEP, progress=False)


def chain(links: int = LINKS) -> CheckedModel:
    """Links of 0.1 m and 1 kg from a ceiling, by hinges about x and y in turn."""
    model, joint = pin.Model(), 0
    for i in range(links):
        below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1 if i else 0.0]))
        joint = model.addJoint(joint, pin.JointModelRY() if i % 2 else pin.JointModelRX(), below, f"hinge_{i}")
        middle = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.05]))
        model.appendBodyToJoint(joint, pin.Inertia.FromBox(1.0, 0.02, 0.02, 0.1), middle)
        model.addBodyFrame(f"link_{i}", joint, pin.SE3.Identity(), 0)
    return CheckedModel(model, name=f"chain of {links}")


def chain_rows() -> list[Row]:
    """`rbd.solve` and steps of a chain that swings, in calls of Pinocchio's `aba`."""
    robot = chain()
    data, rng = robot.model.createData(), np.random.default_rng(3)
    states = [(0.3 * rng.normal(size=robot.nv), 0.1 * rng.normal(size=robot.nv)) for _ in range(DRAWS)]
    tau, start = np.zeros(robot.nu), rbd.State(robot, np.zeros(robot.nq), 0.1 * rng.normal(size=robot.nv))

    def stepping(integrator: rbd.TimeStepping | rbd.RungeKutta4) -> rbd.Trajectory:
        return rbd.simulate(start, (), duration=STEPS * STEP, step=STEP, integrator=integrator, progress=False)

    found = interleaved(
        {
            "aba": lambda i: pin.aba(robot.model, data, *states[i], np.zeros(robot.nv)),
            "solve": lambda i: rbd.solve(rbd.State(robot, *states[i]), tau, ()),
        },
        draws=DRAWS,
        turn=10,
    )
    what = f"a chain of {LINKS} links without contact"
    rows = [Row(f"{what}, rbd.solve", {"": found["solve"] / found["aba"]}, "x aba", (CHAIN_MARK,))]
    for integrator in (rbd.TimeStepping(), rbd.RungeKutta4()):
        seconds = min(once(lambda by=integrator: stepping(by)) for _ in range(3)) / STEPS
        rows.append(Row(f"{what}, a step of {type(integrator).__name__}", {"": seconds / found["aba"]}, "x aba"))
    return rows


def own_rows() -> list[Row]:
    """The rattleback's motion on the clock of the processor, and the chain."""
    rolled(0.02)
    seconds = min(once(lambda: rolled(0.1 * DURATION)) for _ in range(3)) * 10.0
    what = f"a rattleback by own rows, {DURATION:g} s by steps of {1e3 * STEP:g} ms, RungeKutta4"
    return [Row(what, {"": seconds}, "s", (MARK_S,)), *chain_rows()]
