"""Plans on pages and strips: forces balance the motion, contacts have lanes, what is not certified shows what is missing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import CannotPlan
from rbd.planning import Plan
from rbd.simulation.simulated_motion import OPEN, STICKS
from rbd.visual.playback.plan_motion import UNCERTIFIED, shown_plan
from rbd.visual.playback.report_motion import MOMENT_ARM


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def lifted(solo: rbd.Robot) -> Plan:
    """One foot, by 5 cm."""
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    there = solo.feet()[0].points(stand).positions[0] + [0.05, 0.0, 0.0]
    return rbd.plan(
        solo, {0.0: stand, 2.0: {"front_left": there}}, feet | {"front_left": [(0.0, 0.5), (1.0, 2.0)]}, progress=False
    )


@pytest.fixture(scope="module")
def hasty(solo: rbd.Robot) -> Plan:
    """Of a plan that is none."""
    stand, feet = solo.standing(), {foot.name: True for foot in solo.feet()}
    with pytest.raises(CannotPlan) as caught:
        rbd.plan(
            solo, {0.0: stand, 0.12: {"com": stand.com + [0.1, 0.0, 0.0]}, 0.24: stand}, feet, friction=0.2, progress=False
        )
    plan: Plan = caught.value.plan
    return plan


def wrench(plan: Plan) -> np.ndarray:
    """What the motion needs about its centre of mass, by Pinocchio's centroidal momentum, shape (n, 6)."""
    robot, out = plan.robot, []
    data = robot.model.createData()
    for q, v, a in zip(plan.q, plan.v, plan.a, strict=True):
        rate = pin.computeCentroidalMomentumTimeVariation(robot.model, data, q, v, a).vector
        out.append(rate - np.concatenate([robot.mass * robot.gravity, np.zeros(3)]))
    return np.array(out)


def test_shown_forces_balance_the_motion(lifted: Plan):
    """About the centre of mass, where contacts stand as they are drawn, up to what lines between two ends leave."""
    shown, (start, end) = shown_plan(lifted), (0.5, 1.0)
    com = np.array([lifted.state(t).com for t in lifted.t])
    points, forces = (np.concatenate(list(x.values()), axis=1) for x in (shown.points, shown.point_forces))
    arm = np.nan_to_num(points - com[:, None])
    given = np.concatenate([forces.sum(axis=1), np.cross(arm, forces).sum(axis=1)], axis=1)
    assert given == pytest.approx(wrench(lifted), abs=0.01 * lifted.robot.mass * 9.81)
    stands = np.array(shown.modes["front_left"])
    inner = (lifted.t > start + 0.03) & (lifted.t < end - 0.03)
    assert set(stands[inner]) == {OPEN} and set(stands[(lifted.t < start - 0.03) | (lifted.t > end + 0.03)]) == {STICKS}
    assert np.isnan(shown.points["front_left"][inner]).all() and not shown.point_forces["front_left"][inner].any()
    assert not shown.pushes and UNCERTIFIED not in shown.modes
    assert [(e.name, e.kind) for e in shown.events] == [("front_left", "leaves"), ("front_left", "touches")]


def test_what_is_not_proved_is_shown_with_what_is_missing(hasty: Plan):
    """A lane of its own, and the wrench that contacts do not give there; nothing elsewhere."""
    shown = shown_plan(hasty)
    bad = np.array(shown.modes[UNCERTIFIED]) != OPEN
    x = hasty.intervals
    times = [hasty.t[(hasty.t >= a) & (hasty.t < b)] for a, b in zip(x.start[~x.sure], x.end[~x.sure], strict=True)]
    assert set(hasty.t[bad][:-1]) <= set(np.concatenate(times)) and bad.any()
    force, moment = shown.pushes
    forces = np.concatenate(list(shown.point_forces.values()), axis=1)
    assert force.forces[bad, 0] == pytest.approx((wrench(hasty)[:, :3] - forces.sum(axis=1))[bad], abs=1e-6)
    assert not force.forces[~bad].any() and not moment.forces[~bad].any()
    arm = np.nan_to_num(np.concatenate(list(shown.points.values()), axis=1) - force.points)
    turned = MOMENT_ARM * moment.forces[:, 0] + np.cross(arm, forces).sum(axis=1)
    assert turned[bad] == pytest.approx(wrench(hasty)[bad, 3:], abs=1e-6)
    assert "certified in" in shown.title


def test_pages_are_written(lifted: Plan, hasty: Plan, tmp_path: Path):
    """With lanes of contacts, charts of forces, and what is not certified."""
    good, bad = (rbd.visual.export_motion(plan, tmp_path / f"{i}.html").read_text() for i, plan in enumerate((lifted, hasty)))
    assert "front_left" in good and "contact forces, N" in good and UNCERTIFIED not in good
    assert UNCERTIFIED in bad and "missing force" in bad
