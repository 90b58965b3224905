"""A loop whose rows are redundant at every closed configuration, and at no other: its derivatives are along the constraints."""

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.manifold import ConstraintManifold
from rbd.model.dynamics import potential_energy
from rbd.robots import Rod

H = 1e-4


@pytest.fixture(scope="module")
def hexagon() -> rbd.Robot:
    """Bricard's six hinges around a cube."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1)], float)
    along = np.roll(corners, -1, axis=0) - corners
    axes = np.cross(np.roll(along, 1, axis=0), along)
    b = rbd.RobotBuilder("bricard", root="fixed")
    for i in range(6):
        b.body(f"bar {i}", Rod((0, 0, 0), along[i], mass=1.0))
        if i:
            b.joint(f"hinge {i}", f"bar {i - 1}", f"bar {i}", at=along[i - 1], axis=axes[i], motor=i == 1)
    b.loop("hinge 0", ("bar 5", along[5]), "bar 0", kind="revolute", axis=axes[0])
    return b.robot()


def closed(robot: rbd.Robot, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(the closed configuration nearest to q, the direction in which it moves)."""
    manifold = ConstraintManifold.unchecked(rbd.State(robot, q), list(robot.loops()))
    found = manifold.project(q)
    way = np.linalg.svd(found.J)[2][-1]
    return found.q, way * np.sign(way[0])


@pytest.mark.parametrize("rate", [0.0, 0.7])
def test_derivatives_along_the_constraints(hexagon: rbd.Robot, rate: float) -> None:
    """Those of a true motion along its one freedom, at rest and moving, by differences of answers."""
    loops, q0 = list(hexagon.loops()), closed(hexagon, hexagon.at().q + 0.3 * np.array([1, -1, 1, -1, 1]))[0]

    def at(h: float) -> tuple[rbd.State, np.ndarray]:
        q, way = closed(hexagon, pin.integrate(hexagon.model, q0, h * closed(hexagon, q0)[1]))
        state = rbd.State(hexagon, q, rate * way)
        return state, rbd.solve(state, [0.5], loops).a

    (back, a_back), (state, _), (ahead, a_ahead) = at(-H), at(0.0), at(H)
    d = rbd.solve(state, [0.5], loops).derivatives()
    assert np.linalg.svd(loops[0].rows(state).J)[1][-1] < 1e-9  # five rows of rank four
    assert d.along_constraints and "along the constraints alone" in str(d)
    told = d.da_dq @ (ahead.q - back.q) + d.da_dv @ (ahead.v - back.v)
    assert told / (2 * H) == pytest.approx((a_ahead - a_back) / (2 * H), abs=1e-6)
    assert np.abs(told).max() / (2 * H) > 0.1
    assert d.da_dq @ np.linalg.svd(closed(hexagon, state.q)[1][None])[2][1:].T == pytest.approx(0.0, abs=1e-9) or rate


def test_its_equilibria(hexagon: rbd.Robot) -> None:
    """The energy along its freedom is flat there, and its curvature over the inertia is the square of the eigenvalue."""
    found = rbd.find_equilibrium(hexagon.at())
    way = closed(hexagon, found.state.q)[1]

    def energy(h: float) -> float:
        return potential_energy(rbd.State(hexagon, closed(hexagon, pin.integrate(hexagon.model, found.state.q, h * way))[0]))

    down, here, up = (energy(h) for h in (-1e-3, 0.0, 1e-3))
    assert abs(up - down) / 2e-3 < 1e-6
    curvature = (up - 2.0 * here + down) / 1e-6 / float(way @ found.state.M @ way)
    assert np.sort((found.linearised.eigenvalues**2).real) == pytest.approx([-curvature] * 2, rel=1e-4)
    assert found.linearised.method == "derivatives"


def parallelogram() -> rbd.Robot:
    """Flat at q = 0, where its two branches meet; without gravity nothing accelerates there."""
    b = rbd.RobotBuilder("parallelogram", root="fixed")
    for name, parent, at, tip in (("a", "ground", 0.0, 0.1), ("b", "a", 0.1, 0.3), ("c", "ground", 0.3, 0.1)):
        b.body(name, Rod((0, 0, 0), (tip, 0, 0), mass=1.0))
        b.joint(f"pin {name}", parent, name, at=(at, 0, 0), axis=(0, -1, 0))
    b.loop("pin", ("b", (0.3, 0, 0)), ("c", (0.1, 0, 0)), kind="planar", axis=(0, -1, 0))
    return b.robot()


def test_a_singular_pose_is_refused() -> None:
    """Two branches meet in it, with gravity and without; a four-bar on its way has no redundant rows."""
    bars = rbd.mechanism.four_bar(0.1, 0.3, 0.2, 0.25)
    assert not rbd.solve(bars.at("assembled"), [0.0], bars.loops()).derivatives().along_constraints
    flat = parallelogram()
    with pytest.raises(rbd.errors.NotDifferentiable, match="not nearby"):
        rbd.solve(flat.at(), [], flat.loops()).derivatives()
    for gravity in ((0.0, 0.0, -9.81), (0.0, 0.0, 0.0)):
        with pytest.raises(rbd.errors.NotDifferentiable, match="singular"):
            rbd.linearise(flat.with_gravity(gravity).at())
    still, q = flat.with_gravity((0.0, 0.0, 0.0)), closed(flat, np.array([0.5, -0.5, 0.5]))[0]
    assert rbd.linearise(still.at(q)).difference < 1e-9
