"""The prepared way of `rbd.solve` and its general way: the same answers, by the certificate of the problem in arrays.

Nine robots on their feet, both laws. `rbd.solve` chooses the way by itself; a solver that is named takes the general one.
Answers are judged by `residuals_of`, from M, J and J_dot v, which the prepared way does not compute. `make exhaustive` takes
10,000 states of each robot and law, and prints what answered them.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import certificate
import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.contact_modes import modes_of
from rbd.answers.analysis.uniqueness import motion_freedom
from rbd.constraints.constraint import Constraint
from rbd.errors import NonUniqueMotionWarning, RbdWarning
from rbd.problem.residuals import residuals_of
from rbd.solvers.admm import ConeSolver
from rbd.solvers.default import GaussFirst

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
ROBOTS = ("talos", "g1", "human", "romeo", "icub", "bolt", "solo12", "anymal_c", "go2")
GENERAL = {"coulomb": GaussFirst(), "convex": ConeSolver(law="convex")}
CERTIFIED, SAME = 1e-9, 1e-9
FEW, ALL = 16, 10_000
PREPARED, MOST = "ContactDynamics", 0.9
"""`Solution.solver` of the prepared way, and the least share of all states that it answers."""
WEAK = 1e-3
"""At most this share of the states has a motion that residuals of 1e-9 determine to the square root of that only."""
OTHER_MOTIONS = 0.02
"""At most this share of the states has another isolated motion under Coulomb's law, which another start finds."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """One state of a robot, its torques, its contacts."""

    state: rbd.State
    tau: np.ndarray
    contacts: Sequence[Constraint]

    @property
    def held(self) -> bool:
        """Whether its contacts are bilateral."""
        return all(getattr(contact, "friction", None) is None for contact in self.contacts)


def drawer(name: str, seed: int) -> Callable[[], Drawn]:
    """Random states of a robot on feet: bent, at rest or moving, held or with friction, small noise on its torques or large.

    Velocities leave frictional feet at rest; those that are held may move.
    """
    robot = rbd.load_robot(name)
    standing, rng = robot.standing(), np.random.default_rng(seed)
    sets = [robot.feet(friction, on=None) for friction in (None, 0.3, 0.8)]
    hold = rbd.hold(standing, robot.feet(0.8)).tau
    weight = robot.mass / 90.0

    def draw() -> Drawn:
        contacts = sets[rng.integers(3)]
        bend = np.concatenate([0.02 * rng.normal(size=6), 0.1 * rng.normal(size=robot.nv - 6)])
        q = pin.integrate(robot.model, standing.q, bend)
        v = 0.3 * rng.integers(2) * rng.normal(size=robot.nv)
        if contacts is not sets[0] and v.any():
            J = np.concatenate([c.rows(rbd.State(robot, q)).J for c in contacts])
            for _ in range(2):
                v = v - np.linalg.lstsq(J, J @ v, rcond=None)[0]
        tau = hold + weight * rng.choice([0.0, 1.0, 10.0, 60.0]) * rng.normal(size=robot.nu)
        return Drawn(rbd.State(robot, q, v), np.clip(tau, -robot.effort_limit, robot.effort_limit), contacts)

    return draw


def judged(solution: rbd.Solution) -> float:
    """The largest scaled residual by the problem in arrays, computed anew."""
    return residuals_of(solution.problem, solution.a, solution.multipliers, solution.weights, solution.law).worst


def energy_between(one: rbd.Solution, other: rbd.Solution) -> float:
    """1/2 |a - a'|_M^2 of two motions of the same state, to be compared with Gauss's function."""
    e = one.a - other.a
    return 0.5 * float(e @ one.problem.M @ e)


def isolated(solution: rbd.Solution) -> bool:
    """Whether no motion with the same contact modes is near this one."""
    return motion_freedom(solution) == 0


def modes(solution: rbd.Solution) -> list[str]:
    """What each contact point does."""
    return list(modes_of(solution).words.values())


@pytest.mark.parametrize("law", ["coulomb", "convex"])
@pytest.mark.parametrize("name", ROBOTS)
def test_both_ways_give_the_same_certified_answers(name, law, exhaustive, record_property):
    """Residuals at 1e-9 by the arrays; a to 1e-9 where the motion is unique; what answered is counted.

    Under Coulomb's law an isolated motion may be one of several: the two ways then differ in which points stick or slip. A sole
    that slips along a line and hardly turns has four points on cones with nearly parallel tangents: residuals then determine
    its motion to second order only, and what agrees is the energy of the difference. One state in some ten thousand is so.
    """
    draw, count = drawer(name, seed=ROBOTS.index(name)), ALL if exhaustive else FEW
    answered: Counter[str] = Counter()
    families, others, weak, worst, apart = 0, 0, 0, 0.0, 0.0
    for i in range(count):
        drawn = draw()
        fast = rbd.solve(drawn.state, drawn.tau, drawn.contacts, law=None if law == "coulomb" and i % 2 else law)
        assert fast.law.kind == ("bilateral" if drawn.held else law)
        answered[f"{fast.solver} ({fast.method})"] += 1
        worst = max(worst, judged(fast))
        assert worst <= CERTIFIED, f"state {i}: {fast}"
        general = rbd.solve(drawn.state, drawn.tau, drawn.contacts, solver=GENERAL[law])
        difference = float(np.abs(fast.a - general.a).max() / max(1.0, np.abs(general.a).max()))
        if difference <= SAME:
            apart = max(apart, difference)
            continue
        if law == "coulomb" and not (isolated(fast) and isolated(general)):
            families += 1
        elif law == "coulomb" and modes(fast) != modes(general):
            others += 1
        else:
            told = f"state {i}: a differs by {difference:.1e}"
            assert energy_between(fast, general) <= CERTIFIED * max(1.0, fast.gauss), told
            weak += 1
    assert others <= max(1.0, OTHER_MOTIONS * count) and weak <= WEAK * count
    prepared = sum(number for way, number in answered.items() if way.startswith(PREPARED))
    assert prepared >= MOST * count, answered
    told = ", ".join(f"{method} {number}" for method, number in answered.most_common())
    also = f"one of a family of motions {families}, another motion {others}, weakly determined {weak}"
    record_property("counted", f"{name}, {law}: {told}; {also}; residuals {worst:.0e}; a differs by {apart:.0e} at most")


@pytest.mark.parametrize("name", ROBOTS)
def test_the_second_certificate_agrees(name):
    """`tests/certificate.py`, which shares no code with the package: `rnea`, forward kinematics, the law of each point."""
    draw = drawer(name, seed=100 + ROBOTS.index(name))
    for law in ("coulomb", "convex"):
        for _ in range(2):
            drawn = draw()
            s = rbd.solve(drawn.state, drawn.tau, drawn.contacts, law=law)
            axes = {r.name: r.patch.axes for r in s.problem.rows}
            corners = {name: forces @ axes[name] for name, forces in s.corner_forces.items()}
            found = certificate.of_arrays(s.problem.M, s.problem.rhs, s.problem.rows, s.a, s.multipliers, corners, str(s.law))
            assert found.worst <= 1e-7, f"{s}\n{found}"


def test_what_a_solution_tells_is_the_same_both_ways():
    """Forces, corner forces, accelerations, friction used and centre of pressure of sticking soles, derived from either."""
    draw, compared = drawer("talos", seed=5), 0
    while compared < 6:
        drawn = draw()
        with warnings.catch_warnings():
            warnings.simplefilter("error", NonUniqueMotionWarning)
            warnings.simplefilter("ignore", RbdWarning)
            fast = rbd.solve(drawn.state, drawn.tau, drawn.contacts, law="convex")
            general = rbd.solve(drawn.state, drawn.tau, drawn.contacts, solver=GENERAL["convex"])
        size = max(1.0, np.abs(general.multipliers).max())
        for ours, theirs in ((fast.forces, general.forces), (fast.corner_forces, general.corner_forces)):
            assert list(ours) == list(theirs)
            for key in ours:
                assert ours[key].shape == theirs[key].shape and np.abs(ours[key] - theirs[key]).max() <= 1e-8 * size, key
        for key, contact in fast.contacts.items():
            other = general.contacts[key]
            assert contact.normal == pytest.approx(other.normal, abs=1e-8 * size)
            if other.centre_of_pressure is not None:
                assert contact.centre_of_pressure == pytest.approx(other.centre_of_pressure, abs=1e-6)
        assert fast.status == general.status == "solved" and fast.gauss == pytest.approx(general.gauss, rel=1e-8, abs=1e-8)
        assert fast.force_choice == general.force_choice
        compared += 1
