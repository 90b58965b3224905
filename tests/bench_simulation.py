"""Steps of `rbd.simulate` beside MuJoCo's `mj_step`: the same URDF, torques, step and friction, taking turns in one run.

Two robots stand on their feet and sway a little, held by the same torques (PD with constant gains, computed in NumPy for both);
then they fall freely for a second with their joints moving. MuJoCo has a small ball at each corner of a sole, on a plane; its
time is `mj_step` alone, the torques being computed outside of it. Ours is all of `rbd.simulate`: its controller, its residuals
and its record. `mj_forward`, and `mujoco.rollout` of one step for each of 10,000 states, start from states of the same sway.
Times are of the processor, so that other programs trouble them less. Run by `make bench`.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import mujoco
import mujoco.rollout
import numpy as np
import pinocchio as pin
from bench_timing import CLOCK, Row, once
from mujoco_bridge import MujocoTwin
from rich.table import Table

import rbd
from rbd.constraints.contact import PointContact, SurfaceContact

Array = np.ndarray
Foot = PointContact | SurfaceContact
STEP, FRICTION, BALL = 1e-3, 0.7, 5e-3
TURN, ROUNDS = 200, 6
MARKS = {"talos": (8.0, 5.0), "solo12": (16.0, 9.0)}
"""Of a step of ours, in steps of MuJoCo's."""
REST_MARKS = {"talos": (4.0, 3.0), "solo12": (8.0, 5.0)}
"""The same at rest, as a user calls it."""
SLIDE_MARKS = {"talos": (8.0,), "solo12": (12.0,)}
"""The same on feet that slide at `SLIDES` [m/s] with a friction of `SLIPPERY` throughout."""
SLIDES, SLIPPERY = 0.3, 0.05
BOX_MARKS = (30.0,)
BOXES = {
    "slides": ((0.4, 0.4, 0.2), 0.3, (3.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    "tips about an edge": ((0.2, 0.4, 0.8), 0.9, (0.4, 0.0, 0.1, 0.0, 1.0, 0.0)),
}
"""Lengths [m], friction, and velocity of a box of `BOX_KG` on the ground."""
BOX_KG = 10.0
STATES = 10_000
THEIRS, FORWARD, ROLLOUT = (
    "MuJoCo mj_step, Euler",
    "MuJoCo mj_forward",
    f"mujoco.rollout, one step of {STATES:,} states, a state",
)
DEFAULT = "rbd.simulate"
OURS = {
    DEFAULT: (TURN, rbd.TimeStepping()),
    "rbd.simulate, extrapolate=True": (TURN, rbd.TimeStepping(extrapolate=True)),
    "rbd.simulate, every step recorded": (1, rbd.TimeStepping()),
}
"""How often it records, and with what it steps."""
EULER, IMPLICIT, RK4 = "Euler", "implicitfast", "RK4"
INTEGRATORS = {
    EULER: mujoco.mjtIntegrator.mjINT_EULER,
    IMPLICIT: mujoco.mjtIntegrator.mjINT_IMPLICITFAST,
    RK4: mujoco.mjtIntegrator.mjINT_RK4,
}


@dataclass(frozen=True, eq=False)
class Held:
    """tau = tau_0 + K (q* - q) - D v, a number a joint: as stiff as a step of 1 ms stands with a foot off the ground."""

    torque: Array
    stiffness: Array
    damping: Array
    posture: Array

    @classmethod
    def of(cls, standing: rbd.State, feet: list[Foot]) -> Held:
        """The gains of a standing posture, from the inertia that a joint feels with all else free."""
        inertia = 1.0 / np.diag(np.linalg.inv(standing.M))[6:]
        stiffness = np.minimum(0.2 * inertia / STEP**2, 3000.0)
        return cls(rbd.hold(standing, feet).tau, stiffness, 0.25 * inertia / STEP, standing.q[7:])

    def __call__(self, state: rbd.State, t: float) -> Array:
        """Torques (nu,) of a state."""
        return self.of_joints(state.q[7:], state.v[6:])

    def of_joints(self, q: Array, v: Array) -> Array:
        """Torques (nu,) of the joints' q and v, in Pinocchio's order."""
        return self.torque + self.stiffness * (self.posture - q) - self.damping * v


class InMujoco:
    """A robot in MuJoCo with balls at the corners of its feet, on the plane z = 0; Newton's solver, elliptic cones."""

    def __init__(self, standing: rbd.State, feet: list[Foot], integrator: str = EULER, *, floor: bool = True) -> None:
        self.robot, self.feet, self.standing, self.floor = standing.robot, feet, standing, floor
        self.twin = MujocoTwin(standing.robot, self._add_shapes)
        self.model = m = self.twin.model
        m.opt.timestep, m.opt.cone, m.opt.integrator = STEP, mujoco.mjtCone.mjCONE_ELLIPTIC, INTEGRATORS[integrator]
        m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT  # rbd has no joint limits unless they are given
        pairs = [(theirs, ours) for theirs, ours in self.twin.joints if ours > 1]
        model = standing.robot.model
        order = np.argsort([model.idx_vs[ours] for _, ours in pairs])
        self.qpos = np.array([m.jnt_qposadr[theirs] for theirs, _ in pairs])[order]
        self.dofs = np.array([m.jnt_dofadr[theirs] for theirs, _ in pairs])[order]
        self.data = self.at(standing.q, standing.v)

    def _add_shapes(self, spec: mujoco.MjSpec) -> None:
        if not self.floor:
            return
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_PLANE, size=[5, 5, 1], friction=[FRICTION, 0, 0], condim=3, contype=0, conaffinity=1
        )
        for foot in self.feet:
            X_WF = self.standing.frame(foot.frame).X_WF
            for corner in _corners(foot):
                centre = corner + X_WF.rotation.T @ [0.0, 0.0, BALL]
                spec.body(foot.frame).add_geom(
                    type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], pos=centre, friction=[FRICTION, 0, 0], condim=3,
                    contype=1, conaffinity=0, mass=0,
                )  # fmt: skip

    def at(self, q: Array, v: Array) -> mujoco.MjData:
        """Data at a state."""
        twin = self.twin.at(q, v).data
        data = mujoco.MjData(self.model)
        data.qpos[:], data.qvel[:] = twin.qpos, twin.qvel
        return data

    def steps(self, n: int, tau: Held | None, watch: Callable[[mujoco.MjData], None] = lambda data: None) -> float:
        """Seconds that n `mj_step` take, the torques computed between them."""
        m, data, seconds = self.model, self.data, 0.0
        for _ in range(n):
            if tau is not None:
                data.qfrc_applied[self.dofs] = tau.of_joints(data.qpos[self.qpos], data.qvel[self.dofs])
            start = time.thread_time()
            mujoco.mj_step(m, data)
            seconds += time.thread_time() - start - CLOCK
            watch(data)
        return seconds

    def states(self, n: int, tau: Held) -> tuple[Array, Array]:
        """Full states and applied forces at n steps of a sway."""
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        found, applied = np.empty((n, mujoco.mj_stateSize(self.model, kind))), np.empty((n, self.model.nv))
        for i in range(n):
            self.steps(1, tau)
            mujoco.mj_getState(self.model, self.data, found[i], kind)
            applied[i] = self.data.qfrc_applied
        return found, applied

    def forwards(self, states: Array, applied: Array) -> float:
        """Seconds that `mj_forward` takes at all states, these set outside of it."""
        m, data, kind, seconds = self.model, self.data, mujoco.mjtState.mjSTATE_FULLPHYSICS, 0.0
        for state, force in zip(states, applied, strict=True):
            mujoco.mj_setState(m, data, state, kind)
            data.qfrc_applied[:] = force
            start = time.thread_time()
            mujoco.mj_forward(m, data)
            seconds += time.thread_time() - start - CLOCK
        return seconds

    def rollout(self, states: Array, applied: Array) -> float:
        """Seconds of one step from each state, in one call on one thread."""
        control, kind = applied[:, None, :], int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)
        return once(lambda: mujoco.rollout.rollout(self.model, [self.data], states, control, control_spec=kind))

    def energy(self) -> float:
        """Kinetic and potential energy [J]."""
        mujoco.mj_forward(self.model, self.data)
        mujoco.mj_energyPos(self.model, self.data)
        mujoco.mj_energyVel(self.model, self.data)
        return float(self.data.energy.sum())


def _corners(foot: Foot) -> Array:
    """Where a foot touches, in its frame, shape (k, 3) [m]."""
    if isinstance(foot, PointContact):
        return np.array([foot.offset])
    return foot.corners @ foot.placement.rotation.T + foot.placement.translation


def _depth(data: mujoco.MjData) -> float:
    """How deep the deepest contact is [m]."""
    return max(0.0, -float(data.contact.dist.min())) if data.ncon else 0.0


@dataclass(frozen=True, eq=False)
class Bench:
    """One robot on its feet, and in the air."""

    name: str
    swaying: rbd.State
    flying: rbd.State
    feet: list[Foot]
    held: Held

    @classmethod
    def of(cls, name: str) -> Bench:
        """A robot of the catalogue, with random velocities: small ones that leave its feet at rest, and larger ones."""
        robot = rbd.load_robot(name)
        standing, feet = robot.standing(), robot.feet(FRICTION)
        rng = np.random.default_rng(5)
        J = np.concatenate([foot.rows(standing).J for foot in feet])
        sways = 0.1 * rng.normal(size=robot.nv)
        sways -= np.linalg.lstsq(J, J @ sways, rcond=None)[0]
        flies = rng.normal(size=robot.nv)
        flying = standing.with_velocity(flies)
        return cls(name, standing.with_velocity(sways), flying, feet, Held.of(standing, feet))

    def times(self) -> dict[str, float]:
        """Median seconds a step of turns, which alternate."""
        theirs = InMujoco(self.swaying, self.feet)
        ours = {name: (every, integrator, [self.swaying]) for name, (every, integrator) in OURS.items()}
        times: dict[str, list[float]] = {name: [] for name in (THEIRS, *ours)}
        for _ in range(ROUNDS):
            times[THEIRS].append(theirs.steps(TURN, self.held) / TURN)
            for name, (every, integrator, at) in ours.items():
                start = time.thread_time()
                run = self.standing_run(at.pop(), TURN, every, integrator)
                times[name].append((time.thread_time() - start) / TURN)
                at.append(run.state(-1))
        return {name: statistics.median(t) for name, t in times.items()}

    def by_user(self, speed: float = 0.0, friction: float = FRICTION) -> float:
        """A step of ours in steps of MuJoCo's, medians of turns: constant torques from Python, every step recorded.

        Args:
            speed: Of the robot along x [m/s].
            friction: Of its feet.
        """
        standing = self.swaying.with_velocity(speed * np.eye(self.swaying.robot.nv)[0])
        held = replace(self.held, stiffness=np.zeros_like(self.held.stiffness), damping=np.zeros_like(self.held.damping))
        tau, ours, theirs = held.torque, list[float](), list[float]()
        feet = [foot.with_friction(friction) for foot in self.feet]
        for _ in range(ROUNDS):
            twin = InMujoco(standing, feet)
            twin.model.geom_friction[:, 0] = friction
            theirs.append(twin.steps(TURN, held))
            ours.append(
                once(
                    lambda: rbd.simulate(
                        standing, feet, duration=TURN * STEP, step=STEP, controller=lambda state, t: tau, progress=False
                    )
                )
            )
        return statistics.median(ours) / statistics.median(theirs)

    def peers(self) -> dict[str, float]:
        """Median seconds a state of MuJoCo's forward dynamics, and of its rollout."""
        theirs = InMujoco(self.swaying, self.feet)
        states, applied = theirs.states(STATES, self.held)
        forward = [theirs.forwards(states[k::ROUNDS], applied[k::ROUNDS]) / len(states[k::ROUNDS]) for k in range(ROUNDS)]
        rollout = [theirs.rollout(states, applied) / STATES for _ in range(3)]
        return {FORWARD: statistics.median(forward), ROLLOUT: statistics.median(rollout)}

    def standing_run(
        self,
        state: rbd.State,
        steps: int,
        every: int = 1,
        integrator: rbd.TimeStepping = rbd.TimeStepping(),  # noqa: B008
    ) -> rbd.Trajectory:
        """Some steps of ours on the feet."""
        return rbd.simulate(
            state, self.feet, duration=steps * STEP, step=STEP, controller=self.held, integrator=integrator, record_every=every,
            progress=False,
        )  # fmt: skip

    def depths(self) -> dict[str, float]:
        """The deepest that a foot comes into the ground within a second of standing [m]."""
        theirs, found = InMujoco(self.swaying, self.feet), [0.0]
        theirs.steps(1000, self.held, lambda data: found.append(_depth(data)))
        ours = self.standing_run(self.swaying, 1000).residuals["penetration"].max()
        return {"MuJoCo, Euler": max(found), "rbd, TimeStepping": float(ours)}

    def energy_changes(self) -> dict[str, float]:
        """How far the energy moves within a second of free fall, without torques [J]; it should not."""
        out = {}
        for name in INTEGRATORS:
            theirs = InMujoco(self.flying, self.feet, name, floor=False)
            energy = [theirs.energy()]
            for _ in range(100):
                theirs.steps(10, None)
                energy.append(theirs.energy())
            out[f"MuJoCo, {name}"] = float(np.ptp(energy))
        for integrator in (rbd.TimeStepping(), rbd.RungeKutta4()):
            run = rbd.simulate(self.flying, (), duration=1.0, step=STEP, integrator=integrator, record_every=10, progress=False)
            out[f"rbd, {type(integrator).__name__}"] = float(np.ptp(run.energy))
        return out


@cache
def robots() -> dict[str, tuple[Bench, dict[str, float]]]:
    """The robots, and their median seconds a step."""
    benches = {name: Bench.of(name) for name in MARKS}
    return {name: (bench, bench.times()) for name, bench in benches.items()}


def step_rows() -> list[Row]:
    """A step of `rbd.simulate` in steps of MuJoCo's, with its marks."""
    what = f"a step of {DEFAULT} of {1e3 * STEP:g} ms on frictional feet"
    rows = [
        Row(what, {name: times[DEFAULT] / times[THEIRS]}, "x mj_step", MARKS[name]) for name, (_, times) in robots().items()
    ]
    rest = f"{DEFAULT} by default at rest, torques from Python, a step of {1e3 * STEP:g} ms"
    slides = f"the same on feet that slide at {SLIDES:g} m/s, friction {SLIPPERY:g}"
    for name, (bench, _) in robots().items():
        rows.append(Row(rest, {name: bench.by_user()}, "x mj_step", REST_MARKS[name]))
        rows.append(Row(slides, {name: bench.by_user(SLIDES, SLIPPERY)}, "x mj_step", SLIDE_MARKS[name]))
    return rows + [Row(f"a box that {what}, every step recorded", {"": box(what)}, "x mj_step", BOX_MARKS) for what in BOXES]


def box(what: str) -> float:
    """A step of ours in steps of MuJoCo's of a box, medians of turns."""
    size, friction, v = BOXES[what]
    half, robot = 0.5 * np.array(size), rbd.testing.box(BOX_KG, size)
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -half[2]]))
    face = rbd.SurfaceContact("face", "box", half_lengths=half[:2], placement=below, friction=friction, on=0.0)
    start = rbd.State(robot, [0.0, 0.0, half[2], 0.0, 0.0, 0.0, 1.0], np.array(v))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option timestep="{STEP}" cone="elliptic"/><worldbody>
        <geom type="plane" size="5 5 1" friction="{friction} 0 0" condim="3"/><body pos="0 0 {half[2]}"><freejoint/>
        <geom type="box" size="{half[0]} {half[1]} {half[2]}" mass="{BOX_KG}" friction="{friction} 0 0" condim="3"/>
        </body></worldbody></mujoco>"""
    )

    def theirs(data: mujoco.MjData) -> None:
        data.qvel[:] = v
        for _ in range(TURN):
            mujoco.mj_step(model, data)

    own, other = list[float](), list[float]()
    for _ in range(ROUNDS):
        data = mujoco.MjData(model)
        other.append(once(lambda data=data: theirs(data)))
        own.append(once(lambda: rbd.simulate(start, [face], duration=TURN * STEP, step=STEP, progress=False)))
    return statistics.median(own) / statistics.median(other)


def peer_step_rows() -> list[Row]:
    """MuJoCo's calls in microseconds; ours with other settings in steps of MuJoCo's."""
    found = {name: times for name, (_, times) in robots().items()}
    peers = {name: bench.peers() for name, (bench, _) in robots().items()}
    rows = [Row(THEIRS, {name: 1e6 * times[THEIRS] for name, times in found.items()}, "us")]
    rows += [Row(what, {name: 1e6 * seconds[what] for name, seconds in peers.items()}, "us") for what in (FORWARD, ROLLOUT)]
    ratios = {what: {name: times[what] / times[THEIRS] for name, times in found.items()} for what in OURS}
    return rows + [Row(what, values, "x mj_step") for what, values in ratios.items()]


def accuracy() -> dict[str, dict[str, tuple[float, float | None]]]:
    """{robot: {engine: (energy that a second of free fall adds or takes [J], depth of standing feet [m], or None)}}."""
    found = {}
    for name, (bench, _) in robots().items():
        depths = bench.depths()
        found[name] = {label: (moved, depths.get(label)) for label, moved in bench.energy_changes().items()}
    return found


def accuracy_table(found: dict[str, dict[str, tuple[float, float | None]]]) -> Table:
    """What both do to energy and depth."""
    errors = Table(title="errors of the same: energy in a second of free fall, depth of the feet in a second of standing")
    for heading in ("", "energy moves by", "feet sink by"):
        errors.add_column(heading, justify="left" if not heading else "right")
    for name, engines in found.items():
        for label, (moved, depth) in engines.items():
            errors.add_row(f"{name}: {label}", f"{moved:.1e} J", "" if depth is None else f"{depth:.1e} m")
    return errors
