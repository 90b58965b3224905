"""Inverse kinematics: forward kinematics undoes it, and what is out of reach is told, with the distance."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from rbd.errors import InputError
from rbd.planar import Chain, inverse, inverse_formulas

WAYS = ("joint", "segment", "vertical")
DRAWS = 24
XY = sympy.symbols("x y", real=True)
ODD_TARGETS = [(1,), (1, 2, 3), "ab", (np.nan, 0), (np.inf, 0), None, ((1, 2), (3, 4)), (1e200, 0), 3, (1j, 0)]
BEYOND = [((3, 4), 0, "stretched"), ((0.03, -0.04), 0.3, "hole"), ((0, 0), 0.3, "hole")]


def end(chain: Chain, q: np.ndarray) -> np.ndarray:
    """The end point by the law of the plane, from the angles between links: nothing of the library's kinematics."""
    phi = {"joint": np.cumsum(q), "segment": q, "vertical": q - np.pi / 2}[chain.angles]
    lengths = np.array([float(length) for length in chain.lengths])
    return np.array([lengths @ np.cos(phi), lengths @ np.sin(phi)])


def chains(n: int, rng: np.random.Generator):
    """Chains of odd lengths in all conventions."""
    for k in range(DRAWS):
        yield Chain(n, lengths=10.0 ** rng.uniform(-1.0, 1.0, n), angles=WAYS[k % 3])


class TestOneAndTwoLinks:
    """Closed forms."""

    @pytest.mark.parametrize("n", [1, 2])
    def test_forward_undoes_inverse_in_every_branch(self, n: int, rng: np.random.Generator):
        """r(q) = target for every branch, to 1e-12 of the chain's length, in every way to measure angles."""
        for chain in chains(n, rng):
            size = float(sum(chain.lengths))
            target = end(chain, rng.uniform(-np.pi, np.pi, n))
            found = inverse(chain, target)
            assert found.reachable and found.distance <= 1e-15 * size and len(found.branches) == n
            assert all(np.abs(end(chain, q) - target).max() < 1e-12 * size for q in found.branches)
            assert (found.branches > -np.pi).all() and (found.branches <= np.pi).all()

    @pytest.mark.parametrize("gap", [1e-15, 1e-12, 1e-9, 1e-6, 1e-3])
    @pytest.mark.parametrize("folded", [False, True])
    def test_no_digits_are_lost_near_a_singular_pose(self, gap: float, folded: bool):
        """sin(theta_2) is about sqrt(gap) there: an arccos would be off by sqrt(eps) = 1e-8 in the bend."""
        chain = Chain(2, lengths=(0.7, 0.4))
        bend = (np.pi if folded else 0.0) + (-1.0 if folded else 1.0) * np.sqrt(gap)
        target = end(chain, np.array([0.3, bend]))
        for q in inverse(chain, target).branches:
            assert np.abs(end(chain, q) - target).max() < 2e-15

    def test_the_published_pair_of_poses(self):
        """Cases: l = 0.5, (-0.5, 0.5) is (90, 90) deg, (0, 0.5 sqrt 2) is (45, 90) deg; the other branch mirrors the elbow."""
        chain = Chain(2, lengths=(0.5, 0.5))
        first, last = inverse(chain, (-0.5, 0.5)), inverse(chain, (0, sympy.sqrt(2) / 2))
        assert np.degrees(first.branches) == pytest.approx(np.array([[90, 90], [180, -90]]))
        assert np.degrees(last.branches) == pytest.approx(np.array([[45, 90], [135, -90]]))
        assert not first.singular and first.note == "" and np.degrees(first.q) == pytest.approx([90, 90])

    def test_the_branch_is_named_by_the_side_it_bends_to(self, rng: np.random.Generator):
        """The first bends counterclockwise, theta_2 in (0, pi): the elbow is to the right of the way to the target."""
        for chain in chains(2, rng):
            target = end(chain, rng.uniform(-np.pi, np.pi, 2))
            for q, side in zip(inverse(chain, target).branches, (-1, 1), strict=True):
                phi = q[0] - (np.pi / 2 if chain.angles == "vertical" else 0.0)
                elbow = np.array([np.cos(phi), np.sin(phi)])
                assert np.sign(target[0] * elbow[1] - target[1] * elbow[0]) == side

    @pytest.mark.parametrize(
        ("target", "inner", "word"), [((3, 4), 0, "stretched"), ((0.03, -0.04), 0.3, "hole"), ((0, 0), 0.3, "hole")]
    )
    def test_out_of_reach_by_the_distance_to_the_annulus(self, target, inner, word):
        """|l1 - l2| <= r <= l1 + l2; the nearest point lies on the ray, and is reached."""
        chain = Chain(2, lengths=(0.5, 0.2))
        found = inverse(chain, target)
        r = float(np.hypot(*target))
        assert not found.reachable and found.branches.shape == (0, 2) and word in found.note
        assert found.distance == pytest.approx(r - 0.7 if r > 0.7 else inner - r, abs=1e-15)
        assert np.linalg.norm(found.nearest - target) == pytest.approx(found.distance)
        assert inverse(chain, found.nearest).reachable and inverse(chain, found.nearest).singular
        with pytest.raises(InputError, match="out of reach by"):
            _ = found.q

    def test_one_link_reaches_its_circle_only(self):
        """Off it by |r - l|, inside and outside."""
        chain = Chain(1, lengths=[2])
        for r, distance in ((2.5, 0.5), (0.5, 1.5), (0.0, 2.0)):
            found = inverse(chain, (0.0, r))
            assert not found.reachable and found.distance == pytest.approx(distance) and "circle" in found.note
        assert inverse(chain, (0, -2)).q == pytest.approx([-np.pi / 2])
        assert inverse(Chain(1, lengths=[2], angles="vertical"), (0, -2)).q == pytest.approx([0.0])  # it hangs
        assert inverse(chain, (0, 2.001), tolerance=1e-3).q == pytest.approx([np.pi / 2])

    def test_singular_poses_are_told(self):
        """Stretched, folded, and at the base, where equal links leave a family of one parameter."""
        chain, uneven = Chain(2, lengths=(0.5, 0.5)), Chain(2, lengths=(0.5, 0.2))
        stretched, folded, base = inverse(chain, (0, 1)), inverse(uneven, (-0.3, 0)), inverse(chain, (0, 0))
        assert stretched.singular and "stretched" in stretched.note and np.degrees(stretched.branches).tolist() == [[90, 0]]
        assert folded.singular and "folded" in folded.note and np.degrees(folded.branches).tolist() == [[180, 180]]
        assert base.singular and "family" in base.note and np.degrees(base.branches).tolist() == [[0, 180]]
        assert np.degrees(inverse(chain, (0, 0), start=(0.7, 3.0)).q) == pytest.approx([np.degrees(0.7), 180])

    def test_a_start_orders_the_branches_and_keeps_its_turns(self):
        """The nearer one first, within half a turn of the start."""
        chain = Chain(2, lengths=(0.5, 0.5))
        found = inverse(chain, (-0.5, 0.5), start=np.radians((170 + 360, -80 - 360)))
        assert np.degrees(found.branches) == pytest.approx(np.array([[540, -450], [450, -270]]))

    @pytest.mark.parametrize("angles", WAYS)
    def test_the_formulas_in_symbols_give_the_same_numbers(self, angles: str):
        """atan2 of the text's sine and cosine, both branches."""
        chain, point = Chain(2, angles=angles), (-0.3, 0.6)
        known = dict(zip(chain.lengths, (0.7, 0.4), strict=True)) | dict(
            zip(sympy.symbols("x y", real=True), point, strict=True)
        )
        expected = inverse(chain.with_lengths((0.7, 0.4)), point).branches
        for formula, q in zip(inverse_formulas(chain), expected, strict=True):
            turn = np.array(formula.subs(known), dtype=float).ravel() - q
            assert np.abs(turn - 2 * np.pi * np.round(turn / (2 * np.pi))).max() < 1e-12
        assert inverse_formulas(Chain(1))[0][0] == sympy.atan2(XY[1], XY[0])

    @pytest.mark.parametrize("target", [(0.5, 0.6), (-0.4, 0.5), (-0.5, -0.7), (0.2, -0.25)])
    def test_the_triangle_of_the_text(self, target: tuple[float, float]):
        """Cosine rule at the elbow, inner angle pi - theta_2; phi between the first link and the line to the target."""
        l1, l2 = 0.7, 0.4
        for q in inverse(Chain(2, lengths=(l1, l2)), target).branches:
            assert l1**2 + l2**2 - 2 * l1 * l2 * np.cos(np.pi - q[1]) == pytest.approx(target[0] ** 2 + target[1] ** 2)
            phi = np.arctan2(l2 * np.sin(q[1]), l1 + l2 * np.cos(q[1]))
            turn = q[0] + phi - np.arctan2(target[1], target[0])
            assert turn - 2 * np.pi * np.round(turn / (2 * np.pi)) == pytest.approx(0.0, abs=1e-12)
            # Cosine rule at the base, where phi is the angle between the sides l1 and r.
            r = np.hypot(*target)
            assert np.cos(phi) == pytest.approx((l1**2 + r**2 - l2**2) / (2 * l1 * r))


class TestManyLinks:
    """The nearest pose of a family."""

    @pytest.mark.parametrize("n", [3, 4, 7])
    def test_the_end_point_gets_there_by_the_least_change(self, n: int, rng: np.random.Generator):
        """r(q) = target to 1e-12, and q - start has no part in the null space of J: the condition of a nearest pose."""
        for chain in chains(n, rng):
            size = float(sum(chain.lengths))
            target, start = end(chain, rng.uniform(-np.pi, np.pi, n)), rng.uniform(-3.0, 3.0, n)
            found = inverse(chain, target, start=start)
            assert found.reachable and np.abs(end(chain, found.q) - target).max() < 1e-12 * size
            null = np.linalg.svd(chain.numeric.jacobian(found.q))[2][2:]
            assert np.abs(null @ (found.q - start)).max() < 1e-6
            free = inverse(chain, target)
            assert np.abs(end(chain, free.q) - target).max() < 1e-12 * size and "family" in free.note

    def test_nearest_by_brute_force(self):
        """Three links: over the whole family, one parameter, no pose is nearer."""
        chain, start, target = Chain(3, lengths=(0.5, 0.4, 0.3)), np.array([0.3, 0.5, -0.8]), np.array([0.2, 0.7])
        found = np.linalg.norm(inverse(chain, target, start=start).q - start)
        gaps = []
        for phi in np.linspace(-np.pi, np.pi, 20001):
            p = target - 0.3 * np.array([np.cos(phi), np.sin(phi)])
            c = (p @ p - 0.25 - 0.16) / 0.4
            for s in (1, -1) if abs(c) <= 1 else ():
                two = s * np.arccos(c)
                one = np.arctan2(p[1], p[0]) - np.arctan2(0.4 * np.sin(two), 0.5 + 0.4 * np.cos(two))
                turn = np.array([one, two, phi - one - two]) - start
                gaps.append(np.linalg.norm(turn - 2 * np.pi * np.round(turn / (2 * np.pi))))
        assert found <= min(gaps) + 1e-7

    def test_a_start_in_line_with_the_target_is_left(self):
        """There the damped method stands still, as J^T e = 0; the pose comes from three straight pieces."""
        chain = Chain(3, lengths=(1, 1, 1))
        found = inverse(chain, (1.5, 0), start=(0, 0, 0))
        assert np.abs(end(chain, found.q) - (1.5, 0)).max() < 1e-14 and "just as near" in found.note

    def test_a_start_that_is_there_stays(self):
        """Least change is none."""
        chain, q = Chain(4, lengths=(1, 2, 1, 2)), np.array([0.3, -0.7, 1.1, 0.4])
        assert inverse(chain, end(chain, q), start=q).q == pytest.approx(q, abs=1e-12)

    @pytest.mark.parametrize(
        ("lengths", "target", "distance"),
        [((1, 1, 1), (4, 0), 1.0), ((1, 3, 1), (0, 0.25), 0.75), ((1, 3, 1), (0, 0), 1.0), ((1, 1, 1), (0, 0), 0.0)],
    )
    def test_distances_beyond_reach_are_certain(self, lengths, target, distance):
        """|target| - sum, or (longest - others) - |target| in the hole; no hole if no link is longer than the others."""
        found = inverse(Chain(3, lengths=lengths), target)
        assert found.distance == distance and found.reachable == (distance == 0.0)

    @pytest.mark.parametrize(("lengths", "target"), [((1, 2, 1), (0, 4)), ((1, 3, 1), (0, -1)), ((1, 2, 1), (0, 0))])
    def test_at_the_edges_the_chain_is_in_line(self, lengths, target):
        """Stretched, or folded back onto the longest link: singular, and exact."""
        chain = Chain(3, lengths=lengths)
        found = inverse(chain, target)
        assert found.singular and np.abs(end(chain, found.q) - target).max() < 1e-15 * 10

    @pytest.mark.parametrize("angles", WAYS)
    def test_folded_through_the_base_it_points_where_it_is_nearest_to_the_start(self, angles: str):
        """Links of 1, 2 and 1 m: of all directions psi of the first link the one with the least |q - start|.

        Between links the first angle alone is psi: that of the start. From x or from the vertical all three are psi and half
        a turn, so psi is the mean of what the start asks of each link.
        """
        chain, start = Chain(3, lengths=(1, 2, 1), angles=angles), np.array([0.4, 3.0, -0.9])
        found = inverse(chain, (0, 0), start=start)
        psi = 0.4 if angles == "joint" else np.mean(start - [0.0, np.pi, 0.0])
        folded = [psi, np.pi, -np.pi] if angles == "joint" else [psi, psi + np.pi, psi]
        assert np.abs(end(chain, found.q)).max() < 1e-14 and "may point anywhere" in found.note
        assert found.q == pytest.approx(folded, abs=1e-12)

    @pytest.mark.parametrize("angles", WAYS)
    def test_folded_through_the_base_no_direction_is_nearer(self, angles: str, rng: np.random.Generator):
        """Over all directions, by brute force: from starts several turns apart."""
        chain = Chain(4, lengths=(1, 1, 4, 2), angles=angles)
        turn, fold = ([1, 0, 0, 0], [0, 0, np.pi, -np.pi]) if angles == "joint" else ([1, 1, 1, 1], [0, 0, np.pi, 0])
        folded = fold + np.outer(np.linspace(-np.pi, np.pi, 2001), turn)
        for _ in range(20):
            start = rng.uniform(-10.0, 10.0, 4)
            apart = folded - start
            least = np.linalg.norm(apart - 2.0 * np.pi * np.round(apart / (2.0 * np.pi)), axis=1).min()
            assert np.linalg.norm(inverse(chain, (0, 0), start=start).q - start) <= least + 1e-12


class TestBadInput:
    """Told, not guessed."""

    @pytest.mark.parametrize(
        "target", [(1,), (1, 2, 3), "ab", (np.nan, 0), (np.inf, 0), None, ((1, 2), (3, 4)), (1e200, 0), 3, (1j, 0)]
    )
    def test_targets_that_are_none(self, target):
        """Shape, kind, finiteness."""
        with pytest.raises(InputError, match="target"):
            inverse(Chain(2, lengths=(1, 1)), target)

    def test_symbols_and_other_arguments(self):
        """Symbolic lengths have formulas; starts and tolerances are checked; families have no formulas."""
        with pytest.raises(InputError, match="inverse_formulas"):
            inverse(Chain(2), (1, 0))
        chain = Chain(2, lengths=(1, 1))
        for wrong in ((1,), (np.nan, 1), "ab"):
            with pytest.raises(InputError, match="start"):
                inverse(chain, (1, 0), start=wrong)
        for tolerance in (-1, np.nan, 1, "x", None):
            with pytest.raises(InputError, match="tolerance"):
                inverse(chain, (1, 0), tolerance=tolerance)
        with pytest.raises(InputError, match="families"):
            inverse_formulas(Chain(3))
        with pytest.raises(InputError, match="x is"):
            inverse_formulas(Chain(2), x=sympy.I)
