"""Poses that no robot can take are named: joints beyond their limits, feet that joint angles leave off the ground."""

from __future__ import annotations

import warnings

import numpy as np
import pytest

import rbd
from rbd.errors import DistantContactWarning, JointLimitWarning

TALOS = rbd.load_robot("talos")
SOLES = TALOS.soles()
STANDING = TALOS.standing()
ELBOW = "arm_left_4_joint"
LOWER = TALOS.joints[ELBOW].lower


def told(state: rbd.State, call: str) -> list[str]:
    """The warnings of joints of one of the three verbs."""
    calls = {
        "hold": lambda: rbd.hold(state, SOLES),
        "solve": lambda: rbd.solve(state, np.zeros(TALOS.nu), SOLES),
        "solve held": lambda: rbd.solve(state, np.zeros(TALOS.nu), TALOS.soles(friction=None)),
        "solve generally": lambda: rbd.solve(state, np.zeros(TALOS.nu), SOLES, solver=rbd.ProxQP()),
        "gauss_problem": lambda: rbd.gauss_problem(state, np.zeros(TALOS.nu), SOLES),
        "inverse_dynamics": lambda: rbd.inverse_dynamics(state, np.zeros(TALOS.nv), SOLES),
        "support_region": lambda: rbd.statics.support_region(state, SOLES, friction="inscribed"),
    }
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        calls[call]()
    found = [w for w in seen if w.category is JointLimitWarning]
    assert all(w.filename == __file__ for w in found)  # the user's line
    return [str(w.message) for w in found]


@pytest.mark.parametrize(
    "call", ["hold", "solve", "solve held", "solve generally", "gauss_problem", "inverse_dynamics", "support_region"]
)
def test_a_joint_beyond_its_limits_is_named_once_a_state(call: str) -> None:
    """By 0.1 rad: with its value and both limits; not a second time; nothing at the limit, nor a rounding beyond it."""
    state = STANDING.with_joints({ELBOW: LOWER - 0.1})
    (says,) = told(state, call)
    assert repr(ELBOW) in says and f"{LOWER - 0.1:.4g} rad" in says and f"{LOWER:.4g} to" in says and "degrees" not in says
    assert not told(state, call)
    for at in (LOWER, LOWER - 1e-9):
        assert not told(STANDING.with_joints({ELBOW: at}), call)


def test_an_angle_in_degrees_is_recognised() -> None:
    """-90 at an elbow of -2.2 to 0 rad looks like degrees; 0.1 rad beyond does not, nor 300, which is beyond in degrees too."""
    assert f"looks like degrees, {np.radians(-90):.4g} rad" in told(STANDING.with_joints({ELBOW: -90.0}), "hold")[0]
    assert "degrees" not in told(STANDING.with_joints({ELBOW: 300.0}), "hold")[0]


def test_a_joint_with_a_limit_as_constraint_may_be_a_milliradian_beyond() -> None:
    """A motion into a rigid stop ends a little beyond it: that is the constraint's matter; a tenth of a radian is not."""
    stop = rbd.JointLimit("stop", ELBOW)
    for beyond, warned in ((5e-4, False), (0.1, True)):
        with warnings.catch_warnings(record=True) as seen:
            warnings.simplefilter("always")
            rbd.solve(STANDING.with_joints({ELBOW: LOWER - beyond}), np.zeros(TALOS.nu), [*SOLES, stop])
        assert any(w.category is JointLimitWarning for w in seen) == warned
    wider = rbd.JointLimit("stop", ELBOW, lower=LOWER - 0.5)
    rbd.solve(STANDING.with_joints({ELBOW: LOWER - 0.1}), np.zeros(TALOS.nu), [*SOLES, wider])  # warnings are errors here


def test_continuous_joints_have_no_limits() -> None:
    """A wheel turned by a hundred radians."""
    builder = rbd.RobotBuilder("top", root="fixed")
    builder.body("disk", rbd.robots.Cylinder(0.1, 0.02, mass=1.0))
    builder.joint("spin", "ground", "disk", "continuous")
    top = builder.robot()
    rbd.solve(top.at().with_joints({"spin": 100.0}), [], [])


def test_many_states_say_at_which_a_joint_is_beyond() -> None:
    """A column of `warned`, and one warning; of solve_many, hold_many and inverse_dynamics_many."""
    q = np.array([STANDING.q, STANDING.with_joints({ELBOW: LOWER - 0.1}).q])
    v, tau, a = np.zeros(TALOS.nv), np.zeros(TALOS.nu), np.zeros(TALOS.nv)
    for call in (
        lambda: rbd.solve_many(TALOS, q, None, tau, SOLES),
        lambda: rbd.statics.hold_many(TALOS, q, SOLES),
        lambda: rbd.control.inverse_dynamics_many(TALOS, q, v, a, SOLES),
    ):
        with pytest.warns(JointLimitWarning, match="at 1 of 2 states"):
            found = call()
        assert found.warned["a joint is beyond its limits"].tolist() == [False, True]


def test_a_simulation_tells_at_its_start_alone() -> None:
    """A pendulum that starts beyond its limit, and swings on."""
    builder = rbd.RobotBuilder("pendulum", root="fixed")
    builder.body("bob", rbd.robots.Sphere(0.1, mass=1.0, at=(0, 0, -1)))
    builder.joint("pivot", "ground", "bob", axis=(0, 1, 0), limits=(-0.5, 0.5))
    pendulum = builder.robot()
    with pytest.warns(JointLimitWarning, match="'pivot' is at 0.7 rad") as seen:
        rbd.simulate(pendulum.at([0.7]), duration=0.1, step=0.01)
    assert len(seen) == 1 and seen[0].filename == __file__
    rbd.simulate(pendulum.at([0.49], [3.0]), duration=0.1, step=0.01)  # what it reaches is the trajectory's


def test_feet_that_cannot_all_be_on_the_ground_are_named_with_their_gaps() -> None:
    """One knee bent by 0.4 rad more: the gaps of the soles' farthest corners, to place it and to stand in the posture."""
    bent = STANDING.with_joints({"leg_left_4_joint": STANDING.q[TALOS.joints["leg_left_4_joint"].q][0] + 0.4})
    with pytest.warns(DistantContactWarning, match="do not allow all these contacts on the ground") as seen:
        placed = rbd.robots.place_on_ground(bent, SOLES)
    assert seen[0].filename == __file__
    for sole in SOLES:
        gap = max(abs(sole.points(placed).gaps), default=0.0)
        assert gap > 0.01 and f"{sole.name!r} up to {1e3 * gap:.3g} mm above it" in str(seen[0].message)
    rbd.robots.place_on_ground(bent, SOLES[:1])  # that alone lies flat


def test_a_posture_that_leaves_a_foot_off_the_ground_is_stood_in_with_a_warning() -> None:
    """`standing` of a posture of one's own, as `place_on_ground`."""
    builder = rbd.RobotBuilder("stool")
    builder.body("seat", rbd.robots.Box((0.4, 0.4, 0.1), mass=5.0))
    places = {f"leg_{i}": (x, y) for i, (x, y) in enumerate([(0.2, 0.2), (0.2, -0.2), (-0.2, 0.2), (-0.2, -0.2)])}
    for name, (x, y) in places.items():
        builder.body(name, rbd.robots.Rod((0, 0, 0), (0, 0, -0.5), mass=0.2))
        builder.joint(f"{name}_slide", "seat", name, "prismatic", at=(x, y, 0), motor=True)
        builder.frame(f"{name}_tip", name, at=(0, 0, -0.5))
    builder.posture("uneven", {"leg_0_slide": 0.02})
    builder.posture("even", {"leg_0_slide": 0.0})
    builder.posture("rounded", {"leg_0_slide": 3e-5})
    stool = builder.robot(feet=[rbd.PointContact(name, f"{name}_tip", friction=0.5) for name in places])
    with pytest.warns(DistantContactWarning, match="'leg_0' up to") as seen:
        stool.standing("uneven")
    assert seen[0].filename == __file__
    for posture in ("even", "rounded"):  # digits of a file are made good by joints
        state = stool.standing(posture)
        assert max(abs(foot.points(state).gaps[0]) for foot in stool.feet()) < 1e-12
        assert np.abs(state.q[7:]).max() < 1e-4
