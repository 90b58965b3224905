"""Boxes of poses: what is proved of all, and what single poses say."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

import rbd
from rbd.robust import Counterexample, PushSet, RobustHold, hold, verifier
from rbd.robust.pose_bounds import Taylor, bounds_over_poses
from rbd.robust.poses import over_poses
from rbd.robust.sets import middle_of
from rbd.robust.uncertain_loads import UncertainLoads


def around(robot: rbd.Robot, state: rbd.State, joints: list[str], width: float) -> dict[str, tuple[float, float]]:
    """{joint: interval about where it is}."""
    at = {name: float(state.q[robot.model.joints[robot.joint_id(name)].idx_q]) for name in joints}
    return {name: (q - width, q + width) for name, q in at.items()}


def posed(robot: rbd.Robot, state: rbd.State, joints: dict[str, float]) -> rbd.State:
    """The state with some joints elsewhere."""
    q = state.q.copy()
    for name, value in joints.items():
        q[robot.model.joints[robot.joint_id(name)].idx_q] = value
    return rbd.State(robot, q)


def test_twelve_joints_of_talos_may_be_anywhere_within_a_twentieth_of_a_radian(talos):
    """Six joints of each arm: one proof with a positive margin; poses drawn at random are held, as `rbd.hold` says."""
    state, soles = talos.standing(), talos.soles(0.5)
    arms = [f"arm_{side}_{i}_joint" for side in ("left", "right") for i in range(1, 7)]
    box = around(talos, state, arms, 0.05)
    found = hold(state, soles, joints=box)
    assert isinstance(found, RobustHold) and found.margin > 0.5 and found.verify() and len(found.loads.turns) == 12
    rng = np.random.default_rng(4)
    for _ in range(2):
        pose = posed(talos, state, {name: rng.choice(ends) for name, ends in box.items()})
        assert rbd.hold(pose, soles).tau.shape == (32,)


def test_legs_that_carry_talos_may_move_in_parts_of_their_box(talos, exhaustive):
    """All twelve joints of both legs within 0.04 rad, 0.05 rad in the exhaustive run, in parts with bounds of their own.

    A part with the data of another one is refused; loads and forces of random members are within the data of theirs.
    """
    state, soles, width = talos.standing(), talos.soles(0.5), 0.05 if exhaustive else 0.04
    legs = [f"leg_{side}_{i}_joint" for side in ("left", "right") for i in range(1, 7)]
    box = around(talos, state, legs, width)
    found = hold(state, soles, joints=box)
    assert isinstance(found, RobustHold) and found.margin > 0.0 and 1 < found.parts <= 32 and found.verify()
    proof = found.document["proof"]
    swapped = found.document | {"proof": proof | {"below": proof["above"], "above": proof["below"]}}
    with pytest.raises(ValueError, match="another part"):
        verifier.verify(swapped | {"sha256": verifier.digest(swapped)})
    rng, known = np.random.default_rng(6), dict[str, tuple[np.ndarray, ...]]()
    for _ in range(1000 if exhaustive else 6):
        t = rng.choice([-1.0, 1.0], 12) * rng.uniform(0.0, 1.0, 12) ** rng.integers(2)
        pose = posed(talos, state, found.loads.member(0, t).joints)
        part, u = part_of(proof, t)
        if (key := str(part["forces"])) not in known:
            names = ("forces", "forces_radius", "loads", "parameters", "load_radius")
            known[key] = *[floats(part[name]) for name in names], floats([each[1] for each in part["slopes"]])
        P, radius, (load, *_), columns, load_radius, S = known[key]
        assert (np.abs(forces_of(found, pose, soles) - P - np.tensordot(u, S, 1)) <= radius).all()
        assert (np.abs(pose.h - load - u @ columns) <= load_radius).all()


def floats(x: object) -> np.ndarray:
    """Numbers of a certificate."""
    return np.vectorize(lambda text: float(Fraction(text)), otypes=[float])(np.array(x, dtype=object))


def part_of(proof: dict, t: np.ndarray) -> tuple[dict, np.ndarray]:
    """(data of the part with a member, its numbers there)."""
    low, high = -np.ones(len(t)), np.ones(len(t))
    while "split" in proof:
        i, at = proof["split"], float(Fraction(proof["at"]))
        (high if t[i] <= at else low)[i] = at
        proof = proof["below" if t[i] <= at else "above"]
    return proof["data"], (2.0 * t - low - high) / (high - low)


def forces_of(found: RobustHold, pose: rbd.State, contacts: list) -> np.ndarray:
    """What unit contact forces do at a pose, their planes as in the middle of the whole box."""
    balance, P = found.loads.balance, 0.0
    for i, (contact, row) in enumerate(zip(contacts, balance.rows, strict=True)):
        act, X_WF = balance.sets.point_map(i), balance.state.frame(contact.frame).X_WF
        for k, corner in enumerate(row.patch.corners_W):
            J = pose.frame(contact.frame, X_WF.actInv(corner)).J[:3]
            P = P + J.T @ row.patch.axes @ act[3 * k : 3 * k + 3]
    return P


def test_loads_and_forces_of_a_pose_are_within_their_bounds():
    """Gravity, pushes and contact Jacobians of Pinocchio at poses of the box, with other masses, lie in the set of loads."""
    solo = rbd.load_robot("solo12")
    state, rng = solo.standing(), np.random.default_rng(5)
    box = around(solo, state, ["FL_HFE", "FL_KFE", "HR_HAA"], 0.04)
    pushes = PushSet.box("base_link", (-1, -1, 0), (1, 1, 0))
    found = hold(state, solo.feet(friction=0.7), joints=box, pushes=pushes, mass={"base_link": 0.05})
    assert isinstance(found, RobustHold) and found.verify()
    loads, column = found.loads, 1
    for _ in range(10):
        t = np.array([0.0, *rng.uniform(-1.0, 1.0, 3)])
        pose = posed(solo, state, loads.member(0, t).joints)
        J = np.concatenate([foot.rows(pose).J for foot in solo.feet(friction=0.7)])
        P = J.T @ loads.balance.sets.G
        assert (np.abs(loads.within(t).balance.per_weight - P) <= loads.forces_radius).all()
        load = pose.h - pose.frame("base_link").J[:3].T @ loads.components[2]
        assert (np.abs(loads.load(2, t) - load) <= loads.load_radius).all()
        assert np.abs(loads.load(2, np.where(np.arange(4) == column - 1, t, 0.0)) - load).max() > loads.load_radius.max()


@pytest.mark.parametrize("name", ["solo12", "talos"])
def test_the_stated_rounding_holds_what_intervals_say_of_the_file(name):
    """Interval arithmetic from the robot's file to what unit forces do, and to gravity, stays within the stated radii."""
    robot = rbd.load_robot(name)
    state = robot.standing()
    contacts = robot.feet(friction=0.7) if name == "solo12" else robot.soles(friction=0.7)
    joint = next(n for n in robot.joints if robot.model.joints[robot.joint_id(n)].nq == 1)
    loads = UncertainLoads.of(state, contacts)
    exact = over_poses(loads, contacts, around(robot, state, [joint], 0.0))
    off = np.abs(exact.balance.per_weight - loads.balance.per_weight) + (exact.forces_radius - loads.forces_radius)
    assert (off <= loads.forces_radius).all() and off.max() > 1e-3 * loads.forces_radius.max()
    assert (np.abs(exact.corners - loads.corners) + (exact.load_radius - loads.load_radius) <= loads.load_radius).all()


@pytest.mark.parametrize("name", ["solo12", "talos"])
def test_the_stated_rounding_holds_uncertain_masses_and_places_too(name):
    """Of a load with all its columns and its push: what intervals say each is off by, together, is within its radius."""
    robot = rbd.load_robot(name)
    state, trunk = robot.standing(), {"solo12": "base_link", "talos": "torso_2_link"}[name]
    contacts = robot.feet(friction=0.7) if name == "solo12" else robot.soles(friction=0.7)
    push = PushSet.box(trunk, (-20, -20, -20), (20, 20, 20), offset=(0.0, 0.1, 0.2))
    loads = UncertainLoads.of(state, contacts, push, mass=0.05, com={trunk: (0.02, 0.01, 0.03)})
    joint = next(n for n in robot.joints if robot.model.joints[robot.joint_id(n)].nq == 1)
    middles = {link: middle_of(robot, link) for link, *_ in loads.links}
    points = {link: (link, at) for link, at in middles.items()} | {"push": (trunk, np.asarray(push.offset))}
    widths = {i: half for i, (_, column, _, half) in enumerate(loads.links) if column != i}
    for i, half in widths.items():
        points[f"{i}"] = trunk, middles[trunk] + half * np.eye(3)["xyz".index(loads.names[i][0])]
    bounds = bounds_over_poses(state, around(robot, state, [joint], 0.0), points)
    g, off = Taylor.fixed(robot.gravity, bounds.reach), np.zeros(robot.nv)
    for i, (link, column, middle, half) in enumerate(loads.links):
        if column == i:
            exact, size = bounds.jacobians[link].T @ g, half
        else:
            exact, size = (bounds.jacobians[f"{i}"] - bounds.jacobians[link]).T @ g, middle + loads.links[column][3]
        off += np.abs(-size * exact.mid - loads.columns[i]) + size * exact.moved
    for w, corner in zip(loads.components, loads.corners, strict=True):
        pushed = bounds.gravity - bounds.jacobians["push"].T @ Taylor.fixed(w, bounds.reach)
        assert (np.abs(pushed.mid - corner) + pushed.moved + off <= loads.load_radius).all()
    assert off.max() > 1e-4 * loads.load_radius.max()  # and it counts


def test_a_pose_that_falls_is_found(talos):
    """Where a joint of the box puts the feet aside of the centre of mass, a pose is returned that `rbd.hold` cannot hold."""
    state, soles = talos.standing(), talos.soles(0.5, on=None)
    box = around(talos, state, ["leg_left_2_joint", "leg_right_2_joint"], 0.4)
    found = hold(state, soles, joints=box)
    assert isinstance(found, Counterexample) and found.verify()
    with pytest.raises(rbd.CannotHold):
        rbd.hold(posed(talos, state, found.members[0].joints), soles)


@pytest.mark.parametrize(
    ("given", "error"),
    [
        ({"joints": {"FL_HFE": (0.2, 0.1)}}, rbd.InputError),
        ({"joints": {"FL_HFF": (0.1, 0.2)}}, rbd.errors.JointNotFound),
        ({"joints": {"FL_HFE": (0.7, 0.8)}, "pushes": {"base_link": np.zeros((1, 6))}}, rbd.errors.Unsupported),
    ],
)
def test_boxes_that_are_none_are_refused(given, error):
    """Reversed intervals, unknown joints, pushes with moments."""
    solo = rbd.load_robot("solo12")
    with pytest.raises(error):
        hold(solo.standing(), solo.feet(friction=0.7), **given)


def test_a_single_contact_is_refused_with_joints_as_without() -> None:
    """Both ask for a list."""
    solo = rbd.load_robot("solo12")
    for joints in (None, {"FL_HAA": (-0.001, 0.001)}):
        with pytest.raises(rbd.InputError, match=r"give a list, \[constraint\]"):
            hold(solo.standing(), solo.feet(friction=0.7)[0], joints=joints)  # type: ignore[arg-type]
