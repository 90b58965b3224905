"""Springs and dampers between frames and the ground: closed forms, signs, energies, and what is refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.errors import DuplicateName, ForceElementWarning, FrameNotFound, InputError
from rbd.model.external import generalised

G = 9.81


def box(x=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0), v=None) -> rbd.State:
    """A box of 10 kg with its centre of mass at x, turned by a rotation vector."""
    q = pin.SE3ToXYZQUAT(pin.SE3(pin.exp3(np.array(turn)), np.array(x)))
    return rbd.State(rbd.testing.box(mass=10.0), q, v)


def test_a_box_hangs_on_four_springs():
    """At rest k (L - L_0) of four vertical springs is its weight; `hold` needs no contact, and certifies it to 1e-9."""
    k, rest = 500.0, 0.4
    corners = [(x, y, 0.1) for x in (-0.2, 0.2) for y in (-0.1, 0.1)]
    springs = [rbd.Spring("box", to=(x, y, 2.0), offset=(x, y, z), stiffness=k, rest=rest) for x, y, z in corners]
    state = box((0.0, 0.0, 2.0 - 0.1 - rest - 10.0 * G / (4 * k)))
    held = rbd.hold(state, [], external=springs)
    assert held.residuals.worst < 1e-9 and held.status == "solved"
    assert np.abs(rbd.solve(state, [], external=springs).a).max() < 1e-12
    for spring in springs:
        assert spring.force(state) == pytest.approx([-10.0 * G / 4], rel=1e-12)
        assert spring.length(state) == pytest.approx(rest + 10.0 * G / (4 * k), rel=1e-12)
        assert spring.energy(state) == pytest.approx(0.5 * (10.0 * G / 4) ** 2 / k, rel=1e-12)
    with pytest.raises(rbd.CannotHold):
        rbd.hold(state, [], external=springs[:3])


def test_a_spring_pulls_along_its_line():
    """F = preload - k (L - L_0): the box is pulled to the point, by Pythagoras' length."""
    state = box((3.0, 0.0, -4.0))
    spring = rbd.Spring("box", to=(0.0, 0.0, 0.0), stiffness=20.0, rest=2.0, preload=5.0)
    tau, wrench = generalised(state, spring)
    F = 5.0 - 20.0 * 3.0
    assert tau[:3] == pytest.approx(np.array([0.6, 0.0, -0.8]) * F, rel=1e-12)
    assert wrench[:3] == pytest.approx(tau[:3], rel=1e-12) and np.abs(wrench[3:]).max() < 1e-12
    assert spring.energy(state) == pytest.approx(0.5 * 20.0 * 9.0 - 5.0 * 3.0, rel=1e-12) and spring.dissipation(state) == 0.0


def test_a_damper_takes_the_power_that_it_dissipates():
    """F = -d L', and the power of its force is -d L'^2."""
    state = box((3.0, 0.0, -4.0), v=np.array([0.5, 0.7, 0.0, 0.3, 0.1, 0.2]))
    damper = rbd.Damper("box", to=(0.0, 0.0, 0.0), damping=8.0)
    tau, _ = generalised(state, damper)
    assert damper.force(state) == pytest.approx([-8.0 * 0.3], rel=1e-12)
    assert tau @ state.v == pytest.approx(-8.0 * 0.09, rel=1e-12) and damper.dissipation(state) == pytest.approx(8.0 * 0.09)
    assert damper.energy(state) == 0.0


def test_springs_inside_the_robot_move_no_centre_of_mass(talos: rbd.Robot):
    """Between two links there is no outside wrench; to the ground there is, and the certificate knows it."""
    state, soles = talos.standing(), talos.soles()
    hands = "arm_left_7_link", "arm_right_7_link"
    inner = rbd.Spring(hands[0], to=hands[1], stiffness=30.0, rest=0.3)
    outer = rbd.Spring(hands[0], to=(0.5, 0.5, 1.2), stiffness=100.0, rest=0.1)
    assert not generalised(state, inner)[1].any()
    expected = -outer.force(state)[0] * np.array([0.5, 0.5, 1.2] - state.frame(hands[0]).X_WF.translation)
    assert generalised(state, outer)[1][:3] == pytest.approx(expected / outer.length(state), rel=1e-12)
    J_com = pin.jacobianCenterOfMass(talos.model, talos.model.createData(), state.q)
    free, pulled = (rbd.dynamics.free_acceleration(state, np.zeros(talos.nu), e) for e in (None, inner))
    assert np.abs(J_com @ (pulled - free)).max() < 1e-10 * np.abs(pulled).max()
    for external in ([inner], [outer], [inner, outer]):
        held = rbd.hold(state, soles, external=external)
        solution = rbd.solve(state, held.tau, soles, external=external)
        for residuals in (held.residuals, solution.residuals):
            assert residuals.worst < 1e-9 and residuals.centroidal is not None and residuals.centroidal.scaled < 1e-9
        assert np.abs(solution.a).max() < 1e-7
        weight = sum(force[2] for force in held.forces.values()) + generalised(state, external)[1][2]
        assert weight == pytest.approx(talos.mass * G, rel=1e-9)


def test_a_torsional_spring_is_that_of_the_hinge():
    """About a joint's axis its torque is k times the joint's angle, whatever else turns, and in a pendulum's frequency."""
    arm = rbd.planar.to_robot(rbd.planar.Chain(2, lengths=[1.0, 1.0]), masses=[1.0, 1.0])
    links = [name for name in arm.links() if name.startswith("link")]
    state = arm.at([0.4, -0.9], [0.3, 2.0])
    for element, by_hand in (
        (rbd.Spring(links[1], to=links[0], axis=(0, -1, 0), stiffness=7.0, rest=0.2, preload=0.5), 0.5 + 7.0 * 1.1),
        (rbd.Damper(links[1], to=links[0], axis=(0, -2, 0), damping=0.3), -0.6),
    ):
        tau, wrench = generalised(state, element)
        assert tau == pytest.approx([0.0, by_hand], abs=1e-12) and not wrench.any()
    from_ground = rbd.Spring(links[1], to=(0, 0, 0), axis=(0, -1, 0), stiffness=7.0)  # the angle from the ground is the sum
    assert generalised(state, from_ground)[0] == pytest.approx([3.5, 3.5], rel=1e-12)


def test_a_free_body_turns_about_the_twist_of_its_rotation():
    """Of a rotation about the axis alone: the moment -k angle; tilted besides, minus the gradient of the energy."""
    spring = rbd.Spring("box", to=(0, 0, 0), axis=(0, 0, 1), stiffness=30.0, rest=0.5)
    state = box(turn=(0.0, 0.0, 1.3))
    assert generalised(state, spring)[1] == pytest.approx([0, 0, 0, 0, 0, -24.0], abs=1e-12)
    assert spring.length(state) == pytest.approx(1.3, rel=1e-12)
    with pytest.raises(InputError, match="tilted by 175 degrees"):
        spring.force(box(turn=(math.radians(175.0), 0.0, 0.0)))


@pytest.mark.parametrize("rest", [0.0, 2.0, -7.0, 3 * math.pi])
def test_an_angle_between_frames_is_taken_near_the_rest(rest: float):
    """Within 170 degrees of it, over full turns too; farther it is refused by name."""
    spring = rbd.Spring("box", to=(0, 0, 0), axis=(0, 0, 1), stiffness=10.0, rest=rest)
    assert spring.force(box(turn=(0.0, 0.0, rest + 1.0))) == pytest.approx([-10.0], rel=1e-11)
    assert spring.force(box(turn=(0.0, 0.0, rest - 2.9))) == pytest.approx([29.0], rel=1e-11)
    with pytest.raises(InputError, match=r"'torsion spring from box .* is 172 degrees from its rest; at most 170.*JointSpring"):
        spring.force(box(turn=(0.0, 0.0, rest + 3.0)))


def test_zero_length():
    """Refused by name, as the line has no direction; a spring of rest length zero is smooth there."""
    there, at = box((0.0, 0.0, 2.0)), (0.0, 0.0, 2.0)
    for element in (
        rbd.Spring("box", to=at, stiffness=1.0, rest=0.5),
        rbd.Spring("box", to=at, stiffness=1.0, rest=0, preload=1),
        rbd.Damper("box", to=at, damping=1.0),
    ):
        with pytest.raises(InputError, match=re.escape(element.name) + "' has zero length"):
            rbd.solve(there, [], external=[element])
    soft = rbd.Spring("box", to=at, stiffness=40.0, rest=0)
    assert not generalised(there, soft)[0].any() and soft.energy(there) == 0.0
    assert np.array_equal(soft.derivatives(there)[0][:3, :3], -40.0 * np.eye(3))
    away = box((0.1, 0.0, 2.0))
    assert generalised(away, soft)[0][:3] == pytest.approx([-4.0, 0.0, 0.0]) and soft.length(away) == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: rbd.Spring("box", to=(0, 0, 2), stiffness=10.0), "no rest length; give rest="),
        (lambda: rbd.Spring("box", to=(0, 0, 2), stiffness=10.0, rest=-1.0), "rest of .* is -1; expected a length from 0"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), stiffness=math.nan, rest=1.0), "stiffness of .* is nan"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), stiffness="10", rest=1.0), "stiffness of .* is '10'"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), stiffness=1.0, rest=math.inf), "rest of .* is inf"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), stiffness=1.0, rest=1.0, preload=math.nan), "preload of .* is nan"),
        (lambda: rbd.Spring("box", to=(0, 0), stiffness=1.0, rest=1.0), r"to of a spring at 'box' has shape \(2,\)"),
        (lambda: rbd.Spring("box", to=2.0, stiffness=1.0, rest=1.0), "ends at 2.0; expected a frame's name, or a point"),
        (lambda: rbd.Spring("box", to=None, stiffness=1.0, rest=1.0), "ends at None; expected a frame's name"),
        (lambda: rbd.Spring(3, to=(0, 0, 2), stiffness=1.0, rest=1.0), "is 3; expected the name of a frame"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), to_offset=(1, 0, 0), stiffness=1.0, rest=1.0), "give the point of the ground"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), offset=(1, 0), stiffness=1.0, rest=1.0), "offset of a spring at 'box'"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), axis=(0, 0, 0), stiffness=1.0), "axis of .* has length 0"),
        (lambda: rbd.Spring("box", to=(0, 0, 2), stiffness=1.0, rest=1.0, name=3), "name of a spring at 'box' is 3"),
        (lambda: rbd.Damper("box", to=(0, 0, 2), damping=-1.0), "damping of .* is -1.0; expected a finite number from 0"),
        (lambda: rbd.Damper("box", to=(0, 0, 2), damping=math.inf), "damping of .* is inf"),
    ],
)
def test_bad_numbers_are_refused(make, says: str):
    """When the element is made, with its name, what came and what was expected."""
    with pytest.raises(InputError, match=says):
        make()


def test_a_negative_stiffness_is_warned_of():
    """It is taken, and pushes away."""
    with pytest.warns(ForceElementWarning, match="stiffness of 'spring from box to the ground .* is -5: .* away from rest"):
        spring = rbd.Spring("box", to=(0, 0, 2), stiffness=-5.0, rest=1.0)
    assert spring.force(box()) == pytest.approx([5.0])


def test_unknown_frames_and_two_of_one_name():
    """With the nearest names; elements of one name could not be told apart."""
    with pytest.raises(FrameNotFound, match="no frame 'bxo'.*nearest: 'box'"):
        rbd.solve(box(), [], external=[rbd.Spring("bxo", to=(0, 0, 2), stiffness=1.0, rest=1.0)])
    twins = [rbd.Spring("box", to=(0, 0, 2), stiffness=k, rest=1.0) for k in (1.0, 2.0)]
    with pytest.raises(DuplicateName, match="two force elements are named 'spring from box to the ground at"):
        rbd.solve(box(), [], external=twins)
    beside = [rbd.Spring("box", to=(0, 0, 2), stiffness=1.0, rest=1.0, name=name) for name in ("left", "right")]
    assert rbd.solve(box(), [], external=beside).a[2] == pytest.approx(-G + 0.2)


def test_pictures_have_ends_axes_and_forces():
    """What drawings need: both ends in W, the axis, the force on the line or about the axis."""
    state = box((0.0, 0.0, 1.0), turn=(0.0, 0.0, 0.3))
    line = rbd.Spring("box", to=(0, 0, 3), offset=(0, 0, 0.5), stiffness=10.0, rest=1.0).picture(state)
    assert line.kind == "spring" and line.points.tolist() == [[0, 0, 3], [0, 0, 1.5]]
    assert line.axis is None and line.value == pytest.approx(-5.0)
    assert rbd.Spring("box", to=(0, 0, 3), stiffness=10.0, rest=0).picture(state).value == pytest.approx(-20.0)
    turn = rbd.Spring("box", to=(0, 0, 3), axis=(0, 0, 2), stiffness=10.0).picture(state)
    assert turn.kind == "torsion spring" and turn.axis.tolist() == [0, 0, 1] and turn.value == pytest.approx(-3.0)
