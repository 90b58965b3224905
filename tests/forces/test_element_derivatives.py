"""Derivatives of force elements, geometric stiffness included, against differences on the manifold; energies as potentials."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.answers.analysis.state_changes import derivatives_of, element_derivatives, slope
from rbd.constraints.forces.coordinates import Pair, Place, inverse_change, inverse_left_jacobian, rotation_vector
from rbd.model.derivatives import FixedPose, state_derivatives

Array = np.ndarray
SAME = 1e-8
"""Differences of the sixth order are right to 1e-10 of the largest entry here."""
TILT = pin.exp3(np.array([0.3, -0.2, 0.5]))


def elements(frame: str, to: object) -> list:
    """One of each kind, with offsets, tilted axes, preloads and full matrices."""
    rng = np.random.default_rng(3)
    K, C = (A @ A.T for A in rng.normal(size=(2, 6, 6)))
    ends = {"offset": (0.1, 0.2, 0.3)}
    if isinstance(to, str):
        ends["to_offset"] = (0.2, 0.1, 0.0)
    return [
        rbd.Spring(frame, to, stiffness=100.0, rest=0.5, preload=3.0, **ends),
        rbd.Spring(frame, to, stiffness=100.0, rest=0, name="of no length", **ends),
        rbd.Damper(frame, to, damping=10.0, **ends),
        rbd.Spring(frame, to, stiffness=10.0, axis=(1.0, 2.0, 0.5), preload=1.0, name="turning", **ends),
        rbd.Damper(frame, to, damping=10.0, axis=(1.0, 2.0, 0.5), name="turning damper", **ends),
        rbd.Bushing(frame, to, stiffness=10.0 * K, damping=C, preload=(1, 2, 3, 4, 5, 6), offset=pin.SE3(TILT, np.ones(3) / 9)),
    ]


def turned(robot: rbd.Robot, size: float = 0.3, seed: int = 0) -> rbd.State:
    """Near the standing posture, moving."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.standing().q, rng.uniform(-size, size, robot.nv))
    return rbd.State(robot, q, rng.normal(size=robot.nv))


def cases() -> dict[str, tuple]:
    """{robot: a moving state, elements between bodies, to the ground, in joints}."""
    talos, panda = rbd.load_robot("talos"), rbd.load_robot("panda", root="fixed")
    box, rng = rbd.testing.box(), np.random.default_rng(5)
    q = pin.integrate(box.model, pin.neutral(box.model), rng.uniform(-0.4, 0.4, 6))
    ground, pose = (1.0, 2.0, 3.0), pin.SE3(TILT, np.ones(3))
    in_joints = [
        rbd.JointSpring("torso_2_joint", stiffness=10.0, preload=1.0),
        rbd.JointDamping({"torso_2_joint": 3.0, "root_joint": 2.0}),
    ]
    cart = rbd.load_robot("panda", root="planar")
    rolled = rbd.State(cart, pin.integrate(cart.model, cart.neutral(), rng.normal(size=cart.nv)), rng.normal(size=cart.nv))
    ball = joined_by_a_ball()
    swung = rbd.State(
        ball, pin.integrate(ball.model, ball.neutral(), rng.uniform(-0.5, 0.5, ball.nv)), rng.normal(size=ball.nv)
    )
    in_balls = [rbd.JointSpring("b", stiffness=4.0), rbd.JointSpring("b", stiffness=4.0, rest=(0.6, 0, 0, 0.8), name="tilted")]
    hand, torso = "arm_left_7_link", "torso_2_link"
    mount = rbd.Bushing(hand, to=pose, stiffness=(1, 2, 3, 4, 5, 6), damping=2.0, name="mount")
    return {
        "talos": (turned(talos), [*elements(hand, torso), mount, *in_joints]),
        "talos to the ground": (turned(talos, seed=1), elements(hand, ground)),
        "panda": (turned(panda), [*elements("panda_hand", "panda_link3"), *elements("panda_hand", "panda_link0")]),
        "planar root": (rolled, elements("panda_hand", ground)),
        "ball joints": (swung, [*elements("lower", "upper"), *elements("lower", "free"), *in_balls]),
        "box": (rbd.State(box, q, rng.normal(size=6)), elements("box", ground)),
    }


def joined_by_a_ball() -> rbd.Robot:
    """A floating body with two more on ball joints."""
    solid = '<inertial pos=".1 .2 .3" mass="2" diaginertia=".1 .2 .3"/>'
    lower = f'<body name="lower" pos="0 .3 -.4"><joint name="a" type="ball"/>{solid}</body>'
    upper = f'<body name="upper" pos=".2 0 -.5"><joint name="b" type="ball"/>{solid}{lower}</body>'
    world = f'<body name="free"><freejoint/>{solid}{upper}</body>'
    return rbd.load_robot(text=f"<mujoco><worldbody>{world}</worldbody></mujoco>")


@pytest.fixture(scope="module")
def given() -> dict[str, tuple]:
    return cases()


def by_differences(ask, state: rbd.State) -> tuple[Array, Array]:
    """(by q on the tangent space, by v) of a function of the state, entries first."""
    robot, unit, here = state.robot, np.eye(state.robot.nv), ask(state)

    def at(dq: Array, dv: Array) -> Array:
        return ask(rbd.State(robot, pin.integrate(robot.model, state.q, dq), state.v + dv))

    none = np.zeros(robot.nv)
    by_q = [slope(lambda h, d=d: at(h * d, none), here, 0.01, "q") for d in unit]
    by_v = [slope(lambda h, d=d: at(none, h * d), here, 0.1, "v") for d in unit]
    return np.array(by_q).T, np.array(by_v).T


@pytest.mark.parametrize("case", ["talos", "talos to the ground", "panda", "planar root", "ball joints", "box"])
def test_derivatives_are_those_of_differences(given, case: str):
    """Of all elements at once and of each damper's velocity; dtau/dv is symmetric and takes power."""
    state, acting = given[case]
    for element in acting:
        by_q, by_v = element.derivatives(state)
        ref_q, ref_v = by_differences(lambda s, e=element: e.generalised(s)[0], state)
        assert np.abs(by_q - ref_q).max() < SAME * max(1.0, np.abs(ref_q).max()), element.name
        assert np.abs(by_v - ref_v).max() < SAME * max(1.0, np.abs(ref_v).max()), element.name
        assert np.abs(by_v - by_v.T).max() < 1e-12 * max(1.0, np.abs(by_v).max())
        assert np.linalg.eigvalsh(0.5 * (by_v + by_v.T)).max() < 1e-11 * max(1.0, np.abs(by_v).max())
        assert by_q.any() or by_v.any()


@pytest.mark.parametrize("case", ["talos", "panda", "ball joints", "box"])
def test_forces_are_gradients_of_energies_and_power_is_dissipated(given, case: str):
    """At rest tau = -dE/dq; moving, tau v = -dE/dt - dissipation."""
    state, acting = given[case]
    rest = state.with_velocity(state.robot.zero_v)
    for element in acting:
        gradient, _ = by_differences(lambda s, e=element: np.array([e.energy(s)]), rest)
        tau = element.generalised(rest)[0]
        assert np.abs(tau + gradient[0]).max() < SAME * max(1.0, np.abs(tau).max()), element.name
        power = element.generalised(state)[0] @ state.v
        assert power == pytest.approx(tau @ state.v - element.dissipation(state), rel=1e-10, abs=1e-10), element.name
        assert element.dissipation(state) >= 0.0


def test_derivatives_of_solutions_know_the_elements(talos: rbd.Robot):
    """da/dq and da/dv of a Talos on held soles with springs, against solved neighbours."""
    state = talos.standing()
    soles = talos.soles(friction=None)
    hand, torso = "arm_left_7_link", "torso_2_link"
    external = [
        rbd.Spring(hand, to=(0.5, 0.5, 1.5), stiffness=200.0, rest=0.1),
        rbd.Bushing(hand, torso, stiffness=(300.0,) * 3 + (20.0,) * 3, damping=5.0),
        rbd.ExternalForce(torso, (10.0, 5.0, 0.0)),
        rbd.JointDamping({"torso_1_joint": 4.0}),
    ]
    tau = rbd.hold(state, soles).tau
    found = rbd.solve(state, tau, soles, external=external).derivatives()
    free = np.linalg.svd(np.vstack([c.rows(state).J for c in soles]))[2][12:].T  # changes that keep the soles where they are

    def a(s: rbd.State) -> Array:
        return rbd.solve(s, tau, soles, external=external).a

    for d in free.T[::9]:
        along = slope(lambda h, d=d: a(rbd.State(talos, state.q, h * d)), a(state), 0.1, "v")
        assert np.abs(found.da_dv @ d - along).max() < 1e-6 * max(1.0, np.abs(along).max())
    box = rbd.testing.box()
    hung = rbd.State(box, pin.SE3ToXYZQUAT(pin.SE3(TILT, np.ones(3))), np.full(6, 0.3))
    acting = elements("box", (1.0, 2.0, 3.0))
    found = rbd.solve(hung, [], external=acting).derivatives()
    by_q, by_v = by_differences(lambda s: rbd.solve(s, [], external=acting).a, hung)
    assert np.abs(found.da_dq - by_q).max() < SAME * np.abs(by_q).max()
    assert np.abs(found.da_dv - by_v).max() < SAME * np.abs(by_v).max()


def test_the_geometric_stiffness_is_pinocchios(talos: rbd.Robot):
    """d(J^T w)/dq and d(J v)/dq by joint columns are those of its recursive derivatives, to rounding."""
    state, rng = turned(talos), np.random.default_rng(2)
    names, offsets = ("torso_2_link", "arm_left_7_link"), rng.normal(size=(2, 3))
    places = [Place(name, p, np.eye(3)) for name, p in zip(names, offsets, strict=True)]
    pair, w = Pair(state, *places), rng.normal(size=12)
    poses = [FixedPose(name, pin.SE3(np.eye(3), p), np.eye(3)) for name, p in zip(names, offsets, strict=True)]
    with_w, without = (state_derivatives(state, state.v, poses, [f[:6], f[6:]]) for f in (w, np.zeros(12)))
    assert np.abs(pair.geometric(w) - (with_w.force_dq - without.force_dq)).max() < 1e-10
    assert np.abs(pair.velocity_dq() - np.concatenate([p.velocity_dq for p in without.poses])).max() < 1e-12


class Wind:
    """A user's own element: a drag on a link, without derivatives."""

    name = "wind"

    def generalised(self, state):
        """-3 |u| u, nearly, at the link's origin."""
        at = state.frame("torso_2_link")
        f = -3.0 * at.v[:3] * np.sqrt(1.0 + at.v[:3] @ at.v[:3])
        return at.J[:3].T @ f, np.concatenate([f, np.cross(at.X_WF.translation - state.com, f)])

    def energy(self, state):
        """None."""
        return 0.0

    def dissipation(self, state):
        """What it takes."""
        return -float(self.generalised(state)[0] @ state.v)


def test_an_element_without_derivatives_is_differentiated(talos: rbd.Robot):
    """By differences on the manifold: the same as one that has them; in `Solution.derivatives` too."""
    state = turned(talos, 0.1)
    spring = rbd.Spring("arm_left_7_link", to="torso_2_link", stiffness=50.0, rest=0.2)

    class Bare:
        name = "bare"
        generalised, energy, dissipation = spring.generalised, spring.energy, spring.dissipation

    for one, other in zip(element_derivatives(Bare(), state), spring.derivatives(state), strict=True):
        assert np.abs(one - other).max() < 1e-8 * np.abs(spring.derivatives(state)[0]).max()
    wind = Wind()
    by_q, by_v = derivatives_of([wind, spring], state)
    ref_q, ref_v = by_differences(lambda s: wind.generalised(s)[0] + spring.generalised(s)[0], state)
    assert np.abs(by_q - ref_q).max() < 1e-7 * np.abs(ref_q).max() and np.abs(by_v - ref_v).max() < 1e-7 * np.abs(ref_v).max()
    tau = np.zeros(talos.nu)
    with_wind, without = (rbd.solve(state, tau, external=e).derivatives().da_dv for e in ([wind], None))
    assert np.abs(state.M @ (with_wind - without) - by_v).max() < 1e-6 * np.abs(by_v).max()


def test_the_rotation_vector_and_its_inverse_jacobian():
    """The series near zero meets the closed form; the matrix inverts Pinocchio's, and its change is that of differences."""
    rng = np.random.default_rng(0)
    for size in (0.0, 1e-12, 1e-3, 0.3, 0.499, 0.501, 1.5, 2.9):
        theta = rng.normal(size=3)
        theta *= size / np.linalg.norm(theta)
        R = pin.exp3(theta)
        found, angle = rotation_vector(R)
        assert np.abs(found - theta).max() < 1e-14 and abs(angle - size) < 1e-14
        assert np.abs(inverse_left_jacobian(theta).T @ pin.Jexp3(theta) - np.eye(3)).max() < 1e-13
        m = rng.normal(size=3)

        def product(x: Array, m: Array = m) -> Array:
            return inverse_left_jacobian(x) @ m

        ref = [slope(lambda h, x=theta, d=d: product(x + h * d), product(theta), 1e-2, "x") for d in np.eye(3)]
        assert np.abs(inverse_change(theta, m) - np.array(ref).T).max() < 1e-9


def test_derivatives_by_parameters(given):
    """`parameter_force` against differences of elements with other constants."""
    state, _ = given["talos"]
    hand, torso = "arm_left_7_link", "torso_2_link"
    line = {"stiffness": 100.0, "rest": 0.3, "preload": 2.0}
    makes = [
        (lambda **c: rbd.Spring(hand, torso, **c), line),
        (lambda **c: rbd.Spring(hand, (1, 2, 3), axis=(1, 2, 3), **c), line),
        (lambda **c: rbd.JointSpring("torso_2_joint", **c), line),
        (lambda **c: rbd.Damper(hand, torso, **c), {"damping": 5.0}),
        (lambda **c: rbd.Damper(hand, torso, axis=(1, 2, 3), **c), {"damping": 5.0}),
    ]
    for make, constants in makes:
        element = make(**constants)
        assert set(element.parameters) == set(constants)
        for name, value in constants.items():
            moved = [make(**{**constants, name: value + h}).generalised(state)[0] for h in (-0.01, 0.01)]
            ref = (moved[1] - moved[0]) / 0.02
            assert np.abs(element.parameter_force(state, name) - ref).max() < 1e-9 * max(1.0, np.abs(ref).max())
        with pytest.raises(rbd.InputError, match="has no parameter 'mass'"):
            element.parameter_force(state, "mass")
    K, C = np.array([100.0, 200, 300, 4, 5, 6]), np.array([1.0, 2, 3, 4, 5, 6])
    bushing = rbd.Bushing(hand, torso, stiffness=K, damping=C)
    for name in ("stiffness", "damping"):
        parts = bushing.parameter_force(state, name)
        for i, (_, part) in enumerate(parts.items()):
            more = {"stiffness": K + (name == "stiffness") * np.eye(6)[i], "damping": C + (name == "damping") * np.eye(6)[i]}
            ref = rbd.Bushing(hand, torso, **more).generalised(state)[0] - bushing.generalised(state)[0]
            assert np.abs(part - ref).max() < 1e-9
        assert list(parts) == ["x", "y", "z", "about x", "about y", "about z"]
    damping = rbd.JointDamping({"torso_1_joint": 4.0, "torso_2_joint": 3.0})
    parts = damping.parameter_force(state, "damping")
    total = 4.0 * parts["torso_1_joint"] + 3.0 * parts["torso_2_joint"]
    assert np.array_equal(total, damping.generalised(state)[0])
    slack = rbd.Spring("box", (0.0, 0.0, 0.0), stiffness=3.0, rest=0)
    box = rbd.testing.box()
    away = rbd.State(box, [0.3, 0, 0.4, 0, 0, 0, 1])
    near = rbd.Spring("box", (0.0, 0.0, 0.0), stiffness=3.0, rest=1e-6).generalised(away)[0]
    assert np.abs((near - slack.generalised(away)[0]) / 1e-6 - slack.parameter_force(away, "rest")).max() < 1e-8
    with pytest.raises(rbd.InputError, match="zero length, where its force has no derivative by its rest"):
        slack.parameter_force(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), "rest")
