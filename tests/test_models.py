"""The models in urdf/: each closes, is what its maker writes, and moves as its closed form says."""

from __future__ import annotations

import importlib.util
import math
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.mechanism import assemble, link_angles, mobility

FOLDER = Path(__file__).parents[1] / "urdf"
MECHANISMS = sorted(path.name.removesuffix(".loops.yaml") for path in FOLDER.glob("*.loops.yaml"))
ROWS = {
    "four_bar": (3, 2, 2),
    "slider_crank": (3, 2, 2),
    "five_bar": (4, 2, 2),
    "six_bar": (5, 4, 4),
    "parallel_leg": (8, 6, 6),
    "unicycle": (4, 2, 2),
    "chaplygin_sleigh": (3, 1, 1),
    "rolling_disk": (6, 3, 3),
    "two_wheeled": (5, 4, 3),
    "bicycle": (9, 6, 6),
}
"""Freedoms, rows, rank: as urdf/README.md has them."""


def load(name: str) -> rbd.Robot:
    return rbd.load_robot(FOLDER / f"{name}.urdf")


def held(robot: rbd.Robot) -> list:
    return [*robot.loops(), *robot.wheels()]


def reference(robot: rbd.Robot) -> rbd.State:
    """Where its file closes it; the neutral posture of what only rolls."""
    return robot.at(next(iter(robot.postures), None))


def along(state: rbd.State, rng: np.random.Generator, speed: float = 1.0) -> np.ndarray:
    """A velocity that the constraints allow, at random."""
    J = np.vstack([c.rows(state).J for c in held(state.robot)])
    v = rng.normal(size=state.robot.nv) * speed
    return v - np.linalg.pinv(J) @ (J @ v)


@pytest.fixture(scope="module")
def maker() -> ModuleType:
    """urdf/make.py, as a module."""
    spec = importlib.util.spec_from_file_location("make_models", FOLDER / "make.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


NUMBER = re.compile(r"-?\d+\.?\d*(?:e-?\d+)?")


def test_the_files_are_those_that_make_writes(maker: ModuleType, tmp_path: Path) -> None:
    """Word for word, so that a change is made in one place."""
    maker.main(tmp_path)
    written = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert len(written) == 2 * len(MECHANISMS) + 1 == 2 * len(ROWS) + 1  # the rimless wheel has no loops file
    for name, text in written.items():
        kept = (FOLDER / name).read_text()
        assert NUMBER.sub("#", text) == NUMBER.sub("#", kept), name
        both = zip(NUMBER.findall(text), NUMBER.findall(kept), strict=True)
        others = [(float(one), float(other)) for one, other in both if one != other]
        # Sines differ in the last digit from one processor to another; the same number is written in the same letters.
        assert all(one != other for one, other in others), name
        ours, theirs = [one for one, _ in others], [other for _, other in others]
        assert ours == pytest.approx(theirs, rel=1e-13, abs=1e-15), name


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.urdf")) + sorted(FOLDER.glob("*.yaml")), ids=lambda p: p.name)
def test_every_file_tells_its_origin_and_licence(path: Path) -> None:
    """In its head; and the README names it."""
    head = path.read_text()[:700]
    assert "Origin: " in head and "Licence: BSD-2-Clause" in head
    assert path.name.replace(".loops.yaml", ".urdf") in (FOLDER / "README.md").read_text()


@pytest.mark.parametrize("name", MECHANISMS)
def test_the_doctor_finds_nothing_wrong(name: str) -> None:
    """Inertias that bodies have, motors with limits, postures within theirs, loops that are closed somewhere."""
    report = rbd.doctor(load(name))
    assert not report.errors and not report.warnings and report.notes


@pytest.mark.parametrize("name", MECHANISMS)
def test_every_posture_closes_every_loop(name: str) -> None:
    """To 1e-12 m as stored, and no worse after assembling; the rows have the rank that the README states."""
    robot = load(name)
    for posture in robot.postures:
        for state in (robot.at(posture), robot.at(assemble(robot.at(posture), held(robot)).q)):
            assert max(np.abs(c.rows(state).error).max() for c in held(robot)) < 1e-12
    state = reference(robot)
    J = np.vstack([c.rows(state).J for c in held(robot)])
    assert (robot.nv, len(J), np.linalg.matrix_rank(J, tol=1e-9)) == ROWS[name]


@pytest.mark.parametrize("name", MECHANISMS)
def test_every_mechanism_moves(name: str, rng: np.random.Generator) -> None:
    """With gravity, torques and speed: solved to 1e-9 and the constraints keep their rows."""
    robot = load(name)
    state = reference(robot)
    state = state.with_velocity(along(state, rng))
    found = rbd.solve(state, rng.normal(size=robot.nu), held(robot))
    assert found.status is rbd.problem.Status.SOLVED
    assert max(np.abs(a).max() for a in found.accelerations.values()) < 1e-9


@pytest.mark.parametrize("name", MECHANISMS)
def test_every_moving_body_is_drawn(name: str) -> None:
    """Each link with mass has shapes to see, and they stay within twice its reach."""
    robot = load(name)
    drawn = {robot.model.frames[g.parentFrame].name for g in robot.visual_model.geometryObjects}
    heavy = {n for n, Y in zip(list(robot.model.names)[1:], list(robot.model.inertias)[1:], strict=True) if Y.mass > 0.0}
    assert len(drawn) >= len(heavy)


@pytest.mark.parametrize("name", ["four_bar", "slider_crank", "six_bar"])
def test_one_motor_decides_one_freedom(name: str) -> None:
    """Mobility one, by counting and by rank."""
    robot = load(name)
    found = mobility(reference(robot))
    assert found.instantaneous == 1 and robot.nu == 1


# --------------------------------------------------------------------------------------------------- flat linkages


def test_the_foot_of_the_parallel_leg_stays_level() -> None:
    """Three parallelograms: wherever thigh and shank go, the foot's and the knee plate's x axes are the world's."""
    robot = load("parallel_leg")
    q = robot.posture("assembled")
    for thigh, crank in ((-1.3, -1.8), (-0.9, -2.4), (-1.6, -2.2), (-0.6, -1.6)):
        state = robot.at(assemble(rbd.State(robot, q), robot.loops(), fixed={"thigh_joint": thigh, "crank_joint": crank}).q)
        angles = link_angles(state)
        assert abs(angles["foot"]) < 1e-11 and abs(angles["knee_plate"]) < 1e-11
        assert abs(math.remainder(angles["shank"] - crank, 2 * math.pi)) < 1e-11  # driven by the crank, from the hip
        ankle = 0.22 * np.exp(1j * thigh) + 0.22 * np.exp(1j * crank)
        p = state.frame("foot").X_WF.translation
        assert abs(p[0] + 1j * p[2] - ankle) < 1e-11 and abs(p[1]) < 1e-15
        q = state.q


def test_the_parallel_leg_stands_on_its_foot() -> None:
    """With a base that floats its sole is flat on the ground under the hip's height, and it can be held."""
    robot = rbd.load_robot(FOLDER / "parallel_leg.urdf", root="free_flyer")
    state = robot.at("assembled")
    (sole,) = robot.soles_from_collision(["foot"], at=state, on=None)
    patch = sole.rows(state).patch
    assert patch is not None and np.abs(patch.axes[:, 2] - [0, 0, 1]).max() < 1e-9
    assert len(sole.corners) == 4 and abs(np.ptp(sole.corners[:, 0]) - 0.19) < 1e-9
    found = rbd.solve(state, [0.0, 0.0], [sole, *robot.loops()])
    assert found.status is rbd.problem.Status.SOLVED


def test_the_hand_of_the_five_bar_is_where_two_circles_meet() -> None:
    """0.17 m from both cranks' tips, and above them in the posture `assembled`."""
    robot = load("five_bar")
    for name, side in (("assembled", 1.0), ("crossed", -1.0)):
        state = robot.at(name)
        hand = state.frame("left_arm_tip").X_WF.translation
        tips = [state.frame(f"{arm}_arm").X_WF.translation for arm in ("left", "right")]
        assert all(abs(np.linalg.norm(hand - tip) - 0.17) < 1e-15 for tip in tips)
        assert side * (hand[2] - max(side * tip[2] for tip in tips) * side) > 0.05


def test_the_six_bar_goes_round() -> None:
    """Its crank can be driven through a whole turn without coming apart."""
    robot = load("six_bar")
    q, start = robot.posture("assembled"), link_angles(robot.at("assembled"))["crank"]
    for k in range(1, 37):
        q = assemble(rbd.State(robot, q), robot.loops(), fixed={"crank_joint": start + math.radians(10 * k)}).q
    assert np.abs(q - robot.posture("assembled")).max() < 1e-9


# ------------------------------------------------------------------------------------------------- what rolls or slides


def test_the_sleigh_moves_as_chaplygin_says(rng: np.random.Generator) -> None:
    """Its law is v' = a w^2, w' = -(m a / (I + m a^2)) v w, with a 0.3 m, m 5 kg, I 0.4 kg m2; no side slip."""
    robot = load("chaplygin_sleigh")
    for v, w, x, y, th in rng.normal(size=(5, 5)):
        state = robot.at(np.array([x, y, np.cos(th), np.sin(th)]), np.array([v, 0.0, w]))
        a = rbd.solve(state, [], robot.wheels()).a
        assert abs(a[0] - 0.3 * w**2) < 1e-12
        assert abs(a[2] + 5.0 * 0.3 / (0.4 + 5.0 * 0.3**2) * v * w) < 1e-12
        assert abs(a[1]) < 1e-12


def test_a_torque_drives_the_unicycle() -> None:
    """By tau = (m r^2 + I) phi'', and the frame goes ahead at r phi''."""
    robot = load("unicycle")
    wheel = robot.model.inertias[robot.joint_id("wheel_joint")]
    a = rbd.solve(robot.at(), [2.0], robot.wheels()).a
    r = robot.wheels()[0].radius
    spin = 2.0 / (robot.mass * r**2 + wheel.inertia[1, 1])
    assert np.abs(a - [r * spin, 0.0, 0.0, spin]).max() < 1e-12


def test_two_wheels_drive_and_turn() -> None:
    """Kinematics: v = r (w_left + w_right) / 2 and turn = r (w_right - w_left) / track, from the rows alone."""
    robot = load("two_wheeled")
    state = robot.at()
    J = np.vstack([c.rows(state).J for c in robot.wheels()])
    place = {name: robot.model.joints[robot.joint_id(f"{name}_wheel_joint")].idx_v for name in ("left", "right")}
    for left, right in ((1.0, 1.0), (-1.0, 1.0), (2.0, 0.5)):
        v = np.zeros(5)
        v[place["left"]], v[place["right"]] = left, right
        base = np.linalg.lstsq(J[:, :3], -J[:, 3:] @ v[3:], rcond=None)[0]
        assert np.abs(base - [0.1 * (left + right) / 2, 0.0, 0.1 * (right - left) / 0.34]).max() < 1e-14


def test_a_disk_pushed_at_its_centre_rolls() -> None:
    """By a = F / (m + I / r^2) = 2 F / 3 m for a uniform disk, and it spins at a / r about its axis."""
    robot = load("rolling_disk")
    push = rbd.ExternalForce("disk", (6.0, 0.0, 0.0))
    found = rbd.solve(robot.at("upright"), [], robot.wheels(), external=push)
    assert np.abs(found.a - [2.0, 0, 0, 0, 2.0 / 0.25, 0]).max() < 1e-12
    assert np.abs(found.forces["rim"] - [-2.0, 0.0, 2.0 * 9.81]).max() < 1e-9


def test_the_bicycle_has_its_trail_and_leans() -> None:
    """Front contact 1.02 m ahead, steering axis through the ground 0.07 m beyond it; upright it is balanced, leant it falls."""
    robot = load("bicycle")
    state = robot.at("upright")
    fork, hub = state.frame("fork").X_WF, state.frame("front_wheel").X_WF.translation
    axis = fork.rotation[:, 2]
    assert abs(math.degrees(math.acos(axis[2])) - 18.0) < 1e-9 and axis[0] < 0.0
    ground = fork.translation - fork.translation[2] / axis[2] * axis
    assert np.abs(ground - [1.02 + 0.07, 0.0, 0.0]).max() < 1e-12 and np.abs(hub - [1.02, 0.0, 0.34]).max() < 1e-12
    upright = rbd.solve(state, [0.0], robot.wheels())
    assert np.abs(upright.a).max() < 1e-9
    total = sum(force for force in upright.forces.values())
    assert np.abs(total - [0.0, 0.0, robot.mass * 9.81]).max() < 1e-9
    leant = pin.integrate(robot.model, state.q, np.r_[np.zeros(3), 0.05, np.zeros(5)])
    leant = assemble(rbd.State(robot, leant), robot.wheels(), fixed={"steering_joint": 0.0}).q
    falls = rbd.solve(robot.at(leant), [0.0], robot.wheels())
    assert falls.a[3] > 0.1
