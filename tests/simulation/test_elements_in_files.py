"""Force elements of a trajectory in its file: there again to the last bit, and told where they are not."""

from __future__ import annotations

import copy
import dataclasses
import json
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.forces.element_numbers import data_of, element_of
from rbd.motion.identification import MeasuredMotion
from rbd.visual.playback.animation import shown_motion
from rbd.visual.playback.motion_frames import frames_of

SLANTED = pin.SE3(pin.exp3(np.array([0.3, -0.2, 0.7])), np.array([0.1, 1 / 3, -0.2]))
ELEMENTS = (
    rbd.Spring("link_1", to=(0, 0, 1), stiffness=10.0, rest=1 / 3, preload=0.1, offset=(0.1, 0, 0)),
    rbd.Spring("link_1", to="link_2", stiffness=2.0, axis=(1.0, 2.0, 3.0), offset=SLANTED, name="twist"),
    rbd.Damper("link_2", to=(0.3, 0.1, 2.0), damping=0.7, name="dämpfer"),
    rbd.Bushing("link_2", to=SLANTED, stiffness=(1, 2, 3, 0.1, 0.2, 1 / 7), damping=0.1, preload=0.2),
    rbd.JointSpring("joint_1", stiffness=3.0, rest=0.2, preload=-0.1),
    rbd.JointSpring("ball", stiffness=3.0, rest=(0.1, 0.2, 0.3, np.sqrt(0.86)), name="in the ball"),
    rbd.JointDamping({"joint_1": 0.5, "joint_2": 1 / 3}),
    rbd.JointDamping({"pose": 0.5}, name="an odd joint"),
)


class Wind:
    """A force element of a user."""

    name = "wind"

    def generalised(self, state: rbd.State) -> tuple[np.ndarray, np.ndarray]:
        """Damping of 1."""
        return -state.v, np.zeros(6)

    def energy(self, state: rbd.State) -> float:
        """None."""
        return 0.0

    def dissipation(self, state: rbd.State) -> float:
        """Its power."""
        return float(state.v @ state.v)


@pytest.fixture(scope="module")
def arm() -> rbd.Robot:
    return rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])


def swing(arm: rbd.Robot, external: object) -> rbd.Trajectory:
    return rbd.simulate(arm.at([0.4, 0.2]), duration=0.2, step=0.02, external=external, progress=False)


def acting() -> list[object]:
    return [rbd.JointSpring("joint_1", stiffness=20.0), rbd.JointDamping({"joint_1": 0.5, "joint_2": 1 / 3})]


@pytest.mark.parametrize("element", ELEMENTS, ids=lambda element: element.name)
def test_an_element_is_the_same_from_text_a_copy_and_a_pickle(element: object):
    again = element_of(json.loads(json.dumps(data_of(element))))
    for other in (again, copy.deepcopy(element), pickle.loads(pickle.dumps(element))):
        assert other is not element and other == element and hash(other) == hash(element)
        assert repr(other).replace(".0", "") == repr(element).replace(".0", "") and data_of(other) == data_of(element)


def test_elements_that_differ_are_not_equal():
    spring = ELEMENTS[0]
    for changed in ({"rest": 0.3}, {"name": "another"}, {"to": (0, 0, 1.1)}, {"offset": SLANTED}):
        assert dataclasses.replace(spring, **changed) != spring  # type: ignore[type-var]
    assert len(set(ELEMENTS)) == len(ELEMENTS)

    class Weaker(rbd.Spring):
        """What a derived class adds is not compared: only itself is the same."""

    one, other = (Weaker("link_1", to=(0, 0, 1), stiffness=10.0, rest=0.5) for _ in range(2))
    assert one == one and one != other and data_of(one) is None


@pytest.mark.parametrize("ending", ["npz", "nc"])
def test_a_file_has_the_elements(arm: rbd.Robot, tmp_path: Path, ending: str):
    run = swing(arm, acting())
    run.save(tmp_path / f"swing.{ending}")
    again = rbd.Trajectory.load(tmp_path / f"swing.{ending}", arm)
    assert again.elements == run.elements and len(run.elements) == 2
    names = [[e.name for e in frames_of(shown_motion(each), [1]).elements] for each in (again, run)]
    assert names[0] == names[1] != []
    with pytest.raises(rbd.InputError, match="springs or dampers acted in the trajectory"):
        rbd.identify(again)
    found = rbd.identify(MeasuredMotion(again, external=list(again.elements)), columns=["damping"])
    np.testing.assert_allclose(found.theta, 0.0, atol=1e-8)


def test_elements_of_a_function_or_of_an_old_file_are_told(arm: rbd.Robot):
    """The energies tell that springs acted: no masses are identified, and a page says what it does not draw."""
    given = acting()

    def stiffening(state: rbd.State, t: float) -> list[object]:
        return [rbd.JointSpring("joint_1", stiffness=20.0 + t)]

    for unknown in (swing(arm, stiffening), dataclasses.replace(swing(arm, given), elements=())):
        assert unknown.elements == () and unknown.elastic.any()
        with pytest.raises(rbd.InputError, match="energy of springs or work of dampers, whose elements it does not know"):
            rbd.identify(unknown)
        assert any("springs or dampers that acted" in words for words in frames_of(shown_motion(unknown), [1]).left_out)
        assert not any("that acted" in words for words in frames_of(shown_motion(unknown), [1], external=given).left_out)
    assert not any("that acted" in words for words in frames_of(shown_motion(swing(arm, None)), [1]).left_out)


@pytest.mark.filterwarnings("ignore:the steps of .* energy")  # they are long
def test_an_element_of_a_user_is_warned_of(arm: rbd.Robot, tmp_path: Path):
    run = swing(arm, [*acting(), Wind()])
    run.save(tmp_path / "wind.npz")
    with pytest.warns(rbd.errors.ForceElementWarning, match="by name alone .wind."):
        again = rbd.Trajectory.load(tmp_path / "wind.npz", arm)
    assert again.elements == run.elements[:2]


@pytest.mark.parametrize(
    "data",
    [
        None, {}, {"kind": "Wind"}, {"kind": "Spring"}, {**(data_of(ELEMENTS[0]) or {}), "stiffness": "much"},
        {**(data_of(ELEMENTS[0]) or {}), "to": {"pose": [1.0]}}, {**(data_of(ELEMENTS[0]) or {}), "offset": {"a": 1}},
        {**(data_of(ELEMENTS[1]) or {}), "axis": [1, 2]}, {**(data_of(ELEMENTS[6]) or {}), "damping": {"joints": {"a": []}}},
        {**(data_of(ELEMENTS[1]) or {}), "offset": {"pose": [[1, 2], [3]]}},
    ],
)  # fmt: skip
def test_other_data_are_refused(data: object):
    with pytest.raises(rbd.InputError):
        element_of(data)
