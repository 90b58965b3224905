"""Nonsense in, an `RbdError` out, or a right answer: every public function of `rbd.planar`, as tests/test_guards.py has it."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import sympy as sp

import rbd
from rbd import planar

ARM = planar.Chain(2, lengths=[0.5, 0.4])
SYMBOLS = planar.Chain(2)
Q = np.array([0.3, 0.8])
PATH = planar.minimum_jerk([0.6, 0.3], [0.2, 0.6], 1.0)
X, Y = sp.symbols("x y")

NAMES = ["", " ", "join", "SEGMENT", "a\0b", "Ω\u202e", "../../x", "%s{}", "x" * 100_000, "\ud800", b"joint"]
NUMBERS = [0, -1, 10**400, 10**12, -(2**70), 1e300, 1e-320, np.nan, np.inf, -np.inf, 0.5, 1 + 2j, True, sp.oo, sp.nan, sp.zoo]
ODD = [
    *(None, (), [], {}, set(), [[]], [None], [[1.0], [1.0, 2.0]], object(), object, len, ..., range(3), lambda: 1, {"a": 1}),
    *(
        np.array(3.0),
        np.array([]),
        np.zeros((0, 3)),
        np.zeros((3, 0)),
        np.array(["1", "2"]),
        np.ma.masked_array([1.0, 2.0], [0, 1]),
    ),
    *(
        np.bool_(True),
        np.array([None] * 2),
        sp.Symbol("z"),
        sp.Matrix([[1, 2], [3, 4]]),
        sp.Eq(X, X),
        sp.Eq(X, Y),
        sp.sin,
        sp.S.true,
    ),
    *([np.nan, 1.0], [1e300, 1e300], [np.inf, 0.0], [1 + 2j, 0], "1 2", ARM, SYMBOLS, planar.Chain, PATH, [10**400] * 2),
]


def looked_at(answer: Any) -> Any:
    """The numbers of an answer."""
    return [getattr(answer, name) for name in ("displacement", "velocity", "acceleration", "jerk") if hasattr(answer, name)]


CASES: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Chain": (planar.Chain, {"n": 2, "lengths": [0.5, 0.4], "angles": "joint"}),
    "constrained": (planar.constrained, {"chain": SYMBOLS, "relation": {1: 0}, "branch": None, "free": [2]}),
    "dynamics": (
        planar.dynamics,
        {"chain": ARM, "masses": [1.0, 2.0], "centres": [0.2, 0.2], "inertias": [0.1, 0.1], "gravity": 9.81},
    ),
    "endpoint_motion": (
        planar.endpoint_motion,
        {"chain": ARM, "path": PATH, "times": np.array([0.1, 0.5]), "branch": 0, "start": None},
    ),
    "inverse": (planar.inverse, {"chain": ARM, "target": np.array([0.6, 0.2]), "start": None, "tolerance": 1e-12}),
    "inverse, three links": (
        planar.inverse,
        {"chain": planar.Chain(3, lengths=[0.5, 0.4, 0.3]), "target": [0.6, 0.2], "start": [0.1, 0.2, 0.3]},
    ),
    "inverse_formulas": (planar.inverse_formulas, {"chain": ARM, "x": X, "y": None}),
    "inverse_path": (
        planar.inverse_path,
        {"chain": ARM, "points": np.array([[0.6, 0.2], [0.6, 0.21]]), "start": None, "branch": 0, "check": True},
    ),
    "jacobian": (planar.jacobian, {"f": [X**2 * Y, 5 * X + sp.sin(Y)], "x": [X, Y]}),
    "joint_motion": (planar.joint_motion, {"chain": ARM, "path": planar.minimum_jerk(Q, Q + 1.0, 1.0), "times": None}),
    "joint_rates": (
        planar.joint_rates,
        {"chain": ARM, "q": Q, "velocity": Q, "acceleration": Q, "jerk": Q, "at_singular": "raise"},
    ),
    "minimum_jerk": (planar.minimum_jerk, {"start": [1.0, 0.0], "stop": [0.5, 0.5], "duration": 1.0}),
    "robot_coordinates": (planar.robot_coordinates, {"chain": ARM}),
    "to_robot": (
        planar.to_robot,
        {"chain": ARM, "masses": [1.0, 2.0], "lengths": None, "bodies": "rods", "plane": None, "values": None, "name": "arm"},
    ),
    "to_robot, dynamics": (planar.to_robot, {"chain": planar.dynamics(ARM, masses=[1, 2], bodies="rods", gravity=0)}),
    "to_urdf": (
        planar.to_urdf,
        {"chain": ARM, "masses": [1.0, 2.0], "lengths": None, "centres": None, "inertias": None, "plane": "xz", "name": "arm"},
    ),
    "classify": (planar.classify, {"chain": ARM, "pinned": None}),
    "Chain.position": (ARM.position, {"i": 1}),
    "Chain.jacobian": (ARM.jacobian, {"i": 1}),
    "Chain.split": (ARM.split, {"i": 1}),
    "Chain.function": (ARM.function, {"expr": ARM.position()}),
    "Chain.ellipse": (ARM.ellipse, {"q": Q, "kind": "velocity"}),
    "MinimumJerk.velocity": (PATH.velocity, {"t": 0.5}),
}


def numbers_in(answer: Any) -> list[np.ndarray]:
    """All numbers of an answer that is plain or a record."""
    if isinstance(answer, np.ndarray) and answer.dtype.kind == "f":
        return [answer]
    if isinstance(answer, float | np.floating):
        return [np.array(answer)]
    if isinstance(answer, tuple | list):
        return [x for each in answer for x in numbers_in(each)]
    if hasattr(answer, "__dataclass_fields__"):
        return [
            x for name in answer.__dataclass_fields__ if not name.startswith("_") for x in numbers_in(getattr(answer, name))
        ]
    return []


@pytest.mark.parametrize("name", CASES)
def test_good_arguments_are_answered(name):
    """The law below can fail."""
    call, good = CASES[name]
    call(**good)


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, (_, good) in CASES.items() for key in good])
def test_each_odd_thing_is_refused_or_answered(name, key):
    """An `RbdError` that can be read, or numbers that are finite."""
    call, good = CASES[name]
    for odd in (*NAMES, *NUMBERS, *ODD):
        try:
            answer = call(**{**good, key: odd})
        except rbd.RbdError as error:
            assert 0 < len(str(error)) <= 1500
            continue
        if name not in ("to_urdf", "inverse") or key not in ("path", "target"):
            assert all(np.isfinite(x).all() for x in numbers_in(answer)), (odd, answer)


def test_every_public_function_is_asked():
    """A new one wants a case; records are made by the functions."""
    functions = {n for n in planar.__all__ if inspect.isfunction(getattr(planar, n))}
    assert functions <= {name.partition(",")[0] for name in CASES}
