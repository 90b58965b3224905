"""Contacts that are rare: with what is fixed to the world, edge across edge, nothing near, nothing carried."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import InputError
from rbd.problem.answer import corner_split
from rbd.problem.rows import Patch, Rows

BODY = '<inertial pos="0 0 0" mass="2" diaginertia=".02 .03 .04"/>'


def scene(folder: Path, *bodies: str, fixed: str = "") -> rbd.Robot:
    """Free bodies b0, b1 ... with these geoms; geoms fixed to the world come with the first."""
    robots = []
    for i, geom in enumerate(bodies):
        path = folder / f"b{i}.xml"
        body = f'<body name="body"><freejoint/>{BODY}<geom name="geom" {geom}/></body>'
        path.write_text(f'<mujoco model="b{i}"><worldbody>{"" if i else fixed}{body}</worldbody></mujoco>')
        robots.append(rbd.load_robot(path))
    out = robots[0]
    for i, robot in enumerate(robots[1:], 1):
        out = rbd.robots.merge_robots(out, robot, names=("b0" if i == 1 else "", f"b{i}"))
    return out


def placed(robot: rbd.Robot, *poses: tuple[tuple[float, float, float], tuple[float, float, float]], v=None) -> rbd.State:
    """Bodies at (position, rotation vector)."""
    q = [pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array(turn)), np.array(p))) for p, turn in poses]
    return robot.at(np.concatenate(q), v)


TABLE = '<geom name="table" type="box" size="0.5 0.5 0.1" pos="0 0 0.9"/>'


def test_a_body_on_a_table_that_is_fixed_is_as_on_the_ground(tmp_path, rng):
    """A box on a table of the world's: gaps, rows and their velocities are those of the plane at the table's height."""
    robot = scene(tmp_path, 'type="box" size="0.1 0.2 0.05"', fixed=TABLE)
    state = placed(robot, ((0.1, 0.0, 1.05), (0.0, 0.0, 0.4)), v=rng.normal(size=6))
    pair = rbd.CollisionContacts("on table", robot, ground=False, pairs=[("geom", "table")], friction=0.5)
    plane = rbd.CollisionContacts("on plane", robot, ground=["geom"], on=rbd.Ground(point=(0.0, 0.0, 1.0)), friction=0.5)
    one, other = pair.rows(state), plane.rows(state)
    assert len(one) == len(other) == 12 and np.abs(one.error - other.error).max() < 1e-14
    order = np.argsort([tuple(np.round(p, 9)) for p in pair.points(state).positions], axis=0)[:, 0]
    same = np.argsort([tuple(np.round(p, 9)) for p in plane.points(state).positions], axis=0)[:, 0]
    for what in ("J", "velocity"):
        mine, theirs = (getattr(r, what).reshape(4, 3, -1)[i] for r, i in ((one, order), (other, same)))
        # Tangents may be chosen otherwise: normals, and the lengths of tangential parts.
        assert np.abs(np.abs(mine[:, 2]) - np.abs(theirs[:, 2])).max() < 1e-12
        assert np.abs(np.linalg.norm(mine[:, :2], axis=1) - np.linalg.norm(theirs[:, :2], axis=1)).max() < 1e-12
    still = placed(robot, ((0.1, 0.0, 1.05), (0.0, 0.0, 0.4)))
    assert np.abs(rbd.solve(still, [], [pair]).a).max() < 1e-9


def test_what_is_near_by_its_sphere_alone_does_not_touch(tmp_path):
    """A ball diagonally off the table's corner, within its reach and not at it: no rows, and free fall."""
    robot = scene(tmp_path, 'type="sphere" size="0.1"', fixed=TABLE)
    contacts = rbd.CollisionContacts("floor", robot, ground=False, pairs=[("geom", "table")])
    state = placed(robot, ((0.6, 0.6, 0.9), (0.0, 0.0, 0.0)))
    rows = contacts.rows(state)
    assert len(rows) == 0 and rows.patch is None and contacts.points(state).names == ()
    assert rbd.solve(state, [], [contacts]).a == pytest.approx([0, 0, -9.81, 0, 0, 0], abs=1e-12)


@pytest.mark.parametrize("gap", [1e-3, 1e-9, 0.0, -1e-9, -1e-3])
@pytest.mark.parametrize("yaw", [0.3, 1.0, 0.5 * np.pi])
def test_edges_that_cross_touch_in_one_point(tmp_path, rng, gap, yaw):
    """A beam across a beam, both on their edges: one point where the edges cross, also exactly in touch, and its velocity."""
    beam = 'type="box" size="0.5 0.05 0.05"'
    robot = scene(tmp_path, beam, beam)
    edge, tilted = 0.05 * np.sqrt(2.0), (0.25 * np.pi, 0.0, 0.0)
    turned = tuple(pin.log3(pin.exp3(np.array([0.0, 0.0, yaw])) @ pin.exp3(np.array(tilted))))
    state = placed(robot, ((0.03, 0.02, 1.0), tilted), ((0.0, 0.0, 1.0 + 2.0 * edge + gap), turned), v=rng.normal(size=12))
    contacts = rbd.CollisionContacts("cross", robot, ground=False, pairs=[("b0geom", "b1geom")], friction=0.5, margin=0.01)
    found = contacts.points(state)
    assert len(found.names) == 1 and found.gaps[0] == pytest.approx(gap, abs=1e-10)
    assert found.positions[0] == pytest.approx([0.02 / np.tan(yaw), 0.02, 1.0 + edge + 0.5 * gap], abs=1e-9)
    assert np.abs(found.axes[0][:, 2]) == pytest.approx([0.0, 0.0, 1.0], abs=1e-10)
    rows, step = contacts.rows(state), 1e-6
    ends = [contacts.rows(robot.at(pin.integrate(robot.model, state.q, x * state.v), state.v)) for x in (step, -step)]
    assert (ends[0].error - ends[1].error)[2] / (2.0 * step) == pytest.approx(rows.velocity[2], rel=1e-4)
    assert rows.J @ state.v == pytest.approx(rows.velocity, abs=1e-13)


def test_three_bodies_in_a_row_share_what_is_known_of_the_middle_one(tmp_path):
    """A ball between two: each pair has its point, and the whole row of 6 kg falls on the plane as one."""
    ball = 'type="sphere" size="0.1"'
    robot = scene(tmp_path, ball, ball, ball)
    state = placed(robot, *[((0.0, 0.0, 0.1 + 0.2 * i), (0.0, 0.0, 0.0)) for i in range(3)])
    pairs = [("b0geom", "b1geom"), ("b1geom", "b2geom")]
    stack = rbd.CollisionContacts("stack", robot, ground=["b0geom"], pairs=pairs, friction=0.5)
    solution = rbd.solve(state, [], [stack])
    normals = np.sort(np.abs(solution.forces["stack"].reshape(-1, 3)[:, 2]))
    assert normals == pytest.approx(2.0 * 9.81 * np.array([1.0, 2.0, 3.0]), rel=1e-9)
    assert np.abs(solution.a).max() < 1e-9


def test_shapes_that_are_fixed_cannot_reach_the_ground(tmp_path):
    """All of them, or one that is named."""
    path = tmp_path / "post.xml"
    arm = f'<body name="b"><joint type="hinge" axis="0 1 0"/>{BODY}</body>'
    path.write_text(f'<mujoco model="post"><worldbody>{TABLE}{arm}</worldbody></mujoco>')
    robot = rbd.load_robot(path)
    with pytest.raises(InputError, match="all collision shapes of post are fixed to the world; give ground=False"):
        rbd.CollisionContacts("floor", robot)
    with pytest.raises(InputError, match="'table' is fixed to the world"):
        rbd.CollisionContacts("floor", robot, ground=["table"])


def test_bounds_want_a_robot():
    """Said with the limit's name."""
    with pytest.raises(InputError, match="the robot of 'stop' is 'robot'; expected a robot"):
        rbd.JointLimit("stop", "elbow").bounds("robot")


# ------------------------------------------------------------------------------------------------------------ feedback


class Wrong:
    """A constraint whose rows are a list."""

    name = "wrong"

    def rows(self, state: rbd.State) -> list[float]:
        """None that are."""
        return [1.0]


def test_rows_of_a_constraint_that_is_fed_back_are_checked(tmp_path):
    """Anything else is named; sets side by side are heard if one of them is."""
    robot = scene(tmp_path, 'type="box" size="0.1 0.1 0.1"')
    state = placed(robot, ((0.0, 0.0, 0.1), (0.0, 0.0, 0.0)))
    by = rbd.constraints.Baumgarte(20.0)
    with pytest.raises(InputError, match="constraint 'wrong' gave a list in place of rbd.Rows"):
        by.of(Wrong()).rows(state)
    corners = rbd.CollisionContacts("floor", robot, friction=0.5)
    assert by.of(corners).acts_on(state) == "position and velocity"


# --------------------------------------------------------------------------------------------------------- split forces


def test_a_contact_that_leaves_splits_nothing():
    """No rows, no forces: zeros at each corner; of a cone of another kind in a patch, the half-lines and cones alone count."""
    corners = np.array([[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]])
    patch = Patch(np.zeros(3), np.eye(3), corners, 0.5)
    gone = Rows("gone", np.zeros((0, 3)), np.zeros(0), rbd.problem.NonNegative(0), patch=patch)
    assert np.array_equal(corner_split(gone, np.zeros(0)), np.zeros((2, 3)))


# ----------------------------------------------------------------------------------------------------------------- sets


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: rbd.problem.WrenchCone(np.zeros((2, 2)), 0.5), r"corners of a WrenchCone have shape \(2, 2\)"),
        (lambda: rbd.problem.WrenchCone(np.zeros((0, 3)), 0.5), r"shape \(0, 3\)"),
        (lambda: rbd.problem.WrenchCone([[np.nan, 0.0, 0.0]], 0.5), "finite numbers"),
        (lambda: rbd.problem.LineCone(0.0, 0.5), "half_length of a LineCone is 0.0"),
        (lambda: rbd.problem.LineCone(-1.0, 0.5), "half_length of a LineCone is -1.0"),
        (lambda: rbd.problem.Product([rbd.problem.Free]), "expected a set of forces"),
        (lambda: rbd.problem.Product([3.0]), "a member of Product is 3.0; expected a set of forces"),
        (lambda: rbd.problem.Free(-1), "dimension of a set is -1"),
        (lambda: rbd.problem.NonNegative(True), "dimension of a set is True"),
        (lambda: rbd.problem.Free(100_001), "dimension of a set is 100001"),
        (lambda: Rows("", np.eye(1), np.zeros(1), rbd.problem.Free(1)), "the name of rows is ''"),
        (
            lambda: Rows("row", np.eye(1), np.zeros(1), rbd.problem.Free(1), velocity=np.array([np.nan])),
            "velocity or error is not",
        ),
        (lambda: Rows("row", np.eye(1), np.zeros(1), "cone"), "the cone is 'cone'"),
        (lambda: Rows("row", np.eye(1), np.zeros(1), rbd.problem.Free(1), resultant=[[1.0, 2.0]]), "resultant has shape"),
        (
            lambda: rbd.GaussProblem(np.eye(1), np.zeros(1), Rows("row", np.eye(1), np.zeros(1), rbd.problem.Free(1))),
            "single Rows",
        ),
        (lambda: rbd.GaussProblem(np.eye(1), np.zeros(1), [3.0]), "an entry of rows is 3.0; expected rbd.Rows"),
        (lambda: rbd.KKT().solve("problem"), "problem is 'problem'; expected a GaussProblem"),
    ],
)
def test_sets_and_rows_are_checked_when_they_are_made(make, match):
    """In words, before any problem holds them."""
    with pytest.raises(InputError, match=match):
        make()


def test_rows_may_be_made_of_lists():
    """J, bias and the resultant as lists of numbers are the same rows."""
    rows = Rows("row", [[1, 0]], [2], rbd.problem.Free(1), resultant=[[1], [0], [0]])
    assert rows.J.dtype == float and rows.resultant.tolist() == [[1.0], [0.0], [0.0]]


def test_what_a_contact_lacks_is_told_by_what_it_is():
    """A name that is none, a frame that is none: each message says which."""
    kinds = {rbd.PointContact: {}, rbd.LineContact: {"half_length": 0.1}, rbd.SurfaceContact: {"half_lengths": (1, 1)}}
    for kind, shape in kinds.items():
        with pytest.raises(InputError, match="name") as nameless:
            kind("", "frame", **shape)
        with pytest.raises(InputError, match="frame") as frameless:
            kind("toe", 3, **shape)
        assert "''" in str(nameless.value) and "3" in str(frameless.value)
