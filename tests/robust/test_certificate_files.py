"""Certificate files: what the verifier proves, and what it refuses."""

from __future__ import annotations

import copy
import json
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.robust import PushSet, hold, verifier

BOX = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "box.urdf")
UNDERSIDE = np.eye(4)
UNDERSIDE[2, 3] = -0.1
STATE = BOX.at(np.array([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]))
FILE = Path(verifier.__file__)


def answer(push: float = 5.0, **given: Any) -> Any:
    """A box that is pushed sideways, of uncertain mass."""
    pushes = PushSet.box("box", (-push, -push, 0.0), (push, push, 0.0))
    sole = rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.2), placement=UNDERSIDE, friction=0.5)
    return hold(STATE, [sole], pushes=pushes, **({"mass": {"box": 0.1}, "com": {"box": 0.01}} | given))


def sealed(document: dict[str, Any]) -> dict[str, Any]:
    """The same with the digest of what it says now."""
    return document | {"sha256": verifier.digest(document)}


def changed(document: Any, path: list[Any], value: Any) -> Any:
    """A copy with another value."""
    out = copy.deepcopy(document)
    at = out
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    return out


def numbers(document: Any, path: list[Any]) -> list[list[Any]]:
    """Where numbers are."""
    if isinstance(document, dict | list):
        items = document.items() if isinstance(document, dict) else enumerate(document)
        return [found for key, x in items for found in numbers(x, [*path, key])]
    return [path] if isinstance(document, int | float) or (isinstance(document, str) and path[-1] != "sha256") else []


def test_the_verifier_is_short_and_knows_the_standard_library_alone():
    """Two hundred lines at most; run by itself it imports neither NumPy nor this package."""
    assert len(FILE.read_text(encoding="utf-8").splitlines()) <= 200
    code = f"import runpy, sys; runpy.run_path({str(FILE)!r}); print({{'rbd', 'numpy', 'pinocchio'}} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-I", "-c", code], capture_output=True, text=True, check=True).stdout == "set()\n"


@pytest.mark.parametrize(("push", "says"), [(5.0, "held"), (60.0, "refuted")])
def test_a_file_is_verified_by_the_command_and_by_itself(tmp_path, push, says):
    """Both answers are kept, and proved again from the file; the exit code says it."""
    path = answer(push).save(tmp_path / "answer.json")
    by_command = CliRunner().invoke(app, ["verify", str(path)])
    assert by_command.exit_code == 0 and by_command.stdout.startswith(f"proved: {says}")
    alone = subprocess.run([sys.executable, "-I", str(FILE), str(path)], capture_output=True, text=True, check=False)
    assert alone.returncode == 0 and alone.stdout == by_command.stdout


def test_margins_raised_by_a_millionth_are_refused(exhaustive):
    """A false claim, well formed: each of a hundred is refused (ten of them outside the exhaustive run)."""
    rng = np.random.default_rng(3)
    for _ in range(100 if exhaustive else 10):
        given = {
            "mass": {"box": rng.uniform(0.0, 0.3)},
            "com": {"box": rng.uniform(0.0, 0.03, 3)},
            "friction": rng.uniform(0.3, 0.9),
        }
        document = answer(rng.uniform(0.0, 8.0), **given).document
        assert verifier.verify(document)[0]
        margin = Fraction(document["claim"]["margin"])
        assert margin > 0
        for raised in (margin + Fraction(1, 10**6), margin * (1 + Fraction(1, 10**6))):
            assert not verifier.verify(sealed(changed(document, ["claim", "margin"], str(raised))))[0]


def test_a_refuted_set_cannot_be_claimed_to_be_held_nor_the_reverse():
    """The proof of one claim proves no other."""
    held, refuted = answer(5.0).document, answer(60.0).document
    for document, says in ((held, "refuted"), (refuted, "held")):
        with pytest.raises(verifier.NO_CERTIFICATE):
            verifier.verify(sealed(changed(document, ["claim", "says"], says)))
    swapped = refuted | {"data": held["data"]}
    assert not verifier.verify(sealed(swapped))[0]


@pytest.mark.parametrize("push", [5.0, 60.0])
def test_a_change_of_any_number_is_noticed(push):
    """By the digest, whatever it is; and no change of a number of the proof makes a file that proves more."""
    document = answer(push).document
    places = numbers(document, [])
    assert len(places) > 200
    for path in places:
        value = document
        for key in path:
            value = value[key]
        try:
            other = (
                str(Fraction(value) * (1 + Fraction(1, 10**6)) + Fraction(1, 10**12)) if isinstance(value, str) else value + 1
            )
        except ValueError:
            other = value + "x"
        proved, words = verifier.verify(changed(document, path, other)) if path != ["kind"] else (False, "SHA-256")
        assert not proved and "SHA-256" in words


def test_data_that_ask_for_more_are_refused_by_the_numbers_themselves():
    """Larger loads, wider columns, less friction, larger rounding: with a digest of their own, the proof no longer holds."""
    document, part = answer(5.0).document, Fraction(1001, 1000)
    wider = [[str(Fraction(x) * part) for x in row] for row in document["data"]["parameters"]]
    larger = [[str(Fraction(x) * part) for x in row] for row in document["data"]["loads"]]
    rough = [str(Fraction(x) + Fraction(1, 1000)) for x in document["data"]["load_radius"]]
    slippery = [str(Fraction(x) / part) for x in document["data"]["friction"]]
    for name, value in (("parameters", wider), ("loads", larger), ("load_radius", rough), ("friction", slippery)):
        assert not verifier.verify(sealed(changed(document, ["data", name], value)))[0]


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (["data", "friction"], ["-1/2"] * 4),
        (["data", "cones"], [[0, 1, 2]] * 4),
        (["data", "idle"], [0, 1, 2, 3, 4]),
        (["data", "loads"], []),
        (["data", "loads"], [[0.5] * 6]),
        (["claim", "torques"], "any"),
        (["claim", "margin"], "-1"),
        (["proof", "forces"], []),
        (["proof", "inverse"], []),
        (["proof"], {"split": 9, "at": "0"}),
        (["kind"], "something else"),
    ],
)
def test_what_is_no_certificate_is_refused(tmp_path, path, value):
    """Sizes that do not agree, decimal numbers, claims that are none: exit code 2, in one line."""
    document = sealed(changed(answer(5.0).document, path, value))
    with pytest.raises(verifier.NO_CERTIFICATE):
        verifier.verify(document)
    file = tmp_path / "bad.json"
    file.write_text(json.dumps(document))
    told = CliRunner().invoke(app, ["verify", str(file)])
    assert told.exit_code == 2 and "no certificate" in told.stderr


def test_a_proof_of_some_corners_proves_nothing_of_all():
    """Each corner of the pushes has its forces."""
    proof = answer(5.0).document["proof"]
    fewer = proof | {"forces": proof["forces"][:3], "corrections": proof["corrections"][:3]}
    with pytest.raises(verifier.NO_CERTIFICATE):
        verifier.verify(sealed(dict(answer(5.0).document) | {"proof": fewer}))


def test_an_inverse_that_repairs_nothing_proves_nothing():
    """Where P X is not near one, nothing is claimed."""
    document = answer(5.0).document
    nothing = [["0"] * 6 for _ in range(12)]
    assert not verifier.verify(sealed(changed(document, ["proof", "inverse"], nothing)))[0]
