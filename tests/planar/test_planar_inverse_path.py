"""Inverse kinematics along a path, and the joint rates that follow from the end point's."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.errors import InputError, SingularPose
from rbd.planar import Chain, inverse_path, joint_rates

HALF = (0.5, 0.5)


def minimum_jerk(start, stop, samples: int) -> tuple[np.ndarray, ...]:
    """Time, point, velocity, acceleration, jerk of the quintic over 1 s."""
    t = np.linspace(0.0, 1.0, samples)
    p0, way = np.array(start, dtype=float), np.array(stop, dtype=float) - start
    shapes = (
        10 * t**3 - 15 * t**4 + 6 * t**5,
        30 * t**2 - 60 * t**3 + 30 * t**4,
        60 * t - 180 * t**2 + 120 * t**3,
        60 - 360 * t + 360 * t**2,
    )
    point, *rest = (way * s[:, None] for s in shapes)
    return t, p0 + point, *rest


class TestPaths:
    """One branch, continuously."""

    def test_the_published_motion(self):
        """Cases: (-0.5, 0.5) to (0, 0.5 sqrt 2): (90, 90) to (45, 90) deg; the other branch (180, -90) to (135, -90)."""
        chain = Chain(2, lengths=HALF)
        _, points, *_ = minimum_jerk((-0.5, 0.5), (0, np.sqrt(0.5)), 101)
        for branch, ends in ((0, [(90, 90), (45, 90)]), (1, [(180, -90), (135, -90)])):
            path = inverse_path(chain, points, branch=branch)
            assert np.degrees(path.q[[0, -1]]) == pytest.approx(np.array(ends, dtype=float))
            assert path.reachable.all() and not path.singular.any() and path.note == "" and len(path) == 101

    @pytest.mark.parametrize("angles", ["joint", "segment", "vertical"])
    @pytest.mark.parametrize("n", [1, 2, 3])
    def test_angles_never_jump_by_a_turn(self, n: int, angles: str):
        """Three times around the base: three turns of the first link, and r(q) on the path to 1e-12."""
        chain = Chain(n, lengths=np.full(n, 1.0 / n), angles=angles)
        w = np.linspace(0.0, 6 * np.pi, 400)
        points = (1.0 if n == 1 else 0.7) * np.stack([np.cos(w), np.sin(w)], axis=1)
        path = inverse_path(chain, points)
        assert np.abs(np.diff(path.q, axis=0)).max() < 0.2
        assert np.abs(chain.numeric.position(path.q) - points).max() < 1e-12
        if n < 3:
            assert path.q[-1, 0] - path.q[0, 0] == pytest.approx(6 * np.pi)

    @pytest.mark.parametrize("samples", [100, 101])
    def test_through_the_base_the_elbow_goes_on_turning(self, samples: int):
        """On a line through the base cos(theta_1) = -+x and theta_2 passes 180 deg: staying would turn link 1 about at once."""
        x = np.linspace(-0.8, 0.8, samples)
        path = inverse_path(Chain(2, lengths=HALF), np.stack([x, 0 * x], axis=1))
        assert path.q[:, 0] == pytest.approx(np.arccos(x)) and path.q[:, 1] == pytest.approx(2 * (np.pi - np.arccos(x)))
        assert len(path.switches) == 1 and "other branch" in path.note

    def test_touching_the_outer_edge_along_it_the_elbow_passes_straight(self):
        """R = cos(b/2), direction b/2: theta_1 = 0 and theta_2 = b, smooth through the stretched pose."""
        b = np.linspace(-1.0, 1.0, 201)
        points = np.cos(b / 2)[:, None] * np.stack([np.cos(b / 2), np.sin(b / 2)], axis=1)
        path = inverse_path(Chain(2, lengths=HALF), points, branch=1)
        assert path.q == pytest.approx(np.stack([0 * b, b], axis=1), abs=1e-7)
        assert path.singular[100] and "sample 100" in path.note

    def test_stretching_out_and_back_keeps_the_branch(self):
        """At rest at the edge there is no kink to avoid."""
        _, points, *_ = minimum_jerk((0.5, 0.5), (1, 0), 101)
        path = inverse_path(Chain(2, lengths=HALF), np.vstack([points, points[-2::-1]]))
        assert path.switches == () and path.q == pytest.approx(path.q[::-1], abs=1e-12)

    def test_leaving_the_reach_is_told_where_and_by_how_much(self):
        """An error naming the first sample; or the nearest points, with a note."""
        chain, points = Chain(2, lengths=HALF), np.array([[0.9, 0.0], [1.0, 0.0], [1.25, 0.0], [1.5, 0.0]])
        with pytest.raises(InputError, match=r"sample 2 of 4.*by 0.25 m.*2 samples.*sample 3, by 0.5 m"):
            inverse_path(chain, points)
        path = inverse_path(chain, points, check=False)
        assert path.reachable.tolist() == [True, True, False, False] and path.distance == pytest.approx([0, 0, 0.25, 0.5])
        assert path.q[2:] == pytest.approx(np.zeros((2, 2)), abs=1e-12) and "sample 2" in path.note

    def test_many_samples_are_quick_and_right(self):
        """100,000 samples of two links in one go."""
        w = np.linspace(0.0, 20.0, 100_000)
        points = np.stack([0.5 * np.cos(w), 0.3 * np.sin(1.3 * w) + 0.3], axis=1)
        chain = Chain(2, lengths=HALF)
        assert np.abs(chain.numeric.position(inverse_path(chain, points).q) - points).max() < 1e-12

    @pytest.mark.parametrize(
        "wrong", [{"points": (1, 0)}, {"points": [(1, np.nan)]}, {"branch": 2}, {"branch": True}, {"start": (1,)}]
    )
    def test_bad_input(self, wrong):
        """Each argument is named."""
        with pytest.raises(InputError, match=next(iter(wrong))):
            inverse_path(Chain(2, lengths=HALF), **{"points": [(0.5, 0.5)], **wrong})


class TestRates:
    """q', q'', q''' of v, a, j."""

    @pytest.mark.parametrize("n", [2, 3, 5])
    def test_rates_are_derivatives_of_each_other(self, n: int):
        """Central differences of q, q', q'' agree at the rate h^2: halving the step leaves a quarter of the difference."""
        chain, worst = Chain(n, lengths=np.full(n, 0.5)), []
        for samples in (101, 201):
            t, points, v, a, j = minimum_jerk((-0.5, 0.5), (0, 0.7), samples)
            q = inverse_path(chain, points).q
            rates = joint_rates(chain, q, v, a, j)
            pairs = ((q, rates.qd), (rates.qd, rates.qdd), (rates.qdd, rates.qddd))
            worst.append([np.abs((x[2:] - x[:-2]) / (t[2] - t[0]) - y[1:-1]).max() for x, y in pairs])
        assert np.array(worst[0]) / worst[1] == pytest.approx([4, 4, 4], rel=0.12) and max(worst[1]) < 0.02

    @pytest.mark.parametrize("angles", ["joint", "segment", "vertical"])
    @pytest.mark.parametrize("n", [1, 2, 4])
    def test_the_chain_moves_as_was_asked(self, n: int, angles: str, rng: np.random.Generator):
        """By the chain's own symbols in numbers: v, a, j come back to 1e-9, and q' has no part in the null space of J."""
        chain = Chain(n, lengths=rng.uniform(0.5, 1.5, n), angles=angles)
        drawn = [
            rng.uniform(-1.0, 1.0, (20, n)) + 1.2 * (np.arange(n) if k == 0 and angles != "joint" else 0.6) for k in range(4)
        ]
        motion = [getattr(chain.numeric, name)(*drawn[: k + 2]) for k, name in enumerate(("velocity", "acceleration", "jerk"))]
        found = joint_rates(chain, drawn[0], *motion)
        again = [
            chain.numeric.velocity(drawn[0], found.qd),
            chain.numeric.acceleration(drawn[0], found.qd, found.qdd),
            chain.numeric.jerk(drawn[0], found.qd, found.qdd, found.qddd),
        ]
        for got, wanted in zip(again, motion, strict=True):
            assert got == pytest.approx(wanted, rel=1e-9, abs=1e-9)
        if n < 3:
            assert found.qddd == pytest.approx(drawn[3], rel=1e-6, abs=1e-6)
        else:
            null = np.linalg.svd(chain.numeric.jacobian(drawn[0]))[2][:, 2:]
            assert np.abs(null @ found.qd[..., None]).max() < 1e-12
            assert (np.linalg.norm(found.qd, axis=1) <= np.linalg.norm(drawn[1], axis=1)).all()

    def test_the_text_s_motion_starts_at_a_singularity(self):
        """Stretched out at t = 0: theta_2'' is 1.5 sqrt(10/t) there, without bound; told at sample 0, or NaN there only."""
        chain = Chain(2, lengths=HALF)
        t, points, v, a, j = minimum_jerk((1, 0), (0.5, 0.5), 10_001)
        path = inverse_path(chain, points)
        assert path.singular.tolist().count(True) == 1 and path.singular[0] and np.degrees(path.q[-1]) == pytest.approx([0, 90])
        with pytest.raises(SingularPose, match="sample 0 of 10001"):
            joint_rates(chain, path.q, v, a, j)
        rates = joint_rates(chain, path.q, v, a, j, at_singular="nan")
        assert np.isnan(rates.qdd[0]).all() and np.isfinite(rates.qddd[1:]).all()
        # Near the start r = 1 - 5 t^3 and r = 1 - theta_2^2/8: theta_2 = sqrt(40 t^3), theta_2'' = 1.5 sqrt(10/t).
        assert rates.qdd[1:20, 1] == pytest.approx(1.5 * np.sqrt(10 / t[1:20]), rel=1e-2)

    def test_one_sample_and_what_was_not_asked(self):
        """Vectors in, vectors out; no acceleration in, none out."""
        rates = joint_rates(Chain(2, lengths=HALF), (0, np.pi / 2), (-0.5, 0))
        assert rates.qd == pytest.approx([0, 1])
        assert rates.qd.shape == (2,) and rates.qdd.size == 0 and not rates.singular

    def test_a_single_link_cannot_leave_its_circle(self):
        """V along the radius, or a without the centripetal part."""
        chain = Chain(1, lengths=[2])
        with pytest.raises(InputError, match="velocity at sample 0"):
            joint_rates(chain, [0.0], (1, 2))
        with pytest.raises(InputError, match="acceleration"):
            joint_rates(chain, [0.0], (0, 2), (0, 0))
        assert joint_rates(chain, [0.0], (0, 2), (-2, 3)).qdd == pytest.approx([1.5])

    @pytest.mark.parametrize(
        ("arguments", "word"),
        [
            ({"q": (0,)}, "q"),
            ({"velocity": (1, 2, 3)}, "velocity"),
            ({"acceleration": (1, np.inf)}, "acceleration"),
            ({"jerk": (1, 2)}, "without an acceleration"),
            ({"at_singular": "inf"}, "at_singular"),
        ],
    )
    def test_bad_input(self, arguments, word):
        """Each argument is named."""
        with pytest.raises(InputError, match=word):
            joint_rates(Chain(2, lengths=HALF), **{"q": (0, 1), "velocity": (1, 0), **arguments})
