"""The law of an answer: a record that prints as one reads it."""

import pickle

import numpy as np
import pytest

import rbd
from rbd.errors import InputError
from rbd.problem.gauss_problem import BILATERAL, CONVEX, COULOMB, Law


@pytest.mark.parametrize("text", ["bilateral", "convex", "coulomb", "convex, 4 facets", "convex, 4 and 8 facets"])
def test_a_law_is_the_one_that_prints_so(text):
    """Text to record and back; a record is itself."""
    law = Law.of(text)
    assert str(law) == text and Law.of(law) is law and pickle.loads(pickle.dumps(law)) == law
    assert law.kind == text.split(",")[0] and bool(law.facets) == ("facets" in text)


def test_facets_stand_in_order():
    """Two spellings are one law, with one hash."""
    assert Law.of("convex, 8 and 4 facets") == Law("convex", (4, 8)) and len({CONVEX, COULOMB, BILATERAL, Law("convex")}) == 3


@pytest.mark.parametrize("wrong", ["hooke", "", None, 3, "facets", "coulomb, 4 facets", "convex, 2 facets", "convex, facets"])
def test_what_is_no_law_is_refused(wrong):
    """In words."""
    with pytest.raises(InputError, match="law is|facets of"):
        Law.of(wrong)


@pytest.mark.parametrize("facets", [(8, 4), (4, 4)])
def test_facets_out_of_order_are_refused(facets):
    """They would print as a law that reads back as another."""
    with pytest.raises(InputError, match="ascending, of the convex law"):
        Law("convex", facets)


def test_a_solver_may_say_its_law_as_it_prints():
    """Text in an `Answer` becomes the record."""
    P = rbd.GaussProblem(np.eye(1), np.ones(1))
    assert rbd.problem.Answer(P, np.ones(1), np.zeros(0), None, "convex, 4 facets", "mine", 1, 0.0).law == Law("convex", (4,))
    with pytest.raises(InputError, match="law is"):
        rbd.problem.Answer(P, np.ones(1), np.zeros(0), None, "true cones", "mine", 1, 0.0)
    assert rbd.ConeSolver(law="convex").law == rbd.ConeSolver(law=CONVEX).law == CONVEX and rbd.ConeSolver().law == COULOMB
