"""Published mechanisms from the builder: Andrews' squeezer, the Bricard mechanism and the simplest walker of example 32."""

from __future__ import annotations

import copy
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from test_examples import EXAMPLES, run

import rbd

EXAMPLE = next(path for path in EXAMPLES if path.stem == "32_models_in_memory")
SPRING = rbd.Spring("D", to=(0.014, 0.072, 0.0), stiffness=4530.0, rest=0.07785)


@cache
def models() -> tuple[ModuleType, dict[str, rbd.Trajectory]]:
    """The example and its motions, computed once."""
    module, result, _ = run(EXAMPLE)
    return module, result


def test_each_model_is_built_in_twenty_lines() -> None:
    """Of the example's text, and without a file."""
    text = EXAMPLE.read_text().split("\n\n\n")
    for name in ("squeezer", "bricard", "walker"):
        (body,) = [part for part in text if part.startswith(f"def {name}(")]
        assert len(body.splitlines()) <= 24 and "save" not in body and "open" not in body
    assert all(motion.robot.source.in_memory for motion in models()[1].values())  # type: ignore[attr-defined]


# ------------------------------------------------------------------------------------------------- Andrews' squeezer


def test_the_squeezer_starts_as_published() -> None:
    """The test set's initial accelerations and Lagrange multipliers, here forces in the pins [Mazzia2008].

    Its multipliers belong to the six equations of the three loops, each in x and y.
    """
    module, _ = models()
    robot = module.squeezer()
    state = robot.at("start")
    assert max(np.abs(loop.rows(state).error).max() for loop in robot.loops()) < 1e-15
    found = rbd.solve(state, [0.033], robot.loops(), external=SPRING)
    a = {name: found.a[robot.joints[name].v.start] for name in robot.joints}
    assert a["beta"] == pytest.approx(14222.4439199541138705911625887, rel=1e-12)
    assert a["theta"] == pytest.approx(-10666.8329399655854029433719415, rel=1e-12)
    assert max(abs(a[name]) for name in ("gamma", "delta", "phi", "epsilon", "omega")) < 1e-9
    forces = np.array([found.forces[f"K2 {body}"][:2] for body in ("K3", "K4", "K6")])
    assert np.abs(forces[0]) == pytest.approx([98.5668703962410896057654982170, 6.12268834425566265503114393122], rel=1e-11)
    assert np.abs(forces[1:]).max() < 1e-10


def test_the_squeezer_moves_as_published() -> None:
    """All angles and speeds at 0.03 s: to nine of the digits that the test set gives, against the largest of their kind."""
    module, result = models()
    end = result["squeezer"][-1].state
    speeds = {"beta": 1139.920302151208, "theta": -1424.379294994111, "gamma": 11.03291221937134, "phi": 19.29337464421385}
    speeds |= {"delta": 0.5735699284790808, "omega": -19.29337464421385, "epsilon": 0.3231791658026955}
    assert end.robot.name == "squeezer" and module.off(result["squeezer"]) < 3e-9
    wrong = max(abs(end.v[end.robot.joints[name].v.start] - speed) for name, speed in speeds.items())
    assert wrong < 1e-9 * 1424.4


def test_the_squeezer_s_mass_matrix_is_the_published_one(rng: np.random.Generator) -> None:
    """M of the test set's Fortran, in its seven angles, at random angles; the spring's generalised force too."""
    module, _ = models()
    robot = module.squeezer()
    names = ["beta", "theta", "gamma", "phi", "delta", "omega", "epsilon"]
    at = [robot.joints[name].v.start for name in names]
    for _ in range(3):
        be, th, ga, ph, de, om, ep = angles = rng.uniform(-3.0, 3.0, 7)
        q = np.zeros(7)
        q[at] = angles
        state = robot.at(q)
        assert np.allclose(state.M[np.ix_(at, at)], squeezer_mass(th, ph, om), rtol=1e-12, atol=1e-18)
        tau, _ = SPRING.generalised(state)
        pull = squeezer_pull(ga)
        assert np.allclose(tau[at], [0, 0, pull, 0, 0, 0, 0], rtol=1e-11, atol=1e-12)


def squeezer_mass(th: float, ph: float, om: float) -> np.ndarray:
    """M of the test set."""
    m1, m2, m3, m4, m5, m6, m7 = 0.04325, 0.00365, 0.02373, 0.00706, 0.07050, 0.00706, 0.05498
    i1, i2, i3, i4, i5, i6, i7 = 2.194e-6, 4.410e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5
    da, e, ea, rr, ra, sa, sb = 0.0115, 0.02, 0.01421, 0.007, 0.00092, 0.01874, 0.01043
    ta, tb, u, ua, ub, zf, zt, fa = 0.02308, 0.00916, 0.04, 0.01228, 0.00449, 0.02, 0.04, 0.01421
    M = np.zeros((7, 7))
    M[0, 0] = m1 * ra**2 + m2 * (rr**2 - 2 * da * rr * np.cos(th) + da**2) + i1 + i2
    M[1, 0] = M[0, 1] = m2 * (da**2 - da * rr * np.cos(th)) + i2
    M[1, 1] = m2 * da**2 + i2
    M[2, 2] = m3 * (sa**2 + sb**2) + i3
    M[3, 3] = m4 * (e - ea) ** 2 + i4
    M[4, 3] = M[3, 4] = m4 * ((e - ea) ** 2 + zt * (e - ea) * np.sin(ph)) + i4
    M[4, 4] = m4 * (zt**2 + 2 * zt * (e - ea) * np.sin(ph) + (e - ea) ** 2) + m5 * (ta**2 + tb**2) + i4 + i5
    M[5, 5] = m6 * (zf - fa) ** 2 + i6
    M[6, 5] = M[5, 6] = m6 * ((zf - fa) ** 2 - u * (zf - fa) * np.sin(om)) + i6
    M[6, 6] = m6 * ((zf - fa) ** 2 - 2 * u * (zf - fa) * np.sin(om) + u**2) + m7 * (ua**2 + ub**2) + i6 + i7
    return M


def squeezer_pull(ga: float) -> float:
    """The moment of the test set's spring about B."""
    c0, lo, xb, yb, xc, yc, sc, sd = 4530.0, 0.07785, -0.03635, 0.03273, 0.014, 0.072, 0.018, 0.02
    xd = sd * np.cos(ga) + sc * np.sin(ga) + xb
    yd = sd * np.sin(ga) - sc * np.cos(ga) + yb
    length = np.hypot(xd - xc, yd - yc)
    fx, fy = -c0 * (length - lo) / length * np.array([xd - xc, yd - yc])
    return float(fx * (sc * np.cos(ga) - sd * np.sin(ga)) + fy * (sd * np.cos(ga) + sc * np.sin(ga)))


def test_the_squeezer_from_its_files_moves_the_same(tmp_path: Path) -> None:
    """Bit by bit; the same robot again from its trajectory's file, which needs no other."""
    module, result = models()
    whole = result["squeezer"]
    whole.save(tmp_path / "whole.npz")
    again = rbd.Trajectory.load(tmp_path / "whole.npz").robot
    assert isinstance(again, rbd.Robot) and again.model == whole.robot.model
    first = rbd.solve(again.at("start"), [0.033], again.loops(), external=SPRING)
    other = rbd.solve(whole.robot.at("start"), [0.033], whole.robot.loops(), external=SPRING)  # type: ignore[attr-defined]
    assert np.array_equal(first.a, other.a)


# --------------------------------------------------------------------------------------------- the Bricard mechanism


def test_the_bricard_is_over_constrained_and_moves() -> None:
    """Five hinges and five rows of rank four, in every pose of the motion; its sixth hinge stays closed."""
    _, result = models()
    motion = result["bricard"]
    (loop,) = motion.robot.loops()  # type: ignore[attr-defined]
    for sample in motion[::20]:
        rows = loop.rows(sample.state)
        assert rows.J.shape == (5, 5) and np.linalg.matrix_rank(rows.J, tol=1e-9) == 4
        assert np.abs(rows.error).max() < 1e-11
    mobility = rbd.mechanism.mobility(motion[0].state)
    assert (mobility.count.value, mobility.instantaneous, mobility.finite) == (0, 1, 1)


def test_the_bricard_keeps_its_energy_and_its_symmetry() -> None:
    """The kinetic energy is that of uniform bars, summed here by hand; alternate hinges turn alike, as the trihedral's do."""
    _, result = models()
    motion = result["bricard"]
    assert np.ptp(motion.energy) < 1e-10 * motion.kinetic.max() and motion.kinetic.max() > 10.0
    for k in range(0, len(motion), 25):
        state = motion[k].state
        q = state.q
        assert np.allclose([q[2] - q[0], q[4] - q[0], q[3] - q[1]], 0.0, atol=1e-9)
        by_hand = 0.0
        for i in range(1, 6):
            J = state.frame(f"bar {i}").J
            v, w = (J @ state.v)[:3], (J @ state.v)[3:]
            (_, *others) = [shape for shape in state.robot.visual_model.geometryObjects]  # type: ignore[attr-defined]
            along = others[i - 1].placement.translation  # half the bar, in its joint's axes
            half = state.frame(f"bar {i}").X_WF.rotation @ along
            speed = v + np.cross(w, half)
            spin = w - half * (w @ half) / (half @ half)
            axial = (w @ half) ** 2 / (half @ half)
            by_hand += 0.5 * (speed @ speed + spin @ spin / 12.0 + axial * 0.01**2 / 2.0)
        assert by_hand == pytest.approx(motion.kinetic[k], rel=1e-10, abs=1e-9)


# ------------------------------------------------------------------------------------------------ the simplest walker


def test_the_walker_has_the_compass_s_equations(rng: np.random.Generator) -> None:
    """On one foot, its two angles accelerate as Goswami's compass gait with masses at hip and feet, gravity on a slope."""
    module, _ = models()
    m, slope = 0.3, module.SLOPE
    robot = module.walker(m)
    foot = rbd.PointContact("left", "left_foot", friction=None)
    for _ in range(3):
        stance, swing, w, u = rng.uniform(-0.5, 0.5, 4)  # of the legs, from the normal, counter-clockwise
        start = [-np.sin(stance), np.cos(stance), np.cos(stance), np.sin(stance), swing - stance]
        state = robot.at(start, [-w, 0.0, w, u - w])
        found = rbd.solve(state, [], [foot])
        c, s = np.cos(stance - swing), np.sin(stance - swing)
        # M of (swing, stance): l = b = 1, a = 0; see Goswami, Thuilot and Espiau (1998), equations 1 and 2.
        M = np.array([[m, -m * c], [-m * c, 1.0 + m]])
        bias = np.array([m * s * w**2, -m * s * u**2])
        weight = np.array([m * np.sin(swing - slope), -(1.0 + m) * np.sin(stance - slope)])
        expected = np.linalg.solve(M, -bias - weight)
        assert found.a[2] == pytest.approx(expected[1], abs=1e-12)
        assert found.a[2] + found.a[3] == pytest.approx(expected[0], abs=1e-12)


def test_the_walker_s_step_ends_as_it_began() -> None:
    """As [Garcia1998] for feet without mass: the difference is of first order in the mass of a foot."""
    module, result = models()
    light, heavy = module.again(result["walker"]), module.again(module.step(module.walker(2.0 * module.FOOT)))
    assert heavy == pytest.approx(2.0 * light, rel=5e-3)
    assert np.abs(2.0 * light - heavy).max() < 1e-6  # extrapolated to feet without mass


def test_copies_of_these_robots_move_the_same() -> None:
    """A deep copy, with the gravity that was given."""
    module, _ = models()
    robot: Any = module.walker()
    copied = copy.deepcopy(robot)
    assert np.array_equal(copied.gravity, robot.gravity) and copied.model == robot.model
