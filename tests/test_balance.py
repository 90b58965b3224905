"""Talos pushed while it stands: who survives how large an impulse, by which limits, and the theory beside it."""

from __future__ import annotations

import importlib
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure
from test_readme import TOP

import rbd
from rbd.constraints.convex.polygons import convex_hull

LEFT = np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def balance():
    """The example as a module."""
    sys.path.insert(0, str(TOP / "examples"))
    try:
        return importlib.import_module("29_balance")
    finally:
        sys.path.remove(str(TOP / "examples"))


@pytest.fixture(scope="module")
def bound(balance) -> float:
    """The largest impulse to the left without angular momentum [N s]."""
    state, soles, *_ = balance.talos()
    force = rbd.statics.push_limits(state, soles, balance.TORSO, LEFT).forces[0]
    return float(force * balance.LASTS_S / (1.0 - np.exp(-balance.rate(state) * balance.LASTS_S)))


def test_without_angular_momentum_the_bound_is_the_capture_point_at_the_edge(balance, bound):
    """A point mass pushed so, its centre of pressure at the outer edge of the left sole, stops over the edge and not beyond."""
    state, soles, *_ = balance.talos()
    w, mass, z = balance.rate(state), state.robot.mass, state.com[2]
    corners = np.concatenate([(p := sole.rows(state).patch).point + p.corners @ p.axes.T for sole in soles])[:, :2]
    d, h = convex_hull(corners)[:, 1].max() - state.com[1], state.frame(balance.TORSO).X_WF.translation[2]
    assert bound == pytest.approx(mass * 9.81 * d / h * balance.LASTS_S / (1.0 - np.exp(-w * balance.LASTS_S)), rel=1e-6)
    # c'' = w^2 (c - d) + b during the push, in closed form; the capture point c + c' / w at its end
    b, T = bound / balance.LASTS_S * h / (mass * z), balance.LASTS_S
    c = (d - b / w**2) * (1.0 - np.cosh(w * T))
    speed = -w * (d - b / w**2) * np.sinh(w * T)
    assert c + speed / w == pytest.approx(d, rel=1e-5)


def test_the_controller_stands_at_sixty_percent_of_the_bound_and_falls_at_twice(balance, bound):
    """Both soles keep their places; torques and joints stay within limits, the law is met, no step was without an answer."""
    way = balance.pushed(balance.CONTROL, 0.6 * bound * LEFT)
    assert balance.stands(way)
    state, soles, _, answers = balance.talos()
    robot, controller = state.robot, answers[balance.CONTROL]
    assert controller.log.residual.max() < 1e-7 and not controller.log.violations
    assert (np.abs(way.tau) <= robot.effort_limit).all()
    for joint in robot.joints.values():
        if np.isfinite(joint.upper - joint.lower):
            assert (way.q[:, joint.q] > joint.lower - 1e-5).all() and (way.q[:, joint.q] < joint.upper + 1e-5).all()
    assert way.residuals["law"].max() < 1e-7
    for sole in soles:
        assert np.abs(way.points[sole.name][-1] - way.points[sole.name][0]).max() < 5e-3
    assert np.abs(way.com[:, 1] - way.com[0, 1]).max() > 0.01  # it was a push
    assert not balance.stands(balance.pushed(balance.CONTROL, 2.0 * bound * LEFT))


@pytest.mark.parametrize("name", ["fixed torques", "held posture"])
def test_others_fall_where_the_controller_stands(balance, bound, name):
    """At sixty percent of the bound, neither the torques of standing nor springs at the joints are enough."""
    assert not balance.stands(balance.pushed(name, 0.6 * bound * LEFT))


def test_an_error_that_is_no_fall_is_not_taken_for_one(balance, monkeypatch):
    """What a controller raises reaches the user."""

    def broken(state, t):
        raise ZeroDivisionError

    monkeypatch.setitem(balance.talos()[3], "broken", broken)
    with pytest.raises(rbd.errors.SimulationStopped, match="ZeroDivisionError"):
        balance.pushed("broken", LEFT)


def test_the_plot_has_a_closed_curve_for_each_answer(balance):
    """Read back: directions, sizes, names, unit."""
    angles = np.radians([0.0, 90.0, 180.0, 270.0])
    ways = np.column_stack([np.cos(angles), np.sin(angles), 0.0 * angles])
    impulses = {"fixed torques": np.zeros(4), balance.CONTROL: np.array([33.0, 52.0, 39.0, 52.0])}
    ax = Figure().add_subplot(projection="polar")
    artists = balance.plot_impulses(ax, (ways, impulses))
    assert all(artist.axes is ax for artist in artists)
    for line, (name, sizes) in zip(ax.lines, impulses.items(), strict=True):
        assert line.get_label() == name and np.allclose(line.get_ydata(), [*sizes, sizes[0]])
        assert np.allclose(np.cos(line.get_xdata()[:-1]), ways[:, 0]) and np.allclose(np.sin(line.get_xdata()[:-1]), ways[:, 1])
    ax.figure.canvas.draw()
    assert all(text.get_text().endswith(" N s") for text in ax.get_yticklabels())
    assert ax.get_legend().get_title().get_text() == "largest impulse"
