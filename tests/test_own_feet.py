"""Feet of one's own, registered once: `load_robot(file, feet=...)`, and what stands on them."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from test_cli import run

import rbd
from rbd.errors import DuplicateName, FrameNotFound, InputError, ModelError, UnknownName

URDF = Path(__file__).parents[1] / "urdf"
WALKER = URDF / "walker.urdf"
FEET = ["left_foot", "right_foot"]


def test_frames_give_the_undersides_of_their_boxes() -> None:
    """The walker's feet are boxes of 0.16 x 0.08 m, their undersides 0.06 m below the frame: it stands on them, and is held."""
    walker = rbd.load_robot(WALKER, feet=FEET)
    soles, state = walker.soles(), walker.standing()
    assert [sole.name for sole in soles] == FEET
    for sole in soles:
        corners = sole.placement.translation + sole.corners @ sole.placement.rotation.T
        expected = {(x, y, -0.06) for x in (-0.06, 0.1) for y in (-0.04, 0.04)}
        assert {tuple(np.round(corner, 12) + 0.0) for corner in corners} == expected
        assert np.abs(sole.rows(state).patch.gaps).max() < 1e-12
    assert not state.q[7:].any()
    assert rbd.hold(state, soles).residuals.stationarity < 1e-9
    by_hand = rbd.load_robot(WALKER).soles_from_collision(FEET)
    for one, other in zip(soles, by_hand, strict=True):
        assert np.abs(one.corners - other.corners).max() < 1e-15 and one.placement.isApprox(other.placement, 1e-15)


def test_contacts_of_ones_own_are_taken_as_they_are() -> None:
    """Names, frames, corners and poses to rounding; friction and ground are those that `feet` is asked for."""
    X_FP = pin.SE3(pin.rpy.rpyToMatrix(0.1, -0.2, 0.3), np.array([0.01, 0.02, -0.05]))
    patch = np.array([[0.1, 0.05, 0.0], [-0.1, 0.05, 0.0], [-0.1, -0.05, 0.0], [0.12, -0.05, 0.001]])
    own = [
        rbd.SurfaceContact("left", "left_foot", corners=patch, placement=X_FP, friction=0.1, on=0.5),
        rbd.PointContact("toe", "right_foot", offset=(0.1, 0.0, -0.06)),
    ]
    walker = rbd.load_robot(WALKER, feet=own)
    left, toe = walker.feet(0.6, on={"left": 0.2})
    assert (left.name, left.frame, left.friction, left.on.point[2]) == ("left", "left_foot", 0.6, 0.2)
    assert np.abs(left.corners - own[0].corners).max() < 1e-15 and left.placement.isApprox(X_FP, 1e-15)
    assert (toe.name, toe.frame) == ("toe", "right_foot") and np.abs(toe.offset - own[1].offset).max() < 1e-15
    with pytest.raises(ModelError, match="stands on points"):
        walker.soles()
    with pytest.raises(UnknownName, match="on names what is no foot, 'right'"):
        walker.feet(on={"right": 0.1})


def test_balls_give_their_lowest_points(tmp_path: Path) -> None:
    """Of the walker on balls of 0.03 m: below the balls' centres."""
    box, ball = (f"<{shape}/></geometry></collision>" for shape in ('box size="0.16 0.08 0.03"', 'sphere radius="0.03"'))
    own = tmp_path / "on_balls.urdf"
    own.write_text(WALKER.read_text().replace(box, ball))
    for foot in rbd.load_robot(own, feet=FEET).feet():
        assert isinstance(foot, rbd.PointContact)
        assert np.abs(foot.offset - [0.02, 0.0, -0.075]).max() < 1e-12


def test_they_replace_those_of_the_catalogue(talos: rbd.Robot) -> None:
    """Talos on a smaller left sole alone: `standing`, `feet` and `find_pose` know no other."""
    small = rbd.SurfaceContact("heel", "left_sole_link", half_lengths=(0.03, 0.03))
    own = rbd.load_robot("talos", feet=[small])
    assert [foot.name for foot in own.feet()] == ["heel"] and [foot.name for foot in talos.feet()] == [
        "left_sole",
        "right_sole",
    ]
    assert np.abs(own.feet()[0].rows(own.standing()).patch.gaps).max() < 1e-12
    found = rbd.find_pose(own, {"heel": (0.0, 0.0, 0.0)}, com=(0.0, 0.0))
    held = rbd.hold(found.state, own.feet())
    assert held.residuals.stationarity < 1e-9


def test_a_copy_has_the_same_feet() -> None:
    """Also in another process: they travel with the robot."""
    walker = rbd.load_robot(WALKER, feet=FEET)
    again = pickle.loads(pickle.dumps(walker))
    assert again.source.feet == walker.source.feet and len(again.feet()) == 2
    assert np.array_equal(again.standing().q, walker.standing().q)


@pytest.mark.parametrize(
    ("feet", "kind", "says"),
    [
        ("left_foot", InputError, "expected a list of frames' names"),
        ([], InputError, "expected a list of frames' names"),
        ({"left": "left_foot"}, InputError, "expected a list of frames' names"),
        (3, InputError, "expected a list of frames' names"),
        (rbd.PointContact("p", "left_foot"), InputError, "expected a list of frames' names"),
        ([3], InputError, "feet has 3; expected a frame's name or a contact"),
        (["left_fot"], FrameNotFound, "nearest: 'left_foot'"),
        ([rbd.PointContact("p", "left_fot")], FrameNotFound, "nearest: 'left_foot'"),
        (["left_foot", "left_foot"], DuplicateName, "two feet are called 'left_foot'"),
        ([rbd.LineContact("edge", "left_foot", half_length=0.1)], InputError, "foot 'edge' is an edge"),
        (["torso"], ModelError, "no sole for frame 'torso' of walker: its file gives no collision shape"),
    ],
)
def test_what_is_no_foot_is_refused(feet: object, kind: type, says: str) -> None:
    """With what was expected, and the nearest names."""
    with pytest.raises(kind, match=says):
        rbd.load_robot(WALKER, feet=feet)  # type: ignore[arg-type]


def test_an_edge_is_told_to_be_one(tmp_path: Path) -> None:
    """A skate's blade of 0.8 mm: no sole and no point."""
    own = tmp_path / "skate.urdf"
    own.write_text(
        """<robot name="skate"><link name="body"><inertial><mass value="1"/>
        <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/></inertial>
        <collision><geometry><box size="0.3 0.0008 0.05"/></geometry></collision></link></robot>"""
    )
    with pytest.raises(ModelError, match="'body' of skate stands on an edge"):
        rbd.load_robot(own, feet=["body"])


def test_the_command_line_stands_on_them(tmp_path: Path) -> None:
    """`rbd stand FILE --feet A,B`: half of the weight on each; `rbd simulate` holds it there; without, they are asked for."""
    code, out, _ = run("stand", str(WALKER), "--feet", "left_foot,right_foot", "--json", str(tmp_path / "out.json"))
    assert code == 0 and "left_foot" in out
    contacts = json.loads((tmp_path / "out.json").read_text())["contacts"]
    assert list(contacts) == FEET
    assert [contacts[name]["normal"] for name in FEET] == pytest.approx([98.1, 98.1], rel=1e-6)
    code, out, _ = run("simulate", str(WALKER), "--feet", "left_foot, right_foot", "--duration", "0.01")
    assert code == 0 and "on left_foot, right_foot, holding its posture" in out
    for feet, says in (("left_foot,", "--feet is 'left_foot,'; expected names"), ("left_fot", "nearest: 'left_foot'")):
        code, _, told = run("stand", str(WALKER), "--feet", feet)
        assert code == 2 and says in told
    code, _, told = run("stand", str(WALKER))
    assert code == 2 and "--feet A,B" in told
