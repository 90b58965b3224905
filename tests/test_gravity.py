"""Gravity of any direction and size: what follows it, and what does not."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError
from rbd.simulation.velocity_problem import EXACT
from rbd.testing import box

TILT = np.radians(20.0)
R = pin.rpy.rpyToMatrix(0.0, TILT, 0.3)
"""From the world in which the ground is level to the one in which gravity is along -z."""
DOWN = np.array([0.0, 0.0, -9.81])
SIZE = (0.4, 0.3, 0.2)


def corners(ground: rbd.Ground | float, friction: float) -> list[rbd.PointContact]:
    """The four lower corners of the box."""
    signs = [(1, 1), (1, -1), (-1, -1), (-1, 1)]
    x, y, z = 0.5 * np.array(SIZE)
    return [
        rbd.PointContact(f"c{i}", "box", offset=(a * x, b * y, -z), friction=friction, on=ground)
        for i, (a, b) in enumerate(signs)
    ]


def patch(ground: rbd.Ground | float, friction: float) -> list[rbd.SurfaceContact]:
    """The lower face of the box."""
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5 * SIZE[2]]))
    return [rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.15), placement=X, friction=friction, on=ground)]


def two_boxes() -> tuple[rbd.State, rbd.State, rbd.Ground]:
    """A box on level ground under gravity that leans by 20 degrees; and one on an incline of 20 degrees."""
    p = np.array([0.1, -0.2, 0.5 * SIZE[2]])
    level = box(10.0, SIZE).with_gravity(R.T @ DOWN)
    incline = box(10.0, SIZE)
    first = rbd.State(level, pin.SE3ToXYZQUAT(pin.SE3(np.eye(3), p)))
    second = rbd.State(incline, pin.SE3ToXYZQUAT(pin.SE3(R, R @ p)))
    return first, second, rbd.Ground(point=(0.0, 0.0, 0.0), normal=R[:, 2])


@pytest.mark.parametrize("contacts", [corners, patch])
@pytest.mark.parametrize("friction", [0.2, 0.5])
@pytest.mark.parametrize("law", ["coulomb", "convex"])
def test_box_under_leaning_gravity_is_a_box_on_an_incline(contacts: object, friction: float, law: str) -> None:
    """Solved: the same accelerations in the box's axes, the same forces in the turned ones."""
    first, second, ground = two_boxes()
    one = rbd.solve(first, [], contacts(0.0, friction), law=law)
    other = rbd.solve(second, [], contacts(ground, friction), law=law)
    assert np.abs(one.a - other.a).max() < 1e-9
    if contacts is patch:
        for part in (slice(0, 3), slice(3, 6)):
            turned = R @ one.forces["face"][part]
            assert np.abs(turned - other.forces["face"][part]).max() < 1e-7
    else:
        total = [sum(s.forces.values()) for s in (one, other)]
        assert np.abs(R @ total[0] - total[1]).max() < 1e-8
    if law == "coulomb":  # under the convex law a box that slides lifts off
        along = 9.81 * (np.sin(TILT) - friction * np.cos(TILT))
        assert abs(np.linalg.norm(one.a[:3]) - max(along, 0.0)) < 1e-9


def test_box_under_leaning_gravity_is_held_as_on_an_incline() -> None:
    """It needs a coefficient of friction of tan 20 degrees."""
    first, second, ground = two_boxes()
    enough, little = np.tan(TILT) + 1e-4, np.tan(TILT) - 1e-4
    one, other = rbd.hold(first, patch(0.0, enough)), rbd.hold(second, patch(ground, enough))
    assert np.abs(R @ one.forces["face"][:3] - other.forces["face"][:3]).max() < 1e-9
    assert np.abs(R @ one.forces["face"][3:] - other.forces["face"][3:]).max() < 1e-9
    for state, on in ((first, 0.0), (second, ground)):
        with pytest.raises(rbd.CannotHold, match="friction prevents it"):
            rbd.hold(state, patch(on, little))


@pytest.mark.parametrize("v", [(0.3, 0.5, 0.0, 0.0, 0.0, 0.0), (0.3, 0.5, 0.7, 1.5, -0.5, 1.0)])
def test_box_under_leaning_gravity_moves_as_on_an_incline(v: tuple[float, ...]) -> None:
    """Pushed so that it slides and stops, or thrown so that it lands on a corner; energy is the same too."""
    first, second, ground = two_boxes()
    one, other = (
        rbd.simulate(state.with_velocity(v), corners(on, 0.4), duration=0.3, step=2e-3)
        for state, on in ((first, 0.0), (second, ground))
    )
    apart = 2.0 * EXACT * len(one)  # the impulses of each step are accepted at a merit of EXACT m/s, and errors do not grow
    assert np.abs(one.v - other.v).max() < apart
    assert np.abs(one.com @ R.T - other.com).max() < apart * one.t[-1]
    assert np.abs(one.energy - other.energy).max() < apart * first.robot.mass * np.abs(one.v).max()
    assert np.ptp(one.energy) > 1.0  # rubbed away, or by the impact


def test_quadruped_under_leaning_gravity_is_one_on_an_incline() -> None:
    """Falling on its feet, and held in its posture: velocities, forces and torques of time steps agree."""
    solo = rbd.load_robot("solo12")
    leaning, state = solo.with_gravity(R.T @ DOWN), solo.standing()
    turned = state.q.copy()
    turned[:7] = pin.SE3ToXYZQUAT(pin.SE3(R, np.zeros(3)) * state.base_pose())
    ground = rbd.Ground(point=(0.0, 0.0, 0.0), normal=R[:, 2])
    level, incline = leaning.at(state.q), solo.at(turned)
    for holds in (False, True):
        one, other = (
            rbd.simulate(
                start,
                feet,
                duration=0.06,
                step=2e-3,
                controller=rbd.control.HoldPosture(start, feet) if holds else None,
            )
            for start, feet in ((level, leaning.feet(0.6)), (incline, solo.feet(0.6, on=ground)))
        )
        assert np.abs(one.v - other.v).max() < 1e-9
        assert np.abs(one.tau - other.tau).max() < 1e-9
        assert np.abs(one.energy - other.energy).max() < 1e-9
        for foot in one.forces:
            assert np.abs(one.forces[foot] @ R.T - other.forces[foot]).max() < 1e-8


def test_box_falls_along_gravity() -> None:
    """P = g t^2 / 2, in any direction."""
    g = np.array([1.0, -2.0, 0.5])
    state = rbd.State(box(10.0, SIZE).with_gravity(g), pin.neutral(box(10.0, SIZE).model))
    motion = rbd.simulate(state, duration=0.5, step=0.01)
    assert np.abs(motion.com[-1] - 0.5 * g * 0.25).max() < 1e-9
    assert np.ptp(motion.energy) < 1e-9
    floating = rbd.simulate(rbd.State(box(10.0, SIZE).with_gravity((0, 0, 0)), state.q), duration=0.5, step=0.01)
    assert not floating.com[-1].any()


def test_on_the_moon_weight_is_a_sixth() -> None:
    """Forces, torques of holding and potential energy are in proportion to gravity."""
    earth = rbd.load_robot("solo12")
    moon = rbd.load_robot("solo12", gravity=(0.0, 0.0, -1.62))
    share = 1.62 / 9.81
    there, here = moon.standing(), earth.standing()
    assert np.abs(there.q - here.q).max() < 1e-12
    one, other = (rbd.solve(s, np.zeros(12), s.robot.feet(friction=0.3)) for s in (there, here))
    for foot in one.forces:
        assert np.abs(one.forces[foot] - share * other.forces[foot]).max() < 1e-9
    assert np.abs(one.a - share * other.a).max() < 1e-9
    held = rbd.hold(there, moon.feet())
    assert abs(sum(f[2] for f in held.forces.values()) - 1.62 * moon.mass) < 1e-9
    assert abs(rbd.dynamics.potential_energy(there) - share * rbd.dynamics.potential_energy(here)) < 1e-12
    assert moon.weight[2] == -1.62 * moon.mass
    assert earth.gravity.tolist() == [0.0, 0.0, -9.81]


def test_robots_with_their_own_gravity_travel() -> None:
    """Pickles, copies and robots of other processes keep it; a robot with another gravity is another robot."""
    solo = rbd.load_robot("solo12")
    leaning = solo.with_gravity(R.T @ DOWN)
    for robot in (
        pickle.loads(pickle.dumps(leaning)),
        copy.deepcopy(leaning),
        copy.copy(leaning),
        leaning.with_gravity(R.T @ DOWN),
    ):
        assert robot.gravity.tolist() == leaning.gravity.tolist()
        assert robot.is_like(leaning)
        assert robot.digest == leaning.digest
    assert not leaning.is_like(solo)
    assert leaning.digest != solo.digest
    assert solo.gravity.tolist() == DOWN.tolist()
    assert [foot.name for foot in leaning.feet()] == [foot.name for foot in solo.feet()]
    assert leaning.with_gravity(DOWN).is_like(solo)


@pytest.mark.parametrize("friction", [0.6, None])
def test_prepared_contacts_know_gravity_of_any_direction(friction: float | None) -> None:
    """One state and many, at rest, and moving on held soles: as the general solver, which knows no prepared contacts."""
    talos = rbd.load_robot("talos").with_gravity((1.0, 0.5, -9.6))
    state, soles = talos.standing(), talos.soles(friction)
    rng, n = np.random.default_rng(0), 4  # the fifth draw slips and turns, and has a family of motions
    tau, v = 0.5 * rng.uniform(-1.0, 1.0, (n, talos.nu)) * np.minimum(talos.effort_limit, 10.0), np.zeros((n, talos.nv))
    for i in range(n if friction is None else 0):
        v[i] = rbd.mechanism.project_velocity(state.with_velocity(rng.uniform(-0.3, 0.3, talos.nv)), soles).v
    many = rbd.solve_many(talos, np.tile(state.q, (n, 1)), v, tau, soles)
    for i in range(n):
        moving = state.with_velocity(v[i])
        one, general = rbd.solve(moving, tau[i], soles), rbd.solve(moving, tau[i], soles, solver=rbd.ConeSolver())
        for a in (one.a, many.a[i]):
            assert np.abs(a - general.a).max() < 1e-9 * max(1.0, np.abs(general.a).max())


def test_a_pair_has_one_gravity() -> None:
    """Merged robots keep it; two different ones are refused."""
    tilted = box(1.0, SIZE).with_gravity(R.T @ DOWN)
    other = box(2.0, SIZE)
    pair = rbd.robots.merge_robots(tilted, other.with_gravity(R.T @ DOWN), names=("a_", "b_"))
    assert pair.gravity.tolist() == tilted.gravity.tolist()
    assert np.abs(rbd.State(pair, pair.neutral()).h[:3] + pair.members[0].mass * tilted.gravity).max() < 1e-12
    level = pair.with_gravity(DOWN)
    for robot in (level, *level.members, pickle.loads(pickle.dumps(level)), copy.deepcopy(level)):
        assert robot.gravity.tolist() == DOWN.tolist()
    with pytest.raises(InputError, match="one world has one"):
        rbd.robots.merge_robots(tilted, other, names=("a_", "b_"))


def test_a_robot_on_two_points_stands_with_its_centre_of_mass_over_them_along_gravity() -> None:
    """Bolt on level ground under gravity that leans forward can be held; without gravity, or upside down, it is not turned."""
    bolt = rbd.load_robot("bolt")
    leaning = bolt.with_gravity(9.81 * np.array([np.sin(0.1), 0.0, -np.cos(0.1)]))
    state = leaning.standing()
    held = rbd.hold(state, leaning.feet(friction=0.7))
    assert abs(sum(held.forces.values()) @ leaning.gravity + leaning.mass * 9.81**2) < 1e-6
    assert max(abs(foot.points(state).gaps).max() for foot in leaning.feet()) < 1e-9
    turned = pin.log3(bolt.standing().base_pose().rotation.T @ state.base_pose().rotation)
    assert abs(abs(turned[1]) - 0.1) < 1e-9  # by the lean of gravity, about the line of its feet
    for gravity in ((0.0, 0.0, 0.0), (0.0, 0.0, 9.81)):
        other = bolt.with_gravity(gravity).standing()
        assert max(abs(foot.points(other).gaps).max() for foot in leaning.feet()) < 1e-9
        assert other.base_pose().rotation[2, 2] > 0.9


def test_regions_are_refused_where_gravity_does_not_meet_the_ground() -> None:
    """Zero or level; the message says which gravity is wanted."""
    solo = rbd.load_robot("solo12")
    for gravity, words in (((0.0, 0.0, 0.0), "no weight"), ((9.81, 0.0, 0.0), "a part along z")):
        robot = solo.with_gravity(gravity)
        with pytest.raises(InputError, match=words):
            rbd.statics.support_region(robot.standing(), robot.feet())
    with pytest.raises(InputError, match="a part along z"):
        rbd.statics.zmp_region(solo.standing().robot.with_gravity((9.81, 0.0, 0.0)).standing(), solo.feet())
    with pytest.raises(InputError, match="towards its plane"):
        rbd.statics.zmp_region(solo.with_gravity((0.0, 0.0, 9.81)).standing(), solo.feet())


def test_support_region_on_a_ceiling() -> None:
    """Gravity upwards presses a robot against bilateral contacts: the same region as with gravity downwards."""
    solo = rbd.load_robot("solo12")
    held = solo.feet(friction=None)
    up, down = (rbd.statics.support_region(robot.standing(), held) for robot in (solo.with_gravity((0.0, 0.0, 9.81)), solo))
    assert up.bounded == down.bounded
    assert up.cut == down.cut


def test_linear_pendulum_under_leaning_gravity() -> None:
    """At rest the zero-moment point is below the centre of mass along gravity; corners are proven by forces through it."""
    solo = rbd.load_robot("solo12").with_gravity(9.81 * np.array([np.sin(0.1), 0.0, -np.cos(0.1)]))
    state, feet = solo.standing(), solo.feet(0.7)
    rest = rbd.statics.zmp(state, np.zeros(solo.nv))
    below = state.com[:2] - state.com[2] / solo.gravity[2] * solo.gravity[:2]
    assert np.abs(rest[:2] - below).max() < 1e-12
    region = rbd.statics.zmp_region(state, feet, friction="inscribed")
    assert region.distance(rest) > 0.0
    for corner in range(len(region.vertices)):
        total = sum(region.forces(corner).values())
        assert abs(total[2] + solo.mass * solo.gravity[2]) < 1e-6
        lean = (state.com - region.vertices[corner])[:2] / state.com[2]
        assert np.abs(total[:2] / total[2] - lean).max() < 1e-6


def test_check_of_a_motion_follows_gravity() -> None:
    """Standing as on an incline: friction 0.1 misses the weight beyond its cone; the repaired motion leans back."""
    lean = np.radians(10.0)
    solo = rbd.load_robot("solo12").with_gravity(9.81 * np.array([np.sin(lean), 0.0, -np.cos(lean)]))
    q = solo.standing().q
    still = rbd.motion.minimum_jerk(solo, [q, q], [0.0, 0.2])
    assert rbd.check_motion(still, friction=0.7).missing_scaled.max() < 1e-9
    missing = rbd.check_motion(still, friction=0.1).missing_scaled
    assert np.abs(missing - (np.sin(lean) - 0.1 * np.cos(lean)) / np.hypot(1.0, 0.1)).max() < 1e-6
    talos = rbd.load_robot("talos").with_gravity(9.81 * np.array([np.sin(0.2), 0.0, -np.cos(0.2)]))
    q = talos.standing().q
    assert rbd.statics.support_region(talos.standing(), talos.soles()).distance() < 0.0
    report = rbd.check_motion(rbd.motion.minimum_jerk(talos, [q, q], [0.0, 0.2]))
    near = report.repaired(progress=False)
    assert report.missing_scaled.min() > 0.02
    assert rbd.check_motion(near).missing_scaled.max() < 1e-9
    for i in (0, -1):
        state = talos.at(near.q[i])
        assert rbd.statics.support_region(state, talos.soles()).distance() > 0.0
    with pytest.raises(InputError, match="presses it on a level floor"):
        rbd.check_motion(rbd.motion.minimum_jerk(solo.with_gravity((0, 0, 0)), [still.q[0]] * 2, [0.0, 0.2]))


@pytest.mark.parametrize(("gravity", "arrow", "line"), [
    (DOWN, False, True),
    ((0.0, 0.0, -1.62), False, True),
    ((3.0, 0.0, -9.0), True, True),
    ((9.81, 0.0, 0.0), True, False),
    ((0.0, 0.0, 9.81), True, False),
    ((0.0, 0.0, 0.0), False, False),
])  # fmt: skip
def test_scenes_draw_gravity(gravity: tuple[float, ...], arrow: bool, line: bool) -> None:
    """The drop line along it, an arrow where it is not along -z, and what it is in the legend where it is not the Earth's."""
    solo = rbd.load_robot("solo12").with_gravity(gravity)
    state = solo.standing()
    with rbd.visual.Scene(solo) as scene:
        scene.show(state)
        marks = {mark.path: mark for mark in scene.drawn}
        legend = str(scene.recorder.messages())
    assert ("com/gravity" in marks) == arrow
    assert ("com/drop_line" in marks) == line
    if arrow:
        tip = marks["com/gravity"].points - state.com
        along = solo.gravity / np.linalg.norm(solo.gravity)
        assert np.linalg.norm(tip - np.outer(tip @ along, along), axis=1).max() < 0.2 * (tip @ along).max()
    if line:
        foot = marks["com/on_the_ground"].points.mean(axis=0)
        assert np.abs(foot[:2] - (state.com[:2] - state.com[2] / solo.gravity[2] * solo.gravity[:2])).max() < 1e-2
    assert ('\\"gravity\\"' in legend or '"gravity"' in legend) == (not np.array_equal(gravity, DOWN))


def test_regions_are_drawn_where_the_ground_is() -> None:
    """Its corners at a height are along gravity from those on z = 0; a figure names its plane."""
    from matplotlib.figure import Figure

    solo = rbd.load_robot("solo12").with_gravity((3.0, 0.0, -9.0))
    state = solo.standing()
    region = rbd.statics.support_region(state, solo.feet())
    high = region.corners_at(0.3)
    assert np.abs(np.cross(high - np.column_stack([region.vertices, np.zeros(len(high))]), solo.gravity)).max() < 1e-12
    assert (high[:, 2] == 0.3).all()
    axes = Figure().subplots()
    rbd.visual.plot_region(axes, region)
    assert axes.get_xlabel() == "x on z = 0, along gravity [m]"


def test_gravity_of_an_mjcf_is_read_and_can_be_replaced(tmp_path: Path) -> None:
    """<option gravity>, and the argument in its place."""
    file = tmp_path / "ball.xml"
    file.write_text(
        '<mujoco><option gravity="0 1 -3"/><worldbody><body name="ball"><freejoint/><geom size="0.1" mass="1"/></body>'
        "</worldbody></mujoco>"
    )
    assert rbd.load_robot(file).gravity.tolist() == [0.0, 1.0, -3.0]
    other = rbd.load_robot(file, gravity=(0.0, 0.0, -1.62))
    assert other.gravity.tolist() == [0.0, 0.0, -1.62]
    rbd.simulate(other.at(), duration=0.01, step=5e-3).save(tmp_path / "fall.npz")
    assert rbd.Trajectory.load(tmp_path / "fall.npz").robot.gravity.tolist() == [0.0, 0.0, -1.62]


def test_commands_take_gravity() -> None:
    """`rbd stand --gravity`."""
    from typer.testing import CliRunner

    from rbd.cli.app import app

    answer = CliRunner().invoke(app, ["stand", "solo12", "--gravity", "0,0,-1.62"])
    assert answer.exit_code == 0
    assert "weight 4.05 N" in answer.stdout
    assert CliRunner().invoke(app, ["region", "solo12", "--gravity", "0,0,0"]).exit_code == 2


@pytest.mark.parametrize("g", [9.81, (0.0, 0.0), (0.0, np.nan, 0.0), "down", (0.0, 0.0, -1e5), None])
def test_what_is_no_gravity_is_refused(g: object) -> None:
    """A number, wrong sizes, what is not finite, and vectors that are not in m/s2."""
    with pytest.raises(InputError, match="gravity"):
        box(1.0, SIZE).with_gravity(g)


def test_doctor_tells_gravity() -> None:
    """A note, where it is not (0, 0, -9.81)."""
    solo = rbd.load_robot("solo12")
    assert [note.kind for note in rbd.doctor(solo).notes] == []
    notes = rbd.doctor(solo.with_gravity((0.0, 0.0, -1.62))).notes
    assert [note.kind for note in notes] == ["gravity"]
    assert "-1.62" in notes[0].text


@pytest.mark.parametrize("friction", ["inscribed", "cone"])
def test_support_region_of_talos_is_where_it_can_be_held(friction: str) -> None:
    """Under gravity that leans: a push moment that shifts its weight's line to a corner can be held, one beyond cannot.

    By `rbd.hold` of the very pose, with a moment on its base that moves the line of action of the weight to points of
    z = 0 on both sides of the region's edge.
    """
    talos = rbd.load_robot("talos").with_gravity(9.81 * np.array([np.sin(0.12), np.sin(-0.07), -0.99]))
    state, soles = talos.standing(), talos.soles(0.6)
    region = rbd.statics.support_region(state, soles, friction=friction, torque_limits=True)
    g, com = talos.gravity, state.com
    below = com[:2] - com[2] / g[2] * g[:2]
    assert abs(region.distance() - region.distance(below)) < 1e-12
    assert region.residual < 1e-6
    middle = region.vertices.mean(axis=0)
    for corner in region.vertices[:: max(1, len(region.vertices) // 6)]:
        for share, can in ((0.995, True), (1.005, False)):
            d = np.array([*(middle + share * (corner - middle) - below), 0.0])
            moved = rbd.ExternalForce("base_link", np.zeros(3), moment=np.cross(d, talos.mass * g))
            try:
                rbd.hold(state, soles, external=[moved], friction=friction)
                held = True
            except rbd.CannotHold:
                held = False
            assert held == can
