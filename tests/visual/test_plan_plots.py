"""Plots of plans: forces that carry the weight, what is used of limits, contacts, and what is not certified."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import rbd
from rbd.errors import CannotPlan, InputError
from rbd.planning import Plan


@pytest.fixture(scope="module")
def robot() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def plan(robot: rbd.Robot) -> Plan:
    stand = robot.standing()
    feet = {foot.name: True for foot in robot.feet()}
    return rbd.plan(robot, {0.0: stand, 0.4: {"com": stand.com - [0.0, 0.0, 0.02]}, 0.8: stand}, feet, progress=False)


def test_curves_of_forces_carry_the_weight(plan: Plan, robot: rbd.Robot):
    """The four of the first panel add up to mass times vertical acceleration and the weight."""
    artists = plan.plot()
    forces, used, bars = artists[0].figure.axes
    curves = [line for line in forces.get_lines() if line.get_label() in plan.forces(0.0)]
    assert len(curves) == 4
    total = np.sum([curve.get_ydata() for curve in curves], axis=0)
    for i, t in ((0, 0.0), (-1, 0.8)):
        A, bias, mass = plan.state(t).centroidal()
        pushed = (A[:3] @ plan.acceleration(t) + bias[:3])[2] + 9.81 * mass
        assert total[i] == pytest.approx(pushed, rel=1e-4)  # 9.80665 m/s2 is 3e-5 off
    assert {"friction", "torques"} <= {line.get_label() for line in used.get_lines()}
    assert [label.get_text() for label in bars.get_yticklabels()] == [contact.name for contact in plan.contacts.contacts]


def test_what_is_not_proved_is_a_band(robot: rbd.Robot):
    """In every panel, over the instants that the error names; and none of a plan that is certified."""
    stand, feet = robot.standing(), {foot.name: True for foot in robot.feet()}
    far = {"com": stand.com + [0.1, 0.0, 0.0]}
    with pytest.raises(CannotPlan) as caught:
        rbd.plan(robot, {0.0: stand, 0.12: far, 0.24: stand}, feet, friction=0.2, progress=False)
    axes = caught.value.plan.plot()[0].figure.axes
    bands = [[patch.get_x() for patch in ax.patches if patch.get_facecolor()[3] == 0.25] for ax in axes]
    assert bands[0] and bands[0] == bands[1] == bands[2]
    assert min(bands[0]) == pytest.approx(min(caught.value.t))


def test_axes_and_plans_that_are_none(plan: Plan):
    """Four axes; what is no plan."""
    with pytest.raises(InputError, match="one to 3"):
        rbd.visual.plot_plan(list(Figure().subplots(4)), plan)
    with pytest.raises(InputError, match="plan"):
        rbd.visual.plot_plan(None, 3)
