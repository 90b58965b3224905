"""Sizes by direction on polar axes: where curves stand, what axes and legend say, what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import rbd
from rbd.visual import plot_directions

ANGLES = np.radians([0.0, 90.0, 225.0, 135.0])  # not in their order
DIRECTIONS = np.column_stack([np.cos(ANGLES), np.sin(ANGLES), np.zeros(4)]) * [[1.0], [2.0], [0.5], [3.0]]
CURVES = {"controller": [40.0, 30.0, 20.0, 35.0], "fixed torques": [1.0, 0.0, 2.0, 3.0]}


def drawn(**given):
    ax = Figure().add_subplot(projection="polar")
    return ax, plot_directions(ax, DIRECTIONS, CURVES, **given)


def test_each_curve_goes_round_in_the_order_of_its_angles_and_is_closed():
    """Angle and size of every direction, read back from the lines, whatever its length."""
    ax, artists = drawn()
    assert len(artists) == 4 and all(artist.axes is ax for artist in artists)
    for line, (name, sizes) in zip(ax.lines, CURVES.items(), strict=True):
        order = [0, 1, 3, 2, 0]
        assert line.get_label() == name
        assert np.allclose(line.get_xdata(), ANGLES[order]) and np.array_equal(line.get_ydata(), np.array(sizes)[order])
    assert len({to_hex(line.get_color()) for line in ax.lines}) == len({line.get_marker() for line in ax.lines}) == 2


def test_axes_and_legend_say_directions_quantity_and_unit():
    """Seen from above with x up and y to the left; circles have the unit, the legend names the quantity."""
    ax, _ = drawn(quantity="largest impulse", unit="N s")
    ax.figure.canvas.draw()
    up, left = (ax.transData.transform((angle, 10.0)) - ax.transData.transform((0.0, 0.0)) for angle in (0.0, np.pi / 2.0))
    assert abs(up[0]) < 1e-6 < up[1] and left[0] < -1e-6 < 1e-6 > abs(left[1])
    assert [text.get_text() for text in ax.get_xticklabels()][::2] == ["ahead (x)", "left (y)", "back", "right"]
    circles = [text.get_text() for text in ax.get_yticklabels()]
    assert circles and all(text.endswith(" N s") for text in circles)
    assert [float(text.removesuffix(" N s")) for text in circles] == pytest.approx(ax.get_yticks())
    legend = ax.get_legend()
    assert legend.get_title().get_text() == "largest impulse"
    assert [text.get_text() for text in legend.get_texts()] == list(CURVES)
    assert ax.get_rmin() == 0.0 and 40.0 < ax.get_rmax() < 50.0


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"ax": Figure().subplots()}, "polar"),
        ({"directions": [(0.0, 0.0, 1.0)] * 4}, "horizontal"),
        ({"directions": [1.0, 0.0, 0.0]}, "shape"),
        ({"curves": {"a": [1.0, 2.0]}}, "one per direction"),
        ({"curves": {"a": [1.0, 2.0, -3.0, 4.0]}}, "below zero"),
        ({"curves": {"a": [1.0, 2.0, np.inf, 4.0]}}, "'a'"),
        ({"curves": [1.0, 2.0, 3.0, 4.0]}, "name: sizes"),
        ({"unit": 3}, "unit"),
    ],
)
def test_what_cannot_be_drawn_is_refused_by_name(given, named):
    """The argument, and what was expected; nothing is drawn."""
    ax = given.pop("ax", None) or Figure().add_subplot(projection="polar")
    with pytest.raises(rbd.InputError, match=named):
        plot_directions(ax, **{"directions": DIRECTIONS, "curves": CURVES, **given})
    assert not ax.lines
