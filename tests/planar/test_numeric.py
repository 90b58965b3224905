"""Numbers out of chains: from the structure for any n, and compiled from symbols; both vectorised over samples."""

from __future__ import annotations

import mpmath
import numpy as np
import pinocchio as pin
import pytest
import sympy
from work import calls

from rbd.errors import InputError
from rbd.planar.angles import CONVENTIONS
from rbd.planar.chain import Chain
from rbd.planar.robot_file import to_robot

ASKED = {"position": 1, "velocity": 2, "acceleration": 3, "jerk": 4, "jacobian": 1, "jacobian_rate": 2}
"""How many of q, qd, qdd, qddd each takes."""


def chain_of(n: int, word: str = "joint") -> Chain:
    """Links of different lengths."""
    return Chain(n, lengths=np.linspace(0.3, 0.8, n), angles=word)


def motion_of(n: int, samples: int = 100, seed: int = 0) -> np.ndarray:
    """Random q, qd, qdd, qddd, shape (4, samples, n)."""
    return np.random.default_rng(seed).normal(size=(4, samples, n))


@pytest.mark.parametrize("word", CONVENTIONS)
@pytest.mark.parametrize("n", [1, 2, 3, 4, 5])
def test_numbers_equal_the_symbols(n, word):
    """Every numeric function of every joint against the symbols, compiled."""
    chain, state = chain_of(n, word), motion_of(n)
    for name, takes in ASKED.items():
        for i in {None, 0, 1, n // 2}:
            ours = getattr(chain.numeric, name)(*state[:takes], i=i)
            theirs = chain.function(getattr(chain, name)(i))(*state[:takes])
            assert np.abs(ours - theirs.reshape(ours.shape)).max() < 1e-12


@pytest.mark.parametrize("word", CONVENTIONS)
@pytest.mark.parametrize("n", [1, 7, 50])
def test_any_number_of_links_moves_as_its_position_does(n, word):
    """Derivatives of r(q(t)) at 40 digits along a cubic q(t): no symbols, no Jacobian, any n."""
    chain = chain_of(n, word)
    q, qd, qdd, qddd = motion_of(n, 1)[:, 0] * 0.5

    def end_point(t: mpmath.mpf) -> mpmath.mpc:
        theta = [mpmath.mpf(a) + b * t + c * t**2 / 2 + d * t**3 / 6 for a, b, c, d in zip(q, qd, qdd, qddd, strict=True)]
        if word == "joint":
            theta = [mpmath.fsum(theta[: k + 1]) for k in range(n)]
        turn = -mpmath.pi / 2 if word == "vertical" else mpmath.mpf(0)
        return mpmath.fsum(float(ell) * mpmath.expj(phi + turn) for ell, phi in zip(chain.lengths, theta, strict=True))

    numbers = chain.numeric
    ours = [numbers.position(q), numbers.velocity(q, qd), numbers.acceleration(q, qd, qdd), numbers.jerk(q, qd, qdd, qddd)]
    with mpmath.workdps(40):
        for order, value in enumerate(ours):
            exact = mpmath.diff(end_point, 0, order)
            assert np.hypot(value[0] - float(exact.real), value[1] - float(exact.imag)) < 1e-13 * (1.0 + float(abs(exact)))


@pytest.mark.parametrize("n", [1, 2, 5])
def test_pinocchio_moves_the_end_point_alike(n):
    """Position, velocity, classical acceleration and Jacobian of the exported robot's end, in its x-z plane."""
    chain = chain_of(n)
    robot = to_robot(chain, masses=[1.0] * n)
    model, data = robot.model, robot.model.createData()
    end, axes = model.getFrameId("end"), [0, 2]
    for q, qd, qdd in motion_of(n, 5)[:3].swapaxes(0, 1):
        pin.forwardKinematics(model, data, q, qd, qdd)
        pin.updateFramePlacements(model, data)
        world = pin.LOCAL_WORLD_ALIGNED
        theirs = [
            data.oMf[end].translation[axes],
            pin.getFrameVelocity(model, data, end, world).linear[axes],
            pin.getFrameClassicalAcceleration(model, data, end, world).linear[axes],
            pin.computeFrameJacobian(model, data, q, end, world).reshape(6, n)[axes],
        ]
        numbers = chain.numeric
        ours = [numbers.position(q), numbers.velocity(q, qd), numbers.acceleration(q, qd, qdd), numbers.jacobian(q)]
        assert max(np.abs(a - b).max() for a, b in zip(ours, theirs, strict=True)) < 1e-12


def test_positions_go_from_the_base_to_the_end_point():
    """Two links of 1 m at 0 and 90 degrees: (0, 0), (1, 0), (1, 1)."""
    chain = Chain(2, lengths=(1.0, 1.0))
    assert np.allclose(chain.numeric.positions([0.0, np.pi / 2]), [[0, 0], [1, 0], [1, 1]], atol=1e-15)
    q = motion_of(2, 7)[0]
    assert chain.numeric.positions(q).shape == (7, 3, 2)
    for i in range(3):
        assert np.array_equal(chain.numeric.positions(q)[:, i], chain.numeric.position(q, i))


@pytest.mark.parametrize("n", [1, 2, 5])
def test_many_samples_are_each_one_of_them(n):
    """Blocks, and their ends, change nothing: 10,001 samples at once and some of them alone."""
    chain, state = chain_of(n), motion_of(n, 10_001)
    compiled = chain.function(chain.acceleration())
    for function in (chain.numeric.acceleration, compiled):
        many = function(*state[:3])
        for k in (0, 4095, 4096, 8191, 8192, 10_000):
            assert np.abs(many[k] - function(*state[:3, k])).max() < 1e-13
        assert function(*state[:3, :0]).shape == (0, 2)
        assert np.array_equal(function(*(np.asfortranarray(x) for x in state[:3])), many)


def test_shapes_follow_the_expression():
    """A number gives (samples,), a column (samples, r), a matrix (samples, r, c), a tensor all its axes."""
    chain = Chain(2, lengths=(0.5, 0.5))
    q = motion_of(2, 6)[0]
    tensor = sympy.Array([chain.jacobian().tolist(), chain.jacobian().tolist()])
    for expr, shape in ((chain.determinant(), ()), (chain.position(), (2,)), (chain.jacobian(), (2, 2)), (tensor, (2, 2, 2)),
                        (sympy.Integer(3), ()), (2.5, ()), (sympy.Matrix([[chain.q[0]]]), (1,))):  # fmt: skip
        function = chain.function(expr)
        assert function.shape == shape
        assert function(q).shape == (6, *shape) and function(q[0]).shape == shape
    assert np.allclose(chain.function(chain.determinant())(q), 0.25 * np.sin(q[:, 1]), atol=1e-16)


def test_parameters_are_given_by_symbol_or_by_name():
    """Lengths as parameters give what lengths in the chain give, to the last digit."""
    chain, state = Chain(2), motion_of(2)
    expected = Chain(2, lengths=(1 / 3, 0.7)).numeric.jerk(*state)
    for keys in (chain.lengths, ("ell_1", "ell_2"), sympy.symbols("ell_1 ell_2")):
        function = chain.function(chain.jerk(), parameters=dict(zip(keys, (1 / 3, sympy.Rational(7, 10)), strict=True)))
        assert np.abs(function(*state) - expected).max() < 1e-13


def test_what_is_left_without_a_number_is_named():
    """Lengths that are symbols, foreign functions, a fourth derivative."""
    chain = Chain(2)
    with pytest.raises(InputError, match="no numbers are known for ell_1, ell_2"):
        chain.function(chain.position())
    foreign = sympy.Function("f")(chain.t)
    for expr in (foreign, chain.qddd[0].diff(chain.t), chain.t, Chain(3).q[2]):
        with pytest.raises(InputError, match="no numbers are known"):
            chain.function(expr)
    with pytest.raises(InputError, match="lengths are symbols"):
        _ = chain.numeric


@pytest.mark.parametrize("parameters", [{"ell_1": np.nan}, {"ell_1": "1"}, {1: 2.0}, [1.0], {"ell_1": sympy.I}])
def test_parameters_that_are_none_are_refused(parameters):
    """Symbols or names, with finite real numbers."""
    with pytest.raises(InputError, match="parameter"):
        Chain(1).function(Chain(1).position(), parameters=parameters)


@pytest.mark.parametrize("expr", ["q", None, object(), sympy.Eq(sympy.Symbol("x"), 1), np.eye(2), True])
def test_what_is_no_expression_is_refused(expr):
    """SymPy's expressions, matrices and arrays."""
    with pytest.raises(InputError, match="is no expression"):
        Chain(2).function(expr)


def test_no_value_that_is_not_finite_or_real_comes_out():
    """A division by zero, a root of a negative number, an imaginary unit, a function that NumPy has not."""
    chain = Chain(1, lengths=(1.0,))
    angle = chain.q[0]
    for expr in (1 / angle, sympy.sqrt(angle - 1), sympy.log(angle), sympy.I * angle, sympy.I, sympy.besselj(0, angle)):
        with pytest.raises(InputError, match="expression"):
            chain.function(expr)([[0.0], [0.5]])


@pytest.mark.parametrize(
    "given",
    [([0, 0],), ([0, 0], [0, 0, 0]), ([0, 0], [[0, 0]]), ([0, np.nan], [0, 0]), ("ab", [0, 0]), (None, [0, 0]), ([[[0]]],) * 2],
)
def test_wrong_samples_are_refused(given):
    """All of one shape, (n,) or (samples, n), finite; none left out that is needed."""
    chain = Chain(2, lengths=(0.5, 0.5))
    for function in (chain.function(chain.velocity()), chain.numeric.velocity):
        with pytest.raises((InputError, TypeError) if len(given) == 1 else InputError):
            function(*given)


def test_what_came_is_not_changed():
    """Arrays of the user's stay as they were."""
    chain, state = chain_of(3), motion_of(3)
    before = state.copy()
    chain.numeric.jerk(*state)
    chain.numeric.split(*state[:3])
    chain.function(chain.jerk())(*state)
    assert np.array_equal(state, before)


def test_a_hundred_thousand_accelerations_take_few_calls():
    """Two links, hot: NumPy takes thousands of samples at once (688 calls were counted). `make bench` has the time, 20 ms."""
    chain, state = Chain(2, lengths=(0.5, 0.5)), motion_of(2, 100_000)
    for function in (chain.function(chain.acceleration()), chain.numeric.acceleration):
        function(*state[:3])
        assert calls(lambda f=function: f(*state[:3])) < 2_000


def test_the_ellipse_of_a_square_elbow_is_golden():
    """Two links of 1 m, elbow at 90 degrees: J J^T = ((2, -1), (-1, 1)), semi-axes phi and 1/phi, manipulability sin 90 = 1."""
    chain, golden = Chain(2, lengths=(1.0, 1.0)), (1.0 + np.sqrt(5.0)) / 2.0
    velocity, force = (chain.ellipse([0.0, np.pi / 2], kind) for kind in ("velocity", "force"))
    for ellipse in (velocity, force):
        assert np.allclose(ellipse.semi_axes, [golden, 1.0 / golden], atol=1e-14)
        assert np.allclose(ellipse.centre, [1.0, 1.0]) and abs(ellipse.manipulability - 1.0) < 1e-14
    assert np.abs(velocity.directions[:, ::-1] - force.directions).max() < 1e-14


@pytest.mark.parametrize("n", [2, 3, 6])
def test_ellipses_bound_what_unit_rates_and_unit_torques_do(n):
    """On the velocity ellipse v^T (J J^T)^-1 v = 1; on the force ellipse |J^T f| = 1; sqrt(det J J^T) is the manipulability."""
    chain, q = chain_of(n), motion_of(n)[0, 0]
    J = chain.numeric.jacobian(q)
    v, f = (chain.ellipse(q, kind).points(50) - chain.numeric.position(q) for kind in ("velocity", "force"))
    assert np.allclose(np.einsum("ka,ab,kb->k", v, np.linalg.inv(J @ J.T), v), 1.0)
    assert np.allclose(np.linalg.norm(f @ J, axis=1), 1.0)
    assert np.isclose(chain.ellipse(q).manipulability, np.sqrt(np.linalg.det(J @ J.T)))


def test_a_stretched_arm_has_a_flat_ellipse_and_pushes_without_end():
    """Two links of 1 m along x: only y moves, at sqrt(5) m/s; along x any force is held."""
    chain = Chain(2, lengths=(1.0, 1.0))
    velocity, force = chain.ellipse([0.0, 0.0]), chain.ellipse([0.0, 0.0], "force")
    assert np.allclose(velocity.semi_axes, [np.sqrt(5.0), 0.0]) and velocity.is_singular and velocity.manipulability == 0.0
    assert np.allclose(velocity.directions, [[0, 1], [1, 0]]) and np.allclose(force.directions, np.eye(2))
    assert force.semi_axes[0] == np.inf and np.isclose(force.semi_axes[1], 1 / np.sqrt(5.0))
    assert np.allclose(force.points(5, longest=3.0)[0], [5.0, 0.0])
    with pytest.raises(InputError, match="infinite axis"):
        force.points()
    assert Chain(1, lengths=(2.0,)).ellipse([0.3]).is_singular


def test_wrong_ellipses_are_refused():
    """Another word, another shape, symbols, no joint, wrong numbers of points."""
    chain = Chain(2, lengths=(0.5, 0.5))
    with pytest.raises(InputError, match="nearest: 'velocity'"):
        chain.ellipse([0, 1], "velocities")
    for attempt in (
        lambda: chain.ellipse([0, 1, 2]), lambda: chain.ellipse([[0, 1]]), lambda: Chain(2).ellipse([0, 1]),
        lambda: chain.ellipse([0, 1], i=0), lambda: chain.ellipse([0, 1], ["force"]), lambda: chain.ellipse([0, 1]).points(2),
        lambda: chain.ellipse([0, 1]).points(scale=-1.0), lambda: chain.ellipse([0, 1]).points(scale="a"),
    ):  # fmt: skip
        with pytest.raises(InputError):
            attempt()
