"""Events of the user: their times against closed forms and SciPy, what they leave unchanged, switches, and named errors."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from passive_walkers import COMPASS, SIDES
from scipy.integrate import solve_ivp
from scipy.special import ellipk

import rbd
from rbd.errors import BadEvent, InputError, Reason, SimulationStopped, UnknownName
from rbd.simulation import StateEvent, Switch

G = 9.81
SMOOTH = [rbd.RungeKutta4(), rbd.DormandPrince8()]
ALL = pytest.mark.parametrize("by", [*SMOOTH, rbd.TimeStepping()], ids=lambda by: type(by).__name__)
PENDULUM = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
"""A uniform rod of 1 m."""
W2 = 1.5 * G
"""Square of its frequency."""


def pendulum(angle):
    """(its state at rest at an angle from the downward vertical, f = that angle)."""
    return PENDULUM.at([angle - np.pi / 2.0]), lambda state: state.q[0] + np.pi / 2.0


def thrown(height=1.0, speed=0.0):
    """A box at a height, thrown up."""
    return rbd.State(rbd.testing.box(mass=10.0), [0, 0, height, 0, 0, 0, 1], [0, 0, speed, 0, 0, 0])


@ALL
def test_a_body_in_flight_passes_a_height_twice_at_the_times_of_its_parabola(by):
    """Up and down through 1.3 m, to rounding: parabolas are exact by all three."""
    two = [StateEvent(lambda s: s.q[2] - 1.3, "any"), StateEvent(lambda s, t: s.q[2] - 1.3, "down", direction=-1)]
    motion = rbd.simulate(thrown(speed=4.0), duration=0.9, step=0.05, events=two, integrator=by)
    up, down = (4.0 - np.array([1.0, -1.0]) * np.sqrt(16.0 - 2.0 * G * 0.3)) / G
    assert [(e.name, e.kind, e.point) for e in motion.events] == [
        ("any", "rises through zero", -1), ("any", "falls through zero", -1), ("down", "falls through zero", -1)
    ]  # fmt: skip
    assert np.abs(np.array([e.t for e in motion.events]) - [up, down, down]).max() < 1e-12
    for t in (up, down):
        (i,) = np.flatnonzero(np.abs(motion.t - t) < 1e-12)
        assert abs(motion.q[i, 2] - 1.3) < 1e-12
        assert abs(motion.a[i, 2] + G) < 1e-9
    grid = 0.05 * np.arange(19)
    assert np.abs(motion.t[np.searchsorted(motion.t, grid - 1e-12)] - grid).max() < 1e-12
    assert len(motion) == len(grid) + 2


@pytest.mark.parametrize(("by", "step", "order"), [(SMOOTH[0], 0.05, 4), (rbd.TimeStepping(), 0.01, 2)])
def test_times_of_events_have_the_order_of_the_integrator(by, step, order):
    """A pendulum from 1 rad passes the vertical after a quarter of its period, K(sin^2(1/2)) / w."""
    state, angle = pendulum(1.0)
    true = ellipk(np.sin(0.5) ** 2) / np.sqrt(W2)
    errors = []
    for h in (step, 0.5 * step):
        motion = rbd.simulate(state, duration=0.7, step=h, events=[angle], integrator=by)
        errors.append(abs(motion.events[0].t - true))
    assert errors[0] > 1e-12
    assert errors[0] / errors[1] > 0.7 * 2**order


def test_times_of_events_by_dormand_prince_are_exact_and_those_of_scipy():
    """Ten passages of a pendulum from 2 rad: quarter periods to 1e-10, and what solve_ivp gives with the same settings."""
    state, angle = pendulum(2.0)
    by = rbd.DormandPrince8(rtol=1e-12, atol=1e-13)
    motion = rbd.simulate(state, duration=11.0, step=0.5, events=[angle], integrator=by)
    quarter = ellipk(np.sin(1.0) ** 2) / np.sqrt(W2)
    times = np.array([e.t for e in motion.events])
    assert len(times) == 10
    assert np.abs(times - quarter * np.arange(1, 20, 2)).max() < 1e-10
    theirs = solve_ivp(
        lambda t, y: [y[1], -W2 * np.sin(y[0])], (0.0, 11.0), [2.0, 0.0], method="DOP853", rtol=1e-12, atol=1e-13,
        events=lambda t, y: y[0],
    )  # fmt: skip
    assert np.abs(times - theirs.t_events[0]).max() < 1e-10


@ALL
def test_events_do_not_change_the_motion(by):
    """The samples at the sample times are the same bits with and without events, and so are impacts."""
    corner = rbd.PointContact("corner", "box", friction=0.6, on=0.0)
    given = [corner] if isinstance(by, rbd.TimeStepping) else []
    state = rbd.State(rbd.testing.box(mass=10.0), [0, 0, 0.1, 0, 0, 0, 1], [1.0, 0, 0, 0.1, 0.2, 0.3])
    plain = rbd.simulate(state, given, duration=0.3, step=0.01, integrator=by)
    seen = rbd.simulate(state, given, duration=0.3, step=0.01, integrator=by, events=[lambda s: s.q[0] - 0.111])
    at = np.searchsorted(seen.t, plain.t)
    assert len(seen) == len(plain) + 1
    assert np.array_equal(seen.q[at], plain.q)
    assert np.array_equal(seen.v[at], plain.v)
    assert [e for e in seen.events if e.name == "corner"] == list(plain.events)


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
@ALL
def test_a_terminal_event_ends_the_motion_there(by):
    """The attributes of a plain function, as SciPy reads them; and the third passage of three."""
    state, angle = pendulum(1.0)

    def vertical(s):
        return angle(s)

    vertical.terminal, vertical.direction = True, 1
    motion = rbd.simulate(state, duration=5.0, step=0.05, events=[vertical], integrator=by)
    quarter = ellipk(np.sin(0.5) ** 2) / np.sqrt(W2)
    assert motion.t[-1] == motion.events[-1].t
    assert abs(motion.t[-1] - 3.0 * quarter) < 5e-3
    assert abs(angle(motion.state(-1))) < 1e-11
    assert motion.end_reason is Reason.EVENT
    assert motion.interrupted == f"ended by event 'vertical' at t = {motion.t[-1]:.6g} s"
    third = rbd.simulate(state, duration=5.0, step=0.05, events=[StateEvent(angle, "third", terminal=3)], integrator=by)
    assert abs(third.t[-1] - 5.0 * quarter) < 5e-3
    assert len(third.events) == 3


def test_events_are_in_files_and_prints(tmp_path):
    """A motion that is saved and read again has the same events."""
    motion = rbd.simulate(thrown(), duration=0.4, step=0.1, events=[StateEvent(lambda s: s.q[2] - 0.5, "half way")])
    motion.save(tmp_path / "fall.npz")
    assert rbd.Trajectory.load(tmp_path / "fall.npz", robot=motion.robot).events == motion.events
    assert "0.319275 s: half way falls through zero" in str(motion)


def test_a_ball_that_a_switch_reflects_bounces_as_one_with_restitution():
    """v+ = -e v at each touch, by a switch of `DormandPrince8`, and by the impacts of `TimeStepping`: the same bounces."""
    flight = thrown(0.5)
    bounce = StateEvent(lambda s: s.q[2], "bounce", direction=-1, then=lambda s, t: Switch(v=-0.6 * s.v))
    by = rbd.DormandPrince8()
    switched = rbd.simulate(flight, duration=1.2, step=0.1, events=[bounce], integrator=by)
    tip = rbd.PointContact("tip", "box", friction=0.0, on=0.0)
    stepped = rbd.simulate(flight, [tip], duration=1.2, step=0.1, restitution={"tip": 0.6})
    times = [[e.t for e in m.events if e.kind in ("touches", "falls through zero")] for m in (switched, stepped)]
    first = np.sqrt(2.0 * 0.5 / G)
    assert np.abs(np.array(times)[:, :3] - first * np.array([1.0, 2.2, 2.92])).max() < 1e-12
    assert np.abs(switched.q[-1] - stepped.q[-1]).max() < 1e-11


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
def test_a_held_contact_that_is_switched_off_lets_go():
    """A pendulum held at its tip falls from when it is let go: `inactive` and `off`, by smooth integrators."""
    state, angle = pendulum(1.0)
    lock = rbd.JointLock("lock", next(iter(PENDULUM.joints)))
    let_go = StateEvent(lambda s, t: t - 0.3, "let go", then=Switch(off="lock"))
    quarter = ellipk(np.sin(0.5) ** 2) / np.sqrt(W2)
    for by, within in ((rbd.DormandPrince8(), 1e-9), (rbd.RungeKutta4(), 1e-5), (rbd.TimeStepping(), 1e-3)):
        down = StateEvent(angle, "down", while_off="lock")
        motion = rbd.simulate(state, [lock], duration=1.0, step=0.02, events=[let_go, down], integrator=by)
        fell = [e.t for e in motion.events if e.name == "down"]
        assert abs(fell[0] - 0.3 - quarter) < within
        (i,) = np.flatnonzero(motion.t == next(e.t for e in motion.events if e.name == "let go"))
        assert set(motion.modes["lock"][:i]) == {"holds"}
        assert set(motion.modes["lock"][i:]) == {"open"}
        assert [e.kind for e in motion.events if e.name == "lock"] == ["leaves"]


def test_feet_that_scuff_are_ignored_while_they_are_off():
    """A compass gait on feet with friction by time steps: the swing foot goes below the slope, and strikes on time."""
    plane = rbd.Ground(point=(0.0, 0.0, 0.0), normal=COMPASS.normal)
    feet = [rbd.PointContact(side, side, friction=2.0, on=plane) for side in SIDES]
    y = np.array([0.2738, -0.2738, -1.09, -0.376])
    after, true = COMPASS.step(y)
    for step in (8e-3, 4e-3, 2e-3):
        motion = rbd.simulate(COMPASS.start(y), feet, duration=0.76, step=step, events=COMPASS.strikes, inactive="right")
        (strike,) = [e for e in motion.events if e.name == "right strikes"]
        (i,) = np.flatnonzero(motion.t == strike.t)
        error = max(abs(strike.t - true), np.abs(COMPASS.angles(motion.state(i), "right") - after).max())
        assert error < 2.0 * step**2
        depth = min(float(COMPASS.normal @ state.frame("right").X_WF.translation) for state in map(motion.state, range(i)))
        assert depth < -1e-4
        assert [e.kind for e in motion.events if e.name == "right"] == ["touches"]
        assert not motion.forces["right"][:i].any()


def test_work_of_the_motors_goes_on_across_switches():
    """A motor that turns a pendulum, and an event that halves the velocity: energy less work is kept between them."""
    state, angle = pendulum(0.5)
    motor = {"controller": lambda s, t: np.array([0.3]), "integrator": rbd.DormandPrince8()}
    stop = StateEvent(angle, "stop", terminal=3, then=lambda s, t: Switch(v=0.5 * s.v))
    motion = rbd.simulate(state, duration=6.0, step=0.05, events=[stop], **motor)
    assert len(motion.events) > 1
    rest = motion.energy - motion.motor_work
    lost = np.diff(rest)
    assert motion.motor_work[-1] != 0.0
    jumps = np.isin(motion.t[1:], [e.t for e in motion.events])
    assert np.abs(lost[~jumps]).max() < 1e-9
    assert (lost[jumps] < -1e-3).all()


BAD = {
    "nan": (lambda s: np.nan, "finite number"),
    "array": (lambda s: s.q, r"shape \(7,\)"),
    "text": (lambda s: "one", "expected one number"),
    "arguments": (lambda s, t, more: 0.0, "failed"),
}


@pytest.mark.parametrize("which", BAD)
def test_functions_that_give_no_number_are_refused_by_name(which):
    """At the start it is a BadEvent; later the cause of a SimulationStopped, with what was computed."""
    f, words = BAD[which]
    with pytest.raises(BadEvent, match=words) as caught:
        rbd.simulate(thrown(), duration=0.1, step=0.01, events=[StateEvent(f, "mine")])
    assert "'mine'" in str(caught.value)
    assert caught.value.reason is Reason.BAD_EVENT


def test_a_function_that_fails_later_stops_the_motion():
    """With the trajectory until then."""
    with pytest.raises(SimulationStopped, match="gave nan") as caught:
        rbd.simulate(thrown(), duration=0.5, step=0.01, events=[lambda s: 1.0 if s.q[2] > 0.9 else np.nan])
    assert caught.value.reason is Reason.STOPPED_BAD_EVENT
    assert isinstance(caught.value.__cause__, BadEvent)
    assert len(caught.value.trajectory) > 10


def test_a_function_that_is_zero_throughout_is_an_error_with_the_motion():
    """No event, and most likely not what was meant."""
    with pytest.raises(SimulationStopped, match="'flat' was zero at all") as caught:
        rbd.simulate(thrown(), duration=0.2, step=0.01, events=[StateEvent(lambda s: 0.0 * s.q[2], "flat")])
    assert caught.value.reason is Reason.STOPPED_BAD_EVENT
    assert len(caught.value.trajectory) == 21


def test_an_event_that_is_required_must_happen():
    """One that is nowhere zero is none; where it is required, that is an error with the motion."""
    never = StateEvent(lambda s: 1.0 + s.q[2] ** 2, "never")
    motion = rbd.simulate(thrown(), duration=0.2, step=0.01, events=[never])
    assert (motion.events, motion.absent) == ((), ("never",))
    assert "never did not happen" in str(motion)
    needed = StateEvent(lambda s: s.q[2] + 9.0, "landing", required=True)
    with pytest.raises(SimulationStopped, match="'landing' is required, and did not happen; its last value is 9.8") as caught:
        rbd.simulate(thrown(), duration=0.2, step=0.01, events=[needed])
    assert caught.value.reason is Reason.STOPPED_NO_EVENT
    assert len(caught.value.trajectory) == 21


def test_what_did_not_happen_is_in_files(tmp_path):
    """In both formats; older files have no such entry."""
    never = StateEvent(lambda s: 1.0 + s.q[2] ** 2, "never")
    motion = rbd.simulate(thrown(), duration=0.1, step=0.05, events=[never])
    for name in ("fall.npz", "fall.nc"):
        motion.save(tmp_path / name)
        assert rbd.Trajectory.load(tmp_path / name, robot=motion.robot).absent == ("never",)


def test_zeros_that_come_ever_faster_are_chatter():
    """A ball by switches, e = 0.5: infinitely many bounces in a finite time, refused before it falls through."""
    bounce = StateEvent(lambda s: s.q[2], "bounce", direction=-1, then=lambda s, t: Switch(v=-0.5 * s.v))
    with pytest.raises(SimulationStopped, match="'bounce' chatters: three zeros within") as caught:
        rbd.simulate(thrown(0.5), duration=1.2, step=0.1, events=[bounce], integrator=rbd.DormandPrince8())
    end = np.sqrt(2.0 * 0.5 / G) * 3.0  # sqrt(2 h / g) (1 + e) / (1 - e)
    assert abs(caught.value.t - end) < 1e-4


def test_rounding_about_zero_is_chatter_unless_it_counts_as_zero():
    """Sign changes at nearly every step."""
    with pytest.raises(SimulationStopped, match=r"chatters: \d+ zeros in 10 steps"):
        rbd.simulate(thrown(), duration=1.0, step=0.01, events=[lambda s, t: (-1.0) ** round(100.0 * t) * 1e-15])
    event = StateEvent(lambda s, t: (-1.0) ** round(100.0 * t) * 1e-15 + max(0.0, s.q[2] - 0.9), "small", zero=1e-12)
    found = rbd.simulate(thrown(), duration=0.5, step=0.01, events=[event])
    assert [e.name for e in found.events] == ["small"]
    assert abs(found.events[0].t - np.sqrt(0.2 / G)) < 1e-9


def test_a_switch_of_rounding_at_the_start_is_no_event():
    """A function that is zero at the start, or after a switch, has its event when it becomes zero again."""
    leaves = StateEvent(lambda s: s.q[2] - 1.0, "level")
    motion = rbd.simulate(thrown(speed=1.0), duration=0.5, step=0.01, events=[leaves])
    assert len(motion.events) == 1
    assert abs(motion.events[0].t - 2.0 / G) < 1e-12


WRONG = {
    "direction": (lambda: StateEvent(len, "x", direction=2), InputError, "direction of event 'x' is 2"),
    "terminal": (lambda: StateEvent(len, "x", terminal=-1), InputError, "terminal"),
    "then": (lambda: StateEvent(len, "x", then=3), InputError, "expected an rbd.simulation.Switch"),
    "class": (lambda: StateEvent(float), InputError, "expected a function"),
    "both": (lambda: Switch(on="a", off="a"), InputError, "both on and off"),
    "number": (lambda: fall(events=[3]), InputError, "event 1 is 3"),
    "text": (lambda: fall(events="height"), InputError, "events are 'height'"),
    "twice": (lambda: fall(events=[StateEvent(height, "h"), StateEvent(height, "h")]), InputError, "two events are named 'h'"),
    "constraint": (lambda: fall(events=[StateEvent(height, "tip")]), InputError, "has the name of a constraint"),
    "while_on": (lambda: fall(events=[StateEvent(height, while_on="tap")]), UnknownName, "'tip'"),
    "off": (lambda: fall(events=[StateEvent(height, then=Switch(off="tap"))]), UnknownName, "'tip'"),
    "inactive": (lambda: fall(inactive="tap", events=[height]), UnknownName, "'tip'"),
    "for ever": (lambda: fall(inactive="tip"), InputError, "no event can switch it on"),
}


def height(state):
    """Of a box."""
    return state.q[2]


def fall(**given):
    """A box falls on a tip."""
    tip = rbd.PointContact("tip", "box", friction=0.5, on=0.0)
    return rbd.simulate(thrown(0.1), [tip], duration=0.2, step=0.01, **given)


@pytest.mark.parametrize("which", WRONG)
def test_wrong_events_are_refused_with_what_came(which):
    """Each with the argument's name, and the nearest names."""
    ask, kind, words = WRONG[which]
    with pytest.raises(kind, match=words):
        ask()


def test_a_function_that_returns_no_switch_stops_the_motion():
    """What `then` gave is told."""
    odd = StateEvent(lambda s: s.q[2] - 0.95, "odd", then=lambda s, t: "up")
    with pytest.raises(SimulationStopped, match="then of event 'odd' gave 'up'") as caught:
        rbd.simulate(thrown(), duration=0.2, step=0.01, events=[odd])
    assert len(caught.value.trajectory) > 5
    unknown = StateEvent(lambda s: s.q[2] - 0.95, "odd", then=lambda s, t: Switch(on="foot"))
    with pytest.raises(SimulationStopped, match="'foot', which is no constraint"):
        rbd.simulate(thrown(), duration=0.2, step=0.01, events=[unknown])


@pytest.mark.parametrize("tilt", [0.0, 0.7])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_the_height_of_a_point_is_zero_where_the_point_touches(e, tilt):
    """Once at each touch, at its time, whatever the restitution; a terminal event ends the motion at sqrt(2 h / g)."""
    point = rbd.PointContact("p", "box", friction=0.5, on=0.0)
    start = rbd.State(rbd.testing.box(mass=1.0), [0, 0, 1, np.sin(0.5 * tilt), 0, 0, np.cos(0.5 * tilt)], [0.3, 0, 0, 0, 0, 0])

    def motion(duration, **kinds):
        ground = [
            StateEvent(lambda s: s.q[2], "ground", **kinds),
            StateEvent(lambda s: s.frame("box").v[2], "turns", direction=1),
        ]
        return rbd.simulate(start, [point], duration=duration, step=0.05, events=ground, restitution=e)

    one = motion(1.0, terminal=True, direction=-1)
    assert abs(one.t[-1] - np.sqrt(2.0 / G)) < 1e-11
    assert one.interrupted.startswith("ended by event 'ground'")
    assert [x.kind for x in one.events if x.name == "p"] == ["touches"]
    all_of_them = motion(1.7)
    at = {name: [x.t for x in all_of_them.events if x.name == name and x.kind != "leaves"] for name in ("ground", "p", "turns")}
    flight = np.sqrt(2.0 / G)
    bounces = {0.0: [1.0], 0.5: [1.0, 2.0, 2.5, 2.75, 2.875], 1.0: [1.0, 3.0]}[e]
    assert np.abs(np.array(at["ground"][: len(bounces)]) - np.array(bounces) * flight).max() < 1e-9
    assert at["ground"] == pytest.approx(at["p"], abs=1e-12)
    if e != 0.5:
        assert len(at["p"]) == len(bounces)
    if e:
        assert at["turns"][: len(bounces)] == pytest.approx(at["p"][: len(bounces)], abs=1e-11)


def test_a_function_that_passes_zero_near_a_touch_is_found_by_its_own_time():
    """A place x0 = v t an instant before, at and after a bounce, and a height a little above and below the ground."""
    point = rbd.PointContact("p", "box", friction=0.0, on=0.0)
    start = rbd.State(rbd.testing.box(mass=1.0), [0, 0, 1, 0, 0, 0, 1], [0.3, 0, 0, 0, 0, 0])
    touch = np.sqrt(2.0 / G)
    for off in (-1e-3, -1e-8, 0.0, 1e-8, 1e-3):
        there = StateEvent(lambda s, off=off: s.q[0] - 0.3 * (touch + off), "there")
        (found,) = (
            x
            for x in rbd.simulate(start, [point], duration=0.8, step=0.05, events=[there], restitution=0.5).events
            if x.point < 0
        )
        assert abs(found.t - touch - off) < 1e-9
        assert found.kind == "rises through zero"
    above = rbd.simulate(start, [point], duration=0.8, step=0.5, events=[lambda s: s.q[2] - 1e-3], restitution=0.5)
    assert [x.kind for x in above.events if x.point < 0] == ["falls through zero", "rises through zero"]
    below = rbd.simulate(start, [point], duration=0.8, step=0.05, events=[lambda s: s.q[2] + 1e-9], restitution=0.5)
    assert not [x for x in below.events if x.point < 0]
    assert below.absent == ("event 1",)


def test_a_contact_below_its_plane_is_not_switched_on():
    """It would be lifted by 0.1 m, with energy from nowhere: named, with depth, event and contact. At its height it is."""
    point = rbd.PointContact("p", "box", friction=0.5, on=0.6)

    def motion(height):
        on = StateEvent(lambda s: s.q[2] - height, "late", then=Switch(on="p"), while_off="p")
        return rbd.simulate(thrown(), [point], inactive="p", duration=0.5, step=0.05, events=[on])

    with warnings.catch_warnings():
        warnings.simplefilter("error")  # none at the start, where it is off
        lands = motion(0.6)
    assert abs(lands.q[-1, 2] - 0.6) < 1e-9
    assert np.diff(lands.energy).max() < 1e-9
    with pytest.raises(SimulationStopped, match="'late' at t = 0.319.* s switches on .*'p' 100 mm below") as stopped:
        motion(0.5)
    assert stopped.value.trajectory.t[-1] < 0.32
    assert stopped.value.reason is Reason.STOPPED_BAD_INPUT


@ALL
@pytest.mark.parametrize("at", [0.2, 0.2 - 1e-11, 0.2 + 1e-11, 0.4])
def test_events_at_sample_times_make_no_second_sample(by, at):
    """At a sample time or within 1e-9 s of it, the last one too: told once, with strictly increasing times."""
    clock = StateEvent(lambda s, t: t - at, "clock")
    motion = rbd.simulate(thrown(), duration=0.4, step=0.1, events=[clock], integrator=by)
    assert [round(e.t, 9) for e in motion.events] == [round(at, 9)]
    assert len(motion) == 5
    stop = StateEvent(lambda s, t: t - at, "stop", then=Switch(v=np.zeros(6)))
    switched = rbd.simulate(thrown(), duration=0.4, step=0.1, events=[stop], integrator=by)
    assert len(switched.events) == 1
    assert abs(switched.t[-1] - 0.4) < 1e-9
    assert abs(switched.q[-1, 2] - (1.0 - 0.5 * G * (at**2 + (0.4 - at) ** 2))) < 1e-9


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
@ALL
def test_two_switches_at_one_time_both_act(by):
    """One locks, the other one stops the motion before: in the order in which the events are given."""
    state, angle = pendulum(0.5)
    lock = rbd.JointLock("lock", next(iter(PENDULUM.joints)))
    two = [
        StateEvent(angle, "stop", then=lambda s, t: Switch(v=[0.0])),
        StateEvent(lambda s: 2.0 * angle(s), "lock it", then=Switch(on="lock", impact=False)),
    ]
    motion = rbd.simulate(state, [lock], duration=1.0, step=0.05, events=two, inactive="lock", integrator=by)
    assert sorted(e.name for e in motion.events) == ["lock", "lock it", "stop"]
    assert abs(motion.v[-1, 0]) < 1e-12
    assert abs(angle(motion.state(-1))) < 1e-9
    assert motion.modes["lock"][-1] == "holds"


def test_springs_and_dampers_go_on_across_switches():
    """Energy with what is stored and dissipated is kept, but for what a switch takes."""
    mass = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
    joint = next(iter(mass.joints))
    given = [rbd.JointSpring(joint, stiffness=20.0, rest=-np.pi / 2.0), rbd.JointDamping({joint: 0.3})]
    state = mass.at([0.5 - np.pi / 2.0])
    slow = StateEvent(lambda s: s.q[0] + np.pi / 2.0, "slow", then=lambda s, t: Switch(v=0.8 * s.v))
    motion = rbd.simulate(state, duration=2.0, step=0.05, external=given, events=[slow], integrator=rbd.DormandPrince8())
    total = motion.energy + motion.dissipated
    jumps = np.isin(motion.t[1:], [e.t for e in motion.events])
    assert jumps.sum() > 2
    assert np.abs(np.diff(total)[~jumps]).max() < 1e-9
    assert (np.diff(motion.dissipated) >= 0.0).all()


def test_an_integrator_that_finds_no_events_is_refused():
    """One of the user's own, which does not know of them: no event would be found, silently."""

    class Plain:
        def reason_unsupported(self, motion, state):
            return None

        def run(self, motion, state, times):
            return rbd.RungeKutta4().run(motion, state, times)

    assert len(rbd.simulate(thrown(), duration=0.1, step=0.01, integrator=Plain())) == 11
    with pytest.raises(rbd.errors.Unsupported, match="does not look for events"):
        rbd.simulate(thrown(), duration=0.1, step=0.01, integrator=Plain(), events=[height])


def test_a_switch_without_impact_needs_a_velocity_that_is_allowed():
    """Where it is not, the error says how to have an impact."""
    lock = rbd.JointLock("lock", next(iter(PENDULUM.joints)))
    state, angle = pendulum(0.5)
    for impact in (True, False):
        given = [StateEvent(angle, "down", then=Switch(on="lock", impact=impact))]
        run = {"duration": 1.0, "step": 0.05, "events": given, "inactive": "lock", "integrator": rbd.DormandPrince8()}
        if impact:
            motion = rbd.simulate(state, [lock], **run)
            assert not motion.v[-1].any()
            assert [e.kind for e in motion.events] == ["falls through zero", "touches"]
        else:
            with pytest.raises(SimulationStopped, match=r"Switch\(\.\.\., impact=True\)"):
                rbd.simulate(state, [lock], **run)
