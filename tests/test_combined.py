"""Two robots in one model: each keeps what it is, and they meet in contacts."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.testing import box
from rbd.visual.robot_meshes import robot_parts

BOX = Path(__file__).parents[1] / "urdf" / "box.urdf"
X_W2 = pin.SE3(pin.exp3(np.array([0.1, -0.2, 0.5])), np.array([1.0, 2.0, 0.3]))


@pytest.fixture(scope="module")
def robots(talos: rbd.Robot) -> dict[str, rbd.Robot]:
    """A humanoid, an object, a fixed arm with passive fingers."""
    fingers = ["panda_finger_joint1", "panda_finger_joint2"]
    return {
        "talos": talos,
        "box": rbd.load_robot(BOX),
        "panda": rbd.load_robot("panda", root="fixed", passive=fingers),
    }


def _somewhere(robot: rbd.Robot, seed: int) -> rbd.State:
    rng = np.random.default_rng(seed)
    v = rng.normal(size=(2, robot.nv))
    return robot.at(pin.integrate(robot.model, robot.neutral(), v[0]), v[1])


PAIRS = [("talos", "box"), ("box", "talos"), ("talos", "panda"), ("panda", "talos"), ("panda", "panda"), ("talos", "talos")]


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_the_dynamics_of_both_stand_side_by_side(robots, one, other):
    """M and S block-diagonal, h one after the other, without contacts; masses, limits, passive joints as they were."""
    first, second = robots[one], robots[other]
    pair = rbd.robots.merge_robots(first, second, placement=pin.SE3(pin.exp3(np.array([0, 0, 0.5])), np.array([1.0, 2.0, 0.3])))
    states = _somewhere(first, 1), _somewhere(second, 2)
    both = pair.together(*states)
    n = first.nv
    for i, state in enumerate(states):
        part = slice(0, n) if i == 0 else slice(n, None)
        assert both.M[part, part] == pytest.approx(state.M, abs=1e-11)
        assert both.h[part] == pytest.approx(state.h, abs=1e-10)  # a placement that does not tilt leaves gravity as it was
    assert not both.M[:n, n:].any()
    S = np.zeros((pair.nu, pair.nv))
    S[: first.nu, :n], S[first.nu :, n:] = first.actuation, second.actuation
    assert np.array_equal(pair.actuation, S)
    assert np.array_equal(pair.effort_limit, np.r_[first.effort_limit, second.effort_limit])
    assert pair.mass == pytest.approx(first.mass + second.mass)
    assert pair.passive == {p + n for r, p in ((first, "a_"), (second, "b_")) for n in r.passive}
    assert pair.actuated_names == tuple(p + n for r, p in ((first, "a_"), (second, "b_")) for n in r.actuated_names)


@pytest.mark.parametrize(("one", "other"), PAIRS)
def test_frames_are_where_they_were_and_those_of_the_second_are_placed(robots, one, other):
    """Every frame of both, velocities too, whatever the placement."""
    first, second = robots[one], robots[other]
    pair = rbd.robots.merge_robots(first, second, placement=X_W2)
    states = _somewhere(first, 1), _somewhere(second, 2)
    both = pair.together(*states)
    for state, robot, prefix, X in ((states[0], first, "a_", pin.SE3.Identity()), (states[1], second, "b_", X_W2)):
        for name in robot.frames()[1:]:
            alone, here = state.frame(name), both.frame(prefix + name)
            assert here.X_WF.homogeneous == pytest.approx((X * alone.X_WF).homogeneous, abs=1e-13)
            turned = np.concatenate([X.rotation @ alone.v[:3], X.rotation @ alone.v[3:]])
            assert here.v == pytest.approx(turned, abs=1e-11)


def test_the_answer_for_both_is_the_answer_for_each(talos, g1):
    """Robots that do not touch do not know of each other: accelerations and forces are those of two solutions."""
    states = talos.standing(), g1.standing()
    taus = [rbd.hold(s, r.soles()).tau + 0.5 for s, r in zip(states, (talos, g1), strict=True)]
    pair = rbd.robots.merge_robots(talos, g1, placement=pin.SE3(np.eye(3), np.array([0.0, 1.0, 0.0])), names=("talos_", "g1_"))
    both = rbd.solve(pair.standing(), np.concatenate(taus), pair.feet(0.7))
    assert both.residuals.centroidal.scaled < 1e-9
    for part, state, tau, prefix in zip(pair.split(both.a), states, taus, ("talos_", "g1_"), strict=True):
        alone = rbd.solve(state, tau, state.robot.soles(0.7))
        assert part == pytest.approx(alone.a, abs=1e-7 * max(1.0, np.abs(alone.a).max()))
        for name, force in alone.forces.items():
            assert both.forces[prefix + name] == pytest.approx(force, abs=1e-5)


def test_the_momentum_of_both_is_balanced(robots):
    """Free fall with a generalised and a placed external force: the rate of momentum is weight and pushes."""
    pair = rbd.robots.merge_robots(robots["box"], robots["talos"])
    rng = np.random.default_rng(3)
    state = pair.at(pin.integrate(pair.model, pair.neutral(), rng.normal(size=pair.nv)), rng.normal(size=pair.nv))
    assert pair.bases == (1, 2) and not pair.floating
    pushes = [rbd.ExternalForce("a_box", rng.normal(size=3)), rbd.ExternalForce("b_torso_2_link", rng.normal(size=3))]
    for external in (None, rng.normal(size=pair.nv), pushes):
        s = rbd.solve(state, 0.2 * rng.normal(size=pair.nu), external=external)
        assert s.residuals.centroidal is not None and s.residuals.centroidal.scaled < 1e-12
    total = np.asarray(pushes[0].force) + pushes[1].force + pair.mass * np.array([0, 0, -9.81])
    assert (s.problem.balance.A_g @ s.a + s.problem.balance.rate_bias)[:3] == pytest.approx(total, abs=1e-9)


def test_what_is_fixed_to_the_world_has_no_momentum_balance(robots):
    """The base's reaction is unknown."""
    pair = rbd.robots.merge_robots(robots["talos"], robots["panda"])
    s = rbd.solve(pair.at(), np.zeros(pair.nu))
    assert pair.bases == () and s.residuals.centroidal is None


def test_a_pair_is_combined_with_a_third(talos):
    """Three boxes in a tower: each feels what is above it."""
    tower = rbd.robots.merge_robots(rbd.robots.merge_robots(box(4.0), box(2.0), names=("a_", "b_")), box(1.0), names=("", "c_"))
    heights = [0.1, 0.3, 0.5]
    q = np.concatenate([[0, 0, h, 0, 0, 0, 1.0] for h in heights])
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    contacts = [
        rbd.SurfaceContact(name, name, half_lengths=(0.2, 0.2), placement=below, friction=0.5, on=other and rbd.Body(other))
        for name, other in (("a_box", None), ("b_box", "a_box"), ("c_box", "b_box"))
    ]
    s = rbd.solve(tower.at(q), np.zeros(0), contacts)
    assert [s.forces[c.name][2] for c in contacts] == pytest.approx([7 * 9.81, 3 * 9.81, 9.81], abs=1e-7)
    assert s.residuals.centroidal.scaled < 1e-9


def test_contacts_made_for_each_alone_are_renamed_and_moved(talos):
    """Names, frames and the other body's frame get the prefix; the ground of the second is turned with its world."""
    pair = rbd.robots.merge_robots(talos, box(), placement=X_W2)
    hand = rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Body("base_link"), friction=0.4)
    toe = rbd.PointContact("toe", "box", friction=0.4)
    mine, theirs = pair.contacts([hand], [toe])
    assert (mine.name, mine.frame, mine.on.frame, mine.friction) == ("a_hand", "a_gripper_left_base_link", "a_base_link", 0.4)
    assert (theirs.name, theirs.frame) == ("b_toe", "b_box") and theirs.normal == pytest.approx(X_W2.rotation[:, 2])
    for given in ({"anchor": (0, 0, 0)}, {"on": rbd.Ground(velocity=(1, 0, 0))}):
        with pytest.raises(rbd.InputError, match="'toe' has an anchor or a moving ground"):
            pair.contacts(second=[rbd.PointContact("toe", "box", **given)])
    with pytest.raises(rbd.InputError, match="no contact"):
        pair.contacts([talos])
    with pytest.raises(rbd.InputError, match="list"):
        pair.contacts(toe)


def test_feet_of_a_pair_are_those_of_both(talos, g1):
    """An object has none; neither has any: said."""
    names = [f.name for f in rbd.robots.merge_robots(talos, rbd.robots.merge_robots(box(), g1)).feet()]
    assert names == ["a_left_sole", "a_right_sole", "b_b_left_sole", "b_b_right_sole"]
    with pytest.raises(rbd.errors.ModelError, match="no feet are known of box and box"):
        rbd.robots.merge_robots(box(), box()).feet()


def test_an_object_beside_a_standing_robot_stays_where_it_is_put(robots):
    """It has no posture of its own: its neutral one, moved by the placement; the robot stands as it does alone."""
    pair = rbd.robots.merge_robots(robots["talos"], robots["box"], placement=X_W2)
    talos, crate = pair.split(pair.standing().q)
    assert np.abs(talos - robots["talos"].standing().q).max() == 0.0
    assert np.abs(pin.XYZQUATToSE3(crate).homogeneous - X_W2.homogeneous).max() < 1e-15


def test_shapes_of_both_are_drawn_where_they_are(robots):
    """As many pieces as each has alone, each on its own joint, welded bases too."""
    first, second = robots["box"], robots["panda"]
    pair = rbd.robots.merge_robots(first, second, placement=X_W2)
    alone = [*robot_parts(first), *robot_parts(second)]
    state = pair.at()
    data = pair.model.createData()
    pin.forwardKinematics(pair.model, data, state.q)
    other = second.model.createData()
    pin.forwardKinematics(second.model, other, second.neutral())
    parts = robot_parts(pair)
    assert len(parts) == len(alone) and [len(p.mesh.faces) for p in parts] == [len(p.mesh.faces) for p in alone]
    for part, known in zip(parts[1:], alone[1:], strict=True):
        here = data.oMi[part.joint] * part.placement
        there = X_W2 * (other.oMi[known.joint] * known.placement)
        assert here.homogeneous == pytest.approx(there.homogeneous, abs=1e-12)
    assert len(pair.collision_model.geometryObjects) == sum(len(r.collision_model.geometryObjects) for r in (first, second))
    assert len(rbd.robots.merge_robots(box(), first).visual_model.geometryObjects) == 1


def test_split_takes_vectors_of_q_v_and_tau_apart(robots):
    """(first's, second's); anything else is refused."""
    pair = rbd.robots.merge_robots(robots["talos"], robots["panda"])
    for size, first in ((pair.nq, 39), (pair.nv, 38), (pair.nu, 32)):
        one, other = pair.split(np.arange(size))
        assert (len(one), one[-1], other[0]) == (first, first - 1, first)
    with pytest.raises(rbd.InputError, match="split wants q"):
        pair.split(np.zeros(3))
    with pytest.raises(rbd.InputError, match="split wants q"):
        pair.split("all")


def test_two_worlds_that_do_not_fit_are_refused(talos):
    """No robot, names that stay alike, two gravities, a placement that is none, states of others."""
    with pytest.raises(rbd.InputError, match="a robot of merge_robots is .* expected two robots"):
        rbd.robots.merge_robots(talos, "box")
    for names in (("", ""), ("a", "a")):
        with pytest.raises(rbd.InputError, match="both would have a joint"):
            rbd.robots.merge_robots(talos, talos, names=names)
    for names in ("ab", ("a_",), ("a_", 3), None):
        with pytest.raises(rbd.InputError, match="names is"):
            rbd.robots.merge_robots(talos, talos, names=names)
    light = box()
    light.model.gravity.linear = np.array([0.0, 0.0, -1.62])
    with pytest.raises(rbd.InputError, match="one world has one"):
        rbd.robots.merge_robots(talos, CheckedModel(light.model))
    with pytest.raises(rbd.InputError, match="placement of the second robot is no rigid placement"):
        rbd.robots.merge_robots(talos, box(), placement=np.ones((4, 4)))
    pair = rbd.robots.merge_robots(talos, box())
    with pytest.raises(rbd.InputError, match="together wants a State of box"):
        pair.together(talos.standing(), talos.standing())


def test_frames_of_both_are_offered_when_a_name_is_wrong(talos):
    """With their prefixes."""
    pair = rbd.robots.merge_robots(talos, box(), names=("talos_", "box_"))
    with pytest.raises(rbd.errors.FrameNotFound, match="'talos_left_sole_link'"):
        pair.at().frame("talos_left_sole_lnik")
    assert pair.name == "talos and box" and pair.members[0] is talos


def test_the_robots_given_are_not_changed(talos):
    """Their models are copied before names are changed."""
    before = list(talos.model.names), [f.name for f in talos.model.frames]
    rbd.robots.merge_robots(talos, talos)
    assert before == (list(talos.model.names), [f.name for f in talos.model.frames])


def test_loops_of_the_files_are_left_out_with_a_warning():
    """They name frames of one robot; silence would open the loops."""
    four_bar, box_robot = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5), box()
    with pytest.warns(rbd.errors.ModelWarning, match="no loops, wheels or drives of its own: 'coupler_pin'"):
        rbd.robots.merge_robots(four_bar, box_robot, names=("", "box_"))


def test_rotors_of_both_are_in_the_mass_matrix():
    """Of a file's <dynamics armature> and of motors; `pin.appendModel` drops them. Torque limits and speeds stay too."""
    swing = rbd.RobotBuilder("swing", root="fixed")
    swing.body("rod", rbd.robots.Rod((0, 0, 0), (0, 0, -1), mass=1.0))
    swing.joint("hinge", "ground", "rod", axis=(0, 1, 0), motor=True, armature=0.7, speed=3.0)
    first = swing.robot()
    second = first.with_motors({"hinge": rbd.Motor(rotor_inertia=1e-3, gear=5.0, limit=2.0, speed_limit=4.0)})
    pair = rbd.robots.merge_robots(first, second)
    M = np.diag([1 / 3 + 0.7, 1 / 3 + 0.025])
    geared = pair.with_motors({"b_hinge": rbd.Motor(rotor_inertia=1e-3, gear=10.0)})
    three = rbd.robots.merge_robots(geared, first, names=("c_", "d_"))
    assert pair.at().M == pytest.approx(M, abs=1e-14)
    assert np.diag(three.at().M) == pytest.approx([M[0, 0], 1 / 3 + 0.1, M[0, 0]], abs=1e-14)
    for same in (copy.deepcopy(geared), pickle.loads(pickle.dumps(geared)), geared.with_gravity((0.0, 0.0, -1.62))):
        assert np.diag(same.at().M) == pytest.approx([M[0, 0], 1 / 3 + 0.1], abs=1e-14)
    a = rbd.solve(pair.at(), tau=[1.0, 1.0]).a
    assert a == pytest.approx(1.0 / np.diag(M), abs=1e-12)
    for limit in ("upperVelocityLimit", "lowerVelocityLimit", "upperEffortLimit", "lowerEffortLimit"):
        assert np.array_equal(getattr(pair.model, limit), [getattr(r.model, limit)[0] for r in (first, second)])
