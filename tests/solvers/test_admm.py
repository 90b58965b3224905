"""ConeSolver: Coulomb's law and the convex one with true cones, on robots that slip and lift, and on arrays."""

from __future__ import annotations

import time
import warnings
from functools import cache

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.problem.gauss_problem import COULOMB
from rbd.problem.programs import SEARCH_WORK
from rbd.problem.rows import Rows
from rbd.solvers.admm import OPEN, _ConeSearch, holding
from rbd.solvers.conic_newton import interior_point
from rbd.solvers.newton import scaled, steps_from
from rbd.solvers.pinocchio_admm import admm
from rbd.testing import box, law_residuals

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.EffortLimitWarning")  # noise on small motors
LAWS = ["coulomb", "convex"]


def pushed_states(name: str, count: int, seed: int, contacts=None, noise=(2.0, 60.0)):
    """Problems of a standing robot at rest, torque noise in N m, mu 0.2 to 1, half of the postures bent."""
    rng = np.random.default_rng(seed)
    robot = rbd.load_robot(name)
    standing = robot.standing()
    hold = rbd.hold(standing, robot.feet(0.7)).tau
    for i in range(count):
        mu, state = rng.uniform(0.2, 1.0), standing
        if i % 2:
            bend = np.r_[np.zeros(6), 0.1 * rng.normal(size=robot.nv - 6)]
            state = rbd.State(robot, pin.integrate(robot.model, standing.q, bend))
        tau = hold + rng.uniform(*noise) * rng.normal(size=robot.nu)
        yield rbd.gauss_problem(state, tau, robot.feet(mu, on=None) if contacts is None else contacts(robot, mu))


def signorini_and_coulomb(s: rbd.Solution) -> float:
    """How far corner forces are from Signorini's and Coulomb's laws, from the outside: scaled by the largest terms.

    Corner accelerations come from each contact's own acceleration: c + alpha x corner, in contact axes, at rest.
    """
    worst, forces = 0.0, s.corner_forces
    f_scale = max(1.0, np.abs(s.multipliers).max(), np.abs(s.problem.rhs).max())
    for rows in s.problem.rows:
        c, patch = s.accelerations[rows.name], rows.patch
        if patch.friction is None:
            worst = max(worst, np.abs(c).max())
            continue
        if len(c) == 1:
            c = np.r_[0.0, 0.0, c]
        a_scale = max(1.0, np.abs(c).max())
        for corner, f_W in zip(patch.corners, forces[rows.name], strict=True):
            f = patch.axes.T @ f_W
            a = c[:3] if len(c) == 3 else c[:3] + np.cross(c[3:], corner)
            slip, mu, f_t = np.linalg.norm(a[:2]), patch.friction, np.linalg.norm(f[:2])
            worst = max(worst, -a[2] / a_scale, -f[2] / f_scale, abs(a[2] * f[2]) / (a_scale * f_scale))  # Signorini
            worst = max(worst, (f_t - mu * f[2]) / f_scale)
            # Where it slips, friction is mu f_n against the slip: f_t . a_t = -mu f_n |a_t|, of largest dissipation.
            if len(s.accelerations[rows.name]) != 1:
                worst = max(worst, abs(f[:2] @ a[:2] + mu * max(f[2], 0.0) * slip) / (a_scale * f_scale))
    return worst


def hands_and_feet(robot, mu):
    """Two soles, two hands on walls, an elbow: 21 rows."""
    tilted = np.array([0.6, 0.0, 0.8])
    return [
        *robot.soles(mu, on=None),
        rbd.PointContact("left_hand", "gripper_left_base_link", on=rbd.Ground(normal=(0.0, -1.0, 0.0)), friction=mu),
        rbd.PointContact("right_hand", "gripper_right_base_link", on=rbd.Ground(normal=(0.0, 1.0, 0.0)), friction=mu),
        rbd.PointContact("elbow", "arm_left_4_link", on=rbd.Ground(normal=tilted), friction=mu),
    ]


def eight_points(robot, mu):
    """The corners of both soles as points: 24 rows of rank 12."""
    return [
        rbd.PointContact(f"{sole.name}_{i}", sole.frame, offset=sole.placement.act(c), friction=mu)
        for sole in robot.soles()
        for i, c in enumerate(sole.corners)
    ]


def mixed(robot, mu):
    """A rubbing sole, a smooth toe, a held hand."""
    toe = robot.soles()[1]
    return [
        robot.soles(mu, on=None)[0],
        rbd.PointContact("toe", toe.frame, offset=toe.placement.translation, friction=0.0),
        rbd.PointContact("hand", "gripper_left_base_link", on=rbd.Ground(normal=(1.0, 0.0, 0.0))),
    ]


SETS = [
    ("talos", None, (2.0, 60.0)),
    ("g1", None, (2.0, 60.0)),
    ("talos_full", None, (2.0, 60.0)),
    ("g1_hands", None, (2.0, 60.0)),
    ("talos", hands_and_feet, (2.0, 60.0)),
    ("talos", eight_points, (2.0, 60.0)),
    ("talos", mixed, (2.0, 60.0)),
    ("solo12", None, (0.1, 3.0)),
    ("anymal_c", None, (2.0, 60.0)),
]


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(("name", "contacts", "noise"), SETS)
def test_pushed_robots_are_solved(name, contacts, noise, law, exhaustive):
    """8 states of each, or 40: all solved, and each is checked by equations written down elsewhere.

    1,000 of each by `python tests/solvers/test_admm.py`.
    """
    slipping, count = 0, 40 if exhaustive else 8
    for problem in pushed_states(name, count, 11, contacts, noise):
        s = rbd.Solution.of(rbd.ConeSolver(law=law).solve(problem))
        assert s.status == "solved" and str(s.law) == law and s.reason in ("", OPEN if law == "coulomb" else ""), s
        assert max(law_residuals(problem, s, law).values()) < 1e-9
        slipping += max(np.abs(c).max() for c in s.accelerations.values()) > 1e-3
        if law == "coulomb":
            assert signorini_and_coulomb(s) < 1e-9
    assert slipping > count // 4


def test_the_outside_check_can_fail():
    """The convex answer of a slipping box lifts off while it pushes: no Signorini."""
    P = pushed_box(80.0, 0.6)
    assert signorini_and_coulomb(rbd.Solution.of(rbd.ConeSolver().solve(P))) < 1e-12
    assert signorini_and_coulomb(rbd.Solution.of(rbd.ConeSolver(law="convex").solve(P))) > 1e-3


def pushed_box(push_N, mu, contacts=None, moment=(0.0, 0.0, 0.0)):
    """The 10 kg box on its patch, or on other contacts, pushed along x."""
    robot = box()
    q = pin.neutral(robot.model)
    q[2] = 0.1
    if contacts is None:
        X_FP = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
        contacts = [rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=X_FP, friction=mu)]
    force = rbd.ExternalForce("box", (push_N, 0.0, 0.0), moment)
    return rbd.gauss_problem(rbd.State(robot, q), np.zeros(0), contacts, external=force)


@pytest.mark.parametrize(
    ("law", "a_x", "a_z", "normal"),
    [("coulomb", 2.114, 0.0, 98.1), ("convex", 1.554411765, 0.932647059, 107.426470588)],
)
def test_the_slipping_box_to_the_last_digit(law, a_x, a_z, normal):
    """10 kg, mu = 0.6, 80 N: closed forms (F - mu N)/m and, convex, N = (m g + mu F)/(1 + mu^2), c_z = (N - m g)/m."""
    s = rbd.ConeSolver(law=law).solve(pushed_box(80.0, 0.6))
    assert s.a[[0, 2]] == pytest.approx([a_x, a_z], abs=1e-9)
    assert s.contacts["floor"].normal == pytest.approx(normal, abs=1e-8)
    assert s.contacts["floor"].friction_used == pytest.approx(1.0, abs=1e-12)


def test_a_turned_box_spins_against_its_corners():
    """A moment M_z = 30 N m, mu = 0.3: a_zz = (M_z - mu m g r) / I_zz with r the corners' distance from the axis."""
    s = rbd.ConeSolver().solve(pushed_box(0.0, 0.3, moment=(0.0, 0.0, 30.0)))
    inertia = 10.0 * (0.4**2 + 0.4**2) / 12.0
    expected = (30.0 - 0.3 * 98.1 * np.hypot(0.2, 0.2)) / inertia
    assert s.a == pytest.approx([0, 0, 0, 0, 0, expected], abs=1e-9)


@pytest.mark.parametrize("law", LAWS)
def test_points_and_patch_are_the_same_box(law, rng):
    """Four corner points (12 rows of rank 6) and one patch (6 rows): one motion, however the load is shared."""
    for _ in range(10):
        mu, push, moment = rng.uniform(0.2, 1.0), rng.uniform(0.0, 120.0), rng.normal(size=3) * [3.0, 3.0, 8.0]
        points = [
            rbd.PointContact(f"c{i}", "box", offset=(0.2 * x, 0.2 * y, -0.1), friction=mu)
            for i, (x, y) in enumerate([(1, 1), (1, -1), (-1, -1), (-1, 1)])
        ]
        one = rbd.ConeSolver(law=law).solve(pushed_box(push, mu, points, moment))
        other = rbd.ConeSolver(law=law).solve(pushed_box(push, mu, None, moment))
        assert one.status == other.status == "solved"
        assert np.abs(one.a - other.a).max() < 1e-6 * max(1.0, np.abs(one.a).max())


def test_how_corners_share_a_load_does_not_depend_on_their_order(talos, rng):
    """Where soles slide and turn, rigid bodies leave the shares, and so the friction, open; the choice is one of principle.

    The limit of corners that all yield alike: corners listed in another order, feet exchanged, another start: the same a.
    """
    state = talos.standing()
    hold = rbd.hold(state, talos.soles(0.7)).tau
    shared = 0
    for _ in range(25):
        mu, tau = rng.uniform(0.2, 0.8), hold + 25.0 * rng.normal(size=talos.nu)
        P = rbd.gauss_problem(state, tau, talos.soles(mu))
        s = rbd.ConeSolver().solve(P)
        turned = [
            rbd.SurfaceContact(x.name, x.frame, corners=x.corners[[2, 0, 3, 1]], placement=x.placement, friction=mu)
            for x in talos.soles(mu)[::-1]
        ]
        again = rbd.ConeSolver().solve(rbd.gauss_problem(state, tau, turned))
        assert np.abs(again.a - s.a).max() < 1e-6 * max(1.0, np.abs(s.a).max())
        many = rbd.ConeSolver(starts=6).solve(P)
        assert not many.others and np.abs(many.a - s.a).max() < 1e-6 * max(1.0, np.abs(s.a).max())
        # Newton alone, from another start, shows that there was something to choose.
        T, W = P.force_set, P.whitened @ P.force_set.G
        S = scaled(W.T @ W, T.G.T @ P.free_row_acceleration, T)
        w, merit, _ = steps_from(S, np.zeros(T.size), coulomb=True)
        if merit < 1e-12 and np.abs(W @ (T.project(S.weights(w)) - s.weights)).max() > 1e-3:
            shared += 1
            assert s.reason == OPEN
    assert shared >= 3


def test_the_choice_is_the_limit_of_yielding_corners(talos):
    """With compliance in the corners the answer is unique; as it vanishes, linearly, it tends to ours."""
    P = next(iter(pushed_states("talos", 1, 3)))
    s, T, W = rbd.ConeSolver().solve(P), P.force_set, P.whitened @ P.force_set.G
    D, gaps = W.T @ W, []
    for compliance in (1e-2, 1e-3, 1e-4):
        S = scaled(D + compliance * D.diagonal().max() * np.eye(T.size), T.G.T @ P.free_row_acceleration, T)
        w, merit, _ = steps_from(S, S.guess(s.weights), coulomb=True)
        assert merit < 1e-12
        gaps.append(np.abs(W @ (S.weights(w) - s.weights)).max())
    assert gaps[0] > 5.0 * gaps[1] > 25.0 * gaps[2]


def test_more_facets_come_nearer_to_the_true_cones(talos, rng):
    """ProxQP with n facets tends to the convex law of circular cones, about as 1/n^2."""
    state = talos.standing()
    hold = rbd.hold(state, talos.soles(0.7)).tau
    gaps = np.zeros(3)
    for _ in range(6):
        tau = hold + 30.0 * rng.normal(size=talos.nu)
        true = rbd.solve(state, tau, talos.soles(0.3), solver=rbd.ConeSolver(law="convex"))
        for i, n in enumerate((4, 12, 36)):
            s = rbd.solve(state, tau, talos.soles(0.3, facets=n), check=False, solver=rbd.ProxQP())
            gaps[i] = max(gaps[i], np.abs(s.a - true.a).max() / np.abs(true.a).max())
    assert gaps[0] > 1e-4 and gaps[1] < 0.3 * gaps[0] and gaps[2] < 0.3 * gaps[1]


def made_up(rng, law: str):
    """A dense problem of one to eight cones and other sets, with an acceleration strictly inside: an answer exists."""
    nv, rows, a0 = int(rng.integers(3, 16)), [], None
    A, a0 = rng.normal(size=(nv, nv)), rng.normal(size=nv)
    for i in range(int(rng.integers(1, 9))):
        mu, t = rng.uniform(0.05, 1.5), rng.normal(size=2)
        inside = np.r_[t, mu * np.hypot(*t) + 0.1]
        J = rng.normal(size=(3, nv))
        rows.append(Rows(f"cone{i}", J, inside - J @ a0, rbd.problem.FrictionCone(mu)))
    J = rng.normal(size=(4, nv))
    rows.append(Rows("box", J[:2], -J[:2] @ a0, rbd.problem.Bounds([-1.0, -2.0], [1.0, 0.5])))
    rows.append(Rows("stop", J[2:3], 0.1 - J[2:3] @ a0, rbd.problem.NonNegative(1)))
    rows.append(Rows("held", J[3:], -J[3:] @ a0, rbd.problem.Free(1)))
    return rbd.GaussProblem(A @ A.T + 0.1 * np.eye(nv), 10.0 * rng.normal(size=nv), rows)


@pytest.mark.parametrize("law", LAWS)
def test_made_up_problems_that_have_an_answer_are_solved(law, rng):
    """Up to 28 rows on 3 to 15 coordinates; existence by [Acary2011]: some acceleration is strictly inside K*."""
    for _ in range(120):
        P = made_up(rng, law)
        s = rbd.ConeSolver(law=law).solve(P)
        assert s.status == "solved", (s, s.reason)
        assert max(law_residuals(P, s, law).values()) < 1e-9


def one_coordinate(push: float, cone, feedback: float = 0.0) -> rbd.GaussProblem:
    """2 kg on a line."""
    return rbd.GaussProblem([[2.0]], [push], [Rows("row", np.eye(1), np.zeros(1), cone, feedback=np.array([feedback]))])


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize(
    ("cone", "push", "a", "force"),
    [
        (rbd.problem.Bounds([-5.0], [5.0]), 3.0, 0.0, -3.0),  # dry friction sticks
        (rbd.problem.Bounds([-5.0], [5.0]), 8.0, 1.5, -5.0),  # and slips
        (rbd.problem.Bounds([4.0], [4.0]), 2.0, 3.0, 4.0),  # a fixed force
        (rbd.problem.Bounds([-np.inf], [1.0]), 3.0, 0.0, -3.0),  # bounded from above alone
        (rbd.problem.Bounds([-np.inf], [1.0]), -3.0, -1.0, 1.0),
        (rbd.problem.Bounds([2.0], [np.inf]), 3.0, 2.5, 2.0),  # from below alone, nowhere near zero
        (rbd.problem.Bounds([0.0], [0.0]), 3.0, 1.5, 0.0),  # no force at all
        (rbd.problem.Bounds([-1e9], [1e9]), 3.0, 0.0, -3.0),  # as good as held
        (rbd.problem.NonNegative(1), -3.0, 0.0, 3.0),
        (rbd.problem.NonNegative(1), 3.0, 1.5, 0.0),
    ],
)
def test_one_coordinate_under_every_set(cone, push, a, force, law):
    """M a = push + f in closed form."""
    s = rbd.ConeSolver(law=law).solve(one_coordinate(push, cone))
    assert s.status == "solved"
    assert s.a[0] == pytest.approx(a, abs=1e-13) and s.multipliers[0] == pytest.approx(force, abs=1e-12)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("mass", [1e-2, 1.0, 1e4])
def test_units_of_rows_and_mass_change_nothing(law, mass, rng):
    """Rows in units from 1e-3 to 1e3, masses from 1e-2 to 1e4: the same acceleration."""
    for _ in range(20):
        P = made_up(rng, law)
        plain = rbd.ConeSolver(law=law).solve(P)
        rows = []
        for r in P.rows:
            unit = 10.0 ** rng.uniform(-3.0, 3.0)
            cone = (
                rbd.problem.Bounds(mass * r.cone.lo / unit, mass * r.cone.hi / unit)
                if isinstance(r.cone, rbd.problem.Bounds)
                else r.cone
            )
            rows.append(Rows(r.name, unit * r.J, unit * r.bias, cone))
        s = rbd.ConeSolver(law=law).solve(rbd.GaussProblem(mass * P.M, mass * P.rhs, rows))
        assert s.status == "solved"
        if law == "convex":  # Coulomb's motion need not be unique
            assert np.abs(s.a - plain.a).max() < 1e-6 * max(1.0, np.abs(plain.a).max())


def test_where_all_rows_hold_it_is_the_closed_form(talos):
    """No cone, no law: bilateral, as KKT; and free motion without rows."""
    P = rbd.gauss_problem(talos.standing(), np.zeros(talos.nu), talos.soles(None))
    s = rbd.ConeSolver().solve(P)
    assert s.law.kind == "bilateral" and s.solver == "ConeSolver" and s.status == "solved"
    assert np.abs(s.a - rbd.KKT().solve(P).a).max() == 0.0
    free = rbd.ConeSolver().solve(rbd.GaussProblem(np.eye(2), [1.0, 2.0]))
    assert free.a == pytest.approx([1.0, 2.0]) and free.status == "solved"


def moving_apart() -> rbd.GaussProblem:
    """Two floors that both push, moving apart: no acceleration satisfies them."""
    cone, J = rbd.problem.FrictionCone(0.5), np.eye(3)
    rows = [Rows("floor", J, np.array([0.0, 0.0, -1.0]), cone), Rows("ceiling", -J, np.array([0.0, 0.0, -1.0]), cone)]
    return rbd.GaussProblem(np.eye(3), [1.0, 2.0, -3.0], rows)


@pytest.mark.parametrize("law", LAWS)
def test_contradictory_rows_are_infeasible_in_words(law):
    """No acceleration; said after a bounded search."""
    s = rbd.ConeSolver(law=law).solve(moving_apart())
    assert s.status == "infeasible" and "no acceleration" in s.reason and np.isfinite(s.a).all()
    assert s.iterations < 3000


@pytest.mark.parametrize("law", LAWS)
def test_a_search_without_work_left_ends_after_its_first_start_and_says_so(law, monkeypatch):
    """One multiplication: Newton's first step is more. Whether the rows contradict each other is not looked at any more."""
    monkeypatch.setattr("rbd.solvers.admm.SEARCH_WORK", 1.0)
    s = rbd.ConeSolver(law=law).solve(moving_apart())
    assert s.status == "failed" and not s.infeasible
    assert s.reason == "no motion was found within 1e+00 multiplications, and not all starts were tried"
    assert s.iterations <= 201 + 25  # of ADMM and of Newton, from one start


@cache
def wedged() -> rbd.problem.Answer | None:
    """Three wedged points of great friction on four coordinates: now and then the search ends without a motion."""
    rng = np.random.default_rng(4)
    for _ in range(300):
        J = rng.normal(size=(9, 4))
        rows = [Rows(f"p{i}", J[3 * i : 3 * i + 3], rng.normal(size=3), rbd.problem.FrictionCone(3.0)) for i in range(3)]
        s = rbd.ConeSolver().solve(rbd.GaussProblem(np.eye(4), 5.0 * rng.normal(size=4), rows))
        if s.status == "failed":
            return s
    return None


def test_coulomb_without_an_answer_says_so():
    """In words, and with numbers."""
    found = wedged()
    assert found is not None and "Coulomb" in found.reason and not found.infeasible
    assert np.isfinite(found.a).all()


def test_every_step_of_newton_and_of_the_interior_point_is_counted_as_work(monkeypatch):
    """In a search that tries all starts: p^3 + 1e4 multiplications for each step that is not ADMM's."""
    problem, by_admm = wedged().problem, []

    def counted(*given, **settings):
        w, steps = admm(*given, **settings)
        by_admm.append(steps)
        return w, steps

    monkeypatch.setattr("rbd.solvers.admm.admm", counted)
    search = _ConeSearch(problem, COULOMB, 0.0)
    answer = search.run(1)
    steps = answer.iterations - sum(by_admm)
    assert answer.status == "failed" and len(by_admm) == 2 and steps > 300
    assert SEARCH_WORK - search.work.left == steps * (9**3 + 1e4)


def test_two_motions_at_rest_are_both_found():
    """Painleve at rest: a point whose tangent and normal are coupled may stay, or leave. Closed forms of both."""
    D = np.array([[1.0, 0.0, 0.9], [0.0, 1.0, 0.0], [0.9, 0.0, 1.0]])
    y_free, mu = np.array([1.0, 0.0, 0.1]), 1.5
    L = np.linalg.cholesky(D)
    P = rbd.GaussProblem(np.eye(3), np.linalg.solve(L, y_free), [Rows("point", L, np.zeros(3), rbd.problem.FrictionCone(mu))])
    assert np.abs(P.delassus - D).max() < 1e-14 and P.free_row_acceleration == pytest.approx(y_free)
    s = rbd.ConeSolver(starts=20).solve(P)
    motions = [s, *s.others]
    assert all(m.status == "solved" for m in motions)
    assert min(np.abs(P.J @ m.a).max() for m in motions) < 1e-12  # it stays
    assert min(np.abs(m.a - P.a_free).max() for m in motions) < 1e-12  # it leaves: y_n = 0.1 > 0
    assert not rbd.ConeSolver(law="convex", starts=20).solve(P).others


def moving_point(velocity):
    """A unit point mass whose floor contact has a velocity."""
    rows = Rows("point", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.5), np.array(velocity))
    return rbd.GaussProblem(np.eye(3), [0.0, 0.0, -9.81], [rows])


def test_what_cannot_be_taken_is_refused_in_words():
    """Impacts under both laws; sliding under the convex one."""
    assert "approaches" in rbd.ConeSolver().reason_unsupported(moving_point([0.0, 0.0, -1.0]))
    assert "approaches" in rbd.ConeSolver(law="convex").reason_unsupported(moving_point([0.0, 0.0, -1.0]))
    reason = rbd.ConeSolver(law="convex").reason_unsupported(moving_point([1.0, 0.0, 0.0]))
    assert "'point' slides at 1 m/s" in reason and "coulomb" in reason
    for velocity in ([1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]):
        assert rbd.ConeSolver().reason_unsupported(moving_point(velocity)) is None
    for wrong in ({"law": "newton"}, {"law": None}, {"starts": 0}, {"starts": True}, {"starts": 2.5}):
        with pytest.raises(rbd.InputError):
            rbd.ConeSolver(**wrong)


def test_a_sliding_point_rubs_against_its_motion_and_an_opening_one_not_at_all():
    """Unit mass: f = m g (-mu, 0, 1) while it slides along x; free fall while it leaves."""
    s = rbd.ConeSolver().solve(moving_point([2.0, 0.0, 0.0]))
    assert s.status == "solved" and s.a == pytest.approx([-0.5 * 9.81, 0.0, 0.0])
    s = rbd.ConeSolver().solve(moving_point([2.0, 0.0, 1.0]))
    assert s.status == "solved" and s.a == pytest.approx([0.0, 0.0, -9.81]) and not s.multipliers.any()


def test_pinocchios_admm_answers_most_states_and_newton_makes_it_exact():
    """Its own answer on states that slip: a share does not converge; from what it leaves, Newton does."""
    close = exact = 0
    problems = list(pushed_states("talos", 40, 5))
    for P in problems:
        T, W = P.force_set, P.whitened @ P.force_set.G
        S = scaled(W.T @ W, T.G.T @ P.free_row_acceleration, T)
        w, iterations = admm(S, np.zeros(T.size), coulomb=True, iterations=500, tolerance=1e-9)
        assert iterations <= 501
        close += steps_from(S, w, coulomb=True, iterations=0)[1] < 1e-6
        exact += steps_from(S, w, coulomb=True)[1] < 1e-11
    assert close >= 0.8 * len(problems) and exact >= close


def statistics(name: str, law: str, count: int, contacts=None, noise=(2.0, 60.0)) -> str:
    """One line: shares solved, residuals, how they were found."""
    problems = list(pushed_states(name, count, 1, contacts, noise))
    answers = [rbd.Solution.of(rbd.ConeSolver(law=law).solve(P)) for P in problems]
    worst = np.array([s.residuals.worst for s in answers])
    outside = [max(law_residuals(P, s, law).values()) for P, s in zip(problems, answers, strict=True)]
    if law == "coulomb":
        outside = [max(x, signorini_and_coulomb(s)) for x, s in zip(outside, answers, strict=True)]
    wrong = sum(x > 1e-8 for x, s in zip(outside, answers, strict=True) if s.status == "solved")
    seconds, steps = np.array([s.seconds for s in answers]), np.array([s.iterations for s in answers])
    slip = np.mean([max(np.abs(c).max() for c in s.accelerations.values()) > 1e-3 for s in answers])
    what = "soles or feet" if contacts is None else contacts.__name__
    return (
        f"{name:11} {what:15} {law:8} {100 * (worst <= 1e-8).mean():6.2f} % at 1e-8, worst {worst.max():.0e}, wrong {wrong}, "
        f"{100 * slip:3.0f} % slip or lift, {100 * (steps == 0).mean():3.0f} % closed form, "
        f"{100 * (steps > 210).mean():4.1f} % beyond the first try, {np.median(steps):.0f} steps, "
        f"{1e6 * np.median(seconds):.0f} us, longest {1e3 * seconds.max():.0f} ms"
    )


def methods(name: str, law: str, count: int) -> str:
    """One line: what each method finds alone, at a scaled merit of 1e-8 and 1e-12, and its median time."""
    coulomb, found = law == "coulomb", {}

    def take(what, problem, guess, run) -> np.ndarray:
        start = time.perf_counter()
        w = run(problem, guess)
        merit = steps_from(problem, w, coulomb=coulomb, iterations=0)[1]
        found.setdefault(what, []).append((merit < 1e-8, merit < 1e-12, time.perf_counter() - start))
        return w

    for P in pushed_states(name, count, 1):
        T, W = P.force_set, P.whitened @ P.force_set.G
        S = scaled(W.T @ W, T.G.T @ P.free_row_acceleration, T)
        first = S.guess(T.project(holding(P)))
        take("Newton, from holding", S, first, lambda S, w: steps_from(S, w, coulomb=coulomb)[0])
        take("Newton, from zero", S, 0.0 * first, lambda S, w: steps_from(S, w, coulomb=coulomb)[0])
        admm(S, first, coulomb=coulomb, iterations=1, tolerance=1e-6)  # its models are made once for each friction
        for tolerance in (1e-4, 1e-6, 1e-9):
            w = take(
                f"ConeSolver to {tolerance:g}", S, first,
                lambda S, w, t=tolerance: admm(S, w, coulomb=coulomb, iterations=200, tolerance=t)[0],
            )  # fmt: skip
            take(f"Newton from {tolerance:g}", S, w, lambda S, w: steps_from(S, w, coulomb=coulomb)[0])
        if not coulomb:
            take("interior point", S, first, lambda S, w: interior_point(S.convex()).x)
    cells = []
    for what, results in found.items():
        good, exact, seconds = np.array(results).T
        cells.append(f"{what}: {100 * good.mean():.1f} / {100 * exact.mean():.1f} %, {1e6 * np.median(seconds):.0f} us")
    return f"{name:6} {law:8} " + "; ".join(cells)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    for robot in ("talos", "g1"):
        for rule in LAWS:
            print(methods(robot, rule, 1000), flush=True)
    for robot, chosen, torque in SETS:
        for rule in LAWS:
            print(statistics(robot, rule, 1000 if chosen is None else 300, chosen, torque), flush=True)
