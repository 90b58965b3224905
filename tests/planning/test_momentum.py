"""What contacts can do to the momentum of a whole plan: closed forms, linear programs on fine grids, certified plans."""

from __future__ import annotations

import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hops import hop_of
from scipy.optimize import linprog

import rbd
from rbd.centroid import CentroidProgram
from rbd.constraints.convex.polygons import across
from rbd.errors import CannotPlan, NoSolution
from rbd.planning import MomentumCertificate, Plan
from rbd.planning.momentum import COUNTS, Momentum, Standing
from rbd.planning.stays import planned_contacts

G, MASS = 9.81, 5.0
DOWN = np.array([0.0, 0.0, -G])
FACETS = 24


def stay(start: float, end: float, points: Any, friction: float, normal: Any = (0, 0, 1), name: str = "floor") -> Standing:
    """A contact that stands."""
    n = np.asarray(normal) / np.linalg.norm(normal)
    return Standing(name, start, end, np.array(points, float), np.array([*across(n), n]), friction)


def sole(half: float, at: Any = (0.0, 0.0, -1.0)) -> Any:
    """Corners of a square."""
    return np.asarray(at) + half * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])


def asked(stays: list[Standing], t: Any, com: Any, rests: bool = True) -> Momentum:
    """Of a mass."""
    return Momentum(MASS, DOWN, tuple(stays), np.atleast_1d(t), np.atleast_2d(com), rests)


def check(why: MomentumCertificate, rng: np.random.Generator) -> None:
    """At random instants and corners f . u is not negative of any force in its cone; what is needed is; no limit is idle."""
    m = why.asked
    for s in m.stays:
        for t in rng.uniform(s.start, s.end, 40):
            u = np.array([s.axes @ why.direction(t, p) for p in s.points])
            assert (s.friction * np.linalg.norm(u[:, :2], axis=1) - u[:, 2]).max() <= why.missing / why.reach + 1e-12
            assert np.linalg.norm(u, axis=1).max() <= 1.0 + 1e-9
    assert why.missing > 0.0 and why.reach > 1e3 * m.weight * m.t[-1]
    gone = [limit for limit in m.limits if limit not in why.limits]
    gone = [x for x in gone if x.kind != "push" or not any(y.name == x.name for y in why.limits)]
    for limit in why.limits:
        assert m.solved([*gone, limit])[0] < COUNTS


@pytest.mark.parametrize("mu", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("T", [0.4, 1.0])
def test_a_mass_is_moved_by_half_mu_g_T_squared(mu: float, T: float, rng: np.random.Generator):
    """From rest to rest on a wide floor, its height free: impulses m g T / 2 at both ends. One percent more is refused."""
    most = 0.5 * mu * G * T**2
    floor = stay(0.0, T, sole(50.0), mu)
    assert asked([floor], T, [0.99 * most, 0.0, 0.0]).certificate() is None
    why = asked([floor], T, [1.01 * most, 0.0, 0.0]).certificate()
    assert why is not None and [(x.kind, x.name) for x in why.limits] == [("friction", "floor"), ("keyframe", f"{T:g} s")]
    check(why, rng)
    assert why.helps == pytest.approx({"time": np.sqrt(1.01), "friction": 1.01, "distance": 1.01}, abs=1.5e-3)


def test_acceleration_is_at_most_mu_g_where_its_height_does_not_change(rng: np.random.Generator):
    """Keyframes at one height, 20 ms apart, over half a second: to mu g T^2 / 4, half of the time forwards, then back."""
    mu, T, n = 0.4, 0.5, 25
    t = T * np.arange(1, n + 1) / n
    for share, found in ((0.98, False), (1.02, True)):
        a = share * mu * G
        x = np.where(t < 0.5 * T, 0.5 * a * t**2, a * (T * t - 0.25 * T**2 - 0.5 * t**2))
        why = asked([stay(0.0, T, sole(50.0), mu)], t, np.stack([x, 0.0 * x, 0.0 * x], axis=1)).certificate()
        assert (why is not None) == found
    assert why is not None and any(limit.kind == "friction" for limit in why.limits)
    check(why, rng)


def test_the_mass_in_flight_falls(rng: np.random.Generator):
    """Keyframes in the air at one height contradict each other, and nothing but the flight and they are named."""
    t = np.array([0.4, 0.5, 0.6, 1.0])
    why = asked([stay(0.0, 0.4, sole(0.2), 0.7), stay(0.6, 1.0, sole(0.2), 0.7)], t, np.zeros((4, 3))).certificate()
    assert why is not None and {limit.kind for limit in why.limits} == {"flight", "keyframe"}
    assert str(why.limits[0]) == "the time from 0.4 to 0.6 s, in which nothing stands"
    check(why, rng)
    fallen = np.array([[0.0, 0.0, z] for z in (0.0, 0.125 * G * 0.2**2, 0.0, 0.0)])
    assert asked(list(why.asked.stays), t, fallen).certificate() is None


def test_at_rest_without_a_contact(rng: np.random.Generator):
    """Nothing stands before 0.3 s, and the mass is to be where it was: it can be thrown, but not lie in wait."""
    late = [stay(0.3, 1.0, sole(0.2), 0.7)]
    assert asked(late, 1.0, [0.0, 0.0, 0.0]).certificate() is None
    why = asked(late, [0.2, 1.0], [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]).certificate()
    assert why is not None and {limit.kind for limit in why.limits} == {"flight", "keyframe"}
    check(why, rng)


def test_the_edge_of_a_sole(rng: np.random.Generator):
    """On a narrow sole what is pushed forwards tips: the angular momentum that friction gives has to be taken back."""
    half, h, T = 0.05, 1.0, 0.5
    found = []
    for side in (half, 50.0):
        for d in np.linspace(0.02, 0.7, 35):
            why = asked([stay(0.0, T, sole(side, (0.0, 0.0, -h)), 0.5)], T, [d, 0.0, 0.0]).certificate()
            if why is not None:
                found.append((d, {limit.kind for limit in why.limits}))
                check(why, rng)
                break
    (narrow, kinds), (wide, others) = found
    assert "edge" in kinds and "edge" not in others
    assert narrow < wide and wide == pytest.approx(0.5 * 0.5 * G * T**2, abs=0.02)


def by_linear_program(m: Momentum, inside: bool) -> bool:
    """Whether forces in pyramids, within circular cones or around them, at 101 instants give what is needed."""
    columns = []
    angles = 2.0 * np.pi * (np.arange(FACETS) + 0.5) / FACETS
    radius = 1.0 if inside else 1.0 / np.cos(np.pi / FACETS)
    for s in m.stays:
        rays = np.stack([radius * s.friction * np.cos(angles), radius * s.friction * np.sin(angles), np.ones(FACETS)], axis=1)
        for t in np.linspace(s.start, s.end, 101):
            for p in s.points:
                columns.append(rays @ s.axes @ m.direction(t, t, 0, p))
    A = np.concatenate(columns).T
    size = np.abs(m.need).max()
    answer = linprog(np.zeros(A.shape[1]), A_eq=A, b_eq=m.need / size, bounds=(0.0, None), method="highs")
    return bool(answer.status == 0)


@pytest.mark.parametrize("k", range(8))
def test_linear_programs_agree(k: int, rng: np.random.Generator):
    """Random stays on slopes: what pyramids inside can do is not refused; what is refused pyramids around the cones cannot."""
    rng, T = np.random.default_rng(k), 0.8
    stays = []
    for i, (start, end) in enumerate(((0.0, 0.5), (0.3, 0.8))):
        n = np.array([*rng.uniform(-0.3, 0.3, 2), 1.0])
        at = np.array([*rng.uniform(-0.2, 0.2, 2), -rng.uniform(0.3, 0.6)])
        stays.append(stay(start, end, sole(0.05, at), 0.4, n, f"foot {i}"))
    m = asked(stays, T, [*rng.uniform(-0.6, 0.6, 2), 0.0])
    why = m.certificate()
    if why is None:
        assert m.solved()[0] < 1e-4 and by_linear_program(m.rougher(1.02).slower(1.001), True)
    else:
        check(why, rng)
        assert not by_linear_program(m, True)
        factor = why.helps["friction"]
        assert by_linear_program(m.rougher(1.03 * factor), True)
        assert not by_linear_program(m.rougher(0.97 * factor), False)


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def hop(solo: rbd.Robot) -> Plan:
    """Nothing stands from 0.4 to 0.7 s."""
    return hop_of(solo)


def test_forces_of_a_proved_plan_give_what_is_needed(hop: Plan):
    """Sums of f . u over a hop's own forces, by Gauss's rule, for each multiplier."""
    m, x, first = Momentum.of(hop.contacts), hop.intervals, hop.contacts.keys[0][1].com
    assert m.certificate() is None
    given = np.zeros(len(m.need))
    for start, end in zip(x.start, x.end, strict=True):
        for z, weight in zip(*np.polynomial.legendre.leggauss(2), strict=True):
            t = start + 0.5 * (end - start) * (z + 1.0)
            for name, forces in hop.forces(t).items():
                contact = next(c for c in hop.contacts.contacts if c.name == name)
                points = contact.points(hop.state(t)).positions.reshape(-1, 3) - first
                for p, f in zip(points, forces, strict=True):
                    given += 0.5 * (end - start) * weight * (f @ m.direction(t, t, 0, p))
    size = m.units * (m.weight * m.t[-1])
    off, within, n = np.abs(given - m.need) * m.units, 2.0 * hop.missing * float(size.max()), 6 + 3 * len(m.t)
    assert (off[:n] <= within).all()
    far = np.linalg.norm((given - m.need)[n:].reshape(-1, 3), axis=1) / m.mass
    coms = np.array([hop.state(x.t).com - first - x.centre for x in m.near])
    assert far == pytest.approx(np.linalg.norm(coms, axis=1), abs=2e-3) and (far < [x.radius for x in m.near]).all()


def test_too_little_friction_is_refused_before_anything_is_planned(solo: rbd.Robot, rng: np.random.Generator):
    """Friction of all feet, the flight and the keyframe; with its certificate, no plan, and what would help."""
    stand, feet = solo.standing(), {foot.name: [(0.0, 0.2), (0.4, 0.6)] for foot in solo.feet()}
    keys = {0.0: stand, 0.6: stand.q + 0.3 * np.eye(solo.nq)[0]}
    with pytest.raises(CannotPlan, match="friction of 'front_left'.*0.194 instead of 0.1") as caught:
        rbd.plan(solo, keys, feet, friction=0.1, progress=False)
    error = caught.value
    assert error.plan is None and error.irreducible and error.certificate is error.momentum
    assert error.limits == error.momentum.limits
    why = error.momentum
    least = MomentumCertificate(replace(why.asked, near=()), why.y, (), why.t).helps["friction"]
    assert least == pytest.approx(0.3 / (0.5 * 0.1 * G * 0.6**2), abs=2e-3) and error.helps["friction"] > least
    assert min(error.t) >= 0.0 and max(error.t) <= 0.6
    check(error.momentum, rng)
    assert str(pickle.loads(pickle.dumps(error)).momentum) == str(error.momentum)


@pytest.mark.parametrize(("T", "said"), [(1.2, "leave with about 5.9 m/s and to rise by about 1.8 m"), (0.3, None)])
def test_a_flight_that_rises_higher_than_legs_reach(T: float, said: str | None):
    """With g T / 2 and by g T^2 / 8, where that is more than the distance of its centre of mass from any foot."""
    solo = rbd.load_robot("solo12")
    stand, feet = solo.standing(), {foot.name: [(0.0, 0.4), (0.4 + T, 0.8 + T)] for foot in solo.feet()}
    high = Momentum.of(planned_contacts(solo, {0.0: stand, 0.8 + T: stand}, feet, friction=0.6, ground=0.0)).high_flight
    assert high is None if said is None else said in str(high)


def test_keyframes_that_contradict_each_other_are_told_with_the_nearest_plan(talos: rbd.Robot, rng: np.random.Generator):
    """8 cm there and back in 0.24 s: no motion passes through all three."""
    stand = talos.standing()
    keys = {0.0: stand, 0.12: {"com": stand.com + [0.08, 0.0, 0.0]}, 0.24: stand}
    with pytest.raises(CannotPlan, match="No motion passes through") as caught:
        rbd.plan(talos, keys, {foot.name: True for foot in talos.feet()}, progress=False)
    error = caught.value
    assert error.plan is not None and {limit.kind for limit in error.momentum.limits} == {"friction", "keyframe"}
    check(error.momentum, rng)


def test_the_centroids_program_has_no_answer_either():
    """What is refused has no motion on the grid of the centroid's program; with 0.8 of the distance it has one."""
    mu, n, dt = 0.5, 61, 1.0 / 60.0
    points, most = np.tile(sole(50.0), (n, 1, 1)), 0.5 * mu * G
    way = np.linspace(0.0, 1.0, n)[:, None] * [1.01 * most, 0.0, 0.0]
    still = np.zeros((n, 3))
    program = CentroidProgram(
        dt, MASS, DOWN, points, np.ones((n, 4), bool), mu, way, still, rests=(True, True), start=(way[0], still[0], still[0]),
        end=way[-1],
    )  # fmt: skip
    with pytest.raises(NoSolution, match="PrimalInfeasible"):
        program.solve()
    assert replace(program, end=0.8 * way[-1], com=0.8 * way).solve().status == "Solved"
