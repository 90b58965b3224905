"""Solution: what is said about an answer, and what happens when there is none."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.solution import Solution
from rbd.arrays import RANK
from rbd.errors import InaccurateWarning, NoSolution
from rbd.problem.answer import Status
from rbd.problem.rows import Rows

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.EffortLimitWarning")  # noise on small motors


@pytest.fixture(scope="module")
def pushed(talos: rbd.Robot) -> rbd.Solution:
    """Talos pushed hard enough for its soles to slip and lift."""
    rng = np.random.default_rng(3)
    state = talos.standing()
    tau = rbd.hold(state, talos.soles()).tau + 30.0 * rng.normal(size=talos.nu)
    return rbd.solve(
        state, tau, talos.soles(0.3), external=rbd.ExternalForce("torso_2_link", (100.0, 150.0, 0.0)), solver=rbd.ProxQP()
    )


@pytest.fixture(scope="module")
def turning(talos: rbd.Robot) -> rbd.State:
    """Talos whose feet turn."""
    v = 0.3 * np.random.default_rng(4).normal(size=talos.nv)
    return talos.standing().with_velocity(v)


def _four_points(talos: rbd.Robot) -> list[rbd.PointContact]:
    sole = talos.soles()[0]
    return [rbd.PointContact(f"corner{i}", sole.frame, offset=sole.placement.act(c)) for i, c in enumerate(sole.corners)]


def test_gauss_is_the_distance_from_free_motion_and_the_sum_of_its_shares(pushed, talos, turning):
    """1/2 |a - a_free|_M^2 = sum of 1/2 f_i . J_i (a - a_free), slipping or held, at rest or moving."""
    held = rbd.solve(turning, np.zeros(talos.nu), talos.soles(None), solver=rbd.KKT())
    for s in (pushed, held):
        moved = s.a - s.a_free
        assert s.gauss == pytest.approx(0.5 * moved @ s.problem.M @ moved, rel=1e-12)
        assert set(s.gauss.shares) == {"left_sole", "right_sole"}
        assert sum(s.gauss.shares.values()) == pytest.approx(float(s.gauss), rel=1e-9)
        for rows in s.problem.rows:
            f = s.multipliers[s.problem.slices[rows.name]]
            assert s.gauss.shares[rows.name] == pytest.approx(0.5 * f @ rows.J @ moved, rel=1e-12, abs=1e-9)


def test_a_multiplier_is_the_rate_of_gauss_as_its_row_gives_way(talos, turning):
    """dZ*/dy = f for Z*(y) = min 1/2 |a - a_free|_M^2 with J a + J_dot v = y: a parabola, so central differences are exact."""
    held = rbd.solve(turning, np.zeros(talos.nu), talos.soles(None), solver=rbd.KKT())
    P = held.problem

    def least(giving):
        rows = [replace(r, bias=r.bias - giving[P.slices[r.name]]) for r in P.rows]
        return float(rbd.solve_problem(rbd.GaussProblem(P.M, P.rhs, rows), solver=rbd.KKT()).gauss)

    slopes = [0.5 * (least(e) - least(-e)) for e in np.eye(P.m)]
    assert np.abs(slopes - held.multipliers).max() < 1e-9 * np.abs(held.multipliers).max()
    assert np.abs(held.multipliers).min() > 1e-3  # no row for which zero would do


def test_no_other_admissible_acceleration_is_nearer_to_free_motion(pushed, rng):
    """Gauss: the answer minimises 1/2 |a - a_free|_M^2 over all a whose contacts neither pierce nor leave K*."""
    P = pushed.problem
    solve_J, G = np.linalg.pinv(P.J), P.force_set.pyramids.G
    free = np.eye(P.nv) - solve_J @ P.J
    tried = 0
    for size in (1e-3, 1e-1, 1.0, 10.0):
        for _ in range(200):
            c = P.J @ pushed.a + P.offset + size * 0.1 * rng.normal(size=P.m)
            c[2::6] += size * rng.uniform(size=2)  # upwards, or few would be admissible
            if (G.T @ c).min() < 0.0:
                continue
            a = solve_J @ (c - P.offset) + free @ (pushed.a + size * rng.normal(size=P.nv))
            assert 0.5 * (a - P.a_free) @ P.M @ (a - P.a_free) > pushed.gauss
            tried += 1
    assert tried > 50


def test_accelerations_are_those_of_the_contacts(pushed, talos, turning):
    """J a + J_dot v by name: zero where a contact holds, in K* where it may slip or lift."""
    held = rbd.solve(turning, np.zeros(talos.nu), talos.soles(None))
    assert np.abs(np.concatenate(list(held.accelerations.values()))).max() < 1e-9
    for rows in pushed.problem.rows:
        c = pushed.accelerations[rows.name]
        assert c == pytest.approx(rows.J @ pushed.a + rows.bias, abs=1e-9)
        assert (rbd.problem.force_set.at_rest(rows.cone).pyramids.G.T @ c).min() > -1e-9
    assert max(np.abs(c).max() for c in pushed.accelerations.values()) > 0.1


def test_accelerations_leave_feedback_out():
    """Stabilisation is no physics: a row held by feedback accelerates."""
    rows = Rows("bar", np.ones((1, 1)), np.array([2.0]), rbd.problem.Free(1), feedback=np.array([5.0]))
    s = rbd.KKT().solve(rbd.GaussProblem(np.ones((1, 1)), np.zeros(1), [rows]))
    assert s.a == pytest.approx([-7.0]) and s.accelerations["bar"] == pytest.approx([-5.0])


def test_corner_forces_add_up_to_the_wrench_and_stay_in_their_pyramids(pushed):
    """Sum of p_i = force, sum of c_i x p_i = moment, |p_x|, |p_y| <= mu p_z in contact axes."""
    for rows in pushed.problem.rows:
        corners, wrench, patch = pushed.corner_forces[rows.name], pushed.forces[rows.name], rows.patch
        assert corners.shape == (4, 3)
        assert corners.sum(axis=0) == pytest.approx(wrench[:3], abs=1e-9)
        arms = patch.corners @ patch.axes.T
        assert np.cross(arms, corners).sum(axis=0) == pytest.approx(wrench[3:], abs=1e-9)
        local = corners @ patch.axes
        assert (np.abs(local[:, :2]) <= 0.3 * local[:, 2:] + 1e-9).all()


def test_corner_forces_of_a_held_sole_add_up_too(talos):
    """A contact that holds has no corner law: the minimum-norm split, which still adds up."""
    s = rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(None))
    for name, corners in s.corner_forces.items():
        assert corners.sum(axis=0) == pytest.approx(s.forces[name][:3], abs=1e-8)


@pytest.mark.parametrize("friction", [None, 0.0, 0.6])
def test_forces_are_in_world_axes_on_the_robot(talos, friction):
    """Whatever the kind, a robot that keeps still is carried by its weight, upwards."""
    state = talos.standing()
    tau = rbd.hold(state, talos.soles(0.6)).tau if friction != 0.0 else np.zeros(talos.nu)
    s = rbd.solve(state, tau, talos.soles(friction))
    total = sum(f[:3] for f in s.forces.values())
    if friction == 0.0:
        assert total[:2] == pytest.approx([0.0, 0.0], abs=1e-9) and total[2] > 0.0
        rate = s.problem.balance.A_g @ s.a
        assert total[2] - talos.mass * 9.81 == pytest.approx(rate[2], abs=1e-8)
    else:
        assert total == pytest.approx([0.0, 0.0, talos.mass * 9.81], abs=1e-9 * talos.mass * 9.81)


def test_forces_are_copies(pushed):
    """Changing what was handed out changes no later answer."""
    s = replace(pushed)
    s.forces["left_sole"][:] = 0.0
    assert replace(pushed).forces["left_sole"].any()


def test_the_rank_is_stated_with_its_tolerance(talos):
    """Four held corners of a sole: 12 rows of rank 6, at singular values above 1e-9 of the largest."""
    s = rbd.solve(talos.standing(), np.zeros(talos.nu), _four_points(talos), solver=rbd.KKT())
    assert s.problem.m == 12 and s.rank == 6 and RANK == 1e-9
    assert "12 rows of rank 6" in str(s)
    assert rbd.solve(talos.standing(), np.zeros(talos.nu), []).rank == 0


def test_a_sole_held_at_four_points_cannot_turn(talos, turning):
    """Four held points of a turning foot contradict each other: NoSolution names one and carries problem and result."""
    for solver in (rbd.ProxQP(), rbd.KKT()):
        with pytest.raises(NoSolution, match=r"corner\d cannot hold: residual .* m/s2") as caught:
            rbd.solve(turning, np.zeros(talos.nu), _four_points(talos), solver=solver)
        error = caught.value
        assert error.problem.m == 12 and isinstance(error.result, Solution)
        assert error.result.status is Status.INFEASIBLE and "SurfaceContact" in str(error)
        gaps = {name: np.abs(c).max() for name, c in error.result.accelerations.items()}
        assert gaps[str(error).split()[0]] == pytest.approx(max(gaps.values()), rel=1e-6)  # two corners miss by the same
    rbd.solve(turning, np.zeros(talos.nu), talos.soles(None)[:1])  # one surface: no contradiction


def test_unchecked_the_best_attempt_is_returned(talos, turning):
    """`check=False` raises nothing, and the answer says what it is."""
    s = rbd.solve(turning, np.zeros(talos.nu), _four_points(talos), check=False)
    assert s.status is Status.INFEASIBLE and s.residuals.feasibility > 1e-3 and "cannot hold" in s.worst


@dataclass(frozen=True)
class Given:
    """A constraint whose rows are given."""

    name: str
    J: np.ndarray
    bias: np.ndarray
    cone: rbd.problem.cones.Cone

    def rows(self, state: rbd.State) -> Rows:
        """As given, wherever the robot is."""
        return Rows(self.name, self.J, self.bias, self.cone)


def test_rows_that_contradict_each_other_name_their_constraint(talos):
    """One constraint asks for two accelerations of one joint: it is named, not its neighbour that can be met."""
    e = np.eye(talos.nv)
    hand = Given("hand", e[[20, 20]], np.array([0.0, 1.0]), rbd.problem.Free(2))
    knee = Given("knee", e[[10]], np.array([3.0]), rbd.problem.Free(1))
    for solver in (rbd.ProxQP(), rbd.KKT()):
        with pytest.raises(NoSolution, match=r"^hand cannot hold.*no acceleration satisfies"):
            rbd.solve(talos.standing(), np.zeros(talos.nu), [knee, hand], solver=solver)


def test_stops_that_contradict_each_other_are_infeasible(talos):
    """A joint cannot be above its upper and below its lower stop; a linear program confirms it."""
    e = np.eye(talos.nv)
    stops = Given("stops", np.array([e[20], -e[20]]), np.array([0.0, -1.0]), rbd.problem.NonNegative(2))
    with pytest.raises(NoSolution, match=r"^stops.*no acceleration satisfies") as caught:
        rbd.solve(talos.standing(), np.zeros(talos.nu), [stops])
    assert caught.value.result.status is Status.INFEASIBLE


def test_an_inaccurate_answer_is_said_aloud(talos):
    """Between 1e-9 and 1e-7 it is returned, with a warning."""
    right = rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(None))

    class Rough(rbd.KKT):
        """The closed form, a little off."""

        def solve(self, problem):
            s = super().solve(problem)
            return replace(s, multipliers=s.multipliers * (1.0 + 1e-8))

    with pytest.warns(InaccurateWarning, match="inaccurate on talos"):
        s = rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(None), solver=Rough())
    assert s.status is Status.INACCURATE and np.allclose(s.a, right.a)
    rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(None), solver=Rough(), check=False)  # silent


def test_a_solver_refuses_before_it_starts(talos):
    """KKT takes contacts that hold; the message says which does not, and what to use."""
    with pytest.raises(rbd.errors.Unsupported, match=r"KKT.*'left_sole'.*WrenchCone.*solver="):
        rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(0.5), solver=rbd.KKT())


def test_the_law_is_named(talos, pushed):
    """Bilateral, convex, or convex with the pyramids that stand for the cones."""
    state, tau = talos.standing(), np.zeros(talos.nu)
    assert str(pushed.law) == "convex, 4 facets"
    assert rbd.solve(state, tau, talos.soles(None)).law.kind == "bilateral"
    assert str(rbd.solve(state, tau, talos.soles(0.0), solver=rbd.ProxQP()).law) == "convex"
    mixed = [talos.soles(0.5, facets=8)[0], talos.soles(0.5)[1]]
    assert str(rbd.solve(state, tau, mixed, solver=rbd.ProxQP()).law) == "convex, 4 and 8 facets"
    for kind in ("coulomb", "convex"):
        assert str(rbd.solve(state, tau, mixed, law=kind).law) == kind


def test_contacts_say_what_they_carry(pushed):
    """Normal and tangential force, friction used, centre of pressure inside the sole."""
    for rows in pushed.problem.rows:
        c = pushed.contacts[rows.name]
        assert c.normal == pytest.approx(pushed.forces[rows.name][2])
        assert c.tangential == pytest.approx(np.hypot(*pushed.forces[rows.name][:2]))
        assert c.friction_used == pytest.approx(c.tangential / (0.3 * c.normal))
        local = rows.patch.axes.T @ (c.centre_of_pressure - rows.patch.point)
        assert (np.abs(local) <= np.abs(rows.patch.corners[0]) + 1e-9).all()
        assert np.cross(c.centre_of_pressure - rows.patch.point, pushed.forces[rows.name][:3])[:2] == pytest.approx(
            pushed.forces[rows.name][3:5], abs=1e-8
        )


def test_the_printed_table_has_a_line_for_each_contact(pushed):
    """Status, law, contacts and residuals; one look is enough."""
    text = str(pushed)
    for word in ("solved by QP, law: convex, 4 facets", "left_sole", "right_sole", "residuals", "centroidal"):
        assert word in text
    assert "solved" in repr(pushed)


def test_a_fixed_base_has_no_centroidal_residual():
    """The base's reaction is unknown, so the momentum balance says nothing."""
    panda = rbd.load_robot("panda", root="fixed")
    s = rbd.solve(panda.at(), np.zeros(panda.nu))
    assert s.residuals.centroidal is None and s.status is Status.SOLVED


def test_constrained_motion_keeps_its_constraint(talos):
    """Integrated over a step h, the velocity of held soles grows as h^2 only: J a + J_dot v is its rate, and is zero."""
    rng = np.random.default_rng(8)
    state = talos.standing()
    J = np.vstack([sole.rows(state).J for sole in talos.soles(None)])
    v = rng.normal(size=talos.nv)
    state = state.with_velocity(v - np.linalg.pinv(J) @ (J @ v))
    a = rbd.solve(state, 10.0 * rng.normal(size=talos.nu), talos.soles(None)).a
    slips = []
    for h in (1e-3, 5e-4):
        later = talos.at(pin.integrate(talos.model, state.q, state.v * h + 0.5 * a * h * h), state.v + a * h)
        slips.append(max(np.abs(sole.rows(later).velocity).max() for sole in talos.soles(None)))
    assert slips[0] / slips[1] == pytest.approx(4.0, rel=0.05)


@pytest.mark.parametrize(
    "solver", [rbd.ProxQP(), rbd.ConeSolver(), rbd.ConeSolver(law="convex")], ids=["pyramids", "coulomb", "convex"]
)
def test_rows_made_by_hand_have_corner_forces_too(solver):
    """A point and a patch without a robot: corner forces lie in their cones and make the row forces."""
    corners = np.array([[0.2, 0.1, 0.0], [-0.2, 0.1, 0.0], [-0.2, -0.1, 0.0], [0.2, -0.1, 0.0]])
    patch = rbd.Rows("patch", np.eye(6), np.zeros(6), rbd.problem.WrenchCone(corners, 0.5))
    s = rbd.solve_problem(rbd.GaussProblem(np.eye(6), np.array([2.0, 1.0, -10.0, 0.2, -0.1, 0.0]), [patch]), solver=solver)
    f = s.corner_forces["patch"]
    total = np.concatenate([f.sum(axis=0), np.cross(corners, f).sum(axis=0)])
    assert s.status == "solved" and f.shape == (4, 3) and np.abs(total - s.multipliers).max() < 1e-9
    assert (np.hypot(f[:, 0], f[:, 1]) <= 0.5 * np.sqrt(2.0) * f[:, 2] + 1e-9).all()
    point = rbd.Rows("point", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.5))
    s = rbd.solve_problem(rbd.GaussProblem(np.eye(3), np.array([1.0, 0.0, -10.0]), [point]), solver=solver)
    assert s.corner_forces["point"] == pytest.approx(np.array([[-1.0, 0.0, 10.0]]))
