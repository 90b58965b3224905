"""Chains as robots: the symbolic equations against Pinocchio's, and against rbd.simulate."""

from __future__ import annotations

import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import rbd
from rbd.errors import InputError, ModelError, ModelWarning
from rbd.planar.chain import Chain
from rbd.planar.equations_of_motion import dynamics
from rbd.planar.robot_file import robot_coordinates, to_robot, to_urdf

ANGLES = ("joint", "segment", "vertical")
PLANES = {"xz": (9.81, [0, 2]), "xy": (0, [0, 1])}


def drawn(n: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Bodies of n links; centres of mass beyond the ends too."""
    sizes = {"masses": (0.1, 5.0), "centres": (-0.3, 1.5), "inertias": (0.001, 0.5)}
    return {name: rng.uniform(*bounds, n).round(3) for name, bounds in sizes.items()}


def differ(found, expected, scale: float = 0.0) -> float:
    """Largest difference over the largest entry (or the scale, where that is larger)."""
    expected = np.asarray(expected)
    return float(np.abs(np.reshape(found, expected.shape) - expected).max() / max(np.abs(expected).max(), scale, 1e-300))


@pytest.mark.parametrize(("n", "angles", "plane"), [
    *((n, angles, "xz") for n in range(1, 6) for angles in ANGLES), (2, "joint", "xy"), (3, "vertical", "xy"),
])  # fmt: skip
def test_lagranges_equations_are_pinocchios(n: int, angles: str, plane: str, exhaustive: bool):
    """M, C, Christoffel tensor, g, T, V and both dynamics of random chains in random states, to 1e-12 of their size."""
    if n == 5 and angles != "joint" and not exhaustive:
        pytest.skip("five links in the other angles: run by `make exhaustive`")
    rng = np.random.default_rng(100 * n + len(angles))
    gravity, _ = PLANES[plane]
    dyn = dynamics(Chain(n, lengths=rng.uniform(0.2, 1.5, n).round(3), angles=angles), gravity=gravity, **drawn(n, rng))
    made, to = to_robot(dyn), robot_coordinates(dyn.chain)
    A = to.rates(np.eye(n)).T
    terms = (dyn.M, dyn.C, dyn.christoffel, dyn.g, dyn.T, dyn.V)
    M, C, G, g, T, V = (dyn.function(term) for term in terms)
    weight = float(made.mass * 9.81)  # of one metre: what zero is measured against
    for _ in range(4):
        q, qd, qdd, tau = rng.uniform(-3.0, 3.0, (4, n))
        state = made.at(to(q), to.rates(qd))
        tensor = np.einsum("ijk,ia,jb,kc->abc", rbd.dynamics.coriolis_tensor(state), A, A, A)
        speed = np.abs(qd).max()
        assert differ(M(q), A.T @ state.M @ A) < 1e-12
        assert differ(C(q, qd), A.T @ rbd.dynamics.coriolis_matrix(state) @ A, speed * made.mass) < 1e-12
        assert differ(G(q), tensor, made.mass) < 1e-12
        assert differ(g(q), to.inverse.forces(-rbd.dynamics.gravity_torque(state)), weight) < 1e-12
        assert differ(T(q, qd), rbd.dynamics.kinetic_energy(state)) < 1e-12
        assert differ(V(q) * np.ones(()), rbd.dynamics.potential_energy(state) if gravity else 0.0, weight) < 1e-12
        moved = rbd.dynamics.inverse_dynamics(state, to.rates(qdd))
        assert differ(dyn.inverse(q, qd, qdd), to.inverse.forces(moved)) < 1e-12
        free = rbd.dynamics.free_acceleration(state, to.forces(tau))
        assert differ(dyn.forward(q, qd, tau), to.inverse.rates(free)) < 1e-12 * np.linalg.cond(state.M)


@pytest.mark.parametrize("plane", PLANES)
@pytest.mark.parametrize("angles", ANGLES)
def test_the_frame_end_is_the_end_point(angles: str, plane: str):
    """Position and velocity of the frame `end`, and of each link's frame: x to the right, y up or along y."""
    chain = Chain(3, lengths=[0.5, 0.4, 0.3], angles=angles)
    made, to = to_robot(chain, masses=[1, 1, 1], plane=plane), robot_coordinates(chain)
    q, qd = np.random.default_rng(2).uniform(-3.0, 3.0, (2, 3))
    state, (_, axes) = made.at(to(q), to.rates(qd)), PLANES[plane]
    assert differ(state.frame("end").X_WF.translation[axes], chain.numeric.position(q)) < 1e-14
    assert differ(state.frame("end").v[axes], chain.numeric.velocity(q, qd)) < 1e-14
    for i in (0, 1, 2):
        assert differ(state.frame(f"link_{i + 1}").X_WF.translation[axes], chain.numeric.position(q, i), 1.0) < 1e-14
        x = state.frame(f"link_{i + 1}").X_WF.rotation[axes, 0]
        assert np.arctan2(x[1], x[0]) == pytest.approx(np.angle(np.exp(1j * chain.convert(q)[i])), abs=1e-14)


def test_a_swinging_pendulum_is_that_of_rbd_simulate():
    """Two rods let go: RungeKutta4 on the exported robot, DOP853 on the symbolic equations; equal to 1e-9, energy kept."""
    chain = Chain(2, lengths=[1.0, 0.8], angles="vertical")
    dyn = dynamics(chain, masses=[1.0, 0.7], bodies="rods", gravity=9.81)
    to, start = robot_coordinates(chain), np.array([1.2, -0.6, 0.3, -1.0])
    state = to_robot(dyn).at(to(start[:2]), to.rates(start[2:]))
    moved = rbd.simulate(state, duration=1.0, step=5e-4, integrator=rbd.RungeKutta4(), record_every=200, progress=False)
    exact = solve_ivp(
        lambda t, x: np.concatenate([x[2:], dyn.forward(x[:2], x[2:])]),
        (0.0, 1.0), start, method="DOP853", rtol=1e-12, atol=1e-12, t_eval=moved.t,
    )  # fmt: skip
    assert np.abs(to.inverse(moved.q) - exact.y[:2].T).max() < 1e-9
    assert np.abs(to.inverse.rates(moved.v) - exact.y[2:].T).max() < 1e-9
    energy = dyn.function(dyn.energy)(exact.y[:2].T, exact.y[2:].T)
    assert np.ptp(energy) < 1e-9 * np.abs(energy).max()


def test_rbd_solve_gives_the_accelerations_of_forward_dynamics():
    """From two links to rbd.solve: the same motors, the same motion."""
    chain = Chain(2, lengths=[0.5, 0.5], angles="segment")
    dyn, to = dynamics(chain, masses=[2.0, 1.0], bodies="rods", gravity=9.81), robot_coordinates(chain)
    q, qd, tau = np.array([0.3, 1.2]), np.array([1.0, -2.0]), np.array([3.0, 0.5])
    solution = rbd.solve(to_robot(dyn).at(to(q), to.rates(qd)), to.forces(tau))
    assert differ(to.inverse.rates(solution.a), dyn.forward(q, qd, tau)) < 1e-12


def test_holding_torques_carry_the_links_less_what_pushes_at_the_end_point():
    """In joint angles tau = g - J^T f - m (1, 1, 1)^T, with the force f and the counterclockwise moment m at the end."""
    chain = Chain(3, lengths=[0.38, 0.325, 0.107])
    dyn, to = dynamics(chain, masses=[6.0, 3.5, 1.5], bodies="rods", gravity=9.81), robot_coordinates(chain)
    for q in np.random.default_rng(4).uniform(-3.0, 3.0, (4, 3)):
        f, m = np.array([-35.0, 448.0]), 12.0
        ground = rbd.ExternalForce("end", force=(f[0], 0.0, f[1]), moment=(0.0, -m, 0.0))  # z up, x right: y is away from us
        held = rbd.hold(to_robot(dyn).at(to(q)), [], external=ground)
        expected = dyn.function(dyn.g)(q) - chain.numeric.jacobian(q).T @ f - m * np.ones(3)
        assert differ(to.inverse.forces(held.tau), expected) < 1e-12


@pytest.mark.parametrize("angles", ANGLES)
def test_coordinates_go_there_and_back(angles: str):
    """q, rates and torques; the power is the same on both sides."""
    to = robot_coordinates(Chain(4, angles=angles))
    q, qd, tau = np.random.default_rng(3).normal(size=(3, 6, 4))
    assert differ(to.inverse(to(q)), q) < 1e-15
    assert differ(to.inverse.rates(to.rates(qd)), qd) < 1e-15
    assert differ(to.inverse.forces(to.forces(tau)), tau) < 1e-15
    assert differ((to.forces(tau) * to.rates(qd)).sum(axis=1), (tau * qd).sum(axis=1)) < 1e-14
    if angles == "vertical":
        assert to(np.zeros(4)).tolist() == [-np.pi / 2, 0.0, 0.0, 0.0]


def test_the_robot_is_sound_and_its_q_are_angles():
    """No complaint of the doctor; joints with motors, by name; turns are kept, as limits are far away."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", ModelWarning)
        made = to_robot(Chain(3), lengths=[0.5, 0.4, 0.3], masses=[1.0, 1.0, 1.0], name="arm")
        to_robot(Chain(2, lengths=[1, 1]), masses=[1, 1], bodies="points")  # point masses were asked for: no warning
    assert rbd.doctor(made).ok and not rbd.doctor(made).warnings
    assert (made.name, made.nq, made.nv, made.nu, made.root) == ("arm", 3, 3, 3, "fixed")
    assert list(made.actuated_names) == ["joint_1", "joint_2", "joint_3"]
    assert made.at(np.array([100.0, -50.0, 7.0])).q.tolist() == [100.0, -50.0, 7.0]
    assert '<robot name="arm">' in made.urdf.read_text(encoding="utf-8")
    assert len(made.visual_model.geometryObjects) == 1 + 3 * 3


def test_the_file_is_written_and_read_again(tmp_path):
    """The text that comes back is the file's; numbers keep all their digits; rbd.load_robot reads it."""
    path = tmp_path / "two.urdf"
    lengths, masses = [0.1 + 0.2, 1 / 3], [np.pi, 1e-3]
    text = to_urdf(Chain(2, lengths=lengths), path, masses=masses)
    assert path.read_text(encoding="utf-8") == text
    found = ElementTree.fromstring(text)
    assert [float(e.get("value")) for e in found.iter("mass")] == masses
    assert [float(e.find("origin").get("xyz").split()[0]) for e in found.findall("joint")][1:] == lengths
    assert rbd.load_robot(path, root="fixed").nv == 2


def test_values_take_the_place_of_symbols():
    """Symbols of lengths and masses, by name or themselves."""
    chain = Chain(2)
    text = to_urdf(chain, values={chain.lengths[0]: 0.5, "ell_2": 0.25, "m_1": 1.0, "m_2": 2.0})
    assert text == to_urdf(chain.with_lengths([0.5, 0.25]), masses=[1.0, 2.0])
    made = to_robot(dynamics(Chain(1), gravity=0), values={"ell_1": 1, "m_1": 1, "d_1": 1, "I_1": 0.1})
    assert made.at().M.item() == pytest.approx(1.1)


def test_point_masses_weigh_as_points():
    """It is m L^2 about the base, exactly."""
    assert to_robot(Chain(1, lengths=[2.0]), masses=[3.0], bodies="points").at().M.tolist() == [[12.0]]


@pytest.mark.parametrize(("given", "told"), [
    ({}, "still symbols: ell_1, ell_2, m_1, m_2.*values="),
    ({"lengths": [1, 1]}, "still symbols: m_1, m_2"),
    ({"lengths": [1, 1], "masses": [1, 1], "centres": [0.5, 0.5]}, "still symbols: I_1, I_2"),
    ({"lengths": [1, 1], "values": {"m_1": 1.0}}, "still a symbol: m_2"),
    ({"lengths": [1, 0], "masses": [1, 1]}, "length of link 2"),
    ({"lengths": [1], "masses": [1, 1]}, "lengths has 1 entries"),
    ({"lengths": [1, 1], "masses": [1, np.nan]}, "finite"),
    ({"lengths": [1, 1], "masses": [1, 1], "plane": "yz"}, "plane"),
    ({"lengths": [1, 1], "masses": [1, 1], "plane": 2}, "plane"),
    ({"lengths": [1, 1], "masses": [1, 1], "name": "<a>"}, "name"),
    ({"lengths": [1, 1], "masses": [1, 1], "name": "../a"}, "name"),
    ({"lengths": [1, 1], "masses": [1, 1], "values": {"x": 1.0}}, "no symbol"),
    ({"lengths": [1, 1], "masses": [1, 1], "bodies": "rods", "inertias": [1, 1]}, "leave centres"),
])  # fmt: skip
def test_what_makes_no_file_is_refused(given: dict, told: str):
    """Symbols by their names, numbers by their link."""
    with pytest.raises(InputError, match=told):
        to_urdf(Chain(2), **given)
    with pytest.raises(InputError, match=told):
        to_robot(Chain(2), **given)


def test_a_file_lies_in_a_plane():
    """Only a robot made of dynamics finds its plane by itself."""
    with pytest.raises(InputError, match="plane is None"):
        to_urdf(Chain(2, lengths=[1, 1]), masses=[1, 1], plane=None)


@pytest.mark.parametrize("chain", ["arm", None, 2, Chain])
def test_what_is_no_chain_is_refused(chain):
    """Functions that take a chain say what they want."""
    for ask in (dynamics, to_urdf, to_robot, robot_coordinates):
        with pytest.raises(InputError, match="the chain is .*; expected a planar one"):
            ask(chain)


def test_files_that_cannot_be_written_are_told(tmp_path):
    """A wrong ending, a missing folder, what is no path."""
    chain = Chain(1, lengths=[1.0])
    with pytest.raises(InputError, match="ends in .urdf"):
        to_urdf(chain, tmp_path / "a.xml", masses=[1.0])
    with pytest.raises(ModelError, match="cannot be written"):
        to_urdf(chain, tmp_path / "none" / "a.urdf", masses=[1.0])
    with pytest.raises(InputError):
        to_urdf(chain, 3, masses=[1.0])  # type: ignore[arg-type]


def test_robots_fall_with_the_gravity_of_their_dynamics():
    """On the Moon too; a chain without inertia is refused."""
    dyn = dynamics(Chain(1, lengths=[1]), masses=[1], bodies="rods", gravity=1.62)
    made = to_robot(dyn)
    assert made.gravity.tolist() == [0.0, 0.0, -1.62]
    assert abs(rbd.dynamics.gravity_torque(made.at([0.0]))[0] + 0.5 * 1.62) < 1e-12
    with pytest.raises(ModelError, match="singular"):
        to_robot(Chain(2, lengths=[1, 1]), masses=[1, 1], centres=[1, 0], inertias=[0, 0])


@pytest.mark.parametrize("values", [[0.0], [0.0, np.nan], "ab", np.zeros((2, 2, 2))])
def test_coordinates_of_other_shapes_are_refused(values):
    """All six ways check shape and numbers."""
    to = robot_coordinates(Chain(2))
    maps = (to, to.rates, to.forces, to.inverse, to.inverse.rates, to.inverse.forces)
    for convert in maps:
        with pytest.raises(InputError):
            convert(values)


def test_dynamics_know_their_masses_and_their_plane():
    """What came with dynamics is in their robot: upright under gravity, flat without; given twice it is refused."""
    dyn = dynamics(Chain(2, lengths=[0.5, 0.5], angles="segment"), masses=[1.0, 2.0], bodies="points", gravity=0)
    flat = to_robot(dyn, name="two")
    assert flat.name == "two" and rbd.dynamics.gravity_torque(flat.at([0.1, 0.2])).tolist() == [0.0, 0.0]
    assert robot_coordinates(dyn.chain)([0.5, 1.5]).tolist() == [0.5, 1.0]
    for given in ({"masses": [1, 1]}, {"lengths": [1, 1]}, {"bodies": "rods"}, {"plane": "xz"}):
        with pytest.raises(InputError, match=f"{next(iter(given))} came with dynamics"):
            to_robot(dyn, **given)
