"""Contacts of a robot with the ground: points and surfaces, held, rubbing or smooth."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.surface import contact_axes
from rbd.testing import box, check_constraint


def _generic(robot: rbd.Robot, seed: int) -> rbd.State:
    """No particular pose, and a base turned any way."""
    rng = np.random.default_rng(seed)
    return robot.at(pin.integrate(robot.model, robot.standing().q, 0.5 * rng.normal(size=robot.nv)))


@pytest.mark.parametrize("name", ["talos", "g1", "solo12", "anymal_c", "human"])
@pytest.mark.parametrize("friction", [None, 0.0, 0.5])
def test_feet_of_the_catalogue_describe_their_motion(name, friction):
    """J, velocity and J_dot v of every foot, sole or point, against its motion along curves."""
    robot = rbd.load_robot(name)
    state = _generic(robot, seed=1)
    for foot in robot.feet(friction):
        report = check_constraint(foot, state, draws=3)
        assert report.against == "motion of the patch" and max(report.jacobian, report.jdot_v) < 1e-8


@pytest.mark.parametrize("friction", [None, 0.0, 0.5])
@pytest.mark.parametrize("normal", [(0, 0, 1), (0, 0, -1), (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0.6, 0, 0.8), (0.48, -0.64, 0.6)])
def test_points_on_any_wall_describe_their_motion(talos, normal, friction):
    """Floor, ceiling, walls, slopes."""
    point = rbd.PointContact(
        "toe", "left_sole_link", offset=(0.1, 0.02, -0.1), on=rbd.Ground(normal=np.array(normal, float)), friction=friction
    )
    report = check_constraint(point, _generic(talos, 2), draws=2)
    assert report.rows == (1 if friction == 0.0 else 3)


@pytest.mark.parametrize("friction", [None, 0.0, 0.5])
def test_patches_on_any_side_of_a_link_describe_their_motion(talos, friction, rng):
    """A patch turned and moved on its frame."""
    X_FP = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    patch = rbd.SurfaceContact("palm", "torso_2_link", half_lengths=(0.1, 0.2), placement=X_FP, friction=friction)
    assert check_constraint(patch, _generic(talos, 3), draws=2).rows == 6


def test_on_a_fixed_base_too():
    """The Panda's hand on a table."""
    panda = rbd.load_robot("panda", root="fixed")
    state = panda.at(np.r_[0.3, -0.5, 0.4, -1.9, 0.2, 1.6, 0.7, np.zeros(panda.nq - 7)])
    for contact in (
        rbd.PointContact("tip", "panda_hand", offset=(0, 0, 0.1), friction=0.5),
        rbd.SurfaceContact("palm", "panda_hand", half_lengths=(0.02, 0.03)),
    ):
        assert check_constraint(contact, state).jdot_v < 1e-9


@pytest.mark.parametrize("normal", np.vstack([np.eye(3), -np.eye(3), [[0.6, 0.0, 0.8], [0.95, 0.0, np.sqrt(1 - 0.95**2)]]]))
def test_contact_axes_are_right_handed_with_the_normal_third(normal):
    """R_WP is a rotation whose third column is the normal; on level ground it is the identity."""
    R = contact_axes(normal)
    assert np.allclose(R.T @ R, np.eye(3), atol=1e-15) and np.linalg.det(R) == pytest.approx(1.0)
    assert np.allclose(R[:, 2], normal)
    assert np.array_equal(contact_axes(np.array([0.0, 0.0, 1.0])), np.eye(3))


def test_a_contact_says_what_it_is(talos):
    """Name, frame, friction and corners are readable, as they were given."""
    sole = talos.soles(0.4)[0]
    assert (sole.name, sole.frame, sole.friction) == ("left_sole", "left_sole_link", 0.4)
    assert sole.corners.shape == (4, 3) and not sole.corners[:, 2].any()
    patch = rbd.SurfaceContact("p", "f", half_lengths=(0.1, 0.05))
    assert np.array_equal(np.abs(patch.corners), np.tile([0.1, 0.05, 0.0], (4, 1)))
    assert len(np.unique(patch.corners, axis=0)) == 4
    point = rbd.PointContact("p", "f")
    assert point.corners.tolist() == [[0.0, 0.0, 0.0]] and point.friction is None


@pytest.mark.parametrize(
    ("friction", "kind", "point_rows"),
    [(None, rbd.problem.Free, 3), (0.0, rbd.problem.NonNegative, 1), (0.5, rbd.problem.FrictionCone, 3)],
)
def test_friction_chooses_the_rows_and_the_cone(talos, friction, kind, point_rows):
    """None holds, zero only pushes, mu pushes and rubs."""
    state = talos.standing()
    point = rbd.PointContact("p", "left_sole_link", friction=friction).rows(state)
    assert isinstance(point.cone, kind) and len(point) == point_rows
    surface = talos.soles(friction)[0].rows(state)
    assert isinstance(surface.cone, rbd.problem.Free if friction is None else rbd.problem.WrenchCone) and len(surface) == 6


def test_a_sole_at_rest_on_a_slope_pushes_along_its_normal():
    """A box on a smooth slope of 30 deg: N = m g cos(30 deg) along the normal, in world axes, and it slides with g sin."""
    angle = np.pi / 6
    R = pin.exp3(np.array([0.0, angle, 0.0]))
    state = rbd.State(box(), pin.SE3ToXYZQUAT(pin.SE3(R, np.zeros(3))))
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=below, friction=0.0)
    points = [
        rbd.PointContact(f"p{i}", "box", offset=below.act(c), on=rbd.Ground(normal=R[:, 2]), friction=0.0)
        for i, c in enumerate(floor.corners)
    ]
    for contacts in ([floor], points):
        s = rbd.solve(state, np.zeros(0), contacts)
        total = sum(f[:3] for f in s.forces.values())
        assert total == pytest.approx(10 * 9.81 * np.cos(angle) * R[:, 2], abs=1e-8)
        assert R @ s.a[:3] == pytest.approx(9.81 * np.sin(angle) * R[:, 0], abs=1e-8)


@pytest.mark.parametrize("friction", [None, 0.9])
def test_corner_forces_on_a_slope_are_in_world_axes(friction):
    """A box that sticks on a slope of 30 deg is carried straight up, corner forces and moments included."""
    R = pin.exp3(np.array([0.2, np.pi / 6, 0.3]))
    state = rbd.State(box(), pin.SE3ToXYZQUAT(pin.SE3(R, np.zeros(3))))
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=below, friction=friction)
    s = rbd.solve(state, np.zeros(0), [floor])
    assert np.abs(s.a).max() < 1e-8
    corners, wrench = s.corner_forces["floor"], s.forces["floor"]
    assert corners.sum(axis=0) == pytest.approx([0.0, 0.0, 98.1], abs=1e-8)
    assert np.cross(floor.corners @ R.T, corners).sum(axis=0) == pytest.approx(wrench[3:], abs=1e-8)


def test_four_smooth_points_are_a_smooth_surface(talos, rng):
    """One law, said in 4 rows or in 6: the same acceleration and the same wrench."""
    sole = talos.soles(0.0)[0]
    points = [
        rbd.PointContact(f"p{i}", sole.frame, offset=sole.placement.act(c), friction=0.0) for i, c in enumerate(sole.corners)
    ]
    other = talos.soles(0.8)[1]
    state = talos.standing()
    for _ in range(5):
        tau = np.clip(10.0 * rng.normal(size=talos.nu), -talos.effort_limit, talos.effort_limit)
        one, four = (rbd.solve(state, tau, [*contacts, other]) for contacts in ([sole], points))
        assert np.abs(one.a - four.a).max() < 1e-7 * max(1.0, np.abs(one.a).max())
        normal = sum(four.forces[f"p{i}"][2] for i in range(4))
        assert one.forces["left_sole"][2] == pytest.approx(normal, abs=1e-6)


class TestMoving:
    """Under the convex law contacts that can break or slip are solved at rest only; those that hold take any motion."""

    def test_a_moving_contact_is_refused_by_name(self, talos):
        """Above 1e-6 m/s; the message names it, says how fast, and what to use."""
        v = np.zeros(talos.nv)
        v[0] = 0.5
        state = talos.standing().with_velocity(v)
        for contact in (talos.soles(0.5)[1], rbd.PointContact("right_sole", "right_sole_link", friction=0.3)):
            with pytest.raises(rbd.errors.ContactMoves, match=r"'right_sole'.*0\.5 m/s.*friction=None"):
                rbd.solve(state, np.zeros(talos.nu), [contact], law="convex")
        rbd.solve(state, np.zeros(talos.nu), talos.soles(None))

    def test_a_contact_that_leaves_carries_nothing(self, talos):
        """Lifted at 0.5 m/s, with the ground's friction or without: free fall, proved under the convex law too."""
        v = np.zeros(talos.nv)
        v[2] = 0.5
        state, tau = talos.standing().with_velocity(v), np.zeros(talos.nu)
        free = rbd.dynamics.free_acceleration(state, tau)
        for contact in (talos.soles(0.5)[1], rbd.PointContact("right_sole", "right_sole_link", friction=0.0)):
            with pytest.warns(rbd.errors.OpeningContactWarning, match="'right_sole' at .*0.5 m/s"):
                s = rbd.solve(state, tau, [contact])
            assert not s.forces["right_sole"].any() and np.abs(s.a - free).max() < 1e-10 * np.abs(free).max()

    @pytest.mark.parametrize(("speed", "refused"), [(9e-7, False), (1.1e-6, True)])
    def test_the_limit_is_a_millionth(self, talos, speed, refused):
        """Rounding is no motion."""
        v = np.zeros(talos.nv)
        v[0] = speed
        state = talos.standing().with_velocity(v)
        if refused:
            with pytest.raises(rbd.errors.ContactMoves):
                rbd.solve(state, np.zeros(talos.nu), talos.soles(0.5), law="convex")
        else:
            rbd.solve(state, np.zeros(talos.nu), talos.soles(0.5), law="convex")

    def test_a_turning_sole_is_refused(self, talos):
        """A sole that turns about its own centre is no surface contact."""
        sole = talos.soles(0.5)[0]
        state = talos.standing()
        J = sole.rows(state).J
        v = np.linalg.pinv(J) @ np.array([0, 0, 0, 0, 0, 0.2])
        with pytest.raises(rbd.errors.ContactMoves, match="'left_sole'"):
            rbd.solve(state.with_velocity(v), np.zeros(talos.nu), [sole], law="convex")

    def test_a_smooth_point_may_slide(self):
        """A puck on ice: only its normal row is there, and it does not move along it."""
        puck = box(1.0, (0.1, 0.1, 0.02))
        q = pin.neutral(puck.model)
        state = rbd.State(puck, q, np.array([3.0, -2.0, 0.0, 0.0, 0.0, 0.0]))
        s = rbd.solve(state, np.zeros(0), [rbd.PointContact("ice", "box", offset=(0, 0, -0.01), friction=0.0)])
        assert s.forces["ice"] == pytest.approx([0.0, 0.0, 9.81])


IDENTITY = pin.SE3.Identity()


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("friction", {"friction": -0.1}),
        ("friction", {"friction": np.nan}),
        ("friction", {"friction": "0.7"}),
        ("facets", {"friction": 0.5, "facets": 2}),
        ("offset", {"offset": (0.0, 0.0)}),
        ("offset", {"offset": (0.0, 0.0, np.inf)}),
        ("offset", {"offset": "here"}),
    ],
)
def test_a_point_that_means_nothing_is_refused(what, arguments):
    """By name, before any robot is involved."""
    with pytest.raises(rbd.InputError, match=what):
        rbd.PointContact("toe", "foot", **arguments)


@pytest.mark.parametrize(
    ("what", "normal"),
    [("length", (0.0, 0.0, 2.0)), ("length", (0.0, 0.0, 0.0)), ("normal", (0.0, 1.0)), ("normal", (0.0, np.nan, 1.0))],
)
def test_a_normal_that_means_nothing_is_refused(what, normal):
    """Of ground and of a body, before any contact is involved."""
    for make in (rbd.Ground, lambda **given: rbd.Body("table", **given)):
        with pytest.raises(rbd.InputError, match=what):
            make(normal=normal)


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("half_lengths.*or corners", {}),
        ("half_lengths.*or corners", {"half_lengths": (0.1, 0.1), "corners": [[0, 0], [0, 1], [1, 0]]}),
        ("half_lengths", {"half_lengths": (0.1, 0.0)}),
        ("half_lengths", {"half_lengths": (0.1, -0.1)}),
        ("half_lengths", {"half_lengths": (0.1, np.nan)}),
        ("half_lengths", {"half_lengths": 0.1}),
        ("half_lengths", {"half_lengths": (0.1, 0.1, 0.1)}),
        ("corners", {"corners": [[0, 0], [0, 1]]}),
        ("one line", {"corners": [[0, 0], [1, 1], [2, 2]]}),
        ("finite", {"corners": [[0, 0], [0, 1], [1, np.inf]]}),
        ("corners", {"corners": "four"}),
        ("friction", {"half_lengths": (0.1, 0.1), "friction": -1.0}),
        ("placement", {"half_lengths": (0.1, 0.1), "placement": np.eye(3)}),
        ("placement", {"half_lengths": (0.1, 0.1), "placement": np.diag([1.0, 1.0, -1.0, 1.0])}),
        ("placement", {"half_lengths": (0.1, 0.1), "placement": np.full((4, 4), np.nan)}),
    ],
)
def test_a_patch_that_means_nothing_is_refused(what, arguments):
    """By name, before any robot is involved."""
    with pytest.raises(rbd.InputError, match=what):
        rbd.SurfaceContact("sole", "foot", **arguments)


def test_a_frame_that_is_not_there_is_refused_with_the_nearest(talos):
    """Unknown ids crash Pinocchio, so no unknown name becomes one."""
    for contact in (rbd.PointContact("p", "left_sole_lnik"), rbd.SurfaceContact("s", "left_sole_lnik", half_lengths=(1, 1))):
        with pytest.raises(rbd.errors.FrameNotFound, match="'left_sole_link'"):
            contact.rows(talos.standing())


def test_two_contacts_of_one_name_are_refused(talos):
    """Their forces could not be told apart."""
    with pytest.raises(rbd.errors.DuplicateName, match="'left_sole'"):
        rbd.solve(talos.standing(), np.zeros(talos.nu), [talos.soles()[0], talos.soles()[0]])


class TestCorners:
    """One contact at k corner points: `PointContact`, `LineContact` and `SurfaceContact` are it at one, two and more."""

    PLACED = pin.SE3(pin.exp3(np.array([0.2, -0.1, 0.4])), np.array([0.1, -0.05, -0.1]))
    GROUNDS = {
        "nothing known": None,
        "ramp": rbd.Ground(point=(0.1, 0.2, 0.3), normal=(0.28, 0.0, 0.96)),
        "turntable": rbd.Ground(velocity=(0.1, 0.2, 0.3, 0.4, 0.5, 0.6), acceleration=(1, 2, 3), about=(0.3, 0.2, 0.1)),
        "body": rbd.Body("right_sole_link"),
    }

    def pairs(self, **more):
        """(at corners, by its thin constructor) of each of the three."""
        X, frame = self.PLACED, "left_sole_link"
        square = [[0.1, 0.05], [0.1, -0.05], [-0.1, -0.05], [-0.1, 0.05]]
        at = X.act(np.array([0.02, 0.03, 0.0]))
        edge = X * pin.SE3(pin.exp3(np.array([0.0, 0.0, np.pi / 2])), np.array([0.05, 0.0, 0.0]))
        return [
            (
                rbd.constraints.Contact("c", frame, corners=[[0.02, 0.03]], placement=X, **more),
                rbd.PointContact("c", frame, offset=at, **more),
            ),
            (
                rbd.constraints.Contact("c", frame, corners=[[0.05, 0.2], [0.05, -0.2]], placement=X, **more),
                rbd.LineContact("c", frame, half_length=0.2, placement=edge, **more),
            ),
            (
                rbd.constraints.Contact("c", frame, corners=square, placement=X, **more),
                rbd.SurfaceContact("c", frame, half_lengths=(0.1, 0.05), placement=X, **more),
            ),
        ]

    @pytest.mark.parametrize("friction", [None, 0.0, 0.6])
    @pytest.mark.parametrize("on", GROUNDS)
    def test_its_rows_are_those_of_the_three(self, talos, on, friction):
        """J, velocity, J_dot v, error, resultant and corners in W, free and anchored."""
        rng = np.random.default_rng(1)
        state = talos.at(
            pin.integrate(talos.model, talos.standing().q, 0.2 * rng.normal(size=talos.nv)), rng.normal(size=talos.nv)
        )
        for pair in self.pairs(on=self.GROUNDS[on], friction=friction):
            for one, other in (pair, [c.anchored(talos.standing()) for c in pair]):
                mine, theirs = one.rows(state), other.rows(state)
                for what in ("J", "velocity", "bias", "resultant"):
                    assert getattr(mine, what) == pytest.approx(getattr(theirs, what), abs=1e-12), what
                assert (mine.error is None) == (theirs.error is None)
                if mine.error is not None:
                    assert mine.error == pytest.approx(theirs.error, abs=1e-12)
                assert mine.patch.corners_W == pytest.approx(theirs.patch.corners_W, abs=1e-14)
                assert type(mine.cone) is type(theirs.cone) and mine.cone.dim == theirs.cone.dim

    @pytest.mark.parametrize("friction", [0.0, 0.6])
    @pytest.mark.parametrize("on", ["nothing known", "ramp", "turntable"])
    def test_its_points_are_its_corners(self, talos, on, friction):
        """J of each is that of the corner's velocity in the point's axes; gaps are to the plane, or to one through it."""
        rng = np.random.default_rng(2)
        state = talos.at(pin.integrate(talos.model, talos.standing().q, 0.2 * rng.normal(size=talos.nv)))
        for contact, _ in self.pairs(on=self.GROUNDS[on], friction=friction):
            points, k = contact.points(state), len(contact.corners)
            assert len(points.names) == len(points.cones) == len(points.gaps) == k == len(set(points.names))
            assert points.positions == pytest.approx(contact.rows(state).patch.corners_W, abs=1e-12)
            w = 3 if friction else 1
            for i, corner in enumerate(contact.corners):
                J = state.frame("left_sole_link", contact.placement.act(corner)).J[:3]
                assert points.J[w * i : w * i + w] == pytest.approx(points.axes.T[3 - w :] @ J, abs=1e-12)
            ground = self.GROUNDS[on]
            located = ground is not None and ground.point is not None
            expected = ground.distances(points.positions) if located else (points.positions - contact_place(contact, state))
            expected = expected if located else expected @ points.axes[:, 2]
            assert points.gaps == pytest.approx(expected, abs=1e-12)
            f = rng.normal(size=w * k)
            total = sum(points.axes[:, 3 - w :] @ f[w * i : w * i + w] for i in range(k))
            assert (points.resultant @ f)[:3] == pytest.approx(total, abs=1e-12)

    def test_a_ground_that_rises_carries_its_plane_along(self):
        """At 0.3 m/s along its normal for 0.2 s: every point is 6 cm nearer."""
        state = rbd.State(box(), pin.neutral(box().model))
        lift = rbd.Ground(point=(0.0, 0.0, -0.5), velocity=(0.1, 0.0, 0.3))
        sole = rbd.SurfaceContact("sole", "box", half_lengths=(0.1, 0.1), friction=0.5, on=lift)
        assert sole.points(state).gaps == pytest.approx(0.5) and sole.points(state, 0.2).gaps == pytest.approx(0.44)

    def test_what_holds_or_touches_a_body_has_no_points_of_its_own(self, talos):
        """There its rows say it all."""
        assert talos.soles(None)[0].points(talos.standing()) is None
        assert rbd.PointContact("p", "left_sole_link", friction=0.5, on=rbd.Body("base_link")).points(talos.standing()) is None

    @pytest.mark.parametrize(
        ("corners", "says"),
        [
            ([], "shape"),
            ([1.0, 2.0, 3.0], r"shape \(3,\)"),
            ([[1.0]], r"shape \(1, 1\)"),
            ([[0.1, 0.2], [0.1, 0.2]], "are one point"),
            ([[0, 0], [1, 1], [2, 2]], "lie on one line"),
            ([[0.1, np.nan]], "not finite"),
        ],
    )
    def test_corners_that_mean_nothing_are_refused(self, corners, says):
        """By name, before any robot is involved."""
        with pytest.raises(rbd.InputError, match=f"corners of contact 'c'.*{says}"):
            rbd.constraints.Contact("c", "box", corners=corners)


def contact_place(contact: rbd.constraints.Contact, state: rbd.State) -> np.ndarray:
    """The contact's centre in W."""
    return (state.frame(contact.frame).X_WF * contact.placement).translation


def test_feet_can_stand_on_a_body(talos):
    """On a table, a body of the same model that is held still: forces and motion as on the ground."""
    pair = rbd.robots.merge_robots(talos, box(20.0, (2.0, 2.0, 0.2)), names=("", "table_"))
    q = pair.q(talos.standing().q, np.r_[0.0, 0.0, -0.1, 0.0, 0.0, 0.0, 1.0])
    tau = rbd.hold(talos.standing(), talos.soles()).tau
    still = rbd.JointLock("still", "table_root_joint")
    soles = talos.soles(on=rbd.Body("table_box"))
    assert all(sole.frames == (sole.frame, "table_box") for sole in soles)
    on_table = rbd.solve(pair.at(q), tau, [*soles, still])
    on_ground = rbd.solve(talos.standing(), tau, talos.soles())
    assert on_table.a[: talos.nv] == pytest.approx(on_ground.a, abs=1e-7)
    for sole in soles:
        assert on_table.forces[sole.name] == pytest.approx(on_ground.forces[sole.name], abs=1e-5)
    assert on_table.forces.get("still", on_table.multipliers[-6:])[2] == pytest.approx((20.0 + talos.mass) * 9.81, abs=1e-5)


class Heel(rbd.SurfaceContact):
    """A user's sole with a constructor of its own."""

    def __init__(self, side: str, length: float) -> None:
        super().__init__(f"{side}_heel", "box", half_lengths=(length, 0.05), friction=0.5)
        self.__dict__["side"] = side


def test_contacts_with_constructors_of_their_own_are_copied_whole():
    """Another friction, an anchor and a new name leave class, size and attributes as they are."""
    heel, state = Heel("left", 0.1), rbd.State(rbd.testing.box(), [0, 0, 0, 0, 0, 0, 1])
    others = heel.with_friction(0.9), heel.anchored(state), heel.renamed("b_", None)
    assert [other.friction for other in others] == [0.9, 0.5, 0.5] and others[2].name == "b_left_heel"
    for other in others:
        assert type(other) is Heel and other.side == "left" and np.array_equal(other.corners, heel.corners)
    assert np.abs(others[1].rows(state).error).max() == 0.0 and others[0].cone.mu == 0.9
