"""Every solver passes `check_solver`: put a new one into the list."""

from __future__ import annotations

import pytest

import rbd
from rbd.solvers import qp
from rbd.testing import check_solver

SOLVERS = {
    "KKT": rbd.KKT(),
    "ConeSolver": rbd.ConeSolver(),
    "ConeSolver, convex": rbd.ConeSolver(law="convex"),
    "ProxQP": rbd.ProxQP(),
    "ProxQP, preconditioned": rbd.ProxQP(policy=(qp.Setting(precondition=True),)),
}


@pytest.mark.parametrize("name", SOLVERS)
def test_a_solver_answers_the_reference_problems(name):
    """Laws, closed forms, the sign of a resting force; a thousandth of the tolerance is reached."""
    report = check_solver(SOLVERS[name])
    assert max(report.ran.values()) < 1e-10
    assert len(report.ran) >= 8


def test_together_the_solvers_take_all_problems():
    """What no solver takes would be known by name."""
    reports = [check_solver(solver) for solver in SOLVERS.values()]
    assert not set.intersection(*(set(r.skipped) for r in reports))
