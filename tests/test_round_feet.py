"""Feet that are balls, of a file of one's own: where the ball is lowest, whatever the joints; and joints within limits."""

from __future__ import annotations

import pickle
import warnings
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import ConvexHull
from test_cli import run

import rbd
from rbd.errors import DistantContactWarning, InputError

R = 0.02
FEET = ("FL_ball", "FR_ball", "RL_ball", "RR_ball")


def _link(name: str, mass: float, low: float, shape: str = "") -> str:
    inertia = f'<inertia ixx="{0.01 * mass}" iyy="{0.01 * mass}" izz="{0.01 * mass}" ixy="0" ixz="0" iyz="0"/>'
    body = f'<inertial><origin xyz="0.01 0 {low}"/><mass value="{mass}"/>{inertia}</inertial>' if mass else ""
    return f'<link name="{name}">{body}{shape and f"<collision><geometry>{shape}</geometry></collision>"}</link>'


def _joint(name: str, parent: str, child: str, at: str, limits: str = "") -> str:
    kind = f'type="revolute"><axis xyz="0 1 0"/><limit {limits} effort="30" velocity="20"/' if limits else 'type="fixed"'
    return f'<joint name="{name}" {kind}><origin xyz="{at}"/><parent link="{parent}"/><child link="{child}"/></joint>'


def pony(shape: str = f'<sphere radius="{R}"/>') -> str:
    """A quadruped of 12 kg whose knees cannot be straight, on balls."""
    out = _link("trunk", 8.0, 0.0)
    for leg, x, y in (("FL", 0.2, 0.12), ("FR", 0.2, -0.12), ("RL", -0.2, 0.12), ("RR", -0.2, -0.12)):
        out += _link(f"{leg}_thigh", 0.8, -0.08) + _link(f"{leg}_shank", 0.2, -0.1) + _link(f"{leg}_ball", 0.0, 0.0, shape)
        out += _joint(f"{leg}_hip", "trunk", f"{leg}_thigh", f"{x} {y} 0", 'lower="-1.5" upper="1.5"')
        out += _joint(f"{leg}_knee", f"{leg}_thigh", f"{leg}_shank", "0 0 -0.2", 'lower="-2.6" upper="-0.2"')
        out += _joint(f"{leg}_end", f"{leg}_shank", f"{leg}_ball", "0 0 -0.2")
    return f'<robot name="pony">{out}</robot>'


ROBOT = rbd.load_robot(text=pony(), feet=FEET)


def bent(robot: rbd.Robot, hip: float = 0.7, knee: float = -1.4) -> rbd.State:
    """All legs alike, the base in the air."""
    return robot.at().with_joints({name: hip if "hip" in name else knee for name in robot.actuated_names})


BENT = rbd.robots.place_on_ground(bent(ROBOT), ROBOT.feet())
BALLS = [rbd.RollingBall(name, name, radius=R, friction=0.7) for name in FEET]


def heights(state: rbd.State) -> np.ndarray:
    """Of the balls' centres."""
    return np.array([state.frame(name).X_WF.translation[2] for name in FEET])


def test_round_feet_are_placed_and_held_as_rolling_balls_are() -> None:
    """The floor carries a ball below its centre: torques are those of `RollingBall`, without a warning, to rounding."""
    assert np.abs(heights(BENT) - R).max() < 1e-15
    assert np.array_equal(BENT.q, rbd.robots.place_on_ground(bent(ROBOT), BALLS).q)
    feet = ROBOT.feet(at=BENT)
    beside = [np.linalg.norm(one.offset - other.offset) for one, other in zip(feet, ROBOT.feet(), strict=True)]
    chord = 2.0 * R * np.sin((0.7 - 0.2) / 2.0)  # shanks lean by 0.7 rad here, and by 0.2 rad at loading
    assert np.abs(np.array(beside) - chord).max() < 1e-12
    held, rolling = rbd.hold(BENT, feet), rbd.hold(BENT, BALLS)
    assert np.abs(held.tau - rolling.tau).max() < 1e-10
    one, other = (rbd.solve(BENT, np.zeros(ROBOT.nu), contacts) for contacts in (feet, BALLS))
    assert max(np.abs(one.forces[name] - other.forces[name]).max() for name in FEET) < 1e-9
    again = pickle.loads(pickle.dumps(ROBOT)).feet(at=BENT)
    assert all(np.array_equal(a.offset, b.offset) for a, b in zip(again, feet, strict=True))


def _simulated(contacts: list[rbd.PointContact], torque: np.ndarray | None = None) -> rbd.Trajectory:
    controller = None if torque is None else lambda state, t: torque
    return rbd.simulate(BENT, contacts, duration=4e-3, step=2e-3, controller=controller, progress=False)


CALLS = {
    "hold": lambda feet: rbd.hold(BENT, feet),
    "hold within limits": lambda feet: rbd.hold(BENT, feet, friction="inscribed"),
    "solve": lambda feet: rbd.solve(BENT, np.zeros(8), feet),
    "solve generally": lambda feet: rbd.solve(BENT, np.zeros(8), feet, solver=rbd.ProxQP()),
    "inverse_dynamics": lambda feet: rbd.inverse_dynamics(BENT, np.zeros(14), feet),
    "simulate": _simulated,
    "impact": lambda feet: rbd.impact(BENT, feet),
    "solve_many": lambda feet: rbd.solve_many(ROBOT, BENT.q[None], np.zeros((1, 14)), np.zeros((1, 8)), feet),
    "hold_many": lambda feet: rbd.statics.hold_many(ROBOT, BENT.q[None], feet),
}


@pytest.mark.parametrize("call", CALLS)
def test_points_of_another_posture_are_named(call: str) -> None:
    """10 mm beside the lowest points; those of this state are not named."""
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        CALLS[call](ROBOT.feet())
    said = [w for w in seen if w.category is DistantContactWarning]
    assert len(said) == 1 and said[0].filename == __file__
    if "many" not in call:
        words = str(said[0].message)
        assert all(f"'{name}' 9.9 mm" in words for name in FEET) and "robot.feet(at=state)" in words
    with warnings.catch_warnings():
        warnings.simplefilter("error", DistantContactWarning)
        CALLS[call](ROBOT.feet(at=BENT))


def test_a_motion_that_turns_balls_on_the_ground_says_so() -> None:
    """Without torques the pony folds: its shanks turn by more than 0.05 rad in 0.1 s, that is, over a millimetre of R."""
    feet = ROBOT.feet(at=BENT)
    with pytest.warns(DistantContactWarning, match="turn on the ground in this motion.*'FL_ball'.*RollingBall"):
        folds = rbd.simulate(BENT, feet, duration=0.1, step=2e-3, progress=False)
    knee = ROBOT.joints["FL_knee"].q
    assert np.abs(folds.q[-1, knee] - BENT.q[knee]).max() > 0.05


def test_a_motion_of_round_feet_is_checked_with_the_balls() -> None:
    """A squat over balls that stay where they are: the floor is fitted at zero, and nothing slides."""
    t = np.linspace(0.0, 2.0, 41)
    knees = -1.4 - 0.5 * np.sin(np.pi * t / 2.0) ** 2
    q = [rbd.robots.place_on_ground(bent(ROBOT, -knee / 2.0, knee), ROBOT.feet()).q for knee in knees]
    report = rbd.check_motion(rbd.Motion.of_arrays(ROBOT, t, np.array(q)))
    assert abs(report.lanes.ground) < 1e-12 and not report.lanes.slides.any() and report.lanes.touches.all()
    assert report.share_possible == 1.0


def test_find_pose_puts_balls_on_the_ground() -> None:
    """On a slope, where the joints have to move: all centres are a radius above it."""
    slope = rbd.Ground(point=(0.0, 0.0, 0.3), normal=(np.sin(0.2), 0.0, np.cos(0.2)))
    found = rbd.find_pose(ROBOT, ground=slope, posture=BENT)
    centres = np.array([found.state.frame(name).X_WF.translation for name in FEET])
    assert np.abs(slope.distances(centres) - R).max() < 1e-9


def test_round_feet_on_several_planes() -> None:
    """Front feet on a step of 50 mm: each ball is a radius above its plane, and contacts of this state say nothing."""
    step = {"FL_ball": 0.05, "FR_ball": 0.05}
    placed = rbd.robots.place_on_ground(BENT, ROBOT.feet(on=step))
    assert np.abs(heights(placed) - [0.05 + R, 0.05 + R, R, R]).max() < 1e-12
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbd.hold(placed, ROBOT.feet(on=step, at=placed))
    with pytest.raises(InputError, match=r"'knee' is not a contact with the ground; expected .* or an rbd.RollingBall"):
        rbd.robots.place_on_ground(BENT, [rbd.constraints.JointLock("knee", "FL_knee")])


@pytest.mark.parametrize(
    ("shape", "radius"),
    [(f'<capsule radius="{R}" length="0.03"/>', R), ('<box size="0.1 0.06 0.02"/>', None)],
)
def test_what_is_round_is_remembered(shape: str, radius: float | None) -> None:
    """The end of a capsule is; a sole is not."""
    robot = rbd.load_robot(text=pony(shape), feet=FEET[:1])
    (foot,) = robot.feet(at=bent(robot))
    assert foot.ball is None if radius is None else abs(foot.ball.radius - radius) < 1e-12


def test_a_mesh_of_a_ball_is_taken_as_its_ball(tmp_path: Path) -> None:
    """Of 150 corners, whose facets sag by 0.3 mm: its lowest point in another posture, to twice that."""
    i = np.arange(150) + 0.5
    z, turn = 1.0 - 2.0 * i / 150.0, np.pi * (1.0 + 5.0**0.5) * i
    points = R * np.column_stack([np.sqrt(1.0 - z**2) * np.cos(turn), np.sqrt(1.0 - z**2) * np.sin(turn), z])
    loops = ("\n".join(f"vertex {x:.9f} {y:.9f} {z:.9f}" for x, y, z in points[each]) for each in ConvexHull(points).simplices)
    facets = "\n".join(f"facet normal 0 0 0\nouter loop\n{loop}\nendloop\nendfacet" for loop in loops)
    (tmp_path / "ball.stl").write_text(f"solid ball\n{facets}\nendsolid ball\n")
    (tmp_path / "pony.urdf").write_text(pony('<mesh filename="ball.stl"/>'))
    robot = rbd.load_robot(tmp_path / "pony.urdf", feet=FEET)
    for foot, ball in zip(robot.feet(at=bent(robot)), ROBOT.feet(at=BENT), strict=True):
        assert np.linalg.norm(foot.offset - ball.offset) < 6e-4


def test_a_file_without_postures_stands_within_its_limits() -> None:
    """Knees of [-2.6, -0.2] rad are at -0.2, hips at zero; `at()` is neutral as before, and a robot of the catalogue too."""
    state = ROBOT.standing()
    assert {state.joint(f"{name[:2]}_knee").position for name in FEET} == {-0.2}
    assert {state.joint(f"{name[:2]}_hip").position for name in FEET} == {0.0}
    assert ROBOT.at().joint("FL_knee").position == 0.0
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        rbd.hold(state, ROBOT.feet())


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The pony's URDF."""
    path = tmp_path_factory.mktemp("pony") / "pony.urdf"
    path.write_text(pony())
    yield path


def test_rbd_stand_takes_joints_and_names_those_beyond_limits(file: Path) -> None:
    """By patterns, within limits: the torques of `hold`; straight knees are named on stdout."""
    stands = ("stand", str(file), "--feet", ",".join(FEET))
    code, out, _ = run(*stands, "--joint", "*_hip=0.7", "--joint", "*_knee=-1.4")
    largest = np.abs(rbd.hold(BENT, BALLS).tau).max()
    assert code == 0 and f"{largest:.3f}" in out and "joint limits" not in out
    code, out, _ = run(*stands, "--joint", "FL_knee=0")
    assert "Not within its joint limits: 'FL_knee' is at 0 rad, of -2.6 to -0.2 rad." in " ".join(out.split())


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["*_kne=1"], "nearest: 'RR_knee'"),
        (["FL_knee"], "expected NAME=VALUE"),
        (["FL_knee=bent"], "expected one number"),
        (["*_knee=-1", "FL_knee=-1"], "names 'FL_knee' twice"),
    ],
)
def test_joints_on_the_command_line_that_are_refused(file: Path, given: list[str], said: str) -> None:
    """Each with what was expected."""
    options = [word for each in given for word in ("--joint", each)]
    code, _, complaint = run("simulate", str(file), "--feet", ",".join(FEET), *options)
    assert code == 2 and said in " ".join(complaint.split())
