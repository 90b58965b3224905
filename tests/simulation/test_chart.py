"""Charts about a configuration: the rate of their coordinates is the one that makes the motion."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from rbd.model.chart import Charts
from rbd.model.checked_model import CheckedModel

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
