"""Contacts between two bodies: of one robot, and of two in one model."""

from __future__ import annotations

import inspect

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.model.checked_model import CheckedModel
from rbd.testing import ConstraintWrong, box, check_constraint, law_residuals

G = 9.81
SOLVERS = [rbd.ProxQP(), rbd.ConeSolver()]
DOWN = np.array([0.0, 0.0, -0.1])  # from the centre of a box of 0.4 x 0.4 x 0.2 m to its underside


def _patch(name: str, frame: str, friction: float | None, **more) -> rbd.SurfaceContact:
    X_FP = pin.SE3(np.eye(3), DOWN)
    return rbd.SurfaceContact(name, frame, half_lengths=(0.2, 0.2), placement=X_FP, friction=friction, **more)


def _stack(v: np.ndarray | None = None) -> rbd.State:
    """4 kg on 10 kg, the lower one on z = 0."""
    pair = rbd.robots.merge_robots(box(10.0), box(4.0), names=("lower_", "upper_"))
    q = pair.q(np.r_[0, 0, 0.1, 0, 0, 0, 1.0], np.r_[0, 0, 0.3, 0, 0, 0, 1.0])
    return pair.at(q, v)


def _bent(robot: rbd.Robot, seed: int) -> rbd.State:
    return robot.at(pin.integrate(robot.model, robot.standing().q, 0.4 * np.random.default_rng(seed).normal(size=robot.nv)))


def _kinds(
    frame: str, rng: np.random.Generator, against: str, **more
) -> list[rbd.PointContact | rbd.LineContact | rbd.SurfaceContact]:
    """One contact of each shape, somewhere on a frame."""
    more["on"] = rbd.Body(against)
    X = pin.SE3(pin.exp3(rng.normal(size=3)), 0.2 * rng.normal(size=3))
    return [
        rbd.PointContact("point", frame, offset=X.translation, **more | {"on": rbd.Body(against, normal=X.rotation[:, 2])}),
        rbd.LineContact("line", frame, half_length=0.1, placement=X, **more),
        rbd.SurfaceContact("surface", frame, half_lengths=(0.1, 0.05), placement=X, **more),
    ]


@pytest.mark.parametrize("friction", [None, 0.0, 0.5])
@pytest.mark.parametrize(
    ("name", "frame", "against"),
    [
        ("talos", "gripper_left_base_link", "leg_left_4_link"),
        ("talos", "left_sole_link", "base_link"),
        ("g1", "left_rubber_hand", "right_rubber_hand"),
        ("solo12", "FL_FOOT", "HR_FOOT"),
    ],
)
def test_they_describe_their_motion_as_seen_from_the_other_body(name, frame, against, friction, rng):
    """J, velocity and J_dot v of points, lines and patches, against the relative motion along curves."""
    robot = rbd.load_robot(name)
    for contact in _kinds(frame, rng, against, friction=friction):
        report = check_constraint(contact, _bent(robot, 6), draws=3)
        assert report.against == "motion of the patch"
        assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-8


def test_forgotten_coriolis_acceleration_is_found(talos, rng):
    """The check above can fail: without 2 W x v_rel the bias is that of axes that do not turn."""

    class Forgets:
        name = "point"

        def rows(self, state):
            r = _kinds("gripper_left_base_link", np.random.default_rng(1), "leg_left_4_link")[0].rows(state)
            W = state.frame("leg_left_4_link").v[3:]
            missing = 2.0 * r.patch.axes.T @ np.cross(W, r.patch.axes @ r.velocity)
            return rbd.Rows("point", r.J, r.bias + missing, r.cone, r.velocity, resultant=r.resultant, patch=r.patch)

    with pytest.raises(ConstraintWrong, match="J_dot v"):
        check_constraint(Forgets(), _bent(talos, 6))


@pytest.mark.parametrize("solver", [*SOLVERS, rbd.KKT()], ids=lambda s: type(s).__name__)
def test_two_stacked_boxes_press_with_what_is_above(solver):
    """Between them m2 g, on the floor (m1 + m2) g; the force on the upper one is up."""
    friction = None if isinstance(solver, rbd.KKT) else 0.5
    contacts = [_patch("floor", "lower_box", friction), _patch("between", "upper_box", friction, on=rbd.Body("lower_box"))]
    s = rbd.solve(_stack(), np.zeros(0), contacts, solver=solver)
    assert s.forces["between"] == pytest.approx([0, 0, 4.0 * G, 0, 0, 0], abs=1e-7)
    assert s.forces["floor"] == pytest.approx([0, 0, 14.0 * G, 0, 0, 0], abs=1e-7)
    assert np.abs(s.a).max() < 1e-8
    assert s.residuals.centroidal is not None and s.residuals.centroidal.scaled < 1e-9


@pytest.mark.parametrize("kind", ["point", "line", "surface"])
def test_the_normal_is_the_other_bodys(kind):
    """Of a contact named from the lower box's side the normal points down, and the force on that box is down."""
    up = pin.SE3(pin.exp3(np.array([np.pi, 0.0, 0.0])), -DOWN)  # on its upper side, its z out of the upper box: down
    more = {"on": rbd.Body("upper_box"), "friction": 0.5}
    contact = {
        "point": rbd.PointContact(
            "between", "lower_box", offset=up.translation, **more | {"on": rbd.Body("upper_box", normal=(0, 0, -1))}
        ),
        "line": rbd.LineContact("between", "lower_box", half_length=0.2, placement=up, **more),
        "surface": rbd.SurfaceContact("between", "lower_box", half_lengths=(0.2, 0.2), placement=up, **more),
    }[kind]
    s = rbd.solve(_stack(), np.zeros(0), [_patch("floor", "lower_box", 0.5), contact])
    assert s.forces["between"][:3] == pytest.approx([0.0, 0.0, -4.0 * G], abs=1e-7)
    assert s.contacts["between"].normal == pytest.approx(4.0 * G) and np.abs(s.a).max() < 1e-8


def test_naming_the_other_body_first_changes_the_sign_of_the_force_alone(talos, rng):
    """Action and reaction: the same acceleration, the opposite force and moment about the same point, held and rubbing."""
    X_WP = pin.SE3(pin.exp3(rng.normal(size=3)), np.array([0.2, 0.1, 0.9]))
    state = _bent(talos, 7)
    for friction in (None, 0.6):
        sides = []
        for frame, other, turn in (
            ("gripper_left_base_link", "leg_left_4_link", np.eye(3)),
            ("leg_left_4_link", "gripper_left_base_link", np.diag([1.0, -1.0, -1.0])),
        ):
            X_FP = state.frame(frame).X_WF.actInv(X_WP * pin.SE3(turn, np.zeros(3)))
            half = (0.05, 0.03)
            sides.append(
                rbd.SurfaceContact("c", frame, half_lengths=half, placement=X_FP, on=rbd.Body(other), friction=friction)
            )
        tau = 20.0 * rng.normal(size=talos.nu)
        tau = np.clip(tau, -talos.effort_limit, talos.effort_limit)
        one, two = (rbd.solve(state, tau, [c, *talos.soles(None, on=None)], solver=rbd.ConeSolver()) for c in sides)
        scale = max(1.0, np.abs(one.a).max())
        assert np.abs(one.a - two.a).max() < 1e-8 * scale
        assert one.forces["c"] == pytest.approx(-two.forces["c"], abs=1e-7 * scale)
        assert friction or np.abs(one.forces["c"]).max() > 1.0


@pytest.mark.parametrize("against_joint_first", [False, True])
def test_a_held_point_agrees_with_pinocchios_closed_loop(talos, rng, against_joint_first):
    """Hand held to thigh at rest: constraintDynamics with a 3D contact between two joints gives the same acceleration."""
    state, tau = _bent(talos, 2), np.zeros(talos.nu)
    hand, thigh = "gripper_left_base_link", "leg_left_4_link"
    s = rbd.solve(state, tau, [rbd.PointContact("hand", hand, on=rbd.Body(thigh))])
    (j1, X1), (j2, X2) = talos.site(hand), talos.site(thigh)
    X2 = X2 * (state.frame(thigh).X_WF.inverse() * state.frame(hand).X_WF)
    ends = ((j2, X2), (j1, X1)) if against_joint_first else ((j1, X1), (j2, X2))
    model = pin.RigidConstraintModel(pin.ContactType.CONTACT_3D, talos.model, *ends[0], *ends[1], pin.ReferenceFrame.LOCAL)
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    models.append(model)
    datas.append(model.createData())
    data = talos.model.createData()
    pin.initConstraintDynamics(talos.model, data, models, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 1e-10, 30)
    theirs = pin.constraintDynamics(talos.model, data, state.q, state.v, np.zeros(talos.nv), models, datas, settings)
    assert s.a == pytest.approx(theirs, abs=1e-7 * np.abs(theirs).max())


def test_a_turntable_in_the_model_is_a_turntable_given_by_its_motion(rng):
    """A body on a hinge, driven, or a ground that turns: the same velocity and relative acceleration of a box on it."""
    model = pin.Model()
    hinge = model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "hinge")
    model.appendBodyToJoint(hinge, pin.Inertia.FromBox(5.0, 2.0, 2.0, 0.1), pin.SE3.Identity())
    model.addBodyFrame("table", hinge, pin.SE3.Identity(), 0)
    pair = rbd.robots.merge_robots(CheckedModel(model, name="turntable"), box(), names=("", ""))
    alone = box()
    W, spin_up = 1.3, -0.4
    q_box, v_box = pin.integrate(alone.model, pin.neutral(alone.model), rng.normal(size=6)), rng.normal(size=6)
    a_box = rng.normal(size=6)
    state = pair.at(pair.q(np.array([0.7]), q_box), np.r_[W, v_box])
    motion = {"velocity": (0, 0, 0, 0, 0, W), "acceleration": (0, 0, 0, 0, 0, spin_up), "about": (0, 0, 0)}
    normal = pin.exp3(np.array([0.0, 0.0, -0.7])) @ np.array([0.48, -0.64, 0.6])  # in the table's axes
    X = pin.SE3(pin.exp3(rng.normal(size=3)), DOWN)
    for body, ground in (
        (
            rbd.PointContact("c", "box", offset=DOWN, on=rbd.Body("table", normal=normal)),
            rbd.PointContact("c", "box", offset=DOWN, on=rbd.Ground(normal=(0.48, -0.64, 0.6), **motion)),
        ),
        (
            rbd.SurfaceContact("c", "box", half_lengths=(0.1, 0.1), placement=X, on=rbd.Body("table")),
            rbd.SurfaceContact("c", "box", half_lengths=(0.1, 0.1), placement=X, on=rbd.Ground(**motion)),
        ),
        (
            rbd.LineContact("c", "box", half_length=0.1, placement=X, on=rbd.Body("table")),
            rbd.LineContact("c", "box", half_length=0.1, placement=X, on=rbd.Ground(**motion)),
        ),
    ):
        ours, theirs = body.rows(state), ground.rows(rbd.State(alone, q_box, v_box))
        R = ours.patch.axes.T @ theirs.patch.axes  # a point's tangents follow the table's x, not W's
        turn = R if len(ours) == 3 else np.eye(len(ours))
        assert ours.velocity == pytest.approx(turn @ theirs.velocity, abs=1e-13)
        c = ours.J @ np.r_[spin_up, a_box] + ours.bias
        assert c == pytest.approx(turn @ (theirs.J @ a_box + theirs.bias), abs=1e-12)
        assert ours.patch.axes[:, 2] == pytest.approx(theirs.patch.axes[:, 2], abs=1e-15)


@pytest.mark.parametrize("kind", [_patch, lambda n, f, mu, **k: rbd.PointContact(n, f, offset=DOWN, friction=mu, **k)])
def test_a_box_that_slides_on_a_plank_drags_it_along(kind):
    """Plank on ice: -mu g for the box, + mu m2 g / m1 for the plank, from their relative motion (Coulomb's law)."""
    v = np.r_[np.r_[1.0, 0, 0, 0, 0, 0], np.r_[1.6, 0, 0, 0, 0, 0]]
    contacts = [_patch("ice", "lower_box", 0.0), kind("between", "upper_box", 0.3, on=rbd.Body("lower_box"))]
    s = rbd.solve(_stack(v), np.zeros(0), contacts, solver=rbd.ConeSolver())
    if isinstance(contacts[1], rbd.SurfaceContact):
        assert s.a[[0, 6]] == pytest.approx([0.3 * 4.0 * G / 10.0, -0.3 * G], abs=1e-8)
    force = s.forces["between"]
    assert force[0] == pytest.approx(-0.3 * force[2], abs=1e-9) and force[2] > 0.0
    plank_and_box = 10.0 * s.a[0] + 4.0 * s.a[6]
    assert abs(plank_and_box) < 1e-9  # nothing pushes from outside along x


def test_boxes_that_move_together_are_at_rest_on_each_other():
    """The convex law refuses sliding contacts only: what counts is the relative velocity."""
    v = np.tile([0.7, -0.2, 0.0, 0.0, 0.0, 0.0], 2)
    contacts = [_patch("ice", "lower_box", 0.0), _patch("between", "upper_box", 0.3, on=rbd.Body("lower_box"))]
    push = rbd.ExternalForce("lower_box", (14.0, 0.0, 0.0))
    s = rbd.solve(_stack(v), np.zeros(0), contacts, external=push, solver=rbd.ConeSolver())
    assert s.a[[0, 6]] == pytest.approx([1.0, 1.0], abs=1e-8) and s.forces["between"][0] == pytest.approx(4.0)
    v[6] += 0.5
    with pytest.raises(rbd.errors.ContactMoves, match=r"'between'.*0\.5"):
        rbd.solve(_stack(v), np.zeros(0), [contacts[1]], law="convex")


def test_two_boxes_tied_in_the_air_move_as_one_body(rng):
    """Welded boxes, tumbling and pushed: the acceleration of one body with the mass and inertia of both."""
    pair = rbd.robots.merge_robots(box(10.0), box(4.0, (0.2, 0.3, 0.1)), names=("one_", "two_"))
    X_12 = pin.SE3(pin.exp3(rng.normal(size=3)), np.array([0.3, 0.1, -0.2]))
    X_W1 = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    v1 = pin.Motion(rng.normal(size=6))
    state = pair.at(pair.q(pin.SE3ToXYZQUAT(X_W1), pin.SE3ToXYZQUAT(X_W1 * X_12)), np.r_[v1.vector, X_12.actInv(v1).vector])
    push = rbd.ExternalForce("two_box", 20.0 * rng.normal(size=3), rng.normal(size=3))
    tie = rbd.SurfaceContact("tie", "two_box", half_lengths=(0.1, 0.1), on=rbd.Body("one_box"))
    s = rbd.solve(state, np.zeros(0), [tie], external=push, solver=rbd.KKT())

    both = pin.Model()
    joint = both.addJoint(0, pin.JointModelFreeFlyer(), pin.SE3.Identity(), "root_joint")
    both.appendBodyToJoint(joint, pair.model.inertias[1], pin.SE3.Identity())
    both.appendBodyToJoint(joint, pair.model.inertias[2], X_12)
    both.addBodyFrame("two_box", joint, X_12, 0)
    one = CheckedModel(both, name="welded")
    welded = rbd.State(one, pin.SE3ToXYZQUAT(X_W1), v1.vector)
    a = rbd.solve(welded, np.zeros(0), external=push).a
    assert s.a[:6] == pytest.approx(a, abs=1e-9)
    assert s.residuals.centroidal.scaled < 1e-12
    rate = s.problem.balance.A_g @ s.a + s.problem.balance.rate_bias
    assert rate[:3] == pytest.approx(np.asarray(push.force) + [0.0, 0.0, -14.0 * G], abs=1e-9)  # internal forces change nothing


def test_the_centroidal_residual_sees_a_force_without_a_reaction():
    """A contact between bodies whose rows act on one of them only: momentum is not conserved, and the answer fails."""

    class OneSided:
        name = "between"

        def rows(self, state):
            r = _patch("between", "upper_box", None, on=rbd.Body("lower_box")).rows(state)
            J = r.J.copy()
            J[:, :6] = 0.0
            return rbd.Rows("between", J, r.bias, r.cone, r.velocity, resultant=r.resultant, patch=r.patch)

    s = rbd.solve(_stack(), np.zeros(0), [_patch("floor", "lower_box", None), OneSided()], check=False)
    assert s.status == "failed" and s.residuals.centroidal == pytest.approx(4.0 * G)


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
def test_talos_leans_on_a_box_as_on_a_wall(talos, solver):
    """A held box is a wall: the same motion and hand force against a box tied to the world and against the ground."""
    pair = rbd.robots.merge_robots(talos, box(), names=("", "wall_"))
    state = talos.standing()
    hand = state.frame("gripper_left_base_link").X_WF
    q_wall = np.r_[hand.translation + [0.25, 0.0, 0.0], 0, 0, 0, 1.0]
    both = pair.at(pair.q(state.q, q_wall))
    tau = rbd.hold(state, talos.soles()).tau
    wall, n = {"offset": (0.0, 0.0, 0.0), "friction": 0.5}, (-1.0, 0.0, 0.0)
    push = rbd.ExternalForce("gripper_left_base_link", (60.0, 0.0, 0.0))
    tied = rbd.SurfaceContact("tied", "wall_box", half_lengths=(1, 1))
    alone = rbd.solve(
        state,
        tau,
        [*talos.soles(), rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Ground(normal=n), **wall)],
        external=push,
        solver=solver,
    )
    against = rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Body("wall_box", normal=n), **wall)
    s = rbd.solve(both, tau, [*talos.soles(), against, tied], external=push, solver=solver)
    assert s.a[: talos.nv] == pytest.approx(alone.a, abs=1e-6)
    assert s.forces["hand"] == pytest.approx(alone.forces["hand"], abs=1e-5) and s.forces["hand"][0] < -20.0
    # The wall's tie feels the reaction, and the wall's weight: the force on the wall is minus that on the hand.
    assert s.forces["tied"][:3] == pytest.approx(s.forces["hand"] + [0.0, 0.0, 10.0 * G], abs=1e-6)


def test_two_robots_push_hands(g1):
    """G1 against G1, mirror images: each pushes the other, and one acceleration is the image of the other."""
    turned = pin.SE3(np.diag([-1.0, -1.0, 1.0]), np.array([0.7, 0.0, 0.0]))
    pair = rbd.robots.merge_robots(g1, g1, placement=turned)
    alone = g1.standing()
    state = pair.standing()
    hold = rbd.hold(alone, g1.soles()).tau
    other = rbd.Body("b_torso_link", normal=(1.0, 0.0, 0.0))
    hands = rbd.PointContact("hands", "a_torso_link", offset=(0.2, 0.0, 0.0), on=other, friction=0.5)
    tau = np.r_[hold, hold]
    lean = [rbd.ExternalForce("a_torso_link", (30.0, 0, 0)), rbd.ExternalForce("b_torso_link", (-30.0, 0, 0))]
    s = rbd.solve(state, tau, [*pair.feet(0.7), hands], external=lean, solver=rbd.ConeSolver())
    assert s.status == "solved" and s.residuals.centroidal.scaled < 1e-9
    first, second = pair.split(s.a)
    assert first == pytest.approx(second, abs=1e-6)  # each in its own base's axes
    assert s.forces["hands"][0] < -1.0 and abs(s.forces["hands"][1]) < 1e-6


@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
def test_answers_between_bodies_obey_the_law_recomputed(rng, solver):
    """Stacks pushed at random, sticking and slipping: residuals written down once more."""
    for _ in range(20):
        push = [rbd.ExternalForce(f, 30.0 * rng.normal(size=3), rng.normal(size=3)) for f in ("lower_box", "upper_box")]
        contacts = [_patch("floor", "lower_box", 0.6), _patch("between", "upper_box", 0.4, on=rbd.Body("lower_box"))]
        s = rbd.solve(_stack(), np.zeros(0), contacts, external=push, solver=solver)
        assert max(law_residuals(s.problem, s, solver.law).values()) < 1e-9
        assert s.residuals.centroidal.scaled < 1e-9


def test_a_robot_holds_itself_by_its_own_thigh(talos):
    """Statics between bodies: a hand on its own thigh costs no outside force, and the feet carry the weight as before."""
    state = talos.standing()
    hand = rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Body("leg_left_4_link", normal=(0, 0, 1)), friction=0.5)
    held = rbd.hold(state, [*talos.soles(), hand])
    feet = sum(held.forces[sole.name][:3] for sole in talos.soles())
    assert feet == pytest.approx([0.0, 0.0, talos.mass * G], abs=1e-6) and held.residuals.stationarity < 1e-6


def test_frames_of_one_body_are_refused(talos):
    """They do not move against each other; said with both names."""
    contact = rbd.PointContact("c", "left_sole_link", on=rbd.Body("leg_left_6_link"))
    with pytest.raises(rbd.InputError, match="'left_sole_link' and 'leg_left_6_link', which are fixed to one body of talos"):
        contact.rows(talos.standing())
    with pytest.raises(rbd.InputError, match="between 'left_sole_link' and itself"):
        rbd.PointContact("c", "left_sole_link", on=rbd.Body("left_sole_link"))


def test_a_body_that_is_not_there_is_refused_with_the_nearest(talos):
    """As with the contact's own frame."""
    for contact in _kinds("left_sole_link", np.random.default_rng(0), "right_sole_lnik"):
        with pytest.raises(rbd.errors.FrameNotFound, match="'right_sole_link'"):
            contact.rows(talos.standing())


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("rbd.Body is of ''", {"frame": ""}),
        ("rbd.Body is of 3", {"frame": 3}),
        ("normal of the body 'other'", {"frame": "other", "normal": (0.0, 0.0, 2.0)}),
    ],
)
def test_a_body_that_is_none_is_refused(what, arguments):
    """By name, before any robot is involved. A contact touches a body or a ground that moves, never both: there is one `on`."""
    with pytest.raises(rbd.InputError, match=what):
        rbd.Body(**arguments)
    for make in (rbd.Ground, rbd.PointContact, rbd.LineContact, rbd.SurfaceContact, rbd.RollingBall):
        assert {"against", "body"}.isdisjoint(inspect.signature(make).parameters)
    for word in ("velocity", "acceleration", "about"):
        with pytest.raises(TypeError, match=word):
            rbd.Body("other", **{word: (1.0, 0.0, 0.0)})
