"""Four-bars by Grashof's condition, and their transmission angle, against closed forms and the motions of the linkages."""

from __future__ import annotations

import math

import numpy as np
import pytest

import rbd
from rbd.errors import InputError
from rbd.mechanism import FourBarClass, classify, four_bar, trace

KINDS = {
    (1.0, 3.0, 2.5, 3.0): "crank-rocker",
    (2.5, 3.0, 1.0, 3.0): "rocker-crank",
    (3.0, 3.0, 2.5, 1.0): "double crank",
    (3.0, 1.0, 2.5, 3.0): "double rocker",
    (2.0, 2.0, 2.2, 3.5): "triple rocker",
    (1.0, 2.0, 1.5, 1.5): "change point",
    (1.0, 3.0, 1.0, 3.0): "change point",
}
TURN = 2.0 * math.pi


def turns(a: float, b: float, c: float, d: float) -> bool:
    """Whether the bar a turns round on the bar d: the loop closes where a and d are stretched, and where they are folded."""
    return a + d <= b + c and abs(d - a) >= abs(b - c)


@pytest.mark.parametrize(("lengths", "kind"), KINDS.items())
def test_the_class_says_which_bars_turn_round(lengths: tuple[float, ...], kind: str) -> None:
    """Input and output turn round on the ground as triangle inequalities at the ends say; some bar does if s + l <= p + q."""
    a, b, c, d = lengths
    found = FourBarClass(*lengths)
    assert found.kind == kind and str(found).startswith(f"{kind}: ")
    s, p, q, longest = sorted(lengths)
    assert found.excess == pytest.approx(s + longest - p - q, abs=1e-15) and found.grashof == (s + longest <= p + q)
    if kind != "change point":
        round_of = {"crank-rocker": (True, False), "rocker-crank": (False, True), "double crank": (True, True)}
        assert (turns(a, b, c, d), turns(c, b, a, d)) == round_of.get(kind, (False, False))
        assert turns(b, c, d, a) == (kind in ("double rocker", "crank-rocker"))  # of the coupler on the input


@pytest.mark.parametrize("lengths", [k for k in KINDS if KINDS[k] != "change point"], ids=KINDS.get)
def test_a_robot_has_the_class_of_its_lengths_and_moves_so(lengths: tuple[float, ...]) -> None:
    """The lengths are measured from the file's frames, in any pose; a driven input turns round where the class says so."""
    robot = four_bar(*lengths)
    found = classify(robot.at("assembled")).four_bar
    assert found is not None and found.lengths == pytest.approx(lengths, abs=1e-12)
    assert f"As a four-bar it is a {found.kind}" in str(classify(robot.at()))  # open there
    start = rbd.mechanism.link_angles(robot.at("assembled"))["crank"]
    path = trace(robot.at("assembled"), joint="crank_joint", values=(start, start + TURN), steps=12)
    assert path.complete == (found.kind in ("crank-rocker", "double crank"))


def test_the_driven_bar_is_the_input() -> None:
    """Driven at the other pin of the ground, the same linkage is a rocker-crank; driven at the coupler it is no input."""
    robot = four_bar(1.0, 3.0, 2.5, 3.0)
    state = robot.at("assembled")
    angle = robot.joints["rocker_joint"].coordinate(state.q)
    back = trace(state, joint="rocker_joint", values=(angle, angle + 0.2), steps=4)
    # the output is then the crank, 1 m, and the far end is the rocker's tip seen from the crank's pin
    far = np.abs(3.0 + 2.5 * np.exp(1j * back.input))
    assert back.transmission_angle == pytest.approx(np.arccos((1.0 + 9.0 - far**2) / 6.0), abs=1e-12)
    bend = robot.joints["coupler_joint"].coordinate(state.q)
    with pytest.raises(InputError, match="driven at the ground"):
        _ = trace(state, joint="coupler_joint", values=(bend, bend + 0.1), steps=2).transmission_angle
    slides = rbd.mechanism.slider_crank(1.0, 3.0)
    assert classify(slides.at("assembled")).four_bar is None
    assert classify(rbd.load_robot("solo12").standing()).four_bar is None


def test_transmission_angle_by_the_cosine_rule() -> None:
    """Cos mu = (b^2 + c^2 - f^2) / (2 b c), f from the crank's tip to the far pin: of the moving robot."""
    a, b, c, d = 0.4, 1.2, 0.8, 1.0
    path = trace(four_bar(a, b, c, d).at("assembled"), joint="crank_joint", values=(0.0, TURN), steps=50)
    far = np.abs(a * np.exp(1j * path.input) - d)
    expected = np.arccos((b * b + c * c - far**2) / (2.0 * b * c))
    assert np.abs(path.transmission_angle - expected).max() < 1e-12
    found = FourBarClass(a, b, c, d)
    assert np.abs(found.transmission_angle(path.input) - expected).max() < 1e-12
    # its extremes are where crank and ground are in line
    assert path.transmission_angle[[0, 25]] == pytest.approx([expected.min(), expected.max()], abs=1e-12)
    assert np.isnan(FourBarClass(2.0, 2.0, 2.2, 3.5).transmission_angle([math.pi, 0.0])).tolist() == [True, False]


def test_bars_that_do_not_close_are_no_four_bar() -> None:
    """Named with what is missing."""
    with pytest.raises(InputError, match="ground is 1 m longer"):
        FourBarClass(1.0, 1.0, 1.0, 4.0)
    with pytest.raises(InputError, match="coupler"):
        FourBarClass(1.0, -1.0, 1.0, 2.0)
