"""Words of the text, and the same words from the robot that a chain is exported to."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from rbd import mechanism
from rbd.errors import InputError
from rbd.planar import Chain, classify, constrained, to_robot


@pytest.mark.parametrize("n", [1, 2, 3, 5])
def test_open_chains_and_their_robots_agree(n: int):
    """N degrees of freedom, mobility n, an end point with at most two, the rest redundancy: by `rbd.mechanism` too."""
    chain = Chain(n, lengths=(0.5,) * n)
    ours, theirs = classify(chain), mechanism.classify(to_robot(chain, masses=(1.0,) * n).at(), [], end="end")
    assert (ours.kind, ours.closed, ours.degrees_of_freedom, ours.mobility) == ("serial", False, n, n)
    assert (theirs.kind, theirs.closed, theirs.degrees_of_freedom, theirs.mobility) == ("serial", False, n, n)
    end = theirs.end_points[0]
    assert (ours.end_dof, ours.redundancy) == (min(n, 2), max(n - 2, 0)) == (end.position_dof, end.position_redundancy)


def test_a_pinned_chain_is_a_four_bar():
    """Three links with the end on the ground: closed, parallel, mobility 1, as of the four-bar linkage."""
    ours = classify(Chain(3, lengths=(1, 3, 2)), pinned=(2.5, 0))
    theirs = mechanism.classify(mechanism.four_bar(1.0, 3.0, 2.0, 2.5).at())
    assert (ours.kind, ours.closed, ours.mobility, ours.degrees_of_freedom) == ("parallel", True, 1, 3)
    assert (theirs.kind, theirs.closed, theirs.mobility, theirs.degrees_of_freedom) == ("parallel", True, 1, 3)
    assert ours.end_dof == 0 and ours.redundancy == 1


@pytest.mark.parametrize(
    ("lengths", "pin", "mobility"),
    [
        ((1,), (1, 0), 0),
        ((1, 1), (1, 1), 0),
        ((1, 1), (2, 0), 0),
        ((1, 1), (0, 0), 1),
        ((1, 1, 1), (1, 1), 1),
        ((1, 1, 1), (3, 0), 0),
        ((1, 1, 2), (0, 0), 1),
        ((1, 1, 3), (1, 0), 0),
    ],
)
def test_pins_where_the_links_are_in_line(lengths, pin, mobility):
    """N - 2 degrees of freedom, none where the only pose is a line, one where that line may turn about the base."""
    assert classify(Chain(len(lengths), lengths=lengths), pinned=pin).mobility == mobility


def test_relations_take_degrees_of_freedom_and_close_nothing():
    """The polar manipulator: one freedom, and one of its end point; held joints; an end point held by relations."""
    ell = sympy.Symbol("ell", positive=True)
    chain = Chain(2, lengths=(ell, ell))
    polar = classify(constrained(chain, 2 * chain.q[0] + chain.q[1] - sympy.pi))
    assert (polar.mobility, polar.end_dof, polar.redundancy, polar.closed) == (1, 1, 0, False)
    assert classify(constrained(chain, [{1: 0}, {2: 0}])).mobility == 0
    assert classify(constrained(Chain(2), {1: 0})).end_dof == 1  # ell_1 is not in its Jacobian
    three = Chain(3)
    held = classify(constrained(three, [p - three.lengths[0] for p in three.position()]))
    assert (held.mobility, held.end_dof, held.redundancy) == (1, 0, 1) and "hold the end point" in held.note
    freed = classify(constrained(Chain(4), {2: 1}))
    assert (freed.degrees_of_freedom, freed.mobility, freed.end_dof, freed.redundancy) == (4, 3, 2, 1)


def test_every_word_has_its_line():
    """All words of the text, printed with value and meaning."""
    shown = str(classify(Chain(3)))
    assert len(shown.splitlines()) == 8
    assert all(
        word in shown for word in ("base", "end point", "open", "serial", "degrees of freedom", "mobility", "redundancy")
    )
    assert "taken" not in shown and "reaches the pin" in classify(Chain(3), pinned=sympy.symbols("x y")).note


@pytest.mark.parametrize("pinned", [(5, 0), (1,), "ab", (np.nan, 1), 3])
def test_pins_that_are_none(pinned):
    """Out of reach, or no point."""
    with pytest.raises(InputError):
        classify(Chain(2, lengths=(1, 1)), pinned=pinned)
    if pinned != (5, 0):
        with pytest.raises(InputError):
            classify(Chain(2), pinned=pinned)


def test_what_is_no_chain():
    """Named."""
    with pytest.raises(InputError, match="the chain is 3; expected a planar one"):
        classify(3)
    with pytest.raises(InputError, match="under relations"):
        classify(constrained(Chain(2), {1: 0}), pinned=(1, 0))
