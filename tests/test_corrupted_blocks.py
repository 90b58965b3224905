"""Blocks of states with a fault put in: their certificate notices, and what is returned is right.

As `tests/test_corrupted_path.py`, for `rbd.solve_many`.
"""

from __future__ import annotations

import numpy as np
import pytest
import test_corrupted_path as one
from test_corrupted_path import ROBOTS, case_of, judged

import rbd

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
COUNT = 6
KINDS = tuple(kind for kind in one.KINDS if kind not in ("moving ground", "two bodies"))
"""Those that blocks answer: the others are answered one by one."""
FAULTS = one.EVERYWHERE


class Blocks(one.Case):
    """Draws that are answered at once."""

    def answered(self) -> rbd.Solutions:
        """All draws."""
        q, v, tau = (np.array(each) for each in zip(*self.draws, strict=True))
        return rbd.solve_many(self.robot, q, v, tau, self.constraints, law=self.law, external=list(self.external) or None)


def blocks_of(name: str, kind: str) -> Blocks:
    """Draws of one robot."""
    return Blocks(**vars(case_of(name if kind != "edges" else "talos", kind, count=COUNT)))


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_is_noticed_in_every_row(name, kind, fault, monkeypatch):
    """Each row is solved and certified by the problem in arrays, and its motion is that of the faultless call."""
    case = blocks_of(name, kind)
    right = case.answered()
    with monkeypatch.context() as patch:
        fault(patch, case)
        found = case.answered()
    for i in range(COUNT):
        s = found[i]
        assert s.status == "solved" and judged(s) <= 1e-9 and np.array_equal(found.a[i], s.a)
        if kind not in ("slipping, Coulomb", "feet that slide"):  # whose motion may be one of several
            assert np.abs(found.a[i] - right.a[i]).max() <= 1e-9 * max(1.0, np.abs(right.a[i]).max())


@pytest.mark.parametrize("name", ROBOTS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_faults_have_an_effect(name, kind, monkeypatch):
    """No row is left to the blocks."""
    case = blocks_of(name, kind)
    assert not case.answered().one_by_one.any()
    for fault in FAULTS:
        with monkeypatch.context() as patch:
            fault(patch, case)
            assert case.answered().one_by_one.all(), fault.__name__
