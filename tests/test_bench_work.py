"""The scenes of `bench_work`: references that share no code with our steps, which converge to them at their order. No times."""

from __future__ import annotations

import numpy as np
import pytest
from bench_work import ELLIPSE, OURS, Setting, crate, drop, front, stance, time_at

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")


@pytest.mark.parametrize(("make", "n", "largest"), [(crate, 4, 3e-4), (stance, 16, 4e-4), (drop, 16, 5e-4)])
def test_errors_fall_by_the_order_of_the_steps(make, n, largest):
    """Two steps, one half of the other: a quarter of the error, across slides, stops, impacts, the end of a push."""
    scene = make()
    first, second = (scene.error(scene.ours(k)[1], scene.rigid) for k in (n, 2 * n))
    assert first < largest and 3.0 < first / second < 5.0


def test_held_soles_are_of_order_four():
    """Runge and Kutta's scheme, where friction holds: the motion is the same, and half the step a sixteenth of the error."""
    scene = stance()
    way = f"{OURS}, RungeKutta4 on held soles"
    first, second = (scene.error(scene.ours(n, way)[1], scene.rigid) for n in (16, 32))
    assert first < 3e-5 and 11.0 < first / second < 30.0


def test_each_law_of_mujoco_has_its_own_limit():
    """Its steps of order four tend to it, where contacts last; it is not the motion of rigid contacts."""
    scene = stance()
    limit = scene.limit(ELLIPSE, 64)
    errors = [scene.error(scene.theirs(Setting("Newton", "RK4", ELLIPSE), n)[1], limit) for n in (16, 32)]
    assert errors[0] < 1e-4 and errors[0] / errors[1] > 8.0
    assert scene.error(limit, scene.rigid) > 1e-2


def test_a_front_has_the_runs_that_no_other_beats():
    """Of two settings; times between runs are straight in logarithms, and infinite below the least error."""
    curves = {"a, 1": [(1.0, 1e-1), (3.0, 1e-3)], "a, 2": [(2.0, 1e-2), (4.0, 1e-2)], "b": [(0.1, 1e-9)]}
    runs = front(curves, "a, ")
    assert [run[0] for run in runs] == [1.0, 2.0, 3.0]
    seconds, name = time_at(10.0**-2.5, runs)
    assert seconds == pytest.approx(np.sqrt(6.0)) and name == "a, 1"
    assert time_at(1e-4, runs) == (np.inf, "") and time_at(0.5, runs) == (1.0, "a, 1")
