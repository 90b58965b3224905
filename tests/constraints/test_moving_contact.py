"""Contacts with surfaces that move: lifts, belts, carts, turntables; and anchors on them."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.testing import ConstraintWrong, box, check_constraint, law_residuals

M, G, MU = 10.0, 9.81, 0.6  # a box of 0.4 x 0.4 x 0.2 m
BELOW = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
FREE = pin.SE3(pin.exp3(np.array([0.3, -0.5, 0.8])), np.array([0.1, -0.2, 0.05]))


def _patch(friction: float | None = MU, **more) -> rbd.SurfaceContact:
    return rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=BELOW, friction=friction, **more)


def _points(friction: float | None = MU, **more) -> list[rbd.PointContact]:
    corners = BELOW.translation + 0.2 * np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0]])
    return [rbd.PointContact(f"corner {i}", "box", offset=c, friction=friction, **more) for i, c in enumerate(corners)]


def _edges(friction: float | None = MU, **more) -> list[rbd.LineContact]:
    sides = [pin.SE3(np.eye(3), np.array([0.0, y, -0.1])) for y in (0.2, -0.2)]
    more["friction"] = friction
    return [rbd.LineContact(f"edge {i}", "box", half_length=0.2, placement=X, **more) for i, X in enumerate(sides)]


KINDS = {"point": _points, "line": _edges, "surface": lambda *a, **k: [_patch(*a, **k)]}
SOLVERS = [rbd.ProxQP(), rbd.ConeSolver()]


def _at(x: float = 0.0, v: np.ndarray | None = None) -> rbd.State:
    return rbd.State(box(M), np.array([x, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]), v)


def _total(s: rbd.Solution) -> np.ndarray:
    return sum(f[:3] for f in s.forces.values())


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("lift", [3.0, -4.0])
def test_a_box_on_a_lift_presses_with_m_g_plus_a(kind, solver, lift):
    """N = m (g + a), going up or down, at any speed of the lift."""
    v = np.array([0.0, 0.0, 1.5, 0.0, 0.0, 0.0])
    s = rbd.solve(
        _at(v=v), np.zeros(0), KINDS[kind](on=rbd.Ground(velocity=(0, 0, 1.5), acceleration=(0, 0, lift))), solver=solver
    )
    assert _total(s) == pytest.approx([0.0, 0.0, M * (G + lift)], abs=1e-7)
    assert s.a == pytest.approx([0.0, 0.0, lift, 0.0, 0.0, 0.0], abs=1e-8)
    assert all(np.abs(c).max() < 1e-8 for c in s.accelerations.values())  # relative to the lift


def test_a_lift_that_falls_faster_than_g_leaves_the_box_behind():
    """No force, and the box falls freely."""
    s = rbd.solve(_at(), np.zeros(0), [_patch(on=rbd.Ground(acceleration=(0.0, 0.0, -12.0)))], solver=rbd.ConeSolver())
    assert np.abs(s.forces["floor"]).max() < 1e-9 and s.a[2] == pytest.approx(-G)
    assert s.accelerations["floor"][2] == pytest.approx(12.0 - G)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
def test_a_box_moves_with_its_belt(kind, solver):
    """At the belt's speed it is at rest: nothing rubs, and what the belt's acceleration asks for is m a."""
    state = _at(v=np.array([1.2, -0.4, 0, 0, 0, 0]))
    for a in ((0.0, 0.0, 0.0), (2.0, 1.0, 0.0)):
        s = rbd.solve(state, np.zeros(0), KINDS[kind](on=rbd.Ground(velocity=(1.2, -0.4, 0.0), acceleration=a)), solver=solver)
        assert _total(s) == pytest.approx([M * a[0], M * a[1], M * G], abs=1e-7)
        assert s.a[:3] == pytest.approx(a, abs=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_a_box_slower_than_its_belt_is_rubbed_along(kind):
    """Coulomb: mu m g along the belt's motion relative to the box, whatever the speeds; the centre gains mu g."""
    v = np.array([0.5, 0.0, 0, 0, 0, 0])
    s = rbd.solve(_at(v=v), np.zeros(0), KINDS[kind](on=rbd.Ground(velocity=(0.5, 2.0, 0.0))), solver=rbd.ConeSolver())
    # Rubbed along y at its bottom, it does not tip: the load leans to one side by mu h = 0.06 of the 0.2 m there are.
    assert _total(s) == pytest.approx([0.0, MU * M * G, M * G], abs=1e-7)
    assert s.a == pytest.approx([0.0, MU * G, 0.0, 0.0, 0.0, 0.0], abs=1e-8)
    assert max(s.residuals.scaled.values()) < 1e-9


def test_a_belt_faster_than_the_box_is_refused_by_the_convex_law():
    """It slips, so that only Coulomb's law says what happens; named, with the relative speed."""
    with pytest.raises(rbd.errors.ContactMoves, match=r"'floor'.* 0\.7 m/s.*Under Coulomb's"):
        rbd.solve(
            _at(v=np.array([0.5, 0, 0, 0, 0, 0])), np.zeros(0), [_patch(on=rbd.Ground(velocity=(1.2, 0.0, 0.0)))], law="convex"
        )


def test_a_floor_that_comes_up_is_an_impact():
    """No acceleration answers it; a floor that goes down leaves the box free."""
    with pytest.raises(rbd.errors.ContactMoves, match="'floor' approaches at 0.3 m/s"):
        rbd.solve(_at(), np.zeros(0), [_patch(on=rbd.Ground(velocity=(0.0, 0.0, 0.3)))], solver=rbd.ConeSolver())
    with pytest.warns(rbd.errors.OpeningContactWarning, match="'floor' at up to 0.3 m/s"):
        s = rbd.solve(_at(), np.zeros(0), [_patch(on=rbd.Ground(velocity=(0.0, 0.0, -0.3)))], solver=rbd.ConeSolver())
    assert not s.forces["floor"].any() and s.a[2] == pytest.approx(-G)


@pytest.mark.parametrize("brake", [4.0, 5.8])
def test_a_braking_cart_holds_its_load_up_to_mu_g(brake):
    """Friction m a, up to mu g = 5.886 m/s2; the load leans forward, and stays while mu h < b."""
    v = np.array([3.0, 0.0, 0, 0, 0, 0])
    contact = _patch(on=rbd.Ground(velocity=(3.0, 0.0, 0.0), acceleration=(-brake, 0.0, 0.0)))
    for solver in (rbd.ConeSolver(), rbd.ProxQP()):
        s = rbd.solve(_at(v=v), np.zeros(0), [contact], solver=solver)
        assert s.forces["floor"][:3] == pytest.approx([-M * brake, 0.0, M * G], abs=1e-7)
        assert s.contacts["floor"].centre_of_pressure[0] == pytest.approx(0.1 * brake / G)


def test_a_cart_that_brakes_harder_loses_its_load():
    """Beyond mu g the load slides forward on the cart: a = -mu g (Coulomb's law), from the first instant."""
    contact = _patch(on=rbd.Ground(velocity=(3.0, 0.0, 0.0), acceleration=(-9.0, 0.0, 0.0)))
    s = rbd.solve(_at(v=np.array([3.0, 0.0, 0, 0, 0, 0])), np.zeros(0), [contact], solver=rbd.ConeSolver())
    assert s.a[:3] == pytest.approx([-MU * G, 0.0, 0.0], abs=1e-8)
    assert s.accelerations["floor"][:3] == pytest.approx([9.0 - MU * G, 0.0, 0.0], abs=1e-8)


class TestTurntable:
    """It turns about W's z axis with W: `about` is a point of the axis, and the rest follows."""

    W, R = 1.7, 0.9

    def on(self, friction: float | None = MU, *, spin_up: float = 0.0) -> rbd.SurfaceContact:
        """A box on it, wherever it is."""
        W = self.W
        return _patch(
            friction, on=rbd.Ground(velocity=(0, 0, 0, 0, 0, W), acceleration=(0, 0, 0, 0, 0, spin_up), about=(0.0, 0.0, 0.0))
        )

    def at(self, walk: tuple[float, float] = (0.0, 0.0), spin: float = 0.0) -> rbd.State:
        """At radius R on the x axis; `walk` and `spin` relative to the table."""
        return _at(self.R, np.array([walk[0], self.W * self.R + walk[1], 0.0, 0.0, 0.0, self.W + spin]))

    @pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)
    def test_a_box_at_rest_on_it_is_held_by_m_W2_r(self, solver):
        """Centripetal, to the last digit; M W^2 r = 26 N of the 59 N of friction."""
        s = rbd.solve(self.at(), np.zeros(0), [self.on()], solver=solver)
        assert s.forces["floor"][:3] == pytest.approx([-M * self.W**2 * self.R, 0.0, M * G], rel=1e-10, abs=1e-8)
        assert np.abs(s.accelerations["floor"]).max() < 1e-9 and abs(s.a[5]) < 1e-9

    def test_while_it_spins_up_friction_has_three_parts(self):
        """-m W^2 r inwards, m W' r along, and the moment I W' about the box's own axis."""
        s = rbd.solve(self.at(), np.zeros(0), [self.on(spin_up=0.7)])
        inertia = M / 12.0 * (0.4**2 + 0.4**2)
        expected = [-M * self.W**2 * self.R, M * 0.7 * self.R, M * G]
        assert s.forces["floor"][:3] == pytest.approx(expected, abs=1e-8)
        assert s.forces["floor"][5] == pytest.approx(inertia * 0.7, abs=1e-8)

    def test_walking_on_it_wants_coriolis_force(self):
        """At a steady (u, w) relative to the table: m (2 W x v_rel + W x (W x r)), by a contact that holds its velocity."""
        u, w = 0.8, -0.5
        s = rbd.solve(self.at((u, w)), np.zeros(0), [self.on(None)], solver=rbd.KKT())
        expected = [-M * self.W**2 * self.R - 2.0 * M * self.W * w, 2.0 * M * self.W * u, M * G]
        assert s.forces["floor"][:3] == pytest.approx(expected, rel=1e-12)
        assert abs(s.a[5]) < 1e-12 and s.a[2] == pytest.approx(0.0, abs=1e-12)

    def test_a_smooth_puck_goes_straight(self):
        """Frictionless: no horizontal acceleration in W; seen from the table -2 W x v_rel - W x (W x r)."""
        u, w, W = 0.8, -0.5, self.W
        s = rbd.solve(self.at((u, w)), np.zeros(0), [self.on(0.0)], solver=rbd.ConeSolver())
        velocity = s.problem.rows[0].velocity
        assert velocity == pytest.approx([u, w, 0.0, 0.0, 0.0, 0.0], abs=1e-15)
        assert s.forces["floor"][:3] == pytest.approx([0.0, 0.0, M * G], abs=1e-9)
        assert s.accelerations["floor"][:3] == pytest.approx([2 * W * w + W**2 * self.R, -2 * W * u, 0.0], abs=1e-9)

    def test_a_sliding_point_rubs_against_its_motion_on_the_table(self):
        """Not against its motion in the world: -mu N v_rel / |v_rel|."""
        point = rbd.PointContact(
            "tip",
            "box",
            offset=(0, 0, -0.1),
            friction=MU,
            on=rbd.Ground(velocity=(0, 0, 0, 0, 0, self.W), about=(0.0, 0.0, 0.0)),
        )
        s = rbd.solve(self.at((0.3, -0.4)), np.zeros(0), [point], solver=rbd.ConeSolver())
        force = s.forces["tip"]
        assert force[:2] / force[2] == pytest.approx([-MU * 0.6, MU * 0.8], abs=1e-12) and force[2] > 0.0

    def test_a_velocity_at_the_contact_needs_its_centripetal_acceleration(self):
        """Without `about` both are of the surface's point under the contact: u = W x r, s = W x (W x r), given by hand."""
        W, R = self.W, self.R
        by_hand = _patch(on=rbd.Ground(velocity=(0, W * R, 0, 0, 0, W), acceleration=(-W * W * R, 0, 0)))
        for contact in (self.on(), by_hand):
            rows = contact.rows(self.at((0.2, 0.1), 0.4))
            assert rows.velocity == pytest.approx([0.2, 0.1, 0, 0, 0, 0.4], abs=1e-14)
            expected = [2.0 * W * 0.1 + W * W * R, -2.0 * W * 0.2, 0.0]  # of a body that goes straight on in W
            classical = self.at((0.2, 0.1), 0.4).frame("box", (0, 0, -0.1)).bias[:3]
            assert rows.bias[:3] == pytest.approx(classical + expected, abs=1e-13)


@pytest.mark.parametrize("kind", ["point", "line", "surface"])
@pytest.mark.parametrize("along", [False, True], ids=["sliding", "moving along"])
def test_rows_are_the_motion_seen_from_the_surface(talos, kind, along):
    """J a + bias and velocity are the derivatives of the contact's pose in a frame that moves and turns as given.

    Both poses are differenced in time, to sixth order; no Jacobian and no formula for relative motion is used.
    """
    rng = np.random.default_rng(8)
    state = talos.at(pin.integrate(talos.model, talos.standing().q, 0.4 * rng.normal(size=talos.nv)))
    v, a = rng.normal(size=(2, talos.nv))
    u, s, at = rng.normal(size=6), rng.normal(size=6), rng.normal(size=3)
    moves = {"velocity": u, "acceleration": s, "about": at}
    more = {"on": rbd.Ground(**moves)}
    contact = {
        "point": rbd.PointContact(
            "c", "left_sole_link", offset=(0.1, 0.0, -0.1), on=rbd.Ground(normal=(0.48, -0.64, 0.6), **moves)
        ),
        "line": rbd.LineContact("c", "left_sole_link", half_length=0.1, placement=FREE, **more),
        "surface": rbd.SurfaceContact("c", "left_sole_link", half_lengths=(0.1, 0.1), placement=FREE, **more),
    }[kind]
    if along:  # at the surface's own velocity: what is left is the acceleration alone
        J, relative = contact.rows(state.with_velocity(0 * v)).J, contact.rows(state.with_velocity(0 * v)).velocity
        v = v - np.linalg.pinv(J) @ (J @ v + relative)
    rows = contact.rows(state.with_velocity(v))
    step = 5e-3
    nodes = step * np.arange(-3, 4)
    first = np.array([-1.0, 9.0, -45.0, 0.0, 45.0, -9.0, 1.0]) / (60.0 * step)
    second = np.array([2.0, -27.0, 270.0, -490.0, 270.0, -27.0, 2.0]) / (180.0 * step**2)
    y = np.zeros((7, 6))
    for i, t in enumerate(nodes):
        moved = contact.rows(talos.at(pin.integrate(talos.model, state.q, v * t + 0.5 * a * t * t))).patch
        X_WS = pin.SE3(pin.exp3(u[3:] * t + 0.5 * s[3:] * t * t), at + u[:3] * t + 0.5 * s[:3] * t * t)
        y[i, :3] = X_WS.actInv(moved.point)  # the surface's axes stand along W's at t = 0
        turned = X_WS.rotation.T @ moved.axes
        x, x0 = turned[:, 0], rows.patch.axes[:, 0]
        y[i, 3:] = np.cross(x0, x) if kind == "line" else pin.log3(turned @ rows.patch.axes.T)
    y = y[:, : len(rows.resultant)]
    assert rows.velocity == pytest.approx(rows.resultant.T @ (first @ y), abs=1e-8)
    assert rows.J @ a + rows.bias == pytest.approx(rows.resultant.T @ (second @ y), abs=1e-7)
    if along:
        assert np.abs(rows.velocity).max() < 1e-12


@pytest.mark.parametrize("friction", [None, 0.0, 0.5])
@pytest.mark.parametrize("motion", [{"velocity": (1, 2, 3)}, {"velocity": (1, 2, 3, 0.4, 0.5, 0.6), "about": (1, 0, 0)}])
def test_the_contract_holds_on_moving_ground(talos, friction, motion):
    """check_constraint takes the ground's own motion out first."""
    rng = np.random.default_rng(9)
    state = talos.at(pin.integrate(talos.model, talos.standing().q, 0.4 * rng.normal(size=talos.nv)))
    motion = {**motion, "acceleration": (0.3, -0.2, 0.1)}
    for contact in (
        rbd.PointContact(
            "p", "left_sole_link", offset=(0.1, 0.0, -0.1), on=rbd.Ground(normal=(0.6, 0, 0.8), **motion), friction=friction
        ),
        rbd.SurfaceContact(
            "s", "left_sole_link", half_lengths=(0.1, 0.1), placement=FREE, friction=friction, on=rbd.Ground(**motion)
        ),
    ):
        report = check_constraint(contact, state)
        assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-9


def test_a_ground_that_does_not_move_is_the_ground(talos):
    """Zero velocity and acceleration, or an anchor: the same rows by the longer way."""
    state = talos.standing().with_velocity(np.linspace(-1.0, 1.0, talos.nv))
    still = {"velocity": (0.0, 0.0, 0.0), "acceleration": (0.0, 0.0, 0.0), "about": (1.0, 2.0, 3.0)}
    for kind in (
        lambda **k: rbd.PointContact("p", "left_sole_link", on=rbd.Ground(normal=(0.6, 0.0, 0.8), **k), friction=0.5),
        lambda **k: rbd.SurfaceContact(
            "s", "left_sole_link", half_lengths=(0.1, 0.1), placement=FREE, friction=0.5, on=rbd.Ground(**k)
        ),
        lambda **k: rbd.LineContact("l", "left_sole_link", half_length=0.1, placement=FREE, friction=0.5, on=rbd.Ground(**k)),
    ):
        plain, moving, anchored = kind().rows(state), kind(**still).rows(state), kind().anchored(state).rows(state)
        for field in ("J", "velocity", "bias", "resultant"):
            assert getattr(moving, field) == pytest.approx(getattr(plain, field), abs=1e-12)
            assert getattr(anchored, field) == pytest.approx(getattr(plain, field), abs=1e-12)
        assert plain.error is None and moving.error is None and np.abs(anchored.error).max() < 1e-15


def test_talos_rides_a_lift(talos):
    """Held torques for g + a from hold's answer scaled: on a lift that gains 2 m/s2 the feet carry m (g + a)."""
    state = talos.standing()
    tau = rbd.hold(state, talos.soles()).tau * (G + 2.0) / G
    soles = [
        rbd.SurfaceContact(
            s.name,
            s.frame,
            corners=s.corners,
            placement=s.placement,
            friction=0.7,
            on=rbd.Ground(velocity=(0, 0, 1), acceleration=(0, 0, 2)),
        )
        for s in talos.soles()
    ]
    v = np.zeros(talos.nv)
    v[2] = 1.0
    s = rbd.solve(state.with_velocity(v), tau, soles)
    assert _total(s) == pytest.approx([0.0, 0.0, talos.mass * (G + 2.0)], rel=1e-9, abs=1e-6)
    assert np.delete(s.a, 2) == pytest.approx(np.zeros(talos.nv - 1), abs=1e-7) and s.a[2] == pytest.approx(2.0)
    assert s.residuals.centroidal.scaled < 1e-9


def test_answers_on_moving_ground_obey_the_law_recomputed(rng):
    """Belts and turntables at random under a box that moves with them: residuals written down once more."""
    for _ in range(30):
        contact = _patch(
            0.5, on=rbd.Ground(velocity=np.r_[rng.normal(size=2), 0, 0, 0, rng.normal()], acceleration=3 * rng.normal(size=3))
        )
        u = contact.on.velocity
        state = _at(v=np.r_[u[:3], u[3:]])
        for solver in SOLVERS:
            s = rbd.solve(state, np.zeros(0), [contact], solver=solver)
            assert max(law_residuals(s.problem, s, solver.law).values()) < 1e-9


class TestAnchor:
    """`error` is the way from where the contact first touched."""

    def test_a_point_that_has_slipped_knows_how_far(self):
        """In contact axes: on a wall, the way up is the second tangent's."""
        wall = rbd.PointContact(
            "hand", "box", offset=(0.2, 0.0, 0.0), on=rbd.Ground(normal=(-1.0, 0.0, 0.0)), anchor=(0.2, 0.0, 0.1)
        )
        state = rbd.State(box(), np.array([0.01, 0.02, 0.13, 0.0, 0.0, 0.0, 1.0]))
        rows = wall.rows(state)
        assert rows.patch.axes @ rows.error == pytest.approx([0.01, 0.02, 0.03], abs=1e-15)
        assert rows.error[2] == pytest.approx(-0.01)  # into the wall

    def test_a_smooth_point_knows_how_deep_it_is(self):
        """One row, one error: along the normal."""
        floor = rbd.PointContact("toe", "box", offset=(0.0, 0.0, -0.1), friction=0.0, anchor=(5.0, 6.0, 0.0))
        state = rbd.State(box(), np.array([0.0, 0.0, 0.08, 0.0, 0.0, 0.0, 1.0]))
        assert floor.rows(state).error == pytest.approx([-0.02])

    def test_a_patch_knows_its_way_and_its_turn(self):
        """Shift and rotation vector in patch axes."""
        start = _at()
        sole = _patch().anchored(start)
        assert sole.anchor.translation == pytest.approx([0.0, 0.0, 0.0])
        move = pin.SE3(pin.exp3(np.array([0.01, -0.02, 0.03])), np.array([1e-3, 2e-3, 3e-3]))
        X = pin.SE3(np.eye(3), np.array([0.0, 0.0, 0.1])) * BELOW * move * BELOW.inverse()
        error = sole.rows(rbd.State(start.robot, pin.SE3ToXYZQUAT(X))).error
        assert error[3:] == pytest.approx([0.01, -0.02, 0.03], abs=1e-12)
        assert error[:3] == pytest.approx(move.rotation.T @ [1e-3, 2e-3, 3e-3], abs=1e-12)

    @pytest.mark.parametrize("friction", [None, 0.0, 0.5])
    @pytest.mark.parametrize("against", [rbd.Ground, lambda **given: rbd.Body("right_sole_link", **given)])
    def test_its_derivative_is_J_v(self, talos, friction, against):
        """Of points, lines and patches, once and twice along curves that keep the contact: check_constraint looks."""
        rng = np.random.default_rng(4)
        state = talos.at(pin.integrate(talos.model, talos.standing().q, 0.3 * rng.normal(size=talos.nv)))
        more = {"friction": friction, "on": against()}
        for contact in (
            rbd.PointContact(
                "p", "left_sole_link", offset=(0.1, 0.0, -0.1), friction=friction, on=against(normal=(0.6, 0, 0.8))
            ),
            rbd.LineContact("l", "left_sole_link", half_length=0.1, placement=FREE, **more),
            rbd.SurfaceContact("s", "left_sole_link", half_lengths=(0.1, 0.1), placement=FREE, **more),
        ):
            for moving in (True, False):
                check_constraint(contact.anchored(state), state, moving=moving)

    def test_a_wrong_error_is_found(self, talos):
        """The check above can fail: an error in world axes in place of contact axes."""

        class Wrong:
            name = "p"

            def rows(self, state):
                inner = (
                    rbd.PointContact("p", "left_sole_link", on=rbd.Ground(normal=(0.6, 0.0, 0.8)))
                    .anchored(talos.standing())
                    .rows(state)
                )
                error = inner.patch.axes @ inner.error
                return rbd.Rows("p", inner.J, inner.bias, inner.cone, inner.velocity, error, resultant=inner.resultant,
                                patch=inner.patch)  # fmt: skip

        with pytest.raises(ConstraintWrong, match="error' against J v"):
            check_constraint(Wrong(), talos.standing())


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("velocity.*shape", {"velocity": (1.0, 0.0)}),
        ("velocity.*shape", {"velocity": 1.0}),
        ("velocity.*finite", {"velocity": (1.0, np.nan, 0.0)}),
        ("velocity", {"velocity": "fast"}),
        ("acceleration.*shape", {"acceleration": np.eye(3)}),
        ("acceleration.*finite", {"acceleration": (np.inf, 0.0, 0.0)}),
        ("about.*shape", {"velocity": (1, 0, 0), "about": (1.0, 0.0)}),
        ("about= without", {"about": (1.0, 0.0, 0.0)}),
    ],
)
def test_a_motion_that_means_nothing_is_refused(what, arguments):
    """By name, before any contact is involved."""
    with pytest.raises(rbd.InputError, match=what):
        rbd.Ground(**arguments)


@pytest.mark.parametrize("anchor", ["here", (0.0, 0.0)])
@pytest.mark.parametrize("kind", KINDS)
def test_an_anchor_that_means_nothing_is_refused(kind, anchor):
    """By name, before any robot is involved."""
    with pytest.raises(rbd.InputError, match="anchor"):
        KINDS[kind](anchor=anchor)
