"""Which forces are returned: those of least norm inside the cones, held against closed forms, duality and linear programs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog, minimize, nnls

import rbd
from rbd.answers.analysis.admissible_forces import admissible, ray_weights
from rbd.answers.analysis.force_choice import _least_distance, shortest
from rbd.errors import InputError, NoSolution, UnknownName
from rbd.problem.cones import project_cones, pyramid
from rbd.problem.gauss_problem import Law
from rbd.problem.rows import Patch, Rows
from rbd.testing import box

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.EffortLimitWarning")  # noise on small motors

G = 9.81
LEGS = ("++", "+-", "-+", "--")
CHOSEN = "minimum norm of the corner forces [N]"


def table(com, friction, solver=None) -> rbd.Solution:
    """Legs at (+-0.6, +-0.4) m, weight 400 N, at rest."""
    feet = [(0.6, 0.4), (0.6, -0.4), (-0.6, 0.4), (-0.6, -0.4)]
    legs = [
        rbd.PointContact(name, "box", offset=(x - com[0], y - com[1], -0.7), friction=friction)
        for name, (x, y) in zip(LEGS, feet, strict=True)
    ]
    robot = box(400.0 / G, (1.2, 0.8, 0.1))
    q = np.array([0.0, 0.0, 0.7, 0.0, 0.0, 0.0, 1.0])
    return rbd.solve(rbd.State(robot, q), np.zeros(0), legs, solver=solver or rbd.ProxQP())


def minimum_norm(problem, a, f, weights, law) -> tuple[np.ndarray, np.ndarray]:
    """(row forces, weights) of minimum norm among those with the same motion under the same law."""
    found = admissible(problem, a, f, weights, law)
    x = shortest(found)
    return found.forces(x), found.law_weights(x)


def normals(solution: rbd.Solution) -> np.ndarray:
    """Vertical forces of the four legs."""
    return np.array([solution.forces[name][2] for name in LEGS])


@pytest.fixture(scope="module")
def noisy(talos) -> list[rbd.Solution]:
    """Talos with noise on its torques: corners that stick, slip and open, by pyramids and by Coulomb's law."""
    rng, state = np.random.default_rng(5), talos.standing()
    tau = rbd.hold(state, talos.soles(0.5)).tau
    found = []
    for size in (0.0, 6.0, 12.0, 20.0):
        noise = size * rng.normal(size=talos.nu)
        for solver in (rbd.ProxQP(), rbd.ConeSolver(law="coulomb"), rbd.ConeSolver(law="convex")):
            found.append(rbd.solve(state, tau + noise, talos.soles(0.5), solver=solver))
    assert {str(s.law) for s in found} == {"convex, 4 facets", "coulomb", "convex"}
    return found


@pytest.mark.parametrize(
    ("com", "friction", "expected"),
    [
        ((0.15, -0.1), None, (100.0, 150.0, 50.0, 100.0)),
        ((0.15, -0.1), 0.0, (100.0, 150.0, 50.0, 100.0)),
        ((0.15, -0.1), 0.5, (100.0, 150.0, 50.0, 100.0)),
        ((0.45, 0.2), None, (225.0, 125.0, 75.0, -25.0)),  # held: a leg pulls
        ((0.45, 0.2), 0.0, (250.0, 100.0, 50.0, 0.0)),
        ((0.45, 0.2), 0.5, (250.0, 100.0, 50.0, 0.0)),
    ],
)
@pytest.mark.parametrize("solver", [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver(law="coulomb")], ids=lambda s: type(s).__name__)
def test_the_table_stands_on_its_shortest_forces(com, friction, expected, solver):
    """Closed form: f = f0 + t (1, -1, -1, 1); least at t = 0, or where the leg that would pull carries nothing."""
    if friction is not None and solver == rbd.KKT():
        solver = rbd.ConeSolver(law="convex")
    s = table(com, friction, solver)
    chosen = s.with_forces()
    assert chosen.force_choice == CHOSEN and chosen.status == "solved"
    assert normals(chosen) == pytest.approx(expected, abs=400e-10)
    assert np.abs([chosen.forces[name][:2] for name in LEGS]).max() < 400e-10
    assert np.array_equal(chosen.a, s.a)
    settled = s.settled()
    assert normals(settled) == pytest.approx(normals(chosen), abs=1e-12) and settled.force_choice == CHOSEN


def test_kkt_returns_the_shortest_forces(talos):
    """12 held points in place of a wrench: KKT's own answer is the chosen one, its parts belong together."""
    s = table((0.45, 0.2), None, rbd.KKT())
    assert s.force_choice == CHOSEN and normals(s) == pytest.approx([225, 125, 75, -25], abs=400e-10)
    for rows in s.problem.rows:
        f = s.multipliers[s.problem.slices[rows.name]]
        assert s.forces[rows.name] == pytest.approx(rows.resultant @ f, abs=1e-12)
        assert s.corner_forces[rows.name][0] == pytest.approx(s.forces[rows.name], abs=1e-12)


def test_two_held_feet_share_a_load_with_the_least_corner_forces():
    """Row forces and corner forces are chosen together: no change within the null space shortens the corner forces."""
    feet = [
        rbd.SurfaceContact(name, "box", half_lengths=half, placement=_below(x), friction=None)
        for name, x, half in (("left", -0.15, (0.05, 0.2)), ("right", 0.15, (0.02, 0.1)))
    ]
    robot = box()
    q = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    push = rbd.ExternalForce("box", (70.0, 20.0, -30.0))
    s = rbd.solve(rbd.State(robot, q), np.zeros(0), feet, external=push, solver=rbd.KKT())
    assert s.force_choice == CHOSEN
    corners = np.concatenate([s.corner_forces[name].ravel() for name in ("left", "right")])
    C = np.zeros((12, 24))
    for i, rows in enumerate(s.problem.rows):
        C[6 * i : 6 * i + 6, 12 * i : 12 * i + 12] = rbd.problem.WrenchCone(rows.patch.corners, 0.0).corner_map
    assert C @ corners == pytest.approx(s.multipliers, abs=1e-10)
    shortest = np.linalg.pinv(s.problem.J.T @ C) @ (s.problem.J.T @ s.multipliers)  # all corners at once, no rows
    assert corners == pytest.approx(shortest, abs=1e-9)


def _below(x: float) -> np.ndarray:
    X = np.eye(4)
    X[:3, 3] = x, 0.0, -0.1
    return X


def test_no_force_of_the_pyramids_is_shorter(noisy):
    """Optimality by a linear program over the rays themselves: gradient . (other - chosen) >= 0 for all that are admissible."""
    tried = 0
    for s in noisy:
        if not s.law.facets:
            continue
        P, R = s.problem, s.problem.force_set.pyramids
        still = R.G.T @ (P.J @ s.a + P.offset) < 1e-9
        A = P.J.T @ R.G[:, still]
        rays = [pyramid(0.5, 4)] * 8  # corner forces of the rays, contact axes
        E = np.zeros((24, 32))
        for i, ray in enumerate(rays):
            E[3 * i : 3 * i + 3, 4 * i : 4 * i + 4] = ray
        x = np.concatenate([(s.corner_forces[r.name] @ r.patch.axes).ravel() for r in P.rows])
        gradient = E[:, still].T @ x
        b = P.J.T @ s.multipliers
        U, sv, _ = np.linalg.svd(A)
        basis = U[:, : int((sv > 1e-9 * sv[0]).sum())]
        best = linprog(gradient, A_eq=basis.T @ A, b_eq=basis.T @ b, bounds=(0.0, None), method="highs")
        assert best.status == 0 and best.fun >= x @ x - 1e-8 * (x @ x)
        assert s.force_choice == CHOSEN
        tried += 1
    assert tried == 4


def test_the_circular_choice_has_no_duality_gap(noisy):
    """D(l) = b . l - 1/2 |proj_K(A^T l)|^2 bounds 1/2 |corner forces|^2 from below, and reaches it."""
    tried = 0
    for s in noisy:
        if s.law.facets:
            continue
        P, T = s.problem, s.problem.force_set
        y = T.accelerations(P.J @ s.a + P.offset, coulomb=s.law.kind == "coulomb").reshape(-1, 3)
        slip = np.hypot(y[:, 0], y[:, 1])
        mode = np.where(np.linalg.norm(y, axis=1) < 1e-8, 0, np.where(y[:, 2] - 0.5 * slip < 1e-8, 1, 2))
        edge = np.column_stack([-0.5 * y[:, :2] / np.maximum(slip, 1e-12)[:, None], np.ones(len(y))])

        def allowed(v, mode=mode, edge=edge):
            v = v.reshape(-1, 3)
            along = np.maximum((v * edge).sum(axis=1) / (edge * edge).sum(axis=1), 0.0)[:, None] * edge
            whole = project_cones(v, np.full(len(v), 0.5))
            return np.where((mode == 0)[:, None], whole, np.where((mode == 1)[:, None], along, 0.0)).ravel()

        x = np.concatenate([(s.corner_forces[r.name] @ r.patch.axes).ravel() for r in P.rows])
        b, size = s.multipliers, float(x @ x)
        start = np.linalg.lstsq(T.G.T, x, rcond=None)[0]
        scale = np.sqrt(size)

        def dual(lam, T=T, b=b, allowed=allowed, scale=scale):
            p = allowed(T.G.T @ lam)
            return 0.5 * p @ p / scale**2 - b @ lam / scale**2, (T.G @ p - b) / scale**2

        lam = start
        for _ in range(6):
            lam = minimize(dual, lam, jac=True, method="BFGS", options={"gtol": 1e-13, "maxiter": 3000}).x
        assert -dual(lam)[0] == pytest.approx(0.5, abs=1e-7)  # in units of |x|^2
        assert -dual(lam)[0] <= 0.5 + 1e-12
        assert T.G @ x == pytest.approx(b, abs=1e-9 * scale) and np.abs(allowed(x) - x).max() < 1e-9 * scale
        tried += 1
    assert tried == 8


def test_where_rows_are_independent_the_row_forces_stay_as_they_are(noisy):
    """J of full rank: only the split among corners is chosen, and it belongs to the wrench to the last digit."""
    for s in noisy:
        assert s.rank == s.problem.m
        chosen = s.with_forces()
        assert chosen.multipliers is s.multipliers
        for rows in s.problem.rows:
            corners, wrench = chosen.corner_forces[rows.name], s.forces[rows.name]
            assert corners == pytest.approx(s.corner_forces[rows.name], abs=1e-9)
            arms = rows.patch.corners @ rows.patch.axes.T
            assert corners.sum(axis=0) == pytest.approx(wrench[:3], abs=1e-9)
            assert np.cross(arms, corners).sum(axis=0) == pytest.approx(wrench[3:], abs=1e-9)


def test_what_is_unique_is_said_to_be():
    """One foot on a point: nothing to choose."""
    s = rbd.solve_problem(
        rbd.GaussProblem(
            np.eye(3), np.array([1.0, 0.0, -9.0]), [Rows("toe", np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.5))]
        )
    )
    assert s.force_choice == "unique" and s.with_forces().force_choice == "unique"


@pytest.mark.parametrize(
    ("weight", "t"),
    [({"+-": 2.0}, 30.0), ({"+-": 10.0}, 50.0), ({"--": 4.0}, -(400.0 - 200.0 + 100.0) / 7.0), (dict.fromkeys(LEGS, 7.0), 0.0)],
)
def test_weights_move_the_load_to_where_it_costs_less(weight, t):
    """Minimise sum w f^2 along f0 + t (1, -1, -1, 1): t = -sum(w n f0) / sum(w), up to where a leg carries nothing."""
    for s in (table((0.15, -0.1), 0.0), table((0.15, -0.1), 0.5), table((0.15, -0.1), 0.5, rbd.ConeSolver())):
        chosen = s.with_forces(weight)
        assert chosen.force_choice == "minimum of the given weight" and chosen.status == "solved"
        expected = np.array([100, 150, 50, 100]) + t * np.array([1, -1, -1, 1])
        assert normals(chosen) == pytest.approx(expected, abs=4e-7)


def test_a_number_a_list_and_a_matrix_say_the_same(noisy):
    """Weights of corners as numbers, one each, and as a matrix in world axes; unlike weights give other forces."""
    for s in noisy[:3]:
        number = s.with_forces({"left_sole": 3.0})
        each = s.with_forces({"left_sole": [3.0] * 4})
        matrix = s.with_forces({"left_sole": 3.0 * np.eye(12)})
        uneven = s.with_forces({"left_sole": [1.0, 1.0, 1.0, 100.0]})
        for other in (each, matrix):
            assert other.corner_forces["left_sole"] == pytest.approx(number.corner_forces["left_sole"], abs=1e-8)
        assert uneven.corner_forces["left_sole"][3, 2] < number.corner_forces["left_sole"][3, 2] - 1.0


def test_a_matrix_may_weigh_directions(noisy):
    """Tangential forces made dear: each corner then rubs as it presses, as the closed form of a held patch has it, or less."""
    s = noisy[0]
    dear = np.kron(np.eye(4), np.diag([1e4, 1e4, 1.0]))
    plain, smooth = s.with_forces(), s.with_forces({"left_sole": dear})

    def rubbing(solution):
        return (solution.corner_forces["left_sole"][:, :2] ** 2).sum()

    assert rubbing(smooth) < rubbing(plain) * (1 + 1e-9) and smooth.status == "solved"
    values = [(x.corner_forces["left_sole"].ravel() @ dear @ x.corner_forces["left_sole"].ravel()) for x in (smooth, plain)]
    assert values[0] <= values[1] * (1 + 1e-12)


@pytest.mark.parametrize(
    "weight",
    [
        {"++": -1.0},
        {"++": 0.0},
        {"++": np.nan},
        {"++": [1.0, 2.0]},
        {"++": np.diag([1.0, 1.0, -1.0])},
        {"++": np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])},
        {"++": 1e-30},
        {"++": 1e40},
        {"++": "heavy"},
        3.0,
        [("++", 1.0)],
    ],
)
def test_weights_that_mean_nothing_are_refused(weight):
    """The message says what came and what was expected."""
    with pytest.raises(InputError, match="expected"):
        table((0.15, -0.1), 0.5).with_forces(weight)


def test_a_weight_names_its_contact():
    """A name that is none brings the nearest."""
    with pytest.raises(UnknownName, match="'legs'.*nearest|'legs'.*there are"):
        table((0.15, -0.1), 0.5).with_forces({"legs": 1.0})


def test_what_is_no_answer_has_no_other_forces(talos):
    """Rows that contradict each other: with_forces refuses, settled returns the same, and the choice is the solver's."""
    e = np.eye(3)
    rows = [Rows("one", e[:1], np.zeros(1), rbd.problem.Free(1)), Rows("two", e[:1], np.ones(1), rbd.problem.Free(1))]
    s = rbd.solve_problem(rbd.GaussProblem(np.eye(3), np.ones(3), rows), solver=rbd.KKT(), check=False)
    with pytest.raises(NoSolution):
        s.with_forces()
    assert s.settled() is s and s.force_choice == "as KKT left it"


def test_rows_without_corners_count_with_their_own_forces():
    """Two parallel rows in other units share a load of 6: least f1^2 + f2^2 with f1 + 2 f2 = 6."""
    patch = Patch(np.zeros(3), np.eye(3), np.zeros((1, 3)), None)
    rows = [
        Rows("plain", np.array([[1.0]]), np.zeros(1), rbd.problem.NonNegative(1)),
        Rows(
            "toe",
            np.array([[2.0]]),
            np.zeros(1),
            rbd.problem.NonNegative(1),
            resultant=np.array([[0.0], [0.0], [1.0]]),
            patch=patch,
        ),
    ]
    s = rbd.solve_problem(rbd.GaussProblem(np.eye(1), np.array([-6.0]), rows)).with_forces()
    assert s.multipliers == pytest.approx([1.2, 2.4], abs=1e-12) and s.corner_forces.keys() == {"toe"}
    dear = s.with_forces({"plain": 4.0})  # least 4 f1^2 + f2^2: f1 = 6/17
    assert dear.multipliers == pytest.approx([6 / 17, 48 / 17], abs=1e-12)


def test_minimum_norm_gives_arrays(noisy):
    """The plain function: row forces and the law's weights, which add up to them."""
    for s in noisy[:3]:
        f, w = minimum_norm(s.problem, s.a, s.multipliers, s.weights, s.law)
        G = s.problem.force_set.pyramids.G if s.law.facets else s.problem.force_set.G
        assert f == pytest.approx(s.multipliers, abs=1e-9) and G @ w == pytest.approx(f, abs=1e-9)


@pytest.mark.parametrize("facets", [3, 4, 5, 8, 16])
def test_ray_weights_add_up_and_are_not_negative_inside(facets, rng):
    """Of forces made of random rays: the weights found make the same force and are not negative."""
    rays = pyramid(0.7, facets)
    for _ in range(200):
        w = rng.exponential(size=facets) * (rng.random(facets) < 0.5)
        found = ray_weights(rays @ w, 0.7, facets)
        assert rays @ found == pytest.approx(rays @ w, abs=1e-12) and found.min() > -1e-12
    outside = np.array([5.0, 0.0, 1.0])
    assert ray_weights(outside, 0.7, facets).min() < 0.0


def test_solvers_agree_on_forces_that_are_not_unique(talos):
    """24 held rows of rank 12, and legs that push: KKT and ProxQP return the same forces without being asked."""
    corners = [
        rbd.PointContact(f"{sole.name} {i}", sole.frame, offset=sole.placement.act(c))
        for sole in talos.soles()
        for i, c in enumerate(sole.corners)
    ]
    state, tau = talos.standing(), np.random.default_rng(8).normal(size=talos.nu)
    one, other = (rbd.solve(state, tau, corners, solver=solver) for solver in (rbd.KKT(), rbd.ProxQP()))
    assert one.rank == 12 and one.force_choice == other.force_choice == CHOSEN
    assert other.multipliers == pytest.approx(one.multipliers, abs=1e-9 * np.abs(one.multipliers).max())
    s = table((0.45, 0.2), 0.5)
    assert s.force_choice == CHOSEN and normals(s) == pytest.approx([250, 100, 50, 0], abs=400e-10)


def test_nothing_is_chosen_before_it_is_asked_for(talos):
    """Independent rows: the answer carries no set of forces until corner forces are wanted."""
    s = rbd.solve(talos.standing(), np.zeros(talos.nu), talos.soles(0.7))
    assert "_admissible" not in vars(s) and s.forces and "_admissible" not in vars(s)
    assert s.corner_forces and "_admissible" in vars(s)


class TestLeastDistance:
    """|H z + c| is least with A z >= b: the plain function behind bounds and pyramids."""

    def test_where_no_row_is_felt_it_is_least_squares(self):
        """The free minimum lies inside: z = -c."""
        z = _least_distance(np.eye(2), np.array([-1.0, -2.0]), np.eye(2), np.zeros(2))
        assert z == pytest.approx([1.0, 2.0], abs=1e-14)

    def test_rows_that_contradict_each_other_have_no_nearest_point(self):
        """At least 1, and at most -1."""
        assert _least_distance(np.eye(1), np.zeros(1), np.array([[1.0], [-1.0]]), np.ones(2)) is None

    @pytest.mark.parametrize("wedge", [False, True], ids=["open", "wedge"])
    def test_what_is_found_is_the_nearest_or_it_is_not_found(self, wedge):
        """Fifteen planes about a point: the nearest is in none of them, and pushed to where it is by those that it touches.

        Where two planes are nearly opposite, at 1e-5 to 1e-8 rad, digits do not always suffice; then None is said.
        """
        missed = 0
        for seed in range(300):
            rng = np.random.default_rng(seed)
            A, c = rng.normal(size=(15, 5)), rng.normal(size=5)
            if wedge:
                A[-1] = -A[0] + 10.0 ** rng.uniform(-8, -5) * rng.normal(size=5)
            A /= np.linalg.norm(A, axis=1)[:, None]
            point = rng.normal(size=5) * 10.0 ** rng.uniform(0, 3 if wedge else 2)
            b = A @ point - rng.uniform(size=15) * (rng.random(15) < 0.5)
            z = _least_distance(np.eye(5), c, A, b)
            if z is None:
                missed += 1
                continue
            size = max(1.0, float(np.abs(z).max()))
            touched = A @ z - b <= 1e-9 * size
            assert (b - A @ z).max() <= 1e-9 * size
            push = A[touched].T
            left = nnls(push, z + c)[1] if touched.any() else np.linalg.norm(z + c)
            assert left <= 1e-9 * size  # z + c is a sum of the planes' pushes: nothing nearer
        assert missed <= (30 if wedge else 0)


def many_legs(friction) -> rbd.Solution:
    """A table whose weight stands near one leg."""
    return table((0.45, 0.2), friction)


class TestOtherWays:
    """Each way to the shortest forces gives what the others give, or says that there was none."""

    @pytest.mark.parametrize("friction", [0.0, 0.5])
    def test_the_dual_and_the_barrier_stand_in_for_the_active_set(self, monkeypatch, friction):
        """Over bounds and pyramids, where nonnegative least squares gives up: the same loads, 250, 100, 50 and 0 N."""
        s = many_legs(friction)
        monkeypatch.setattr("rbd.answers.analysis.force_choice.least_distance", lambda *_: None)
        assert normals(s.with_forces()) == pytest.approx([250, 100, 50, 0], abs=1e-6)
        monkeypatch.setattr("rbd.answers.analysis.force_choice.by_dual", lambda *_: None)
        assert normals(s.with_forces()) == pytest.approx([250, 100, 50, 0], abs=1e-5)

    def test_without_the_dimension_of_the_set_nothing_is_chosen(self, monkeypatch):
        """No linear program, and no dual: the forces stay as they were, and say so."""
        s = many_legs(0.5)
        monkeypatch.setattr("rbd.answers.analysis.force_choice._least_distance", lambda *_: None)
        monkeypatch.setattr("rbd.answers.analysis.force_choice.by_dual", lambda *_: None)
        monkeypatch.setattr("rbd.problem.programs.PROGRAM_PIVOTS", 0)
        monkeypatch.setattr("rbd.problem.programs.PROGRAM_SECONDS", 0.0)
        kept = s.with_forces()
        assert kept.force_choice == "as ProxQP left it" and np.array_equal(kept.multipliers, s.multipliers)

    def test_where_cones_leave_one_point_it_is_the_answer(self, monkeypatch):
        """Two feet in line, pushed with mu m g: each rubs with mu N at the edge of its cone, N by moments about the other."""
        places = {"front": 0.2, "back": -0.2}
        feet = [rbd.PointContact(name, "box", offset=(x, 0.0, -0.1), friction=0.6) for name, x in places.items()]
        state, push = rbd.State(box(), np.array([0, 0, 0.1, 0, 0, 0, 1.0])), 0.6 * 98.1
        force = rbd.ExternalForce("box", (push, 0.0, 0.0))
        s = rbd.solve(state, np.zeros(0), feet, external=force, solver=rbd.ConeSolver(law="coulomb"))
        monkeypatch.setattr("rbd.answers.analysis.force_choice.by_dual", lambda *_: None)
        for name, sign in (("front", 1.0), ("back", -1.0)):
            N = 0.5 * 98.1 + sign * push * 0.1 / 0.4
            assert s.with_forces().forces[name] == pytest.approx([-0.6 * N, 0.0, N], abs=1e-6)


def test_weights_that_are_not_given_are_any_that_make_the_force(noisy):
    """Of soles that stick all weights are lawful, and the forces those of least norm; of corners that slip only some are."""
    sticks = noisy[0]
    f, w = minimum_norm(sticks.problem, sticks.a, sticks.multipliers, None, sticks.law)
    assert f == pytest.approx(sticks.multipliers, abs=1e-9) and sticks.problem.force_set.pyramids.G @ w == pytest.approx(
        f, abs=1e-9
    )
    slips = replace(noisy[8], weights=None)
    assert noisy[8].status is rbd.problem.Status.SOLVED and slips.status is rbd.problem.Status.FAILED
    with pytest.raises(NoSolution):
        slips.with_forces()


def test_rays_without_friction_are_all_one():
    """Of mu = 0 the four rays are the normal, one half-line; two cones side by side share a load of 6 evenly."""
    rows = [Rows(name, np.eye(3), np.zeros(3), rbd.problem.FrictionCone(0.0)) for name in ("one", "two")]
    P = rbd.GaussProblem(np.eye(3), np.array([0.0, 0.0, -6.0]), rows)
    f, weights = np.array([0, 0, 6.0, 0, 0, 0]), np.array([6.0, 0.0])
    f, w = minimum_norm(P, np.zeros(3), f, weights, Law("convex", (4,)))
    assert f == pytest.approx([0, 0, 3, 0, 0, 3], abs=1e-12) and P.force_set.pyramids.G @ w == pytest.approx(f, abs=1e-12)
    assert ray_weights(np.array([0.0, 0.0, 2.0]), 0.0, 4) == pytest.approx(np.full(4, 0.5))
