"""A chain of n links in symbols: its motion twice over, its Jacobian, where it is singular, how it is written."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
import sympy
from sympy import Rational, cos, sin

from rbd.errors import InputError
from rbd.planar.angles import CONVENTIONS
from rbd.planar.chain import Chain

CASES = [(n, word) for n in (1, 2, 3, 4) for word in CONVENTIONS]
ORDERS = ("position", "velocity", "acceleration", "jerk")


def vanishes(matrix) -> bool:
    """Whether it expands to zero; all forms have the same sines and cosines in them."""
    return sympy.expand(matrix) == sympy.zeros(*matrix.shape)


@pytest.mark.parametrize(("n", "word"), CASES)
def test_derivatives_and_jacobian_give_the_same_motion(n, word):
    """The derivatives of r are v = J qd, a = Jd qd + J qdd, j = Jdd qd + 2 Jd qdd + J qddd, whatever the angles."""
    chain = Chain(n, angles=word)
    r = chain.position()
    assert vanishes(chain.jacobian() - r.jacobian(chain.q))
    assert vanishes(chain.jacobian_rate() - chain.jacobian().diff(chain.t))
    for order, name in enumerate(ORDERS[1:], 1):
        ours, again = getattr(chain, name)(), getattr(chain, f"{name}_by_jacobian")()
        assert vanishes(ours - r.diff(chain.t, order))
        assert vanishes(again - ours)


@pytest.mark.parametrize("word", CONVENTIONS)
def test_five_links_move_alike_by_both_ways_in_numbers(word):
    """The same for n = 5, at 200 random states."""
    chain = Chain(5, lengths=(0.3, 0.5, 0.2, 0.7, 0.4), angles=word)
    state = np.random.default_rng(0).normal(size=(4, 200, 5))
    for order, name in enumerate(ORDERS[1:], 1):
        by_time = chain.function(chain.position().diff(chain.t, order))(*state)
        for form in (getattr(chain, name)(), getattr(chain, f"{name}_by_jacobian")()):
            assert np.abs(chain.function(form)(*state) - by_time).max() < 1e-11 * (1.0 + np.abs(by_time).max())


@pytest.mark.parametrize(("n", "word"), CASES)
def test_every_joint_is_the_end_of_a_shorter_chain(n, word):
    """What joint i does, the end point of the first i links does; the base does nothing."""
    chain = Chain(n, angles=word)
    for i in range(1, n + 1):
        shorter = Chain(i, angles=word)
        for name in ORDERS:
            assert getattr(chain, name)(i) == getattr(shorter, name)()
        assert chain.jacobian(i)[:, :i] == shorter.jacobian()
        assert chain.jacobian(i)[:, i:] == sympy.zeros(2, n - i)
    for name in (*ORDERS, "velocity_by_jacobian", "acceleration_by_jacobian", "jerk_by_jacobian"):
        assert getattr(chain, name)(0) == sympy.zeros(2, 1)


def test_one_link_is_the_circular_motion_of_the_text():
    """[Duarte2021], one link: v = l th' along the tangent; a = l th'' along it and l th'^2 towards the hinge."""
    chain = Chain(1)
    (ell,), th, w, alpha = chain.lengths, chain.q[0], chain.qd[0], chain.qdd[0]
    assert chain.velocity() == sympy.Matrix([-ell * sin(th) * w, ell * cos(th) * w])
    along, inward = sympy.Matrix([-sin(th), cos(th)]), -sympy.Matrix([cos(th), sin(th)])
    assert vanishes(chain.acceleration() - ell * (alpha * along + w**2 * inward))
    assert sympy.simplify(chain.velocity().dot(chain.velocity())) == ell**2 * w**2
    assert sympy.simplify(chain.acceleration().dot(chain.position())) == -(ell**2) * w**2


def test_the_velocity_of_one_link_is_its_angular_velocity_cross_its_position():
    """Right-hand rule: omega = th' k, out of the plane for a counterclockwise turn, and v = omega x r."""
    chain = Chain(1)
    omega, r = sympy.Matrix([0, 0, chain.qd[0]]), sympy.Matrix([*chain.position(), 0])
    assert vanishes(omega.cross(r) - sympy.Matrix([*chain.velocity(), 0]))


@pytest.mark.parametrize("n", [2, 3])
def test_velocities_add_from_joint_to_joint(n):
    """Relative velocity: each link adds (th1' + .. + thk') k x (joint k+1 - joint k) to the velocity of the joint before it."""
    chain = Chain(n)
    for k in range(n):
        omega = sympy.Matrix([0, 0, sum(chain.qd[: k + 1])])
        link = sympy.Matrix([*(chain.position(k + 1) - chain.position(k)), 0])
        relative = chain.velocity(k + 1) - chain.velocity(k)
        assert vanishes(omega.cross(link) - sympy.Matrix([*relative, 0]))


def test_the_printed_relative_velocity_of_the_text_lacks_a_rate():
    """[Duarte2021] prints l2 cos(th1 + th2) th1' for the y component; both rates turn the second link."""
    chain = Chain(2)
    (_, b), (th1, th2), (w1, w2) = chain.lengths, chain.q, chain.qd
    relative = chain.velocity() - chain.velocity(1)
    assert sympy.expand(relative[1] - b * cos(th1 + th2) * (w1 + w2)) == 0
    assert sympy.expand(relative[1] - b * cos(th1 + th2) * w1) == b * cos(th1 + th2) * w2


def test_two_links_have_the_position_and_jacobian_of_the_text():
    """[Duarte2021], two links, Out[23] and Out[27]."""
    chain = Chain(2)
    (a, b), (th1, th2) = chain.lengths, chain.q
    assert chain.position() == sympy.Matrix([a * cos(th1) + b * cos(th1 + th2), a * sin(th1) + b * sin(th1 + th2)])
    assert chain.jacobian() == sympy.Matrix(
        [[-a * sin(th1) - b * sin(th1 + th2), -b * sin(th1 + th2)], [a * cos(th1) + b * cos(th1 + th2), b * cos(th1 + th2)]]
    )


@pytest.mark.parametrize("n", [2, 4])
def test_links_in_absolute_angles_are_complex_numbers_that_add_up(n):
    """The end is the sum of L_i e^(i th_i), cosines real and sines imaginary; column i of J is L_i (-sin th_i, cos th_i)."""
    chain = Chain(n, angles="segment")
    # e^(i th) by its series of the exponential, not by sine and cosine.
    at = {angle: sympy.Rational(k + 1, 3) for k, angle in enumerate(chain.q)}
    lengths = {length: k + 2 for k, length in enumerate(chain.lengths)}
    total = sum(lengths[ell] * sympy.exp(sympy.I * at[th]).evalf(30) for ell, th in zip(chain.lengths, chain.q, strict=True))
    x, y = (complex(entry.subs(at).subs(lengths)) for entry in chain.position())
    assert abs(x + 1j * y - complex(total)) < 1e-14
    columns = [[-ell * sin(th), ell * cos(th)] for ell, th in zip(chain.lengths, chain.q, strict=True)]
    assert chain.jacobian() == sympy.Matrix(columns).T


def test_the_printed_acceleration_of_the_text_is_wrong_and_ours_is_right():
    """[Duarte2021], Out[25], lost its brackets: l2 th1' + th2'^2 cos(..) where l2 (th1' + th2')^2 cos(..) belongs."""
    chain = Chain(2)
    (a, b), (th1, th2), (w1, w2), (u1, u2) = chain.lengths, chain.q, chain.qd, chain.qdd
    s1, c1, s12, c12 = sin(th1), cos(th1), sin(th1 + th2), cos(th1 + th2)
    printed = sympy.Matrix(
        [
            -(a * s1 * u1 + a * c1 * w1**2 + b * w1 + w2**2 * c12 + b * (u1 + u2) * s12),
            -a * s1 * w1**2 + a * c1 * u1 - b * w1 + w2**2 * s12 + b * (u1 + u2) * c12,
        ]
    )
    mended = sympy.Matrix(
        [
            -(a * s1 * u1 + a * c1 * w1**2 + b * (w1 + w2) ** 2 * c12 + b * (u1 + u2) * s12),
            -a * s1 * w1**2 + a * c1 * u1 - b * (w1 + w2) ** 2 * s12 + b * (u1 + u2) * c12,
        ]
    )
    derived = chain.position().diff(chain.t, 2)
    assert vanishes(chain.acceleration() - derived) and vanishes(mended - derived)
    # Both links along x, the first one turning at 2 rad/s: -4 (a + b) towards the base, the print says -4 a - 2 b.
    turning = {u1: 0, u2: 0, w1: 2, w2: 0, th1: 0, th2: 0}
    spun = [form.subs({**turning}).doit() for form in (derived, chain.acceleration(), printed)]
    assert spun[0][0] == spun[1][0] == -4 * a - 4 * b
    assert spun[2][0] == -4 * a - 2 * b


@pytest.mark.parametrize("word", CONVENTIONS)
def test_expressions_have_one_term_per_link(word):
    """Sums over segments stay sums over segments, and are never longer in print than SymPy's own derivative."""
    chain = Chain(4, angles=word)
    for order, name in enumerate(ORDERS):
        ours, plain = getattr(chain, name)(), chain.position().diff(chain.t, order)
        assert all(len(sympy.Add.make_args(row)) == 4 for row in ours)
        assert len(str(ours)) <= len(str(plain))


def test_two_links_are_singular_when_stretched_or_folded():
    """The determinant is l1 l2 sin th2 in joint angles, l1 l2 sin(th2 - th1) in the others."""
    joint, segment, vertical = (Chain(2, angles=word) for word in CONVENTIONS)
    a, b = joint.lengths
    th1, th2 = joint.q
    assert joint.determinant() == a * b * sin(th2)
    assert segment.determinant() == vertical.determinant() == a * b * sin(th2 - th1)
    assert joint.singular_configurations() == (sympy.Eq(sin(th2), 0),)
    for chain in (joint, segment, vertical):
        assert sympy.simplify(chain.jacobian().det() - chain.determinant()) == 0


@pytest.mark.parametrize("word", CONVENTIONS)
@pytest.mark.parametrize("n", [3, 4, 6, 7])
def test_the_determinant_of_more_links_is_that_of_j_jt(n, word):
    """Sums of squared minors (up to six links), and the rows' Gram determinant (more), against NumPy's."""
    chain = Chain(n, lengths=np.linspace(0.3, 0.8, n), angles=word)
    q = np.random.default_rng(3).normal(size=(20, n))
    J = chain.numeric.jacobian(q)
    assert np.allclose(chain.function(chain.determinant())(q), np.linalg.det(J @ J.swapaxes(1, 2)), rtol=1e-10, atol=1e-14)


def test_one_link_never_loses_the_rank_it_has():
    """J of one link is a tangent of length l: det(J^T J) = l^2, and no singular configuration."""
    chain = Chain(1)
    assert chain.determinant() == chain.lengths[0] ** 2 == sympy.simplify((chain.jacobian().T * chain.jacobian())[0])
    assert chain.singular_configurations() == ()


@pytest.mark.parametrize("word", CONVENTIONS)
@pytest.mark.parametrize("n", [2, 3, 5])
def test_a_chain_is_singular_exactly_when_all_links_are_on_a_line(n, word):
    """Every way to stretch and fold loses a direction and meets the conditions; one link off the line does neither."""
    chain = Chain(n, lengths=np.linspace(0.4, 0.9, n), angles=word)
    conditions = chain.function(sympy.Matrix([condition.lhs for condition in chain.singular_configurations()]))
    rng = np.random.default_rng(4)
    for _ in range(10):
        phi = rng.normal() + np.pi * rng.integers(0, 2, size=n)
        on_line = Chain(n, angles="segment").convert(phi, word)
        phi[rng.integers(n)] += 0.3
        off_line = Chain(n, angles="segment").convert(phi, word)
        assert np.linalg.svd(chain.numeric.jacobian(on_line))[1][-1] < 1e-14 > np.abs(conditions(on_line)).max() - 1e-14
        assert np.linalg.svd(chain.numeric.jacobian(off_line))[1][-1] > 0.01 < np.abs(conditions(off_line)).max()


def test_latex_has_ell_theta_and_newtons_dots():
    r"""\ell_{1}, \theta_{1}, \dot, \ddot and \dddot; no time in brackets."""
    chain = Chain(2)
    assert chain.latex(chain.qddd) == r"\left[\begin{matrix}\dddot{\theta}_{1}\\\dddot{\theta}_{2}\end{matrix}\right]"
    written = chain.latex(chain.acceleration())
    for piece in (r"\ell_{1}", r"\ell_{2}", r"\ddot{\theta}_{1}", r"\left(\dot{\theta}_{1} + \dot{\theta}_{2}\right)^{2}"):
        assert piece in written
    assert "(t)" not in written and "Derivative" not in written and "frac{d" not in written
    assert chain.latex(chain.determinant()) == r"\ell_{1} \ell_{2} \sin{\left(\theta_{2} \right)}"
    assert chain.latex(chain.singular_configurations()) == r"\sin{\left(\theta_{2} \right)} = 0"
    assert [part in chain.latex(chain.split()) for part in ("Tangential", "Centripetal", "Coriolis")] == [True] * 3


def test_notebooks_typeset_chains_splits_and_formulas():
    """`_repr_latex_` gives what is between dollars."""
    chain = Chain(2)
    for shown in (chain, chain.split(), chain.formula(chain.velocity())):
        assert shown._repr_latex_().startswith(r"$\displaystyle") and shown._repr_latex_().endswith("$")
    assert str(chain.formula(chain.velocity())) == chain.latex(chain.velocity())


@pytest.mark.parametrize("expr", ["x", None, object(), True, ()])
def test_what_has_no_latex_is_refused(expr):
    """Expressions, matrices, equations and splits; nothing else."""
    for write in (Chain(2).latex, Chain(2).formula):
        with pytest.raises(InputError, match="has no LaTeX"):
            write(expr)


def test_lengths_may_be_numbers_symbols_or_both():
    """Decimals stay exact, so that identities do; symbols of the user's own are taken."""
    ell = sympy.Symbol("ell", positive=True)
    assert Chain(3, lengths=[0.1, np.float64(0.5), 2]).lengths == (Rational(1, 10), Rational(1, 2), sympy.Integer(2))
    assert Chain(2, lengths=(ell, ell / 2)).determinant() == ell**2 * sin(Chain(2).q[1]) / 2
    assert Chain(2, lengths=(ell, sympy.sqrt(2))).lengths[1] == sympy.sqrt(2)
    assert float(Chain(1, lengths=[1 / 3]).lengths[0]) == 1 / 3


def test_chains_are_values():
    """Equal chains are equal, hashable, copied by dataclasses.replace, pickled, and never changed."""
    chain = Chain(2, lengths=(0.5, 0.5))
    assert chain == Chain(2, lengths=[0.5, 0.5]) and hash(chain) == hash(Chain(2, lengths=[0.5, 0.5]))
    assert chain != Chain(2) and chain != chain.with_angles("segment")
    assert dataclasses.replace(Chain(2), lengths=(0.5, 0.5)) == chain == Chain(2).with_lengths((0.5, 0.5))
    assert pickle.loads(pickle.dumps(chain)) == chain
    assert Chain(2).q == Chain(2).q
    with pytest.raises(dataclasses.FrozenInstanceError):
        chain.n = 3


@pytest.mark.parametrize("n", [0, -1, 51, 2.0, 2.5, True, "2", None, np.nan, 10**400, [2], sympy.Symbol("n")])
def test_a_number_of_links_is_whole_and_positive(n):
    """1 to 50, and no truth value or decimal."""
    with pytest.raises(InputError, match="expected a whole number of links, 1 to 50"):
        Chain(n)


@pytest.mark.parametrize(
    "lengths",
    [(1.0,), (1, 2, 3), 1.0, "ab", (1.0, 0.0), (1.0, -0.5), (1.0, np.nan), (1.0, np.inf), (1.0, 1e300), (True, 1.0), (1, "2"),
     (1, None), (1, 1j), (1, sympy.I), (1, sympy.oo), (1, sympy.zoo), (1, sympy.Symbol("k", negative=True)), (1, 10**400),
     (1, sympy.Symbol("t")), (1, sympy.Function("f")(sympy.Symbol("s"))), {1: 2, 3: 4}, [[1.0, 2.0], [1.0, 2.0]]],
)  # fmt: skip
def test_lengths_are_one_positive_finite_constant_per_link(lengths):
    """Wrong counts, zero, negative, infinite, complex or moving lengths are refused."""
    with pytest.raises(InputError, match="length"):
        Chain(2, lengths=lengths)


@pytest.mark.parametrize("i", [-1, 3, 1.0, True, "1", [0], np.nan, 10**400])
def test_a_joint_that_is_not_there_is_refused(i):
    """Joints 0 to n; None is the end point."""
    chain = Chain(2, lengths=(0.5, 0.5))
    asked = [getattr(chain, name) for name in (*ORDERS, "jacobian", "jacobian_rate", "jerk_by_jacobian", "split")]
    for ask in (*asked, lambda i: chain.numeric.position([0, 0], i), lambda i: chain.ellipse([0, 0], i=i)):
        with pytest.raises(InputError, match="there is no joint"):
            ask(i)
