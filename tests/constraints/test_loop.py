"""Loops: two frames kept together, in mechanisms whose motion is known."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.constraints.loop import KINDS
from rbd.model.checked_model import CheckedModel
from rbd.testing import check_constraint

G = 9.81
HERE = pin.SE3.Identity()
ROWS = KINDS
MORE = {"universal": {"axis_b": (0.1, 0.7, -0.2)}, "rod": {"length": 0.3}, "rope": {"length": 0.2, "margin": 1.0}}
SOLVERS = [rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()]
EACH_SOLVER = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)


def at(x: float, y: float = 0.0, z: float = 0.0) -> pin.SE3:
    """A placement without a turn."""
    return pin.SE3(np.eye(3), np.array([x, y, z]))


def bar(model: pin.Model, parent: int, name: str, length: float, where: pin.SE3, mass: float = 1.0) -> int:
    """A uniform bar along x on a hinge about z, with a frame "<name>_tip" at its end; gravity is along -y."""
    model.gravity.linear = np.array([0.0, -G, 0.0])
    joint = model.addJoint(parent, pin.JointModelRZ(), where, name)
    rod = np.diag([1e-3, 1.0, 1.0]) * mass * length**2 / 12.0
    model.appendBodyToJoint(joint, pin.Inertia(mass, np.array([0.5 * length, 0.0, 0.0]), rod), HERE)
    model.addFrame(pin.Frame(f"{name}_tip", joint, 0, at(length), pin.FrameType.OP_FRAME))
    return joint


def robot(model: pin.Model, passive: bool = True) -> CheckedModel:
    """The model without limits and without motors."""
    return CheckedModel(model, passive=list(model.names)[1:] if passive else (), name="mechanism")


def marked(model: pin.Model, name: str, joint: int, X: pin.SE3 = HERE) -> None:
    """A frame fixed to a joint's body."""
    model.addFrame(pin.Frame(name, joint, 0, X, pin.FrameType.OP_FRAME))


@pytest.fixture(scope="module")
def bent(talos: rbd.Robot) -> rbd.State:
    """Talos in no particular pose, moving: no loop of it is closed."""
    rng = np.random.default_rng(0)
    q = pin.integrate(talos.model, talos.standing().q, 0.5 * rng.normal(size=talos.nv))
    return talos.at(q, 0.5 * rng.normal(size=talos.nv))


@pytest.mark.parametrize("kind", ROWS)
@pytest.mark.parametrize(
    "frames", [("left_sole_link", "right_sole_link"), ("universe", "torso_2_link"), ("torso_2_link", "universe")]
)
def test_a_loop_describes_its_motion_where_it_is_open_too(bent, kind, frames):
    """J v and J a + J_dot v are the first two derivatives of the error, a metre and a radian off closure."""
    loop = rbd.LoopClosure("loop", *frames, kind=kind, axis=(0.3, -0.5, 0.4), **MORE.get(kind, {}))
    report = check_constraint(loop, bent)
    assert report.rows == ROWS[kind] and report.against == "motion of the error"
    assert np.abs(loop.rows(bent).error).max() > 0.05
    assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-8


@pytest.mark.parametrize("kind", ["revolute", "planar"])
def test_the_length_of_the_axis_changes_no_row(bent, kind):
    """A direction of length 1, 2 or 0.05: the same errors, Jacobian and forces, and an axis of length 1."""
    axis = np.array([0.36, -0.48, 0.8])
    one = rbd.LoopClosure("loop", "left_sole_link", "right_sole_link", kind=kind, axis=axis)
    expected = one.rows(bent)
    for length in (2.0, 0.05):
        loop = rbd.LoopClosure("loop", "left_sole_link", "right_sole_link", kind=kind, axis=length * axis)
        rows = loop.rows(bent)
        assert np.linalg.norm(loop.axis) == pytest.approx(1.0, abs=1e-15)
        for name in ("J", "bias", "velocity", "error", "resultant"):
            assert getattr(rows, name) == pytest.approx(getattr(expected, name), rel=1e-13, abs=1e-13), name


@pytest.mark.filterwarnings("ignore::rbd.errors.LoopNotClosedWarning")  # left open on purpose
@pytest.mark.parametrize("kind", [kind for kind in ROWS if kind != "rope"])
def test_a_loop_inside_a_robot_changes_nobodys_momentum(bent, kind):
    """Its base columns vanish, open as it is: opposite forces along one line. So the centroidal check holds."""
    loop = rbd.LoopClosure("loop", "left_sole_link", "right_sole_link", kind=kind, **MORE.get(kind, {}))
    J = loop.rows(bent).J
    assert np.abs(J[:, :6]).max() < 1e-14 < 0.1 < np.abs(J[:, 6:]).max()
    s = rbd.solve(bent, np.zeros(bent.robot.nu), [loop, *bent.robot.soles(None, on=None)[:1]], solver=rbd.KKT())
    assert s.status == "solved" and s.residuals.centroidal.scaled < 1e-12


@pytest.mark.parametrize(("kind", "angle"), [(k, a) for k in ("revolute", "rigid") for a in (1e-9, 0.3, 2.0, 3.1)])
def test_the_turn_of_a_loop_is_twice_the_sine_of_half_the_angle(kind, angle):
    """About an axis across the hinge; and to third order it is the angle."""
    model = pin.Model()
    ball = model.addJoint(0, pin.JointModelSpherical(), HERE, "ball")
    model.appendBodyToJoint(ball, pin.Inertia.Random(), HERE)
    marked(model, "body", ball)
    q = pin.Quaternion(pin.exp3(np.array([0.6, 0.8, 0.0]) * angle)).coeffs()
    rows = rbd.LoopClosure("loop", "universe", "body", kind=kind).rows(rbd.State(robot(model), q))
    expected = 2.0 * np.sin(0.5 * angle) * np.array([0.6, 0.8, 0.0])[: len(rows) - 3]
    assert np.abs(rows.error - np.r_[np.zeros(3), expected]).max() < 1e-13  # at 3.1 rad 1 + cos is left with 13 digits


@pytest.mark.parametrize("kind", ROWS)
def test_newton_on_the_error_converges_quadratically(bent, kind):
    """From half a metre and half a radian: right J, off closure, squares the error in each step."""
    loop = rbd.LoopClosure("loop", "arm_left_7_link", "arm_right_7_link", kind=kind, **MORE.get(kind, {}))
    state, errors = bent.robot.standing(), []
    for _ in range(12):
        rows = loop.rows(state)
        errors.append(np.abs(rows.error).max())
        if errors[-1] < 1e-13:
            break
        state = rbd.State(state.robot, pin.integrate(state.robot.model, state.q, -np.linalg.pinv(rows.J) @ rows.error))
    assert errors[0] > 0.3 and errors[-1] < 1e-13
    near = [i for i, e in enumerate(errors[:-1]) if e < 1e-2]
    assert near and all(errors[i + 1] < 10.0 * errors[i] ** 2 + 1e-14 for i in near)


def _two_bodies(kind: str, seed: int) -> tuple[rbd.State, rbd.State, rbd.LoopClosure, np.ndarray]:
    """A tree of two bodies at a state, the same two bodies cut apart at the same state, and the loop that joins them.

    Also the wrench on the second body at the joint, world axes, from Pinocchio's inverse dynamics of the tree.
    """
    rng = np.random.default_rng(seed)
    axis, across = np.array([0.0, 0.0, 1.0]), {"axis_b": (1.0, 0.0, 0.0)} if kind == "universal" else {}
    joints = {
        "point": [pin.JointModelSpherical()], "revolute": [pin.JointModelRZ()], "rigid": [], "prismatic": [pin.JointModelPZ()],
        "cylindrical": [pin.JointModelRZ(), pin.JointModelPZ()], "universal": [pin.JointModelRZ(), pin.JointModelRX()],
    }  # fmt: skip
    first, second = pin.Inertia.Random(), pin.Inertia.Random()
    X_12 = pin.SE3(pin.exp3(rng.normal(size=3)), rng.normal(size=3))
    tree, cut = pin.Model(), pin.Model()
    for model in (tree, cut):
        base = model.addJoint(0, pin.JointModelFreeFlyer(), HERE, "one")
        model.appendBodyToJoint(base, first, HERE)
        marked(model, "a", base, X_12)
    last = 1
    for i, joint in enumerate(joints[kind]):
        last = tree.addJoint(last, joint, HERE if i else X_12, f"joint {i}")
    tree.appendBodyToJoint(last, second, HERE if last > 1 else X_12)
    other = cut.addJoint(0, pin.JointModelFreeFlyer(), HERE, "two")
    cut.appendBodyToJoint(other, second, HERE)
    marked(cut, "b", other)
    whole = robot(tree)
    q, v = pin.integrate(tree, pin.neutral(tree), rng.normal(size=tree.nv)), rng.normal(size=tree.nv)
    joined = rbd.State(whole, q, v)
    a = rbd.solve(joined, np.zeros(0)).a
    data = tree.createData()
    pin.forwardKinematics(tree, data, q, v, a)
    X_W1 = data.oMi[1]
    X_W2 = data.oMi[last] if last > 1 else X_W1 * X_12
    v_2 = X_W2.actInv(X_W1.act(data.v[1])) if last == 1 else data.v[last]
    apart = rbd.State(robot(cut), np.r_[pin.SE3ToXYZQUAT(X_W1), pin.SE3ToXYZQUAT(X_W2)], np.r_[v[:6], v_2.vector])
    if last > 1:
        pin.rnea(tree, data, q, v, a)
        f = data.f[last]
    else:
        a_2 = X_12.actInv(data.a[1] - X_W1.actInv(pin.Motion(tree.gravity.vector)))
        v_2 = X_12.actInv(data.v[1])
        f = second * a_2 + (v_2 ^ (second * v_2))
    wrench = np.r_[X_W2.rotation @ f.linear, X_W2.rotation @ f.angular]
    return joined, apart, rbd.LoopClosure("loop", "a", "b", kind=kind, axis=axis, **across), wrench


@EACH_SOLVER
@pytest.mark.parametrize("kind", ["point", "revolute", "rigid", "prismatic", "cylindrical", "universal"])
def test_a_joint_cut_open_and_closed_by_a_loop_moves_as_before(kind, solver):
    """Two bodies in free flight with the joint in the tree, and as a loop: the same motion, and the joint's own wrench."""
    pin.seed(4)
    for seed in range(3):
        joined, apart, loop, wrench = _two_bodies(kind, seed)
        assert np.abs(loop.rows(apart).error).max() < 1e-14 and loop.rows(apart).speed < 1e-13
        s = rbd.solve(apart, np.zeros(0), [loop], solver=solver)
        expected = rbd.solve(joined, np.zeros(0)).a
        assert np.abs(s.a[:6] - expected[:6]).max() < 1e-8 * max(1.0, np.abs(expected).max())
        assert np.abs(s.forces["loop"] - wrench[: len(s.forces["loop"])]).max() < 1e-8 * max(1.0, np.abs(wrench).max())


@pytest.mark.parametrize("ground", ["universe", "wall"])
@pytest.mark.parametrize("turned", [False, True])
def test_a_loop_with_the_ground_gives_the_force_on_the_robot(turned, ground):
    """A bar that hangs from a nail is carried by m g upwards, whichever frame is named first, whatever the ground's name."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), HERE, "base")
    model.appendBodyToJoint(base, pin.Inertia(2.0, np.array([0.0, 0.0, -0.5]), np.eye(3)), HERE)
    marked(model, "nail", base)
    marked(model, "wall", 0)
    frames = ("nail", ground) if turned else (ground, "nail")
    state = rbd.State(robot(model), pin.neutral(model))
    for kind in ("point", "revolute", "rigid"):
        s = rbd.solve(state, np.zeros(0), [rbd.LoopClosure("nail", *frames, kind=kind, axis=(1, 0, 0))])
        assert np.abs(s.a).max() < 1e-12
        assert np.abs(s.forces["nail"][:3] - [0.0, 0.0, 2.0 * G]).max() < 1e-10
        assert s.residuals.centroidal is not None and s.residuals.centroidal < 1e-10


def test_a_box_on_a_hinge_of_the_ground_is_a_pendulum():
    """It has th'' = -m g l sin(th) / (I + m l^2); the hinge carries m (g cos + l w^2) along, m (g sin + l th'') across."""
    m, l, I, angle, w = 3.0, 0.4, 0.05, 0.7, 1.3
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), HERE, "base")
    model.appendBodyToJoint(base, pin.Inertia(m, np.array([0.0, 0.0, -l]), I * np.eye(3)), HERE)
    marked(model, "hinge", base)
    R = pin.exp3(np.array([angle, 0.0, 0.0]))
    state = rbd.State(robot(model), pin.SE3ToXYZQUAT(pin.SE3(R, np.zeros(3))), np.r_[0.0, 0.0, 0.0, w, 0.0, 0.0])
    loop = rbd.LoopClosure("hinge", "universe", "hinge", kind="revolute", axis=(1, 0, 0))
    turn = -m * G * l * np.sin(angle) / (I + m * l**2)
    for solver in SOLVERS:
        s = rbd.solve(state, np.zeros(0), [loop], solver=solver)
        assert np.abs(s.a - [0, 0, 0, turn, 0, 0]).max() < 1e-9
        carried = R.T @ s.forces["hinge"][:3]
        expected = [0.0, m * (G * np.sin(angle) + l * turn), m * (G * np.cos(angle) + l * w**2)]
        assert np.abs(carried - expected).max() < 1e-8 and np.abs(s.forces["hinge"][3:]).max() < 1e-8


def _cranks(n: int) -> tuple[CheckedModel, list[rbd.LoopClosure]]:
    """IFToMM A02: n + 1 cranks on the ground 1 m apart, n couplers hinged in a row from the first crank's tip."""
    model = pin.Model()
    at_tip = bar(model, 0, "crank0", 1.0, HERE)
    loops = []
    for i in range(1, n + 1):
        at_tip = bar(model, at_tip, f"coupler{i}", 1.0, at(1.0))
    for i in range(1, n + 1):  # after the chain: Pinocchio wants each branch in one piece
        bar(model, 0, f"crank{i}", 1.0, at(float(i)))
        loops.append(rbd.LoopClosure(f"pin{i}", f"crank{i}_tip", f"coupler{i}_tip", kind="planar"))
    return robot(model), loops


@EACH_SOLVER
@pytest.mark.parametrize("n", [1, 2, 5])
@pytest.mark.parametrize("angle", [0.4, 1.9, -2.5])
def test_n_four_bars_swing_as_one_and_load_their_pins(n, angle, solver):
    """[(N+1)/3 + N] phi'' = -[(N+1)/2 + N] g cos phi (IFToMM A02), and the pins' forces by Newton and Euler, bar by bar.

    A coupler moves with p'' on a circle and does not turn, so its two ends carry equal shares k/2 of k = p''_y + g; an inner
    pin carries those of two couplers. Along x the pin at crank i carries what turns that crank.
    """
    model, loops = _cranks(n)
    names, c, s_, rate = list(model.model.names)[1:], np.cos(angle), np.sin(angle), 1.7
    q = np.array([angle if name.startswith("crank") else (-angle if name == "coupler1" else 0.0) for name in names])
    v = np.array([1.0 if name.startswith("crank") else (-1.0 if name == "coupler1" else 0.0) for name in names]) * rate
    s = rbd.solve(rbd.State(model, q, v), np.zeros(0), loops, solver=solver)
    swing = -((n + 1) / 2 + n) * G * c / ((n + 1) / 3 + n)
    expected = np.where(v == 0.0, 0.0, np.sign(v)) * swing
    assert np.abs(s.a - expected).max() < 1e-8
    k = swing * c - rate**2 * s_ + G
    for i in range(1, n + 1):
        up = 0.5 * k if i == n else k
        along = (swing / 3 + 0.5 * G * c + c * up) / s_
        assert np.abs(s.forces[f"pin{i}"] - [along, up, 0.0]).max() < 1e-8 * max(1.0, abs(along))


@EACH_SOLVER
def test_a_slider_crank_moves_as_its_closed_form(solver):
    """One equation for the crank's angle: m(th) th'' + m'(th) th'^2 / 2 = -V'(th), sin(beta) = r/l sin(th)."""
    r, l, m_r, m_l, m_s, th, rate = 0.3, 0.8, 1.2, 2.0, 3.0, 0.9, -2.2
    model = pin.Model()
    crank = bar(model, 0, "crank", r, HERE, m_r)
    bar(model, crank, "rod", l, at(r), m_l)
    slider = model.addJoint(0, pin.JointModelPX(), HERE, "slider")
    model.appendBodyToJoint(slider, pin.Inertia(m_s, np.zeros(3), 0.01 * np.eye(3)), HERE)
    marked(model, "slide", slider)
    beta = np.arcsin(r / l * np.sin(th))
    c, s_, cb, sb = np.cos(th), np.sin(th), np.cos(beta), np.sin(beta)
    b1 = r * c / (l * cb)
    b2 = (-r * s_ + l * sb * b1**2) / (l * cb)
    x1, x2 = -r * s_ - l * sb * b1, -r * c - l * cb * b1**2 - l * sb * b2
    gx1, gx2 = -r * s_ - 0.5 * l * sb * b1, -r * c - 0.5 * l * (cb * b1**2 + sb * b2)
    gy1, gy2 = 0.5 * r * c, -0.5 * r * s_
    I_r, I_l = m_r * r**2 / 3.0, m_l * l**2 / 12.0
    inertia = I_r + m_l * (gx1**2 + gy1**2) + I_l * b1**2 + m_s * x1**2
    half_rate = m_l * (gx1 * gx2 + gy1 * gy2) + I_l * b1 * b2 + m_s * x1 * x2
    turn = -(half_rate * rate**2 + G * (0.5 * m_r * r * c + m_l * gy1)) / inertia
    q = np.array([th, -beta - th, r * c + l * cb])
    v = rate * np.array([1.0, -b1 - 1.0, x1])
    state = rbd.State(robot(model), q, v)
    loop = rbd.LoopClosure("pin", "rod_tip", "slide", kind="planar")
    s = rbd.solve(state, np.zeros(0), [loop], solver=solver)
    expected = turn * np.array([1.0, -b1 - 1.0, x1]) + rate**2 * np.array([0.0, -b2, x2])
    assert loop.rows(state).speed < 1e-14 and np.abs(s.a - expected).max() < 1e-9
    assert abs(s.forces["pin"][0] - m_s * expected[2]) < 1e-8  # the guide has no friction: the pin alone moves the slider


@EACH_SOLVER
@pytest.mark.parametrize(("kind", "rank"), [("planar", 2), ("point", 2), ("rigid", 3)])
def test_spurious_rows_of_a_planar_loop_are_told_and_do_no_harm(kind, rank, solver):
    """A four-bar: 2 rows of rank 2 when planar, 3 of rank 2; with a bush (m, I) on its fourth pin, welded on, 6 of rank 3."""
    model, m, I = pin.Model(), 0.0, 0.0
    crank = bar(model, 0, "crank", 1.0, HERE)
    coupler = bar(model, crank, "coupler", 1.0, at(1.0))
    if kind == "rigid":
        m, I = 0.3, 0.1
        bush = model.addJoint(coupler, pin.JointModelRZ(), at(1.0), "bush")
        model.appendBodyToJoint(bush, pin.Inertia(m, np.zeros(3), I * np.eye(3)), HERE)
        marked(model, "welded", bush)
    bar(model, 0, "rocker", 1.0, at(1.0))
    turn = 0.8
    q, v = np.array([turn, -turn, turn]), np.array([1.0, -1.0, 1.0])
    if kind == "rigid":
        q, v = np.insert(q, 2, turn), np.insert(v, 2, 1.0)
    state = rbd.State(robot(model), q, v)
    loop = rbd.LoopClosure("pin", "welded" if kind == "rigid" else "coupler_tip", "rocker_tip", kind=kind)
    s = rbd.solve(state, np.zeros(0), [loop], solver=solver)
    assert s.status == "solved" and (len(loop.rows(state)), s.rank) == (ROWS[kind], rank)
    swing = -(2.0 + m) * G * np.cos(turn) / (5.0 / 3.0 + m + I)
    assert np.abs(s.a - swing * v).max() < 1e-8


@EACH_SOLVER
def test_an_over_constrained_parallelogram_moves_and_its_rank_is_told(solver):
    """A third crank in the middle of one coupler of 2 m, 2 kg: 4 rows of rank 3, the same swing whatever the shares."""
    model = pin.Model()
    crank = bar(model, 0, "crank0", 1.0, HERE)
    coupler = bar(model, crank, "coupler", 2.0, at(1.0), 2.0)
    marked(model, "middle", coupler, at(1.0))
    bar(model, 0, "crank1", 1.0, at(1.0))
    bar(model, 0, "crank2", 1.0, at(2.0))
    turn, rate = 1.1, 0.6
    state = rbd.State(robot(model), np.array([turn, -turn, turn, turn]), rate * np.array([1.0, -1.0, 1.0, 1.0]))
    loops = [
        rbd.LoopClosure("inner", "crank1_tip", "middle", kind="planar"),
        rbd.LoopClosure("outer", "crank2_tip", "coupler_tip", kind="planar"),
    ]
    s = rbd.solve(state, np.zeros(0), loops, solver=solver)
    swing = -3.5 * G * np.cos(turn) / 3.0
    assert (s.problem.m, s.rank) == (4, 3) and s.status == "solved"
    assert np.abs(s.a - swing * np.array([1.0, -1.0, 1.0, 1.0])).max() < 1e-8
    assert s.force_choice == "minimum norm of the corner forces [N]"


def test_a_four_bar_without_motors_holds_still_where_it_hangs():
    """Ground 2 m, three bars of 4 m and 20 kg (Drake's example): it hangs at arccos(1/4), 75.5225 deg, and nowhere near."""
    model = pin.Model()
    left = bar(model, 0, "left", 4.0, HERE, 20.0)
    bar(model, left, "across", 4.0, at(4.0), 20.0)
    bar(model, 0, "right", 4.0, at(2.0), 20.0)
    steep = np.arccos(0.25)
    assert np.rad2deg(steep) == pytest.approx(75.5225, abs=5e-5)
    loop = rbd.LoopClosure("pin", "across_tip", "right_tip", kind="planar")
    hanging = rbd.State(robot(model), np.array([-np.pi + steep, np.pi - steep, -steep]))
    assert np.abs(loop.rows(hanging).error).max() < 1e-14
    held = rbd.hold(hanging, [loop])
    assert held.residuals.stationarity < 1e-8 and held.tau.shape == (0,)
    assert np.abs(rbd.solve(hanging, np.zeros(0), [loop]).a).max() < 1e-10
    q = hanging.q.copy()
    q[0] += 0.02
    for _ in range(8):  # closed again, aside
        rows = loop.rows(rbd.State(robot(model), q))
        q[1:] -= np.linalg.solve(rows.J[:, 1:], rows.error)
    with pytest.raises(rbd.CannotHold):
        rbd.hold(rbd.State(robot(model), q), [loop])


@pytest.mark.filterwarnings("ignore::rbd.errors.LoopNotClosedWarning")  # left open on purpose
def test_a_loop_has_derivatives_of_the_answer():
    """How a and the pin's force of a swinging four-bar change with q and v, against differences of the answers."""
    model, loops = _cranks(1)
    q, v = np.array([0.4, -0.5, 0.6]), np.array([1.0, -0.7, 0.8])  # a loop that is a little open, and opening

    def answer(dq: np.ndarray, dv: np.ndarray) -> rbd.Solution:
        return rbd.solve(rbd.State(model, q + dq, v + dv), np.zeros(0), loops, solver=rbd.KKT())

    d, none, h = answer(np.zeros(3), np.zeros(3)).derivatives(), np.zeros(3), 1e-5
    for i, e in enumerate(h * np.eye(3)):
        for found, force, pair in (
            (d.da_dq, d.forces["pin1"].dq, (answer(e, none), answer(-e, none))),
            (d.da_dv, d.forces["pin1"].dv, (answer(none, e), answer(none, -e))),
        ):
            change = (pair[0].a - pair[1].a) / (2.0 * h)
            assert np.abs(found[:, i] - change).max() < 1e-6 * max(1.0, np.abs(change).max())
            change = (pair[0].forces["pin1"] - pair[1].forces["pin1"]) / (2.0 * h)
            assert np.abs(force[:, i] - change).max() < 1e-6 * max(1.0, np.abs(change).max())


def test_a_planar_loop_overlooks_what_is_across_its_plane():
    """Links that lie on top of each other: the frames are 3 cm apart along the axis, and the pin carries nothing along it."""
    model, loops = _cranks(1)
    raised = model.model.copy()
    raised.frames[raised.getFrameId("crank1_tip")].placement = at(1.0, 0.0, 0.03)
    q, v = np.array([0.4, -0.4, 0.4]), np.zeros(3)
    one, other = (rbd.solve(rbd.State(m, q, v), np.zeros(0), loops) for m in (model, robot(raised)))
    assert np.abs(one.a - other.a).max() < 1e-12 and other.forces["pin1"][2] == 0.0


def test_hinges_with_opposite_axes_are_refused():
    """Turned over, the way back is not one way; a weld turned by 180 deg is answered."""
    model = pin.Model()
    base = model.addJoint(0, pin.JointModelFreeFlyer(), HERE, "base")
    model.appendBodyToJoint(base, pin.Inertia.Random(), HERE)
    marked(model, "body", base, pin.SE3(pin.exp3(np.array([np.pi, 0.0, 0.0])), np.zeros(3)))
    state = rbd.State(robot(model), pin.neutral(model))
    with pytest.raises(rbd.InputError, match="opposite.*Turn one of the frames over"):
        rbd.LoopClosure("hinge", "universe", "body", kind="revolute").rows(state)
    assert np.linalg.norm(rbd.LoopClosure("weld", "universe", "body", kind="rigid").rows(state).error) == pytest.approx(2.0)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"kind": "hinge"}, "kind of loop 'loop' is 'hinge'; .* Expected one of point, revolute, rigid, planar"),
        ({"kind": None}, "Expected one of point"),
        ({"axis": (0, 0, 0)}, "has length 0"),
        ({"kind": "universal"}, "'universal' has axis_b = None; expected the axis of the second pin, in frame_b"),
        ({"kind": "universal", "axis_b": (0, 0, 0)}, "axis_b of loop 'loop' has length 0"),
        ({"axis_b": (0, 1, 0)}, "'point' has axis_b = .*None of others"),
        ({"kind": "rod", "length": 0.0}, "length of loop 'loop' is 0.0; expected a length > 0"),
        ({"kind": "rope", "length": np.nan}, "length of loop 'loop' is nan"),
        ({"length": 1.0}, "'point' has a length; only kinds rod and rope"),
        ({"kind": "rope", "margin": -1.0}, "margin of loop"),
        ({"axis": (1, 0)}, "three numbers"),
        ({"axis": (np.nan, 0, 1)}, "not finite"),
        ({"frame_a": ""}, "frame_a of a loop closure"),
        ({"name": 3}, "name of a loop closure"),
        ({"frame_b": "left_sole_link"}, "with itself"),
    ],
)
def test_a_loop_that_says_nothing_is_refused(given, words):
    """With what came and what was expected."""
    with pytest.raises(rbd.InputError, match=words):
        rbd.LoopClosure(**({"name": "loop", "frame_a": "left_sole_link", "frame_b": "right_sole_link"} | given))


def test_frames_that_are_not_there_or_on_one_body_are_refused(talos):
    """Nearest names; and a loop within a body closes nothing."""
    state = talos.standing()
    with pytest.raises(rbd.errors.FrameNotFound, match="right_sole_link"):
        rbd.LoopClosure("loop", "left_sole_link", "right_sole_lin").rows(state)
    with pytest.raises(rbd.InputError, match="one body"):
        rbd.LoopClosure("loop", "left_sole_link", "leg_left_6_link").rows(state)
    with pytest.raises(rbd.InputError, match="want a State"):
        rbd.LoopClosure("loop", "left_sole_link", "right_sole_link").rows(talos)


def test_a_loop_that_is_open_is_solved_with_a_warning():
    """Accelerations say nothing about places: an open loop stays open, and the user is told."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5)
    with pytest.warns(rbd.errors.LoopNotClosedWarning, match="coupler_pin.*is open by.*assemble"):
        rbd.solve(rbd.State(robot, robot.neutral()), np.zeros(1), robot.loops())
    assert rbd.solve(robot.at("assembled"), np.zeros(1), robot.loops()).status == "solved"


def test_the_kind_of_a_loop_is_said_by_its_name():
    """Three words in a row are names; a fourth would be mistaken for one."""
    with pytest.raises(TypeError):
        rbd.LoopClosure("pin", "a", "b", "revolute")  # type: ignore[misc]
