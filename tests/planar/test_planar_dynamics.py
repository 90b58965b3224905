"""Lagrange's equations of planar chains: against differentiation, published numbers, and the laws they obey."""

from __future__ import annotations

from functools import cache

import lagrange
import numpy as np
import pytest
import scipy.linalg
import sympy as sp
from sympy.core.cache import clear_cache
from work import calls

from rbd.errors import InputError, SingularInertia
from rbd.planar.bodies import bodies_of
from rbd.planar.chain import Chain
from rbd.planar.equations_of_motion import Dynamics, dynamics
from rbd.planar.robot_file import to_robot

ANGLES = ("joint", "segment", "vertical")
m, L, g = sp.symbols("m L g", positive=True)


def normal(expression):
    """Sines and cosines as polynomials in e^(i theta), where equal expressions look alike."""
    return sp.expand(expression.rewrite(sp.exp))


@cache
def general(n: int, angles: str) -> Dynamics:
    return dynamics(Chain(n, angles=angles))


def by_hand(dyn: Dynamics):
    """(T, V) from where the centres of mass are: nothing of rbd.planar.equations_of_motion is in it."""
    chain, b = dyn.chain, dyn.bodies
    centres, at = [], sp.zeros(2, 1)
    for phi, ell, d in zip(chain.segment_angles, b.lengths, b.centres, strict=True):
        along = sp.Matrix([sp.cos(phi), sp.sin(phi)])
        centres.append(at + d * along)
        at += ell * along
    return lagrange.energies(centres, list(chain.segment_angles), b.masses, b.inertias, dyn.gravity, chain.t)


@pytest.mark.parametrize(("n", "angles"), [*((n, angles) for n in (1, 2) for angles in ANGLES), (3, "joint")])
def test_the_equations_are_those_of_lagrange(n: int, angles: str):
    """d/dt dT/dqd - dT/dq + dV/dq, from the positions of the centres of mass, in symbols."""
    dyn = general(n, angles)
    chain = dyn.chain
    T, V = by_hand(dyn)
    assert normal(lagrange.euler_lagrange(T, V, chain.q, chain.t) - dyn.equations) == sp.zeros(n, 1)
    assert normal(T - dyn.T) == normal(V - dyn.V) == 0


def test_four_links_are_those_of_lagrange_in_numbers():
    """M and the forces of four links against the second derivatives of T at random states."""
    dyn = general(4, "vertical").subs({s: 0.3 + 0.1 * k for k, s in enumerate(general(4, "vertical").unknowns)})
    T, V = by_hand(dyn)
    chain, rng = dyn.chain, np.random.default_rng(4)
    q, qd, qdd = rng.uniform(-2.0, 2.0, (3, 20, 4))
    long = lagrange.euler_lagrange(T, V, chain.q, chain.t)
    expected = chain.function(long)(q, qd, qdd)
    assert np.abs(dyn.inverse(q, qd, qdd) - expected).max() < 1e-13 * np.abs(expected).max()
    M = chain.function(lagrange.mass_matrix(T, chain.qd))(q, qd)
    assert np.abs(chain.function(dyn.M)(q) - M).max() < 1e-13 * np.abs(M).max()


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize("n", [2, 4])
def test_christoffel_symbols_are_the_derivatives_of_M(n: int, angles: str):
    """G_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i), and C_ij = sum_k G_ijk qd_k."""
    dyn = general(n, angles)
    G = lagrange.christoffel(dyn.M, dyn.chain.q)
    assert all(sp.expand(a - b) == 0 for a, b in zip(sp.flatten(G), sp.flatten(dyn.christoffel), strict=True))
    assert (lagrange.coriolis_matrix(G, dyn.chain.qd) - dyn.C).expand() == sp.zeros(n, n)


def test_christoffel_symbols_of_two_links_are_the_published_ones():
    """Planar 2R, h = m2 L1 d2 sin q2: G_111 = 0, G_112 = G_121 = G_122 = -h, G_211 = h, the rest 0 (cases.md)."""
    dyn = general(2, "joint")
    ell_1, m_2, d_2 = (s for s in dyn.unknowns if str(s) in ("ell_1", "m_2", "d_2"))
    h = m_2 * ell_1 * d_2 * sp.sin(dyn.chain.q[1])
    assert dyn.christoffel.tolist() == [[[0, -h], [-h, -h]], [[h, 0], [0, 0]]]


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_the_parts_make_the_whole(n: int, angles: str):
    """M qdd + C qd + g = tau, whichever way it is grouped."""
    dyn = general(n, angles)
    qd, qdd = dyn.chain.qd, dyn.chain.qdd
    assert normal(dyn.M * qdd + dyn.C * qd + dyn.g - dyn.equations) == sp.zeros(n, 1)
    assert normal(dyn.C * qd + dyn.g - dyn.bias) == normal(dyn.coriolis + dyn.g - dyn.bias) == sp.zeros(n, 1)


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize("n", [1, 2, 3, 4])
def test_coriolis_forces_do_no_work_beside_that_of_Mdot(n: int, angles: str):
    """M is symmetric, and Mdot - 2 C skew."""
    dyn = general(n, angles)
    assert dyn.M == dyn.M.T
    assert (dyn.skew + dyn.skew.T).expand() == sp.zeros(n, n)


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize("n", [1, 2, 3])
def test_energy_changes_by_the_power_of_the_motors(n: int, angles: str):
    """d/dt (T + V) = tau . qd, and g is the gradient of V."""
    dyn = general(n, angles)
    power = (dyn.chain.qd.T * dyn.equations)[0]
    assert normal(dyn.energy.diff(dyn.chain.t) - power) == 0
    assert dyn.g.expand() == sp.Matrix([dyn.V.diff(x) for x in dyn.chain.q]).expand()


def test_the_inertia_of_two_links_is_positive_definite():
    """In symbols above zero: det M = mu_11 mu_22 - mu_12^2 cos^2 >= mu_11 mu_22 - mu_12^2, a sum of positive terms."""
    dyn = general(2, "segment")
    least = sp.expand(dyn.M.det()).subs(sp.cos(dyn.chain.q[0] - dyn.chain.q[1]), 1)
    assert all(term.is_positive for term in sp.Add.make_args(sp.expand(least)))


@pytest.mark.parametrize("angles", ANGLES)
def test_the_inertia_of_five_links_is_positive_definite(angles: str):
    """Eigenvalues of M at 1,000 random postures of uniform rods, stretched out and folded ones among them."""
    dyn = dynamics(Chain(5, lengths=[0.5, 0.4, 0.3, 0.4, 0.6], angles=angles), masses=[3, 1, 4, 1, 5], bodies="rods")
    q = np.random.default_rng(5).integers(-6, 7, (1000, 5)) * np.pi / 6
    assert np.linalg.eigvalsh(dyn.function(dyn.M)(q)).min() > 1e-4


@pytest.mark.parametrize(("one", "other"), [("joint", "segment"), ("joint", "vertical"), ("segment", "vertical")])
def test_a_motion_is_the_same_in_all_angles(one: str, other: str):
    """The power tau . qd, the energy, and accelerations carried over by the angle map."""
    weights = {"masses": [1.0, 2.0, 0.5], "centres": [0.3, 0.1, -0.2], "inertias": [0.1, 0.2, 0.3], "gravity": 9.81}
    a, b = (dynamics(Chain(3, lengths=[0.5, 0.4, 0.7], angles=word), **weights) for word in (one, other))
    to = a.chain.angle_map(other)
    q, qd, qdd = np.random.default_rng(0).uniform(-2.0, 2.0, (3, 50, 3))
    powers = [(d.inverse(*x) * x[1]).sum(axis=1) for d, x in ((a, (q, qd, qdd)), (b, (to(q), to.rates(qd), to.rates(qdd))))]
    assert np.abs(powers[0] - powers[1]).max() < 1e-11
    energies = a.function(a.energy)(q, qd), b.function(b.energy)(to(q), to.rates(qd))
    assert np.abs(energies[0] - energies[1]).max() < 1e-12
    assert np.abs(to.rates(a.forward(q, qd)) - b.forward(to(q), to.rates(qd))).max() < 1e-10


def test_inverse_dynamics_undo_forward_dynamics():
    """From tau to qdd to tau, one sample or many, and without motors."""
    dyn = dynamics(Chain(3, lengths=[0.5, 0.4, 0.3]), masses=[1.0, 1.0, 1.0], bodies="rods", gravity=9.81)
    q, qd, tau = np.random.default_rng(1).normal(size=(3, 7, 3))
    qdd = dyn.forward(q, qd, tau)
    assert np.abs(dyn.inverse(q, qd, qdd) - tau).max() < 1e-12
    assert np.abs(dyn.forward(q[3], qd[3], tau[3]) - qdd[3]).max() < 1e-12
    assert np.abs(dyn.inverse(q, qd, dyn.forward(q, qd))).max() < 1e-12
    assert dyn.forward(q, qd, tau[0]).shape == (7, 3)


def test_a_pendulum_of_one_link_is_that_of_every_book():
    """Its equation is m L^2 th'' + m g L sin th = tau; a flat one feels no gravity."""
    dyn = dynamics(Chain(1, lengths=[L], angles="vertical"), masses=[m], bodies="points")
    theta = dyn.chain.q[0]
    assert dyn.equations[0].expand() == m * L**2 * dyn.chain.qdd[0] + m * g * L * sp.sin(theta)
    flat = dynamics(Chain(1), gravity=0)
    assert flat.g == sp.zeros(1, 1) and flat.V == 0 and flat.C == sp.zeros(1, 1)
    flat = flat.subs({"ell_1": 1, "m_1": 1, "d_1": 1, "I_1": 0})
    assert flat.forward([0.3], [1.0], [2.0]) == flat.inverse([0.3], [1.0], [2.0]) == 2.0


def test_the_vertical_two_link_pendulum():
    """Problem 4 of the text with masses at the ends: the double pendulum's equations, gravity in -sin of each angle."""
    dyn = dynamics(Chain(2, angles="vertical"), bodies="points")
    chain = dyn.chain
    (a, b), (da, db), (dda, ddb) = chain.q, chain.qd, chain.qdd
    l1, l2, m1, m2, gravity = dyn.unknowns
    first = (m1 + m2) * l1**2 * dda + m2 * l1 * l2 * (sp.cos(a - b) * ddb + sp.sin(a - b) * db**2)
    second = m2 * l2**2 * ddb + m2 * l1 * l2 * (sp.cos(a - b) * dda - sp.sin(a - b) * da**2)
    weights = (m1 + m2) * gravity * l1 * sp.sin(a), m2 * gravity * l2 * sp.sin(b)
    expected = sp.Matrix([first + weights[0], second + weights[1]])
    assert (dyn.equations - expected).expand() == sp.zeros(2, 1)
    assert dyn.function(dyn.bias, parameters={s: 1.0 for s in dyn.unknowns})(np.zeros(2), np.zeros(2)).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("angles", ANGLES)
@pytest.mark.parametrize(("bodies", "squared"), [
    ("points", (2 - sp.sqrt(2), 2 + sp.sqrt(2))), ("rods", (3 - 6 / sp.sqrt(7), 3 + 6 / sp.sqrt(7))),
])  # fmt: skip
def test_modes_of_the_double_pendulum_are_the_published_ones(bodies: str, squared, angles: str):
    """Equal point masses: w^2 = (2 -/+ sqrt 2) g/L; equal uniform rods: (3 -/+ 6/sqrt 7) g/L (cases.md)."""
    linear = dynamics(Chain(2, lengths=[L, L], angles=angles), masses=[m, m], bodies=bodies).linearised()
    modes = linear.modes()
    assert all(sp.simplify(found - w2 * g / L) == 0 for found, w2 in zip(modes.squared, squared, strict=True))
    for k, w2 in enumerate(modes.squared):
        moved = (linear.K - w2 * linear.M) * modes.shapes[:, k]
        assert all(sp.simplify(entry) == 0 for entry in moved)
    assert linear.holding == sp.zeros(2, 1)


def test_modes_in_numbers_are_those_in_symbols():
    """The same double pendulum with numbers; the shapes are orthogonal in M, frequencies in hertz."""
    dyn = dynamics(Chain(2), bodies="points")
    numbers = {"ell_1": 0.7, "ell_2": 0.4, "m_1": 2.0, "m_2": 0.5, "g": 9.81}
    symbols = [float(w2.subs({s: numbers[str(s)] for s in dyn.unknowns})) for w2 in dyn.linearised().modes().squared]
    linear = dyn.subs(numbers).linearised()
    modes = linear.modes()
    assert np.abs(modes.squared - symbols).max() < 1e-12 * max(symbols)
    assert np.abs(modes.frequencies - np.sqrt(symbols) / (2 * np.pi)).max() < 1e-12
    between = modes.shapes.T @ np.array(linear.M, dtype=float) @ modes.shapes
    assert abs(between[0, 1]) < 1e-13


def test_a_chain_stood_on_its_end_falls():
    """Upright, K is minus the hanging one: all w^2 change their sign; stretched out it needs holding."""
    dyn = dynamics(Chain(3, lengths=[1, 1, 1], angles="vertical"), masses=[1, 1, 1], bodies="rods", gravity=9.81)
    hanging, upright = dyn.linearised().modes(), dyn.linearised([sp.pi] * 3).modes()
    assert np.abs(upright.squared + hanging.squared[::-1]).max() < 1e-12
    assert np.isnan(upright.frequencies).all()
    held = dyn.linearised([sp.pi / 2, 0, 0]).holding
    assert held[0].evalf() == pytest.approx(2.5 * 9.81) and held[1:, 0] == sp.zeros(2, 1)


def test_uncoupled_links_swing_by_themselves():
    """A second link balanced on its joint: it has w = 0, and the first link its own frequency."""
    dyn = dynamics(Chain(2, angles="vertical"), centres=[L, 0], masses=[m, m], inertias=[0, m * L**2])
    ell_1 = dyn.chain.lengths[0]
    modes = dyn.linearised().modes()
    assert sp.simplify(modes.squared[0] - g * (L + ell_1) / (L**2 + ell_1**2)) == 0 == modes.squared[1]
    assert modes.shapes == sp.eye(2)


def test_many_small_links_swing_as_a_chain_does():
    """Hanging chain of length 1: w = j_01 / 2 sqrt(g/L) = 1.2024 sqrt(g) (Daniel Bernoulli); 8 rods come within 1 %."""
    n = 8
    dyn = dynamics(Chain(n, lengths=[1 / n] * n, angles="vertical"), masses=[1 / n] * n, bodies="rods", gravity=9.81)
    assert np.sqrt(dyn.linearised().modes().squared[0] / 9.81) == pytest.approx(1.2024, rel=0.01)


def test_four_links_are_derived_in_no_time():
    """From an empty cache of SymPy 297,954 calls were counted, a third of a second; `make bench` has the time, 20 s at most."""
    clear_cache()
    assert calls(lambda: dynamics(Chain(4))) < 600_000


def test_the_equations_have_latex():
    """M, C, g with Newton's dots, as one aligned block that a notebook shows."""
    dyn = general(2, "joint")
    text = dyn.latex()
    for part in (r"\begin{aligned}", r"\mathbf{M}", r"\dot{\theta}_{2}", r"\ell_{1}", "m_{2}", r"\end{aligned}"):
        assert part in text
    assert text in dyn._repr_latex_() and text.count(r"\\") >= 3


@pytest.mark.parametrize(("given", "told"), [
    ({"masses": [1.0]}, "masses has 1 entries; expected 2"),
    ({"masses": 1.0}, "expected 2 numbers"),
    ({"masses": "ab"}, "expected 2 numbers"),
    ({"masses": [1.0, 0.0]}, "mass of link 2 is 0; expected a mass above zero"),
    ({"masses": [-1.0, 1.0]}, "mass of link 1"),
    ({"masses": [sp.Symbol("m", negative=True), 1.0]}, "mass of link 1"),
    ({"masses": [float("nan"), 1.0]}, "finite"),
    ({"masses": [1e300, 1.0]}, "at most"),
    ({"masses": [True, 1.0]}, "finite"),
    ({"masses": ["m", 1.0]}, "finite"),
    ({"masses": [sp.I, 1.0]}, "real"),
    ({"masses": [sp.oo, 1.0]}, "finite"),
    ({"masses": [1 + 2j, 1.0]}, "finite"),
    ({"masses": [Chain(1).q[0], 1.0]}, "depends on time"),
    ({"masses": [sp.Function("m_1")(sp.Symbol("t", real=True)), 1.0]}, "depends on time"),  # a time of one's own
    ({"inertias": [0.0, -1e-9]}, "inertia of link 2"),
    ({"centres": [0.1, np.inf]}, "finite"),
    ({"centres": [0.1, None]}, "finite"),
    ({"gravity": -9.81}, "gravity"),
    ({"gravity": "down"}, "gravity"),
    ({"gravity": [0.0, -9.81]}, "gravity"),
    ({"bodies": "balls"}, "expected 'points', 'rods'"),
    ({"bodies": ["rods"]}, "expected 'points', 'rods'"),
    ({"bodies": "rods", "centres": [0.1, 0.1]}, "leave centres and inertias out"),
])  # fmt: skip
def test_bodies_that_are_none_are_refused(given: dict, told: str):
    """The message names the link and says what was expected."""
    with pytest.raises(InputError, match=told):
        dynamics(Chain(2), **given)


def test_symbols_that_are_left_are_named():
    """Numbers are asked of symbols: all of them are named, and how to put numbers in."""
    dyn = dynamics(Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0], inertias=[0.1, 0.1])
    zero = np.zeros(2)
    for ask in (lambda: dyn.forward(zero, zero), lambda: dyn.inverse(zero, zero, zero), lambda: to_robot(dyn)):
        with pytest.raises(InputError, match=r"still symbols: d_1, d_2, g\. .*subs\(|still symbols: d_1, d_2, g\. .*values="):
            ask()
    with pytest.raises(InputError, match="d_1"):
        dyn.function(dyn.M)
    with pytest.raises(InputError, match="3 links.*m_1"):
        dynamics(Chain(3)).linearised().modes()
    with pytest.raises(InputError, match="g"):
        _ = dynamics(Chain(1)).linearised().modes().frequencies
    done = dyn.subs({"d_1": 0.5, dyn.unknowns[1]: 0.5, "g": 9.81})
    assert done.unknowns == () and done.forward(zero, zero).shape == (2,)


@pytest.mark.parametrize(("values", "told"), [
    ({"x": 1.0}, "no symbol of these dynamics; its symbols: ell_1, ell_2, m_1"),
    ({sp.Symbol("m_1"): 1.0}, "no symbol"),  # another symbol of that name, not known to be positive
    ({"m_1": 0.0}, "mass of link 1"),
    ({"ell_1": -1.0}, "length of link 1"),
    ({"g": -1.0}, "gravity"),
    ({"I_2": float("nan")}, "finite"),
    ({"m_2": Chain(1).q[0]}, "the value of m_2 is .*, which depends on time"),
    ([("m_1", 1.0)], "expected {symbol: number}"),
])  # fmt: skip
def test_numbers_that_do_not_fit_are_refused(values, told: str):
    """What subs takes is what the constructor takes."""
    with pytest.raises(InputError, match=told):
        dynamics(Chain(2)).subs(values)


@pytest.mark.parametrize(("q", "qd", "tau"), [
    ([0.0], [0.0, 0.0], None),
    ([0.0, 0.0], [0.0], None),
    ([0.0, np.nan], [0.0, 0.0], None),
    ([0.0, 0.0], [0.0, np.inf], None),
    (np.zeros((3, 2)), np.zeros((4, 2)), None),
    ([0.0, 0.0], [0.0, 0.0], [1.0]),
    ([0.0, 0.0], [0.0, 0.0], np.zeros((3, 2))),
    (np.zeros((3, 2)), np.zeros((3, 2)), np.zeros((4, 2))),
    ("ab", [0.0, 0.0], None),
    ([0.0, 0.0], None, None),
])  # fmt: skip
def test_states_that_do_not_fit_are_refused(q, qd, tau):
    """Shapes and numbers of q, qd and tau."""
    dyn = dynamics(Chain(2, lengths=[1, 1]), masses=[1, 1], bodies="rods", gravity=0)
    with pytest.raises(InputError):
        dyn.forward(q, qd, tau)


def test_a_link_that_moves_no_mass_is_refused():
    """The last link's mass at its joint, without inertia: M is singular, in numbers and in symbols."""
    dyn = dynamics(Chain(2, lengths=[1, 1]), masses=[1, 1], centres=[1, 0], inertias=[0, 0], gravity=9.81)
    for ask in (lambda: dyn.forward([0.1, 0.2], [0.0, 0.0]), dyn.linearised().modes):
        with pytest.raises(SingularInertia, match="singular"):
            ask()
    with pytest.raises(SingularInertia):
        dynamics(Chain(2), centres=[1, 0], inertias=[0, 0]).linearised().modes()
    # Mass at joint 2 and at the end: regular, but where the links are in line both ways round
    dyn = dynamics(Chain(2, lengths=[1, 1]), masses=[1, 1], centres=[0, 1], inertias=[0, 0], gravity=9.81)
    assert np.isfinite(dyn.forward([0.1, 0.2], [0.0, 0.0])).all()
    with pytest.raises(SingularInertia):
        dyn.forward([[0.1, 0.2], [0.1, 0.0]], np.zeros((2, 2)))


@pytest.mark.parametrize("posture", [[0.0], "ab", 1.0, [0.0, np.nan], [0.0, Chain(1).q[0]]])
def test_a_posture_is_n_angles(posture):
    """Small motion is about n finite angles that do not move."""
    with pytest.raises(InputError):
        dynamics(Chain(2)).linearised(posture)


def test_bodies_are_what_they_are_called():
    """Points and rods by their formulas; a rod's inertia about its joint is m L^2 / 3."""
    chain = Chain(1, lengths=[L])
    rod, point = bodies_of(chain, bodies="rods", masses=[m]), bodies_of(chain, bodies="points", masses=[m])
    assert rod.coupling(0, 0) == m * L**2 / 3 and point.coupling(0, 0) == m * L**2
    assert rod.first_moments == (m * L / 2,) and point.centres == (L,)
    assert bodies_of(Chain(1), masses=[0.1]).masses == (sp.Rational(1, 10),)


def test_modes_agree_with_a_general_eigenvalue_solver():
    """Symbolic M and K of four links with numbers put in, against LAPACK on finite differences of the forces."""
    n = 4
    dyn = dynamics(Chain(n, lengths=[0.4, 0.3, 0.5, 0.2]), masses=[1, 2, 1, 3], bodies="rods", gravity=9.81)
    at, h = np.array([-np.pi / 2, 0, 0, 0]), 1e-5
    rest = np.zeros((n, n))
    K = (dyn.inverse(at + h * np.eye(n), rest, rest) - dyn.inverse(at - h * np.eye(n), rest, rest)) / (2 * h)
    M = dyn.inverse(np.tile(at, (n, 1)), rest, np.eye(n)) - dyn.inverse(at, rest[0], rest[0])
    assert np.abs(dyn.linearised().modes().squared - scipy.linalg.eigh(K, M, eigvals_only=True)).max() < 1e-5
