"""Charts about a configuration: the rate of their coordinates is the one that makes the motion."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from rbd.model.checked_model import CheckedModel
from rbd.model.derivatives import Charts

EPS = 1e-6
JOINTS = {
    "slider": pin.JointModelPX(),
    "circle": pin.JointModelRUBZ(),
    "sphere": pin.JointModelSpherical(),
    "plane": pin.JointModelPlanar(),
    "space": pin.JointModelFreeFlyer(),
}


@pytest.mark.parametrize("size", [0.3, 0.9, 1.1, 2.5, 4.0])
@pytest.mark.parametrize("joints", [tuple(JOINTS), ("slider", "circle")], ids=["every kind", "none that turns in space"])
def test_the_rate_moves_the_configuration_as_the_velocity_does(joints: tuple[str, ...], size: float):
    """Q0 (+) (xi + e xi') is (q0 (+) xi) (+) e v, near, beyond 1 rad, where T itself is inverted, and beyond half a turn."""
    model, at = pin.Model(), 0
    for name in joints:
        at = model.addJoint(at, JOINTS[name], pin.SE3.Random(), name)
        model.appendBodyToJoint(at, pin.Inertia.Random(), pin.SE3.Identity())
    robot, rng = CheckedModel(model, name="chain"), np.random.default_rng(3)
    q0 = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv))
    chart = Charts(robot).at(q0)
    for _ in range(5):
        xi, v = rng.normal(size=model.nv), rng.normal(size=model.nv)
        xi *= size / np.abs(xi).max()
        rate = chart.rate(xi, v)
        ahead, behind = (pin.integrate(model, chart.q(xi), side * EPS * v) for side in (1.0, -1.0))
        moved = pin.difference(model, behind, ahead) / (2.0 * EPS)
        along = pin.difference(model, chart.q(xi - EPS * rate), chart.q(xi + EPS * rate)) / (2.0 * EPS)
        assert np.abs(along - moved).max() < 1e-8 * max(1.0, np.abs(rate).max())
        if joints == ("slider", "circle"):
            assert np.array_equal(rate, v)


def bracket(xi: np.ndarray) -> np.ndarray:
    """Of poses, linear then angular, shape (6, 6)."""
    V, W = pin.skew(xi[:3]), pin.skew(xi[3:])
    return np.block([[W, V], [np.zeros((3, 3)), W]])


@pytest.mark.parametrize("size", [1e-6, 1e-4, 1e-3, 1e-2, 0.3, 0.99])
@pytest.mark.parametrize(("kind", "rows"), [("space", [0, 1, 2, 3, 4, 5]), ("plane", [0, 1, 5]), ("sphere", [3, 4, 5])])
def test_the_rate_is_exact_near_the_middle_of_a_chart(kind: str, rows: list[int], size: float):
    """T xi' = v to rounding, T by its power series; Pinocchio's Jacobians are off by 1e-9 around 1e-3."""
    model, rng = pin.Model(), np.random.default_rng(1)
    joint = model.addJoint(0, JOINTS[kind], pin.SE3.Identity(), kind)
    model.appendBodyToJoint(joint, pin.Inertia.Random(), pin.SE3.Identity())
    chart = Charts(CheckedModel(model, name=kind)).at(pin.neutral(model))
    for _ in range(20):
        xi, v, whole = size * rng.uniform(-1.0, 1.0, model.nv), rng.uniform(-1.0, 1.0, model.nv), np.zeros(6)
        if kind != "sphere":
            xi[: 2 if kind == "plane" else 3] *= 3.0  # a long way, with a small turn
        whole[rows] = xi
        T, term = np.eye(6), np.eye(6)
        for k in range(1, 40):
            term = -term @ bracket(whole) / (k + 1)
            T += term
        assert np.abs(T[np.ix_(rows, rows)] @ chart.rate(xi, v) - v).max() < 1e-14
