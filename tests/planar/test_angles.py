"""Joint angles, segment angles, angles from the vertical, and the maps between them."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
import sympy

from rbd.errors import InputError
from rbd.planar.angles import CONVENTIONS
from rbd.planar.chain import Chain

PAIRS = list(permutations(CONVENTIONS, 2))


def test_a_segment_angle_is_the_sum_of_the_joint_angles_before_it():
    """Joint angles of 30, 40, 50 degrees: segments at 30, 70, 120 from x, and 90 more from the downward vertical."""
    chain = Chain(3)
    q = np.radians([30.0, 40.0, 50.0])
    assert np.allclose(np.degrees(chain.convert(q, "segment")), [30.0, 70.0, 120.0], atol=1e-12)
    assert np.allclose(np.degrees(chain.convert(q, "vertical")), [120.0, 160.0, 210.0], atol=1e-12)


@pytest.mark.parametrize(("source", "to"), PAIRS)
def test_a_map_leaves_the_links_where_they_are(source, to):
    """The same posture in two conventions puts every joint of the chain at the same place."""
    here, there = (Chain(4, lengths=(0.3, 0.5, 0.2, 0.7), angles=word) for word in (source, to))
    q = np.random.default_rng(0).normal(size=(50, 4))
    assert np.abs(here.numeric.positions(q) - there.numeric.positions(here.convert(q, to))).max() < 1e-14


@pytest.mark.parametrize(("source", "to"), PAIRS)
def test_there_and_back_is_where_one_was(source, to):
    """The matrices are inverse to each other, exactly; turns are not wrapped."""
    there, back = Chain(5, angles=source).angle_map(to), Chain(5, angles=to).angle_map(source)
    assert there.matrix * back.matrix == sympy.eye(5)
    assert there.matrix * back.offset + there.offset == sympy.zeros(5, 1)
    q = 20.0 * np.random.default_rng(1).normal(size=5)
    assert np.abs(back(there(q)) - q).max() < 1e-12


@pytest.mark.parametrize(("source", "to"), PAIRS)
def test_rates_go_with_the_matrix_alone(source, to):
    """d/dt (A q + b) = A qd: what the end point's velocity shows too."""
    here, there = (Chain(3, lengths=(1.0, 0.5, 0.2), angles=word) for word in (source, to))
    change = here.angle_map(to)
    q, qd = np.random.default_rng(2).normal(size=(2, 20, 3))
    assert np.abs(here.numeric.velocity(q, qd) - there.numeric.velocity(change(q), change.rates(qd))).max() < 1e-14


@pytest.mark.parametrize(("source", "to"), PAIRS)
def test_symbols_go_through_the_same_map(source, to):
    """The other chain's position, its angles replaced by the map of this one's, is this chain's position."""
    here, there = Chain(3, angles=source), Chain(3, angles=to)
    mapped = there.position().xreplace(dict(zip(there.q, here.convert(here.q, to), strict=True)))
    assert mapped == here.position()


def test_zero_from_the_vertical_hangs():
    """All angles zero: the end point of a pendulum is straight below the base, of an arm straight to the right."""
    a, b = Chain(2).lengths
    for word, end in (("vertical", [0, -a - b]), ("joint", [a + b, 0]), ("segment", [a + b, 0])):
        chain = Chain(2, angles=word)
        assert chain.position().subs({angle: 0 for angle in chain.q}) == sympy.Matrix(end)


@pytest.mark.parametrize("word", ["joints", "Segment", "", None, 3, ["joint"], "x" * 500])
def test_another_word_is_refused_with_the_nearest(word):
    """Three words and no other."""
    for attempt in (lambda: Chain(2, angles=word), lambda: Chain(2).angle_map(word), lambda: Chain(2).convert([0, 0], word)):
        with pytest.raises(InputError, match="the way to measure angles is"):
            attempt()


def test_the_nearest_word_is_named():
    """A slip of one letter is answered with the word meant."""
    with pytest.raises(InputError, match="nearest: 'segment'"):
        Chain(2, angles="segments")


@pytest.mark.parametrize(
    "values", [[1.0], [1, 2, 3], [[[1.0, 2.0]]], [np.nan, 0], [np.inf, 0], "ab", None, [1j, 0], sympy.zeros(3, 1), sympy.eye(2)]
)
def test_values_of_another_shape_or_kind_are_refused(values):
    """Two angles, or rows of two, finite; or a column of two expressions."""
    change = Chain(2).angle_map("segment")
    for call in (change, change.rates):
        with pytest.raises(InputError):
            call(values)
