"""Plots of driven mechanisms: what is drawn is what the trace has."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import rbd
from rbd.errors import InputError
from rbd.visual import plot_trace

TURN = 2.0 * np.pi


def test_a_four_bars_panels_are_its_angles_rates_transmission_angle_and_path() -> None:
    """In degrees over the crank's; rates over the crank's; the path of the point that is asked for."""
    robot = rbd.mechanism.four_bar(0.4, 1.2, 0.8, 1.0)
    path = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(0.0, TURN), steps=24)
    drawn = path.plot(frame="coupler", offset=(0.6, 0.0, 0.3))
    crank, coupler, rocker, *rates = [line.get_ydata() for line in drawn[:6]]
    assert np.abs(crank - np.degrees(path.input)).max() < 1e-9  # not wrapped
    loop = 0.4 * np.exp(1j * np.radians(crank)) + 1.2 * np.exp(1j * np.radians(coupler)) - 0.8 * np.exp(1j * np.radians(rocker))
    assert np.abs(loop - 1.0).max() < 1e-12
    for state, *each in zip(path.states, *rates, strict=True):
        known = rbd.mechanism.link_rates(state)
        assert each == pytest.approx([known[link] for link in ("crank", "coupler", "rocker")], abs=1e-12)
    assert np.array_equal(drawn[6].get_ydata(), np.degrees(path.transmission_angle))
    assert np.array_equal(drawn[7].get_xydata(), path.points("coupler", (0.6, 0.0, 0.3))[:, [0, 2]])
    titles = [ax.get_title() for ax in drawn[0].figure.axes]
    assert titles[2] == "transmission angle [°], 26.4 to 86.4" and titles[3] == "path of a point of coupler"


def test_limits_are_marked_and_rates_near_them_cut_off() -> None:
    """At a limit the rates have no value: a gap; beside it they are cut, and a note tells."""
    robot = rbd.mechanism.four_bar(2.0, 2.0, 2.0, 3.0)
    path = rbd.mechanism.trace(robot.at("assembled"), joint="crank_joint", values=(1.0, 3.0), past_limits=True, steps=30)
    axes = Figure().subplots(2, 2)
    drawn = plot_trace(axes, path)
    assert len(path.limits) == 2 and sum(line.get_linestyle() == "--" for line in axes[0, 0].get_lines()) == 2
    notes = [text.get_text() for text in axes[0, 1].texts]
    assert len(notes) == 1 and notes[0].startswith("cut off") and notes[0].endswith("°")
    assert drawn[0] is axes[0, 0].get_lines()[0]


def test_what_slides_has_panels_of_its_own_and_other_planes_their_joints() -> None:
    """A slider's displacement and rate in metres; a four-bar in another plane has its joints' angles."""
    slides = rbd.mechanism.slider_crank(1.0, 3.0)
    path = rbd.mechanism.trace(slides.at("assembled"), joint="crank_joint", values=(0.0, 3.0), steps=6)
    drawn = plot_trace(None, path)
    titles = [ax.get_title() for ax in drawn[0].figure.axes]
    assert titles[2:] == ["displacement of slider_joint [m]", "rate, over that of crank_joint [m/rad]"]
    x = np.cos(path.input) + np.sqrt(9.0 - np.sin(path.input) ** 2)
    assert np.abs(drawn[4].get_ydata() - x).max() < 1e-12
    with pytest.raises(InputError, match="expected 4"):
        plot_trace(Figure().subplots(), path)
