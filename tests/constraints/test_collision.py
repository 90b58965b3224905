"""Contacts found from collision shapes: points, gaps, rows and forces."""

from __future__ import annotations

import pickle
import threading
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.collision import CollisionContacts, CollisionShapes
from rbd.constraints.convex.convex_shapes import convex_shape
from rbd.constraints.convex.polygons import convex_hull
from rbd.testing import check_constraint

BOX = Path(__file__).parents[2] / "urdf" / "box.urdf"  # 10 kg, 0.4 x 0.4 x 0.2 m
GRAVITY = 9.81


def urdf(tmp: Path, name: str, shape: str) -> rbd.Robot:
    """A free body of 2 kg with one collision shape of URDF, its centre at the frame."""
    inertial = '<inertial><mass value="2"/><inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>'
    collision = f"<collision><geometry>{shape}</geometry></collision>"
    path = tmp / f"{name}.urdf"
    path.write_text(f'<robot name="{name}"><link name="{name}">{inertial}{collision}</link></robot>')
    return rbd.load_robot(path)


def mjcf(tmp: Path, name: str, geom: str) -> rbd.Robot:
    """The same with one of MJCF."""
    inertial = '<inertial pos="0 0 0" mass="2" diaginertia=".02 .02 .02"/>'
    body = f'<body name="{name}"><freejoint/>{inertial}<geom {geom}/></body>'
    path = tmp / f"{name}.xml"
    path.write_text(f'<mujoco model="{name}"><worldbody>{body}</worldbody></mujoco>')
    return rbd.load_robot(path)


@pytest.fixture(scope="module")
def bodies(tmp_path_factory: pytest.TempPathFactory) -> dict[str, rbd.Robot]:
    """One free body of each shape."""
    tmp = tmp_path_factory.mktemp("shapes")
    return {
        "ball": urdf(tmp, "ball", '<sphere radius="0.1"/>'),
        "can": urdf(tmp, "can", '<cylinder radius="0.1" length="0.3"/>'),
        "brick": urdf(tmp, "brick", '<box size="0.2 0.3 0.1"/>'),
        "globe": urdf(tmp, "globe", '<sphere radius="1.0"/>'),
        "slab": urdf(tmp, "slab", '<box size="4 4 1"/>'),
        "pill": mjcf(tmp, "pill", 'type="capsule" size="0.1 0.2"'),
        "egg": mjcf(tmp, "egg", 'type="ellipsoid" size="0.1 0.2 0.15"'),
    }


def at(robot: rbd.Robot, height: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0), v=None) -> rbd.State:
    """A free body at a height, turned by a rotation vector."""
    pose = pin.SE3(pin.exp3(np.array(turn)), np.array([0.0, 0.0, height]))
    return robot.at(pin.SE3ToXYZQUAT(pose), v)


@pytest.fixture
def box() -> rbd.Robot:
    """The box of the contact cases."""
    return rbd.load_robot(BOX)


def test_a_box_on_the_floor_is_four_points_at_its_corners(box, rng):
    """J, velocity and J_dot v are those of `PointContact`s at the corners, also while the box turns and slides."""
    state = at(box, 0.1, (0.0, 0.0, 0.4), rng.normal(size=6))
    contacts = CollisionContacts("floor", box, friction=0.6)
    rows, found = contacts.rows(state), contacts.points(state)
    assert len(found.names) == 4 and np.abs(found.gaps).max() < 1e-15
    offsets = (found.positions - [0.0, 0.0, 0.1]) @ state.frame("box").X_WF.rotation
    assert {tuple(x) for x in np.round(offsets, 12).tolist()} == {(x, y, -0.1) for x in (0.2, -0.2) for y in (0.2, -0.2)}
    points = [rbd.PointContact(n, "box", offset=p, friction=0.6).rows(state) for n, p in zip(found.names, offsets, strict=True)]
    for what in ("J", "velocity", "bias"):
        expected = np.concatenate([getattr(p, what) for p in points])
        assert np.abs(getattr(rows, what) - expected).max() < 1e-13
    assert rows.cone.dim == 12 and (np.flatnonzero(rows.holonomic) == [2, 5, 8, 11]).all()


@pytest.mark.parametrize(
    ("solver", "push_N", "normal_N", "a"),
    [
        (rbd.ConeSolver(), 80.0, 98.1, (2.114, 0.0, 0.0)),
        (rbd.ConeSolver(), 30.0, 98.1, (0.0, 0.0, 0.0)),
        (rbd.ProxQP(), 30.0, 98.1, (0.0, 0.0, 0.0)),
        (rbd.ProxQP(), 80.0, 107.426470588, (1.554411765, 0.0, 0.932647059)),
    ],
)
def test_a_pushed_box_obeys_both_laws(box, solver, push_N, normal_N, a):
    """The slipping box of the contact cases: Coulomb's law slides at 2.114 m/s2 under 98.1 N, the convex law lifts off."""
    push = [rbd.ExternalForce("box", (push_N, 0.0, 0.0))]
    floor = CollisionContacts("floor", box, friction=0.6)
    solution = rbd.solve(at(box, 0.1), np.zeros(0), [floor], external=push, solver=solver)
    assert np.abs(solution.a[:3] - a).max() < 1e-8
    assert abs(solution.forces["floor"][2] - normal_N) < 1e-8
    assert np.abs(solution.corner_forces["floor"].sum(axis=0) - solution.forces["floor"][:3]).max() < 1e-8
    assert abs(solution.contacts["floor"].normal - normal_N) < 1e-8
    assert "floor" in str(solution) and solution.residuals.centroidal.scaled < 1e-9


def test_the_wrench_is_about_the_planes_point(box):
    """A box at rest 3 m from the origin: its weight's moment about W's origin is 3 m g, and the centre of pressure below it."""
    q = box.neutral()
    q[:3] = 3.0, 0.0, 0.1
    solution = rbd.solve(box.at(q), np.zeros(0), [CollisionContacts("floor", box)])
    assert np.abs(solution.forces["floor"] - [0.0, 0.0, 98.1, 0.0, -3.0 * 98.1, 0.0]).max() < 1e-8
    assert np.abs(solution.contacts["floor"].centre_of_pressure - [3.0, 0.0, 0.0]).max() < 1e-9


def test_without_friction_there_is_one_row_a_point(box):
    """friction=0 gives the normal rows alone, which carry the weight."""
    state = at(box, 0.1)
    smooth, rough = (CollisionContacts("floor", box, friction=mu).rows(state) for mu in (0.0, 0.5))
    assert (smooth.J == rough.J[2::3]).all() and smooth.holonomic.all() and len(smooth) == 4
    solution = rbd.solve(state, np.zeros(0), [CollisionContacts("floor", box, friction=0.0)])
    assert abs(solution.corner_forces["floor"][:, 2].sum() - 98.1) < 1e-9


@pytest.mark.parametrize(("shape", "lowest"), [("ball", 0.1), ("can", None), ("brick", None), ("pill", None), ("egg", None)])
def test_the_lowest_gap_is_coals_distance_to_a_half_space(bodies, rng, shape, lowest):
    """On an inclined plane too: the smallest gap is the signed distance, to rounding."""
    robot = bodies[shape]
    n = np.array([0.3, -0.2, 0.9])
    n /= np.linalg.norm(n)
    contacts = CollisionContacts("slope", robot, on=rbd.Ground(normal=n, point=(0.1, 0.2, 0.3)), margin=10.0)
    plane = coal.Halfspace(n, float(n @ [0.1, 0.2, 0.3]))
    for _ in range(20):
        turn = rng.normal(size=3)
        state = at(robot, 0.6, tuple(turn))
        object_ = robot.collision_model.geometryObjects[0]
        X = pin.XYZQUATToSE3(state.q) * object_.placement
        distance = coal.distance(
            plane, coal.Transform3s(), object_.geometry, coal.Transform3s(X.rotation, X.translation),
            coal.DistanceRequest(), coal.DistanceResult(),
        )  # fmt: skip
        found = contacts.points(state)
        assert abs(found.gaps.min() - distance) < 1e-12
        assert np.abs((found.positions - [0.1, 0.2, 0.3]) @ n - found.gaps).max() < 1e-12
        assert np.abs(found.axes[:, :, 2] - n).max() < 1e-15
    if lowest is not None:
        assert abs(CollisionContacts("floor", robot, margin=9.0).points(at(robot, 0.7)).gaps[0] - (0.7 - lowest)) < 1e-15


@pytest.mark.parametrize("shape", ["ball", "can", "brick", "pill", "egg"])
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.0, 0.6, 0.8)])
def test_rows_describe_the_motion_of_the_place_of_contact(bodies, shape, normal):
    """The normal rows are first and second derivative of the gap, tangential ones of their velocity; whatever the shape."""
    robot = bodies[shape]
    contacts = CollisionContacts("floor", robot, on=rbd.Ground(normal=normal, point=(0.0, 0.0, 0.0)), margin=5.0)
    report = check_constraint(contacts, at(robot, 0.3, (0.5, -0.7, 0.4)))
    assert report.jdot_v < 1e-9


def test_a_ball_that_rolls_is_the_rolling_ball(bodies, rng):
    """The rows of `RollingBall`: no centripetal acceleration, as the place of contact stays below the centre."""
    ball = bodies["ball"]
    state = at(ball, 0.1, (0.3, 0.2, 0.1), rng.normal(size=6))
    rows = CollisionContacts("floor", ball, friction=0.4).rows(state)
    rolling = rbd.RollingBall("floor", "ball", radius=0.1, friction=0.4).rows(state)
    for what in ("J", "velocity", "bias", "error"):
        assert np.abs(getattr(rows, what) - getattr(rolling, what)).max() < 1e-14


def test_a_box_on_its_edge_touches_with_two_corners(box):
    """Turned by 45 degrees about y, the lowest edge lies 0.3 sin 45 below the centre; nothing else is near."""
    height = (0.2 + 0.1) / np.sqrt(2.0)
    contacts = CollisionContacts("floor", box)
    found = contacts.points(at(box, height, (0.0, np.pi / 4.0, 0.0)))
    assert len(found.names) == 2 and np.abs(found.gaps).max() < 1e-15
    assert np.abs(np.abs(found.positions[:, 1]) - 0.2).max() < 1e-15
    assert contacts.points(at(box, height + 2e-4, (0.0, np.pi / 4.0, 0.0))).names == ()
    assert len(contacts.with_margin(0.5).points(at(box, height, (0.0, np.pi / 4.0, 0.0))).names) == 8


def test_a_can_stands_on_its_rim_and_rolls_on_its_side(bodies):
    """Upright: eight points of the rim. On its side: the lowest points of both rims. Leaning: the lowest of one."""
    can = bodies["can"]
    contacts = CollisionContacts("floor", can)
    upright = contacts.points(at(can, 0.15))
    assert len(upright.names) == 8 and np.abs(np.hypot(*upright.positions[:, :2].T) - 0.1).max() < 1e-15
    side = contacts.points(at(can, 0.1, (np.pi / 2.0, 0.0, 0.0)))
    assert len(side.names) == 2 and np.abs(np.abs(side.positions[:, 1]) - 0.15).max() < 1e-15
    lean = 0.3
    leaning = contacts.points(at(can, 0.15 * np.cos(lean) + 0.1 * np.sin(lean), (lean, 0.0, 0.0)))
    assert len(leaning.names) == 1 and abs(leaning.gaps[0]) < 1e-15


def test_names_stay_with_the_corners(box, rng):
    """A point's name is the shape's with the corner's number: the same material point wherever the box is."""
    contacts = CollisionContacts("floor", box, margin=5.0)
    places = {}
    for _ in range(5):
        state = at(box, 1.0, tuple(rng.normal(size=3)))
        found = contacts.points(state)
        local = state.frame("box").X_WF.actInv
        for name, p in zip(found.names, found.positions, strict=True):
            assert np.abs(places.setdefault(name, local(p)) - local(p)).max() < 1e-14
    assert sorted(places) == [f"box_0:{i}" for i in range(8)]


def test_nothing_near_gives_no_rows(box):
    """A box in the air has no rows, and falls."""
    contacts = CollisionContacts("floor", box)
    rows = contacts.rows(at(box, 1.0))
    assert len(rows) == 0 and rows.J.shape == (0, 6)
    solution = rbd.solve(at(box, 1.0), np.zeros(0), [contacts])
    assert abs(solution.a[2] + GRAVITY) < 1e-12 and (solution.forces["floor"] == np.zeros(6)).all()
    assert str(solution)


@pytest.mark.parametrize("solver", [rbd.ProxQP(), rbd.ConeSolver()])
def test_g1_stands_on_its_eight_balls(g1, solver):
    """Four spheres a foot: forces that push add up to the weight, by both laws."""
    state = g1.standing()
    contacts = CollisionContacts("ground", g1)
    assert len(contacts.points(state).names) == 8
    solution = rbd.solve(state, rbd.hold(state, g1.feet()).tau, [contacts], solver=solver)
    assert np.abs(solution.forces["ground"][:3] - [0.0, 0.0, g1.mass * GRAVITY]).max() < 1e-8
    assert (solution.corner_forces["ground"][:, 2] > 0.0).all() and np.abs(solution.a).max() < 1e-8


def test_talos_stands_on_its_meshes(talos):
    """The hulls of its soles, uneven by a millimetre: at most sixteen points each, which carry the weight."""
    state = talos.standing()
    contacts = CollisionContacts("ground", talos, margin=1e-3)
    found = contacts.points(state)
    assert {name.split(":")[0] for name in found.names} == {"leg_left_6_link_0", "leg_right_6_link_0"}
    assert 3 <= sum(name.startswith("leg_left") for name in found.names) <= 16
    solution = rbd.solve(state, rbd.hold(state, talos.soles()).tau, [contacts])
    assert np.abs(solution.forces["ground"][:3] - [0.0, 0.0, talos.mass * GRAVITY]).max() < 1e-7
    assert solution.status is rbd.problem.Status.SOLVED


def test_many_points_leave_those_that_carry(talos):
    """Of the twenty that are near the eight lowest are kept, and what spans nearly all that the twenty span."""

    def area(points: np.ndarray) -> float:
        x, y = convex_hull(points).T
        return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))

    (foot,) = [s for s in talos.collision_model.geometryObjects if s.name == "leg_left_6_link_0"]
    shape = convex_shape(foot)
    up = np.array([0.0, 0.0, 1.0])
    limit = shape.lowest(up) + 1e-3
    near = shape.vertices[shape.vertices @ up <= limit]
    numbers, points = shape.low(up, limit)
    assert len(near) > 16 >= len(numbers)
    assert area(points[:, :2]) > 0.99 * area(near[:, :2])
    assert set(np.sort(near[:, 2])[:8]) <= set(points[:, 2])


def test_a_foot_that_stands_keeps_its_points(talos, rng):
    """Small motions of a foot on the ground do not change which of its many points carry: the eight lowest stay in."""
    contacts = CollisionContacts("ground", talos, ground=["leg_left_6_link"], margin=0.05)
    start = talos.standing()
    before = contacts.points(start)
    carry = {name for name, gap in zip(before.names, before.gaps, strict=True) if gap < before.gaps.min() + 1e-4}
    for _ in range(20):
        q = pin.integrate(talos.model, start.q, 1e-4 * rng.normal(size=talos.nv))
        assert carry <= set(contacts.points(talos.at(q)).names)


def pair_of(bodies, one: str, other: str, X_1: pin.SE3, X_2: pin.SE3, margin: float = 0.02):
    """(contacts between two free bodies, their state)."""
    pair = rbd.robots.merge_robots(bodies[one], bodies[other])
    state = pair.at(pair.q(pin.SE3ToXYZQUAT(X_1), pin.SE3ToXYZQUAT(X_2)))
    named = [(f"a_{one}", f"b_{other}")]
    return CollisionContacts("pair", pair, ground=False, pairs=named, margin=margin), state


def placed(*p: float, turn: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> pin.SE3:
    """A pose by place and rotation vector."""
    return pin.SE3(pin.exp3(np.array(turn)), np.array(p))


def test_two_balls_touch_on_their_line_of_centres(bodies):
    """Gap: distance of the centres less the radii; the normal pushes the first away; rows as the motion has them."""
    centre = np.array([0.5, 0.3, 2.0])
    contacts, state = pair_of(bodies, "globe", "globe", placed(*centre), placed(0.0, 0.0, 0.0), margin=1.0)
    found = contacts.points(state)
    away = float(np.linalg.norm(centre))
    assert abs(found.gaps[0] - (away - 2.0)) < 1e-14
    assert np.abs(found.axes[0, :, 2] - centre / away).max() < 1e-14
    assert check_constraint(contacts, state).jdot_v < 1e-8


# The brick's edges lean so that the next corners are all as high as can be, 86 mm above the lowest.
ON_A_CORNER = tuple(pin.log3(pin.Quaternion.FromTwoVectors(np.array([30.0, 20.0, 60.0]), np.array([0.0, 0.0, 1.0])).matrix()))


@pytest.mark.parametrize(
    ("one", "X"),
    [
        ("ball", placed(0.2, 0.3, 0.605)),
        ("egg", placed(0.2, 0.3, 0.655, turn=(0.0, 0.0, 0.3))),
        ("brick", placed(0.2, 0.3, 0.5 + 0.5 * 0.26, turn=ON_A_CORNER)),
        ("pill", placed(0.2, 0.3, 0.70, turn=(0.8, 0.0, 0.0))),
    ],
)
@pytest.mark.parametrize("first", [True, False])
def test_rows_of_what_touches_a_moving_face_describe_the_motion(bodies, one, X, first):
    """A ball, an ellipsoid, a corner, an end of a capsule on the face of a slab that moves too; either may come first."""
    names, poses = ((one, "slab"), (X, placed(0.0, 0.0, 0.0))) if first else (("slab", one), (placed(0.0, 0.0, 0.0), X))
    contacts, state = pair_of(bodies, *names, *poses, margin=0.05)
    found = contacts.points(state)
    assert len(found.names) == 1 and abs(abs(found.axes[0, 2, 2]) - 1.0) < 1e-15
    assert found.axes[0, 2, 2] * (1.0 if first else -1.0) > 0.0
    assert check_constraint(contacts, state).jdot_v < 1e-9


def test_a_box_on_a_box_touches_at_the_corners_that_coal_finds(bodies):
    """Two boxes face on face, one turned and shifted: the corners of the common polygon, as in Coal's contact patch."""
    X = placed(0.02, 0.03, 0.1, turn=(0.0, 0.0, 0.3))
    contacts, state = pair_of(bodies, "brick", "brick", X, placed(0.0, 0.0, 0.0))
    found = contacts.points(state)
    brick = coal.Box(0.2, 0.3, 0.1)
    request, result, patches = coal.CollisionRequest(), coal.CollisionResult(), coal.ContactPatchResult()
    request.security_margin, request.enable_contact, request.num_max_contacts = 1e-3, True, 1
    poses = coal.Transform3s(X.rotation, X.translation), coal.Transform3s()
    coal.collide(brick, poses[0], brick, poses[1], request, result)
    coal.computeContactPatch(brick, poses[0], brick, poses[1], result, coal.ContactPatchRequest(), patches)
    patch = patches.getContactPatch(0)
    expected = np.array([patch.getPoint(i) for i in range(patch.size())])
    assert len(expected) == len(found.names) == 7
    away = np.linalg.norm(found.positions[:, None] - expected, axis=2)
    assert away.min(axis=0).max() < 1e-5 and away.min(axis=1).max() < 1e-5  # Coal's normal is off by 1e-5 here
    assert np.abs(found.gaps).max() < 1e-14 and (found.axes[:, 2, 2] == 1.0).all()


def test_gaps_between_tilted_faces_are_those_of_the_surfaces(bodies):
    """A brick over a slab, tilted by 0.01: each corner's gap is its own height over the face."""
    tilt = 0.01
    X = placed(0.0, 0.0, 0.5 + 0.05 * np.cos(tilt) + 0.15 * np.sin(tilt), turn=(tilt, 0.0, 0.0))
    contacts, state = pair_of(bodies, "brick", "slab", X, placed(0.0, 0.0, 0.0))
    gaps = np.sort(contacts.points(state).gaps)
    assert np.abs(gaps - [0.0, 0.0, 0.3 * np.sin(tilt), 0.3 * np.sin(tilt)]).max() < 1e-12


def test_a_can_on_a_slab_touches_as_on_the_ground(bodies):
    """Upright on eight points, on its side on two, where its rims are."""
    upright, state = pair_of(bodies, "can", "slab", placed(0.0, 0.0, 0.65), placed(0.0, 0.0, 0.0))
    assert len(upright.points(state).names) == 8 and np.abs(upright.points(state).gaps).max() < 1e-14
    side, state = pair_of(bodies, "can", "slab", placed(0.0, 0.0, 0.6, turn=(np.pi / 2.0, 0.0, 0.0)), placed(0.0, 0.0, 0.0))
    found = side.points(state)
    assert len(found.names) == 2 and np.abs(np.abs(found.positions[:, 1]) - 0.15).max() < 1e-12
    assert np.abs(found.gaps).max() < 1e-12


def test_a_stack_of_two_presses_with_its_weight(bodies):
    """Brick on brick on the ground: the ground carries both, the lower the upper, and nothing moves."""
    pair = rbd.robots.merge_robots(bodies["brick"], bodies["brick"])
    state = pair.at(pair.q(pin.SE3ToXYZQUAT(placed(0.01, 0.02, 0.15)), pin.SE3ToXYZQUAT(placed(0.0, 0.0, 0.05))))
    ground = CollisionContacts("ground", pair)
    between = CollisionContacts("between", pair, ground=False, pairs=[("a_brick_0", "b_brick")])
    for solver in (rbd.ProxQP(), rbd.ConeSolver()):
        solution = rbd.solve(state, np.zeros(0), [ground, between], solver=solver)
        assert np.abs(solution.a).max() < 1e-8
        assert abs(solution.forces["ground"][2] - 4.0 * GRAVITY) < 1e-8
        assert abs(solution.forces["between"][2::3].sum() - 2.0 * GRAVITY) < 1e-8


def test_bricks_whose_corners_could_meet_and_do_not_have_no_rows(bodies):
    """One brick 0.02 m above the other: the balls about them overlap, their faces are apart, and the upper one falls."""
    pair = rbd.robots.merge_robots(bodies["brick"], bodies["brick"])
    state = pair.at(pair.q(pin.SE3ToXYZQUAT(placed(0.0, 0.0, 0.17)), pin.SE3ToXYZQUAT(placed(0.0, 0.0, 0.05))))
    between = CollisionContacts("between", pair, ground=False, pairs=[("a_brick_0", "b_brick")])
    assert len(between.rows(state)) == 0
    solution = rbd.solve(state, np.zeros(0), [CollisionContacts("ground", pair), between])
    assert solution.a[[2, 8]] == pytest.approx([-GRAVITY, 0.0], abs=1e-9)


def test_all_pairs_leave_out_neighbours():
    """pairs=True takes all shapes of bodies that no joint connects; a model's own collision pairs go before."""
    solo = rbd.load_robot("solo12")
    found = CollisionShapes("self", solo).pairs(True)
    parents = solo.model.parents
    assert len(found) > 50
    for one, other in found:
        assert one.joint != other.joint and parents[one.joint] != other.joint and parents[other.joint] != one.joint
    names = [shape.name for shape in solo.collision_model.geometryObjects]
    ids = names.index("FL_FOOT_0"), names.index("FR_FOOT_0")
    solo.collision_model.addCollisionPair(pin.CollisionPair(*ids))
    assert [(a.name, b.name) for a, b in CollisionShapes("self", solo).pairs(True)] == [("FL_FOOT_0", "FR_FOOT_0")]


def test_copies_and_threads_find_the_same(g1):
    """A copy made by pickle, and eight threads at once, give bit for bit the same rows."""
    contacts = CollisionContacts("ground", g1, margin=1e-3)
    q = g1.standing().q
    states = [g1.at(q) for _ in range(8)]
    expected = contacts.rows(states[0])
    copied = pickle.loads(pickle.dumps(contacts))
    assert (copied.rows(states[0]).J == expected.J).all()
    out: dict[int, bool] = {}

    def work(i: int) -> None:
        out[i] = all((contacts.rows(states[(i + j) % 8]).J == expected.J).all() for j in range(8))

    threads = [threading.Thread(target=work, args=(i,)) for i in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert out == dict.fromkeys(range(8), True)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"friction": -0.1}, "friction is -0.1"),
        ({"friction": None}, "are unilateral"),
        ({"ground": ["bax"]}, "nearest: 'box'"),
        ({"ground": "box"}, "expected a list"),
        ({"ground": 3}, "expected True or a list"),
        ({"ground": [3]}, "names of links or shapes"),
        ({"pairs": [("box", "bax")]}, "nearest: 'box'"),
        ({"pairs": [("box", "box_0")]}, "one body"),
        ({"pairs": [("box",)]}, "expected two names"),
        ({"ground": False}, "nothing can touch"),
        ({"on": "floor"}, "on of 'floor' is 'floor'; expected rbd.Ground"),
        ({"on": rbd.Ground(normal=(0.0, 0.0, 1.0))}, "with a point"),
        ({"on": rbd.Body("box")}, "expected rbd.Ground"),
        ({"on": rbd.Ground(point=(0, 0, 0), velocity=(0, 0, 0, 0, 0, 1), about=(0, 0, 0))}, "the ground of .* turns"),
        ({"margin": -1.0}, "length >= 0"),
        ({"facets": 2}, "facets is 2"),
    ],
)
def test_what_means_nothing_is_refused(box, given, words):
    """Each with what came and what was expected."""
    with pytest.raises(rbd.InputError, match=words):
        CollisionContacts("floor", box, **given)


def test_other_robots_and_robots_without_shapes_are_refused(box, bodies, tmp_path):
    """A state of another robot; a robot of points; no robot at all; no name."""
    contacts = CollisionContacts("floor", box)
    with pytest.raises(rbd.InputError, match="the state is of ball"):
        contacts.rows(bodies["ball"].at())
    with pytest.raises(rbd.InputError, match="has no collision shapes"):
        CollisionContacts("floor", rbd.load_robot(BOX.parent / "four_bar.urdf"))
    with pytest.raises(rbd.InputError, match="wants a robot second"):
        CollisionContacts("floor", "box")
    with pytest.raises(rbd.InputError, match="expected a string"):
        CollisionContacts("", box)
    with pytest.raises(rbd.InputError, match="want a State"):
        contacts.rows(box.neutral())


def test_a_mesh_that_cannot_be_had_is_refused_unless_left_out(tmp_path):
    """The box that stands in for a lost mesh touches nothing; other shapes still may."""
    path = tmp_path / "lost.urdf"
    inertial = '<inertial><mass value="2"/><inertia ixx=".02" iyy=".02" izz=".02" ixy="0" ixz="0" iyz="0"/></inertial>'
    mesh = '<collision name="lost"><geometry><mesh filename="package://nowhere/lost.stl"/></geometry></collision>'
    ball = '<collision><geometry><sphere radius=".1"/></geometry></collision>'
    path.write_text(f'<robot name="lost"><link name="body">{inertial}{mesh}{ball}</link></robot>')
    robot = rbd.load_robot(path)
    with pytest.warns(rbd.errors.ModelWarning, match="boxes in place"):
        shapes = [s.name for s in robot.collision_model.geometryObjects]
    with pytest.raises(rbd.InputError, match="was not found"):
        CollisionContacts("floor", robot)
    assert len(CollisionContacts("floor", robot, ground=[shapes[1]]).points(at(robot, 0.1)).names) == 1


def test_a_ball_that_slides_begins_to_roll(bodies):
    """Simulated: with I = m r^2 it sticks after t = v0 / (2 mu g), at half its speed; both come out to the step's square."""
    ball = bodies["ball"]
    contacts = CollisionContacts("floor", ball, friction=0.3)
    motion = rbd.simulate(at(ball, 0.1, v=np.eye(6)[0]), [contacts], duration=0.3, step=2e-3, progress=False)
    stuck = [event.t for event in motion.events if event.kind == "sticks"]
    assert abs(stuck[0] - 1.0 / (2.0 * 0.3 * GRAVITY)) < 2e-3**2
    speed = np.linalg.norm(motion.v[-1][:3])
    assert abs(speed - 0.5) < 2.0 * 2e-3**2
