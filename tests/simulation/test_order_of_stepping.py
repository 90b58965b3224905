"""Order of `TimeStepping`: half the step, a quarter of the error, also where contact begins, ends, sticks or slips."""

from __future__ import annotations

import numpy as np
import pytest
from closed_forms import Ladder, RimlessWheel
from contact_cases import (
    billiard_ball,
    block_on_belt,
    block_thrown_up,
    bouncing_ball,
    ladder,
    rimless_wheel,
    rocking_block,
    rod_on_rough_table,
    rubbed_oscillator,
    sliding_disk,
    spinning_tripod,
    stopped_pendulum,
    symmetric_flight,
    toppling_crate,
)
from courses import OnePoint, rod_inertia

MS = 1e-3
SMOOTH = {
    "ladder on floor and wall": (lambda: ladder(), 0.4, 1.5e-4),
    "ladder rough at both ends": (lambda: ladder(floor=0.1, wall=0.15), 0.4, 9e-5),
    "rod that sticks": (lambda: rod_on_rough_table(1.0)[0], 0.84, 2.6e-4),
    "disk on three feet": (lambda: spinning_tripod()[0], 0.32, 3.2e-3),
    "top in flight": (lambda: symmetric_flight(), 0.4, 7e-4),
}
"""Case, time, error at 4 ms: nothing begins or ends on the way."""
EVENTFUL = {
    "ladder off the wall": (lambda: ladder(), 0.6, 4e-5),
    "rod that slips": (lambda: rod_on_rough_table(1.0)[0], 1.04, 8e-5),
    "rod that slips back, then forwards": (lambda: rod_on_rough_table(0.3)[0], 1.04, 4e-5),
    "rod that slips, sticks, slips": (lambda: rod_on_rough_table(0.36)[0], 1.04, 6e-5),
    "pendulum on its stop": (lambda: stopped_pendulum(0.3, 0.5)[0], 1.2, 1e-5),
    "pendulum stopped": (lambda: stopped_pendulum(-0.3, 0.0)[0], 1.2, 8e-6),
    "oscillator with dry friction": (lambda: rubbed_oscillator(), 0.56, 1.5e-4),
    "block that rocks": (lambda: rocking_block()[0], 1.04, 4e-5),
    "block that rocks in space": (lambda: rocking_block(spatial=True)[0], 0.64, 2e-5),
    "rimless wheel": (lambda: rimless_wheel(1.3, 3, RimlessWheel(j=0.01))[0], 1.2, 3e-5),
}
"""Likewise, the error at 2 ms, with impacts, and changes between sticking, slipping and leaving."""
EXACT = {
    "block that stops on a slope": lambda brick: block_thrown_up(brick, 0.5),
    "block that comes back": lambda brick: block_thrown_up(brick, 0.3),
    "block on a belt": block_on_belt,
    "ball that bounces": lambda _: bouncing_ball(0.8),
    "ball that slips and rolls": lambda _: billiard_ball((2.0, 0.0, 0.0)),
    "ball struck aslant": lambda _: billiard_ball((2.0, 0.5, 0.0), (-3.0, -30.0, 5.0)),
    "disk that slips and rolls": lambda _: sliding_disk(),
}
"""Constant accelerations, events and all."""


def errors(case, until, steps) -> np.ndarray:
    """At the end, for each step."""
    return np.array([case.error(case.run(until, h)) for h in steps])


@pytest.mark.parametrize("name", SMOOTH)
def test_between_events_half_the_step_is_a_quarter_of_the_error(name):
    """To 3 %, at 8 and 4 ms."""
    make, until, bound = SMOOTH[name]
    e = errors(make(), until, (8 * MS, 4 * MS))
    assert e[0] / e[1] == pytest.approx(4.0, rel=0.03) and e[1] < bound


def test_a_crate_that_topples_does_so_at_second_order(crate):
    """Four corners of a sole, two of which leave at once."""
    e = errors(toppling_crate(crate, 110.0), 0.48, (8 * MS, 4 * MS))
    assert e[0] / e[1] == pytest.approx(4.0, rel=0.03) and e[1] < 1.7e-4


@pytest.mark.parametrize("name", EVENTFUL)
def test_across_events_it_stays_second_order(name):
    """Where in a step an event falls changes the constant: over two halvings the error falls by 16, within a factor of 2.5."""
    make, until, bound = EVENTFUL[name]
    e = errors(make(), until, (8 * MS, 2 * MS))
    assert e[1] < bound and 16.0 / 2.5 < e[0] / e[1] < 16.0 * 2.5


@pytest.mark.parametrize(("name", "make"), EXACT.items(), ids=EXACT)
def test_some_motions_are_exact_at_any_step(brick, name, make):
    """Parabolas between events, with each event at its own time: to rounding at 7 ms, which divides nothing here."""
    case = make(brick)
    trajectory = case.run(0.6, 7 * MS)
    assert max(case.error(trajectory, k) for k in range(0, len(trajectory), 4)) < 1e-11


def test_recorded_forces_are_of_second_order_too():
    """Of the state they stand beside: wall and floor of the ladder, foot of the rod, against the reduced equations."""
    truth = Ladder(10.0, 1.0, rod_inertia(10.0, 1.0), np.pi / 3.0)
    course = truth.course(0.4)
    rod, rod_course = rod_on_rough_table(1.0)
    body = OnePoint(10.0, rod_inertia(10.0, 1.0), (-1.0, 0.0), 1.0)
    off = np.zeros((2, 2))
    for i, step in enumerate((4 * MS, 2 * MS)):
        trajectory = ladder().run(0.4, step)
        for k in range(0, len(trajectory), 10):
            x, z, angle, vx, vz, w = course.at(float(trajectory.t[k]))
            turning = truth.fall * np.cos(angle)  # th = angle + pi
            wall = 10.0 * (np.sin(angle) * turning + np.cos(angle) * w * w)
            off[0, i] = max(off[0, i], abs(trajectory.forces["wall"][k, 0] - wall))
        trajectory = rod.run(0.84, step)
        for k in range(0, len(trajectory), 10):
            expected = body.force(rod_course.at(float(trajectory.t[k])), "sticks")
            off[1, i] = max(off[1, i], np.abs(trajectory.forces["foot"][k][[0, 2]] - expected).max())
    assert off[:, 0] / off[:, 1] == pytest.approx([4.0, 4.0], rel=0.1)
    assert (off[:, 1] < [1e-3, 2.5e-3]).all()
