"""The end point's acceleration in its tangential, centripetal and Coriolis parts."""

from __future__ import annotations

import numpy as np
import pytest
import sympy
from sympy import cos, sin

from rbd.planar.angles import CONVENTIONS
from rbd.planar.chain import Chain

CASES = [(n, word) for n in (1, 2, 3, 4) for word in CONVENTIONS]


@pytest.mark.parametrize(("n", "word"), CASES)
def test_the_parts_sum_to_the_whole(n, word):
    """Tangential + centripetal + Coriolis = d2r/dt2, for every joint."""
    chain = Chain(n, angles=word)
    for i in range(n + 1):
        assert sympy.expand(chain.split(i).total - chain.position(i).diff(chain.t, 2)) == sympy.zeros(2, 1)


@pytest.mark.parametrize(("n", "word"), CASES)
def test_each_part_has_its_own_kind_of_term(n, word):
    """By degree: th'' alone; th_i'^2 alone; th_i' th_j' of two angles alone, read off the expanded derivative."""
    chain = Chain(n, angles=word)
    parts, whole = chain.split(), sympy.expand(chain.position().diff(chain.t, 2))
    still, steady = {rate: 0 for rate in chain.qd}, {rate: 0 for rate in chain.qdd}
    names = sympy.symbols(f"w_1:{n + 1}")
    flat = whole.xreplace(steady).xreplace(dict(zip(chain.qd, names, strict=True)))
    squares = sum((flat.applyfunc(lambda x, w=w: sympy.expand(x).coeff(w, 2)) * w**2 for w in names), sympy.zeros(2, 1))
    back = dict(zip(names, chain.qd, strict=True))
    assert sympy.expand(parts.tangential - whole.xreplace(still)) == sympy.zeros(2, 1)
    assert sympy.expand(parts.centripetal - squares.xreplace(back)) == sympy.zeros(2, 1)
    assert sympy.expand(parts.coriolis - (flat - squares).xreplace(back)) == sympy.zeros(2, 1)


def test_two_links_split_as_in_the_text():
    """[Duarte2021], Out[26]: the three printed matrices, which have kept their brackets."""
    chain = Chain(2)
    (a, b), (th1, th2), (w1, w2), (u1, u2) = chain.lengths, chain.q, chain.qd, chain.qdd
    s, c = a * sin(th1) + b * sin(th1 + th2), a * cos(th1) + b * cos(th1 + th2)
    parts = chain.split()
    assert parts.tangential.equals(sympy.Matrix([-b * sin(th1 + th2) * u2 - s * u1, b * cos(th1 + th2) * u2 + c * u1]))
    inward, second = -sympy.Matrix([c, s]), -b * sympy.Matrix([cos(th1 + th2), sin(th1 + th2)])
    assert sympy.expand(parts.centripetal - inward * w1**2 - second * w2**2) == sympy.zeros(2, 1)
    assert sympy.expand(parts.coriolis - 2 * second * w1 * w2) == sympy.zeros(2, 1)


@pytest.mark.parametrize("n", [1, 2, 4])
def test_segment_angles_have_no_coriolis_part(n):
    """Every link turns by its own angle alone: no product of two rates, in segment angles and from the vertical."""
    for word in ("segment", "vertical"):
        parts = Chain(n, angles=word).split()
        assert parts.coriolis == sympy.zeros(2, 1)
        assert "no Coriolis part" in parts.note
    assert Chain(1).split().coriolis == sympy.zeros(2, 1)
    assert Chain(3).split().coriolis != sympy.zeros(2, 1)


def test_the_coriolis_part_of_two_links_is_across_the_relative_velocity():
    """[Duarte2021]: perpendicular to v - v_joint2; it points along the second link."""
    chain = Chain(2)
    relative = chain.velocity() - chain.velocity(1)
    assert sympy.expand(chain.split().coriolis.dot(relative)) == 0


def test_the_coriolis_part_is_twice_omega_cross_the_velocity_seen_from_link_1():
    """2 omega x v: omega of the first link, v of the end point for an observer who turns with that link."""
    chain = Chain(2)
    seen = sympy.Matrix([*(chain.velocity() - chain.velocity().subs(chain.qd[1], 0)), 0])
    omega = sympy.Matrix([0, 0, chain.qd[0]])
    assert sympy.expand(2 * omega.cross(seen) - sympy.Matrix([*chain.split().coriolis, 0])) == sympy.zeros(3, 1)


def test_the_coriolis_part_needs_no_change_of_the_distance_to_the_base():
    """[Duarte2021] says it occurs when a distance varies: stretched out, it does not vary, and the part is largest along x."""
    arm = Chain(2, lengths=(1, 1)).numeric
    stretched, rates = np.zeros(2), np.array([2.0, 3.0])
    assert arm.position(stretched) @ arm.velocity(stretched, rates) == 0.0
    coriolis = arm.split(stretched, rates, np.zeros(2)).coriolis
    np.testing.assert_allclose(coriolis, [-2.0 * 2.0 * 3.0, 0.0], atol=1e-12)


def test_centripetal_terms_point_to_the_joint_that_turns():
    """Joint angles: with one rate alone and no acceleration, a = -rate^2 (P - joint), whichever joint turns."""
    chain = Chain(5, lengths=(0.3, 0.5, 0.2, 0.7, 0.4))
    q = np.random.default_rng(0).normal(size=5)
    joints = chain.numeric.positions(q)
    for i in range(5):
        parts = chain.numeric.split(q, 2.0 * np.eye(5)[i], np.zeros(5))
        assert np.abs(parts.centripetal + 4.0 * (joints[-1] - joints[i])).max() < 1e-14
        assert not parts.coriolis.any() and not parts.tangential.any()


@pytest.mark.parametrize("word", CONVENTIONS)
@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_numbers_split_as_the_symbols_do(n, word):
    """`chain.numeric.split` is written from the structure; the symbols are the other implementation."""
    chain = Chain(n, lengths=np.linspace(0.3, 0.8, n), angles=word)
    state = np.random.default_rng(1).normal(size=(3, 100, n))
    for i in range(n + 1):
        ours, symbols = chain.numeric.split(*state, i=i), chain.split(i)
        for part in ("tangential", "centripetal", "coriolis"):
            assert np.abs(getattr(ours, part) - chain.function(getattr(symbols, part))(*state)).max() < 1e-13
        assert np.abs(ours.total - chain.numeric.acceleration(*state, i=i)).max() < 1e-13


def test_the_parts_depend_on_the_angles_and_their_sum_does_not():
    """Joint 2 turning against joint 1: the second segment keeps its direction, and segment angles see no turning of it."""
    joint = Chain(2, lengths=(1.0, 1.0))
    segment, to = joint.with_angles("segment"), joint.angle_map("segment")
    q, qd, qdd = np.array([0.0, np.pi / 2]), np.array([1.0, -1.0]), np.zeros(2)
    here, there = joint.numeric.split(q, qd, qdd), segment.numeric.split(to(q), to.rates(qd), to.rates(qdd))
    assert np.allclose(here.total, [-1.0, 0.0], atol=1e-15) and np.allclose(there.total, here.total, atol=1e-15)
    assert np.allclose(here.coriolis, [0.0, 2.0], atol=1e-15) and not there.coriolis.any()
    assert np.allclose(here.centripetal, [-1.0, -2.0], atol=1e-15)
    assert np.allclose(there.centripetal, [-1.0, 0.0], atol=1e-15)
