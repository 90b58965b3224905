"""Example 28: Talos walks six steps. What the example claims, from its recorded motion, by Pinocchio's own calls."""

from itertools import pairwise
from types import ModuleType
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial import ConvexHull
from test_examples import run
from test_readme import TOP

import rbd

WALK = TOP / "examples" / "28_talos_walks.py"
FOOTPRINTS = {"right_sole": (0, 1, 3, 5), "left_sole": (0, 2, 4, 5)}  # in strides
STRIDE = 0.23  # over the height of the centre of mass
TOUCHING = 1e-5  # a corner lower than this is down [m]; those of a foot that lands flat are within 0.3 mm of each other


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return run(WALK)[0]


@pytest.fixture(scope="module")
def result() -> Any:
    return run(WALK)[1]


def stands(walk: rbd.Trajectory, foot: str) -> list[tuple[int, int]]:
    """(first, last) sample of each stand of a foot: from when its first corner touches to when its last one leaves."""
    down = (walk.points[foot][..., 2] < TOUCHING).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], down, [False]]).astype(int)))
    merged: list[tuple[int, int]] = []
    for first, end in edges.reshape(-1, 2).tolist():
        if merged and first - merged[-1][1] < 50:  # a corner that leaves again for less than 0.1 s: still the same stand
            merged[-1] = (merged[-1][0], end - 1)
        else:
            merged.append((first, end - 1))
    return merged


@pytest.mark.parametrize("foot", FOOTPRINTS)
def test_the_feet_land_at_their_footprints_and_stay_there(result, foot):
    """One to five strides ahead within a millimetre; no corner moves by 0.1 mm until lift-off."""
    corners, stride = result.walk.points[foot], STRIDE * result.walk.com[0, 2]
    found = stands(result.walk, foot)
    assert len(found) == len(FOOTPRINTS[foot])
    for (first, last), strides in zip(found, FOOTPRINTS[foot], strict=True):
        x = strides * stride
        stand = corners[first : last + 1, :, :2]
        shift = stand - corners[0, :, :2]
        assert np.abs(shift - [x, 0.0]).max() < 1e-3
        assert np.linalg.norm(stand - stand[0], axis=-1).max() < 1e-4


def test_the_feet_land_softly(result):
    """No corner meets the ground at 0.1 m/s or faster; all twelve corners of six steps are in the events."""
    touches = [e for e in result.walk.events if e.kind == "touches"]
    assert max(e.speed for e in touches) < 0.1
    assert {(e.name, e.point) for e in touches} == {(foot, i) for foot in FOOTPRINTS for i in range(4)}


def test_the_contacts_push_within_friction(result):
    """Soles only push, and the forces of their corners are within the friction cone, mu = 0.7."""
    for forces in result.walk.point_forces.values():
        normal, along = forces[..., 2], np.linalg.norm(forces[..., :2], axis=-1)
        assert normal.min() > -1e-9
        assert (along - 0.7 * normal).max() < 1e-6


def test_only_motors_and_soles_move_it(result):
    """M a + h = S^T tau + J^T f by Pinocchio's RNEA at recorded samples: no force acts on the base; torques within limits."""
    walk = result.walk
    robot = walk.robot
    data = robot.model.createData()
    limit = robot.effort_limit
    assert (np.abs(walk.tau) <= limit).all()
    weight = 9.81 * robot.mass
    for i in range(0, len(walk), 40):
        needed = pin.rnea(robot.model, data, walk.q[i], walk.v[i], walk.a[i])
        pin.computeJointJacobians(robot.model, data, walk.q[i])
        pin.framesForwardKinematics(robot.model, data, walk.q[i])
        for foot, points in walk.points.items():
            frame = robot.model.getFrameId(f"{foot}_link")
            J = pin.getFrameJacobian(robot.model, data, frame, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)
            for p, f in zip(points[i], walk.point_forces[foot][i], strict=True):
                arm = p - data.oMf[frame].translation
                needed -= J[:3].T @ f + J[3:].T @ np.cross(arm, f)
        assert np.abs(needed[:6]).max() < 1e-9 * weight
        assert np.abs(needed[robot.motors] - walk.tau[i]).max() < 1e-9 * weight


def test_the_centre_of_pressure_is_inside_the_soles(result):
    """From q, v and a alone, where the ground must push, beside the hull of the corners that are down, at each sample."""
    walk = result.walk
    data, g = walk.robot.model.createData(), 9.81
    margins = []
    for i in range(len(walk)):
        rate = pin.computeCentroidalMomentumTimeVariation(walk.robot.model, data, walk.q[i], walk.v[i], walk.a[i]).vector
        c, f = walk.com[i], rate[:3] + [0.0, 0.0, g * walk.robot.mass]
        pressure = [c[0] - (c[2] * f[0] + rate[4]) / f[2], c[1] - (c[2] * f[1] - rate[3]) / f[2]]
        corners = np.concatenate([points[i] for points in walk.points.values()])
        hull = ConvexHull(corners[corners[:, 2] < TOUCHING, :2])
        margins.append(-(hull.equations @ [*pressure, 1.0]).max())
    assert min(margins) > 0.0


def test_energy_changes_by_the_work_of_the_motors(result):
    """Between impacts, to 1e-6 of the work that the motors exchange in the walk; impacts only lose energy, and little."""
    walk = result.walk
    excess = walk.energy - walk.motor_work
    after = np.unique(np.searchsorted(walk.t, [e.t for e in walk.events if e.kind in ("touches", "slips")]))
    parts = [excess[first:end] for first, end in pairwise([0, *after, len(walk)]) if end - first > 1]
    assert max(np.ptp(part) for part in parts) < 1e-6 * exchanged(walk)
    assert sum(map(len, parts)) > 0.98 * len(walk)
    assert -1e-4 * exchanged(walk) < excess[-1] - excess[0] < 0.0


def test_half_the_step_leaves_a_quarter_of_the_error_of_energy(result, example, monkeypatch):
    """While the first foot swings; at 1 ms the error is below 1e-6 of the motors' work in that swing alone."""
    monkeypatch.setattr(example, "STEP", 1e-3)
    swing = result.controller.plan.footsteps[0]
    lifts, lands = swing.start + 0.01, swing.end - 0.01
    errors = []
    for walk in (result.walk, example.walked("talos", lands).walk):
        part = walk[np.searchsorted(walk.t, lifts) : np.searchsorted(walk.t, lands)]
        errors.append(np.ptp(part.energy - part.motor_work) / exchanged(part))
    assert errors[1] < 1e-6
    assert 3.5 < errors[0] / errors[1] < 4.5


def exchanged(walk: rbd.Trajectory) -> float:
    """What motors take and give [J]: the sizes of torque times displacement in each step, added up over steps and motors."""
    model = walk.robot.model
    moved = [pin.difference(model, one, other)[walk.robot.motors] for one, other in pairwise(walk.q)]
    return float(np.abs(walk.tau[:-1] * moved).sum())


def test_the_walk_repeats_bit_by_bit(result, example):
    """Until the first foot is down, with a new robot, plan and controller."""
    walk, again = result.walk, example.walked("talos", result.controller.plan.footsteps[0].end + 0.1).walk
    n = len(again) - 1  # the last step is a shorter one
    assert n > 800
    for one, other in ((again.t, walk.t), (again.q, walk.q), (again.v, walk.v)):
        assert one[:n].tobytes() == other[:n].tobytes()
    for foot, force in again.point_forces.items():  # that of the last sample belongs to a step that is not taken
        assert force[: n - 1].tobytes() == walk.point_forces[foot][: n - 1].tobytes()


def test_the_controller_is_asked_once_a_step_and_assumes_what_touches(result):
    """One step of control for each step, none of which violates a limit; soles that it counts on do not slide."""
    log, walk = result.controller.log, result.walk
    assert np.abs(log.t - walk.t).max() < 1e-9
    assert log.violations == 0 and log.residual.max() < 1e-9
    assert log.torque_share.max() < 0.65
    assert set(log.disagreements) <= set(FOOTPRINTS)
    assert {kind for kinds in log.disagreements.values() for kind in kinds} <= {"partial", "late", "early"}  # of landings
    assert max(np.ptp(walk.points[foot][log.assumed[foot], :, 2].min(axis=1)) for foot in FOOTPRINTS) < 1e-3


def test_it_lifts_its_foot_with_the_damping_of_its_file_too(example):
    """Joint damping, that the controller does not know of, acts implicitly; energy changes by what motors and dampers do."""
    robot = rbd.load_robot("talos")
    controller = rbd.control.Walk(robot, example.STEPS, friction=0.7)
    walk = rbd.simulate(
        controller.state, controller.contacts, duration=controller.plan.footsteps[0].start + 0.5, step=example.STEP,
        controller=controller, external=robot.joint_damping(),
    )  # fmt: skip
    assert walk.residuals["law"].max() < 1e-9 and controller.log.violations == 0
    assert walk.points["right_sole"][-1, :, 2].min() > 0.01 and walk.modes["left_sole"][-1] == "sticks"
    balance = walk.energy + walk.dissipated - walk.motor_work
    assert walk.dissipated[-1] > 0.01
    assert np.ptp(balance) < 0.02 * walk.dissipated[-1]
