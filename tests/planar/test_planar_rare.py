"""Poses, paths and relations that are rarely met: at edges, at rest, doubled, and what is said of them."""

from __future__ import annotations

import re

import numpy as np
import pytest
import sympy

from rbd.errors import InputError, SingularPose
from rbd.planar import (
    Chain,
    LinearisedChain,
    classify,
    constrained,
    endpoint_motion,
    inverse,
    inverse_path,
    minimum_jerk,
    planned_motion,
)
from rbd.planar.inverse_kinematics import _reach, _settle, evenly_bent
from rbd.planar.relations import newton
from rbd.planar.robot_file import to_urdf

THREE = Chain(3, lengths=(0.4, 0.35, 0.25))


# ------------------------------------------------------------------------------------------------------------ poses


def test_a_chain_folded_through_the_base_stays_near_its_start():
    """Links of 2, 1, 1 m fold with the end point on the base, in any direction: the turn of all links nearest the start's."""
    chain = Chain(3, lengths=(2.0, 1.0, 1.0))
    for angle in (-2.0, 0.3, 1.1):
        start = np.array([angle, np.pi, 0.0])
        found = inverse(chain, (0.0, 0.0), start=start)
        assert "folded" in found.note and np.abs(found.q - start).max() < 1e-12
        bent = inverse(chain, (0.0, 0.0), start=start + [0.0, 0.05, -0.05])
        assert np.abs(chain.numeric.position(bent.q)).max() < 1e-12 and abs(bent.q[0] - angle) < 0.1


def test_an_answer_is_printed_in_degrees():
    """Both branches of two links; what is out of reach is said in words."""
    chain = Chain(2, lengths=(0.5, 0.5))
    assert str(inverse(chain, (0.0, 0.5 * np.sqrt(3.0)))) == "(0, 0.866025) m: (60, 60) deg or (120, -60) deg"
    beyond = inverse(chain, (3.0, 0.0))
    assert str(beyond) == beyond.note and "out of reach" in beyond.note
    with pytest.raises(InputError, match="out of reach"):
        _ = beyond.q


def test_a_path_too_coarse_to_follow_is_told():
    """Samples half a turn apart: three links go from pose to pose, each on the path, and two notes ask for finer samples."""
    points = 0.6 * np.array([[1.0, 0.0], [-0.9, 0.1], [1.0, -0.05], [0.0, 0.02], [-1.0, 0.0]])
    path = inverse_path(THREE, points)
    assert np.abs(THREE.numeric.position(path.q) - points).max() < 1e-12
    assert "jump to another pose at sample" in path.note and "sample the path more finely to be sure" in path.note


def test_the_note_of_a_split_says_where_the_coriolis_part_comes_from():
    """Joint angles add up along the chain, so that products of two rates remain; segment angles do not."""
    assert "products of two rates remain" in Chain(2).split().note
    assert "no product of two rates" in Chain(2, angles="segment").split().note


def test_a_path_from_the_stretched_pose_inwards_is_followed():
    """In line there is no null space half-way: the first step is a pose anew, and every sample is on the path."""
    points = np.linspace([1.0, 0.0], [0.9, 0.0], 21)
    path = inverse_path(THREE, points)
    assert np.abs(THREE.numeric.position(path.q) - points).max() < 1e-12
    assert np.abs(path.q[0]).max() < 1e-7 and np.abs(np.diff(path.q[1:], axis=0)).max() < 0.2


def test_poses_on_the_family_that_cannot_be_bettered_are_returned_and_no_minimum_is_claimed():
    """In line the family has no tangent, and without a step none is taken: the pose stays where it is."""
    arm, q0 = THREE.numeric, np.array([0.1, 0.2, 0.3])
    for q in (np.zeros(3), np.array([0.4, -0.7, 1.1])):
        kept, minimum = _settle(arm, arm.position(q), q0, q, most=60 if not q.any() else 0)
        assert np.array_equal(kept, q) and not minimum


def test_a_target_is_not_reached_in_fewer_steps_than_it_takes():
    """Levenberg's method: none after one step, there after a hundred."""
    arm, target = THREE.numeric, np.array([0.2, 0.5])
    assert _reach(arm, target, np.array([2.0, 0.5, 0.5]), most=1) is None
    there = _reach(arm, target, np.array([2.0, 0.5, 0.5]))
    assert there is not None and np.abs(arm.position(there) - target).max() < 1e-14


def test_newtons_method_ends_where_a_root_is_too_flat():
    """A root of order 20 from 1e3: each step takes 1/20 of the way; after 80 the misfit is told, not the root."""
    s, misfit = newton(lambda s: (s**20, np.diag(20.0 * s**19)), np.array([1e3]))
    assert s[0] == pytest.approx(1e3 * 0.95**80, rel=1e-9) and misfit == pytest.approx(s[0] ** 20)


# ------------------------------------------------------------------------------------------------------------ motions


def test_an_end_point_that_stays_keeps_all_angles():
    """From a point to itself: no rate, and nothing unbounded, stretched out or not, of one, two and three links."""
    one = endpoint_motion(Chain(1, lengths=(0.5,)), minimum_jerk((0.3, 0.4), (0.3, 0.4), 1.0))
    assert np.abs(one.q - np.arctan2(0.4, 0.3)).max() < 1e-12 and not one.unbounded
    for chain in (Chain(2, lengths=(0.5, 0.5)), THREE):
        still = endpoint_motion(chain, minimum_jerk((0.3, 0.4), (0.3, 0.4), 1.0))
        assert np.abs(still.q - still.q[0]).max() < 1e-12 and still.note == ""
        with pytest.raises(SingularPose, match="in line at every sample"):
            endpoint_motion(chain, minimum_jerk((1.0, 0.0), (1.0, 0.0), 1.0))


def test_a_path_from_a_pose_nearly_in_line_ends_with_its_place_or_is_followed(monkeypatch):
    """Links 0.5, 0.3, 0.2 m folded onto the base: a milliradian from the line it is followed, a microradian it is told."""
    chain = Chain(3, lengths=(0.5, 0.3, 0.2))

    def begun(bend: float) -> np.ndarray:
        start = np.array([0.0, np.pi + bend, -2.0 * bend])
        here = chain.numeric.position(start)
        return endpoint_motion(chain, minimum_jerk(here, here - [0.1, 0.0], 1.0), start=start).q

    monkeypatch.setattr(planned_motion, "MOST_RATES", 4_000)  # a few seconds, where the limit itself takes more
    end = chain.numeric.position(begun(0.01)[-1])
    assert end == pytest.approx(chain.numeric.position(np.array([0.0, np.pi + 0.01, -0.02])) - [0.1, 0.0], abs=1e-9)
    with pytest.raises(SingularPose, match=r"into line, or nearly, .* at about 0.000\d+ s. Begin near other angles"):
        begun(1e-6)
    with pytest.raises(SingularPose, match="into line, or nearly, along the path"):
        begun(0.0)


def test_a_path_that_begins_along_the_edge_has_bounded_accelerations():
    """Links of 0.7 and 0.3 m, folded at 0.4 m, leave the inner edge at a right angle to the fold: no 1/sqrt(t) there."""
    chain = Chain(2, lengths=(0.7, 0.3))
    found = endpoint_motion(chain, minimum_jerk((0.4, 0.0), (0.4, 0.3), 1.0))
    assert "begins folded" in found.note and found.unbounded == ()
    straight = endpoint_motion(chain, minimum_jerk((0.4, 0.0), (0.6, 0.0), 1.0))
    assert "grow without bound" in straight.note and straight.unbounded == (0.0,)


def test_symbols_of_a_motion_are_written_for_numbers_and_points_alone():
    """A table of starts has no formula."""
    path = minimum_jerk(np.zeros((2, 2)), np.ones((2, 2)), 1.0)
    assert path.displacement(1.0).tolist() == [[1.0, 1.0], [1.0, 1.0]]
    with pytest.raises(InputError, match=r"start has shape \(2, 2\)"):
        path.symbolic()


# ---------------------------------------------------------------------------------------------------------- relations


class TestRelations:
    """What a relation may be, and what is said of those that are none."""

    CHAIN = Chain(2, lengths=(0.5, 0.4))
    A, B = CHAIN.q

    def test_an_identity_constrains_nothing(self):
        """Whether SymPy sees it or only numbers do."""
        x = sympy.Symbol("x")
        with pytest.raises(InputError, match="holds always"):
            constrained(self.CHAIN, sympy.sin(x) ** 2 + sympy.cos(x) ** 2 - 1)
        A, B = self.A, self.B
        hidden = sympy.sin(A + B) - sympy.sin(A) * sympy.cos(B) - sympy.cos(A) * sympy.sin(B)
        with pytest.raises(InputError, match="is redundant: it follows from an identity"):
            constrained(self.CHAIN, hidden)

    def test_more_relations_than_angles_contradict(self):
        """Three conditions on two angles."""
        A, B = self.A, self.B
        relations = [sympy.sin(A) * B - 1, sympy.cos(B) * A - sympy.Rational(1, 3), sympy.sin(A + B) - B**2]
        with pytest.raises(InputError, match="3 relations are left for 2 angles"):
            constrained(self.CHAIN, relations)

    def test_a_branch_without_real_angles_is_refused(self):
        """A^2 + B^2 = -1 has complex solutions alone."""
        with pytest.raises(InputError, match="could not be solved for an angle"):
            constrained(self.CHAIN, self.A**2 + self.B**2 + 1, branch=0)

    def test_a_relation_without_values_at_some_angles_is_satisfied_where_it_has_some(self):
        """sqrt(A - 1) = B is real for A >= 1 only: poses are found there."""
        held = constrained(self.CHAIN, sympy.sqrt(self.A - 1) + self.B**3 - 2)
        q = held.project([2.0, 1.0])
        assert abs(np.sqrt(q[0] - 1.0) + q[1] ** 3 - 2.0) < 1e-12
        with pytest.raises(InputError, match=r"q has shape \(3,\)"):
            held.project([1.0, 2.0, 3.0])

    def test_angles_may_be_given_as_a_column(self):
        """A SymPy matrix of numbers is a list of them."""
        start = sympy.Matrix([sympy.pi / 4, sympy.Rational(1, 2)])
        one, other = (inverse(self.CHAIN, (0.3, 0.6), start=q) for q in (start, [float(x) for x in start]))
        assert np.array_equal(one.q, other.q)


# -------------------------------------------------------------------------------------------------------------- modes


@pytest.mark.parametrize(
    ("K", "squared"),
    [
        ([[6, 3], [3, 3]], (3, 3)),  # K = 3 M: every shape is one
        ([[10, 3], [3, 3]], (3, 7)),  # the second angle alone moves at w^2 = 3
        ([[6, 3], [3, 9]], (3, 15)),  # the first alone
        ([[2, 0], [0, 5]], None),
    ],
)
def test_two_modes_are_two_shapes(K, squared):
    """K s = w^2 M s of each, and the two are independent, also where both frequencies are one."""
    g = sympy.Symbol("g", positive=True)
    M, K = sympy.ImmutableMatrix([[2, 1], [1, 1]]), g * sympy.ImmutableMatrix(K)
    modes = LinearisedChain(sympy.zeros(2, 1), M, K, sympy.zeros(2, 1)).modes()
    if squared is not None:
        assert [sympy.simplify(w2 / g) for w2 in modes.squared] == list(squared)
    for k, w2 in enumerate(modes.squared):
        assert sympy.simplify((K - w2 * M) * modes.shapes[:, k]).is_zero_matrix
        first = next(x for x in modes.shapes[:, k] if x != 0)
        assert first == 1
    assert sympy.simplify(modes.shapes.det()) != 0


def test_the_angle_with_a_number_for_its_coefficient_is_solved_for():
    """A parameter might be zero: p A + B = 1 gives B, A + p B = 1 gives A; of two numbers the last angle."""
    chain, p = Chain(2, lengths=(0.5, 0.4)), sympy.Symbol("p", positive=True)
    A, B = chain.q
    for relation, free in ((p * A + B - 1, A), (A + p * B - 1, B), (A + 2 * B - 1, A)):
        assert list(constrained(chain, relation).free) == [free]


def test_targets_are_reached_from_stretched_and_folded_poses_too():
    """Of 300 chains, half of them almost in line: at most one in thirty does not find its target, and who does stands on it."""
    rng, lost = np.random.default_rng(7), 0
    for k in range(300):
        n = int(rng.integers(3, 6))
        arm = Chain(n, lengths=rng.uniform(0.05, 1.0, n).tolist()).numeric
        start = rng.uniform(-3.0, 3.0, n) if k % 2 else 1e-3 * rng.normal(size=n)
        target = arm.position(rng.uniform(-3.0, 3.0, n))
        there = _reach(arm, target, start)
        lost += there is None
        if there is not None:
            assert np.abs(arm.position(there) - target).max() <= 1e-14 * arm.outer
    assert lost <= 10


def test_one_link_that_reaches_its_target_is_not_called_singular():
    """Its end point moves along the circle, whatever the angle: nothing is special there."""
    found = inverse(Chain(1, lengths=[1.0]), [0.6, 0.8])
    assert found.reachable and not found.singular and found.note == ""
    assert np.abs(found.branches - np.arctan2(0.8, 0.6)).max() < 1e-15


@pytest.mark.parametrize(("target", "side"), [([0.9, 1.2], "outside"), ([0.3, 0.4], "inside")])
def test_a_target_off_the_circle_of_one_link_is_told_on_which_side(target: list[float], side: str):
    """Within reach of one link there is only its circle."""
    found = inverse(Chain(1, lengths=[1.0]), target)
    assert not found.reachable and f"{side} the circle of radius 1 m" in found.note


def test_a_target_out_of_reach_is_pointed_at_by_the_straight_chain():
    """Equal angles between neighbours, none at all: the end is as near to a far target as it can be."""
    arm = Chain(3, lengths=[1.0, 0.5, 0.3]).numeric
    assert np.abs(arm.position(evenly_bent(arm, np.array([0.0, 3.0]))) - [0.0, 1.8]).max() < 1e-15


@pytest.mark.parametrize("off", [-1e-15, 0.0, 1e-15, 1e-14])
def test_a_chain_pinned_where_it_is_folded_is_in_line_though_rounding_says_a_little_more(off: float):
    """One link against the two others: the only pose, and the note says that the slightest play lets them bend."""
    told = classify(Chain(3, lengths=(0.7, 0.1, 0.2)), pinned=(0.4 + off, 0.0))
    assert told.mobility == 0 and "All links are in line" in str(told)


@pytest.mark.parametrize("d", [-0.2, 0.8])
def test_a_counterweight_is_held_by_a_rod_of_its_own_length(d: float):
    """From the joint to the mass, before the link or beyond it: the page and other viewers draw it so."""
    shapes = r'<origin xyz="([^"]*)"[^>]*/><geometry>(.*?)</geometry>'
    text = to_urdf(Chain(1, lengths=[0.5]), masses=[1.0], centres=[d], inertias=[0.01])
    *_, (origin, geometry) = re.findall(shapes, text)
    assert float(origin.split()[0]) == pytest.approx(0.5 * d) and f'length="{abs(d):g}"' in geometry


def test_relations_that_no_angles_satisfy_for_the_lengths_tried_are_still_compared():
    """The relation cos cos = a + 5 has no real angles; that twice of it says nothing new is found all the same."""
    chain, a = Chain(3), sympy.Symbol("a", positive=True)
    relation = sympy.cos(chain.q[0]) * sympy.cos(chain.q[1]) - (a + 5)
    with pytest.raises(InputError, match="gives no condition on rates: it follows from"):
        constrained(chain, [relation, 2 * relation])
