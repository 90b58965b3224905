"""Sliders and choices, and what anybody may send as their values."""

from __future__ import annotations

import json
import math
from typing import Any

import hypothesis
import hypothesis.strategies as st
import pytest

from rbd.errors import InputError
from rbd.visual import Choice, Slider
from rbd.visual.live import LARGEST_MESSAGE, checked_controls, read_request

PUSH = Slider("push", -10.0, 200.0, 50.0, unit="N")
LAW = Choice("law", ("coulomb", "convex"))
CONTROLS = checked_controls([PUSH, LAW])


def said(**values: Any) -> str:
    """A message of a page."""
    return json.dumps({"set": values, "asked": [7, 8]})


@pytest.mark.parametrize(
    ("given", "read"),
    [(12.5, 12.5), (12, 12.0), (-1e9, -10.0), (1e400, 200.0), (10**4000, None), (-0.0, 0.0)],
    ids=str,
)
def test_numbers_are_cut_at_their_bounds(given: float, read: float | None):
    """What a slider could not show is taken as the nearest that it could; what no float holds is none."""
    request = read_request(said(push=given), CONTROLS)
    assert (None if request is None else request.values["push"]) == read
    assert request is None or request.asked == (7, 8)


@pytest.mark.parametrize("given", [True, None, "50", [50.0], {"x": 1}, math.nan], ids=str)
def test_what_is_no_number_is_ignored(given: object):
    """Neither truth values nor text nor NaN."""
    assert read_request(said(push=given), CONTROLS) is None
    both = read_request(said(push=given, law="convex"), CONTROLS)
    assert both is not None and both.values == {"law": "convex"}


@pytest.mark.parametrize("given", ["none", "Convex", "", 0, None, ["convex"], True])
def test_what_is_no_option_is_ignored(given: object):
    """A choice takes its own options, as they are written."""
    assert read_request(said(law=given), CONTROLS) is None


@pytest.mark.parametrize(
    "message",
    [
        *("", "x", "[]", "1", "null", "{}", '{"set": []}', '{"set": {"other": 1}}', '{"set": null}', "[" * 3000, "{" * 3000),
        *('{"set": {"__class__": 1}}', '{"set": {"push": NaN}}', '{"set": {"push": 1e', "\x00", "\ud800"),
        said(push=50.0) + " " * LARGEST_MESSAGE,
    ],
    ids=lambda text: repr(text[:12]),
)
def test_nonsense_is_ignored(message: str):
    """Nothing that a socket may carry raises, or sets anything."""
    assert read_request(message, CONTROLS) is None


@pytest.mark.parametrize("asked", [None, 1, [], [1], [1, 2, 3], [-1, 2], [1, 2**32], [True, 1], [0.5, 1], ["1", 2]])
def test_a_question_without_a_number_is_answered_all_the_same(asked: object):
    """Its answer names no page."""
    request = read_request(json.dumps({"set": {"push": 1.0}, "asked": asked}), CONTROLS)
    assert request is not None and request.asked == (0, 0)


@hypothesis.settings(derandomize=True, database=None, max_examples=200, deadline=None)
@hypothesis.given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
        lambda some: st.lists(some, max_size=3) | st.dictionaries(st.sampled_from(["set", "push", "law", "asked", "x"]), some),
        max_leaves=12,
    )
)
def test_whatever_is_sent_stays_within_bounds(message: object):
    """Any JSON: no error, known names, values that the page could set."""
    request = read_request(json.dumps(message), CONTROLS)
    for name, value in {} if request is None else request.values.items():
        assert name in CONTROLS and CONTROLS[name].read(value) == value


def test_steps_are_round_numbers():
    """A two-hundredth of the range, rounded; or the one given."""
    assert [Slider("x", 0.0, high, 0.0).step for high in (200.0, 1.0, 360.0, 3e-3)] == [1.0, 0.005, 2.0, 2e-5]
    assert Slider("x", 0.0, 1.0, 0.0, step=0.25).step == 0.25


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Slider("", 0, 1, 0), "name is ''"),
        (lambda: Slider("x", 1, 0, 0), "expected low < high"),
        (lambda: Slider("x", 0, 1, 2), "starts at 2"),
        (lambda: Slider("x", 0, math.inf, 0), "high of 'x'"),
        (lambda: Slider("x", math.nan, 1, 0), "low of 'x'"),
        (lambda: Slider("x", 0, 1, 0, step=0.0), "step of 'x'"),
        (lambda: Slider("x", 0, 1, 0, unit=3), "unit of 'x'"),  # type: ignore[arg-type]
        (lambda: Choice("x", ()), "1 to 200 short names"),
        (lambda: Choice("x", "ab"), "short names in a list"),  # type: ignore[arg-type]
        (lambda: Choice("x", ("a", "a")), "one twice"),
        (lambda: Choice("x", ("a",), "b"), "expected one of a"),
        (lambda: checked_controls([PUSH, PUSH]), "two controls are named 'push'"),
        (lambda: checked_controls([]), "there are 0 controls"),
        (lambda: checked_controls(["push"]), "controls hold 'push'"),
        (lambda: checked_controls({"push": PUSH}), "expected a list"),
    ],
)
def test_what_is_no_control_is_refused(make: Any, words: str):
    """In words, when it is made."""
    with pytest.raises(InputError, match=words):
        make()
