"""Rows: named scalar constraints in arrays, built by hand or by a constraint."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.problem.rows import Rows


def test_what_is_not_given_is_zero():
    """A velocity, a feedback: zero of the rows' size; a position residual: none."""
    rows = Rows("bar", [[1, 2, 3], [4, 5, 6]], [0, 0], rbd.problem.Free(2))
    assert rows.velocity.tolist() == rows.feedback.tolist() == [0.0, 0.0]
    assert rows.error is None and rows.resultant is None and rows.patch is None
    assert len(rows) == 2 and rows.speed == 0.0
    assert rows.J.dtype == float and rows.bias.dtype == float


def test_speed_is_the_largest_row_velocity():
    """Of either sign."""
    assert Rows("bar", np.eye(2), np.zeros(2), rbd.problem.Free(2), [0.5, -2.0]).speed == 2.0


def test_an_inactive_constraint_has_no_rows():
    """Zero rows are rows."""
    rows = Rows("idle", np.zeros((0, 4)), np.zeros(0), rbd.problem.NonNegative(0))
    assert len(rows) == 0 and rows.speed == 0.0


@pytest.mark.parametrize(
    ("what", "arguments"),
    [
        ("J has shape", {"J": np.zeros(3)}),
        ("bias has shape", {"bias": np.zeros(3)}),
        ("velocity has shape", {"velocity": np.zeros(1)}),
        ("error has shape", {"error": np.zeros((2, 1))}),
        ("feedback has shape", {"feedback": 0.0}),
        ("cone has dimension", {"cone": rbd.problem.Free(3)}),
        ("resultant has shape", {"resultant": np.zeros((6, 3))}),
        ("resultant has shape", {"resultant": np.zeros(2)}),
    ],
)
def test_sizes_that_do_not_fit_are_refused_by_name(what, arguments):
    """The message names the rows, what came and what was expected."""
    given = {"name": "bar", "J": np.zeros((2, 4)), "bias": np.zeros(2), "cone": rbd.problem.Free(2)} | arguments
    with pytest.raises(rbd.InputError, match=f"rows 'bar'.*{what}"):
        Rows(**given)


def test_rows_are_frozen_and_compare_by_identity():
    """Complete once built; arrays in records are not compared."""
    rows = Rows("bar", np.eye(1), np.zeros(1), rbd.problem.Free(1))
    with pytest.raises(AttributeError):
        rows.name = "other"
    assert rows == rows and rows != Rows("bar", np.eye(1), np.zeros(1), rbd.problem.Free(1))
    assert "bar" in repr(rows) and "Free" in repr(rows)


def test_holonomic_rows_are_truth_values_beside_an_error():
    """Which rows have a position is said row by row, and only where there is an error."""
    good = {"name": "ball", "J": np.eye(2), "bias": np.zeros(2), "cone": rbd.problem.Free(2)}
    rows = rbd.Rows(**good, error=[0.0, 0.1], holonomic=[False, True])
    assert rows.holonomic.tolist() == [False, True]
    for wrong in ({"holonomic": [False, True]}, {"error": np.zeros(2), "holonomic": [1.0, 0.0]}):
        with pytest.raises(rbd.InputError, match="truth values"):
            rbd.Rows(**good, **wrong)
