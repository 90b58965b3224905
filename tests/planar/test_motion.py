"""Minimum-jerk motions: closed forms, and the same motion in end-point and joint space."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from rbd.errors import InputError, NoSolution, SingularPose
from rbd.planar import Chain, endpoint_motion, joint_motion, minimum_jerk

TWO = Chain(2, lengths=(0.5, 0.5))
TEXT = minimum_jerk([1.0, 0.0], [0.5, 0.5], 1.0)


def rates(values: np.ndarray, step: float) -> np.ndarray:
    """Derivative of even samples by central differences of fourth order, without the two outermost on each side."""
    return (values[:-4] - 8.0 * values[1:-3] + 8.0 * values[3:-1] - values[4:]) / (12.0 * step)


def test_minimum_jerk_peaks_are_those_of_the_quintic():
    """Speed 1.875 D/d at d/2; acceleration 10/sqrt 3 D/d^2 at (1 -+ 1/sqrt 3) d/2; jerk 60 D/d^3 at the ends."""
    path = minimum_jerk([1.0, -2.0, 0.5], [0.0, 0.0, 2.5], 2.5)
    far, d, p = 3.0, 2.5, path.peaks
    t = path.times(200_001)
    speed, acceleration, jerk = (np.linalg.norm(f(t), axis=1) for f in (path.velocity, path.acceleration, path.jerk))
    assert path.distance == far and p.speed_at == d / 2 and p.jerk_at == (0.0, d)
    assert p.speed == 1.875 * far / d == pytest.approx(speed.max(), rel=1e-9)
    assert p.acceleration == pytest.approx(10.0 / np.sqrt(3.0) * far / d**2) == pytest.approx(acceleration.max(), rel=1e-9)
    assert p.acceleration_at == pytest.approx(((1 - 3**-0.5) * d / 2, (1 + 3**-0.5) * d / 2))
    assert np.linalg.norm(path.acceleration(p.acceleration_at), axis=1) == pytest.approx(p.acceleration)
    assert p.jerk == pytest.approx(60.0 * far / d**3) == pytest.approx(jerk.max()) and jerk[0] == jerk.max()


def test_minimum_jerk_rests_outside_and_is_exact_at_its_ends():
    """Before and after it nothing moves; at the ends the position is exact, and the jerk is the one inside."""
    path = minimum_jerk([0.1, 0.7], [0.3, -0.2], 3.0)
    t = [-1.0, 0.0, 3.0, 4.0]
    assert np.array_equal(path.displacement(t), [path.start, path.start, path.stop, path.stop])
    assert not path.velocity(t).any() and not path.acceleration(t).any()
    assert not path.jerk([-1e-9, 3.0 + 1e-9]).any()
    np.testing.assert_allclose(path.jerk([0.0, 3.0]), np.full((2, 1), 60.0 / 27.0) * (path.stop - path.start))
    assert path.displacement(1.0).shape == (2,) and path.displacement([[1.0, 2.0]]).shape == (1, 2, 2)
    assert minimum_jerk(0.0, 1.0, 1.0).jerk([0.0, 0.5]).tolist() == [60.0, -30.0]


def test_minimum_jerk_in_symbols_is_the_same_function():
    """The quintic in SymPy, exact fractions, differentiates into what the numbers say; its sixth derivative is zero."""
    t = Chain(2).t
    for k, f in enumerate((TEXT.displacement, TEXT.velocity, TEXT.acceleration, TEXT.jerk)):
        expr = TEXT.symbolic(k)
        assert expr.shape == (2, 1) and expr.free_symbols == {t}
        for at in (0.0, 0.3, 1.0):
            np.testing.assert_allclose(np.array(expr.subs(t, at), float).ravel(), f(at), atol=1e-13)
    assert sympy.diff(TEXT.symbolic(), t, 6).is_zero_matrix  # Euler's equation of least jerk
    assert not minimum_jerk(0.0, 0.5, 2.0).symbolic().has(sympy.Float)


def test_no_motion_between_the_same_ends_has_less_jerk():
    """Any other motion with the same rest at both ends, here a bump s^4 (1 - s)^4, has more squared jerk."""
    path = minimum_jerk(0.0, 1.0, 1.0)
    t = np.linspace(0.0, 1.0, 4001)
    bump = np.polynomial.Polynomial([0.0] * 3 + [1.0]) * np.polynomial.Polynomial([1.0, -1.0]) ** 3
    own = path.jerk(t)
    for size in (-0.5, 0.1, 2.0):
        assert np.trapezoid((own + size * bump.deriv(3)(t)) ** 2, t) > np.trapezoid(own**2, t)


def test_duartes_two_link_reach():
    """Links of 0.5 m, (-0.5, 0.5) to (0, 0.5 sqrt 2) m in 1 s: joints go from (90, 90) to (45, 90) degrees."""
    motion = endpoint_motion(TWO, minimum_jerk([-0.5, 0.5], [0.0, 0.5 * np.sqrt(2.0)], 1.0))
    np.testing.assert_allclose(np.degrees(motion.q[[0, -1]]), [[90.0, 90.0], [45.0, 90.0]], atol=1e-10)
    assert not motion.note and not motion.unbounded and len(motion) == 101


def test_the_texts_motion_starts_at_a_singular_pose_and_says_so():
    """(1, 0) to (0.5, 0.5) m: stretched out at t = 0, th2'' -> 1.5 sqrt(10)/sqrt(t); sampled from 0.01 s, as in the text."""
    motion = endpoint_motion(TWO, TEXT)
    assert len(motion) == 100 and motion.t[0] == 0.01 and motion.unbounded == (0.0,)
    assert "begins stretched out" in motion.note and "without bound" in motion.note and "t = 0 s" in motion.note
    np.testing.assert_allclose(np.degrees(motion.q[-1]), [0.0, 90.0], atol=1e-10)
    for field in ("x", "v", "a", "j", "q", "qd", "qdd", "qddd"):
        assert np.isfinite(getattr(motion, field)).all()
    early = endpoint_motion(TWO, TEXT, times=[0.001, 0.002])
    np.testing.assert_allclose(early.qdd[:, 1] * np.sqrt(early.t), 1.5 * np.sqrt(10.0), rtol=1e-2)
    np.testing.assert_allclose(early.qdd[:, 0] * np.sqrt(early.t), -0.75 * np.sqrt(10.0), rtol=1e-2)
    back = endpoint_motion(TWO, minimum_jerk([0.5, 0.5], [1.0, 0.0], 1.0))
    assert back.unbounded == (1.0,) and "ends stretched out" in back.note
    with pytest.raises(SingularPose):
        endpoint_motion(TWO, TEXT, times=[0.0])


@pytest.mark.parametrize("angles", ["joint", "segment", "vertical"])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_angles_of_an_end_point_motion_give_it_back(n: int, angles: str):
    """Forward kinematics gives the path that was planned; q, qd, qdd, qddd are each other's derivatives in time."""
    chain = Chain(n, lengths=np.linspace(1.3, 0.7, n) / n, angles=angles)
    path = minimum_jerk([0.7, -0.3], [0.1, 0.6], 1.5)
    motion = endpoint_motion(chain, path, times=path.times(3001))
    k, state = chain.numeric, (motion.q, motion.qd, motion.qdd, motion.qddd)
    np.testing.assert_allclose(k.position(motion.q), path.displacement(motion.t), atol=1e-13)
    np.testing.assert_allclose(k.velocity(*state[:2]), path.velocity(motion.t), atol=1e-12)
    np.testing.assert_allclose(k.acceleration(*state[:3]), path.acceleration(motion.t), atol=1e-11)
    np.testing.assert_allclose(k.jerk(*state), path.jerk(motion.t), atol=1e-10)
    np.testing.assert_allclose(motion.split.total, motion.a, atol=1e-11)
    for low, high in zip(state[:-1], state[1:], strict=True):
        np.testing.assert_allclose(rates(low, 0.0005), high[2:-2], atol=2e-5 * np.abs(high).max())


def test_rates_of_a_redundant_chain_are_the_least():
    """Of four links every other rate with the same end-point velocity is longer: qd is perpendicular to the null space."""
    chain = Chain(4, lengths=[0.25] * 4)
    motion = endpoint_motion(chain, minimum_jerk([0.7, -0.3], [0.1, 0.6], 1.0))
    _, _, Vt = np.linalg.svd(chain.numeric.jacobian(motion.q))
    assert np.abs(Vt[:, 2:] @ motion.qd[..., None]).max() < 1e-12


def test_joint_space_motion_is_straight_in_joint_space():
    """The text's one link, 0 to 90 degrees: speed l th', and both parts of the acceleration in closed form."""
    motion = joint_motion(Chain(1, lengths=[1.0]), minimum_jerk(0.0, np.pi / 2, 1.0))
    th, w, alpha = motion.q[:, 0], motion.qd[:, 0], motion.qdd[:, 0]
    np.testing.assert_allclose(motion.speed, np.abs(w), atol=1e-14)
    np.testing.assert_allclose(
        motion.split.tangential, alpha[:, None] * np.stack([-np.sin(th), np.cos(th)], axis=1), atol=1e-13
    )
    np.testing.assert_allclose(
        motion.split.centripetal, -(w**2)[:, None] * np.stack([np.cos(th), np.sin(th)], axis=1), atol=1e-13
    )
    assert not motion.split.coriolis.any() and np.all(motion.manipulability == pytest.approx(1.0))
    two = joint_motion(TWO, minimum_jerk([0.0, 0.0], [0.0, np.pi / 2], 1.0))
    assert len(two) == 101 and "in line at t = 0" in two.note and not two.unbounded
    turned = rates(two.x, 0.01) - two.v[2:-2]
    assert np.abs(turned).max() < 2e-6


def test_one_motion_in_both_spaces():
    """The angles of an end-point motion, run forwards, and the branches of two links: mirror images about the path's line."""
    path = minimum_jerk([0.8, 0.0], [0.3, 0.0], 1.0)
    up, down = (endpoint_motion(TWO, path, branch=b) for b in (0, 1))
    np.testing.assert_allclose(up.q, -down.q, atol=1e-14)
    assert (up.q[:, 1] > 0.0).all()
    again = endpoint_motion(TWO, path, start=down.q[0])
    np.testing.assert_array_equal(again.q, down.q)


def test_a_path_through_the_base_goes_on_without_a_jump():
    """Equal links, straight through the base: the bend passes 180 degrees; only the sample in line is left out."""
    motion = endpoint_motion(TWO, minimum_jerk([0.6, 0.0], [-0.6, 0.0], 1.0))
    assert len(motion) == 100 and 0.5 not in motion.t and not motion.unbounded and "t = 0.5 s" in motion.note
    assert np.abs(np.diff(motion.q, axis=0)).max() < 0.15 and motion.q[-1, 1] > np.pi


def test_paths_that_leave_the_reach_are_refused_with_the_distance():
    """Beyond the stretched chain, through the hole around the base, off the circle of one link."""
    with pytest.raises(NoSolution, match=r"the end, \(1.2, 0.5\) m, is out of reach by 0.3 m"):
        endpoint_motion(TWO, minimum_jerk([1.0, 0.0], [1.2, 0.5], 1.0))
    with pytest.raises(NoSolution, match=r"of the path, \(0, 0\) m, is out of reach by 0.4 m"):
        endpoint_motion(Chain(2, lengths=(0.7, 0.3)), minimum_jerk([0.9, 0.0], [-0.9, 0.0], 1.0))
    with pytest.raises(NoSolution, match=r"circle of radius 1 m.*joint_motion"):
        endpoint_motion(Chain(1, lengths=[1.0]), minimum_jerk([1.0, 0.0], [0.0, 1.0], 1.0))


@pytest.mark.parametrize(
    "ask",
    [
        lambda: minimum_jerk([0.0], [1.0, 2.0], 1.0),
        lambda: minimum_jerk([], [], 1.0),
        lambda: minimum_jerk([np.nan], [1.0], 1.0),
        lambda: minimum_jerk("a", 1.0, 1.0),
        lambda: minimum_jerk(0.0, 1.0, 0.0),
        lambda: minimum_jerk(0.0, 1.0, -1.0),
        lambda: minimum_jerk(0.0, 1.0, np.inf),
        lambda: minimum_jerk(0.0, 1.0, True),
        lambda: minimum_jerk(0.0, 1.0, 1e-200),
        lambda: TEXT.velocity([np.nan]),
        lambda: TEXT.times(1),
        lambda: TEXT.symbolic(4),
        lambda: TEXT.symbolic(t="t"),
        lambda: endpoint_motion(TWO, [1.0, 0.0]),
        lambda: endpoint_motion(Chain(2), TEXT),
        lambda: endpoint_motion("chain", TEXT),
        lambda: endpoint_motion(TWO, minimum_jerk([1.0] * 3, [0.0] * 3, 1.0)),
        lambda: endpoint_motion(TWO, TEXT, branch=2),
        lambda: endpoint_motion(TWO, TEXT, times=[0.2, 0.1]),
        lambda: endpoint_motion(TWO, TEXT, times=[[0.1]]),
        lambda: endpoint_motion(TWO, TEXT, times=[0.1, np.inf]),
        lambda: endpoint_motion(TWO, TEXT, start=[0.0]),
        lambda: joint_motion(Chain(3, lengths=[1.0] * 3), TEXT),
        lambda: joint_motion(TWO, 3.0),
    ],
)
def test_what_means_nothing_is_refused(ask):
    """Input errors, never a number that is none."""
    with pytest.raises(InputError):
        ask()
