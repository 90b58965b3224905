"""Many loop closures at once: the same rows as one by one."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.loop import FEWEST, LoopStack
from rbd.constraints.manifold import ConstraintManifold

LINKS = ("arm_left_7_link", "arm_right_7_link", "head_2_link", "torso_2_link")


def closures_of(kind: str, axis: tuple[float, float, float]) -> list[rbd.LoopClosure]:
    """Between limbs of Talos, and from limbs to the ground and back."""
    pairs = [(LINKS[0], LINKS[1]), (LINKS[1], LINKS[2]), (LINKS[0], "universe"), ("universe", LINKS[3])]
    return [rbd.LoopClosure(f"loop {i}", a, b, kind=kind, axis=axis) for i, (a, b) in enumerate(pairs)]


def moved(robot: rbd.Robot, seed: int) -> rbd.State:
    """Anywhere, moving."""
    rng = np.random.default_rng(seed)
    return rbd.State(robot, pin.integrate(robot.model, robot.neutral(), rng.normal(size=robot.nv)), rng.normal(size=robot.nv))


def check_same(state: rbd.State, loops: list[rbd.LoopClosure]) -> None:
    """Each array to rounding of its terms."""
    stack = LoopStack.of(state.robot, loops)
    assert stack is not None
    found = stack.at(state)
    assert len(found) == len(loops) and [r.name for r in found] == [loop.name for loop in loops]
    f = np.random.default_rng(0).normal(size=len(found.J))
    forces = found.forces(f)
    assert list(forces) == [loop.name for loop in loops]
    for loop, r, part in zip(loops, found, stack.spans, strict=True):
        expected = loop.rows(state)
        assert np.abs(forces[loop.name] - expected.resultant @ f[part]).max() < 1e-13
        assert r.cone == expected.cone and not r.stabilised and r.patch is None
        for part in ("J", "bias", "velocity", "error", "resultant"):
            one, other = getattr(r, part), getattr(expected, part)
            assert one.shape == other.shape
            assert np.abs(one - other).max() < 1e-13 * max(10.0, np.abs(other).max()), (loop.name, part)


@pytest.mark.parametrize("kind", ["planar", "point"])
@pytest.mark.parametrize("seed", range(2))
def test_a_stack_has_the_rows_of_its_closures(talos: rbd.Robot, kind: str, seed: int) -> None:
    """On a robot that moves in space, between its limbs and to the ground, about a tilted axis."""
    check_same(moved(talos, seed), closures_of(kind, (0.3, -0.5, 0.8)))


def test_planar_and_point_closures_stand_in_one_stack(talos: rbd.Robot) -> None:
    """In the order given."""
    one, two = closures_of("planar", (0.0, 1.0, 0.0)), closures_of("point", (0.0, 0.0, 1.0))
    check_same(moved(talos, 3), [two[0], one[1], two[2], one[3]])


def test_a_mechanism_takes_the_stack_of_its_loops() -> None:
    """Five four-bars: the manifold's stacked rows are those of its closures, at a state off its loops."""
    robot = rbd.mechanism.n_four_bar(5)
    loops, state = robot.loops(), moved(robot, 1)
    manifold = ConstraintManifold(robot.at("assembled"))
    rows = manifold.rows(state)
    each = [loop.rows(state) for loop in loops]
    for found, part in ((rows.J, "J"), (rows.offset, "bias"), (rows.velocity, "velocity"), (rows.error, "error")):
        assert np.abs(found - np.concatenate([getattr(r, part) for r in each])).max() < 1e-13 * 100.0
    assert rows.placed is None and rows.names == [(loop.name, i) for loop in loops for i in range(2)]
    assert rows.drift == pytest.approx(max(np.abs(r.error).max() for r in each), rel=1e-13)


def test_recorded_forces_of_many_loops_are_those_of_solve() -> None:
    """Three four-bars that swing for a while: the force at each pin, by the motion's rows and by those of each loop."""
    robot = rbd.mechanism.n_four_bar(3)
    upright = robot.at("assembled")
    moving = upright.with_velocity(rbd.mechanism.velocity_partition(upright, robot.loops(), {"crank_0_joint": -1.0}).v)
    swing = rbd.simulate(moving, robot.loops(), duration=0.2, step=1e-2, integrator=rbd.RungeKutta4(), progress=False)
    for k in (0, 11, 20):
        solution = rbd.solve(robot.at(swing.q[k], swing.v[k]), [0.0], robot.loops(), solver=rbd.KKT())
        for name, force in solution.forces.items():
            assert np.abs(swing.forces[name][k] - force).max() < 1e-9 * max(1.0, np.abs(force).max())


def test_other_closures_and_few_have_no_stack(talos: rbd.Robot) -> None:
    """A hinge among them, a constraint of another kind, or fewer than three."""
    points = closures_of("point", (0.0, 0.0, 1.0))
    hinge = rbd.LoopClosure("hinge", *LINKS[:2], kind="revolute")
    assert LoopStack.of(talos, points[: FEWEST - 1]) is None and LoopStack.of(talos, points[:FEWEST]) is not None
    assert LoopStack.of(talos, [*points, hinge]) is None
    assert LoopStack.of(talos, [*points, rbd.JointLock("brake", "torso_1_joint")]) is None
    assert LoopStack.of(talos, []) is None


def test_a_stack_refuses_a_closure_within_one_body(talos: rbd.Robot) -> None:
    """By name, when it is made."""
    with pytest.raises(rbd.InputError, match=r"loop 'none' closes 'arm_left_7_link' with 'arm_left_7_joint'"):
        LoopStack.of(talos, [*closures_of("point", (0, 0, 1)), rbd.LoopClosure("none", LINKS[0], "arm_left_7_joint")])


def test_circles_of_many_joints_are_normalised_together() -> None:
    """Off by 1e-8 they are put back on the circle; off by 1e-3 the joint's numbers are named, as for few joints."""
    robot = rbd.mechanism.n_four_bar(3)
    q = robot.at("assembled").q.copy()
    q[2:4] *= 1.0 + 1e-8
    q[8:10] *= 1.0 - 1e-8
    norms = np.linalg.norm(robot.check_q(q).reshape(-1, 2), axis=1)
    assert np.abs(norms - 1.0).max() < 3e-16
    q[8:10] *= 1.001
    with pytest.raises(rbd.InputError, match=r"q\[8:10\] has the unit circle \(cos, sin\)"):
        robot.check_q(q)
    q[8:10] = 0.0
    with pytest.raises(rbd.InputError, match=r"q\[8:10\] has the unit circle \(cos, sin\) .* of norm 0"):
        robot.check_q(q)
