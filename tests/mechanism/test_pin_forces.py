"""Forces in the pins of mechanisms, against Newton's law of each bar."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.errors import InputError

GRAVITY = np.array([0.0, 0.0, -9.81])


def solved(speed: float) -> tuple[rbd.State, rbd.Solution, rbd.ExternalForce]:
    """A four-bar that moves, with a torque of 7 N m and a push of its coupler, 1 m from its pin."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.5, 3.0)
    v = rbd.mechanism.velocity_partition(bars.at("assembled"), known={"crank_joint": speed}).v
    state, push = bars.at("assembled").with_velocity(v), rbd.ExternalForce("coupler", (3.0, 0.0, 1.0), offset=(1.0, 0.0, 0.0))
    return state, rbd.solve(state, [7.0], external=[push]), push


@pytest.mark.parametrize("speed", [0.0, 2.0])
def test_the_forces_on_each_bar_accelerate_its_centre_and_turn_it(speed: float) -> None:
    """Newton's and Euler's law of three uniform bars: pins, closing pin, push and weight; moments across y about the centre."""
    state, solution, push = solved(speed)
    pins = rbd.mechanism.pin_forces(solution)
    tip = pins["coupler_pin"]  # on the rocker
    at = {name: state.frame(name).X_WF.translation for name in ("crank", "coupler", "rocker", "coupler_tip", "rocker_tip")}
    on = {
        "crank": [(pins["crank_joint"], at["crank"]), (-pins["coupler_joint"], at["coupler"])],
        "coupler": [
            (pins["coupler_joint"], at["coupler"]),
            (-tip, at["coupler_tip"]),
            (np.r_[push.force, np.zeros(3)], state.frame("coupler", (1.0, 0.0, 0.0)).X_WF.translation),
        ],
        "rocker": [(pins["rocker_joint"], at["rocker"]), (tip, at["rocker_tip"])],
    }
    angular = rbd.mechanism.link_rates(state, solution.a)
    for (link, wrenches), length in zip(on.items(), (1.0, 3.0, 2.5), strict=True):
        mass, middle = length, state.frame(link, (length / 2.0, 0.0, 0.0))  # 1 kg/m
        a = middle.J[:3] @ solution.a + middle.bias[:3]
        force = sum(w[:3] for w, _ in wrenches) + mass * GRAVITY
        assert np.abs(force - mass * a).max() < 1e-10
        moment = sum(w[4] + np.cross(p - middle.X_WF.translation, w[:3])[1] for w, p in wrenches)
        assert moment == pytest.approx(-mass * length**2 / 12.0 * angular[link], abs=1e-10)  # angles are about -y
    assert pins["crank_joint"][4] == pytest.approx(-7.0, abs=1e-10)  # the motor's torque, about -y
    assert np.abs([pins[joint][4] for joint in ("coupler_joint", "rocker_joint")]).max() < 1e-10  # hinges without one


def test_they_are_drawn_where_they_act() -> None:
    """A layer of its own, off at first: each pin's force on the bar after it, the opposite on the bar before it."""
    state, solution, _ = solved(0.0)
    pins = rbd.mechanism.pin_forces(solution)
    with rbd.visual.Scene(state.robot, layers={"pin forces": True}) as scene:
        scene.show(state, solution)
        marks = {mark.path: mark for mark in scene.drawn if mark.layer == "pin forces"}
        for joint in state.robot.joints.values():
            arrow = marks[f"pins/{joint.name}/force"].label
            assert arrow is not None and f"|f| {np.linalg.norm(pins[joint.name][:3]):.4g}"[:8] in arrow.lines[0]
        assert "pins/coupler_joint/reaction" in marks and "pins/crank_joint/reaction" not in marks
    with rbd.visual.Scene(state.robot) as still:
        still.show(state)
        assert not [mark for mark in still.drawn if mark.layer == "pin forces"]


def test_held_still_the_ground_carries_the_weight() -> None:
    """Of `rbd.hold`: the two pins on the ground carry all three bars."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.5, 3.0)
    pins = rbd.mechanism.pin_forces(rbd.hold(bars.at("assembled"), []))
    assert pins["crank_joint"][:3] + pins["rocker_joint"][:3] == pytest.approx(-6.5 * GRAVITY, abs=1e-9)


def bar_between_pins(loop: rbd.LoopClosure) -> dict[str, np.ndarray]:
    """Pin forces of a bar of 2 kg and 1 m, level from its hinge at x = -1 m to W's origin, where a loop joins it."""
    built = rbd.RobotBuilder("bar", root="fixed")
    built.body("base")
    built.body("bar", rbd.robots.Rod((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), mass=2.0))
    built.joint("hinge", "base", "bar", "continuous", at=(-1.0, 0.0, 0.0), axis=(0.0, -1.0, 0.0))
    built.frame("tip", "bar", (1.0, 0.0, 0.0))
    bar = built.robot()
    return rbd.mechanism.pin_forces(rbd.solve(bar.at(), np.zeros(bar.nu), [loop]))


@pytest.mark.parametrize("frames", [("universe", "tip"), ("tip", "universe")])
@pytest.mark.parametrize("kind", ["point", "planar", "revolute"])
def test_a_pin_on_the_ground_pushes_the_bar_up(frames: tuple[str, str], kind: str) -> None:
    """Half of the weight at each end, up, whichever frame comes first and whatever else the pin holds."""
    pins = bar_between_pins(rbd.LoopClosure("far", *frames, kind=kind, axis=(0.0, 1.0, 0.0)))
    assert list(pins) == ["hinge", "far"]
    for end in pins.values():
        assert end == pytest.approx([0.0, 0.0, 9.81, 0.0, 0.0, 0.0], abs=1e-9)


def test_a_closing_pin_pushes_the_body_of_its_second_frame() -> None:
    """Named the other way round it is the opposite; a rod is a link, and a joint's name is refused."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.5, 3.0)
    state = bars.at("assembled")
    forces = []
    for ends in (("coupler_tip", "rocker_tip"), ("rocker_tip", "coupler_tip")):
        pin = rbd.LoopClosure("pin", *ends, kind="planar", axis=(0.0, -1.0, 0.0))
        forces.append(rbd.mechanism.pin_forces(rbd.solve(state, [0.0], [pin], loops=False))["pin"])
    assert np.abs(forces[0][:3]).max() > 1.0 and forces[1] == pytest.approx(-forces[0], abs=1e-9)
    rod = rbd.LoopClosure("rod", "universe", "coupler_tip", kind="rod")
    assert set(rbd.mechanism.pin_forces(rbd.solve(state, [0.0], [rod]))) == {*bars.joints, "coupler_pin"}
    named = rbd.LoopClosure("crank_joint", "coupler_tip", "rocker_tip", kind="planar", axis=(0.0, -1.0, 0.0))
    with pytest.raises(InputError, match="loop 'crank_joint' has the name of a joint"):
        rbd.mechanism.pin_forces(rbd.solve(state, [0.0], [named], loops=False))


def test_what_acts_on_unknown_bodies_is_refused() -> None:
    """Contacts, springs between bodies and generalised forces, by name; and what is no answer."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 2.5, 3.0)
    state = bars.at("assembled")
    spring = rbd.Spring("coupler", (0.0, 0.0, 3.0), stiffness=10.0, rest=1.0, name="spring")
    with pytest.raises(InputError, match="spring acts on four_bar"):
        rbd.mechanism.pin_forces(rbd.solve(state, [0.0], external=[spring]))
    with pytest.raises(InputError, match="generalised force"):
        rbd.mechanism.pin_forces(rbd.solve(state, [0.0], external=np.ones(3)))
    point = rbd.PointContact("point", "coupler_tip", friction=None)
    with pytest.raises(InputError, match="'point' acts"):
        rbd.mechanism.pin_forces(rbd.solve(state, [0.0], [point]))
    with pytest.raises(InputError, match="rbd.solve"):
        rbd.mechanism.pin_forces(state)
