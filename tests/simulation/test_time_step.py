"""The time step is a function: what it returns depends on where it begins and on its length alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from flat_bodies import chain, floor_point
from smooth_models import bricard

import rbd
from rbd.simulation.event_detection import ImpactRecord, StepRecord
from rbd.simulation.instant import Instant, Step
from rbd.simulation.simulated_motion import SimulatedMotion
from rbd.simulation.time_step import StepSystem

URDF = Path(__file__).parents[2] / "urdf"
H = 2e-3


def tumbling() -> tuple[SimulatedMotion, rbd.State]:
    """A box that falls on a corner: points enter and leave the contact set, slip and bounce."""
    box = rbd.load_robot(URDF / "box.urdf")
    q = np.array([0.0, 0.0, 0.4, 0.2, 0.3, 0.1, 1.0])
    q[3:] /= np.linalg.norm(q[3:])
    state = rbd.State(box, q, np.array([0.5, -0.2, 0.0, 3.0, -2.0, 1.0]))
    floor = rbd.CollisionContacts("floor", box, friction=0.5)
    return SimulatedMotion(box, (floor,), restitution={"floor": 0.4}, stabilisation=rbd.simulation.Projection()), state


def looped() -> tuple[SimulatedMotion, rbd.State]:
    """Bricard's mechanism, whose rows are linearly dependent: their norms are handed from step to step."""
    robot = bricard()
    ring = rbd.LoopClosure("ring", "pivot", "tip", kind="revolute", axis=(1.0, 0.0, 0.0))
    return SimulatedMotion(robot, (ring,), stabilisation=rbd.simulation.Projection()), rbd.State(robot, np.zeros(5))


def bits(step: Step) -> bytes:
    """All numbers of where a step ends."""
    end = step.end
    arrays = [end.at.state.q, end.at.state.v, end.force, end.closed, end.leaves]
    arrays += [x for x in (end.velocity, end.norms) if x is not None]
    return np.float64(end.t).tobytes() + b"".join(x.tobytes() for x in arrays)


@pytest.mark.parametrize("start", [tumbling, looped])
@pytest.mark.parametrize("extrapolate", [False, True])
def test_a_step_from_one_instant_is_the_same_at_any_time_and_in_any_order(start, extrapolate):
    """Taken again backwards, and after trial steps of other lengths, it gives the same bits."""
    motion, state = start()
    system = StepSystem(motion, state, impact_speed=1e-3, impacts=20, extrapolate=extrapolate)

    def taken(now: Instant, h: float) -> Step:
        return system.step(system.half_step(now, h), now.t + h)

    instants, ends = [system.begin(state, 0.0).end], []
    for _ in range(150):
        step = taken(instants[-1], H)
        instants.append(step.end)
        ends.append(bits(step))
    for now, known in reversed(list(zip(instants, ends, strict=False))[::7]):
        taken(now, 3.0 * H)
        taken(now, 0.1 * H)
        assert bits(taken(now, H)) == known


def test_what_is_recorded_does_not_change_the_motion():
    """Extrapolated half steps are solved where they are recorded only: that solution leaves nothing to the next step."""
    motion, state = looped()
    stepping = rbd.TimeStepping(extrapolate=True)

    def last(every: int) -> rbd.Trajectory:
        return rbd.simulate(
            state, motion.constraints, duration=0.4, step=5e-3, integrator=stepping, record_every=every, progress=False
        )

    always, rarely = last(1), last(80)
    np.testing.assert_array_equal(always.q[-1], rarely.q[-1])
    np.testing.assert_array_equal(always.v[-1], rarely.v[-1])


@pytest.mark.parametrize("extrapolate", [False, True])
def test_a_strike_so_near_the_end_of_a_step_that_its_time_rounds_to_it_ends_the_step(extrapolate):
    """A mass at 100 m/s, 1000 s after the start: 2e-14 s before the end are less than the last digit of the time.

    No part of no length follows; the mass flies back at half its speed.
    """
    t, speed, early = 1000.0, 100.0, 2e-14
    robot = chain([("z", pin.JointModelPZ(), 1.0, [0.1] * 3)], names=("mass",), name="mass")
    robot.model.gravity.linear = np.zeros(3)
    floor = floor_point("floor", (0.0,) * 3, friction=0.0, frame="mass")
    t_end = t + H
    state = rbd.State(robot, np.array([speed * (t_end - t - early)]), np.array([-speed]))
    motion = SimulatedMotion(robot, (floor,), restitution={"floor": 0.5}, stabilisation=rbd.simulation.Projection())
    system = StepSystem(motion, state, impact_speed=1e-3, impacts=20, extrapolate=extrapolate)
    begun = system.begin(state, t).end
    end, passed = system.step(system.half_step(begun, t_end - t), t_end)
    step, impact = passed
    assert isinstance(step, StepRecord) and isinstance(impact, ImpactRecord)
    assert t + step.h == t_end and 0.5 * early < t_end - t - step.h < 1.5 * early
    assert end.t == impact.t == t_end and end.at.state.v == pytest.approx([0.5 * speed], rel=1e-12)
