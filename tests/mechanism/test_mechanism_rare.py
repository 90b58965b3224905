"""What is rarely asked of mechanisms: nothing to close, nothing known, all fixed, steps that run out."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from linkages import Builder, at, free
from planar_models import bar, checked, four_bar, six_bar
from states import at_neutral

import rbd
from rbd.constraints.descent import displacement, minimise
from rbd.constraints.manifold import ConstraintManifold
from rbd.errors import CannotAssemble, InputError, NoSolution
from rbd.mechanism import (
    acceleration_partition,
    assemble,
    branches,
    independent_velocities,
    integrability,
    mobility,
    project_velocity,
    singularities_along,
    trace,
    velocity_partition,
)
from rbd.mechanism.constraint_error import Closure
from rbd.mechanism.continuation import PoseCurve
from rbd.mechanism.degrees_of_freedom import plane_normal
from rbd.mechanism.poses import beyond_limits

CRANK_ROCKER = (1.0, 3.0, 2.5, 3.0)
START = np.array([0.7, -0.03, 1.5])


def pendulum() -> rbd.model.checked_model.CheckedModel:
    """One bar of 1 m on a hinge."""
    model = pin.Model()
    bar(model, 0, pin.SE3.Identity(), "crank", 1.0)
    return checked(model, "pendulum")


# ---------------------------------------------------------------------------------------------------------- assembling


def test_what_resists_a_motion_is_passed_over_and_named():
    """Friction at a joint asks for no place: the loops alone are closed."""
    robot, loops = four_bar(*CRANK_ROCKER)
    found = assemble(rbd.State(robot, START), [*loops, rbd.JointFriction("rubs", "rocker", 2.0)])
    assert np.array_equal(found.q, assemble(rbd.State(robot, START), loops).q)
    assert found.skipped == ("'rubs' resists motion and gives no position",)


def test_only_the_loop_that_is_open_is_told():
    """The first loop of a six-bar closes at the fixed joints, the second does not."""
    robot, loops = six_bar()
    closed = assemble(rbd.State(robot, [0.7, -0.1, 1.5, 0.0, 1.0]), loops)
    fixed = {name: float(closed.q[i]) for i, name in enumerate(["crank", "coupler", "rocker", "link"])}
    with pytest.raises(CannotAssemble) as told:
        assemble(rbd.State(robot, closed.q), loops, fixed={**fixed, "output": float(closed.q[4]) + 0.5})
    assert set(told.value.distances) == {"second"} and "Give a nearer one" not in str(told.value)
    assert told.value.distances["second"] == pytest.approx(2.0 * 2.0 * math.sin(0.25), rel=1e-9)  # a chord of the output


def test_no_fixed_joint_alone_is_to_blame():
    """Two loops that are each too short: to let go one joint closes neither."""
    robot, loops = four_bar(0.5, 0.5, 0.5, 4.0)
    with pytest.raises(CannotAssemble, match=r"Freeing any one of the fixed joints \('crank', 'rocker'\) does not help"):
        assemble(rbd.State(robot, START), loops, fixed={"crank": 0.1, "rocker": 2.0})


def test_a_fixed_base_that_prevents_closing_is_named_without_a_number():
    """A base has no one value that would do."""
    robot = rbd.load_robot("bolt")
    q0 = robot.standing().q
    touch = robot.feet(friction=None)[0].anchored(rbd.State(robot, q0))
    base = np.array([0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 1.0])
    with pytest.raises(CannotAssemble, match="The fixed value prevents it: it closes with root_joint"):
        assemble(rbd.State(robot, q0), [touch], fixed={"root_joint": base})


def test_a_constraint_that_no_joint_moves_cannot_be_met():
    """A residual of 1 with a derivative of zero: said at once, with its size."""
    robot = pendulum()
    stuck = rbd.FunctionConstraint("stuck", lambda q: np.array([1.0]))
    with pytest.raises(CannotAssemble, match="'stuck' is 1 m") as told:
        assemble(rbd.State(robot, np.zeros(1)), [stuck])
    assert told.value.distances == {"stuck": 1.0}


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"fixed": {"crank": [[1.0]]}}, r"shape \(1, 1\)"),
        ({"fixed": 3}, "expected a mapping"),
        ({"within_limits": 1}, "within_limits is 1; expected True or False"),
    ],
)
def test_arguments_of_assembling_are_checked(given, match):
    """In words."""
    robot, loops = four_bar(*CRANK_ROCKER)
    with pytest.raises(InputError, match=match):
        assemble(rbd.State(robot, START), loops, **given)


def test_joints_made_of_joints_have_their_parts_coordinates():
    """A composite of a hinge and a slide: the first goes round, the second does not."""
    joint = pin.JointModelComposite()
    joint.addJoint(pin.JointModelRZ(), pin.SE3.Identity())
    joint.addJoint(pin.JointModelPX(), pin.SE3.Identity())
    robot = Builder("pair").joint("both", joint, at()).robot()
    assert robot.joints.periodic.tolist() == [True, False] == robot.joints.angular.tolist()
    assert displacement(robot, np.zeros(2), np.array([2.0 * math.pi + 0.1, 7.0])) == pytest.approx([0.1, 7.0])
    with pytest.raises(InputError, match="expected a robot"):
        Closure("both", [])  # type: ignore[arg-type]


class Refusing:
    """A constraint that is defined nowhere."""

    name = "refusing"

    def rows(self, state: rbd.State) -> rbd.Rows:
        """None."""
        raise InputError("not defined here")


class RefusingHalf(Refusing):
    """One that is defined where the crank points up, and says nothing there."""

    def rows(self, state: rbd.State) -> rbd.Rows:
        """Of no length."""
        if math.sin(state.q[0]) < 0.0:
            raise InputError("not defined here")
        return rbd.Rows(self.name, np.zeros((0, 3)), np.zeros(0), rbd.problem.Free(0), error=np.zeros(0))


def test_draws_that_a_constraint_refuses_are_left_out():
    """If all are, that is what is said; if half are, the branches of the other half are found."""
    robot, loops = four_bar(*CRANK_ROCKER)
    with pytest.raises(InputError, match="not defined here"):
        branches(at_neutral(robot), [*loops, Refusing()], fixed={"crank": 0.7}, tries=5)
    for seed in range(6):  # whether the first draw is refused or the last
        found = branches(at_neutral(robot), [*loops, RefusingHalf()], fixed={"rocker": 2.0}, tries=40, seed=seed)
        assert 1 <= len(found) <= 2 and all(math.sin(b.q[0]) >= 0.0 for b in found.found)


# ------------------------------------------------------------------------------------------------------------- driving


def test_a_joint_alone_is_driven_to_its_stop():
    """Nothing to close: a pendulum follows the values, until a stop ends it; both ways of going say so."""
    robot = pendulum()
    robot.model.lowerPositionLimit[0], robot.model.upperPositionLimit[0] = -0.5, 0.5
    stop = rbd.JointLimit("stop", "crank")
    for past in (False, True):
        motion = trace(rbd.State(robot, np.zeros(1)), [stop], joint="crank", values=(0.0, 1.0), steps=10, past_limits=past)
        assert motion.stopped_by == "stop" and motion.input[-1] == pytest.approx(0.5, abs=1e-9)
        free = trace(rbd.State(robot, np.zeros(1)), [stop], joint="crank", values=(0.0, 0.4), steps=4, past_limits=past)
        assert free.stopped_by is None or free.stopped_by == "" and free.complete


@pytest.mark.parametrize("past", [False, True])
def test_steps_that_run_out_are_told(past: bool):
    """Three steps of 0.1 do not lead a crank round."""
    robot, loops = four_bar(*CRANK_ROCKER)
    with pytest.raises(NoSolution, match="steps"):
        trace(rbd.State(robot, START), loops, joint="crank", values=(0.7, 6.0), max_steps=3, past_limits=past)


def test_going_round_tells_its_progress_and_ends_at_the_last_value():
    """A crank that turns for ever has no limits to pass: the last value ends the motion."""
    told: list[float] = []
    robot, loops = four_bar(*CRANK_ROCKER)
    motion = trace(rbd.State(robot, START), loops, joint="crank", values=(0.7, 2.0), past_limits=True, progress=told.append)
    assert motion.input[-1] == pytest.approx(2.0, abs=1e-12) and told == sorted(told) and len(told) > 5
    assert all(0.0 < part <= 1.0 for part in told)


def test_values_that_are_far_off_are_refused():
    """A million turns."""
    robot, loops = four_bar(*CRANK_ROCKER)
    with pytest.raises(InputError, match="values reach"):
        trace(rbd.State(robot, START), loops, joint="crank", values=(0.7, 1e9))


# ---------------------------------------------------------------------------------- velocities and degrees of freedom


def test_what_is_known_whole_leaves_nothing_unknown():
    """All three rates of a four-bar given: no J2, and a condition of one."""
    robot, loops = four_bar(*CRANK_ROCKER)
    state = rbd.State(robot, assemble(rbd.State(robot, START), loops).q)
    v = velocity_partition(state, loops, {"crank": 1.0}).v
    known = dict(zip(("crank", "coupler", "rocker"), map(float, v), strict=True))
    found = velocity_partition(state, loops, known)
    assert found.condition == 1.0 and not found.rates and np.abs(found.v - v).max() < 1e-12


@pytest.mark.parametrize(
    "what",
    [
        "velocity", "acceleration", "independent", "mobility", "integrability", "singularities",
        "assemble", "branches", "trace", "project",
    ],
)  # fmt: skip
def test_what_is_no_state_is_refused_by_name(what: str):
    """With the way to make one."""
    robot, loops = four_bar(*CRANK_ROCKER)
    state = rbd.State(robot, assemble(rbd.State(robot, START), loops).q)
    calls = {
        "velocity": lambda it: velocity_partition(it, loops, {"crank": 1.0}),
        "acceleration": lambda it: acceleration_partition(it, loops, {"crank": 1.0}),
        "independent": lambda it: independent_velocities(it, loops),
        "mobility": lambda it: mobility(it, loops),
        "integrability": lambda it: integrability(it, loops),
        "singularities": lambda it: singularities_along(it, loops, path=state.q[None], inputs=["crank"]),
        "assemble": lambda it: assemble(it, loops),
        "branches": lambda it: branches(it, loops, fixed={"crank": 0.7}),
        "trace": lambda it: trace(it, loops, joint="crank", values=(0.7, 1.0)),
        "project": lambda it: project_velocity(it, loops),
    }
    with pytest.raises(InputError, match=r"a State .*expected first, got .*Make one: rbd.State\(robot, q"):
        calls[what]("four bar")
    with pytest.raises(InputError, match="known is 3; expected a mapping"):
        velocity_partition(state, loops, 3)
    for tolerance in (0.0, -1.0, 1.0):
        with pytest.raises(InputError, match="tolerance"):
            mobility(state, loops, tolerance=tolerance)


def test_rates_that_contradict_name_only_those_that_would_agree():
    """The rates of a five-bar's two cranks decide the rest; a third known one contradicts them."""
    robot, loops = six_bar()
    state = rbd.State(robot, assemble(rbd.State(robot, [0.7, -0.1, 1.5, 0.0, 1.0]), loops).q)
    v = velocity_partition(state, loops, {"crank": 1.0}).v
    with pytest.raises((InputError, NoSolution, rbd.RbdError), match="agree with 'output' at") as told:
        velocity_partition(state, loops, {"crank": 1.0, "rocker": float(v[2]), "output": float(v[4]) + 1.0})
    assert "'crank' at" not in str(told.value) and "'rocker' at" not in str(told.value)


def test_many_redundant_rows_are_counted_not_listed():
    """Four welded loops of flat bars: the first eight are named, and how many more there are."""
    robot = rbd.mechanism.n_four_bar(5)
    state = robot.at("assembled")
    welds = [rbd.LoopClosure(loop.name, loop.frame_a, loop.frame_b, kind="revolute", axis=loop.axis) for loop in robot.loops()]
    found = mobility(state, welds)
    assert len(found.redundant) > 8 and f"and {len(found.redundant) - 8} more" in str(found)
    assert found.rank == mobility(state, robot.loops()).rank == robot.nv - 1


def test_what_moves_by_itself_has_no_mobility():
    """A driven contact is no constraint at rest."""
    robot = rbd.load_robot("bolt")
    foot = robot.feet(friction=None)[0]
    driven = rbd.PointContact(foot.name, foot.frame, on=rbd.Ground(velocity=(0.1, 0.0, 0.0)))
    with pytest.raises(InputError, match="has prescribed motion"):
        mobility(robot.standing(), [driven])


def test_a_stop_that_is_just_reached_does_not_end_the_motion():
    """The last value is the stop's own: the way is complete, and nothing was beyond a limit."""
    robot = pendulum()
    robot.model.lowerPositionLimit[0], robot.model.upperPositionLimit[0] = -0.5, 0.5
    motion = trace(rbd.State(robot, np.zeros(1)), [rbd.JointLimit("stop", "crank")], joint="crank", values=(0.0, 0.5), steps=5)
    assert motion.complete and not motion.stopped_by and motion.input[-1] == 0.5 and not motion.beyond_limits


def test_a_joint_at_its_limit_is_not_beyond_it():
    """Up to 1e-9 on both sides, as the rounding of a pose that was brought there."""
    robot = pendulum()
    robot.model.lowerPositionLimit[0], robot.model.upperPositionLimit[0] = -0.5, 0.7
    for inside in (-0.5, 0.7, 0.0, -0.5 - 5e-10, 0.7 + 5e-10):
        assert beyond_limits(robot, np.array([inside])) == ()
    for outside in (-0.5 - 2e-9, 0.7 + 2e-9):
        (found,) = beyond_limits(robot, np.array([outside]))
        assert (found.joint, found.value, found.lower, found.upper) == ("crank", outside, -0.5, 0.7)


def test_the_normal_of_a_plane_is_a_unit_vector():
    """Of linkages whose hinges stand anywhere in the x-z plane, and of slides alone; a robot in space has none."""
    for robot in (rbd.mechanism.n_four_bar(3, length=0.7), rbd.mechanism.slider_crank(0.3, 0.8, offset=0.1)):
        assert np.abs(plane_normal(robot.at("assembled"))) == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
    aside = Builder("aside").joint("hinge", pin.JointModelRY(), at(2.0, 0.0, 1.0)).robot()
    assert np.abs(plane_normal(rbd.State(aside, np.zeros(1)))) == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
    assert plane_normal(rbd.load_robot("ur5").at()) is None


def test_a_velocity_that_has_no_name_is_refused():
    """A number is no joint."""
    robot, loops = four_bar(*CRANK_ROCKER)
    state = rbd.State(robot, assemble(rbd.State(robot, START), loops).q)
    with pytest.raises(rbd.RbdError, match="3"):
        velocity_partition(state, loops, {3: 1.0})


def test_where_nothing_is_redundant_no_direction_is_tried():
    """Full rank decides by itself, and is said."""
    robot, loops = four_bar(*CRANK_ROCKER)
    found = mobility(rbd.State(robot, assemble(rbd.State(robot, START), loops).q), loops)
    assert found.motion.tried == 0 and len(found.motion.points) == 1 and "J has full rank here" in str(found)


def test_a_robot_without_lengths_is_measured_in_metres():
    """Hinges in one point have no length of their own: one metre; a bar of 3 m has its own."""
    assert free(pin.JointModelRX(), pin.JointModelRY()).joints.length == 1.0
    assert four_bar(1.0, 3.0, 2.5, 3.0)[0].joints.length > 1.0


class Fleeting:
    """A row that is there at one place only."""

    name = "fleeting"

    def rows(self, state: rbd.State) -> rbd.Rows:
        """One row at zero, none elsewhere."""
        m = int(abs(state.q[0]) < 1e-9)
        return rbd.Rows(self.name, np.ones((m, 1)), np.zeros(m), rbd.problem.Free(m), error=np.zeros(m))


def test_rows_that_come_and_go_cannot_be_followed():
    """What has one row here and none beside says so, with how many there were."""
    held = ConstraintManifold(rbd.State(pendulum(), np.zeros(1)), [Fleeting()])
    with pytest.raises(InputError, match=r"change their rows near the state \(there \[1\]\)"):
        held.at(np.array([0.1]))


def test_a_velocity_of_what_has_no_inertia_cannot_be_projected():
    """A hinge without a body: no metric says which velocity is the nearest."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "empty")
    state = rbd.State(rbd.model.checked_model.CheckedModel(model, name="empty"), np.zeros(1), np.ones(1))
    with pytest.raises(rbd.errors.SingularInertia, match="M of empty is not positive definite"):
        rbd.mechanism.project_velocity(state, [rbd.JointLock("lock", "empty")])


def test_a_descent_that_is_cut_short_claims_no_minimum():
    """Bars 1, 1, 1 on a ground of 5, from a bent pose: one step is not the bottom, forty are, 2 m apart."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 5.0)
    closure = Closure(robot, loops)
    start = closure.start(np.array([0.3, 0.2, 2.5]))
    short, whole = minimise(closure, start, most=1), minimise(closure, start)
    assert not short.minimum and whole.minimum
    gaps = [float(np.linalg.norm(b.at.error)) for b in (short, whole)]
    assert np.linalg.norm(start.error) > gaps[0] > gaps[1] and gaps[1] == pytest.approx(2.0, abs=1e-9)


def test_a_direction_that_the_constraints_forbid_has_no_tangent():
    """A flat rhombus allows two directions; straight on along the third leads nowhere, along a mixture on."""
    robot, loops = four_bar(1.0, 1.0, 1.0, 1.0)
    closure = Closure(robot, loops)
    curve = PoseCurve(closure, 1e-12, 0.1)
    flat = closure.start(np.array([0.0, 0.0, 0.0]))
    allowed, forbidden = np.linalg.svd(flat.J)[2][1:], np.linalg.svd(flat.J)[2][0]
    assert np.linalg.matrix_rank(flat.J, tol=1e-9) == 1
    assert curve.point(flat, forbidden) is None and curve.point(flat, None) is None
    found = curve.point(flat, 0.9 * allowed[0] + 0.1 * forbidden)
    assert found is not None and found.singular and abs(found.tangent @ allowed[0]) == pytest.approx(1.0)


def test_a_curve_that_is_lost_within_a_step_is_told(monkeypatch):
    """Where no pose is found between the ends of a step, there is no pose to return."""
    robot, loops = four_bar(*CRANK_ROCKER)
    closure = Closure(robot, loops)
    curve = PoseCurve(closure, 1e-12, 0.1)
    start = curve.point(closure.start(assemble(rbd.State(robot, START), loops).q), None)
    assert start is not None
    step = curve.advance(start)
    half = 0.5 * (start.q[0] + step.end.q[0])
    assert curve.locate(step, lambda p: p.q[0] - half).end.q[0] == pytest.approx(half, abs=1e-12)
    monkeypatch.setattr(curve, "ahead", lambda *_: None)
    with pytest.raises(NoSolution, match="lost within a step"):
        curve.locate(step, lambda p: p.q[0] - half)
