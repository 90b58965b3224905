"""The repair of motions over their whole length: made faults, other robots, its options, and what it says."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.arrays import Array
from rbd.errors import FrameNotFound, InputError
from rbd.motion import CAUSES, Motion, check_motion, minimum_jerk
from rbd.motion.repair.feet import Feet
from rbd.motion.repair.notes import new_faults
from rbd.motion.repair.sweep import Sweep

ARMS = {"left_shoulder_pitch_joint": -1.2, "right_shoulder_pitch_joint": -0.6, "waist_yaw_joint": 0.3}

TALOS_ANKLES = ("leg_left_5_joint", "leg_right_5_joint")


@pytest.fixture(scope="module")
def wave(g1: rbd.Robot) -> Motion:
    """G1 stands and raises its arms, for 1.2 s: possible."""
    stands = g1.standing().q
    raises = stands.copy()
    for name, angle in ARMS.items():
        raises[g1.joints[name].q] += angle
    return minimum_jerk(g1, [stands, raises, stands], [0.0, 0.6, 1.2])


def changed(motion: Motion, change: Array | None = None, **joints: float) -> Motion:
    """With joints changed by angles, and velocities added to each pose, shape (n, nv)."""
    robot, q = motion.robot, motion.q.copy()
    for name, angle in joints.items():
        q[:, robot.joints[f"{name}_joint"].q] += angle
    if change is not None:
        q = np.array([pin.integrate(robot.model, x, y) for x, y in zip(q, change, strict=True)])
    return Motion.of_arrays(robot, motion.t, q)


def along(motion: Motion, coordinate: int, values: Array | float) -> Array:
    """A change of one velocity coordinate."""
    out = np.zeros((motion.n, motion.robot.nv))
    out[:, coordinate] = values
    return out


def tilted(motion: Motion, degrees: float) -> Motion:
    """Both ankles turned."""
    return changed(motion, left_ankle_pitch=np.deg2rad(degrees), right_ankle_pitch=np.deg2rad(degrees))


def slipping(motion: Motion) -> Motion:
    """The whole robot creeps forward at 2 cm/s."""
    return changed(motion, along(motion, 0, 0.02 * motion.t))


def noisy(motion: Motion) -> Motion:
    """Each joint by 2 mrad from frame to frame."""
    noise = np.random.default_rng(0).normal(0.0, 2e-3, (motion.n, motion.robot.nv))
    noise[:, :6] = 0.0
    return changed(motion, noise)


FAULTS = {
    "tilted by 3 degrees": lambda m: tilted(m, 3.0),
    "tilted by 5 degrees": lambda m: tilted(m, 5.0),
    "tilted by 8 degrees": lambda m: tilted(m, 8.0),
    "one foot hovers 18 mm": lambda m: changed(m, left_hip_pitch=-0.07, left_knee=0.14, left_ankle_pitch=-0.07),
    "creeps at 2 cm/s": slipping,
    "floor 4 cm off": lambda m: m.lifted(0.04),
    "noise": noisy,
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_made_fault_is_repaired(wave: Motion, fault: str) -> None:
    """Impossible before; afterwards possible at each frame, soles flat and fixed, near the motion without the fault."""
    broken = FAULTS[fault](wave)
    report = check_motion(broken, ground=0.0 if "floor" in fault else None)
    assert report.share_possible < 0.6
    report = check_motion(broken)
    repaired = report.repaired(progress=False)
    again = check_motion(repaired)
    lanes = repaired.contacts
    assert lanes is not None and again.possible.all(), [c for c in CAUSES if again.of_cause(c).any()]
    assert lanes.touches.all() and np.abs(lanes.heights).max() < 1e-4
    assert np.ptp(lanes.places, axis=0).max() < 2e-4
    off = np.array([pin.difference(wave.robot.model, a, b) for a, b in zip(wave.q, repaired.q, strict=True)])
    assert np.sqrt(np.square(off[:, 6:]).mean()) < 0.1
    assert check_motion(Motion.of_arrays(wave.robot, repaired.t, repaired.q)).share_possible > 0.98  # as another would read it
    told = "nothing was repaired" if report.possible.all() else f"repaired {broken.title}: 100.0% of its frames are possible"
    assert any(told in note for note in repaired.notes)


def test_a_possible_motion_comes_back_as_it_is(wave: Motion) -> None:
    """Not a number changes, and the contacts are those that were found."""
    report = check_motion(wave)
    repaired = report.repaired()
    assert report.possible.all() and repaired.contacts is report.lanes
    for name in ("t", "q", "v", "a"):
        assert np.abs(getattr(repaired, name) - getattr(wave, name)).max() <= 1e-6
    assert "nothing was repaired" in repaired.notes[-1]


LIFTS = {
    "talos": {"leg_left_3_joint": -0.5, "leg_left_4_joint": 0.8, "leg_left_5_joint": -0.3},
    "g1": {"left_hip_pitch_joint": -0.5, "left_knee_joint": 0.8, "left_ankle_pitch_joint": -0.3},
    "romeo": {"LHipPitch": -0.4, "LKneePitch": 0.7, "LAnklePitch": -0.3},
    "icub": {"l_hip_pitch": 0.4, "l_knee": -0.7, "l_ankle_pitch": -0.3},
    "go2": {"FL_thigh_joint": 0.3, "FL_calf_joint": -0.6},
}
"""A leg lifted, the centre of mass not shifted before."""


@pytest.mark.parametrize("name", LIFTS)
def test_a_lifted_leg_of_other_robots(name: str) -> None:
    """The weight goes to the feet that stay, before the other one leaves."""
    robot = rbd.load_robot(name)
    stands = robot.standing().q
    lifts = stands.copy()
    for joint, angle in LIFTS[name].items():
        lifts[robot.joints[joint].q] += angle
    motion = minimum_jerk(robot, [stands, stands, lifts, lifts, stands, stands], [0.0, 0.5, 0.9, 1.4, 1.8, 2.4])
    report = check_motion(motion, self_collision=name != "icub")  # whose foot is 1 mm from the other leg where it stands
    repaired = report.repaired(progress=False)
    again = report.check(repaired)
    assert report.share_possible < 0.6
    assert again.share_possible > 0.98, [c for c in CAUSES if again.of_cause(c).any()]
    assert repaired.contacts is not None
    swings = [lanes for lanes in map(repaired.contacts.intervals, [c.name for c in report.lanes.contacts]) if len(lanes) == 2]
    assert len(swings) == 1 and swings[0][0][1] < 0.8 < 1.5 < swings[0][1][0]


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("name", ["g1", "talos"])
def test_soles_lean_on_their_toes_and_heels(name: str, side: float) -> None:
    """Up on both toes, or heels, by 26 degrees, and down again; lowered until the lowest corners are on the floor."""
    robot = rbd.load_robot(name)
    ankles = [name for name in robot.actuated_names if name.endswith("ankle_pitch_joint") or name in TALOS_ANKLES]
    stands, feet = robot.standing().q, list(robot.feet())
    leans = stands.copy()
    for joint in ankles:
        leans[robot.joints[joint].q] += 0.45 * side
    motion = minimum_jerk(robot, [stands, leans, leans, stands], [0.0, 0.6, 1.0, 1.6])
    q = motion.q.copy()
    q[:, 2] -= Feet.of(robot, feet, q, 1.0 / 60.0).low.min(axis=1)
    report = check_motion(Motion.of_arrays(robot, motion.t, q))
    assert not report.possible[5:-5].any()  # before and after it hardly moves
    new = report.repaired(progress=False)
    assert new.contacts is not None and check_motion(new).share_possible == 1.0
    lean = Feet.of(robot, feet, new.q, 1.0 / 60.0).tilt
    edge = new.contacts.of_contact(feet[0].name) & ~new.contacts.touches[:, : len(feet[0].corners)].all(axis=1)
    assert edge.sum() > 30 and np.abs(lean[~edge]).max() < 1e-3
    assert side * lean[len(lean) // 2, 0, 1] == pytest.approx(0.45 - 0.15, abs=0.02)
    on = feet[0].corners[:, 0] * side > 0.0
    assert np.array_equal(new.contacts.touches[edge][:, : len(on)], np.tile(on, (edge.sum(), 1)))
    assert np.abs(new.contacts.heights[new.contacts.touches]).max() < 1e-4


def test_slower_has_the_same_contacts_at_another_pace(wave: Motion) -> None:
    """Times are longer by the factor, frames are as many."""
    broken = tilted(wave, 5.0)
    repaired = check_motion(broken).repaired(slower=1.5, progress=False)
    assert repaired.n == wave.n and repaired.duration == pytest.approx(1.5 * wave.duration)
    assert "its rate is 40 Hz instead of 60 Hz" in repaired.notes[1]
    assert check_motion(repaired).possible.all()


def test_kept_hands_stay(wave: Motion) -> None:
    """A hand stays within millimetres of where the reference has it, though the feet are levelled."""
    frame, report = "left_wrist_yaw_link", check_motion(tilted(wave, 8.0))
    wanted = report.motion.lifted(-report.lanes.ground)
    off = {}
    for keep in ((), (frame,)):
        repaired = report.repaired(keep=keep, progress=False)
        assert check_motion(repaired).possible.all()
        places = [np.array([m.state(i).frame(frame).X_WF.translation for i in range(m.n)]) for m in (wanted, repaired)]
        off[len(keep)] = float(np.linalg.norm(places[1] - places[0], axis=1).max())
    assert off[1] < 2e-3 < off[0]


def test_any_rate_and_times_come_back(wave: Motion) -> None:
    """Poses are computed at 45 to 75 Hz, and given at the frames of the file."""
    for rate in (25.0, 200.0):
        again = tilted(wave, 5.0).resample(rate)
        repaired = check_motion(again).repaired(progress=False)
        assert np.allclose(repaired.t, again.t, rtol=0.0, atol=1e-9)
        assert check_motion(repaired).share_possible > 0.95


def test_edited_lanes_are_what_it_stands_on(wave: Motion) -> None:
    """A foot that is said to be in the air is lifted off the floor."""
    lanes = check_motion(wave).lanes.with_touch("left_sole", 0.4, 0.8, False)
    repaired = check_motion(tilted(wave, 5.0), contacts=lanes).repaired(progress=False)
    assert repaired.contacts is not None
    assert len(repaired.contacts.intervals("left_sole")) == 2
    low = repaired.contacts.heights[:, repaired.contacts.points.group == 0].min(axis=1)
    assert low.max() > 0.02 and check_motion(repaired).share_possible > 0.95


def test_what_is_not_possible_has_a_time_and_a_cause(g1: rbd.Robot) -> None:
    """With a twentieth of its torques it stands on straighter legs; with a fiftieth not, and the notes say which motors."""
    stands = g1.standing().q
    motion = minimum_jerk(g1, [stands, stands], [0.0, 0.5])
    weak = check_motion(motion, torque_limits=0.05)
    assert weak.share_possible == 0.0 and weak.check(weak.repaired(progress=False)).share_possible == 1.0
    weaker = check_motion(motion, torque_limits=0.02)
    repaired = weaker.repaired(progress=False)
    notes, again = repaired.notes, weaker.check(repaired)
    new = (again.causes & ~weaker.causes).any(axis=1).sum()
    assert notes[1].startswith(f"new faults in {new} frames: ") == bool(new)
    assert any(note.startswith("not possible from 0.00 to 0.50 s: ") and "motor" in note for note in notes)


def test_new_faults_have_counts_and_times() -> None:
    """Frames that had another fault count, those that had the same do not; what is near in time is one stretch."""
    t, was, now = 0.02 * np.arange(50), np.zeros((50, len(CAUSES)), bool), np.zeros((50, len(CAUSES)), bool)
    was[:30, CAUSES.index("slides")] = was[10, CAUSES.index("motor")] = True
    now[5:12, CAUSES.index("motor")] = now[[5, 7, 40], CAUSES.index("joint limit")] = True
    assert new_faults(t, was, now) == ["new faults in 7 frames: motor in 6, joint limit in 3; at 0.10 to 0.22, 0.80 s."]
    assert new_faults(t, now, now) == []


def test_bad_input(wave: Motion) -> None:
    """A pace, a frame, a motion too short."""
    report = check_motion(tilted(wave, 5.0))
    with pytest.raises(InputError, match=r"slower is 0\.5; expected a factor of 1 or more"):
        report.repaired(slower=0.5)
    with pytest.raises(FrameNotFound):
        report.repaired(keep=["left_hand_of_nobody"])
    with pytest.raises(InputError, match="expected 8 frames or more"):
        check_motion(tilted(wave, 5.0).cut(0.0, 0.05)).repaired()


def test_forces_of_contacts_on_one_body_add_up() -> None:
    """Toes and sole of one foot push it together: what is missing is that of the sum, not of the last."""
    solo = rbd.load_robot("solo12")
    q, rng = np.tile(solo.standing().q, (4, 1)), np.random.default_rng(3)
    pushes = rng.normal(size=(4, 3, 6))
    both = Sweep.of(solo, q, 0.01, [4, 7, 4], pushes)
    summed = Sweep.of(solo, q, 0.01, [4, 7], np.stack([pushes[:, 0] + pushes[:, 2], pushes[:, 1]], axis=1))
    assert both.need == pytest.approx(summed.need, abs=1e-12) and both.by_q == pytest.approx(summed.by_q, abs=1e-12)
