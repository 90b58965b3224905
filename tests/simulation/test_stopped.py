"""Errors of the user's own functions, and Ctrl-C: what was computed is kept."""

from __future__ import annotations

import numpy as np
import pytest
from smooth_models import chain

import rbd
from rbd.simulation.simulated_motion import Sample

INTEGRATORS = pytest.mark.parametrize(
    "integrator", [rbd.RungeKutta4(), rbd.DormandPrince8(), rbd.TimeStepping(), rbd.TimeStepping(extrapolate=True)]
)


class Broken(Exception):
    """An error that `rbd` knows nothing of."""


def _raises(error, after):
    """A controller that raises an error from a time [s] on."""

    def controller(state, t):
        if t >= after:
            raise error
        return np.zeros(state.robot.nu)

    return controller


class _Fails:
    """Holds nothing, and raises an error where the first joint has turned far enough."""

    name = "fails"

    def __init__(self, error, at):
        self.error, self.at = error, at

    def rows(self, state):
        if state.q[0] < self.at:
            raise self.error
        return rbd.Rows(self.name, np.zeros((0, state.robot.nv)), np.zeros(0), rbd.problem.Free(0))


def _run(integrator, constraints=(), **more):
    start = rbd.State(chain(2), np.array([-0.1, 0.2]))
    return rbd.simulate(start, constraints, duration=0.2, step=0.01, integrator=integrator, progress=False, **more)


@INTEGRATORS
@pytest.mark.parametrize("given", ["controller", "external", "constraint"])
@pytest.mark.parametrize("error", [Broken("a cable came off"), ZeroDivisionError("division by zero"), KeyError("elbow")])
def test_an_error_of_a_users_function_keeps_the_motion_so_far(integrator, given, error):
    """It is the cause of `SimulationStopped`, which has the same trajectory as a run that ends there, and names the error."""
    if given == "constraint":
        more = {"constraints": [_Fails(error, -0.18)]}
    elif given == "controller":
        more = {"controller": _raises(error, 0.101)}
    else:
        more = {"external": lambda state, t: np.zeros(state.robot.nv) if t < 0.101 else _raises(error, 0.0)(state, t)}
    with pytest.raises(rbd.errors.SimulationStopped, match=type(error).__name__) as stopped:
        _run(integrator, **more)
    assert stopped.value.__cause__ is error
    kept, whole = stopped.value.trajectory, _run(integrator)
    assert 2 <= len(kept) <= 16
    assert kept.interrupted.startswith("stopped at t = 0.") and kept.end_reason is stopped.value.reason
    assert stopped.value.t == kept.t[-1]
    assert np.array_equal(stopped.value.state.q, kept.q[-1])
    assert np.array_equal(kept.t, whole.t[: len(kept)])
    assert np.abs(kept.q - whole.q[: len(kept)]).max() < 1e-9


@INTEGRATORS
def test_an_error_at_the_very_start_has_no_motion_to_keep(integrator):
    """The first call of a controller fails: nothing was recorded, and the message says so."""
    with pytest.raises(
        rbd.errors.SimulationStopped, match="Broken was raised .no power.*Nothing was recorded before"
    ) as stopped:
        _run(integrator, controller=_raises(Broken("no power"), 0.0))
    assert isinstance(stopped.value.__cause__, Broken)
    assert stopped.value.trajectory is None
    assert stopped.value.t == 0.0


@INTEGRATORS
def test_ctrl_c_keeps_what_was_computed_and_is_plain_before_the_first_step_is_done(integrator):
    """After some steps a trajectory that says so; at the start, and within the first step, a KeyboardInterrupt."""
    found = _run(integrator, controller=_raises(KeyboardInterrupt(), 0.101))
    assert found.interrupted.startswith("interrupted at t = 0.")
    assert found.end_reason is rbd.errors.Reason.INTERRUPTED
    assert 2 <= len(found) <= 12
    for after in (0.0, 0.004):
        with pytest.raises(KeyboardInterrupt):
            _run(integrator, controller=_raises(KeyboardInterrupt(), after))


def test_an_inaccurate_record_is_told_by_the_error_that_stops_a_run():
    """Rows that differ by 1e-4 m/s2, and a controller that fails: one error, that says both; no warning takes its place."""

    class Disagreeing:
        name = "disagreeing"

        def rows(self, state):
            return rbd.Rows(self.name, np.eye(2)[[0, 0]], np.array([0.0, 1e-4]), rbd.problem.Free(2))

    with pytest.raises(
        rbd.errors.SimulationStopped, match=r"Broken.*Before that, the simulation of chain is inaccurate.*\(scaled\)"
    ):
        _run(rbd.RungeKutta4(), [Disagreeing()], controller=_raises(Broken("gone"), 0.101))


class _ByHand:
    """An integrator of the user, whose acceleration is not finite from the second moment on."""

    def __init__(self, bad):
        self.bad = bad

    def reason_unsupported(self, motion, state):
        return None

    def run(self, motion, state, times):
        for t in times:
            a = np.array([1.0, self.bad if t else 2.0])
            yield Sample.of(t, state, a, np.zeros(state.robot.nu), dict)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_an_acceleration_that_is_not_finite_goes_no_further(bad):
    """Of whatever integrator: what came before is kept."""
    with pytest.raises(rbd.errors.SimulationStopped, match=r"the acceleration at t = 0\.01 s is not finite") as stopped:
        _run(_ByHand(bad))
    assert len(stopped.value.trajectory) == 1
    assert stopped.value.trajectory.a.tolist() == [[1.0, 2.0]]


@INTEGRATORS
def test_a_motion_that_runs_away_keeps_what_was_reached(integrator):
    """A joint that is driven beyond 1e5 rad/s: the motion till then, and words on what to look at."""
    start = rbd.State(chain(1), np.zeros(1))
    torque = 3e5 * start.M[0, 0] / 0.1  # in a tenth of a second three times as fast as a State may be
    with pytest.raises(rbd.errors.SimulationStopped, match="beyond bounds at t = .*reaches .*check what drives it") as stopped:
        rbd.simulate(
            start,
            duration=0.1,
            step=0.01,
            integrator=integrator,
            controller=lambda state, t: np.array([torque]),
            progress=False,
        )
    assert 0.0 < stopped.value.t <= 0.05 and stopped.value.trajectory.t[-1] == stopped.value.t
    assert 1e4 < abs(stopped.value.state.v[0]) <= 1e5
