"""Timings along a path: against closed forms, a dense search and a second judge; what they keep to; why there is none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import rbd
from rbd.errors import InputError, NoSolution
from rbd.motion import Motion, check_motion, find_contacts, find_timing, minimum_jerk, retimed
from rbd.motion.retiming.passes import CHECKED

GRAVITY = 9.81


def slider(base: str, mass: float, height: float, force: float = 1e3) -> str:
    """A mass that slides along x over a base."""
    return f"""<robot name="slider"><link name="base">{base}</link><link name="mass"><inertial><mass value="{mass}"/>
    <inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="slide" type="prismatic">
    <parent link="base"/><child link="mass"/><origin xyz="0 0 {height}"/><axis xyz="1 0 0"/>
    <limit lower="-9" upper="9" effort="{force}" velocity="100"/></joint></robot>"""


def plate(half: float, mass: float) -> str:
    """A flat base, 2 half long and wide, 2 cm thick."""
    size = f"{2.0 * half} {2.0 * half} 0.02"
    inertia = "".join(f'{axis}="{0.1 * mass * half**2}" ' for axis in ("ixx", "iyy", "izz"))
    return (
        f'<inertial><mass value="{mass}"/><inertia {inertia} ixy="0" ixz="0" iyz="0"/></inertial>'
        f'<collision><geometry><box size="{size}"/></geometry></collision>'
    )


def along(robot: rbd.Robot, begin: float, end: float, n: int = 61) -> Motion:
    """The slider from one place to another in a second, at constant speed."""
    t = np.linspace(0.0, 1.0, n)
    q, v = np.zeros((n, robot.nq)), np.zeros((n, robot.nv))
    if robot.floating:
        q[:, 2], q[:, 6] = 0.01, 1.0
    q[:, -1], v[:, -1] = begin + (end - begin) * t, end - begin
    return Motion.of_arrays(robot, t, q, v, np.zeros((n, robot.nv)), quaternion="xyzw", trust=True)


REST = {"start": 0.0, "end": 0.0}


def test_a_mass_on_a_line_takes_bang_bang_time() -> None:
    """From rest to rest over d with forces up to F: 2 sqrt(d m / F), half of it forwards, half backwards."""
    robot = rbd.load_robot(text=slider("", 2.0, 0.0, 8.0), root="fixed")
    timing = find_timing(along(robot, 0.0, 3.0), fastest=10.0, **REST)
    assert abs(timing.duration - 2.0 * math.sqrt(3.0 * 2.0 / 8.0)) < 1e-9
    assert timing.between < 1e-9 and set(timing.causes) == {"motor of slide"}
    motion = timing.motion()
    assert np.abs(np.abs(2.0 * motion.a[:-1]) - 8.0).max() < 1e-9
    assert motion.q[-1, 0] == pytest.approx(3.0) and not motion.v[-1].any()
    half = find_timing(along(robot, 0.0, 3.0), fastest=10.0, torque_limits=0.25, **REST)
    assert half.duration == pytest.approx(2.0 * timing.duration, rel=1e-9)


def test_a_speed_limit_cuts_the_peak_off() -> None:
    """With |v| <= V: d / V + V m / F; a thousandth of V is spared."""
    robot = rbd.load_robot(text=slider("", 2.0, 0.0, 8.0).replace('velocity="100"', 'velocity="2"'), root="fixed")
    timing = find_timing(along(robot, 0.0, 3.0, 241), fastest=10.0, **REST)
    V = 2.0 * (1.0 - 1e-3)
    assert timing.duration == pytest.approx(3.0 / V + V * 2.0 / 8.0, rel=1e-3)
    assert "speed limit of slide" in timing.causes
    free = find_timing(along(robot, 0.0, 3.0), fastest=10.0, speed_limits=False, **REST)
    assert free.duration == pytest.approx(math.sqrt(3.0), rel=1e-9)


def test_a_pendulum_arm_takes_the_time_of_its_energy() -> None:
    """Forwards with +tau, backwards with -tau: d(I w^2 / 2) = (+-tau - m g l sin q) dq, and the time is that of dq / w."""
    robot = rbd.load_robot(
        text='<robot name="arm"><link name="base"/><link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="1.5"/>'
        '<inertia ixx="1e-9" iyy="1e-9" izz="1e-9" ixy="0" ixz="0" iyz="0"/></inertial></link>'
        '<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 -1 0"/>'
        '<limit lower="-3" upper="3" effort="9" velocity="99"/></joint></robot>',
        root="fixed",
    )
    m, l, tau, a, b = 1.5, 0.5, 9.0, -0.6, 1.4  # noqa: E741
    inertia, weight = m * l**2 + 1e-9, m * GRAVITY * l
    forwards = lambda q: 2.0 / inertia * (tau * (q - a) + weight * (math.cos(q) - math.cos(a)))  # noqa: E731
    backwards = lambda q: 2.0 / inertia * (tau * (b - q) + weight * (math.cos(q) - math.cos(b)))  # noqa: E731
    turn = brentq(lambda q: forwards(q) - backwards(q), a, b)
    # q = a + y^2 and b - y^2 take the roots out of the ends
    first = quad(lambda y: 2.0 * y / math.sqrt(forwards(a + y * y)) if y else 0.0, 0.0, math.sqrt(turn - a))[0]
    second = quad(lambda y: 2.0 * y / math.sqrt(backwards(b - y * y)) if y else 0.0, 0.0, math.sqrt(b - turn))[0]
    errors = []
    for n in (61, 241):
        timing = find_timing(along(robot, a, b, n), fastest=20.0, **REST)
        errors.append(timing.duration / (first + second) - 1.0)
        assert timing.between < 3e-3
    assert -1e-3 < errors[1] < errors[0] < 1e-2 and errors[1] < 3e-3
    motion = timing.motion()
    needed = [rbd.State(robot, q).M[0, 0] * a_[0] + weight * math.sin(q[0]) for q, a_ in zip(motion.q, motion.a, strict=True)]
    assert np.abs(needed).max() < tau * (1.0 + 2e-3)


def test_friction_under_a_plate_decides_how_fast_a_mass_slides_on_it() -> None:
    """The plate holds if m a <= mu (M + m) g."""
    robot = rbd.load_robot(text=slider(plate(0.5, 1.0), 4.0, 0.0))
    timing = find_timing(along(robot, -0.2, 0.2), fastest=20.0, friction=0.2, **REST)
    exact = 2.0 * math.sqrt(0.4 * 4.0 / (0.2 * 5.0 * GRAVITY))
    assert timing.duration == pytest.approx(exact, rel=5e-3)
    assert timing.shares()["friction"] > 0.9
    ice = find_timing(along(robot, -0.2, 0.2), fastest=20.0, friction=0.02, **REST)
    assert ice.duration == pytest.approx(math.sqrt(10.0) * exact, rel=2e-2)
    assert check_motion(timing.motion(), friction=0.2, self_collision=False).share_possible == 1.0


def test_a_mass_above_a_small_plate_is_as_fast_as_its_zero_moment_point_allows() -> None:
    """The point p - h p'' / g stays within +-b: from -c, at rest, to c the time is 2 / w acosh(b / (b - c)), w^2 = g / h."""
    h, half, c = 0.8, 0.1, 0.07
    robot = rbd.load_robot(text=slider(plate(half, 0.5), 5.0, h - 0.01))
    b = half * 5.5 / 5.0  # the plate's weight helps
    exact = 2.0 / math.sqrt(GRAVITY / h) * math.acosh(b / (b - c))
    timing = find_timing(along(robot, -c, c, 121), fastest=20.0, **REST)
    assert timing.duration == pytest.approx(exact, rel=1e-2)
    assert timing.shares().get("tips", 0.0) > 0.9
    assert check_motion(timing.motion(), self_collision=False).share_possible == 1.0


def test_an_arm_is_as_fast_as_a_dense_search_finds() -> None:
    """Dynamic programming over paces on a fine grid, with torques by inverse dynamics in each step."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[0.5, 0.4]), masses=[1.0, 0.8])
    arm = arm.with_motors({name: rbd.Motor(limit=limit) for name, limit in zip(arm.actuated_names, (11.0, 5.0), strict=True)})
    motion = minimum_jerk(arm, [np.array([0.2, -0.4]), np.array([1.6, 0.9])], [0.0, 1.0], rate=40.0).cut(0.2, 0.8)
    motion = replace(motion, t=motion.t - motion.t[0])
    timing = find_timing(motion, fastest=4.0, **REST)
    x = np.linspace(0.0, 2.0, 161) ** 2
    cost = np.where(x == 0.0, 0.0, np.inf)
    for i in range(motion.n - 2, -1, -1):
        h = motion.t[i + 1] - motion.t[i]
        u = np.subtract.outer(x, x).T / (2.0 * h)  # from row to column
        fits = np.ones(u.shape, bool)
        for share, k in ((0.0, i), (1.0, i + 1)):
            here = x[:, None] + 2.0 * h * share * u
            state = rbd.State(arm, motion.q[k])
            unit, bias = state.M @ motion.v[k], state.M @ motion.a[k] + rbd.State(arm, motion.q[k], motion.v[k]).h - state.h
            tau = state.h + u[..., None] * unit + here[..., None] * bias
            fits &= (np.abs(tau) <= arm.effort_limit).all(axis=2)
        with np.errstate(divide="ignore"):
            time = 2.0 * h / np.add.outer(np.sqrt(x), np.sqrt(x))
        cost = np.where(fits, time + cost[None, :], np.inf).min(axis=1)
    assert timing.duration < cost[0] * (1.0 + 1e-3)
    assert timing.duration == pytest.approx(cost[0], rel=3e-2)  # the search's paces are 0.0125 to 0.06 apart


@pytest.fixture(scope="module")
def swing(g1: rbd.Robot) -> Motion:
    """Raises its arms, then leans: tips at this speed."""
    stands = g1.standing().q
    raises, leans = stands.copy(), stands.copy()
    for side in ("left", "right"):
        raises[g1.joints[f"{side}_shoulder_pitch_joint"].q] = -1.5
    leans[g1.joints["waist_pitch_joint"].q] = 0.5
    return minimum_jerk(g1, [stands, raises, leans, stands], [0.0, 0.8, 1.4, 2.2], rate=30.0)


def test_a_motion_that_tips_is_slowed_where_it_tips_and_is_possible_then(swing: Motion) -> None:
    """The least slowed timing is the motion's own elsewhere."""
    before = check_motion(swing, self_collision=False)
    timing = find_timing(swing)
    after = check_motion(timing.motion(), self_collision=False)
    assert before.share_possible < 0.95 and after.share_possible == 1.0
    assert timing.duration < 1.1 * swing.duration and timing.pace.max() <= 1.0 + 1e-9
    assert timing.shares()["fastest"] > 0.6 and sum(timing.shares().values()) == pytest.approx(1.0)
    assert "retimed from 2.2 to" in timing.motion().notes[-1] and timing.between < 3e-3
    new = timing.motion()
    Motion.of_arrays(swing.robot, new.t, new.q, new.v, new.a, quaternion="xyzw")  # v and a are the rates of q, or it is refused
    fast = find_timing(swing, fastest=3.0)
    assert fast.duration < 0.8 * swing.duration
    assert check_motion(fast.motion(60.0), self_collision=False).share_possible == 1.0  # at 30 Hz arms jump


def test_the_sets_of_paces_are_those_that_the_check_calls_possible(swing: Motion) -> None:
    """A dense search: s'' and s'^2 on a grid at a few frames, each judged by `check_motion` and by the set."""
    timing = find_timing(swing, fastest=3.0)
    lanes = timing.sets.lanes
    assert lanes is not None
    seen = [0, 0]
    for frame in (0, 12, 33, 52):
        u, x = (each.ravel() for each in np.meshgrid(np.linspace(-30.0, 30.0, 9), np.linspace(0.0, 6.0, 9)))
        own = timing.sets.at(np.array([float(frame)]))[0]
        found = np.array([own.separate(np.array(p)) for p in zip(u, x, strict=True)])
        q1, q2 = swing.v[frame], swing.a[frame]
        v = np.sqrt(x)[:, None] * q1
        a = u[:, None] * q1 + x[:, None] * q2
        t = np.arange(len(u)) / 30.0
        these = Motion.of_arrays(swing.robot, t, np.tile(swing.q[frame], (len(u), 1)), v, a, quaternion="xyzw", trust=True)
        same = replace(lanes.at_frames(np.full(len(u), frame)), t=t)
        report = check_motion(these, contacts=same, threshold=1e-3, self_collision=False)
        fast = x * (np.abs(q1[6:]) / swing.robot.model.velocityLimit[6:]).max() ** 2
        bad = (report.missing_scaled > 0.02) | (report.excess > 0.02).any(axis=1) | (fast > 1.01)
        good = (report.missing_scaled < 1e-6) & ~report.excess.any(axis=1) & (fast < 0.99)
        assert (found[bad] > 1e-3).all() and (found[good] < 1e-3).all()
        seen = [seen[0] + int(bad.sum()), seen[1] + int(good.sum())]
    assert min(seen) > 40


def test_a_possible_motion_comes_back_unchanged(g1: rbd.Robot) -> None:
    """Also with contacts that were given."""
    stands = g1.standing().q
    raises = stands.copy()
    raises[g1.joints["left_elbow_joint"].q] += 0.3
    motion = minimum_jerk(g1, [stands, raises], [0.0, 0.8], rate=30.0)
    assert retimed(motion) is motion
    lanes = find_contacts(motion)
    again = retimed(motion, contacts=lanes)
    assert np.array_equal(again.q, motion.q) and again.contacts is lanes and check_motion(again).share_possible == 1.0


def test_arms_drawn_at_random_keep_to_their_limits_between_the_points_too() -> None:
    """At 400 Hz torques and speeds exceed limits by no more than `between`; no constant pace that is possible is faster."""
    rng, seen = np.random.default_rng(5), 0
    for _ in range(24):
        k = int(rng.integers(1, 4))
        chain = rbd.planar.Chain(k, lengths=list(rng.uniform(0.2, 0.6, k)))
        arm = rbd.planar.to_robot(chain, masses=list(rng.uniform(0.3, 2.0, k)))
        motors = [rbd.Motor(limit=limit, speed_limit=speed) for limit, speed in rng.uniform([10.0, 2.0], [60.0, 20.0], (k, 2))]
        arm = arm.with_motors(dict(zip(arm.actuated_names, motors, strict=True)))
        poses = list(rng.uniform(-2.0, 2.0, (3, k)))
        motion = minimum_jerk(arm, poses, np.append(0.0, np.cumsum(0.05 * rng.integers(4, 20, 2))), rate=20.0)
        pace = float(rng.choice([1.0, 3.0]))
        try:
            timing = find_timing(motion, fastest=pace)
        except NoSolution:  # only where a pose cannot be held
            held = [rbd.State(arm, q).h / arm.effort_limit for q in motion.resample(200.0).q]
            assert np.abs(held).max() > 0.999
            continue
        seen += 1
        made = timing.motion(400.0)
        data = arm.model.createData()

        def use(m: Motion, by: float = 1.0, robot: rbd.Robot = arm, data: pin.Data = data) -> float:
            tau = [pin.rnea(robot.model, data, *each) for each in zip(m.q, by * m.v, by**2 * m.a, strict=True)]
            return max(
                np.abs(tau / robot.effort_limit).max(), np.abs(by * m.v / robot.model.velocityLimit).max() * (1.0 + 1e-3)
            )

        assert use(made) < 1.0 + 1e-4 + timing.between and timing.between <= 3e-3
        constant = [by for by in np.linspace(0.05, pace, 40) if use(motion, by) <= 1.0]
        assert timing.duration < motion.duration / max(constant, default=1e-9) * (1.0 + 1e-3)
    assert seen > 12


def hop(robot: rbd.Robot) -> Motion:
    """From the apex of one flight to the floor: nothing touches, and it falls."""
    t = np.linspace(0.0, 0.2, 13)
    q, v, a = np.tile(robot.standing().q, (13, 1)), np.zeros((13, robot.nv)), np.zeros((13, robot.nv))
    q[:, 2] += 0.5 - 0.5 * GRAVITY * t**2
    v[:, 2], a[:, 2] = -GRAVITY * t, -GRAVITY
    return Motion.of_arrays(robot, t, q, v, a, quaternion="xyzw", trust=True)


def test_a_flight_keeps_its_pace() -> None:
    """Nothing but gravity acts: s' is 1, whatever is asked for."""
    motion = hop(rbd.load_robot("solo12"))
    timing = find_timing(motion, fastest=3.0)
    assert np.abs(timing.pace - 1.0).max() < 2e-3
    with pytest.raises(NoSolution, match=r"no timing is at rest at 0 s \(frame 0\): floats"):
        find_timing(motion, start=0.0)
    with pytest.raises(NoSolution, match="no timing"):
        find_timing(motion, fastest=0.5, start=0.5, end=0.5)


def test_a_pose_that_no_timing_makes_possible_is_named_with_its_causes(g1: rbd.Robot) -> None:
    """Frame, time, and what is in the way at rest."""
    stands = g1.standing().q
    leans = stands.copy()
    leans[g1.joints["waist_pitch_joint"].q] = 0.5
    leans[g1.joints["left_hip_pitch_joint"].q] -= 0.6
    leans[g1.joints["right_hip_pitch_joint"].q] -= 0.6
    motion = minimum_jerk(g1, [stands, leans], [0.0, 1.0], rate=20.0)
    lanes = find_contacts(motion).of(("left_sole", "right_sole"), [[(0.0, 1.0)], [(0.0, 1.0)]])
    with pytest.raises(NoSolution, match=r"no timing makes the pose at \S+ s \(frame \S+\) possible: even at rest, .*tips"):
        retimed(motion, contacts=lanes)
    with pytest.raises(NoSolution, match="even at rest, motor of .*_joint, [0-9]+ % of its limit"):
        retimed(minimum_jerk(g1, [stands, stands + 0.0], [0.0, 0.2]), torque_limits=0.01)
    arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    arm = arm.with_motors({arm.actuated_names[0]: rbd.Motor(limit=2.0)})
    with pytest.raises(NoSolution, match=r"even at rest, motor of .*, 4\.905 of 2 N m"):
        retimed(minimum_jerk(arm, [np.array([-1.5]), np.array([0.0])], [0.0, 1.0]))


def test_a_start_that_is_too_fast_is_said_with_the_fastest_one() -> None:
    """A mass that would have to stop within the path: v^2 = 2 a d."""
    robot = rbd.load_robot(text=slider("", 2.0, 0.0, 8.0), root="fixed")
    motion = along(robot, 0.0, 1.0)
    most = math.sqrt(2.0 * 8.0 / 2.0)  # of a unit of s
    with pytest.raises(NoSolution, match=rf"no timing begins with s' = 4: only from 0 to {most:.3f}.*Try start={most:.3g}"):
        find_timing(motion, fastest=10.0, start=4.0, end=0.0)
    assert find_timing(motion, fastest=10.0, start=most - 1e-9, end=0.0).duration == pytest.approx(2.0 / most, rel=1e-6)


def test_contacts_are_carried_along(g1: rbd.Robot, swing: Motion) -> None:
    """Lanes of the new motion: touches by frames around, places and heights of the new poses."""
    lanes = find_contacts(swing).with_touch("left_sole 1", 0.5, 1.0, False)
    new = find_timing(swing, contacts=lanes, start=1.0).motion()
    assert new.contacts is not None and np.array_equal(new.contacts.t, new.t)
    assert np.abs(new.contacts.heights).max() < 1e-3
    gone = new.t[~new.contacts.touches[:, list(lanes.names).index("left_sole 1")]]
    timing = find_timing(swing, contacts=lanes)
    ends = np.interp([0.5, 1.0], timing.s, timing.t)
    assert abs(gone[0] - ends[0]) < 0.04 and abs(gone[-1] - ends[1]) < 0.04
    assert timing.motion(120.0).rate == pytest.approx(120.0)


def test_steps_keep_to_the_sets_at_ends_and_middle(swing: Motion) -> None:
    """Each step of the grid, by the set's own programs."""
    timing = find_timing(swing, fastest=2.0)
    h, x = np.diff(timing.s), timing.pace[:-1] ** 2
    for share in CHECKED:
        places = timing.places[:-1] + share * np.diff(timing.places)
        p = np.stack([timing.rise, x + 2.0 * h * share * timing.rise], axis=1)
        assert timing.sets.separate(places, p).max() < 1.1e-4
    t = np.linspace(timing.t[0], timing.t[-1], 501)
    s, pace, _ = timing.at(t)
    assert np.abs(np.gradient(s, t)[2:-2] - pace[2:-2]).max() < 0.05
    assert s[0] == timing.s[0] and abs(s[-1] - timing.s[-1]) < 1e-9


def faster(motion: Motion, times: float) -> Motion:
    """The same path, so many times as fast, on the same contacts."""
    t = motion.t / times
    lanes = find_contacts(motion)
    made = Motion.of_arrays(motion.robot, t, motion.q, motion.v * times, motion.a * times**2, quaternion="xyzw", trust=True)
    return made.with_contacts(replace(lanes, t=t, slides=np.zeros_like(lanes.slides)))


def test_a_walk_that_is_too_fast_is_slowed_step_by_step(four_steps: rbd.Trajectory) -> None:
    """Contacts change on the way: half of the frames are possible at one and a half times the speed, all once it is retimed."""
    walk = faster(Motion.of_trajectory(four_steps).resample(60.0), 1.5)
    assert check_motion(walk, self_collision=False).share_possible < 0.6
    timing = find_timing(walk)
    after = check_motion(timing.motion(), self_collision=False)
    assert after.share_possible > 0.98 and timing.duration < 1.2 * walk.duration
    # the walk as it was is a timing of this path, so the least slowed one is no slower
    assert timing.duration < four_steps.t[-1] - four_steps.t[0]


def test_a_quadruped_that_leans_too_fast_is_slowed() -> None:
    """Solo12, its base to and fro over its feet."""
    solo = rbd.load_robot("solo12")
    standing, frames = solo.standing(), [foot.frame for foot in solo.feet()]
    goals = [standing.frame(name).X_WF.translation for name in frames]

    def leaning(t: float) -> np.ndarray:
        state, base = standing, standing.q[:3] + [0.05 * math.sin(2.0 * math.pi * t / 0.3) ** 2, 0.0, -0.03]
        for _ in range(30):
            J = np.concatenate([*(state.frame(name).J[:3] for name in frames), np.eye(solo.nv)[:6]])
            feet = [goal - state.frame(name).X_WF.translation for name, goal in zip(frames, goals, strict=True)]
            R = state.base_pose().rotation
            off = np.concatenate([*feet, R.T @ (base - state.q[:3]), -pin.log3(R)])
            state = rbd.State(solo, pin.integrate(solo.model, state.q, np.linalg.lstsq(J, off, rcond=1e-9)[0]))
        return state.q

    motion = Motion.from_function(solo, leaning, np.linspace(0.0, 0.3, 19))
    timing = find_timing(motion)
    before, after = (check_motion(each, self_collision=False) for each in (motion, timing.motion()))
    balance = [
        np.array([r.of_cause(c) for c in ("floats", "friction", "tips", "motor")]).any(axis=0).mean() for r in (before, after)
    ]
    assert balance[0] > 0.3 and balance[1] < 0.05


def test_the_largest_pace_of_a_point_is_a_bound_and_is_reached(swing: Motion) -> None:
    """Above the timing everywhere; possible with some s'', and not if it is larger by a hundredth."""
    timing = find_timing(swing, fastest=3.0)
    most = timing.most()
    assert (timing.pace <= most * (1.0 + 1e-3)).all()
    i = int(most.argmin())
    own = timing.sets.at(timing.places[i : i + 1])[0]
    u = np.linspace(-60.0, 60.0, 4001)
    beyond = [min(own.beyond(np.array([each, (most[i] * k) ** 2])) for each in u) for k in (0.99, 1.01)]
    assert beyond[0] < 1e-3 < beyond[1]


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"fastest": 0.0}, "fastest is 0"),
        ({"start": 2.0}, "start is 2"),
        ({"end": -1.0}, "end is -1"),
        ({"friction": "0.7"}, "friction is '0.7'"),
        ({"torque_limits": -1.0}, "torque_limits is -1"),
        ({"speed_limits": "none"}, "speed_limits is 'none'"),
        ({"threshold": 2.0}, "threshold is 2"),
        ({"contacts": 3}, "contacts is 3"),
    ],
)
def test_bad_settings_are_refused(swing: Motion, settings: dict[str, object], message: str) -> None:
    """With what came and what was expected."""
    with pytest.raises(InputError, match=message):
        find_timing(swing, **settings)  # type: ignore[arg-type]


def test_bad_motions_and_contacts_are_refused(g1: rbd.Robot, swing: Motion) -> None:
    """One frame, contacts of another motion, contacts of an arm."""
    with pytest.raises(InputError, match="motion is 3"):
        retimed(3)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="one frame has no timing"):
        retimed(swing.cut(0.0, 0.01))
    with pytest.raises(InputError, match="contacts are of another motion"):
        retimed(swing, contacts=find_contacts(swing.cut(0.0, 1.0)))
    arm = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    with pytest.raises(InputError, match="not one floating base"):
        retimed(minimum_jerk(arm, [np.zeros(1), np.ones(1)], [0.0, 1.0]), contacts=find_contacts(swing))
