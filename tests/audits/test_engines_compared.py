"""Two records of one robot: they part where something was planted, by that contact, for that reason; else nowhere."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import rbd
from rbd.arrays import Array
from rbd.audits import EnginesCompared, Record, compare
from rbd.audits.engines_compared import PARTINGS
from rbd.errors import InputError
from rbd.records import plain_of

G, MU, N = 9.81, 0.5, 6
BOX = rbd.testing.box(mass=1.0)
"""Of 1 kg, 0.4 m long and wide, 0.2 m high."""
AHEAD = MU * 0.1
"""Friction at the bottom, 0.1 m below the centre, would tip the box: it is pressed so far ahead of its centre [m]."""
CORNERS = np.array([[x, y, 0.0] for x in (-0.2, 0.2) for y in (-0.2, 0.2)])
SHARES = 0.25 * (1.0 + np.sign(CORNERS[:, 0]) * AHEAD / 0.2)
"""How much of the force each corner has, so that their centre of pressure is the same point."""


def slide(step: float = 0.01, *, corners: bool = False, begin: float = 0.0, **other: Any) -> Record:
    """The box slides from 1 m/s on: a = -mu g, by one point or by four."""
    t = begin + step * np.arange(N)
    x, zero = t - 0.5 * MU * G * t**2, np.zeros(N)
    q = np.column_stack([x, zero, zero + 0.1, zero, zero, zero, zero + 1.0])
    places = CORNERS if corners else np.array([[AHEAD, 0.0, 0.0]])
    shares = SHARES if corners else np.ones(1)
    points = (q[:, None, :3] * [1.0, 1.0, 0.0] + places).reshape(-1, 3)
    k = len(places)
    arrays: dict[str, Any] = {
        "t": t, "q": q, "v": np.outer(1.0 - MU * G * t, np.eye(6)[0]), "a": np.tile(-MU * G * np.eye(6)[0], (N, 1)),
        "contact_at": np.repeat(np.arange(N), k), "contact_bodies": ["box"] * (k * N), "points": points, "friction": MU,
        "normals": np.tile([0.0, 0.0, 1.0], (k * N, 1)), "forces": np.outer(np.tile(shares, N), [-MU * G, 0.0, G]),
        "gaps": np.zeros(k * N), "engine": "four corners" if corners else "one point",
    }  # fmt: skip
    return Record.of_arrays(BOX, **{**arrays, **other})


ONE = slide()


def changed(name: str, frame: int, by: Any) -> dict[str, Array]:
    """An array of the record with one frame changed."""
    array = np.array(getattr(ONE, name))
    array[frame] += by
    return {name: array}


def test_the_same_motion_by_other_points_agrees() -> None:
    """One engine lists the centre of pressure, the other four corners: resultants are the same."""
    compared = compare(ONE, slide(corners=True))
    assert compared.agree
    assert compared.contacts == ("box",)
    assert compared.force.max() < 1e-12 * G
    assert compared.distance.max() == 0.0
    assert "agree in 6 steps" in str(compared)
    assert plain_of(compared) == plain_of(compared) | {"agree": True, "parting_time": None, "cause": "", "contact": ""}


@pytest.mark.parametrize(
    ("other", "step", "cause", "words"),
    [
        ({"q": ONE.q + 0.02 * np.eye(7)[1]}, 0, "start", ("root_joint.vy differs by 0.02 m",)),
        ({"v": ONE.v + 0.3 * np.eye(6)[5]}, 0, "start", ("root_joint.wz differs by 0.3 rad/s",)),
        ({"tau": 2.0 * np.eye(6)[[0, 0, 0, 2, 2, 2]] * np.eye(6)[2]}, 3, "known forces", ("root_joint.vz", "2 N")),
        (
            {"push_at": [2], "push_bodies": ["box"], "push_points": np.zeros((1, 3)), "push_forces": [[0, 7.0, 0]]},
            2, "known forces", ("pushes", "7 N"),
        ),
        (changed("forces", 4, [0, 0, -9.81 / 2]), 4, "law", ("(-4.905, 0, 9.81)", "(-4.905, 0, 4.905)", "outside the cone")),
        (changed("forces", 4, [0.4905, 0, -0.981]), 4, "force", ("1.1 N apart", "centres of pressure are 0 mm")),
        ({"forces": 0.8 * ONE.forces, "friction": 0.4}, 0, "friction", ("0.5 and 0.4",)),
        (changed("forces", 1, -ONE.forces[1]) | changed("gaps", 1, 0.003), 1, "contact", ("(0, 0, 0) N", "3 mm apart")),
        (changed("forces", 1, -ONE.forces[1]) | changed("gaps", 1, -0.003), 1, "contact", ("3 mm inside each other",)),
        (changed("q", 3, 0.004 * np.eye(7)[0]), 3, "motion", ("root_joint.vx differs by 0.004 m",)),
    ],
)  # fmt: skip
def test_what_was_planted_is_found(other: Mapping[str, Any], step: int, cause: str, words: tuple[str, ...]) -> None:
    """In the step where it is, by its contact, with its size."""
    compared = compare(ONE, slide(**other))
    parting = compared.parting
    assert parting is not None
    assert cause in PARTINGS
    assert (parting.step, parting.cause) == (step, cause)
    assert all(each in parting.text for each in words), parting.text
    assert parting.t == ONE.t[step]
    assert plain_of(compared)["parting_step"] == step
    assert f"step {step} of 6: {parting.text}" in str(compared)
    at_contact = cause in ("contact", "friction", "slip", "law", "force")
    assert parting.contact == "box" * at_contact
    if at_contact:
        assert np.abs(parting.point - ONE.points[step]).max() < 1e-12


def test_one_slips_and_the_other_sticks() -> None:
    """A push below the friction limit; in one record the box moves all the same, too slowly for the motions to part."""
    still = {"q": ONE.q[[0] * N], "a": np.zeros((N, 6)), "points": ONE.points[[0] * N]}
    pushed = np.outer(np.ones(N), 3.0 * np.eye(6)[0])
    rests = slide(**still, v=np.zeros((N, 6)), tau=pushed, forces=[[-3.0, 0.0, G]] * N)
    v = np.zeros((N, 6))
    v[2:, 0] = 0.008
    slides = slide(**still, v=v, tau=pushed, forces=[[-3.0, 0.0, G]] * 2 + [[-3.3, 0.0, G]] * (N - 2))
    parting = compare(rests, replace(slides, engine="soft")).parting
    assert parting is not None
    assert (parting.cause, parting.step) == ("slip", 2)
    assert "box slips in soft, by 0.008 m/s, and sticks in one point" in parting.text


def test_another_step_is_compared_at_common_times() -> None:
    """Of the record with fewer frames; motions are interpolated, so that half a step aside makes no difference of motion."""
    coarse, fine = slide(0.01), slide(0.005, begin=0.0025)
    compared = compare(coarse, fine)
    assert np.array_equal(compared.t, coarse.t[1:3])
    assert compared.apart == pytest.approx(0.0025, abs=1e-12)
    assert compared.distance.max() < 1e-12  # a parabola, by cubics
    assert compared.agree
    assert "motions interpolated, forces those of the nearest frame" in str(compared)
    assert np.array_equal(compare(fine, coarse).frames, compared.frames[:, ::-1])
    whole = compare(slide(0.005), coarse)
    assert whole.apart == 0.0
    assert np.array_equal(whole.frames, [[0, 0], [2, 1], [4, 2]])


def test_thresholds_are_those_given() -> None:
    """A difference of 4 mm, and of 1.1 N."""
    moved, torn = slide(**changed("q", 3, 0.004 * np.eye(7)[0])), slide(**changed("forces", 4, [0.4905, 0, -0.981]))
    assert compare(ONE, moved, distance=0.0041).agree
    assert not compare(ONE, moved, distance=0.0039).agree
    assert compare(ONE, torn, force=1.1 / G).agree
    assert not compare(ONE, torn, force=1.09 / G).agree


def test_what_cannot_be_compared_is_refused() -> None:
    """Other robots, other times, no records."""
    bar = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    other = Record.of_arrays(bar, t=[0.0], q=[bar.at("assembled").q], v=np.zeros((1, bar.nv)), a=np.zeros((1, bar.nv)))
    with pytest.raises(InputError, match="of box and .* with other joints; expected one robot"):
        compare(ONE, other)
    with pytest.raises(InputError, match="no common time: they are from 0 to 0.05 s and 3 to 3.05 s"):
        compare(ONE, slide(begin=3.0))
    with pytest.raises(InputError, match="second is 'x'"):
        compare(ONE, "x")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="force is 0"):
        compare(ONE, ONE, force=0.0)


def test_engines_that_call_the_free_joint_otherwise() -> None:
    """MuJoCo has no force on a box that only just touches, which Coulomb's law stops by friction from the start."""
    mujoco = pytest.importorskip("mujoco")
    xml = (
        '<mujoco><worldbody><geom type="plane" size="9 9 1" friction=".5 0 0"/><body name="box" pos="0 0 .1"><freejoint/>'
        '<geom type="box" size=".2 .2 .1" mass="1" friction=".5 0 0"/></body></worldbody></mujoco>'
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data, spec = mujoco.MjData(model), mujoco.mjtState.mjSTATE_INTEGRATION
    data.qvel[0], states = 1.0, np.empty((5, mujoco.mj_stateSize(model, spec)))
    for row in states:
        mujoco.mj_getState(model, data, row, spec)
        mujoco.mj_step(model, data)
    theirs = rbd.audits.from_mujoco(model, states)
    compared: EnginesCompared = compare(theirs, slide(0.002, corners=True))
    assert compared.parting is not None
    assert (compared.parting.cause, compared.parting.contact, compared.parting.step) == ("contact", "box", 0)
    assert np.abs(compared.forces[0, 0] + [-MU * G, 0.0, G]).max() < 1e-9
