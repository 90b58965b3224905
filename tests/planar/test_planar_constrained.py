"""Chains under relations: the text's problems 2 and 3, and relations of any kind against the full chain."""

from __future__ import annotations

import numpy as np
import pytest
import sympy
from sympy import cos, pi, sin

from rbd.errors import InputError, NoSolution
from rbd.planar import Chain, constrained

ELL = sympy.Symbol("ell", positive=True)
EQUAL = Chain(2, lengths=(ELL, ELL))
TH1, TH2 = EQUAL.q
T = EQUAL.t


def same(one, other) -> bool:
    """Whether two symbolic columns are equal."""
    return (one - sympy.Matrix(other)).applyfunc(sympy.simplify).is_zero_matrix


class TestProblems:
    """Expressions a student finds by hand."""

    def test_first_joint_held(self):
        """Problem 2a: a circle of radius ell_2 about (ell_1, 0): as one link, moved."""
        chain = Chain(2)
        held, (l1, l2), th = constrained(chain, {1: 0}), chain.lengths, chain.q[1]
        assert held.mobility == 1 and list(held.free) == [th]
        assert same(held.position(), [l1 + l2 * cos(th), l2 * sin(th)])
        assert same(held.jacobian(), [-l2 * sin(th), l2 * cos(th)])
        split = held.split()
        assert same(split.tangential, [-l2 * sin(th) * th.diff(T, 2), l2 * cos(th) * th.diff(T, 2)])
        assert same(split.centripetal, [-l2 * cos(th) * th.diff(T) ** 2, -l2 * sin(th) * th.diff(T) ** 2])
        assert split.coriolis.is_zero_matrix and "one free angle" in split.note

    def test_second_joint_held(self):
        """Problem 2b: one link of length ell_1 + ell_2."""
        chain = Chain(2)
        held, one = constrained(chain, {chain.q[1]: 0}), Chain(1, lengths=[sum(Chain(2).lengths)])
        for name in ("position", "velocity", "acceleration", "jerk", "jacobian"):
            assert same(getattr(held, name)(), getattr(one, name)())

    def test_polar_manipulator(self):
        """Problem 3: x = 0, y = 2 ell sin(theta_1): on a line through the base, with J = (0, 2 ell cos(theta_1))."""
        polar = constrained(EQUAL, sympy.Eq(2 * TH1 + TH2, pi))
        assert list(polar.free) == [TH1] and polar.q[1] == pi - 2 * TH1
        assert same(polar.position(), [0, 2 * ELL * sin(TH1)])
        assert same(polar.jacobian(), [0, 2 * ELL * cos(TH1)])
        assert same(polar.velocity(), [0, 2 * ELL * cos(TH1) * TH1.diff(T)])
        split = polar.split()
        assert same(split.tangential, [0, 2 * ELL * cos(TH1) * TH1.diff(T, 2)])
        assert same(split.centripetal, [0, -2 * ELL * sin(TH1) * TH1.diff(T) ** 2])
        assert split.coriolis.is_zero_matrix and same(split.total, polar.acceleration())

    def test_polar_jacobian_beside_the_full_one(self):
        """Problem 3a: off the diagonal the lower left entry vanishes, the upper right one is -ell sin(theta_1)."""
        full = constrained(EQUAL, 2 * TH1 + TH2 - pi).full_jacobian()
        assert full == sympy.Matrix([[-2 * ELL * sin(TH1), -ELL * sin(TH1)], [0, -ELL * cos(TH1)]])

    @pytest.mark.parametrize("relation", [{1: 0}, {2: 0.5}, sympy.Eq(2 * TH1 + TH2, pi), [TH1 - 1, {2: 2}]])
    def test_substitution_in_the_full_chain_gives_the_same(self, relation):
        """Velocity, acceleration, jerk, sum of the parts: the differences are zero."""
        assert all(left.is_zero_matrix for left in constrained(EQUAL, relation).agreement().values())

    @pytest.mark.parametrize("angles", ["segment", "vertical"])
    def test_angles_of_the_chain_s_own_convention(self, angles: str):
        """A held second segment keeps its direction: the end point moves as joint 1 does."""
        chain = Chain(2, angles=angles)
        assert same(constrained(chain, {2: 1}).velocity(), chain.velocity(1))


class TestAnyRelation:
    """Motions under relations, differentiated in numbers."""

    CHAIN = Chain(3, lengths=(0.5, 0.4, 0.3))
    A, B, C = CHAIN.q
    END = CHAIN.position()
    RELATIONS = [
        sympy.Eq(B, sin(A)),
        sin(A) + sin(A + B) - sympy.Rational(1, 2),
        END[1] - sympy.Rational(3, 10),
        [END[0] - sympy.Rational(1, 2), END[1] - sympy.Rational(3, 10)],
        [{3: 1}, cos(A) - sin(B)],
        sympy.Eq(A * B, C),
    ]

    @pytest.mark.parametrize("relation", RELATIONS, ids=str)
    def test_rates_are_derivatives_of_positions_on_the_relation(self, relation, rng: np.random.Generator):
        """Along a curve on the relation, finite differences of r give v, of v a, of a the jerk; the parts sum to a."""
        reduced = constrained(self.CHAIN, relation)
        f, m = reduced.mobility, reduced.coordinates.rows
        order = list(self.CHAIN.q)
        q = reduced.project(rng.uniform(0.3, 1.0, 3))
        s = q[[order.index(a) for a in reduced.coordinates]]
        rates = [rng.uniform(-0.5, 0.5, f) for _ in range(3)]
        names = ("position", "velocity", "acceleration", "jerk")
        values = [reduced.function(getattr(reduced, name)()) for name in names]
        slope = reduced.function(reduced.reduced.rates)
        if f == 0:
            assert all(np.abs(value(s, *rates)).max() < 1e-12 for value in values[1:])
            return

        def state(h: float):
            """S by small steps of the ODE s' = B s_free', with s_free a cubic in time."""
            x, steps = s.copy(), 4
            for k in range(steps):
                a, b = k * h / steps, (k + 1) * h / steps

                def rate(x, t):
                    return slope(x).reshape(m, f) @ (rates[0] + rates[1] * t + 0.5 * rates[2] * t * t)

                k1 = rate(x, a)
                k2 = rate(x + 0.5 * (b - a) * k1, 0.5 * (a + b))
                k3 = rate(x + 0.5 * (b - a) * k2, 0.5 * (a + b))
                x = x + (b - a) / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + (b - a) * k3, b))
            return x, rates[0] + rates[1] * h + 0.5 * rates[2] * h * h, rates[1] + rates[2] * h, rates[2]

        h = 1e-4
        for low, high in zip(values, values[1:], strict=False):
            fine = (low(*state(h)) - low(*state(-h))) / (2 * h)
            assert fine == pytest.approx(high(s, *rates), abs=2e-6 * (1 + np.abs(fine).max()))
        total = reduced.function(reduced.split().total)(s, *rates)
        assert total == pytest.approx(values[2](s, *rates), abs=1e-12)
        full = reduced.function(reduced.on(self.CHAIN.acceleration()))(s, *rates)
        assert full == pytest.approx(total, abs=1e-10)

    def test_an_end_point_on_a_line_moves_along_it(self):
        """Y held: the second row of the reduced Jacobian is zero, though no angle could be solved for."""
        reduced = constrained(EQUAL, EQUAL.position()[1] - ELL / 2)
        assert reduced.reduced.remaining and reduced.mobility == 1 and reduced.jacobian()[1] == 0
        assert sympy.simplify(reduced.reduced.regular - ELL * cos(TH1 + TH2)) == 0

    def test_a_branch_solves_for_an_angle(self):
        """The two solutions of a relation that is linear in no angle."""
        found = {constrained(EQUAL, cos(TH2) - sympy.Rational(1, 2), branch=k).q[1] for k in (0, 1)}
        assert found == {pi / 3, 5 * pi / 3}
        with pytest.raises(InputError, match="branch is 7"):
            constrained(EQUAL, cos(TH2) - sympy.Rational(1, 2), branch=7)

    def test_project_says_when_it_fails(self):
        """No angle has a sine above 1 within a parameter that allows it elsewhere."""
        a = sympy.Symbol("a", positive=True)
        reduced = constrained(EQUAL, sin(TH1) - a)
        assert np.sin(reduced.project((0.1, 0), parameters={a: 0.5})[0]) == pytest.approx(0.5)
        with pytest.raises(NoSolution, match="the residual is"):
            reduced.project((0.1, 0), parameters={a: 2})

    def test_latex_and_repr(self):
        """Of the relations and of the position."""
        polar = constrained(EQUAL, 2 * TH1 + TH2 - pi)
        assert polar.latex() == r"2 \theta_{1} + \theta_{2} - \pi = 0" and polar._repr_latex_().startswith("$")
        assert "free: theta_1(t)" in repr(polar)


class TestBadInput:
    """What contradicts, repeats or is no relation."""

    @pytest.mark.parametrize(
        ("relation", "message"),
        [
            ([{1: 0}, {1: 1}], "theta_1.t. = 1 contradicts theta_1.t. = 0"),
            ([{1: 0}, {1: 2 * pi}], "full turns"),
            ([{1: 0}, {2: 0}, sympy.Eq(TH1 + TH2, 1)], "contradicts theta_1.t. = 0; theta_2.t. = 0"),
            ([sympy.Eq(TH1 + TH2, 1), sympy.Eq(2 * TH1 + 2 * TH2, 2)], "is redundant.*follows from"),
            (sin(TH1) ** 2 + cos(TH1) ** 2 - 1, "is redundant"),
            (sympy.Eq(cos(TH1), 2), "no angles satisfy"),
            ([sin(TH1) - 0.5, sin(TH1) - 0.6], "no angles satisfy"),
            ([sin(TH1) - sympy.Rational(1, 2), sin(TH1) ** 2 - sympy.Rational(1, 4)], "no condition on rates: it follows"),
            (cos(TH2) - 1, "derivative is zero wherever it holds"),
            ({0: 1}, "no joint 0"),
            ({3: 1}, "no joint 3"),
            ({"a": 1}, "no angle of the chain"),
            ({True: 1}, "no angle of the chain"),
            ({1: np.nan}, "finite"),
            ({1: 1j}, "finite real"),
            ({1: "x"}, "finite real"),
            (TH1.diff(T) - 1, "nonholonomic"),
            (sympy.Eq(TH1, T), "driven joint"),
            (sympy.Symbol("x") - 1, "no angle of the chain in it"),
            (TH1 > 0, "sympy.Eq"),
            (2 * TH1 == pi, "False"),
            (True, "constrains nothing"),
            ([], "no relation came"),
            (None, "None"),
            ("th1 = 0", "sympy.Eq"),
        ],
        ids=str,
    )
    def test_relations_that_are_none(self, relation, message):
        """Named, with what to do."""
        with pytest.raises(InputError, match=message):
            constrained(EQUAL, relation)

    def test_numbers_of_another_shape(self):
        """Functions of the free angles say how many there are."""
        reduced = constrained(EQUAL, {1: 0})
        with pytest.raises(InputError, match="per free angle"):
            reduced.function(reduced.q)((1, 2))
        with pytest.raises(InputError, match="branch"):
            constrained(EQUAL, {1: 0}, branch=-1)


class TestLoop:
    """The four-bar of the text: four segments whose sum is zero, theta_1 and theta_4 known."""

    LOOP = Chain(4, angles="segment")
    CLOSED = constrained(LOOP, LOOP.position(), free=(1, 4))

    def test_j1_j2_and_the_determinant_are_the_texts(self):
        """Columns L_i (-sin, cos); det J2 = L2 L3 sin(th3 - th2); rates -J2^-1 J1."""
        (l1, l2, l3, l4), (th1, th2, th3, th4) = self.LOOP.lengths, self.LOOP.q
        assert list(self.CLOSED.free) == [th1, th4]
        assert same(self.CLOSED.J1, [[-l1 * sin(th1), -l4 * sin(th4)], [l1 * cos(th1), l4 * cos(th4)]])
        assert same(self.CLOSED.J2, [[-l2 * sin(th2), -l3 * sin(th3)], [l2 * cos(th2), l3 * cos(th3)]])
        assert sympy.simplify(self.CLOSED.det_J2 - l2 * l3 * sin(th3 - th2)) == 0
        rates = self.CLOSED.rates.extract([1, 2], [0, 1])
        assert same(self.CLOSED.J2 * rates + self.CLOSED.J1, sympy.zeros(2, 2))

    def test_the_ground_may_be_held_as_well(self):
        """With theta_4 = 0 inserted one angle is free, and J1 keeps one column."""
        held = constrained(self.LOOP, [*self.LOOP.position(), {4: 0}], free=[self.LOOP.q[0]])
        assert held.mobility == 1 and held.J1 == self.CLOSED.J1[:, 0] and held.J2 == self.CLOSED.J2
        assert held.q[3] == 0

    def test_solved_relations_leave_no_columns(self):
        """Where all relations were solved, J1 and J2 are empty, and their determinant is one; a free angle is kept."""
        polar = constrained(EQUAL, 2 * TH1 + TH2 - pi, free=[2])
        assert list(polar.free) == [TH2] and same(polar.q, [(pi - TH2) / 2, TH2])
        assert polar.J1.shape == (0, 1) and polar.J2.shape == (0, 0) and polar.det_J2 == 1

    @pytest.mark.parametrize(
        ("relation", "free", "message"),
        [
            (LOOP.position(), (1,), "free names 1 angles; expected 2"),
            (LOOP.position(), (1, 1), "free has 1 in it"),
            (LOOP.position(), (1, 5), "free has 5 in it"),
            (LOOP.position(), (), "free names no angle"),
            (LOOP.position(), "14", "free has '14' in it"),
            ([LOOP.position()[0], {4: 0}], (1, 4), "do not determine the others"),
        ],
        ids=str,
    )
    def test_angles_that_cannot_be_free(self, relation, free, message):
        """Too few, twice, none of the chain, or determined already."""
        with pytest.raises(InputError, match=message):
            constrained(self.LOOP, relation, free=free)
