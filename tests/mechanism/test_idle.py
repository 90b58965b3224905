"""Links between two balls: their spin is reported and left at rest, and all else is as if they were rods."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from linkages import Builder, about, at
from states import at_neutral

import rbd
from rbd.mechanism import acceleration_partition, assemble, branches, mobility, trace, velocity_partition
from rbd.model.checked_model import CheckedModel

CRANK, COUPLER, ROCKER = 0.3, 1.1, 0.6
POST = at(0.9, 0.4, 0.1, about("x", 0.7))
"""The rocker's hinge on the ground."""


def rssr(cut: str) -> tuple[CheckedModel, rbd.LoopClosure]:
    """Crank and rocker about skew axes; between their tips a rod, or a link between balls, with the loop cut somewhere."""
    build = Builder("RSSR").joint("crank", pin.JointModelRZ(), at()).frame("crank_tip", "crank", at(CRANK))
    if cut == "rod":
        build.joint("rocker", pin.JointModelRZ(), POST).frame("rocker_tip", "rocker", at(ROCKER))
        return build.robot(), rbd.LoopClosure("rod", "crank_tip", "rocker_tip", kind="rod", length=COUPLER)
    build.joint("coupler", pin.JointModelSpherical(), at(CRANK), "crank")
    build.frame("coupler_tip", "coupler", at(COUPLER))
    if cut == "hinge":
        build.joint("rocker", pin.JointModelSpherical(), at(COUPLER), "coupler").frame("pivot", "rocker", at(-ROCKER))
        build.frame("post", None, POST)
        return build.robot(), rbd.LoopClosure("hinge", "post", "pivot", kind="revolute")
    build.joint("rocker", pin.JointModelRZ(), POST).frame("rocker_tip", "rocker", at(ROCKER))
    return build.robot(), rbd.LoopClosure("ball", "coupler_tip", "rocker_tip")


def rocker_angle(robot: CheckedModel, q: np.ndarray) -> float:
    """Of the rocker about its hinge, whatever the joints of the tree are."""
    joint = robot.model.getJointId("rocker")
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    turn = POST.rotation.T @ data.oMi[joint].rotation
    return float(np.arctan2(turn[1, 0], turn[0, 0]))


@pytest.mark.parametrize("cut", ["ball", "hinge"])
def test_branches_of_an_rssr_are_those_of_its_rod(cut):
    """Two for a crank angle; with the link between balls they are found too, and its spin is named."""
    rod, link = rssr("rod"), rssr(cut)
    expected = branches(at_neutral(rod[0]), [rod[1]], fixed={"crank": 0.4}, tries=40)
    found = branches(at_neutral(link[0]), [link[1]], fixed={"crank": 0.4}, tries=40)
    assert found.idle == ("coupler",) and "idle: coupler turns by itself" in str(found)
    assert expected.idle == () and len(found) == len(expected) == 2
    angles = [sorted(rocker_angle(robot, b.q) for b in each.found) for (robot, _), each in ((rod, expected), (link, found))]
    assert angles[0] == pytest.approx(angles[1], abs=1e-9)
    assert not any(b.singular for b in found.found)


def closed(robot: CheckedModel, loop: rbd.LoopClosure, crank: float = 0.4) -> rbd.State:
    """The branch with the larger angle of the rocker, from a pose that `branches` finds."""
    found = branches(at_neutral(robot), [loop], fixed={"crank": crank}, tries=20)
    return rbd.State(robot, max(found.q, key=lambda q: rocker_angle(robot, q)))


@pytest.mark.parametrize("cut", ["ball", "hinge"])
def test_a_trace_of_an_rssr_is_that_of_its_rod(cut):
    """Over a turn of the crank, the rocker as with the rod; the coupler's spin is named and stays at rest."""
    rod, link = rssr("rod"), rssr(cut)
    expected, found = (
        trace(closed(*each), [each[1]], joint="crank", values=(0.4, 0.4 + 2.0 * np.pi), steps=24) for each in (rod, link)
    )
    assert expected.complete and found.complete and expected.idle == () and found.idle == ("coupler",)
    angles = [[rocker_angle(robot, q) for q in path.q] for (robot, _), path in ((rod, expected), (link, found))]
    assert np.abs(np.subtract(*angles)).max() < 1e-9
    assert found.sigma_min.min() > 1e-2 and not found.crossings
    assert "idle, left at rest: coupler turns by itself" in str(found)


@pytest.mark.parametrize("cut", ["ball", "hinge"])
def test_rates_and_accelerations_of_an_rssr_are_those_of_its_rod(cut):
    """Of the rocker; the spin of the coupler along its line is zero in the rate."""
    rates, turns = [], []
    for robot, loop in (rssr("rod"), rssr(cut)):
        state = closed(robot, loop)
        found = velocity_partition(state, [loop], {"crank": 2.0})
        assert found.residual < 1e-12 and np.isfinite(found.condition)
        moving = state.with_velocity(found.v)
        a = acceleration_partition(moving, [loop], {"crank": 0.7})
        data = robot.model.createData()
        pin.forwardKinematics(robot.model, data, moving.q, moving.v, a.a)
        joint = robot.model.getJointId("rocker")
        world = [data.oMi[joint].rotation @ x.angular for x in (data.v[joint], data.a[joint])]
        rates.append([POST.rotation[:, 2] @ w for w in world])
        turns.append((found, a))
    assert rates[0] == pytest.approx(rates[1], rel=1e-10, abs=1e-11)
    found, a = turns[1]
    assert found.idle == a.idle == ("coupler",) and "idle, left at rest: coupler" in str(found)
    if cut == "ball":
        assert abs(found.v[1]) < 1e-12  # about x, the coupler's line, from the crank


def test_the_mobility_of_an_rssr():
    """6 (4 - 1 - 4) + 1 + 3 + 3 + 1 = 2 with the link's spin, one with the rod, whose count is 6 (3 - 1 - 3) + 1 + 1 + 5."""
    for cut, freedoms in (("rod", 1), ("ball", 2), ("hinge", 2)):
        robot, loop = rssr(cut)
        found = mobility(closed(robot, loop), [loop])
        assert (found.count.value, found.finite) == (freedoms, freedoms)


def test_a_leg_of_two_bodies_turns_as_one():
    """A ball, a cylinder with a piston, a ball at a lever: both parts of the leg turn about its line."""
    build = (
        Builder("leg")
        .joint("cylinder", pin.JointModelSpherical(), at(0.5))
        .joint("piston", pin.JointModelPX(), at(0.3), "cylinder")
    )
    build.frame("rod_end", "piston", at(0.2)).joint("lever", pin.JointModelRZ(), at()).frame("lever_end", "lever", at(0.0, 0.8))
    robot, loop = build.robot(), rbd.LoopClosure("ball", "rod_end", "lever_end")
    found = branches(at_neutral(robot), [loop], fixed={"lever": 0.3}, tries=20)
    # The piston behind its ball or before it is one pose of the lever, and two of the leg.
    assert found.idle == ("cylinder",) and len(found) == 2
    state = rbd.State(robot, found.q[0])
    assert velocity_partition(state, [loop], {"lever": 1.0}).rates["piston"] != 0.0


def test_what_is_no_idle_freedom_is_refused_as_before():
    """A body on one ball, a five-bar with one rate, a link held by rods: their freedoms are their motion."""
    build = (
        Builder("dangling").joint("crank", pin.JointModelRZ(), at()).joint("bob", pin.JointModelSpherical(), at(1.0), "crank")
    )
    robot = build.frame("tip", "crank", at(1.0)).frame("post", None, at(2.0)).robot()
    rod = rbd.LoopClosure("rod", "tip", "post", kind="rod", length=1.5)
    with pytest.raises(rbd.InputError, match="can still move: 3 degrees of freedom"):
        branches(at_neutral(robot), [rod], tries=5)
    build = Builder("held").joint("arm", pin.JointModelRZ(), at()).joint("link", pin.JointModelSpherical(), at(0.4), "arm")
    build.frame("one", "link", at(1.0, 0.2)).frame("two", "link", at(1.0, -0.2, 0.3)).frame("post", None, at(1.0, 1.0, 0.5))
    robot = build.frame("side", None, at(1.2, -1.0, 0.4)).robot()
    rods = [rbd.LoopClosure(f"rod {a}", a, b, kind="rod", length=1.0) for a, b in (("one", "post"), ("two", "side"))]
    with pytest.raises(rbd.InputError, match="can still move: 1 degree of freedom left with 'arm' fixed"):
        branches(at_neutral(robot), rods, fixed={"arm": 0.1}, tries=5)
    with pytest.raises(rbd.InputError, match="2 degrees of freedom and 1 known rate"):
        velocity_partition(rbd.State(robot, assemble(at_neutral(robot), rods).q), rods, {"arm": 1.0})


def test_the_six_legs_of_a_platform_are_idle():
    """Each of a ball, a slide and a ball: the rates of the slides are those at which the platform draws away from its feet."""
    rng, build, loops = np.random.default_rng(0), Builder("platform"), []
    around = np.deg2rad([0, 20, 120, 140, 240, 260])
    ring = np.stack([np.cos(around), np.sin(around), 0.0 * around], axis=1)
    base, top = ring + 0.2 * rng.normal(size=(6, 3)), 0.5 * ring[[1, 2, 3, 4, 5, 0]] + 0.2 * rng.normal(size=(6, 3))
    for i in range(6):
        build.joint(f"leg{i}", pin.JointModelSpherical(), at(*base[i])).joint(f"slide{i}", pin.JointModelPX(), at(), f"leg{i}")
        build.frame(f"end{i}", f"slide{i}", at(0.5))
    build.joint("platform", pin.JointModelFreeFlyer(), at(0, 0, 1.0))
    for i in range(6):
        build.frame(f"on{i}", "platform", at(*top[i]))
        loops.append(rbd.LoopClosure(f"ball{i}", f"end{i}", f"on{i}"))
    robot = build.robot()
    state = assemble(at_neutral(robot), loops).state
    rates = 0.1 * np.arange(6.0)
    found = velocity_partition(state, loops, {f"slide{i}": rates[i] for i in range(6)})
    assert found.idle == tuple(f"leg{i}" for i in range(6)) and found.residual < 1e-12
    moving = state.with_velocity(found.v)
    ends = [(moving.frame(f"on{i}"), state.frame(f"leg{i}").X_WF.translation) for i in range(6)]
    along = [(frame.X_WF.translation - foot) / np.linalg.norm(frame.X_WF.translation - foot) for frame, foot in ends]
    signs = [np.sign(0.5 + state.joint(f"slide{i}").position) for i in range(6)]  # behind its foot a slide shortens the leg
    assert [u @ frame.v[:3] for u, (frame, _) in zip(along, ends, strict=True)] == pytest.approx(signs * rates, abs=1e-11)
