"""What an answer costs: medians of one run, side by side, as multiples of one `constraintDynamics` call.

Every call has its own q, v and tau. The columns take turns of a few calls, so that a noisy machine troubles them alike. Run by
`make bench`; timing is never part of the tests.
"""

from __future__ import annotations

import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads cost more than they give on 38 x 38 matrices

import statistics
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
from bench_planar import planar_tables
from bench_simulation import simulation_tables
from rich.console import Console
from rich.table import Table

import rbd
from rbd.errors import EffortLimitWarning

DRAWS = 300
MARKS: dict[str, tuple[float, ...]] = {
    "held, ProxQP": (10.0, 8.0),
    "frictional, ProxQP": (25.0, 18.0),
    "frictional, ConeSolver coulomb, sticking": (25.0, 18.0),
    "frictional, ConeSolver coulomb, slipping": (60.0, 40.0),
    "frictional, ConeSolver convex, sticking": (25.0, 18.0),
    "frictional, ConeSolver convex, slipping": (60.0, 40.0),
    "inverse dynamics, no cone at its limit": (12.0,),
    "inverse dynamics, a cone at its limit": (40.0,),
}


ABSOLUTE = {"assemble four-bar": 1.0, "assemble six-bar": 2.0, "load talos": 50.0, "load human": 50.0}
ABSOLUTE |= {"support region, pyramids": 50.0, "support region, cones": 50.0, "72 pushes": 200.0}
"""Marks in milliseconds, of what has no constraintDynamics call to be measured by."""

URDF = Path(__file__).parents[1] / "urdf"


class Draws:
    """Random states and torques of one robot: at rest for frictional soles, moving for held ones."""

    def __init__(self, name: str) -> None:
        self.robot = robot = rbd.load_robot(name)
        rng = np.random.default_rng(7)
        standing = robot.standing()
        tau = rbd.hold(standing, robot.feet()).tau
        dq = 0.02 * rng.normal(size=(DRAWS, robot.nv))
        self.q = [pin.integrate(robot.model, standing.q, d) for d in dq]
        limit = robot.effort_limit
        self.tau = list(np.clip(tau + 5.0 * rng.normal(size=(DRAWS, robot.nu)), -limit, limit))
        self.held = robot.soles(friction=None, on=None)  # postures with noise, soles anywhere
        self.frictional = robot.soles(friction=0.7, on=None)
        self.zero = np.zeros(robot.nv)
        self.sticking = self._draws(rng, tau, 1.0, slips=False)
        self.slipping = self._draws(rng, tau, 30.0, slips=True)
        self.v = [self._resting_soles(q, 0.1 * rng.normal(size=robot.nv)) for q in self.q]
        self.inside, self.at_limit = self._wanted(rng)

    def _draws(self, rng: np.random.Generator, hold: np.ndarray, noise: float, *, slips: bool) -> list[tuple]:
        """(q, tau) where the frictional soles all stick, or where one slips or opens."""
        out: list[tuple] = []
        while len(out) < DRAWS:
            q = self.q[rng.integers(DRAWS)]
            tau = np.clip(hold + noise * rng.normal(size=self.robot.nu), -self.robot.effort_limit, self.robot.effort_limit)
            s = rbd.solve(rbd.State(self.robot, q), tau, self.frictional, solver=rbd.ConeSolver())
            if (max(np.abs(c).max() for c in s.accelerations.values()) > 1e-6) == slips:
                out.append((q, tau))
        return out

    def _wanted(self, rng: np.random.Generator) -> tuple[list[tuple], list[tuple]]:
        """(q, v, a) of motions on both soles where least effort takes no point's friction to its limit, and where it does."""
        inside: list[tuple] = []
        at_limit: list[tuple] = []
        while min(len(inside), len(at_limit)) < DRAWS:
            i = rng.integers(DRAWS)
            state = rbd.State(self.robot, self.q[i], self.v[i])
            free = state.M @ (0.5 * rng.normal(size=self.robot.nv)) + state.h  # the nearest that the soles allow to this
            a = rbd.solve(state, np.zeros(self.robot.nu), self.held, external=free).a
            try:
                found = rbd.inverse_dynamics(state, a, self.frictional)
            except rbd.CannotMove:
                continue
            least = min(float(np.nanmin(f, initial=1.0)) for f in found.margins.corner_friction.values())
            (at_limit if least <= found.margin + 1e-6 else inside).append((self.q[i], self.v[i], a))
        return inside[:DRAWS], at_limit[:DRAWS]

    def _resting_soles(self, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """V with the soles' motion taken out: where a sole moves, constraintDynamics' drift is another one."""
        J = np.concatenate([sole.rows(rbd.State(self.robot, q)).J for sole in self.held])
        return v - np.linalg.lstsq(J, J @ v, rcond=None)[0]


def raw_terms(d: Draws) -> Callable[[int], object]:
    """M, h, joint Jacobians and drift: what any method needs from Pinocchio."""
    model, data = d.robot.model, d.robot.model.createData()

    def run(i: int) -> object:
        pin.crba(model, data, d.q[i], pin.Convention.WORLD)
        pin.nonLinearEffects(model, data, d.q[i], d.v[i])
        pin.forwardKinematics(model, data, d.q[i], d.v[i], d.zero)
        return data.M

    return run


def constraint_dynamics(d: Draws) -> Callable[[int], object]:
    """Pinocchio's own proximal solver for held soles."""
    model, data = d.robot.model, d.robot.model.createData()
    models, datas = pin.StdVec_RigidConstraintModel(), pin.StdVec_RigidConstraintData()
    for sole in d.held:
        f = d.robot.frame(sole.frame)
        m = pin.RigidConstraintModel(
            pin.ContactType.CONTACT_6D, model, f.parentJoint, f.placement * sole.placement, pin.ReferenceFrame.LOCAL
        )
        models.append(m)
        datas.append(m.createData())
    pin.initConstraintDynamics(model, data, models, datas)
    settings = pin.ProximalSettings(1e-12, 1e-12, 1e-8, 10)
    tau = [np.concatenate([np.zeros(6), t]) for t in d.tau]

    def run(i: int) -> np.ndarray:
        return pin.constraintDynamics(model, data, d.q[i], d.v[i], tau[i], models, datas, settings)

    return run


def plain_script(d: Draws) -> Callable[[int], object]:
    """What one writes in ten lines with Pinocchio and NumPy for held soles, unchecked."""
    model, data = d.robot.model, d.robot.model.createData()
    ids = [model.getFrameId(sole.frame) for sole in d.held]
    lwa = pin.LOCAL_WORLD_ALIGNED

    def run(i: int) -> np.ndarray:
        q, v, n = d.q[i], d.v[i], model.nv
        pin.crba(model, data, q)
        pin.nonLinearEffects(model, data, q, v)
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, v, d.zero)
        pin.updateFramePlacements(model, data)
        J = np.vstack([pin.getFrameJacobian(model, data, f, lwa) for f in ids])
        bias = np.concatenate([pin.getFrameClassicalAcceleration(model, data, f, lwa).vector for f in ids])
        m = len(J)
        K = np.block([[data.M, J.T], [J, np.zeros((m, m))]])
        rhs = np.concatenate([np.concatenate([np.zeros(6), d.tau[i]]) - data.nle, -bias])
        return np.linalg.solve(K, rhs)[:n]

    return run


def ours(d: Draws, kind: str, solver: rbd.ProxQP | rbd.KKT | None) -> Callable[[int], object]:
    """The whole pipeline from (q, v, tau) to a certified answer."""
    contacts = d.held if kind == "held" else d.frictional

    def run(i: int) -> rbd.Solution:
        v = d.v[i] if kind == "held" else None
        return rbd.solve(rbd.State(d.robot, d.q[i], v), d.tau[i], contacts, solver=solver)

    return run


def rubbing(d: Draws, solver: rbd.ConeSolver | rbd.ProxQP | None, draws: list[tuple]) -> Callable[[int], object]:
    """The whole pipeline with frictional soles, on draws that all stick or all slip."""

    def run(i: int) -> rbd.Solution:
        q, tau = draws[i]
        return rbd.solve(rbd.State(d.robot, q), tau, d.frictional, solver=solver)

    return run


def commanded(d: Draws, draws: list[tuple]) -> Callable[[int], object]:
    """Torques and forces of least effort from (q, v, a), with their residuals."""

    def run(i: int) -> rbd.Actuation:
        q, v, a = draws[i]
        return rbd.inverse_dynamics(rbd.State(d.robot, q, v), a, d.frictional)

    return run


def agree(d: Draws) -> float:
    """Largest difference between constraintDynamics and our held accelerations, relative."""
    theirs, mine = constraint_dynamics(d), ours(d, "held", rbd.ProxQP())
    worst = 0.0
    for i in range(20):
        a = mine(i).a  # type: ignore[attr-defined]
        worst = max(worst, float(np.abs(theirs(i) - a).max() / max(1.0, np.abs(a).max())))  # type: ignore[operator]
    return worst


def interleaved(columns: dict[str, Callable[[int], object]], rounds: int = 5, turn: int = 25) -> dict[str, float]:
    """Median seconds of each column, the columns taking turns of `turn` calls, as a control loop or a sweep would."""
    times: dict[str, list[float]] = {name: [] for name in columns}
    for _ in range(rounds):
        for begin in range(0, DRAWS, turn):
            for name, run in columns.items():
                for i in range(begin, begin + turn):
                    start = time.perf_counter()
                    run(i)
                    times[name].append(time.perf_counter() - start)
    return {name: statistics.median(t) for name, t in times.items()}


def stages(d: Draws, kind: str) -> dict[str, Callable[[int], object]]:
    """The pipeline's own parts, each from inputs made beforehand."""
    contacts = d.held if kind == "held" else d.frictional
    v = d.v if kind == "held" else [None] * DRAWS
    states = [rbd.State(d.robot, d.q[0], v[0])] * DRAWS

    def problem(i: int) -> rbd.GaussProblem:
        return rbd.gauss_problem(states[i], d.tau[i], contacts)

    return {
        "State": lambda i: rbd.State(d.robot, d.q[i], v[i]),
        "rows": lambda i: [c.rows(states[i]) for c in contacts],
        "rows + problem": problem,
        "+ ProxQP + certificate": lambda i: rbd.ProxQP().solve(problem(i)).status,
    }


def assembling(robot: rbd.Robot) -> Callable[[int], object]:
    """From 0.3 rad a joint off its posture (deviation of each), the crank fixed, onto the loops."""
    rng, q = np.random.default_rng(11), robot.posture("assembled")
    starts = [pin.integrate(robot.model, q, dq) for dq in 0.3 * rng.normal(size=(DRAWS, robot.nv))]
    fixed = {"crank_joint": q[:2]}
    return lambda i: rbd.mechanism.assemble(rbd.State(robot, starts[i]), fixed=fixed)


def standing() -> dict[str, Callable[[int], object]]:
    """Where Talos can stand on its soles, and how hard it can be pushed at its torso, all around."""
    robot = rbd.load_robot("talos")
    state, soles, angle = robot.standing(), robot.soles(friction=0.7), np.arange(72) * (2.0 * np.pi / 72.0)
    ways = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(72)])
    return {
        "support region, pyramids": lambda i: rbd.statics.support_region(state, soles, friction="inscribed"),
        "support region, cones": lambda i: rbd.statics.support_region(state, soles),
        "72 pushes": lambda i: rbd.statics.push_limits(state, soles, "torso_2_link", ways),
    }


def in_milliseconds() -> Table:
    """Assembly of mechanisms, loading of robots, regions and pushes, in milliseconds beside their marks."""
    robots = {"four-bar": rbd.load_robot(URDF / "four_bar.urdf"), "six-bar": rbd.load_robot(URDF / "six_bar.urdf")}
    table = Table(title="mechanisms; robots loaded; where Talos can stand")
    for heading in ("", "median", "mark"):
        table.add_column(heading, justify="left" if not heading else "right")
    medians = interleaved({f"assemble {name}": assembling(robot) for name, robot in robots.items()})
    loads = {f"load {name}": lambda i, name=name: rbd.load_robot(name) for name in ("talos", "human")}
    for label, seconds in (medians | interleaved(loads, rounds=1) | interleaved(standing(), rounds=1, turn=100)).items():
        table.add_row(label, f"{1e3 * seconds:.2f} ms", f"{ABSOLUTE[label]:.0f} ms")
    return table


def main() -> None:
    """Print the table."""
    warnings.simplefilter("ignore", EffortLimitWarning)
    console = Console(width=100)
    for name in ("talos", "g1"):
        d = Draws(name)
        columns = {
            "raw terms (M, h, J, drift)": raw_terms(d),
            "constraintDynamics, held": constraint_dynamics(d),
            "plain pin + NumPy script, held": plain_script(d),
            "rbd held, KKT": ours(d, "held", rbd.KKT()),
            "rbd held, ProxQP": ours(d, "held", rbd.ProxQP()),
            "rbd held, default": ours(d, "held", None),
            "rbd frictional, ProxQP": ours(d, "frictional", rbd.ProxQP()),
        }
        for mode, draws in (("sticking", d.sticking), ("slipping", d.slipping)):
            columns[f"rbd frictional, default, {mode}"] = rubbing(d, None, draws)
            columns[f"rbd frictional, ProxQP, {mode}"] = rubbing(d, rbd.ProxQP(), draws)
            for law in ("coulomb", "convex"):
                columns[f"rbd frictional, ConeSolver {law}, {mode}"] = rubbing(d, rbd.ConeSolver(law=law), draws)
        columns["rbd inverse dynamics, no cone at its limit"] = commanded(d, d.inside)
        columns["rbd inverse dynamics, a cone at its limit"] = commanded(d, d.at_limit)
        medians = interleaved(columns)
        unit = medians["constraintDynamics, held"]
        table = Table(title=f"{name}: nv = {d.robot.nv}, two soles; agreement in a: {agree(d):.1e}")
        for heading in ("", "median", "x constraintDynamics", "mark, second mark"):
            table.add_column(heading, justify="left" if not heading else "right")
        for label, seconds in medians.items():
            marks = MARKS.get(label.removeprefix("rbd "))
            mark = ", ".join(f"{each:.0f}" for each in marks or ())
            table.add_row(label, f"{1e6 * seconds:.1f} us", f"{seconds / unit:.2f}", mark)
        for kind in ("held", "frictional"):
            for label, seconds in interleaved(stages(d, kind), rounds=2).items():
                table.add_row(f"  {kind}: {label}", f"{1e6 * seconds:.1f} us", f"{seconds / unit:.2f}", "")
        console.print(table)
    console.print(in_milliseconds())
    for simulated in [*simulation_tables(), *planar_tables()]:
        console.print(simulated)


if __name__ == "__main__":
    main()
