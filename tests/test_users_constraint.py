"""A kind of constraint made outside the package, in one file: a rod of fixed length between two frames; where it runs.

The rod holds a box of mass m at its centre: from the world's origin, a pendulum of length L that does not turn,

    L phi'' = -g sin(phi)        tension = m (g cos(phi) + L phi'^2)

and between the tips of two cranks it is the coupler of a four-bar.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp

import rbd
from rbd.mechanism import assemble, classify, mobility
from rbd.model.checked_model import CheckedModel
from rbd.problem.rows import Patch
from rbd.robots import loop_file
from rbd.testing import box, check_constraint
from rbd.visual import Scene

M, G, L = 10.0, 9.81, 0.8
PHI, RATE = 0.5, 1.2  # [rad], [rad/s]
TENSION = M * (G * np.cos(PHI) + L * RATE**2)


@dataclass(frozen=True)
class Rod:
    """A rod without mass, on ball joints at the origins of two frames."""

    name: str
    frame_a: str
    frame_b: str
    length: float  # [m]

    @property
    def frames(self) -> tuple[str, str]:
        """The frames that it joins."""
        return self.frame_a, self.frame_b

    def loop_dof(self, state: rbd.State, normal: np.ndarray | None) -> int:
        """Of six relative velocities it takes one; of three in a plane too."""
        return 5 if normal is None else 2

    def renamed(self, prefix: str, placement: pin.SE3 | None) -> Rod:
        """The same between the frames of a robot in a pair."""
        a, b = (frame if frame == "universe" else prefix + frame for frame in self.frames)
        return Rod(prefix + self.name, a, b, self.length)

    def rows(self, state: rbd.State) -> rbd.Rows:
        """One row: how fast its ends part; its force pushes them apart."""
        a, b = state.frame(self.frame_a), state.frame(self.frame_b)
        way, v = b.X_WF.translation - a.X_WF.translation, b.v[:3] - a.v[:3]
        far = max(float(np.linalg.norm(way)), 1e-12)  # a robot in no posture may have both ends at one place
        n = way / far
        across = v - (n @ v) * n
        ground = state.robot.site(self.frame_a)[0] == 0
        axes = np.linalg.qr(np.c_[n, np.eye(3)])[0][:, [1, 2, 0]]
        return rbd.Rows(
            self.name,
            J=(n @ (b.J[:3] - a.J[:3]))[None],
            bias=np.array([n @ (b.bias[:3] - a.bias[:3]) + across @ across / far]),
            cone=rbd.problem.Free(1),
            velocity=np.array([n @ v]),
            error=np.array([far - self.length]),
            resultant=n[:, None],  # on the body of frame_b
            patch=Patch(b.X_WF.translation, axes, np.zeros((1, 3)), None, against=None if ground else self.frame_a),
            holonomic=np.array([True]),  # J v is the rate of the error, not of a place along a direction that stays
        )


ROD = Rod("rod", "universe", "box", L)


def hanging(phi: float = PHI, rate: float = RATE) -> rbd.State:
    """The box at an angle from straight down, swinging in the x-z plane."""
    q = np.r_[L * np.sin(phi), 0.0, -L * np.cos(phi), 0.0, 0.0, 0.0, 1.0]
    return rbd.State(box(M), q, L * rate * np.r_[np.cos(phi), 0.0, np.sin(phi), 0.0, 0.0, 0.0])


def swung(t: float) -> tuple[float, float]:
    """Angle and rate of the pendulum at a time."""
    found = solve_ivp(lambda _, y: [y[1], -G / L * np.sin(y[0])], (0.0, t), [PHI, RATE], rtol=1e-12, atol=1e-12)
    return found.y[0, -1], found.y[1, -1]


@pytest.fixture
def word() -> Iterator[str]:
    """The rod's word in loop files, while a test lasts."""
    before = dict(loop_file.KINDS)
    rbd.register_constraint("strut", Rod)
    yield "strut"
    loop_file.KINDS.clear()
    loop_file.KINDS.update(before)


def test_it_describes_its_motion():
    """Between two frames that move, of Talos anyhow; the check that all kinds of the package pass."""
    talos = rbd.load_robot("talos")
    rng = np.random.default_rng(4)
    state = talos.at(pin.integrate(talos.model, talos.standing().q, 0.4 * rng.normal(size=talos.nv)), rng.normal(size=talos.nv))
    report = check_constraint(Rod("rod", "left_sole_link", "gripper_left_base_link", 0.5), state)
    assert max(report.jacobian, report.velocity, report.jdot_v) < 1e-8


@pytest.mark.parametrize("given", [{}, *({"solver": s} for s in (rbd.KKT(), rbd.ProxQP(), rbd.ConeSolver()))], ids=str)
def test_solve_gives_the_tension_of_a_pendulum(given):
    """Tension m (g cos + L w^2) along the rod, and -g sin along the arc."""
    s = rbd.solve(hanging(), np.zeros(0), [ROD], **given)
    along, arc = np.array([np.sin(PHI), 0.0, -np.cos(PHI)]), np.array([np.cos(PHI), 0.0, np.sin(PHI)])
    assert s.forces["rod"] == pytest.approx(-TENSION * along, abs=1e-8) and s.status == "solved"
    assert s.a[:3] == pytest.approx(-G * np.sin(PHI) * arc - L * RATE**2 * along, abs=1e-9)
    assert s.residuals.centroidal.scaled < 1e-9


def test_solve_warns_of_one_that_is_open():
    """As of every joint that closes a loop."""
    with pytest.warns(rbd.errors.LoopNotClosedWarning, match="loop 'rod' is open by 0.1"):
        rbd.solve(hanging(rate=0.0), np.zeros(0), [Rod("rod", "universe", "box", L - 0.1)])


@pytest.mark.parametrize(
    ("integrator", "step", "off"),
    [(rbd.RungeKutta4(), 5e-3, 1e-8), (rbd.DormandPrince8(), 2e-2, 1e-8), (rbd.TimeStepping(), 2e-3, 2e-5)],
    ids=lambda x: type(x).__name__,
)
def test_both_kinds_of_simulation_swing_it(integrator, step, off):
    """Against the pendulum's own equation after 0.6 s; its length is kept, and the tension at the start is that of `solve`."""
    moved = rbd.simulate(hanging(), [ROD], duration=0.6, step=step, integrator=integrator, progress=False)
    phi, rate = swung(0.6)
    end = moved.state(len(moved) - 1)
    assert np.hypot(*end.q[[0, 2]]) == pytest.approx(L, abs=off) and abs(end.q[1]) < off
    assert np.arctan2(end.q[0], -end.q[2]) == pytest.approx(phi, abs=off)
    assert end.v[[0, 2]] == pytest.approx(L * rate * np.array([np.cos(phi), np.sin(phi)]), abs=10 * off)
    assert np.linalg.norm(moved.forces["rod"][0]) == pytest.approx(TENSION, rel=1e-2 if off > 1e-6 else 1e-9)


def two_cranks(u: float = 0.0) -> rbd.State:
    """Cranks of 0.3 and 0.5 m on the ground, 0.6 m apart, the first at 1 rad, turning at u; `tip_1`, `tip_2` are their ends."""
    model = pin.Model()
    for i, (x, length) in enumerate(((0.0, 0.3), (0.6, 0.5)), start=1):
        joint = model.addJoint(0, pin.JointModelRY(), pin.SE3(np.eye(3), np.array([x, 0.0, 0.0])), f"crank_{i}")
        model.appendBodyToJoint(
            joint, pin.Inertia(2.0 * i, np.array([0.5 * length, 0.0, 0.0]), 0.02 * np.eye(3)), pin.SE3.Identity()
        )
        tip = pin.SE3(np.eye(3), np.array([length, 0.0, 0.0]))
        model.addFrame(pin.Frame(f"tip_{i}", joint, 0, tip, pin.FrameType.OP_FRAME))
    return rbd.State(CheckedModel(model, name="two cranks"), np.array([-1.0, -1.8]), np.array([u, 0.0]))


COUPLER = Rod("coupler", "tip_1", "tip_2", 0.55)


def test_assemble_closes_it():
    """Pulled in along the rod, wherever the box is: at a distance L from the origin. Turns are left alone."""
    rng = np.random.default_rng(2)
    for _ in range(5):
        q = pin.integrate(box(M).model, pin.neutral(box(M).model), rng.normal(size=6))
        found = assemble(rbd.State(box(M), q), [ROD])
        assert np.linalg.norm(found.q[:3]) == pytest.approx(L, abs=1e-10)
        assert found.q[3:] == pytest.approx(q[3:], abs=1e-6)


def test_mobility_counts_it_as_a_joint_that_leaves_five_freedoms():
    """6 (2 - 1 - 2) + 6 + 5 = 5 by counting, 6 - rank J = 5 at an instant, and 5 of finite motion."""
    found = mobility(hanging(rate=0.0), [ROD])
    assert (found.count.value, found.instantaneous, found.finite) == (5, 5, 5)
    assert found.count.joint_dof == (6, 5) and found.count.others == 0
    assert not found.velocity_only and not found.redundant


def test_between_two_cranks_it_is_a_couplers_four_bar():
    """Assembled it has one freedom, counted in the plane: 3 (3 - 1 - 3) + 1 + 1 + 2; one loop; and it moves as a function does.

    The rates of the cranks, and their accelerations, are those of |d| - length differenced by `rbd.FunctionConstraint`.
    """
    robot = two_cranks().robot
    state = rbd.State(robot, assemble(two_cranks(), [COUPLER], fixed={"crank_1": -1.0}).q)
    found = mobility(state, [COUPLER])
    assert (found.count.value, found.count.joint_dof, found.finite) == (1, (1, 1, 2), 1) and found.count.planar
    kind = classify(state, [COUPLER])
    assert (kind.loops, kind.mobility) == (1, 1)

    def apart(q: np.ndarray) -> float:
        x1, x2 = (np.array([x + l * np.cos(t), -l * np.sin(t)]) for x, l, t in ((0.0, 0.3, q[0]), (0.6, 0.5, q[1])))
        return float(np.linalg.norm(x2 - x1)) - 0.55

    J = COUPLER.rows(state).J[0]
    moving = state.with_velocity(np.array([1.3, -1.3 * J[0] / J[1]]))
    by_function = rbd.FunctionConstraint("coupler", apart)
    mine, theirs = (rbd.solve(moving, np.zeros(2), [c]) for c in (COUPLER, by_function))
    assert mine.a == pytest.approx(theirs.a, abs=1e-8) and mine.multipliers == pytest.approx(theirs.multipliers, abs=1e-7)
    ends = [rbd.simulate(moving, [c], duration=0.2, step=5e-3, integrator=rbd.RungeKutta4(), progress=False).q[-1]
            for c in (COUPLER, by_function)]  # fmt: skip
    assert ends[0] == pytest.approx(ends[1], abs=1e-9)


def test_its_force_is_unique_and_that_of_two_is_not():
    """One tension; of two rods side by side their sum alone."""
    one = rbd.solve(hanging(), np.zeros(0), [ROD]).uniqueness()
    along = one.contacts["rod"].normal
    assert one.row_freedom == 0 and np.abs([along.lowest, along.highest]) == pytest.approx([TENSION, TENSION])
    twin = Rod("twin", "universe", "box", L)
    solution = rbd.solve(hanging(), np.zeros(0), [ROD, twin])
    two = solution.uniqueness()
    along = two.contacts["rod"].normal
    assert two.row_freedom == 1 and (along.lowest, along.highest) == (-np.inf, np.inf)
    assert [np.linalg.norm(solution.forces[n]) for n in ("rod", "twin")] == pytest.approx([TENSION / 2, TENSION / 2])


def test_a_loop_file_has_it_by_its_word(word: str, tmp_path: Path):
    """Numbers and names of the file, frames looked up on the robot; it moves as the one that is made by hand."""
    path = tmp_path / "box.urdf"
    path.write_text((Path(__file__).parents[1] / "urdf" / "box.urdf").read_text())
    beside = tmp_path / "box.loops.yaml"
    beside.write_text(f"loops: [{{name: rod, kind: {word}, frame_a: universe, frame_b: box, length: {L}}}]")
    robot = rbd.load_robot(path)
    assert robot.loops() == (ROD,)
    state = robot.at(hanging().q, hanging().v)
    assert np.linalg.norm(rbd.solve(state, np.zeros(0), robot.loops()).forces["rod"]) == pytest.approx(TENSION)
    assert mobility(robot.at(hanging().q)).finite == 5  # without constraints named: those of the file
    for text, says in (
        ("frame_b: bax, length: 1", "loop 'rod': no frame 'bax' in box; nearest: 'box'"),
        ("frame_b: box", r"loops\[0\] \('rod'\) has no 'length'"),
        ("frame_b: box, length: 1, width: 2", "has a key 'width'.*name, kind, frame_a, frame_b, length"),
    ):
        beside.write_text(f"loops: [{{name: rod, kind: {word}, frame_a: universe, {text}}}]")
        with pytest.raises(rbd.errors.ModelError, match=says):
            rbd.load_robot(path)


def test_a_word_that_is_not_registered_is_refused_by_name(tmp_path: Path):
    """With the words that there are."""
    path = tmp_path / "x.yaml"
    path.write_text("loops: [{name: rod, kind: strut, frame_a: a, frame_b: b, length: 1}]")
    with pytest.raises(
        rbd.errors.ModelError, match="kind of .*'rod'.* is 'strut'.*Expected one of point, revolute, rigid, planar"
    ):
        loop_file.read_loop_file(path)


def test_it_is_no_coupling(tmp_path: Path, word: None):
    """Its words are read among loops and wheels."""
    path = tmp_path / "x.yaml"
    path.write_text("couplings: [{name: rod, kind: strut, frame_a: a, frame_b: b, length: 1}]")
    with pytest.raises(rbd.errors.ModelError, match="kind of .*'rod'.* is 'strut'.*Expected one of coupling"):
        loop_file.read_loop_file(path)


@pytest.mark.parametrize(
    ("word_", "kind", "says"),
    [
        ("", Rod, "expected a short one"),
        (3, Rod, "expected a short one"),
        ("point", Rod, "stands for .* already"),
        ("knife_edge", rbd.KnifeEdge, "stands for .* already"),
        ("strut", 3, "makes no constraint"),
        ("strut", lambda length: None, "no parameter `name`"),
    ],
)
def test_what_cannot_be_registered_is_refused(word_, kind, says):
    """The word, or what it is to stand for."""
    with pytest.raises(rbd.InputError, match=says):
        rbd.register_constraint(word_, kind)
    assert "strut" not in loop_file.KINDS


def test_a_pair_of_robots_takes_it_along():
    """Made for the second of two boxes, with its names there; what cannot be renamed is refused."""
    pair = rbd.robots.merge_robots(box(1.0), box(M), names=("a_", "b_"))
    (mine,) = pair.contacts(second=[ROD])
    assert mine == Rod("b_rod", "universe", "b_box", L)
    state = pair.at(pair.q(pin.neutral(box().model), hanging().q), np.r_[np.zeros(6), hanging().v])
    assert np.linalg.norm(rbd.solve(state, np.zeros(0), [mine]).forces["b_rod"]) == pytest.approx(TENSION)
    with pytest.raises(rbd.InputError, match="is no contact"):
        pair.contacts([rbd.JointLock("lock", "root_joint")])


def test_the_viewer_draws_its_force():
    """One arrow at the box's centre, as long as the tension, along the rod."""
    state = hanging()
    solution = rbd.solve(state, np.zeros(0), [ROD])
    robot = rbd.load_robot(Path(__file__).parents[1] / "urdf" / "box.urdf")
    scene = Scene(robot)
    scene.show(robot.at(state.q, state.v), solution)
    (drawn,) = scene.contacts
    assert drawn.name == "rod" and np.linalg.norm(drawn.force) == pytest.approx(TENSION)
    assert drawn.start == pytest.approx(state.q[:3]) and np.cross(drawn.force, state.q[:3]) == pytest.approx(
        np.zeros(3), abs=1e-7
    )


@dataclass(frozen=True)
class Buffer:
    """A smooth ball of the robot above z = 0, told by its points: where it is, not only how its rows move."""

    name: str
    frame: str
    radius: float

    def rows(self, state: rbd.State) -> rbd.Rows:
        """One row: the ball's height."""
        p = self.points(state, 0.0)
        return rbd.Rows(self.name, p.J, p.bias, rbd.problem.NonNegative(1), p.velocity, p.gaps, resultant=p.resultant)

    def points(self, state: rbd.State, t: float) -> rbd.constraints.ContactPoints:
        """Its lowest point."""
        at, up = state.frame(self.frame), np.array([0.0, 0.0, 1.0])
        low = at.X_WF.translation - self.radius * up
        J, velocity, bias = at.J[2:3], at.v[2:3], at.bias[2:3]
        return rbd.constraints.ContactPoints(
            ("low",), low[None], np.eye(3), low[2:], J, velocity, bias, (rbd.problem.NonNegative(1),), up[:, None]
        )


def test_a_contact_kind_of_ones_own_strikes_and_rests_as_the_built_in_one():
    """Dropped from 5 cm, a bounce of one half: the same motion, forces and events as of a frictionless `rbd.RollingBall`."""
    start = rbd.State(box(M), np.r_[0.0, 0.0, 0.15, 0.0, 0.0, 0.0, 1.0], np.r_[0.3, 0.0, 0.0, 0.1, 0.2, 0.0])
    both = Buffer("ball", "box", 0.1), rbd.RollingBall("ball", "box", radius=0.1, friction=0.0)
    mine, built_in = (
        rbd.simulate(start, [ball], duration=0.3, step=2e-3, restitution={"ball": 0.5}, progress=False) for ball in both
    )
    fall = np.sqrt(2.0 * 0.05 / G)
    assert mine.events[0].t == pytest.approx(fall, abs=1e-6)
    assert [e.t for e in mine.events] == pytest.approx([e.t for e in built_in.events], abs=1e-9)
    assert np.abs(mine.q - built_in.q).max() < 1e-9 and np.abs(mine.v - built_in.v).max() < 1e-8
    assert mine.forces["ball"][-1] == pytest.approx(built_in.forces["ball"][-1], abs=1e-6)


class _Wrong(Buffer):
    """A buffer one of whose arrays is replaced, among its points alone."""

    def rows(self, state: rbd.State) -> rbd.Rows:
        return Buffer(self.name, self.frame, self.radius).rows(state)

    def points(self, state: rbd.State, t: float) -> rbd.constraints.ContactPoints:
        return dataclasses.replace(super().points(state, t), **WRONG)


WRONG: dict[str, object] = {}


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"gaps": np.array([np.nan])}, r"gaps of the points of 'ball' is array\(\[nan\]\); expected distances"),
        ({"gaps": np.zeros(2)}, r"gaps of the points of 'ball' has shape \(2,\); expected \(1,\)"),
        ({"J": np.full((1, 6), np.inf)}, "J of the points of 'ball' is not finite"),
        ({"J": np.zeros((1, 5))}, r"J of the points of 'ball' has shape \(1, 5\); expected \(1, 6\)"),
        ({"bias": np.zeros(())}, r"bias of the points of 'ball' has shape \(\); expected \(1,\)"),
        ({"velocity": None}, "velocity of the points of 'ball' is None"),
        ({"positions": np.zeros(3)}, r"positions of the points of 'ball' has shape \(3,\); expected \(1, 3\)"),
        ({"axes": None}, "axes of the points of 'ball' is None"),
        ({"resultant": np.zeros((2, 1))}, r"resultant of the points of 'ball' has shape \(2, 1\); expected \(3, 1\) or"),
        ({"cones": ("cone",)}, "expected a label and a set of forces for each point"),
        ({"names": ("low", "high")}, "expected a label and a set of forces for each point"),
    ],
    ids=str,
)
def test_points_that_do_not_fit_are_refused_by_name(wrong, told, monkeypatch):
    """A gap that is no number would let the body fall through its ground."""
    monkeypatch.setitem(globals(), "WRONG", wrong)
    start = rbd.State(box(M), np.r_[0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    with pytest.raises(rbd.InputError, match=told):
        rbd.simulate(start, [_Wrong("ball", "box", 0.1)], duration=0.02, step=2e-3, progress=False)


def test_points_may_be_lists():
    """As other arguments may."""
    start = rbd.State(box(M), np.r_[0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])

    class Listed(Buffer):
        def points(self, state: rbd.State, t: float) -> rbd.constraints.ContactPoints:
            found = super().points(state, t)
            return dataclasses.replace(found, names=["low"], gaps=found.gaps.tolist(), J=found.J.tolist(), cones=[*found.cones])

    moved = rbd.simulate(start, [Listed("ball", "box", 0.1)], duration=0.02, step=2e-3, progress=False)
    assert moved.forces["ball"][-1, -1] == pytest.approx(M * G)


def test_a_constraint_whose_rows_bear_another_name_is_not_simulated():
    """Its forces could not be found under either."""

    class Renamed(Buffer):
        def rows(self, state: rbd.State) -> rbd.Rows:
            return dataclasses.replace(super().rows(state), name="rows")

    start = rbd.State(box(M), np.r_[0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    with pytest.raises(rbd.InputError, match="the rows of constraint 'ball' are named 'rows'; expected the constraint's name"):
        rbd.simulate(start, [Renamed("ball", "box", 0.1)], duration=0.02, step=2e-3, progress=False)


def test_a_constraint_without_a_name_is_not_simulated():
    """An error of the library, not one of Python."""

    class Nameless:
        def rows(self, state: rbd.State) -> rbd.Rows:
            return Buffer("rows", "box", 0.1).rows(state)

    start = rbd.State(box(M), np.r_[0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    with pytest.raises(rbd.InputError, match="it wants a name and rows"):
        rbd.simulate(start, [Nameless()], duration=0.02, step=2e-3, progress=False)
