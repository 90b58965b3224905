"""Following a motion on its own terrain: onto a step, on two treads, on a slope, and one that was repaired."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.control import follow
from rbd.motion import Motion, MotionDifference, find_contacts, minimum_jerk

TALOS = rbd.load_robot("talos")
STAND = TALOS.standing()
LEFT, RIGHT = ((STAND.frame(s.frame).X_WF * s.placement).translation for s in TALOS.soles())


def followed(motion: Motion, **given: object) -> tuple[MotionDifference, rbd.Trajectory, str]:
    """(how far a simulation on the motion's terrain is from it, the simulation, what the controller says of itself)."""
    controller = follow(motion, **given)  # type: ignore[arg-type]
    assert all(contact.on is motion.ground for contact in controller.contacts)
    feet = motion.robot.feet(on=motion.ground)  # type: ignore[attr-defined]
    run = rbd.simulate(motion.state(0), feet, duration=motion.duration, step=2e-3, controller=controller, progress=False)
    return MotionDifference.of(run, motion), run, str(controller)


def sway(ground: rbd.Terrain, places: dict[str, tuple[float, float, float]], com: tuple[float, float]) -> Motion:
    """A second of Talos on its feet there, its centre of mass to the left and back."""
    poses = [rbd.find_pose(TALOS, places, ground=ground, com=(com[0], com[1] + y)).state.q for y in (0.0, 0.03, 0.0)]
    motion = minimum_jerk(TALOS, poses, [0.0, 0.5, 1.0], ground=ground)
    return motion.with_contacts(find_contacts(motion))


def test_a_step_up_is_followed() -> None:
    """Talos puts its right foot onto a step of 8 cm: the base within 2 mm, nothing in the step, contacts taken as they are."""
    com = (*LEFT[:2], STAND.com[2] - 0.02)
    places = [RIGHT, RIGHT + [0.0, 0.0, 0.12], RIGHT + [0.25, 0.0, 0.12], RIGHT + [0.25, 0.0, 0.08]]
    poses = [
        rbd.find_pose(TALOS, {"left_sole": pin.SE3(np.eye(3), LEFT), "right_sole": pin.SE3(np.eye(3), p)}, com=com).state.q
        for p in places
    ]
    stairs = rbd.Terrain.stairs(0.08, 2.0, 1, start=(RIGHT[0] + 0.12, 0.0, 0.0))
    motion = minimum_jerk(TALOS, [poses[0], *poses, poses[-1]], [0.0, 0.2, 0.8, 1.4, 2.0, 2.2], rate=50.0, ground=stairs)
    motion = motion.with_contacts(rbd.check_motion(motion, self_collision=False, progress=False).lanes)
    off, run, said = followed(motion)
    assert np.linalg.norm(off.base, axis=1).max() < 2e-3 and off.left_out < 4e-3
    assert run.residuals["penetration"].max() < 1e-8
    landed = [e for e in run.events if e.name == "right_sole" and e.kind == "touches" and e.piece == "box 1"]
    assert landed and abs(landed[0].t - 2.0) < 0.15
    assert "contacts and joint limits were kept" in said


def test_a_sway_on_two_treads_is_followed() -> None:
    """One foot 10 cm above the other: to 2 mm, without an event; a repaired copy begins a micrometre above, and comes there."""
    stairs = rbd.Terrain.stairs(0.1, 2.0, 1, start=(LEFT[0] + 0.13, 0.0, 0.0))
    places = {"left_sole": tuple(LEFT), "right_sole": (RIGHT[0] + 0.3, RIGHT[1], 0.1)}
    motion = sway(stairs, places, (LEFT[0] + 0.14, 0.0))
    off, run, said = followed(motion)
    assert np.linalg.norm(off.base, axis=1).max() < 2e-3 and not run.events
    assert "taken as a contact" not in said
    q = motion.q.copy()
    q[:, 2] += 0.02  # off the treads
    given = Motion.of_arrays(TALOS, motion.t, q, ground=stairs, trust=True)
    report = rbd.check_motion(given, self_collision=False, progress=False)
    repaired = report.repaired()
    assert report.share_possible < 1.0 and repaired.contacts is not None
    off, run, said = followed(repaired)
    assert isinstance(repaired.ground, rbd.Terrain)
    assert np.linalg.norm(off.base, axis=1).max() < 1e-2 and np.linalg.norm(off.base[-1]) < 1e-3
    assert run.residuals["penetration"].max() < 1e-8


def test_a_sway_on_a_valley_is_followed() -> None:
    """With both soles across two planes, of no axes in common: they stay where they are."""
    x = np.unique(np.round([(STAND.frame(s.frame).X_WF * s.placement).act(c)[0] for s in TALOS.soles() for c in s.corners], 9))
    planes = {
        name: rbd.Ground(point=(e, 0, 0), normal=np.array([n, 0.0, 1.0]) / np.hypot(n, 1.0))
        for name, e, n in (("rear", x[0], 0.1), ("front", x[-1], -0.1))
    }
    valley = rbd.Terrain(planes)
    poses = [rbd.find_pose(TALOS, {s: pin.SE3(np.eye(3), p) for s, p in (("left_sole", LEFT), ("right_sole", RIGHT))},
                           com=(STAND.com[0], y)).state.q for y in (0.0, 0.02, 0.0)]  # fmt: skip
    motion = minimum_jerk(TALOS, poses, [0.0, 0.3, 0.6], ground=valley)
    lanes = find_contacts(motion)
    motion = motion.with_contacts(lanes.of(["left_sole", "right_sole"], [[(0.0, 0.6)], [(0.0, 0.6)]]))
    off, run, _ = followed(motion)
    assert np.linalg.norm(off.base, axis=1).max() < 2e-3
    assert max(x.max() for x in off.feet.values()) < 1e-4 and run.residuals["penetration"].max() < 1e-8


def test_points_on_a_slope_have_its_normal() -> None:
    """A Solo12 that bends on 12 degrees does not slip: its controller counts on the slope's normal and on its friction."""
    solo, angle = rbd.load_robot("solo12"), np.deg2rad(12.0)
    n = np.array([-np.sin(angle), 0.0, np.cos(angle)])
    slope = rbd.Terrain({"slope": rbd.Ground(point=(0, 0, 0), normal=n)}, friction=0.3)
    first = solo.standing(ground=slope)
    low = rbd.find_pose(solo, ground=slope, posture=first, com=(*first.com[:2], first.com[2] - 0.02)).state.q
    motion = minimum_jerk(solo, [first.q, low, first.q], [0.0, 0.3, 0.6], ground=slope)
    motion = motion.with_contacts(find_contacts(motion))
    off, run, _ = followed(motion, friction=0.6)
    assert np.linalg.norm(off.base, axis=1).max() < 5e-3
    assert not any(e.kind == "slips" for e in run.events)
    for name in run.contacts:
        f = run.forces[name]
        assert np.linalg.norm(f - np.outer(f @ n, n), axis=1).max() <= 0.3 * (f @ n).max()


@pytest.mark.parametrize("on", [0.0, 0.2])
def test_level_ground_is_as_before(on: float) -> None:
    """Contacts of a motion on a level floor stay on the plane of their lanes."""
    wave = minimum_jerk(TALOS, [STAND.q, STAND.q], [0.0, 0.2])
    wave = wave.with_contacts(find_contacts(wave))
    assert all(isinstance(contact.on, rbd.Ground) for contact in follow(wave, friction=0.5 + on).contacts)
