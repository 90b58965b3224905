"""What a contact carries: its parts against their definitions."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest

from rbd.problem.answer import ContactForce
from rbd.problem.rows import Patch

R_WC = pin.exp3(np.array([0.5, -0.8, 0.3]))
POINT = np.array([0.3, -0.2, 0.7])
CORNERS = np.array([[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]])


def patch(friction: float | None = 0.5) -> Patch:
    """A patch that is turned every way."""
    return Patch(POINT, R_WC, CORNERS, friction)


@pytest.mark.parametrize("wrench", [False, True])
def test_a_force_has_a_normal_part_and_a_tangential_one(wrench: bool) -> None:
    """Along the third contact axis and across it; their ratio over mu is the friction used, whatever moments there are."""
    f = R_WC @ np.array([3.0, -4.0, 20.0])
    given = np.r_[f, 0.3, -0.1, 0.2] if wrench else f
    found = ContactForce.of(patch(), given)
    assert np.array_equal(found.force, f)
    assert found.normal == pytest.approx(20.0, rel=1e-14) and found.tangential == pytest.approx(5.0, rel=1e-14)
    assert found.friction_used == pytest.approx(5.0 / (0.5 * 20.0), rel=1e-14)
    assert ContactForce.of(patch(None), given).friction_used is None
    assert ContactForce.of(patch(0.0), given).friction_used is None
    if not wrench:
        assert np.array_equal(found.centre_of_pressure, POINT)


def test_the_tangential_moment_vanishes_about_the_centre_of_pressure() -> None:
    """About p, which is in the plane of the patch, the moment m - (p - point) x f has no part in that plane."""
    wrench = np.r_[R_WC @ np.array([3.0, -4.0, 20.0]), R_WC @ np.array([0.8, -1.1, 0.4])]
    found = ContactForce.of(patch(), wrench)
    assert found.centre_of_pressure is not None
    arm = found.centre_of_pressure - POINT
    assert abs(R_WC[:, 2] @ arm) < 1e-15 and np.abs(arm).max() > 0.01
    left = R_WC.T @ (wrench[3:] - np.cross(arm, wrench[:3]))
    assert np.abs(left[:2]).max() < 1e-14


@pytest.mark.parametrize("size", [3, 6])
@pytest.mark.parametrize("normal", [0.0, -20.0, 0.9e-6])
def test_what_pulls_or_carries_nothing_has_no_ratio_and_no_centre(size: int, normal: float) -> None:
    """Its force is said all the same, without the moment."""
    f = R_WC @ np.array([1.0, 0.0, normal])
    found = ContactForce.of(patch(), np.r_[f, 1.0, 2.0, 3.0][:size])
    assert np.array_equal(found.force, f) and found.normal == pytest.approx(normal, rel=1e-15, abs=1e-15)
    assert found.tangential == pytest.approx(1.0, rel=1e-14)
    assert found.friction_used is None and found.centre_of_pressure is None


def test_a_contact_force_is_printed_in_newtons_per_cent_and_metres() -> None:
    """One row of the table; no minus before a zero."""
    text = str(ContactForce.of(Patch(np.array([-1e-9, 0.25, 0.0]), np.eye(3), CORNERS, 0.5), np.array([3.0, 4.0, 20.0])))
    assert text.split() == ["20.000", "N", "5.000", "N", "50.0", "%", "(0.000,", "0.250,", "0.000)", "m"]
    assert str(ContactForce.of(patch(), np.zeros(3))).split() == ["0.000", "N", "0.000", "N", "-", "-"]
    assert math.isclose(ContactForce.of(patch(), R_WC[:, 2]).normal, 1.0)
