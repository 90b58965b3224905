"""What a mode is does not depend on the unit of length: lengths count over the robot's length, angles in radians."""

from __future__ import annotations

import numpy as np
import pytest

from rbd.mechanism.small_motion.modes import in_phase, largest_entry, shares_of

ROUNDING = 1e-12


@pytest.mark.parametrize("length", [1e-4, 1.0, 1e4])
@pytest.mark.parametrize(("aside", "real"), [(ROUNDING, True), (1e-6, False)])
def test_what_is_out_of_phase_counts_over_the_robots_length(length: float, aside: float, real: bool) -> None:
    """An angle and a length, in phase but for rounding, or out of phase by a millionth of what moves: the same in any unit."""
    scale = np.array([1.0, length])
    for moved in (np.array([1.0, 0.5j * aside]), np.array([0.1 + 0.1j * aside, 1.0]), np.array([1j * aside, 1.0])):
        for dq, dv in (
            in_phase(moved * scale, 3.0 * moved * scale, scale),
            in_phase(moved * scale, 1e-5 * moved * scale, scale),
        ):
            assert np.isrealobj(dq) is real and np.isrealobj(dv) is real
            assert np.array_equal(np.real(dq), moved.real * scale)


def test_position_and_velocity_are_judged_each_by_itself() -> None:
    """A real shape and a velocity a quarter of a period ahead."""
    dq, dv = in_phase(np.array([1.0 + 0.0j, 0.5]), np.array([2.0j, 1.0j]), np.ones(2))
    assert np.isrealobj(dq) and np.iscomplexobj(dv) and np.array_equal(dv, [2.0j, 1.0j])


@pytest.mark.parametrize("length", [1e-4, 1.0, 1e4])
def test_the_largest_entry_and_the_shares_count_over_the_robots_length(length: float) -> None:
    """0.3 rad and 0.4 lengths: the length is largest, and has 16 of 25 parts; where nothing moves, speeds count."""
    scale, names = np.array([1.0, length]), ["turn", "slide"]
    shape = np.array([0.3j, -0.4]) * scale
    largest, of_velocity = largest_entry(shape, 9.0 * shape[::-1] / scale[::-1] * scale, scale)
    assert largest == pytest.approx(-0.4) and of_velocity is False
    shares = shares_of(shape, scale, names)
    assert list(shares) == ["slide", "turn"] and list(shares.values()) == pytest.approx([0.64, 0.36])
    largest, of_velocity = largest_entry(0.0 * shape, 2.0 * shape, scale)
    assert largest == pytest.approx(-0.8) and of_velocity is True
    assert largest_entry(np.zeros(2), np.zeros(2), scale)[0] == 1.0
