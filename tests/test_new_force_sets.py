"""Sets of forces that this file alone knows, each one class, through every verb; and friction that differs by direction."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.problem import Cone, EllipticCone, FrictionCone, NonNegative
from rbd.problem.cones import HALF_LINE, Interval
from rbd.visual.marks.contacts import contact_marks, shown_forces
from rbd.visual.marks.mark import Sizes

G = 9.81
MASS = 10.0
LEVEL = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
CEILING = rbd.Ground(point=(0.0, 0.0, 0.2), normal=(0.0, 0.0, -1.0))
LAWS = ("coulomb", "convex")


class SuctionCup(Cone):
    """`|f_t| <= mu (f_n + vacuum)`: a friction cone, and a vacuum [N] that pulls."""

    dim = 3

    def __init__(self, mu: float, vacuum: float) -> None:
        self.mu, self.vacuum = mu, vacuum

    def generators(self):
        """The cone's, and one column of the vacuum."""
        cone, parts = FrictionCone(self.mu).generators()
        return np.column_stack([cone, [0.0, 0.0, -1.0]]), (*parts, Interval(self.vacuum, self.vacuum))

    def friction_used(self, force):
        """|f_t| / (mu (f_n + vacuum))."""
        return float(np.hypot(force[0], force[1]) / (self.mu * (force[2] + self.vacuum)))


class SoftFinger(Cone):
    """`|f_t| <= mu f_n` and a torsion up to `radius` f_n about the normal; no other moment."""

    dim = 6

    def __init__(self, mu: float, radius: float) -> None:
        self.mu, self.radius = mu, radius

    def generators(self):
        """Two cones, whose normal forces twist to either side."""
        cone, parts = FrictionCone(self.mu).generators()
        out = np.zeros((6, 6))
        out[:3] = np.hstack([cone, cone])
        out[5, 2], out[5, 5] = self.radius, -self.radius
        return out, parts * 2


@pytest.fixture(scope="module")
def box():
    """A cube of 0.4 m and 10 kg."""
    return rbd.testing.box(mass=MASS)


def state(box, v=None):
    """At the origin."""
    return rbd.State(box, LEVEL, v)


def cup(vacuum, mu=0.5):
    """In the middle of the box's upper face, on a ceiling."""
    return rbd.PointContact("cup", "box", offset=(0.0, 0.0, 0.2), friction=SuctionCup(mu, vacuum), on=CEILING)


def sole(friction, half=0.2):
    """The box's lower face, or the middle of it."""
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.2]))
    return rbd.SurfaceContact("sole", "box", half_lengths=(half, half), placement=below, friction=friction, on=-0.2)


def pushed(x, y=0.0, z=0.0, moment=(0.0, 0.0, 0.0)):
    """A push at the box's lower face."""
    return [rbd.ExternalForce("box", (x, y, z), offset=(0.0, 0.0, -0.2), moment=moment)]


class TestSolve:
    """`rbd.solve` against closed forms, under both laws and by both solvers."""

    @pytest.mark.parametrize("solver", [*(rbd.ConeSolver(law=x) for x in LAWS), rbd.ProxQP()])
    def test_a_suction_cup_holds_up_to_its_vacuum(self, box, solver):
        """98.1 N hang on a vacuum of 100 N; from one of 90 N the box falls with (98.1 - 90) / 10."""
        held = rbd.solve(state(box), [], [cup(100.0)], solver=solver)
        assert held.a == pytest.approx(0.0, abs=1e-9) and held.forces["cup"] == pytest.approx([0, 0, MASS * G])
        falls = rbd.solve(state(box), [], [cup(90.0)], solver=solver)
        assert falls.a[2] == pytest.approx(-(MASS * G - 90.0) / MASS) and falls.residuals.worst < 1e-9

    def test_its_friction_grows_with_what_it_presses(self, box):
        """150 N of vacuum less 98.1 N of weight press the cup: it slips at half of that."""
        at_middle = [rbd.ExternalForce("box", (30.0, 0.0, 0.0), offset=(0.0, 0.0, 0.2))]
        slips = rbd.solve(state(box), [], [cup(150.0)], external=at_middle)
        friction = 0.5 * (150.0 - MASS * G)
        assert slips.forces["cup"] == pytest.approx([-friction, 0.0, MASS * G])
        assert slips.a[0] == pytest.approx((30.0 - friction) / MASS)

    def test_a_soft_finger_resists_torsion_up_to_its_radius(self, box):
        """0.02 m times the normal force; beyond, it climbs at the radius times its rotation, as the convex law has it.

        With N = m (g + r alpha) and I alpha = M - r N:  alpha = (M - r m g) / (I + m r^2).
        """
        inertia, r = float(state(box).M[5, 5]), 0.02
        holds, turns = (
            rbd.solve(state(box), [], [sole(SoftFinger(0.5, r))], external=pushed(0.0, moment=(0.0, 0.0, moment)))
            for moment in (1.5, 3.0)
        )
        assert holds.forces["sole"] == pytest.approx([0, 0, MASS * G, 0, 0, -1.5], abs=1e-9)
        alpha = (3.0 - r * MASS * G) / (inertia + MASS * r**2)
        assert turns.a[[2, 5]] == pytest.approx([r * alpha, alpha])
        assert turns.forces["sole"][[2, 5]] == pytest.approx(np.array([1.0, -r]) * MASS * (G + r * alpha))

    @pytest.mark.parametrize("law", LAWS)
    def test_equal_coefficients_are_a_circle(self, box, law):
        """Bit for bit the same rows, so the same answer to rounding; of a point and of a patch."""
        for contact in (sole, lambda f: rbd.PointContact("sole", "box", offset=(0, 0, -0.2), friction=f, on=-0.2)):
            one, two = (
                rbd.solve(state(box), [], [contact(f)], external=pushed(70.0, 30.0), solver=rbd.ConeSolver(law=law))
                for f in (EllipticCone(0.4, 0.4), 0.4)
            )
            assert one.a == pytest.approx(two.a, abs=1e-9) and one.forces["sole"] == pytest.approx(two.forces["sole"], abs=1e-8)

    def test_friction_takes_the_most_power(self, box):
        """At the onset of slip the force is on the ellipse, along -(mu_x^2 a_x, mu_y^2 a_y), and no other takes more."""
        toe = rbd.PointContact("toe", "box", friction=EllipticCone(0.2, 0.6), on=0.0)
        push = [rbd.ExternalForce("box", (40.0, 40.0, 0.0))]
        found = rbd.solve(state(box), [], [toe], external=push, solver=rbd.ConeSolver())
        f, a = found.forces["toe"], found.a
        along = np.array([0.2**2 * a[0], 0.6**2 * a[1]])
        assert f[:2] / np.linalg.norm(f[:2]) == pytest.approx(-along / np.linalg.norm(along), abs=1e-9)
        assert found.contacts["toe"].friction_used == pytest.approx(1.0) and f[2] == pytest.approx(MASS * G)
        turn = np.linspace(0.0, 2.0 * np.pi, 1000)
        others = f[2] * np.stack([0.2 * np.cos(turn), 0.6 * np.sin(turn)])
        assert f[:2] @ a[:2] <= (a[:2] @ others).min() + 1e-4

    def test_a_sliding_point_has_the_same_direction(self, box):
        """Now by its velocity: f_t = -f_n (mu_x^2 v_x, mu_y^2 v_y) / |(mu_x v_x, mu_y v_y)|."""
        v = np.array([0.3, 0.2, 0.0, 0.0, 0.0, 0.0])
        point = rbd.PointContact("toe", "box", friction=EllipticCone(0.2, 0.6), on=0.0)
        f = rbd.solve(state(box, v), [], [point]).forces["toe"]
        wanted = -f[2] * np.array([0.04 * 0.3, 0.36 * 0.2]) / np.hypot(0.2 * 0.3, 0.6 * 0.2)
        assert f[:2] == pytest.approx(wanted) and f[2] == pytest.approx(MASS * G)


class TestOtherVerbs:
    """What else takes constraints."""

    @pytest.mark.parametrize(
        "contact, freedom", [(cup(150.0), 0), (sole(SoftFinger(0.5, 0.02)), 2), (sole(EllipticCone(0.3, 0.6)), 6)]
    )
    def test_uniqueness(self, box, contact, freedom):
        """A cup's force is unique; the normal force always is, as the weight hangs on one contact."""
        found = rbd.solve(state(box), [], [contact]).uniqueness()
        normal = found.contacts[contact.name].normal if contact.name in found.contacts else found.others[contact.name][2]
        assert normal.unique and abs(normal.value) == pytest.approx(MASS * G)
        assert found.corner_freedom == freedom

    def test_inverse_dynamics_and_pushes_of_a_quadruped_on_skates(self):
        """Along a skate it is limited by 0.05, across by 0.8: a push moves it at the sum of what the feet resist."""
        solo = rbd.load_robot("solo12")
        at = solo.standing()
        feet = {
            kind: [rbd.PointContact(f.name, f.frame, offset=f.offset, friction=mu, on=f.on) for f in solo.feet()]
            for kind, mu in (("skates", EllipticCone(0.05, 0.8)), ("round", 0.8), ("slippery", 0.05))
        }
        weight = G * solo.mass
        limits = {k: rbd.statics.push_limits(at, c, "base_link", np.eye(3)[:2]).forces for k, c in feet.items()}
        assert limits["skates"][0] == pytest.approx(0.05 * weight, rel=1e-6)
        assert limits["slippery"] == pytest.approx(0.05 * weight, rel=1e-6)
        assert limits["slippery"][1] < 2.0 < limits["skates"][1] <= limits["round"][1] + 1e-9
        a = np.zeros(solo.nv)
        a[1] = 0.3  # to the left, with all joints at rest
        feet_left = rbd.inverse_dynamics(
            at, np.zeros(solo.nv), feet["skates"], external=[rbd.ExternalForce("base_link", (0, 2.0, 0))]
        )
        assert sum(f[1] for f in feet_left.forces.values()) == pytest.approx(-2.0)
        assert feet_left.residuals.worst < 1e-9
        with pytest.raises(rbd.CannotMove, match="friction"):
            rbd.inverse_dynamics(at, np.zeros(solo.nv), feet["skates"], external=[rbd.ExternalForce("base_link", (2.0, 0, 0))])
        many = rbd.solve_many(solo, at.q[None], at.v[None], np.zeros((1, solo.nu)), feet["skates"])
        assert many.a[0] == pytest.approx(rbd.solve(at, np.zeros(solo.nu), feet["skates"]).a, abs=1e-9)

    def test_pictures(self, box):
        """A cone with an elliptic rim; of a set without a shape to draw its force alone."""
        for contact, drawn in ((sole(EllipticCone(0.3, 0.6)), True), (sole(SoftFinger(0.5, 0.02)), False), (cup(150.0), True)):
            solution = rbd.solve(state(box), [], [contact])
            (shown,) = shown_forces(solution)
            marks = contact_marks(shown, "#3366cc", Sizes(1.0, 1e-3))
            names = [mark.path.rsplit("/", 1)[-1] for mark in marks]
            assert ("rim" in names) == drawn and "force" in names
        rim = EllipticCone(0.3, 0.6).rim()
        assert np.hypot(rim[:, 0] / 0.3, rim[:, 1] / 0.6) == pytest.approx(1.0)
        turn = np.unwrap(np.arctan2(rim[:, 1], rim[:, 0]))
        assert (np.diff(turn) > 0.0).all() and 6.0 < turn[-1] - turn[0] < 2.0 * np.pi  # in order, once around


class TestTimeStepping:
    """`rbd.simulate`, whose points carry the sets' parts."""

    def test_a_box_slides_on_a_skate_along_a_curve(self, box):
        """Deceleration along the ellipse's rule, integrated by hand with a fine step."""
        mu, v, x, h = np.array([0.1, 0.4]), np.array([1.0, 0.5]), np.zeros(2), 1e-5
        for _ in range(20000):
            middle = v - 0.5 * h * G * mu**2 * v / np.linalg.norm(mu * v)
            v = v - h * G * mu**2 * middle / np.linalg.norm(mu * middle)
            x += h * (v + middle) / 2.0
        start = state(box, [1.0, 0.5, 0.0, 0.0, 0.0, 0.0])
        for contact in (rbd.PointContact("toe", "box", friction=EllipticCone(0.1, 0.4), on=0.0),):
            run = rbd.simulate(start, [contact], duration=0.2, step=1e-3, progress=False)
            assert run.v[-1, :2] == pytest.approx(v, abs=2e-3) and run.q[-1, :2] == pytest.approx(x, abs=2e-3)
            assert run.forces["toe"][5, 2] == pytest.approx(MASS * G)
            assert run.residuals["law"].max() < 1e-8

    def test_a_cup_holds_and_lets_go(self, box):
        """It hangs under 100 N of vacuum; pulled by 20 N more than it holds it falls."""
        hangs = rbd.simulate(state(box), [cup(100.0)], duration=0.1, step=1e-3, progress=False)
        assert hangs.q[-1] == pytest.approx(LEVEL, abs=1e-9) and hangs.forces["cup"][-1] == pytest.approx([0, 0, MASS * G])
        down = [rbd.ExternalForce("box", (0.0, 0.0, -21.9))]
        falls = rbd.simulate(state(box), [cup(100.0)], duration=0.1, step=1e-3, external=down, progress=False)
        assert falls.v[-1, 2] < -0.15

    def test_a_soft_finger_turns_when_it_must(self, box):
        """As at one state: (3 - 0.02 x 98.1) / (I + m r^2)."""
        twist = pushed(0.0, moment=(0.0, 0.0, 3.0))
        run = rbd.simulate(state(box), [sole(SoftFinger(0.5, 0.02))], duration=0.1, step=1e-3, external=twist, progress=False)
        rate = (3.0 - 0.02 * MASS * G) / (float(state(box).M[5, 5]) + MASS * 0.02**2)
        assert run.v[-1, 5] == pytest.approx(0.1 * rate, rel=1e-6)


class TestMistakes:
    """What is no set, or no set of this contact."""

    def test_the_dimension(self, box):
        """3, or all rows of the contact."""
        with pytest.raises(rbd.InputError, match="dimension 2; expected 3, of the force at each corner, or 6"):
            sole(NonNegative(2))
        with pytest.raises(rbd.InputError, match="EllipticCone has the coefficients 0.0, 0.5"):
            EllipticCone(0.0, 0.5)
        with pytest.raises(rbd.InputError, match="expected 3"):
            rbd.problem.WrenchCone(np.eye(3), NonNegative(2))

    def test_projections_of_sets_without_a_closed_form(self):
        """Nearest points: of the cup's cone those of a cone moved by its vacuum; of the ellipse, by its normal."""
        shifted = FrictionCone(0.5).project(np.array([3.0, 0.0, 1.0]) + [0.0, 0.0, 2.0]) - [0.0, 0.0, 2.0]
        assert SuctionCup(0.5, 2.0).project(np.array([3.0, 0.0, 1.0])) == pytest.approx(shifted, abs=1e-8)
        ellipse, y = EllipticCone(0.2, 0.6), np.array([1.0, 1.0, 0.5])
        x = ellipse.project(y)
        assert ellipse.friction_used(x) == pytest.approx(1.0, abs=1e-7)
        for other in ellipse.rim() * x[2]:
            assert (y - x) @ (other - x) < 1e-7


class GroovedPad(Cone):
    """`|f_x| <= mu_x f_n`, `|f_y| <= mu_y f_n`: a polyhedron of four rays."""

    dim = 3

    def __init__(self, mu_x: float, mu_y: float) -> None:
        self.mu_x, self.mu_y = mu_x, mu_y

    def generators(self):
        """Its four edges."""
        rays = [[x * self.mu_x, y * self.mu_y, 1.0] for x in (-1, 1) for y in (-1, 1)]
        return np.array(rays).T, (HALF_LINE,) * 4


class PartsThatAreSets(GroovedPad):
    """Sets in place of the parts of sets."""

    def generators(self):
        """Four sets."""
        return super().generators()[0], (NonNegative(1),) * 4


class TooFewColumns(GroovedPad):
    """Three rays for four parts."""

    def generators(self):
        """A column less."""
        G, parts = super().generators()
        return G[:, :3], parts


def test_a_polyhedron_holds_up_to_its_faces(box):
    """A box of 98.1 N on a pad with mu_x = 0.8 and mu_y = 0.3 withstands 78 N along x and 29 N along y, and no more."""
    for direction, most in ((0, 0.8 * MASS * G), (1, 0.3 * MASS * G)):
        for share in (0.99, 1.01):
            push = np.zeros(3)
            push[direction] = share * most
            answer = rbd.solve(state(box), [], [sole(GroovedPad(0.8, 0.3))], external=pushed(*push))
            assert (np.abs(answer.a).max() < 1e-9) == (share < 1.0)


def test_a_polyhedron_that_slides_is_refused_by_name(box):
    """Half-lines do not say which force opposes a motion; it is not an impact."""
    with pytest.raises(rbd.InputError, match="'sole' slides at 0.3 m/s, and its set of forces, .*half-lines alone"):
        rbd.solve(state(box, [0.3, 0.0, 0.0, 0.0, 0.0, 0.0]), [], [sole(GroovedPad(0.8, 0.3))])
    with pytest.warns(rbd.errors.OpeningContactWarning, match="'sole' at up to 0.1 m/s"):
        lifts = rbd.solve(state(box, [0.3, 0.0, 0.1, 0.0, 0.0, 0.0]), [], [sole(GroovedPad(0.8, 0.3))])
    assert not lifts.forces["sole"].any()


@pytest.mark.parametrize(("wrong", "words"), [(PartsThatAreSets, "gives a part"), (TooFewColumns, r"expected \(3, 4\)")])
def test_generators_that_fit_no_set_are_refused_by_name(box, wrong, words):
    """The class is named, and what was expected."""
    with pytest.raises(rbd.InputError, match=rf"{wrong.__name__}.generators\(\) .*{words}"):
        rbd.solve(state(box), [], [sole(wrong(0.8, 0.3))])
