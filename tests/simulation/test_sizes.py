"""Bodies of a tenth of a millimetre and of ten metres strike when they should: what touches is told by their size."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
import pytest
from closed_forms import RockingBlock
from courses import G
from flat_bodies import flat_body, flat_state, floor_point

import rbd
from rbd.model.checked_model import CheckedModel

SIZES = pytest.mark.parametrize("size", [1e-4, 2e-3, 0.05, 1.0, 10.0])


def _block(size, *, width=0.4, gravity=G):
    """(robot, its Housner block, its two edges above the floor): a block of this height [m], of water."""
    mass = 1e3 * width * size**3
    block = RockingBlock(mass, 0.5 * width * size, 0.5 * size, mass * size**2 * (width**2 + 1.0) / 12.0)
    at = ((-block.width, -block.height), (block.width, -block.height))
    edges = [floor_point(f"edge{i}", p, friction=1.0) for i, p in enumerate(at)]
    return flat_body(mass, block.inertia, gravity=gravity), block, edges


def _strikes(found):
    return [event for event in found.events if event.kind == "touches"]


@SIZES
@pytest.mark.parametrize("extrapolate", [False, True])
def test_a_block_that_falls_strikes_after_the_root_of_twice_its_height_over_g(size, extrapolate):
    """From a height of a tenth of its size, flat: both edges at once, at sqrt(2 g h)."""
    robot, block, edges = _block(size)
    height = 0.1 * size
    t, speed = math.sqrt(2.0 * height / G), math.sqrt(2.0 * height * G)
    start = flat_state(robot, (0.0, block.height + height, 0.0))
    by = rbd.TimeStepping(extrapolate=extrapolate)
    found = rbd.simulate(start, edges, duration=1.5 * t, step=0.07 * t, integrator=by, progress=False)
    assert [event.name for event in _strikes(found)] == ["edge0", "edge1"]
    for event in _strikes(found):
        assert abs(event.t - t) < 1e-9 * t
        assert abs(event.speed - speed) < 1e-9 * speed
    assert abs(found.q[-1, 1] - block.height) < 1e-9 * size
    weight = sum(found.forces[edge.name][-1, 2] for edge in edges)
    assert abs(weight - block.mass * G) < 1e-6 * block.mass * G


@SIZES
@pytest.mark.parametrize("gap", [1e-4, 3e-6])
def test_a_block_that_starts_a_hair_above_the_floor_falls_first(size, gap):
    """Gaps of a millionth of its size and more are seen: it strikes when it has fallen through them."""
    robot, block, edges = _block(size)
    gap = gap * min(size, 1.0)
    t = math.sqrt(2.0 * gap / G)
    start = flat_state(robot, (0.0, block.height + gap, 0.0))
    found = rbd.simulate(start, edges, duration=2.0 * t, step=0.15 * t, restitution=0.0, progress=False)
    assert len(_strikes(found)) == 2
    assert all(abs(event.t - t) < 1e-5 * t for event in _strikes(found))


@pytest.mark.parametrize("size", [1e-4, 2e-3, 0.1])
def test_a_block_that_is_lowered_slowly_strikes_in_time(size):
    """At 5 micrometres a second, without gravity: 1e-7 m are 20 ms; it strikes when its gap is zero."""
    robot, block, edges = _block(size, gravity=0.0)
    gap, speed = 1e-6, 5e-6
    start = flat_state(robot, (0.0, block.height + gap, 0.0), (0.0, -speed, 0.0))
    found = rbd.simulate(start, edges, duration=0.3, step=0.013, progress=False)
    assert len(_strikes(found)) == 2
    assert all(abs(event.t - gap / speed) < 1e-6 for event in _strikes(found))


@SIZES
@pytest.mark.parametrize("tilt", [0.2, 1e-3])
def test_a_block_rocks_as_housner_says_at_any_size(size, tilt):
    """Times of its first two impacts, in units of the root of its size: those of Housner's equation."""
    robot, block, edges = _block(size)
    unit = math.sqrt(size)
    until = (1.0 if tilt > 0.1 else 0.06) * unit
    course = block.course(tilt, until)
    start = block.place(np.array([tilt, 0.0]), 1.0)
    found = rbd.simulate(flat_state(robot, start[:3], start[3:]), edges, duration=until, step=0.01 * until, progress=False)
    true = [t for t, word in course.events if word == "impact"][:2]
    assert len(_strikes(found)) >= 2
    for event, t in zip(_strikes(found), true, strict=False):
        assert abs(event.t - t) < 1e-4 * unit


def test_the_same_block_in_another_unit_moves_the_same_way():
    """A rocking block a ten thousandth as large: the same motion, scaled, to rounding."""
    ends = []
    for size in (1.0, 1e-4):
        robot, block, edges = _block(size)
        start, unit = block.place(np.array([0.05, 0.0]), 1.0), math.sqrt(size)
        state, step = flat_state(robot, start[:3], start[3:]), 6e-3 * unit
        found = rbd.simulate(state, edges, duration=100 * step, step=step, progress=False)
        ends.append((found.q / [size, size, 1.0], found.v * unit / [size, size, 1.0]))
    assert np.abs(ends[0][0] - ends[1][0]).max() < 1e-7
    assert np.abs(ends[0][1] - ends[1][1]).max() < 1e-5


@pytest.mark.parametrize("rotor", [0.5, 2e-6])
def test_a_pointer_without_mass_strikes_with_the_inertia_of_its_motor(rotor):
    """Turning at 2 rad/s on a rotor, its tip at 1 m: it strikes when it has turned its angle, with I w / 1 m, and stops."""
    model = pin.Model()
    model.addJoint(0, pin.JointModelRY(), pin.SE3.Identity(), "hinge")
    other = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "elsewhere")
    model.appendBodyToJoint(other, pin.Inertia(1.0, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
    model.armature = np.array([rotor, 0.0])
    model.addBodyFrame("pointer", 1, pin.SE3.Identity(), 0)
    robot = CheckedModel(model, name="pointer")
    tip = floor_point("tip", (1.0, 0.0), friction=0.0, frame="pointer")
    start = rbd.State(robot, np.array([-0.2, 0.0]), np.array([2.0, 0.0]))  # sin 0.2 m above
    found = rbd.simulate(start, [tip], duration=0.15, step=0.01, progress=False)
    (struck,) = _strikes(found)
    assert abs(struck.t - 0.1) < 1e-11
    assert abs(struck.speed - 2.0) < 1e-9
    assert abs(struck.impulse - 2.0 * rotor) < 1e-9 * rotor
    assert abs(found.q[-1, 0]) < 1e-11
    assert found.v[-1, 0] == 0.0


@pytest.mark.parametrize("contact", ["sole", "shapes"])
@pytest.mark.parametrize("step", [1e-3, 7e-3])
def test_a_block_of_two_millimetres_strikes_on_time_from_one_millimetre(contact, step, tmp_path):
    """At sqrt(2 h / g) with sqrt(2 g h), and it lies on the floor: by a sole, and by its collision shape."""
    size, height = 2e-3, 1e-3
    moment = 8e-6 * size**2 / 6.0
    (tmp_path / "block.urdf").write_text(
        f'<robot name="block"><link name="block"><inertial><mass value="8e-6"/><inertia ixx="{moment}" iyy="{moment}" '
        f'izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial><collision><geometry><box size="{size} {size} {size}"/>'
        "</geometry></collision></link></robot>"
    )
    block = rbd.load_robot(tmp_path / "block.urdf")
    below, half = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.5 * size])), (0.5 * size, 0.5 * size)
    given = {
        "sole": rbd.SurfaceContact("sole", "block", half_lengths=half, placement=below, friction=0.5, on=0.0),
        "shapes": rbd.CollisionContacts("shapes", block, friction=0.5),
    }[contact]
    found = rbd.simulate(rbd.State(block, [0, 0, height + 0.5 * size, 0, 0, 0, 1]), [given], duration=0.05, step=step)
    assert len(_strikes(found)) == 4
    for event in _strikes(found):
        assert abs(event.t - math.sqrt(2.0 * height / G)) < 1e-12
        assert abs(event.speed - math.sqrt(2.0 * height * G)) < 1e-9
    assert abs(found.q[-1, 2] - 0.5 * size) < 1e-9 * size


def test_the_gap_of_touch_is_a_setting():
    """A block at rest 50 um above the floor falls; with a tolerance of 0.1 mm it touches from the start."""
    robot, block, edges = _block(0.1)
    start, ends = flat_state(robot, (0.0, block.height + 5e-5, 0.0)), []
    for tolerance in (None, 1e-4):
        by = rbd.TimeStepping(touch_tolerance=tolerance)
        found = rbd.simulate(start, edges, duration=0.02, step=1.3e-3, integrator=by)
        ends.append((found.v[1, 1], [event.t for event in _strikes(found)], abs(found.q[-1, 1] - block.height)))
    assert ends[0][0] == pytest.approx(-1.3e-3 * G)
    assert np.abs(np.array(ends[0][1]) - math.sqrt(1e-4 / G)).max() < 1e-9
    assert ends[0][2] < 1e-10
    assert (ends[1][0], ends[1][1]) == (0.0, [])
    assert ends[1][2] <= 1e-4
    for wrong in (0.0, -1e-6, math.nan, "small"):
        with pytest.raises(rbd.InputError, match="touch_tolerance"):
            rbd.TimeStepping(touch_tolerance=wrong)
