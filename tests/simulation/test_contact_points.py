"""Points keep what is known of them where others enter or leave the contact set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.simulation.stacked_points import PointMatching


@dataclass(frozen=True, eq=False)
class Numbered:
    """What is asked of a layout here."""

    owners: tuple[str, ...]
    numbers: tuple[int, ...]
    widths: np.ndarray
    normals: np.ndarray


def layout(**points: int) -> Numbered:
    """Points by name, with their numbers of rows; the normal is the last row of each."""
    widths = np.array(list(points.values()), int)
    owners, numbers = tuple(name[0] for name in points), tuple(int(name[1]) for name in points)
    return Numbered(owners, numbers, widths, np.cumsum(widths) - 1)


def test_each_point_keeps_its_value_and_its_rows():
    """By constraint and number, whatever stands before it now: a cone of three rows between points of one row."""
    old = layout(a0=1, b0=3, b1=3, c0=1)
    new = layout(b1=3, d0=2, a0=1, b0=3)
    match = PointMatching(old, new)
    assert match.known.tolist() == [True, False, True, True]
    assert match.points(np.array([10.0, 20.0, 21.0, 30.0]), np.inf).tolist() == [21.0, np.inf, 10.0, 20.0]
    rows = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0])
    assert match.rows(rows).tolist() == [5.0, 6.0, 7.0, 0.0, 0.0, 1.0, 2.0, 3.0, 4.0]


def test_into_nothing_and_out_of_nothing():
    """No points before, or none after."""
    some, none = layout(a0=3), layout()
    assert PointMatching(none, some).rows(np.zeros(0)).tolist() == [0.0, 0.0, 0.0]
    assert (
        PointMatching(some, none).rows(np.ones(3)).tolist() == []
        and PointMatching(some, none).points(np.ones(1), 0.0).tolist() == []
    )
    same = PointMatching(some, some)
    values = np.arange(3.0)
    assert same.rows(values) is values and same.points(values, 0.0) is values
