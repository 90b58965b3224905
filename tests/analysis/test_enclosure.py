"""Intervals that contain the exact answer: against rational numbers, fifty digits and closed forms; and what is refused."""

from __future__ import annotations

import copy
import pickle
import time
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import mpmath
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.active_set import ActiveSet
from rbd.answers.analysis.enclosure import NEARBY, OF_MODES, ONLY, SHARED
from rbd.errors import NotDifferentiable, NotEnclosed
from rbd.intervals import Intervals, U
from rbd.problem import Bounds, FrictionCone

URDF = Path(__file__).parents[2] / "urdf"
G = 9.81
POINT = rbd.Rows("p", np.eye(3), np.zeros(3), FrictionCone(0.5))


def box_at(robot: rbd.Robot, position, pitch: float = 0.0, speed: float = 0.0) -> rbd.State:
    """A free body with its x axis raised by `pitch`, which moves along it."""
    q = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array([0.0, -pitch, 0.0])), np.asarray(position, float)))
    return rbd.State(robot, q, [speed, 0.0, 0.0, 0.0, 0.0, 0.0])


def sole(frame: str, depth: float, friction: float | None) -> rbd.SurfaceContact:
    """A square under a box."""
    X = pin.SE3(np.eye(3), np.array([0.0, 0.0, -depth]))
    return rbd.SurfaceContact("floor", frame, half_lengths=(0.2, 0.2), placement=X, friction=friction)


def exact(x: object) -> list[Fraction]:
    """Doubles as rational numbers."""
    return [Fraction(float(value)) for value in np.ravel(x)]


def holds(found: Intervals, true: list[Fraction]) -> bool:
    """Whether rational numbers lie between the ends."""
    return all(lo <= x <= hi for lo, x, hi in zip(exact(found.lower), true, exact(found.upper), strict=True))


def rational_solution(A: np.ndarray, b: np.ndarray) -> list[Fraction]:
    """Of A x = b, in whole numbers, by Bareiss's elimination without fractions."""
    rows = [[int(Fraction(float(x)) * 2**1100) for x in [*row, right]] for row, right in zip(A, b, strict=True)]
    common = min((x & -x).bit_length() - 1 for row in rows for x in row if x)
    rows = [[x >> common for x in row] for row in rows]
    n, last = len(rows), 1
    for i in range(n):
        pivot = next(k for k in range(i, n) if rows[k][i])
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for k in range(n):
            if k != i:
                rows[k] = [(rows[i][i] * x - rows[k][i] * y) // last for x, y in zip(rows[k], rows[i], strict=True)]
        last = rows[i][i]
    return [Fraction(rows[i][n], rows[i][i]) for i in range(n)]


def drawn(robot: rbd.Robot, contacts: list[rbd.PointContact], seed: int, hard: float = 1.0) -> Iterator[rbd.Solution]:
    """Random poses near standing, torques around those that hold, and pushes of a tenth of the weight; those with an answer."""
    rng = np.random.default_rng(seed)
    standing = robot.standing()
    hold, body = rbd.hold(standing, contacts).tau, robot.model.frames[robot.model.nframes // 3].name
    while True:
        q = standing.q.copy()
        q[7:] += rng.uniform(-0.1, 0.1, len(q) - 7)
        tau = hold * (1.0 + 0.1 * hard * rng.normal(size=robot.nu))
        push = rbd.ExternalForce(body, tuple(0.1 * hard * G * robot.mass * rng.normal(size=3)))
        try:
            yield rbd.solve(rbd.State(robot, q), tau, contacts, external=push)
        except rbd.RbdError:
            continue


@pytest.mark.parametrize("name", ["solo12", "talos"])
def test_the_rational_answer_of_a_robot_lies_inside(name: str, exhaustive: bool):
    """Feet or soles that stick: their equations solved in rational numbers, of doubles as they are; 30 and 50 unknowns."""
    if name == "talos" and not exhaustive:
        pytest.skip("in the exhaustive run")
    robot = rbd.load_robot(name)
    contacts = robot.feet(friction=0.7, on=None) if name == "solo12" else robot.soles(friction=0.7, on=None)
    solution = next(drawn(robot, contacts, 3))
    found, P = solution.enclosure(), solution.problem
    K = np.block([[P.M, -P.J.T], [P.J, np.zeros((P.m, P.m))]])
    true = rational_solution(K, np.concatenate([P.rhs, -P.offset]))
    assert {word for words in found.modes.values() for word in words} == {"sticks"} and found.scope == OF_MODES
    assert holds(found.a, true[: P.nv])
    for r in P.rows:  # the resultant maps the row forces, in rational numbers too
        f, R = true[P.nv :][P.slices[r.name]], r.resultant
        world = [sum((Fraction(float(x)) * y for x, y in zip(row, f, strict=True)), Fraction(0)) for row in R]
        assert holds(found.forces[r.name], world)
    assert max(found.width) < 1e-11 and all(found.unique.values()) and not found.missed


def test_of_rows_that_nearly_depend_on_each_other_the_rational_answer_lies_inside():
    """A small difference decides large forces: intervals are wider than rounding, and the answer inside."""
    J = np.array([[1.0, 0.3, 0.1], [1.0, 0.3, 0.1 + 1e-5]])
    problem = rbd.GaussProblem(
        np.array([[2.0, 0.3, 0.1], [0.3, 1.5, -0.2], [0.1, -0.2, 1.2]]), np.array([0.7, -0.3, 0.9]),
        [rbd.Rows("near", J, np.array([0.25, 0.25 + 1e-3]), rbd.problem.Free(2))],
    )  # fmt: skip
    found = rbd.solve_problem(problem).enclosure()
    true = rational_solution(
        np.block([[problem.M, -J.T], [J, np.zeros((2, 2))]]), np.concatenate([problem.rhs, -problem.offset])
    )
    assert holds(found.a, true[:3]) and holds(found.forces["near"], true[3:]) and found.scope == ONLY
    assert found.distance[1] > 1e-3 > 1e3 * found.width[1]  # the answer is solved, and its forces are that far off
    assert (found.forces["near"].rad < 1e-15 * np.abs(found.forces["near"].mid)).all() and abs(float(true[3])) > 1e5


@pytest.mark.parametrize("light", [1.0, 1e-4])
@pytest.mark.parametrize("law", ["coulomb", "convex"])
def test_a_point_that_begins_to_slip_lies_inside_with_fifty_digits(law: str, light: float):
    """Its direction is that of its acceleration, on an inertia that couples all coordinates, one of which may be light."""
    M = np.array([[2.0, 0.3, 0.1], [0.3, 1.5, -0.2], [0.1, -0.2, 1.2]]) * np.outer([1, 1, light], [1, 1, light])
    M[2, 2] *= 1.0 / light
    J, offset, mu = np.array([[1.0, 0.1, 0.0], [0.0, 1.0, 0.2], [0.1, 0.0, 1.0]]), np.array([0.1, -0.2, 0.05]), 0.4
    rhs = np.array([7.3, -5.1, -9.7])
    problem = rbd.GaussProblem(M, rhs, [rbd.Rows("point", J, offset, FrictionCone(mu))])
    solution = rbd.solve_problem(problem, law=law)
    found = solution.enclosure()
    assert found.modes == {"point": ("slips",)} and found.scope == (ONLY if law == "convex" else NEARBY)
    with mpmath.workdps(50):
        A, B, c, b = mpmath.matrix(M), mpmath.matrix(J), mpmath.matrix(offset), mpmath.matrix(rhs)

        def law_of(x, y, z, n):
            a = mpmath.matrix([x, y, z])
            u = B * a + c
            speed = mpmath.sqrt(u[0] ** 2 + u[1] ** 2)
            f = mpmath.matrix([-mpmath.mpf(mu) * n * u[0] / speed, -mpmath.mpf(mu) * n * u[1] / speed, n])
            off = A * a - b - B.T * f
            return [*off, u[2] - (mpmath.mpf(mu) * speed if law == "convex" else 0)]

        start = [*solution.a, solution.multipliers[2]]
        true = mpmath.findroot(law_of, [mpmath.mpf(float(x)) for x in start], tol=1e-80)
        for i in range(3):
            assert mpmath.mpf(float(found.a.lower[i])) <= true[i] <= mpmath.mpf(float(found.a.upper[i]))
        force = found.forces["point"]
        assert mpmath.mpf(float(force.lower[2])) <= true[3] <= mpmath.mpf(float(force.upper[2]))
    assert found.a.rad.max() < 1e-14 and force.rad.max() < 1e-14


def inside(found: Intervals, expected: np.ndarray) -> bool:
    """Whether closed forms, evaluated in doubles, are inside but for the rounding of the problem's data."""
    return bool((np.abs(found.mid - expected) <= found.rad + 200.0 * U * max(1.0, np.abs(expected).max())).all())


def test_closed_forms_lie_inside():
    """A block that sticks and slides on a slope, a box pushed, a crate that topples, a rod that falls, a ladder that stands."""
    block, angle = rbd.load_robot(URDF / "box.urdf"), 0.4
    for speed, expected in ((0.0, 0.0), (3.0, -G * (np.sin(angle) + 0.5 * np.cos(angle)))):
        found = rbd.solve(box_at(block, (0, 0, 1), angle, speed), [], [sole("box", 0.1, 0.5)]).enclosure()
        assert inside(found.a, np.array([expected, 0, 0, 0, 0, 0]))
        assert set(found.modes["floor"]) == ({"slides"} if speed else {"sticks"})
    push = rbd.ExternalForce("box", (80.0, 0.0, 0.0))
    N = (10 * G + 0.6 * 80.0) / 1.36
    for law, a in (("coulomb", [8 - 0.6 * G, 0, 0]), ("convex", [(80 - 0.6 * N) / 10, 0, (N - 10 * G) / 10])):
        point = rbd.PointContact("point", "box", friction=0.6)
        found = rbd.solve(box_at(block, (0, 0, 0)), [], [point], external=push, law=law).enclosure()
        assert inside(found.a, np.array([*a, 0, 0, 0]))
    crate = rbd.load_robot(URDF / "crate.urdf")
    push = rbd.ExternalForce("crate", (120.0, 0.0, 0.0))
    found = rbd.solve(box_at(crate, (0, 0, 0.5)), [], [sole("crate", 0.5, 0.8)], external=push).enclosure()
    inertia = 20.0 * (0.4**2 + 1.0**2) / 12.0 + 20.0 * (0.2**2 + 0.5**2)
    turn = (120.0 * 0.5 - 20 * G * 0.2) / inertia
    assert inside(found.a, np.array([0.5 * turn, 0, 0.2 * turn, 0, turn, 0]))
    assert sorted(found.modes["floor"]) == ["opens", "opens", "sticks", "sticks"]
    rod = rbd.testing.box(10.0, (2.0, 1e-5, 1e-5))
    state = box_at(rod, (np.cos(0.7), 0.0, np.sin(0.7)), 0.7)
    found = rbd.solve(state, [], [rbd.PointContact("foot", "box", offset=(-1.0, 0.0, 0.0))]).enclosure()
    turn = 10 * G * np.cos(0.7) / (10.0 * (4.0 + 1e-10) / 12.0 + 10.0)
    assert inside(found.a, np.array([0.0, 0.0, -turn, 0.0, turn, 0.0])) and found.scope == ONLY
    ladder = rbd.load_robot(URDF / "ladder.urdf")
    feet = [
        rbd.PointContact("floor", "ladder", offset=(-1.0, 0.0, 0.0), friction=0.4),
        rbd.PointContact("wall", "ladder", offset=(1.0, 0.0, 0.0), on=rbd.Ground(normal=(-1.0, 0.0, 0.0)), friction=0.0),
    ]
    found = rbd.solve(box_at(ladder, (-0.5, 0.0, np.sin(np.pi / 3)), np.pi / 3), [], feet).enclosure()
    wall = 0.5 * 10 * G / np.tan(np.pi / 3)
    assert inside(found.forces["floor"], np.array([wall, 0.0, 10 * G]))
    assert inside(found.forces["wall"], np.array([-wall, 0, 0]))


def test_redundant_points_have_one_motion_and_forces_that_are_not_unique():
    """A box on four points, twelve rows of rank six, pushed: what the rows that are left out miss is rounding."""
    robot = rbd.load_robot(URDF / "box.urdf")
    state = box_at(robot, (0.013, 0.27, 0.1), 0.0)
    places = ((0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2))
    corners = [rbd.PointContact(f"p{i}", "box", offset=(x, y, -0.1), friction=0.6) for i, (x, y) in enumerate(places)]
    push = rbd.ExternalForce("box", (20.0, 7.0, 0.0))
    for law in ("coulomb", "convex"):
        solution = rbd.solve(state, [], corners, external=push, law=law)
        found = solution.enclosure()
        assert not any(found.unique.values()) and found.scope == (ONLY if law == "convex" else OF_MODES)
        assert inside(found.a, np.zeros(6)) and found.a.rad.max() < 1e-14
        total = sum(np.array([f.lower, f.upper]) for f in found.forces.values())
        assert np.abs(total - np.array([-20.0, -7.0, 10 * G])).max() < 1e-11
        assert found.missed and max(found.missed.values()) < 1e-13
    patch = rbd.solve(state, [], [sole("box", 0.1, 0.6)], external=push).enclosure()
    assert patch.unique == {"floor": True} and not patch.missed  # six rows hold exactly; corner forces are none of its forces


def test_limits_loops_and_dry_friction_have_modes():
    """A closed loop, a joint on its limit, and dry friction that holds, yields, and slides."""
    four = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    state = four.at("assembled")
    found = rbd.solve(state, np.zeros(four.nu), four.loops()).enclosure()
    assert found.scope == ONLY and set(found.modes[four.loops()[0].name]) == {"holds"}
    for strength, word in ((50.0, "holds"), (1.0, "yields")):
        rows = rbd.Rows("dry", J=np.array([[1.0, 0.0]]), bias=np.zeros(1), cone=Bounds([-strength], [strength]))
        problem = rbd.GaussProblem(2.0 * np.eye(2), np.array([10.0, 3.0]), [rows])
        found = rbd.solve_problem(problem).enclosure()
        expected = 0.0 if word == "holds" else 4.5
        assert found.modes == {"dry": (word,)} and found.scope == ONLY and found.a.contains([expected, 1.5]).all()
    slope = rbd.Rows("slope", J=np.array([[0.6, 0.8]]), bias=np.zeros(1), cone=rbd.problem.NonNegative(1))
    for weight, word in ((-19.62, "presses"), (19.62, "opens")):
        found = rbd.solve_problem(rbd.GaussProblem(2.0 * np.eye(2), np.array([0.0, weight]), [slope])).enclosure()
        j = [Fraction(0.6), Fraction(0.8)]
        force = max(-j[1] * Fraction(weight) / (j[0] ** 2 + j[1] ** 2), Fraction(0))
        assert found.modes == {"slope": (word,)} and holds(found.forces["slope"], [force])
        assert holds(found.a, [j[0] * force / 2, (Fraction(weight) + j[1] * force) / 2])
    free = rbd.solve(rbd.State(rbd.testing.box(), [0, 0, 1, 0, 0, 0, 1]), []).enclosure()
    assert inside(free.a, np.array([0, 0, -G, 0, 0, 0])) and free.margin[0] == "" and free.width[1] == 0.0


def made_to_fail() -> Iterator[rbd.Solution]:
    """Answers whose forces or accelerations are off, and answers on the border of a cone, in exact doubles."""
    solo = rbd.load_robot("solo12")
    rng = np.random.default_rng(5)
    for _, solution in zip(range(15), drawn(solo, solo.feet(friction=0.7, on=None), 6, 0.3), strict=False):
        off = np.zeros(12)
        off[rng.integers(12)] = rng.choice([-1e-6, 1e-6])
        yield replace(solution, multipliers=solution.multipliers + off, weights=solution.weights + off)
        yield replace(solution, a=solution.a + 1e-6 * rng.choice([-1.0, 1.0], 18))
    for _, solution in zip(range(10), drawn(solo, solo.feet(friction=0.7, on=None), 7, 0.3), strict=False):
        off = np.zeros(12)
        off[rng.integers(12)] = rng.choice([-3e-8, 3e-8])  # still an answer, to 1e-7
        yield replace(solution, multipliers=solution.multipliers + off, weights=solution.weights + off)
    for push in ((3.0, 4.0, 2.5), (-5.0, 12.0, 6.5)):  # rises just as fast as the convex law lets it slip
        yield rbd.solve_problem(rbd.GaussProblem(np.eye(3), np.array(push), [POINT]), law="convex")
    for k in range(20):  # 5-12-13 and 3-4-5 times powers of two: friction is used up, exactly
        x, y, size = ((3.0, 4.0, 5.0), (5.0, 12.0, 13.0))[k % 2]
        pushed = np.array([x, y if k % 3 else -y, -2.0 * size]) * 2.0 ** (k // 4)
        yield rbd.solve_problem(rbd.GaussProblem(np.eye(3) * 2.0 ** (k % 5), pushed, [POINT]))


def test_wrong_answers_and_answers_at_a_border_are_refused():
    """Sixty-two of them; one that names a row gives its value, and what was needed."""
    refused = 0
    for solution in made_to_fail():
        with pytest.raises((NotEnclosed, rbd.NoSolution)) as error:
            solution.enclosure()
        refused += 1
        if isinstance(error.value, NotEnclosed):
            assert not error.value.value > error.value.needed and error.value.reason is rbd.errors.Reason.NOT_ENCLOSED
    assert refused == 62


def at_a_limit(robot: rbd.Robot, contacts: list, seed: int, law: str) -> tuple[NotEnclosed, set[tuple[str, int, str, str]]]:
    """(refusal of a state between two contact modes, what changes there as (contact, number of its part, mode, mode)).

    Torques change so that one foot is pushed aside until it slips, relieved of its load until it opens, or (a sole) turned
    until it tips; then the change is halved between two enclosed answers of other modes.
    """
    rng, standing = np.random.default_rng(seed), robot.standing()
    q = standing.q.copy()
    q[7:] += rng.uniform(-0.05, 0.05, len(q) - 7)
    state, tau, foot = rbd.State(robot, q), rbd.hold(standing, contacts).tau, contacts[rng.integers(len(contacts))]
    aside, turn = rng.normal(size=(2, 2))
    load = rbd.solve(state, tau, contacts, law=law).forces[foot.name][:3]
    wrench = ((*aside, 0, 0, 0, 0), (*-load, 0, 0, 0), (0, 0, 0, *(0.1 * turn), 0))[seed % (2 if len(contacts) == 4 else 3)]
    change = -robot.mass * G * (state.frame(foot.frame).J.T @ wrench)[robot.actuated] / np.linalg.norm(wrench)

    def modes(s: float) -> dict[str, tuple[str, ...]]:
        return dict(rbd.solve(state, tau + s * change, contacts, law=law).enclosure().modes)

    low, high = 0.0, 0.005
    before = modes(low)
    while (after := modes(high)) == before:
        low, high = high, high + 0.005 if high < 0.05 else 1.1 * high
    while low < (middle := 0.5 * (low + high)) < high:
        try:
            found = modes(middle)
        except NotEnclosed as error:
            both = [(name, i, x, y) for name in before for i, (x, y) in enumerate(zip(before[name], after[name], strict=True))]
            return error, {each for each in both if each[2] != each[3]}
        if found == before:
            low = middle
        else:
            high, after = middle, found
    raise AssertionError(f"{robot.name}, {seed}: two neighbouring doubles have other modes, and both are enclosed")


@pytest.mark.parametrize(("name", "count", "laws"), [("solo12", 9, 2), ("talos", 16, 1), ("g1", 16, 1)])
@pytest.mark.filterwarnings("ignore::rbd.errors.JointLimitWarning", "ignore::rbd.errors.EffortLimitWarning")
def test_states_between_two_modes_are_refused_with_a_row_that_changes(name, count, laws, exhaustive, record_property):
    """Fifty of them: points on the edge of their cones, loads near none, slips near none, soles that are about to tip.

    Of soles under the convex law, whose motion is unique: Coulomb's may jump, with both sides far from a limit.
    """
    if name != "solo12" and not exhaustive:
        pytest.skip("in the exhaustive run, as all but one of Solo's")
    robot = rbd.load_robot(name)
    contacts = robot.feet(friction=0.7, on=None) if name == "solo12" else robot.soles(friction=0.7, on=None)
    refused, seed, kinds = 0, 0, set[tuple[str, str]]()
    while refused < (count * laws if exhaustive else 1):
        for law in ("convex", "coulomb")[:laws]:
            try:
                error, changes = at_a_limit(robot, contacts, seed, law)
            except NotEnclosed:
                continue  # one of the states that it begins with is at a limit, too
            assert (error.constraint, error.row) in {change[:2] for change in changes}
            assert error.constraint in str(error) and not error.value > error.needed
            refused, kinds = refused + 1, kinds | {change[2:] for change in changes}
        seed += 1
    assert ("sticks", "slips") in kinds and (len(contacts) == 4 or ("sticks", "opens") in kinds)  # points slip before they open
    record_property("counted", f"{refused} states of {name} at a limit refused, of {sorted(kinds)}, {seed} drawn")


def test_a_row_too_near_its_limit_is_named():
    """A mass whose friction is used up, and one with three millionths of a newton left."""
    problem = [rbd.GaussProblem(np.eye(3), np.array([3.0, 0.0, -6.0 * near]), [POINT]) for near in (1.0, 1.0 + 1e-6)]
    with pytest.raises(NotEnclosed, match="^'p', point 1 of 1, sticks: its force is .* inside its set, and more than") as error:
        rbd.solve_problem(problem[0]).enclosure()
    assert error.value.constraint == "p" and error.value.row == 0 and error.value.value <= error.value.needed < 1e-12
    name, part, mode, room = rbd.solve_problem(problem[1]).enclosure().margin
    assert (name, part, mode) == ("p", 0, "sticks") and room == pytest.approx(3e-6, rel=1e-6)


def test_shared_loads_are_said_to_be_shared():
    """A sole that slips and turns under Coulomb's law on four corners: the motion depends on how they share the load."""
    robot = rbd.load_robot(URDF / "box.urdf")
    push = rbd.ExternalForce("box", (90.0, 0.0, 0.0), offset=(0.0, 0.05, 0.0))
    solution = rbd.solve(box_at(robot, (0, 0, 0.1)), [], [sole("box", 0.1, 0.6)], external=push)
    found = solution.enclosure()
    assert found.scope == SHARED and found.modes == {"floor": ("slips",) * 4} and abs(solution.a[5]) > 1.0
    assert solution.uniqueness().motion_freedom and found.a.rad.max() < 1e-13


def test_it_prints_plainly_and_can_be_copied():
    """The statement first; pickles and copies have the same intervals."""
    solo = rbd.load_robot("solo12")
    found = next(drawn(solo, solo.feet(friction=0.7, on=None), 3)).enclosure()
    lines = str(found).splitlines()
    assert lines[0] == "the problem has exactly one motion with these modes, and it is in these intervals"
    assert lines[3].split() == ["front_left", "sticks"] and "nearest to a limit: " in lines[-1]
    for other in (pickle.loads(pickle.dumps(found)), copy.deepcopy(found)):
        assert str(other) == str(found) and np.array_equal(other.a.rad, found.a.rad)


@pytest.mark.parametrize("name", ["solo12", "talos", "g1"])
def test_answers_of_random_states_are_enclosed(name: str, exhaustive: bool, record_property):
    """All but those at a change of mode; narrower than 1e-9 N and 1e-9 m/s2; 1,000 in the exhaustive run, each within 20 ms."""
    if name != "solo12" and not exhaustive:
        pytest.skip("a state of a humanoid is in test_copies; 1,000 of each in the exhaustive run")
    robot = rbd.load_robot(name)
    contacts = robot.feet(friction=0.7, on=None) if name == "solo12" else robot.soles(friction=0.7, on=None)
    count, at_limit, took, widths = 1000 if exhaustive else 10, 0, [], []
    for solution in drawn(robot, contacts, 41):
        assert solution.problem and solution.residuals.within(1e-7)
        begin = time.process_time()
        try:
            found = solution.enclosure()
        except NotEnclosed:
            with pytest.raises(NotDifferentiable):
                ActiveSet(solution)
            at_limit += 1
            continue
        took.append(time.process_time() - begin)
        if took[-1] > 0.02:  # once more: the first call imports, and others use the processor's other half
            begin = time.process_time()
            solution.enclosure()
            took[-1] = min(took[-1], time.process_time() - begin)
        widths.append(found.width)
        if len(took) == count:
            break
    assert np.max(widths) < 1e-9 and at_limit <= 0.02 * count
    if exhaustive:
        assert np.max(took) < 0.02
    figures = f"{np.median(took):.4f} s, at most {max(took):.4f} s, widest {np.max(widths):.1e}, at a limit {at_limit}"
    record_property("counted", f"{count} answers of {name} enclosed: {figures}")
