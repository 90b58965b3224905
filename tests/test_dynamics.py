"""The terms of M(q) a + v^T C(q) v = S^T tau + tau_g(q) + tau_ext, against closed forms, differences and invariants."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd import dynamics
from rbd.arrays import Array

GRAVITY = np.array([0.0, 0.0, -9.81])
INERTIAL = '<inertial><origin xyz="{at}"/><mass value="{m}"/><inertia {moments} ixy="0" ixz="0" iyz="0"/></inertial>'


@pytest.fixture(scope="module")
def panda() -> rbd.Robot:
    """An arm on a fixed base: nine single-axis joints, where v is q_dot."""
    return rbd.load_robot("panda", root="fixed")


@pytest.fixture(scope="module", params=["talos", "g1", "panda"])
def robot(request: pytest.FixtureRequest) -> rbd.Robot:
    """Two floating bases and a fixed one."""
    return rbd.load_robot(request.param, root="fixed" if request.param == "panda" else "free_flyer")


def drawn(robot: rbd.Robot, seed: int) -> rbd.State:
    """A moving state anywhere near the robot's posture."""
    rng = np.random.default_rng(seed)
    q = pin.integrate(robot.model, robot.standing().q, rng.uniform(-1.0, 1.0, robot.nv))
    return rbd.State(robot, q, rng.normal(size=robot.nv))


def moved(state: rbd.State, direction: Array, t: float, v: Array | None = None) -> rbd.State:
    """The state at q (+) direction t."""
    q = pin.integrate(state.robot.model, state.q, direction * t)
    return rbd.State(state.robot, q, state.v if v is None else v)


def urdf(tmp_path: Path, *parts: str) -> Path:
    """A model file of these links and joints."""
    path = tmp_path / "made.urdf"
    path.write_text(f'<robot name="made">{"".join(parts)}</robot>')
    return path


def link(name: str, at: str = "0 0 0", m: float = 1.0, moments: str = 'ixx="1" iyy="1" izz="1"') -> str:
    return f'<link name="{name}">{INERTIAL.format(at=at, m=m, moments=moments)}</link>'


def hinge(name: str, parent: str, child: str, axis: str, at: str = "0 0 0") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="revolute">{ends}<limit lower="-9" upper="9" effort="9" velocity="9"/></joint>'


@pytest.mark.parametrize("seed", range(3))
def test_the_rate_of_M_is_C_plus_its_transpose(robot: rbd.Robot, seed: int) -> None:
    """Mdot - 2 C is skew: Mdot = C + C^T, with Mdot by differences along q (+) v t, to 1e-8 of the largest entry."""
    state, dt = drawn(robot, seed), 1e-5
    C = dynamics.coriolis_matrix(state)
    M_dot = (moved(state, state.v, dt).M - moved(state, state.v, -dt).M) / (2 * dt)
    assert np.abs(M_dot - C - C.T).max() < 1e-8 * np.abs(M_dot).max()


@pytest.mark.parametrize("seed", range(3))
def test_velocity_forces_by_three_routes(robot: rbd.Robot, seed: int) -> None:
    """C(q, v) v = h + tau_g = v @ tensor @ v, for any v: to 1e-12 of the largest entry; on a floating base too."""
    state = drawn(robot, seed)
    tensor = dynamics.coriolis_tensor(state)
    for v in np.random.default_rng(seed).normal(size=(5, robot.nv)):
        at = state.with_velocity(v)
        forces = dynamics.bias_force(at) + dynamics.gravity_torque(at)
        scale = 1e-12 * np.abs(forces).max()
        assert np.abs(v @ tensor @ v - forces).max() < scale
        assert np.abs(dynamics.coriolis_matrix(at) @ v - forces).max() < scale


def test_the_tensor_is_symmetric_in_the_velocities(robot: rbd.Robot) -> None:
    """Shape (nv, nv, nv), force index first: C_ijk = C_ikj exactly, and it does not depend on v."""
    state = drawn(robot, 4)
    tensor = dynamics.coriolis_tensor(state)
    assert tensor.shape == (robot.nv,) * 3
    assert np.array_equal(tensor, tensor.transpose(0, 2, 1))
    assert np.array_equal(tensor, dynamics.coriolis_tensor(state.with_velocity(np.zeros(robot.nv))))


def test_the_tensor_is_made_of_christoffel_symbols(panda: rbd.Robot) -> None:
    """On a fixed base: C_ijk = 1/2 (dM_ij/dq_k + dM_ik/dq_j - dM_jk/dq_i), by differences of M, to 1e-8."""
    state, dt = drawn(panda, 5), 1e-5
    D = np.array([(moved(state, e, dt).M - moved(state, e, -dt).M) / (2 * dt) for e in np.eye(panda.nv)])  # [k, i, j]
    expected = 0.5 * (np.einsum("kij->ijk", D) + np.einsum("jik->ijk", D) - np.einsum("ijk->ijk", D))
    assert np.abs(dynamics.coriolis_tensor(state) - expected).max() < 1e-8


@pytest.mark.parametrize("q2", [-2.0, 0.4, 1.3])
def test_christoffel_symbols_of_the_planar_two_link_arm(tmp_path: Path, q2: float) -> None:
    """Published: with h = m2 L1 d2 sin q2, G_111 = 0, G_112 = G_121 = G_122 = -h, G_211 = h, the rest 0."""
    m2, L1, d2 = 1.7, 0.6, 0.35
    arm = urdf(
        tmp_path,
        '<link name="ground"/>',
        link("upper", "0.3 0 0", 2.1),
        link("lower", f"{d2} 0 0", m2),
        hinge("shoulder", "ground", "upper", "0 0 1"),
        hinge("elbow", "upper", "lower", "0 0 1", f"{L1} 0 0"),
    )
    robot = rbd.load_robot(arm, root="fixed")
    G = dynamics.coriolis_tensor(rbd.State(robot, np.array([0.8, q2])))
    h = m2 * L1 * d2 * np.sin(q2)
    assert np.abs(G - np.array([[[0.0, -h], [-h, -h]], [[h, 0.0], [0.0, 0.0]]])).max() < 1e-15


@pytest.mark.parametrize("friction", [None, 0.0, 0.6])
@pytest.mark.parametrize("seed", range(2))
def test_hessian_of_a_point_gives_its_bias(talos: rbd.Robot, friction: float | None, seed: int) -> None:
    """The hessian H has rows first, symmetric in the velocities: v @ H @ v is J_dot v, to 1e-11, for any v."""
    normal = np.array([0.3, -0.2, 0.9])
    normal /= np.linalg.norm(normal)
    contact = rbd.PointContact(
        "toe", "left_sole_link", offset=(0.1, 0.05, 0.0), on=rbd.Ground(normal=normal), friction=friction
    )
    check_hessian(drawn(talos, seed), contact, rows=1 if friction == 0.0 else 3)


@pytest.mark.parametrize("friction", [None, 0.6])
def test_hessian_of_a_sole_gives_its_bias(talos: rbd.Robot, friction: float | None) -> None:
    """As for a point; six rows in the patch's own axes, which a placement has turned."""
    placement = pin.SE3(pin.rpy.rpyToMatrix(0.4, -0.3, 0.8), np.array([0.1, 0.0, -0.1]))
    sole = rbd.SurfaceContact("sole", "left_sole_link", half_lengths=(0.1, 0.06), placement=placement, friction=friction)
    check_hessian(drawn(talos, 6), sole, rows=6)


def check_hessian(state: rbd.State, contact: dynamics.HasRows, *, rows: int) -> None:
    nv = state.robot.nv
    H = dynamics.constraint_hessian(state, contact)
    assert H.shape == (rows, nv, nv)
    assert np.array_equal(H, H.transpose(0, 2, 1))
    for v in np.random.default_rng(1).normal(size=(4, nv)):
        bias = contact.rows(state.with_velocity(v)).bias
        assert np.abs(v @ H @ v - bias).max() < 1e-11 * max(1.0, np.abs(bias).max())


def test_energies_are_those_of_pinocchio(robot: rbd.Robot) -> None:
    """Kinetic and potential energy by Pinocchio's own sums over the bodies, to 1e-13 of their size."""
    for seed in range(3):
        state = drawn(robot, seed)
        data = robot.model.createData()
        T = pin.computeKineticEnergy(robot.model, data, state.q, state.v)
        U = pin.computePotentialEnergy(robot.model, data, state.q)
        assert abs(dynamics.kinetic_energy(state) - T) < 1e-13 * max(1.0, abs(T))
        assert abs(dynamics.potential_energy(state) - U) < 1e-13 * max(1.0, abs(U))


def test_lifting_a_robot_costs_its_weight(talos: rbd.Robot) -> None:
    """One metre up: potential energy rises by m g; sideways: not at all."""
    q = talos.standing().q
    low = dynamics.potential_energy(rbd.State(talos, q))
    for step, rise in (([0.0, 0.0, 1.0], talos.mass * 9.81), ([1.0, -2.0, 0.0], 0.0)):
        at = q.copy()
        at[:3] += step
        assert abs(dynamics.potential_energy(rbd.State(talos, at)) - low - rise) < 1e-10


def test_gravity_is_the_slope_of_the_potential_energy(robot: rbd.Robot) -> None:
    """tau_g = -dU/dq by differences along each coordinate, to 1e-6 N; on the right-hand side, so h = -tau_g at rest."""
    state, dt = drawn(robot, 7), 1e-5
    tau_g = dynamics.gravity_torque(state)
    U = [[dynamics.potential_energy(moved(state, e, t)) for t in (-dt, dt)] for e in np.eye(robot.nv)]
    slope = np.array([(up - down) / (2 * dt) for down, up in U])
    assert np.abs(tau_g + slope).max() < 1e-6
    rest = state.with_velocity(np.zeros(robot.nv))
    assert np.abs(dynamics.bias_force(rest) + tau_g).max() < 1e-11


def test_momentum_is_mass_times_the_rate_of_the_centre_of_mass(robot: rbd.Robot) -> None:
    """Linear part: m d/dt com, by differences, to 1e-7."""
    state, dt = drawn(robot, 8), 1e-5
    rate = (moved(state, state.v, dt).com - moved(state, state.v, -dt).com) / (2 * dt)
    assert np.abs(dynamics.momentum(state)[:3] - robot.mass * rate).max() < 1e-7 * robot.mass


def test_angular_momentum_is_the_sum_over_the_bodies(talos: rbd.Robot) -> None:
    """About the centre of mass, world axes: sum of R I w + m r x (p_dot - com_dot) over all bodies, to 1e-11."""
    state = drawn(talos, 9)
    data = talos.model.createData()
    pin.forwardKinematics(talos.model, data, state.q, state.v)
    com_dot = dynamics.momentum(state)[:3] / talos.mass
    total = np.zeros(3)
    for X_WB, twist, body in zip(data.oMi, data.v, talos.model.inertias, strict=True):
        r = X_WB.act(body.lever) - state.com
        velocity = X_WB.rotation @ (twist.linear + np.cross(twist.angular, body.lever)) - com_dot
        total += X_WB.rotation @ body.inertia @ twist.angular + body.mass * np.cross(r, velocity)
    assert np.abs(dynamics.momentum(state)[3:] - total).max() < 1e-11


@pytest.mark.parametrize("seed", range(3))
def test_no_motor_moves_the_centre_of_mass_of_a_falling_robot(talos: rbd.Robot, seed: int) -> None:
    """Without contacts the rate of momentum is the weight, about the centre of mass: whatever v and tau are, to 1e-6."""
    state, dt = drawn(talos, seed), 1e-6
    tau = np.random.default_rng(seed).normal(size=talos.nu) * 30.0
    a = dynamics.free_acceleration(state, tau)
    later, before = (moved(state, state.v + 0.5 * a * t, t, state.v + a * t) for t in (dt, -dt))
    rate = (dynamics.momentum(later) - dynamics.momentum(before)) / (2 * dt)
    weight = np.concatenate([talos.mass * GRAVITY, np.zeros(3)])
    assert np.abs(rate - weight).max() < 1e-6 * talos.mass * 9.81


@pytest.mark.parametrize("seed", range(3))
def test_inverse_dynamics_undoes_free_motion(robot: rbd.Robot, seed: int) -> None:
    """M a_free + h = S^T tau + tau_ext, to 1e-10 N."""
    state, rng = drawn(robot, seed), np.random.default_rng(seed)
    tau, external = rng.uniform(-0.9, 0.9, robot.nu), rng.normal(size=robot.nv) * 30.0
    a = dynamics.free_acceleration(state, tau, external)
    forces = dynamics.inverse_dynamics(state, a)
    assert np.abs(forces - robot.actuation.T @ tau - external).max() < 1e-10
    assert np.abs(a - rbd.solve(state, tau, external=external).a).max() < 1e-12 * np.abs(a).max()


def test_inverse_dynamics_is_recursive_newton_euler(robot: rbd.Robot) -> None:
    """M a + h is Pinocchio's rnea, to 1e-12 of its size."""
    state = drawn(robot, 10)
    a = np.random.default_rng(10).normal(size=robot.nv)
    expected = pin.rnea(robot.model, robot.model.createData(), state.q, state.v, a)
    assert np.abs(dynamics.inverse_dynamics(state, a) - expected).max() < 1e-12 * np.abs(expected).max()


def test_power_of_the_forces_is_the_rate_of_energy(robot: rbd.Robot) -> None:
    """d/dt (T + U) = tau . S v + tau_ext . v, by differences along the motion, to 1e-6 of the power."""
    state, rng, dt = drawn(robot, 11), np.random.default_rng(11), 1e-6
    tau, external = rng.normal(size=robot.nu), rng.normal(size=robot.nv)
    a = dynamics.free_acceleration(state, tau, external)
    energy = []
    for t in (dt, -dt):
        at = moved(state, state.v + 0.5 * a * t, t, state.v + a * t)
        energy.append(dynamics.kinetic_energy(at) + dynamics.potential_energy(at))
    power = float(tau @ (robot.actuation @ state.v) + external @ state.v)
    assert abs((energy[0] - energy[1]) / (2 * dt) - power) < 1e-6 * max(1.0, abs(power), dynamics.kinetic_energy(state))


def test_a_swinging_arm_keeps_its_energy(panda: rbd.Robot) -> None:
    """Fifty milliseconds of free motion by Runge and Kutta's fourth order, 50 steps: energy to 1e-6 J of about 30."""
    q, v, dt = panda.standing().q.copy(), np.zeros(panda.nv), 1e-3
    tau = np.zeros(panda.nu)
    start = dynamics.potential_energy(rbd.State(panda, q))

    def rate(q: Array, v: Array) -> tuple[Array, Array]:
        return v, dynamics.free_acceleration(rbd.State(panda, q, v), tau)

    for _ in range(50):
        v1, a1 = rate(q, v)
        v2, a2 = rate(q + 0.5 * dt * v1, v + 0.5 * dt * a1)
        v3, a3 = rate(q + 0.5 * dt * v2, v + 0.5 * dt * a2)
        v4, a4 = rate(q + dt * v3, v + dt * a3)
        q, v = q + dt * (v1 + 2 * v2 + 2 * v3 + v4) / 6, v + dt * (a1 + 2 * a2 + 2 * a3 + a4) / 6
    end = rbd.State(panda, q, v)
    assert dynamics.kinetic_energy(end) > 0.1
    assert abs(dynamics.kinetic_energy(end) + dynamics.potential_energy(end) - start) < 1e-6


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 2, 3.0])
def test_a_pendulum_swings_by_its_closed_form(tmp_path: Path, angle: float) -> None:
    """A point mass m on a bar L: a = -(g / L) sin angle, M = m L^2, tau_g = -m g L sin angle."""
    m, L = 1.3, 0.8
    bob = link("bob", f"0 0 {-L}", m, 'ixx="0" iyy="0" izz="0"')
    robot = rbd.load_robot(urdf(tmp_path, '<link name="roof"/>', bob, hinge("pivot", "roof", "bob", "0 1 0")), root="fixed")
    state = rbd.State(robot, np.array([angle]), np.array([2.0]))
    assert abs(state.M[0, 0] - m * L**2) < 1e-15
    assert abs(dynamics.gravity_torque(state)[0] + m * 9.81 * L * np.sin(angle)) < 1e-14
    assert abs(dynamics.free_acceleration(state, np.zeros(1))[0] + 9.81 / L * np.sin(angle)) < 1e-14


def test_a_torque_free_cylinder_precesses(tmp_path: Path) -> None:
    """Kane, Likins and Levinson (1983): with I = 0.04, J = 0.02, s = (I - J) / I w_z: w_x' = s w_y, w_y' = -s w_x, w_z' = 0."""
    robot = rbd.load_robot(urdf(tmp_path, link("body", m=3.0, moments='ixx="0.04" iyy="0.04" izz="0.02"')))
    w = np.array([0.3, -0.5, 2.0])
    q = pin.randomConfiguration(robot.model, -np.ones(7), np.ones(7))
    state = rbd.State(robot, q, np.concatenate([[0.1, 0.2, 0.3], w]))
    a = dynamics.free_acceleration(state, np.zeros(0))
    s = (0.04 - 0.02) / 0.04 * w[2]
    assert np.abs(a[3:] - [s * w[1], -s * w[0], 0.0]).max() < 1e-13
    R = state.frame("body").X_WF.rotation
    assert np.abs(R @ (a[:3] + np.cross(w, state.v[:3])) - GRAVITY).max() < 1e-13


def test_rotors_count_and_damping_does_not(tmp_path: Path) -> None:
    """An MJCF joint's armature is in M; its damping and friction are in no term of h, as the docstrings say."""
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco model="arm"><worldbody><body name="b"><joint name="j" type="hinge" axis="0 1 0" armature="0.1" damping="2" '
        'frictionloss="3"/><inertial pos="0 0 -0.5" mass="1" diaginertia="0.2 0.2 0.2"/></body></worldbody></mujoco>'
    )
    robot = rbd.load_robot(path)
    state = rbd.State(robot, np.array([0.0]), np.array([5.0]))
    assert abs(state.M[0, 0] - (0.25 + 0.2 + 0.1)) < 1e-15
    assert abs(dynamics.free_acceleration(state, np.zeros(0))[0]) < 1e-14


def test_terms_given_out_are_copies(talos: rbd.Robot) -> None:
    """Writing into an answer changes no other."""
    state = drawn(talos, 12)
    for term in (
        dynamics.mass_matrix,
        dynamics.bias_force,
        dynamics.gravity_torque,
        dynamics.coriolis_matrix,
        dynamics.momentum,
    ):
        first = term(state)
        kept = first.copy()
        first[:] = 7.0
        assert np.array_equal(term(state), kept)


def test_a_contact_with_a_moving_ground_has_no_hessian(talos):
    """Its J_dot v is not quadratic in v: a Hessian would be a wrong number."""
    state = talos.standing()
    lift = rbd.PointContact("lift", "left_sole_link", on=rbd.Ground(acceleration=(0.0, 0.0, 1.0)))
    with pytest.raises(rbd.InputError, match="no Hessian"):
        rbd.dynamics.constraint_hessian(state, lift)
