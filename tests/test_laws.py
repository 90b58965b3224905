"""The two laws side by side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd

BOX = Path(__file__).parent.parent / "urdf" / "box.urdf"


def _compare(push_N: float) -> rbd.studies.LawComparison:
    robot = rbd.load_robot(BOX)
    q = pin.neutral(robot.model)
    q[2] = 0.1
    floor = rbd.SurfaceContact(
        "floor", "box", half_lengths=(0.2, 0.2), placement=pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1])), friction=0.6
    )
    return rbd.studies.compare_laws(
        rbd.State(robot, q), np.zeros(0), [floor], external=rbd.ExternalForce("box", (push_N, 0.0, 0.0))
    )


def test_the_slipping_box_to_its_last_digit():
    """10 kg, mu = 0.6, 80 N: convex lifts off at 0.933 m/s2 with 107.4 N; Coulomb slides at 2.114 m/s2 with 98.1 N.

    Friction takes mu N c_t; under the convex law the lift puts all of it back, f . c = 0.
    """
    both = _compare(80.0)
    N = (98.1 + 48.0) / 1.36
    convex, coulomb = both.under_convex["floor"], both.under_coulomb["floor"]
    assert not both.agree and both.normal_ratio["floor"] == pytest.approx(N / 98.1, rel=1e-9)
    assert convex.normal == pytest.approx(N, rel=1e-9) and convex.lift_off == pytest.approx((N - 98.1) / 10, rel=1e-8)
    assert coulomb.normal == pytest.approx(98.1, rel=1e-9) and coulomb.slip == pytest.approx(2.114, rel=1e-9)
    assert coulomb.lift_off == pytest.approx(0.0, abs=1e-9) and coulomb.lifted == pytest.approx(0.0, abs=1e-6)
    assert coulomb.dissipation == pytest.approx(0.6 * 98.1 * 2.114, rel=1e-8)
    assert convex.dissipation == pytest.approx(0.6 * N * (80 - 0.6 * N) / 10, rel=1e-8)
    assert convex.lifted == pytest.approx(convex.dissipation, rel=1e-8)
    assert both.difference == pytest.approx((N - 98.1) / 10 / max(2.114, 1.0), rel=1e-6)


def test_a_box_that_sticks_moves_the_same_under_both():
    """30 N of 58.86."""
    both = _compare(30.0)
    assert both.agree and both.normal_ratio["floor"] == pytest.approx(1.0, rel=1e-9)
    assert "the same motion" in str(both)


def test_the_table_names_both_laws_and_every_contact():
    """What is printed is what is in the record."""
    text = str(_compare(80.0))
    for part in ("floor", "convex", "coulomb", "107.426", "98.100", "2.114", "0.933", "they differ"):
        assert part in text


def test_talos_pushed_on_ice_parts(talos):
    """On ice a foot slides: only the convex law lifts it, by mu times its slip."""
    mu = 0.05
    state, soles = talos.standing(), talos.soles(friction=mu)
    push = rbd.ExternalForce("torso_2_link", (0.0, 80.0, 0.0))
    tau = rbd.hold(state, talos.soles(friction=0.7), external=push).tau
    both = rbd.studies.compare_laws(state, tau, soles, external=push)
    assert both.convex.status == both.coulomb.status == "solved" and not both.agree
    slipping = [n for n, c in both.under_convex.items() if c.slip > 1e-3]
    assert slipping
    for name in both.under_coulomb:
        assert both.under_coulomb[name].lifted == pytest.approx(0.0, abs=1e-6)
    total = sum(c.lifted - c.dissipation for c in both.under_convex.values())
    assert total == pytest.approx(0.0, abs=1e-5)


def test_a_held_foot_beside_a_rubbing_one_keeps_still_under_both(talos):
    """What holds has no points that could slip: it carries, and does not move; forces sum to the weight."""
    state, left, right = talos.standing(), talos.soles(None)[0], talos.soles(0.7)[1]
    both = rbd.studies.compare_laws(state, rbd.hold(state, talos.soles()).tau, [left, right])
    assert both.agree
    for under in (both.under_convex, both.under_coulomb):
        assert under["left_sole"].slip == under["left_sole"].lift_off == under["left_sole"].dissipation == 0.0
        assert sum(c.normal for c in under.values()) == pytest.approx(talos.mass * 9.81, rel=1e-6)
