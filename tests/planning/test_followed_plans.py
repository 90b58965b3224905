"""Plans with flights, followed: they land, early and late, and stand at the end."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hops import END, LAND, LIFT, hop_of

import rbd
from rbd.model.state import state_at
from rbd.planning import Plan
from rbd.planning.certificate import FALLS
from rbd.planning.stays import centre_of


@pytest.fixture(scope="module", params=["solo12", "go2"])
def hop(request: pytest.FixtureRequest) -> Plan:
    """Nothing stands from 0.4 to 0.7 s; the centre of mass rises by 11 cm."""
    return hop_of(rbd.load_robot(request.param))


def followed(plan: Plan, start: float = 0.0, ground: float = 0.0) -> tuple[rbd.control.ControlLog, rbd.Trajectory]:
    """From a time of the plan on, over a floor at a height, to half a second after its end."""
    controller, state = rbd.control.follow(plan), plan.state(start)
    run = rbd.simulate(
        state_at(plan.robot, state.q, state.v, start), plan.robot.feet(friction=0.6, on=ground),
        duration=END + 0.5 - start, step=1e-3, controller=controller, progress=False,
    )  # fmt: skip
    return controller.log, run


def test_a_hop_is_followed_to_its_end(hop: Plan):
    """No violated step; it lands where it is to, within 5 mm of the plan at all times, and stands as planned."""
    log, run = followed(hop)
    assert log.violations == 0
    off = [np.abs(run.com[i] - hop.state(min(run.t[i], END)).com).max() for i in range(0, len(run.t), 20)]
    assert max(off) < 5e-3
    assert run.com[-1] == pytest.approx(hop.state(END).com, abs=1e-4)
    for foot in hop.robot.feet():
        assert np.linalg.norm(centre_of(run.state(-1), foot).translation - centre_of(hop.state(END), foot).translation) < 1e-3


@pytest.mark.parametrize("ground", [-0.02, 0.02])
def test_a_hop_lands_early_and_late(hop: Plan, ground: float):
    """From the top of its flight onto a floor 2 cm higher or lower than planned: feet touch when they fall onto it.

    A step of control is taken then, between those that are 4 ms apart.
    """
    log, run = followed(hop, 0.55, ground)
    assert log.violations == 0
    feet = hop.robot.feet(on=ground)
    touched = next(t for i, t in enumerate(run.t) if min(foot.points(run.state(i)).gaps[0] for foot in feet) < 1e-5)
    speed = 9.81 * 0.5 * (LAND - LIFT)
    assert abs(touched - (LAND - ground / speed)) < 0.02 and (touched < LAND) == (ground > 0.0)
    between = [t for t in log.t[1:] if abs(t / 4e-3 - round(t / 4e-3)) > 1e-6]
    assert between and all(-1e-9 <= t - touched < 6e-3 for t in between)
    gaps = [foot.points(run.state(-1)).gaps[0] for foot in feet]
    assert np.abs(gaps).max() < 1e-4 and np.abs(run.v[-1]).max() < 0.02


def test_a_humanoid_hops():
    """G1 rises by 11 cm, its soles by 7: certified; torques alone hold its feet; it lands and stands, nothing violated."""
    g1 = rbd.load_robot("g1")
    stand = g1.standing()
    low, off = ({"com": stand.com - [0.0, 0.0, by]} for by in (0.10, 0.06))
    keys = {0.0: stand, 0.4: low, 0.6: off, 0.9: off, 1.1: low, 1.5: stand}
    plan = rbd.plan(g1, keys, {foot.name: [(0.0, 0.6), (0.9, 1.5)] for foot in g1.feet()}, progress=False)
    assert plan.certified and plan.missing < FALLS and plan.torque_use < 1.0
    assert plan.state(0.75).com[2] - plan.state(0.6).com[2] == pytest.approx(9.81 * 0.3**2 / 8.0, abs=2e-3 * 9.81 * 0.3**2)
    soles = g1.feet(friction=0.6, on=0.0)
    assert min(sole.points(plan.state(0.75)).gaps.min() for sole in soles) > 0.07
    assert rbd.check_motion(plan.motion).share_possible == 1.0
    run = rbd.simulate(plan.state(0.0), soles, duration=0.5, step=1e-3, controller=plan.schedule, progress=False)
    for sole in soles:
        assert np.linalg.norm(centre_of(run.state(-1), sole).translation - centre_of(plan.state(0.0), sole).translation) < 1e-4
    controller = rbd.control.follow(plan)
    run = rbd.simulate(plan.state(0.0), soles, duration=2.0, step=1e-3, controller=controller, progress=False)
    assert controller.log.violations == 0
    assert run.com[-1] == pytest.approx(plan.state(1.5).com, abs=1e-4)


def test_a_humanoid_gets_up_from_one_knee(exhaustive: bool):
    """G1 from its right knee and toes and its left sole to standing: certified, 0.1 mm by torques alone; and followed."""
    g1 = rbd.load_robot("g1")
    stand = g1.standing()
    left, right = g1.feet(friction=0.6, on=0.0)
    knee = rbd.PointContact("right_knee", "right_knee_link", offset=(0.063, -0.01, 0.01), friction=0.6, on=0.0)
    toes = rbd.PointContact("right_toes", right.frame, offset=(0.12, 0.0, -0.035), friction=0.6, on=0.0)
    tips = [rbd.PointContact(f"tip_{y}", right.frame, offset=(0.12, y, -0.035), on=0.0) for y in (-0.03, 0.03)]
    planted, landed = centre_of(stand, left), centre_of(stand, right)
    folded = stand.with_joints({
        "left_hip_pitch_joint": -1.6, "left_knee_joint": 1.5, "left_ankle_pitch_joint": -0.1, "right_hip_pitch_joint": 0.1,
        "right_knee_joint": 1.5, "right_ankle_pitch_joint": -0.8,
    })  # fmt: skip
    near = pin.integrate(g1.model, folded.q, np.r_[-0.28, 0.0, -0.33, np.zeros(g1.nv - 3)])
    place = planted.translation - [0.28, 0.2365, 0.0]
    kneels = rbd.find_pose(g1, {"left_sole": planted, knee: place} | dict.fromkeys(tips), posture=near, com=(-0.08, 0.03)).state
    there = {"left_sole": planted, knee: place, right.frame: kneels.frame(right.frame).X_WF}
    over = rbd.find_pose(g1, there, posture=kneels, com=(0.0, 0.1, 0.4)).state
    swung = pin.SE3(pin.utils.rotate("y", 0.8), landed.translation + [-0.28, 0.0, 0.08])
    swings = rbd.find_pose(g1, {"left_sole": planted, right: swung}, posture=over, com=(0.02, 0.105)).state
    rises = {"left_sole": planted, "right_sole": landed, "com": stand.com + [0.0, 0.06, -0.08]}
    keys = {0.0: kneels, 1.4: over, 2.0: swings, 2.8: rises, 3.8: stand}
    stays = {"left_sole": True, "right_sole": [(2.8, 3.8)], knee: [(0.0, 1.6)], toes: [(0.0, 1.6)]}
    plan = rbd.plan(g1, keys, stays, progress=False)
    assert plan.certified and plan.forces(0.5)["right_knee"][0, 2] > 30.0
    assert stand.com[2] - kneels.com[2] > 0.2
    assert rbd.check_motion(plan.motion).share_possible == 1.0
    contacts = plan.contacts.standing(0.0)
    run = rbd.simulate(plan.state(0.0), contacts, duration=0.5, step=1e-3, controller=plan.schedule, progress=False)
    for contact in contacts:
        assert np.linalg.norm(centre_of(run.state(-1), contact).translation - centre_of(kneels, contact).translation) < 1e-4
    if not exhaustive:
        return
    controller = rbd.control.follow(plan)
    run = rbd.simulate(
        plan.state(0.0), [left, right, knee], duration=4.2, step=2e-3, controller=controller, progress=False
    )  # fmt: skip
    assert controller.log.violations == 0
    assert run.com[-1] == pytest.approx(plan.state(3.8).com, abs=1e-4)
