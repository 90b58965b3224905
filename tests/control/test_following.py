"""Following a motion: feet that step, wrong masses, less friction, pushes, landings that are late; robots of all kinds."""

from __future__ import annotations

import math
import pickle
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.control import (
    AcceptedStep,
    ComTask,
    ContactSchedule,
    ContactTouch,
    FrameTask,
    PostureTask,
    Push,
    Reference,
    WholeBodyController,
    follow,
    following,
)
from rbd.errors import InputError
from rbd.model.checked_model import CheckedModel
from rbd.motion import Motion, MotionDifference, find_contacts, minimum_jerk

STEP = 4e-3
LEAVES, LANDS, END = 0.8, 1.2, 2.0
TIMES = np.linspace(0.0, 1.0, 61)


def way(t: float, begin: float, end: float) -> tuple[float, float, float]:
    """From 0 to 1 at rest, with its rate and the rate of that: a polynomial of order 5."""
    u, d = min(max((t - begin) / (end - begin), 0.0), 1.0), end - begin
    return 10 * u**3 - 15 * u**4 + 6 * u**5, 30 * (u * (1 - u)) ** 2 / d, 60 * u * (1 - u) * (1 - 2 * u) / d**2


@pytest.fixture(scope="module")
def g1() -> rbd.Robot:
    return rbd.load_robot("g1")


@pytest.fixture(scope="module")
def stepping(g1: rbd.Robot) -> Motion:
    """G1 moves its weight over its left foot, puts the right one 5 cm ahead, and moves between both: at 60 Hz."""
    state, soles = g1.standing(), g1.soles(friction=0.6)
    middle = [sole.rows(state).patch.point for sole in soles]
    over, ahead = (middle[0] - state.com) * [1.0, 0.9, 0.0], np.array([0.05, 0.0, 0.0])
    foot = state.frame(soles[1].frame).X_WF

    def com(t: float) -> Reference:
        s, back = way(t, 0.0, 0.7), way(t, 1.25, 1.9)
        return Reference(
            *((x - 0.5 * y) * over + 0.5 * y * ahead + first for x, y, first in zip(s, back, (state.com, 0, 0), strict=True))
        )

    def sole(t: float) -> Reference:
        s, up = way(t, LEAVES, LANDS), [x - y for x, y in zip(way(t, LEAVES, 1.0), way(t, 1.0, LANDS), strict=True)]
        p, v, a = (x * ahead + np.array([0.0, 0.0, 0.04 * z]) for x, z in zip(s, up, strict=True))
        return Reference(pin.SE3(foot.rotation, foot.translation + p), np.r_[v, 0, 0, 0], np.r_[a, 0, 0, 0])

    tasks = [
        ComTask(com, cost=1000.0),
        FrameTask(soles[1].frame, sole, position_cost=100.0, orientation_cost=100.0, gain=900.0),
        FrameTask("pelvis", state.frame("pelvis").X_WF.rotation, orientation_cost=10.0),
        PostureTask(state, cost=0.3),
    ]
    schedule = ContactSchedule({soles[1].name: [(-math.inf, LEAVES), (LANDS, math.inf)]}, fade=0.04)
    maker = WholeBodyController(tasks, soles, schedule=schedule)
    made = rbd.simulate(state, soles, duration=END, step=STEP, controller=maker, progress=False)
    motion = Motion.of_trajectory(made).resample(60.0).filtered(15.0)
    times = [[(0.0, END)], [(0.0, LEAVES), (LANDS, END)]]
    return motion.with_contacts(find_contacts(motion).of([each.name for each in soles], times))


def followed(
    motion: Motion, *, floor: float = 0.7, external: object = None, duration: float | None = None, **given: object
) -> MotionDifference:
    """How far a simulation is from its motion."""
    controller, feet = follow(motion, **given), motion.robot.feet(friction=floor)  # type: ignore[attr-defined, arg-type]
    run = rbd.simulate(
        motion.state(0), feet, duration=duration or motion.duration, step=0.5 * STEP, controller=controller, external=external,  # type: ignore[arg-type]
        progress=False,
    )  # fmt: skip
    assert (run.robot.torque_use(run.tau[-1], run.v[-1]) <= 1.0 + 1e-9).all()
    return MotionDifference.of(run, motion)


def scaled(robot: CheckedModel, factor: float) -> CheckedModel:
    """The robot with other masses."""
    model = robot.model.copy()
    for i, body in enumerate(robot.model.inertias):
        model.inertias[i] = pin.Inertia(factor * body.mass, body.lever, factor * body.inertia)
    return CheckedModel(model, name=f"{factor:g} {robot.name}")


@pytest.mark.parametrize(("floor", "factor", "most"), [(0.7, None, 5e-3), (0.6, 1.05, 0.03), (0.6, 0.95, 0.03)])
def test_a_step_is_followed_with_wrong_masses_and_less_friction(
    g1: rbd.Robot, stepping: Motion, floor: float, factor: float | None, most: float
) -> None:
    """To its end, the base within 5 mm, with masses 5 % wrong within 30 mm, the feet within 10 mm."""
    off = followed(stepping, floor=floor, robot=None if factor is None else scaled(g1, factor))
    assert off.left_out < STEP
    assert np.linalg.norm(off.base, axis=1).max() < most
    assert max(x.max() for x in off.feet.values()) < 0.01
    assert off.joint_rms < 0.05


@pytest.mark.parametrize(("force", "start"), [((0.0, 60.0, 0.0), 0.3), ((-60.0, 0.0, 0.0), 0.85)])
def test_a_push_is_taken_up(stepping: Motion, force: tuple[float, float, float], start: float) -> None:
    """3 N s to the side while the weight shifts, or backwards on one foot: at the end nothing is left of it."""
    push = Push("torso_link", force, start=start, duration=0.05)
    still, pushed = followed(stepping), followed(stepping, external=push)
    assert 0.01 < np.linalg.norm(pushed.base, axis=1).max() < 0.06
    assert np.linalg.norm(pushed.base[-1]) < np.linalg.norm(still.base[-1]) + 0.015


@pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")
def test_a_foot_that_lands_late_goes_on_downwards(stepping: Motion, monkeypatch: pytest.MonkeyPatch) -> None:
    """A motion whose foot stays 4 mm above the floor touches all the same; with a target that stays it does not."""
    rises = np.array([0.004 * way(t, LEAVES, 1.0)[0] for t in stepping.t])
    q, robot = stepping.q.copy(), stepping.robot
    foot = rbd.State(robot, q[0]).robot.model.getFrameId("right_ankle_roll_link")
    knee, hip, ankle = (robot.joints[f"right_{name}_joint"] for name in ("knee", "hip_pitch", "ankle_pitch"))
    for i, rise in enumerate(rises):  # a bent knee lifts the foot, which stays level
        for _ in range(4):
            data = robot.model.createData()
            pin.computeJointJacobians(robot.model, data, q[i])
            pin.updateFramePlacements(robot.model, data)
            J = pin.getFrameJacobian(robot.model, data, foot, pin.LOCAL_WORLD_ALIGNED)[[0, 2, 4]]
            pin.framesForwardKinematics(robot.model, data, stepping.q[i])
            wanted = data.oMf[foot].translation[[0, 2]] + [0.0, rise]
            R = data.oMf[foot].rotation.copy()
            pin.framesForwardKinematics(robot.model, data, q[i])
            turn = pin.log3(R @ data.oMf[foot].rotation.T)[1]
            columns = [j.v.start for j in (knee, hip, ankle)]
            dq = np.linalg.solve(J[:, columns], [*(wanted - data.oMf[foot].translation[[0, 2]]), turn])
            for j, each in zip((knee, hip, ankle), dq, strict=True):
                q[i, j.q.start] += each
    late = Motion.of_arrays(robot, stepping.t, q).with_contacts(stepping.contacts)

    def touches() -> float:
        controller, feet = follow(late), robot.feet(friction=0.7)  # type: ignore[attr-defined]
        rbd.simulate(late.state(0), feet, duration=1.6, step=STEP, controller=controller, progress=False)
        log = controller.log
        return float(log.touching["right_sole"][log.t > LANDS].mean())

    assert touches() > 0.5
    monkeypatch.setattr(following, "SINKS", 0.0)
    assert touches() == 0.0


@pytest.mark.filterwarnings("ignore::rbd.errors.InaccurateWarning")
def test_heels_rise_and_come_back(g1: rbd.Robot) -> None:
    """G1, its weight over both toes, turns its soles by 11 degrees about their front edges and back, to 1 mm."""
    state, soles = g1.standing(), g1.soles(friction=0.7)
    ahead, tilts = soles[0].corners[:, 0].max(), [0.2 * (way(t, 0.1, 0.45)[0] - way(t, 0.55, 0.9)[0]) for t in TIMES]
    flat = [state.frame(sole.frame).X_WF * sole.placement * pin.SE3(np.eye(3), np.array([ahead, 0, 0])) for sole in soles]
    flat[1].translation[0] -= 0.15  # feet side by side would stand on one line
    middle, q = 0.5 * (flat[0].translation + flat[1].translation), [state.q]
    for tilt in tilts:
        turned = pin.SE3(pin.exp3(np.array([0.0, tilt, 0.0])), np.zeros(3)) * pin.SE3(np.eye(3), np.array([-ahead, 0, 0]))
        com = middle + [0.0, 0.0, state.com[2] - 0.01 + 0.5 * ahead * math.sin(tilt)]
        places = {sole.name: X * turned for sole, X in zip(soles, flat, strict=True)}
        q.append(rbd.find_pose(g1, places, com=com, posture=g1.at(q[-1])).state.q)
    motion = Motion.of_arrays(g1, TIMES, np.array(q[1:])).filtered(10.0)
    lanes, on = find_contacts(motion), np.array(tilts) > 1e-3
    for sole in soles:
        for k, corner in enumerate(sole.corners):
            lanes = lanes.with_touch(f"{sole.name} {k + 1}", 0.0, 1.0)
            if corner[0] < ahead:
                lanes = lanes.with_touch(f"{sole.name} {k + 1}", TIMES[on][0], TIMES[on][-1], touches=False)
    motion = motion.with_contacts(lanes)
    assert rbd.check_motion(motion, progress=False).share_possible == 1.0
    off = followed(motion)
    assert off.turn.max() < 5e-3
    assert max(far.max() for far in off.feet.values()) < 1e-3
    assert [which for _, _, which in follow(motion).schedule.parts["left_sole"]] == [(0, 3)]


def test_targets_are_the_motion_and_its_rates(stepping: Motion) -> None:
    """Velocities and accelerations of all targets are differences of their values, between samples too."""
    controller, h = follow(stepping), 1e-4
    targets = {task.name: task.target for task in controller.tasks}  # type: ignore[attr-defined]
    for t in (0.3141, 1.0123, 1.7):
        for name in ("com", "right_sole"):
            before, now, after = (targets[name](t + x) for x in (-h, 0.0, h))
            p = [r.value if name == "com" else r.value.translation for r in (before, now, after)]
            assert now.velocity[:3] == pytest.approx((p[2] - p[0]) / (2 * h), abs=2e-3)
            assert now.acceleration[:3] == pytest.approx((after.velocity - before.velocity)[:3] / (2 * h), abs=0.3)
    after = targets["posture"](99.0)
    assert after.value == pytest.approx(stepping.q[-1], abs=1e-12)
    assert not after.velocity.any()


def test_a_target_sinks_by_a_centimetre_at_most(stepping: Motion) -> None:
    """50 mm/s from 30 ms before the touchdown."""
    controller = follow(stepping)
    target = next(task.target for task in controller.tasks if task.name == "right_sole")  # type: ignore[attr-defined]
    times = LANDS - 0.05, LANDS + 0.07, LANDS + 0.27, LANDS + 0.47
    times = tuple(round(60 * t) / 60 for t in times)
    height = [float(target(t).value.translation[2]) for t in times]
    own = [float(stepping.state(int(round(60 * t))).frame("right_ankle_roll_link").X_WF.translation[2]) for t in times]
    below = np.subtract(height, own)
    assert below - below[0] == pytest.approx([0.0, -0.005, -0.01, -0.01], abs=5e-4)


def test_feet_that_change_in_an_instant_overlap() -> None:
    """One that leaves as, or shortly before, the next lands stays for a fade more; not before a flight, nor on two feet."""
    left, right = [(-math.inf, 1.0), (2.0, 3.0)], [(1.02, 2.5), (3.5, math.inf)]
    found = following.bridged({"left": left, "right": right})
    assert found["left"] == [(-math.inf, pytest.approx(1.05)), (2.0, 3.0)]
    assert found["right"] == right


def test_the_motion_begins_with_the_simulation(stepping: Motion) -> None:
    """A clip whose times begin later is followed as one that begins at zero: its state has its time."""
    later = stepping.robot, stepping.t + 8.0, stepping.q, stepping.v, stepping.a
    moved = Motion.of_arrays(*later)
    lanes = find_contacts(moved).of(
        ["left_sole", "right_sole"], [[(8.0, 8.0 + END)], [(8.0, 8.0 + LEAVES), (8.0 + LANDS, 8.0 + END)]]
    )
    one, other = (followed(m, duration=0.1) for m in (stepping, moved.with_contacts(lanes)))
    assert np.abs(one.joints - other.joints).max() < 1e-6


def test_the_same_bits_again_and_in_another_process(stepping: Motion) -> None:
    """A controller that was used, and one that was pickled, give what a fresh one gives."""
    controller = follow(stepping)
    again = pickle.loads(pickle.dumps(controller))
    runs = [
        rbd.simulate(stepping.state(0), controller.contacts, duration=0.05, step=STEP, controller=each, progress=False)
        for each in (controller, controller, again)
    ]
    assert all(np.array_equal(runs[0].q, run.q) for run in runs[1:])


def test_a_quadruped_on_points_and_an_arm_are_followed() -> None:
    """Solo12 lowers its trunk by 3 cm; a UR5 without contacts moves all its joints."""
    solo = rbd.load_robot("solo12")
    state = solo.standing()
    places = {foot.name: tuple(foot.rows(state).patch.point) for foot in solo.feet()}
    poses = [
        rbd.find_pose(solo, places, com=state.com - [0.0, 0.0, z], posture=state).state.q
        for z in (0.0, 0.015, 0.03, 0.015, 0.0)
    ]
    crouch = minimum_jerk(solo, poses, [0.0, 0.2, 0.4, 0.6, 0.8])
    off = followed(crouch.with_contacts(find_contacts(crouch)))
    assert np.abs(off.base).max() < 3e-3
    arm = rbd.load_robot("ur5", root="fixed")
    swing = minimum_jerk(arm, [arm.at().q, arm.at().q + 0.3], [0.0, 0.4])
    run = rbd.simulate(swing.state(0), duration=0.4, step=STEP, controller=follow(swing), progress=False)
    assert np.abs(MotionDifference.of(run, swing).joints).max() < 5e-3


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda m: follow(m.with_contacts(None)), "has no contacts.*find_contacts.*repaired"),
        (lambda m: follow("dance.csv"), "expected an rbd.Motion"),
        (lambda m: follow(m, robot=rbd.load_robot("solo12")), "different joints"),
        (lambda m: follow(m, robot=3), "robot of follow"),
        (lambda m: follow(m, friction=0.0), "friction of follow"),
        (lambda m: follow(m, every=0.1), "longer than the horizon"),
        (lambda m: follow(lying(m)), "feet alone"),
    ],
)
def test_what_cannot_be_followed(stepping: Motion, spoil: Callable[[Motion], object], words: str) -> None:
    """Each says what came, and what to do."""
    with pytest.raises(InputError, match=words):
        spoil(stepping)


def lying(motion: Motion) -> Motion:
    """The same robot on its back."""
    q = motion.q[0].copy()
    q[2:7] = 0.05, 0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)
    lies = minimum_jerk(motion.robot, [q, q], [0.0, 0.2])
    return lies.with_contacts(find_contacts(lies, bodies=True))


def test_a_trajectory_is_compared_with_its_reference(stepping: Motion) -> None:
    """Between frames by cubics; a base and feet that are 1 mm off are 1 mm off; one that is longer is refused."""
    off = MotionDifference.of(stepping.cut(0.5, 1.0), stepping.cut(0.5))
    assert off.joint_rms < 1e-12
    assert all(far.max() < 1e-12 for far in off.feet.values())
    up = MotionDifference.of(stepping.lifted(1e-3), stepping)
    assert [far.max() for far in up.feet.values()] == pytest.approx([1e-3, 1e-3])
    assert "left_sole                         1.0 mm" in str(up)
    with pytest.raises(InputError, match="goes on for 0.500 s"):
        MotionDifference.of(stepping, stepping.cut(0.0, END - 0.5))


def test_a_tilted_sole_comes_back_onto_the_floor(g1: rbd.Robot) -> None:
    """A step of control turns a sole that stands on its edge as a critically damped oscillator, e'' = -25^2 e, at rest."""
    state, soles = g1.standing(), g1.soles(friction=0.7)
    tilted = state.with_joints({"right_ankle_roll_joint": state.q[g1.joints["right_ankle_roll_joint"].q][0] + 0.03})
    controller = WholeBodyController([PostureTask(state, cost=1e-3)], soles)
    touching = {
        sole.name: ContactTouch(np.zeros(4), np.array([True, True, flat, flat]), np.zeros((4, 3)))
        for sole, flat in zip(soles, (True, False), strict=True)
    }
    controller.accepted(AcceptedStep(tilted, 0.0, STEP, touching))
    turned = tilted.frame(soles[1].frame)
    assert controller.log.disagreements["right_sole"]["partial"] == 1
    assert (turned.J @ controller.actuation.a + turned.bias)[3] == pytest.approx(-0.03 * 25.0**2, rel=1e-3)
