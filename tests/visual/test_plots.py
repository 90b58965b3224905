"""Plots on given axes: what is drawn, where, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

import rbd
import rbd.testing
from rbd.errors import InputError
from rbd.problem.rows import Patch, Rows
from rbd.visual import contact_colors, plot_ranges

COLUMNS = {"a": 1.0, "b": 1.0, "c": -1.0}


def beam(friction: float | None, names: str = "ab") -> rbd.answers.analysis.Uniqueness:
    """A mass of one coordinate on supports that push it up (a, b) or down (c), 6 N."""
    rows = []
    for name in names:
        patch = Patch(np.zeros(3), np.eye(3), np.zeros((1, 3)), friction)
        cone = rbd.problem.NonNegative(1) if friction is not None else rbd.problem.Free(1)
        column = np.array([[0.0], [0.0], [1.0]])
        rows.append(Rows(name, np.array([[COLUMNS[name]]]), np.zeros(1), cone, resultant=column, patch=patch))
    return rbd.solve_problem(rbd.GaussProblem(np.eye(1), np.array([-6.0]), rows)).uniqueness()


def test_a_bar_and_a_mark_for_each_contact():
    """Two supports share 6 N: bars from 0 to 6, marks at 3; names, colours and units as everywhere."""
    ax = Figure().subplots()
    artists = plot_ranges(ax, beam(0.0))
    assert len(artists) == 4 and all(artist.axes is ax for artist in artists)
    for y, (name, color) in enumerate(contact_colors(["a", "b"]).items()):
        bar, mark = artists[2 * y : 2 * y + 2]
        assert bar.get_xdata() == pytest.approx([0.0, 6.0], abs=1e-9) and list(bar.get_ydata()) == [y, y]
        assert mark.get_xdata() == pytest.approx([3.0]) and bar.get_color() == mark.get_color() == color
        assert ax.get_yticklabels()[y].get_text() == name
    low, high = ax.get_xlim()
    assert low < 0.0 and high > 6.0 and "[N]" in ax.get_xlabel()
    assert ax.yaxis_inverted()  # the first contact on top


def test_corners_have_bars_of_their_own():
    """A patch of four corners: its own unique force, then four ranges."""
    robot = rbd.testing.box()
    q = np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    X = np.eye(4)
    X[2, 3] = -0.1
    floor = rbd.SurfaceContact("floor", "box", half_lengths=(0.2, 0.2), placement=X, friction=0.5)
    ax = Figure().subplots()
    artists = plot_ranges(ax, rbd.solve(rbd.State(robot, q), np.zeros(0), [floor]).uniqueness())
    assert len(artists) == 10
    assert [t.get_text() for t in ax.get_yticklabels()] == ["floor", *(f"corner {i}" for i in (1, 2, 3, 4))]
    assert artists[0].get_xdata() == pytest.approx([98.1, 98.1]) and artists[2].get_xdata() == pytest.approx(
        [0, 49.05], abs=1e-6
    )


def test_what_has_no_end_runs_to_the_edge_with_an_arrow():
    """A support above and one below press without end: an arrow each, at the edge of the axes; held ones have two."""
    ax = Figure().subplots()
    artists = plot_ranges(ax, beam(0.0, "ac"))
    low, high = ax.get_xlim()
    assert len(artists) == 6 and [a.get_marker() for a in artists[4:]] == [">", ">"]
    assert artists[0].get_xdata() == pytest.approx([6.0, high]) and artists[4].get_xdata() == pytest.approx([high])
    both = plot_ranges(Figure().subplots(), beam(None))
    assert [a.get_marker() for a in both[4:]] == ["<", ">", "<", ">"]


def test_what_is_no_axes_or_no_answer_is_refused():
    """In words."""
    with pytest.raises(InputError, match="expected Matplotlib axes"):
        plot_ranges(None, beam(0.0))
    with pytest.raises(InputError, match=r"expected what solution\.uniqueness"):
        plot_ranges(Figure().subplots(), "ranges")
