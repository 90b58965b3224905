"""Pushes: what they weigh over whole steps, and together."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.control.schedules import Push, Pushes
from rbd.model.dynamics import free_force


@pytest.mark.parametrize("step", [1e-3, 2e-3, 1e-4, 0.1 / 3.0])
@pytest.mark.parametrize("start", [0.0, 0.1, 0.7])
def test_a_push_acts_on_whole_steps_however_their_times_are_rounded(step, start):
    """Of k steps from k * step, and of times that are added up, the same number is pushed: impulse = force * duration."""
    first, n = round(start / step), 3 * round(0.1 / step / 3.0) or 3
    push = Push("tip", (0.0, 1.0, 0.0), start=first * step, duration=n * step)
    times = [k * step for k in range(first + 2 * n)]
    summed = list(np.cumsum([0.0] + [step] * (first + 2 * n - 1)))
    for grid in (times, summed):
        acting = [k for k, t in enumerate(grid) if push.acts(t)]
        assert acting == list(range(first, first + n))
        assert [k for k, t in enumerate(grid) if push.acts(t + 0.5 * step)] == acting


def test_pushes_that_act_together_add_up(talos):
    """Two pushes and a load on one frame are their sum in the equations of motion; apart, each alone."""
    state = talos.standing()
    one = Push("torso_2_link", (0.0, 20.0, 0.0), start=0.0, duration=0.2)
    two = Push("torso_2_link", (5.0, 0.0, -3.0), start=0.1, duration=0.2, offset=(0.0, 0.0, 0.1))
    load = rbd.ExternalForce("arm_left_7_link", (0.0, 0.0, -10.0))
    together = Pushes([one, two, load])
    none = np.zeros(talos.nu)
    rest = free_force(state, none, None)[0]

    def extra(external) -> np.ndarray:
        return free_force(state, none, external)[0] - rest

    parts = extra([one._force]), extra([two._force]), extra([load])
    assert np.allclose(extra(together(state, 0.15)), sum(parts), atol=1e-9)
    assert np.allclose(extra(together(state, 0.05)), parts[0] + parts[2], atol=1e-9)
    assert np.allclose(extra(together(state, 0.25)), parts[1] + parts[2], atol=1e-9)
    assert not extra(one(state, 0.3)).any()
    assert np.allclose(one.impulse, [0.0, 4.0, 0.0])


def test_a_push_says_what_it_is():
    """In one line, for tables."""
    assert str(Push("torso", (0, 220, 0), start=0.2, duration=0.1)) == "(0, 220, 0) N at torso from 0.2 to 0.3 s"


def test_wrong_pushes_are_refused():
    """What came, what was expected."""
    with pytest.raises(rbd.InputError, match="duration of the push at 'tip' is 0"):
        Push("tip", (0, 1, 0), start=0.0, duration=0)
    with pytest.raises(rbd.InputError, match="start of the push at 'tip' is nan"):
        Push("tip", (0, 1, 0), start=float("nan"), duration=1.0)
    with pytest.raises(rbd.InputError, match="three numbers"):
        Push("tip", (0, 1), start=0.0, duration=1.0)
    with pytest.raises(rbd.InputError, match="an entry of pushes is 3"):
        Pushes([3])
    with pytest.raises(rbd.InputError, match="expected a list"):
        Pushes("push")
