"""What is unique of the forces and how far the rest can go: closed forms, linear programs over rays, random forces."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

import rbd
from rbd.answers.analysis.extent import Reach
from rbd.errors import NoSolution
from rbd.problem.cones import pyramid
from rbd.problem.programs import Work
from rbd.problem.rows import Rows
from rbd.testing import box

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.EffortLimitWarning")  # noise on small motors

G = 9.81
URDF = Path(__file__).parents[2] / "urdf"
SOLVERS = [rbd.ProxQP(), rbd.ConeSolver(law="coulomb"), rbd.ConeSolver(law="convex")]
LEGS = {"++": (0.6, 0.4), "+-": (0.6, -0.4), "-+": (-0.6, 0.4), "--": (-0.6, -0.4)}


def at(robot, height: float) -> rbd.State:
    """A free body, level, its frame at a height."""
    return rbd.State(robot, np.array([0.0, 0.0, height, 0.0, 0.0, 0.0, 1.0]))


def table(com, friction, solver) -> rbd.Solution:
    """Legs at (+-0.6, +-0.4) m, weight 400 N, at rest."""
    legs = [
        rbd.PointContact(name, "box", offset=(x - com[0], y - com[1], -0.7), friction=friction) for name, (x, y) in LEGS.items()
    ]
    return rbd.solve(at(box(400.0 / G, (1.2, 0.8, 0.1)), 0.7), np.zeros(0), legs, solver=solver)


def patch(x: float = 0.0, half: float = 0.2, friction: float | None = 0.6, name: str = "floor", depth: float = 0.1):
    """A sole under a box."""
    X = np.eye(4)
    X[:3, 3] = x, 0.0, -depth
    return rbd.SurfaceContact(name, "box", half_lengths=(half, 0.2), placement=X, friction=friction)


def pushed(contacts, force=(0.0, 0.0, 0.0), solver=SOLVERS[0], robot=None, height=0.1) -> rbd.Solution:
    """A 10 kg box of 0.4 x 0.4 x 0.2 m, or another, pushed at its centre."""
    state = at(box() if robot is None else robot, height)
    return rbd.solve(state, np.zeros(0), contacts, external=rbd.ExternalForce("box", force), solver=solver)


def ends(r) -> tuple[float, float]:
    """Both ends of a range."""
    return r.lowest, r.highest


def all_ranges(u: rbd.answers.analysis.Uniqueness) -> list:
    """Every range of an answer, with the constraint it belongs to and what to look at in the forces."""
    found = []
    for name, c in u.contacts.items():
        found.append((c.normal, name, None))
        found += [(r, name, i) for i, r in enumerate(c.corners)]
    return found


@pytest.mark.parametrize("solver", SOLVERS, ids=["pyramids", "coulomb", "convex"])
@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize(("com", "f0"), [((0.15, -0.1), (100, 150, 50, 100)), ((0.45, 0.2), (225, 125, 75, -25))])
def test_the_legs_of_a_table(com, f0, friction, solver):
    """Closed form: f0 + t (1, -1, -1, 1) with all legs >= 0; the ends are where a leg carries nothing."""
    u = table(com, friction, solver).uniqueness()
    f0, n = np.array(f0, float), np.array([1.0, -1.0, -1.0, 1.0])
    t = np.array([(-f0[n > 0]).max(), f0[n < 0].min()])
    for i, c in enumerate(u.contacts.values()):
        expected = np.sort(f0[i] + t * n[i])
        assert ends(c.normal) == pytest.approx(expected, abs=400e-9)
        assert ends(c.share) == pytest.approx(expected / 400.0, abs=1e-9)
        assert not c.unique_normal and not c.unique_wrench and c.normal.lowest <= c.normal.value <= c.normal.highest
    assert (u.rank, u.active_rank) == ((3, 3) if friction == 0.0 else (6, 6))
    assert (u.row_freedom, u.corner_freedom) == ((1, 1) if friction == 0.0 else (6, 6)) and u.exact


@pytest.mark.parametrize("solver", SOLVERS, ids=["pyramids", "coulomb", "convex"])
def test_two_feet_share_a_box_between_a_third_and_two_thirds(solver):
    """Soles from 0.1 to 0.2 m on each side: s p_left + (1 - s) p_right = 0 with the centres of pressure on them."""
    u = pushed([patch(-0.15, 0.05, name="left"), patch(0.15, 0.05, name="right")], solver=solver).uniqueness()
    for c in u.contacts.values():
        assert ends(c.share) == pytest.approx((1 / 3, 2 / 3), abs=1e-9)
        assert ends(c.normal) == pytest.approx((98.1 / 3, 98.1 * 2 / 3), abs=98.1e-9)
        assert not c.unique_wrench and c.unique_centre_of_pressure is False


def test_a_sole_knows_its_centre_of_pressure_but_not_its_corners(talos):
    """Talos, rank 12 of 12: each wrench follows from the torques; the corners' normals n + t (1, -1, 1, -1) do not."""
    state, soles = talos.standing(), talos.soles(0.5)
    tau = rbd.hold(state, soles).tau
    for solver in SOLVERS:
        s = rbd.solve(state, tau, soles, solver=solver)
        u = s.uniqueness()
        assert u.rank == u.active_rank == 12 and (u.row_freedom, u.corner_freedom) == (0, 12)
        for rows in s.problem.rows:
            c, wrench = u.contacts[rows.name], s.multipliers[s.problem.slices[rows.name]]
            assert c.unique_wrench and c.unique_normal and c.unique_centre_of_pressure and c.share.unique
            assert c.normal.value == pytest.approx(s.contacts[rows.name].normal, abs=1e-9)
            xy, sign = rows.patch.corners[:, :2], np.array([1.0, -1.0, 1.0, -1.0])
            carries = np.column_stack([np.ones(4), xy[:, 1], -xy[:, 0]])  # force, moments about x and y
            n = np.linalg.lstsq(carries.T, wrench[[2, 3, 4]], rcond=None)[0]
            t = np.array([(-n[sign > 0]).max(), n[sign < 0].min()])
            for i, corner in enumerate(c.corners):
                assert ends(corner) == pytest.approx(np.sort(n[i] + t * sign[i]), abs=1e-9 * 448.0) and not corner.unique


def test_locked_joints_leave_the_feet_their_choice(talos):
    """A rigid robot: its share on a foot is s with s p_left + (1 - s) p_right under the centre of mass, p on the soles."""
    state, soles = talos.standing(), talos.soles(0.5)
    tau = rbd.hold(state, soles).tau
    brakes = [rbd.JointLock(f"brake of {joint}", joint) for joint in talos.actuated_names]
    s = rbd.solve(state, tau, [*soles, *brakes])
    u = s.uniqueness()
    left, right = ((r.patch.point + r.patch.corners @ r.patch.axes.T)[:, 1] for r in (s.problem.rows[0], s.problem.rows[1]))
    y = state.com[1]
    lowest = (y - right.max()) / (left.max() - right.max())
    highest = (y - right.min()) / (left.min() - right.min())
    assert ends(u.contacts["left_sole"].share) == pytest.approx((lowest, highest), abs=1e-8)
    assert ends(u.contacts["right_sole"].share) == pytest.approx((1 - highest, 1 - lowest), abs=1e-8)
    assert u.rows == 44 and u.rank == 38 and u.row_freedom == 6 and set(u.others) == {b.name for b in brakes}
    assert not u.others["brake of leg_left_4_joint"][0].unique


@pytest.mark.parametrize("solver", SOLVERS, ids=["pyramids", "coulomb", "convex"])
def test_a_ladder_between_rough_walls(solver):
    """Moments about the foot: N_wall = m g / 2 / (tan th + F/N), |F/N| <= 0.3 at the wall: from 24.1 to 34.3 N at 60 deg."""
    angle = np.pi / 3
    robot = rbd.load_robot(URDF / "ladder.urdf")
    feet = [
        rbd.PointContact("floor", "ladder", offset=(-1.0, 0.0, 0.0), friction=0.4),
        rbd.PointContact("wall", "ladder", offset=(1.0, 0.0, 0.0), on=rbd.Ground(normal=(-1.0, 0.0, 0.0)), friction=0.3),
    ]
    q = np.array([-np.cos(angle), 0.0, np.sin(angle), 0.0, -np.sin(angle / 2), 0.0, np.cos(angle / 2)])
    u = rbd.solve(rbd.State(robot, q), np.zeros(0), feet, solver=solver).uniqueness()
    wall = [49.05 / (np.tan(angle) + k) for k in (0.3, -0.3)]
    floor = [98.1 - 0.3 * wall[0], 98.1 + 0.3 * wall[1]]
    assert ends(u.contacts["wall"].normal) == pytest.approx(wall, abs=98.1e-9)
    assert ends(u.contacts["floor"].normal) == pytest.approx(floor, abs=98.1e-9)
    assert ends(u.contacts["floor"].share) == pytest.approx([f / 98.1 for f in floor], abs=1e-9)
    assert u.row_freedom == u.corner_freedom == 1


def funnel(solver) -> rbd.Solution:
    """A box on three points of a funnel, 50 degrees steep, mu = 0.4: internal forces that friction alone bounds."""
    steep, contacts = np.deg2rad(50.0), []
    for name, turn in (("a", 0.0), ("b", 1.9), ("c", 4.3)):
        out = np.array([np.cos(turn), np.sin(turn), 0.0])
        normal = np.array([0.0, 0.0, np.cos(steep)]) - np.sin(steep) * out
        contacts.append(rbd.PointContact(name, "box", offset=0.15 * out, on=rbd.Ground(normal=normal), friction=0.4))
    return pushed(contacts, solver=solver)


def _highest_by_rays(s, name, facets, inscribed) -> float:
    """Largest normal force of a point over pyramids in place of the cones, by a linear program over their rays."""
    P = s.problem
    rays = np.kron(np.eye(3), pyramid(0.4, facets, inscribed=inscribed))
    U, sv, _ = np.linalg.svd(P.J.T)
    basis = U[:, : int((sv > 1e-9 * sv[0]).sum())]
    normal = rays[P.slices[name]][2]
    b = basis.T @ (P.J.T @ s.multipliers)
    found = linprog(-normal, A_eq=basis.T @ P.J.T @ rays, b_eq=b, bounds=(0.0, None), method="highs")
    assert found.status == 0
    return -found.fun


def test_circular_cones_lie_between_pyramids_inside_and_around_them():
    """On a funnel: 128 rays from inside and outside are close, and four facets admit more."""
    s = funnel(rbd.ConeSolver(law="coulomb"))
    assert np.abs(s.a).max() < 1e-8
    four = []
    for name, c in s.uniqueness().contacts.items():
        inner, outer = (_highest_by_rays(s, name, 128, inscribed) for inscribed in (True, False))
        assert inner - 1e-7 <= c.normal.highest <= outer + 1e-7 and outer - inner < 0.01 * outer
        four.append(_highest_by_rays(s, name, 4, False) - c.normal.highest)
    assert min(four) > -1e-7 and max(four) > 1.0


def _walk(s, steps: int, rng):
    """Random forces by hit and run in the null space of J^T G, circular cones; yields weights."""
    P = s.problem
    T = P.force_set
    A = P.J.T @ T.G
    _, sv, Vt = np.linalg.svd(A)
    N = Vt[int((sv > 1e-9 * sv[0]).sum()) :].T
    mu = T.mu
    w = s.with_forces().weights.copy()
    for _ in range(steps):
        d = N @ rng.normal(size=N.shape[1])
        d /= np.linalg.norm(d)
        u, e = w.reshape(-1, 3), d.reshape(-1, 3)
        # |u_t + k e_t|^2 <= mu^2 (u_n + k e_n)^2
        a = (e[:, :2] ** 2).sum(axis=1) - (mu * e[:, 2]) ** 2
        b = 2 * ((u[:, :2] * e[:, :2]).sum(axis=1) - mu**2 * u[:, 2] * e[:, 2])
        c = (u[:, :2] ** 2).sum(axis=1) - (mu * u[:, 2]) ** 2
        low, high = -np.inf, np.inf
        for i in range(len(mu)):
            roots = np.roots([a[i], b[i], c[i]])
            roots = np.append(roots[np.abs(roots.imag) < 1e-12].real, -u[i, 2] / e[i, 2])
            for k in roots:
                side = u[i, 2] + k * e[i, 2]
                if side < -1e-9:
                    continue
                low, high = (max(low, k), high) if k <= 0.0 else (low, min(high, k))
        far = low if -low > high else high  # to the far end every other time: corners are rarely hit else
        new = w + 0.999999 * (far if rng.random() < 0.5 else rng.uniform(low, high)) * d
        # From a point on an edge rounding can miss a double root, and the step goes through the cone.
        if (np.hypot(new[::3], new[1::3]) <= mu * new[2::3] + 1e-9).all():
            w = new
        yield w


@pytest.mark.parametrize("contacts", ["funnel", "legs", "sole"])
def test_random_forces_stay_inside_and_nearly_reach_the_ends(contacts, rng, exhaustive):
    """Hit and run over all forces with the same motion: never beyond an end, and within 15 % of the width from each."""
    if contacts == "funnel":
        s = funnel(rbd.ConeSolver(law="coulomb"))
    elif contacts == "legs":
        s = table((0.15, -0.1), 0.5, rbd.ConeSolver(law="coulomb"))
    else:
        s = pushed([patch()], (20.0, 5.0, 0.0), rbd.ConeSolver(law="coulomb"))
    u = s.uniqueness()
    ranges = [r for c in u.contacts.values() for r in c.corners]
    seen = np.array([w[2::3] for w in _walk(s, 6000 if exhaustive else 3000, rng)])
    assert np.abs(s.problem.J.T @ (s.problem.force_set.G @ next(_walk(s, 1, rng)) - s.multipliers)).max() < 1e-9
    for normal, r in zip(seen.T, ranges, strict=True):
        width = r.highest - r.lowest
        assert normal.min() >= r.lowest - 1e-6 and normal.max() <= r.highest + 1e-6
        assert normal.min() <= r.lowest + 0.15 * width and normal.max() >= r.highest - 0.15 * width


@pytest.mark.parametrize("solver", SOLVERS, ids=["pyramids", "coulomb", "convex"])
def test_the_ends_are_attained_by_forces_with_a_certificate(talos, solver):
    """Each end comes with forces that have it, and as a solution they are solved: sticking, slipping and opening corners."""
    rng = np.random.default_rng(6)
    state, soles = talos.standing(), talos.soles(0.5)
    tau = rbd.hold(state, soles).tau
    cases = [rbd.solve(state, tau + size * rng.normal(size=talos.nu), soles, solver=solver) for size in (0.0, 15.0)]
    cases += [pushed([patch(-0.15, 0.05, name="left"), patch(0.15, 0.05, name="right")], (15.0, 0.0, 0.0), solver)]
    tried = 0
    for s in cases:
        for r, name, corner in all_ranges(s.uniqueness()):
            normal = next(rows.patch.axes[:, 2] for rows in s.problem.rows if rows.name == name)
            for value, forces in ((r.lowest, r.at_lowest), (r.highest, r.at_highest)):
                there = replace(s, multipliers=forces.multipliers, weights=forces.weights, chosen_corners=forces.corner_forces)
                assert there.status == "solved"
                found = forces.corner_forces[name] @ normal
                assert (found.sum() if corner is None else found[corner]) == pytest.approx(value, abs=1e-6)
                net = forces.corner_forces[name].sum(axis=0)
                assert net == pytest.approx(there.forces[name][:3], abs=1e-8)
                tried += 1
    assert tried == 60


@pytest.mark.parametrize("solver", SOLVERS, ids=["pyramids", "coulomb", "convex"])
def test_two_walls_may_squeeze_as_hard_as_they_like(solver):
    """Opposed rough walls: no largest force, and the table says inf; on the smooth floor between them it is all unique."""
    walls = [
        rbd.PointContact(name, "box", offset=(x, 0.0, 0.0), on=rbd.Ground(normal=(-np.sign(x), 0.0, 0.0)), friction=0.0)
        for name, x in (("a", -0.2), ("b", 0.2))
    ]
    u = pushed([*walls, patch(friction=0.6)], (30.0, 0.0, 0.0), solver).uniqueness()
    for name, lowest in (("a", 0.0), ("b", 0.0)):
        r = u.contacts[name].normal
        assert r.highest == np.inf and r.at_highest is None and r.lowest == pytest.approx(lowest, abs=1e-6)
    assert "inf" in str(u) and "unbounded" in str(u)
    assert u.contacts["floor"].unique_normal and u.contacts["floor"].normal.value == pytest.approx(98.1, abs=1e-9)
    assert u.contacts["a"].share.unique and u.contacts["a"].share.value == 0.0


def test_held_contacts_pull_without_end_unless_they_are_unique():
    """Two held feet: rank 6 of 12, no end in any direction; one held foot: its wrench is unique, its corners are not."""
    two = pushed([patch(-0.15, 0.05, None, "left"), patch(0.15, 0.05, None, "right")]).uniqueness()
    for c in two.contacts.values():
        assert ends(c.normal) == (-np.inf, np.inf) and not c.unique_wrench
    assert (two.row_freedom, two.corner_freedom) == (6, 18)
    one = pushed([patch(friction=None)]).uniqueness().contacts["floor"]
    assert one.unique_wrench and one.unique_centre_of_pressure and one.normal.value == pytest.approx(98.1)
    assert all(ends(corner) == (-np.inf, np.inf) for corner in one.corners)


def test_what_slips_keeps_fewer_choices():
    """80 N against mu = 0.6: each corner force lies on one edge, so four normals with three equations remain."""
    s = pushed([patch()], (80.0, 0.0, 0.0), rbd.ConeSolver(law="coulomb"))
    u = s.uniqueness()
    assert s.a[0] == pytest.approx(2.114) and (u.row_freedom, u.corner_freedom, u.active_rank) == (0, 1, 3)
    # Moments about the front edge: the push acts 0.1 m above the floor, at the centre of mass.
    front = 0.5 * 98.1 + 0.1 * 0.6 * 98.1 / 0.4
    at_front = [i for i, c in enumerate(s.problem.rows[0].patch.corners) if c[0] > 0]
    for i in at_front:
        assert u.contacts["floor"].corners[i].highest == pytest.approx(min(front, 0.5 * 98.1), abs=1e-7)


@pytest.mark.parametrize("solver", SOLVERS, ids=["pyramids", "coulomb", "convex"])
def test_at_the_point_of_tipping_little_is_left_to_choose(solver):
    """Pushed with m g b / 2 h the rear corners carry nothing: two front corners, 0 to half the weight each."""
    u = pushed(
        [patch(friction=0.8, depth=0.5)], (78.48, 0.0, 0.0), solver, box(20.0, (0.4, 0.4, 1.0)), height=0.5
    ).uniqueness()  # fmt: skip
    c = u.contacts["floor"]
    assert c.unique_wrench and u.corner_freedom == 1  # the front corners may press along the edge, against each other
    for corner, normal in zip(c.corners, (98.1, 98.1, 0.0, 0.0), strict=True):
        assert ends(corner) == pytest.approx((normal, normal), abs=1e-4)


def test_at_the_limit_of_friction_the_ends_are_exact():
    """Pushed with mu m g, all corners rub as hard as they can: n + t (1, -1, 1, -1)."""
    s = pushed([patch()], (0.6 * 98.1, 0.0, 0.0), rbd.ConeSolver(law="coulomb"))
    u = s.uniqueness()
    shift = 0.1 * 0.6 * 98.1 / 0.4 / 2  # the push acts 0.1 m above the floor
    for corner, x in zip(u.contacts["floor"].corners, s.problem.rows[0].patch.corners[:, 0], strict=True):
        n, t = 98.1 / 4 + np.sign(x) * shift, 98.1 / 4 - shift
        assert ends(corner) == pytest.approx((n - t, n + t), abs=1e-8)
    assert u.exact and u.found


def test_a_box_that_flies_has_nothing_to_choose():
    """No force, no share, no centre of pressure; all unique."""
    for solver in SOLVERS:
        u = pushed([patch()], (0.0, 0.0, 200.0), solver).uniqueness()
        c = u.contacts["floor"]
        assert c.unique_wrench and c.share is None and c.unique_centre_of_pressure is None
        assert (u.row_freedom, u.corner_freedom, u.active_rank) == (0, 0, 0) and c.normal.value == 0.0
    assert pushed([], (0.0, 0.0, 200.0)).uniqueness().contacts == {}


@pytest.mark.parametrize("solver", SOLVERS, ids=["pyramids", "coulomb", "convex"])
def test_two_edges_know_their_loads_but_not_where_they_carry(solver):
    """A box on two parallel edges, pushed across them at height 0.1: loads m g / 2 -+ 20 x 0.1 / 0.4; ends trade theirs."""
    edges = []
    for name, x in (("rear", -0.2), ("front", 0.2)):
        X = np.array([[0.0, -1.0, 0.0, x], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, -0.1], [0.0, 0.0, 0.0, 1.0]])
        edges.append(rbd.LineContact(name, "box", half_length=0.2, placement=X, friction=0.6))
    u = pushed(edges, (20.0, 0.0, 0.0), solver).uniqueness()
    for name, load in (("rear", 44.05), ("front", 54.05)):
        c = u.contacts[name]
        assert c.normal.value == pytest.approx(load, abs=1e-7) and c.unique_normal
        assert not c.unique_wrench and c.unique_centre_of_pressure is False
        for end in c.corners:  # what one end of the rear edge sheds, the same end of the front one takes
            assert ends(end) == pytest.approx((load / 2 - 44.05 / 2, load / 2 + 44.05 / 2), abs=1e-7)


def test_rows_that_are_no_contacts_have_ranges_too():
    """Two stops share a push of 6 N: 0 to 6 each; a bounded one up to its bound."""
    one = np.ones((1, 1))
    rows = [
        Rows("stop", one, np.zeros(1), rbd.problem.NonNegative(1)),
        Rows("rub", one, np.zeros(1), rbd.problem.Bounds(-2.0, 2.0)),
    ]
    s = rbd.solve_problem(rbd.GaussProblem(one, np.array([-6.0]), rows))
    u = s.uniqueness()
    assert ends(u.others["stop"][0]) == pytest.approx((4.0, 8.0), abs=1e-9)
    assert ends(u.others["rub"][0]) == pytest.approx((-2.0, 2.0), abs=1e-9)
    assert u.others["stop"][0].at_highest.multipliers == pytest.approx([8.0, -2.0], abs=1e-9)
    slips = rbd.solve_problem(rbd.GaussProblem(one, np.array([6.0]), rows)).uniqueness()
    assert slips.others["rub"][0].unique and slips.others["rub"][0].value == pytest.approx(-2.0)
    assert slips.row_freedom == 0 and "rub" in str(slips)


def test_what_already_slides_has_one_force():
    """A box that slides at 1 m/s: friction against the motion; its corners share the load along one line."""
    state = at(box(), 0.1).with_velocity(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]))
    s = rbd.solve(state, np.zeros(0), [patch()], solver=rbd.ConeSolver(law="coulomb"))
    u = s.uniqueness()
    assert s.a[0] == pytest.approx(-0.6 * G) and u.corner_freedom == 1 and u.contacts["floor"].unique_wrench


def test_the_table_has_a_line_for_each_contact():
    """Law, ranks, internal forces; then the contacts."""
    u = table((0.15, -0.1), 0.0, rbd.ProxQP()).uniqueness()
    lines = str(u).splitlines()
    assert "law: convex; 4 rows of rank 3" in lines[0] and "1 of the rows, 1 of the corners" in lines[1]
    assert [line.split()[0] for line in lines[3:]] == list(LEGS)
    assert "100.00 .. 250.00" in lines[4] and "25.0 .. 62.5 %" in lines[4] and "1 internal" in repr(u)


def test_what_is_no_answer_has_no_uniqueness():
    """Rows that contradict each other."""
    e = np.eye(3)[:1]
    rows = [Rows("one", e, np.zeros(1), rbd.problem.Free(1)), Rows("two", e, np.ones(1), rbd.problem.Free(1))]
    with pytest.raises(NoSolution, match="no answer, and its uniqueness"):
        rbd.solve_problem(rbd.GaussProblem(np.eye(3), np.ones(3), rows), solver=rbd.KKT(), check=False).uniqueness()


def test_a_contact_that_happens_to_carry_nothing_is_judged_where_it_carries():
    """Two soles in one place, all load on the first: the second could take it, anywhere within the sole."""
    s = pushed([patch(name="one"), patch(name="other")], solver=rbd.ConeSolver(law="coulomb"))
    idle = s.uniqueness().contacts["other"].normal.at_lowest
    assert idle is not None
    one_carries = replace(s, multipliers=idle.multipliers, weights=idle.weights, chosen_corners=None)
    other = one_carries.uniqueness().contacts["other"]
    assert abs(other.normal.value) < 1e-7 and ends(other.normal) == pytest.approx((0.0, 98.1), abs=1e-7)
    assert other.unique_centre_of_pressure is False


def test_walls_that_carry_nothing_but_could_have_no_one_centre_of_pressure():
    """Opposed smooth walls of four corners each, unpushed: they may squeeze without end, wherever they like."""
    walls = []
    for name, side in (("a", -1.0), ("b", 1.0)):
        X = np.eye(4)
        X[:3, :3] = np.array([[0.0, 0.0, -side], [0.0, 1.0, 0.0], [side, 0.0, 0.0]])
        X[:3, 3] = side * 0.2, 0.0, 0.0
        walls.append(rbd.SurfaceContact(name, "box", half_lengths=(0.05, 0.1), placement=X, friction=0.0))
    u = pushed([*walls, patch(friction=0.6)], solver=rbd.ConeSolver(law="coulomb")).uniqueness()
    for name in ("a", "b"):
        c = u.contacts[name]
        assert abs(c.normal.value) < 1e-9 and c.normal.highest == np.inf and c.unique_centre_of_pressure is False


def test_what_every_choice_agrees_on_is_reached_as_it_is():
    """The weight of a box is carried whatever its corners do: its largest value is its value; a corner's is not."""
    adm = pushed([patch()], solver=rbd.ConeSolver(law="coulomb"))._admissible
    reach = Reach(adm, Work(1e12))
    weight = np.tile([0.0, 0.0, 1.0], 4) @ adm.corners
    found = reach.largest(weight)
    assert found.value == pytest.approx(98.1, abs=1e-9) and np.array_equal(found.x, adm.start)
    assert reach.largest(np.eye(12)[2] @ adm.corners).value == pytest.approx(49.05, abs=1e-7)
