"""Every solver on one question."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.answers.comparison import confirmed_by_qp, obeys_gauss


@pytest.fixture(scope="module")
def pushed(talos):
    """Talos standing, with its holding torques."""
    state = talos.standing()
    return state, rbd.hold(state, talos.soles()).tau


def test_held_soles_are_taken_by_all_and_all_agree(talos, pushed):
    """Held contacts have one law and one answer."""
    found = rbd.studies.compare_solvers(*pushed, talos.soles(friction=None))
    assert found.agree and found.worst < 1e-9 and not found.refused
    assert {str(x.law) for x in found.answers} == {"bilateral"} and len(found.answers) == 4


def test_rubbing_soles_agree_within_a_law(talos, pushed, rng):
    """ProxQP and ConeSolver on the same pyramids agree; KKT says why it refuses them; laws may differ where a foot slips."""
    state, tau = pushed
    noisy = tau + rng.normal(size=talos.nu) * 20.0
    noisy = np.clip(noisy, -talos.effort_limit, talos.effort_limit)
    found = rbd.studies.compare_solvers(state, noisy, talos.soles(friction=0.3))
    assert found.agree and found.worst < 1e-8 and "friction=None" in found.refused["KKT"]
    same = [d for d in found.differences if {d[0], d[1]} == {"ProxQP", "ConeSolver on pyramids"}]
    assert len(same) == 1
    text = str(found)
    assert "must agree" in text and "ProxQP" in text and "convex, 4 facets" in text


def test_where_nothing_slips_all_laws_agree(talos, pushed):
    """Standing still is standing still."""
    found = rbd.studies.compare_solvers(*pushed, talos.soles(friction=0.7))
    assert max(da for *_, da, _ in found.differences) < 1e-8


def test_a_lock_beside_rubbing_soles_is_held_on_pyramids_too(talos, pushed):
    """Rows without a cone stay as they are: each of the two laws still has two solvers that agree."""
    lock = rbd.JointLock("elbow", "arm_left_4_joint")
    found = rbd.studies.compare_solvers(*pushed, [*talos.soles(friction=0.7), lock])
    assert found.agree and "ConeSolver on pyramids" in str(found) and "ConeSolver on pyramids" not in found.refused


def test_redundant_forces_are_compared_in_what_is_unique_of_them(rng):
    """A box on four corners: 12 rows of rank 6."""
    from rbd.testing import box

    state = rbd.State(box(), np.array([0, 0, 0.1, 0, 0, 0, 1.0]))
    corners = [
        rbd.PointContact(f"c{i}", "box", offset=(0.2 * x, 0.2 * y, -0.1), friction=0.6)
        for i, (x, y) in enumerate([(1, 1), (1, -1), (-1, -1), (-1, 1)])
    ]
    found = rbd.studies.compare_solvers(state, np.zeros(0), corners, external=rbd.ExternalForce("box", (20.0, 5.0, 0.0)))
    assert found.agree and max(df for *_, df in found.differences) < 1e-8


def test_a_question_without_an_answer_is_said(talos):
    """Two frames of one rigid foot asked for different things."""

    class Pulled:
        name = "pulled"

        def rows(self, state):
            row = rbd.PointContact("p", "left_sole_link").rows(state)
            return rbd.Rows("pulled", row.J, row.bias + np.array([0.0, 0.0, 5.0]), rbd.problem.Free(3))

    state = talos.standing()
    with pytest.raises(rbd.NoSolution, match="no solver has an answer"):
        rbd.studies.compare_solvers(state, np.zeros(talos.nu), [*talos.soles(friction=None), Pulled()])


@pytest.mark.parametrize("friction", [0.7, 0.02])
def test_gauss_qp_confirms_the_answer_with_circular_cones(talos, pushed, friction):
    """Pyramids that touch the cones where friction acts admit the same answer; that of another law is told from it."""
    (state, tau), soles, push = pushed, talos.soles(friction=friction), rbd.ExternalForce("torso_2_link", (30.0, 20.0, 100.0))
    coulomb, convex = (rbd.solve(state, tau, soles, law=law, external=push) for law in ("coulomb", "convex"))
    sticks = friction == 0.7
    assert obeys_gauss(convex) and obeys_gauss(coulomb) is sticks
    confirmed = confirmed_by_qp(convex)
    assert confirmed.same and max(confirmed.a, confirmed.f) < 1e-8
    assert confirmed_by_qp(coulomb).same is sticks
    plain = rbd.solve(state, tau, soles, external=push, solver=rbd.ProxQP())  # a facet that is elsewhere admits more friction
    assert bool(np.abs(plain.a - convex.a).max() < 1e-8) is sticks
