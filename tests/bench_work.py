"""Work and precision beside MuJoCo: the error of a motion over the processor time that it takes, by step, of three scenes.

The error is that of q at eight times evenly over the motion: the largest |q - q_ref| over the largest |q_ref - q(0)|, Euclidean
norms of `pinocchio.difference`, metres and radians alike.

Ours is judged by `work_references`: rigid contacts under Coulomb's law. MuJoCo's contacts are soft, its law is another one, and
each of its settings is judged by what its own law tends to (`Scene.limit`), which depends on cone, impratio, solref and solimp;
and once more by Coulomb's law. Where two of its finest steps differ by more than an error, that difference is its error.

Its time is that of `mj_step`, all steps between two samples in one call, feedback by its own actuators; ours is all of
`rbd.simulate`, with a controller in Python, its residuals and its record. Processor times, the least of three. `make bench`.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from bench_timing import CLOCK, Row
from matplotlib.figure import Figure
from mujoco_bridge import MujocoTwin
from PIL import Image
from work_references import GRAVITY, Dropped, Robot, Site, pushed_stance, sliding_crate

import rbd
from rbd.constraints.constraint import Constraint
from rbd.constraints.contact import PointContact, SurfaceContact
from rbd.errors import RbdWarning, SimulationStopped
from rbd.simulation.simulated_motion import Integrator
from rbd.visual.figures.plots import frame

Array = np.ndarray
SAMPLES = 8
BALL = 1e-6
"""Radius of MuJoCo's balls at corners [m]: its points are then those of rbd."""
LEVELS = {1e-2: (), 1e-3: (3.0,), 1e-4: (1.0,), 1e-5: (1.0,)}
"""Errors at which times are told, with marks: ours over MuJoCo's."""
LONGEST = {"MuJoCo": 0.4, "rbd.simulate": 1.2}
"""Steps become shorter until a run takes so long [s]."""
FINEST = 1e-6
"""Or until it has an error so small."""
WRONG = 0.3
"""Larger errors are not drawn."""
COULOMB = "MuJoCo against Coulomb's law"
THEIRS, OURS = LONGEST
Curve = list[tuple[float, float]]
"""(seconds, error) of each step."""


@dataclass(frozen=True)
class Law:
    """A contact law of MuJoCo's: what its motion tends to as steps go to zero."""

    cone: str = "pyramidal"
    impratio: float = 1.0
    stiff: bool = False

    def on(self, m: mujoco.MjModel) -> None:
        """Set it."""
        m.opt.cone = getattr(mujoco.mjtCone, f"mjCONE_{self.cone.upper()}")
        m.opt.impratio = self.impratio
        m.geom_solref[:] = (0.004, 1.0) if self.stiff else (0.02, 1.0)
        m.geom_solimp[:] = (0.99, 0.999, 1e-4, 0.5, 2.0) if self.stiff else (0.9, 0.95, 1e-3, 0.5, 2.0)


@dataclass(frozen=True)
class Setting:
    """How MuJoCo steps."""

    solver: str
    integrator: str
    law: Law

    def __str__(self) -> str:
        """What is not MuJoCo's default is told, too."""
        law = self.law
        more = f", impratio {law.impratio:g}" if law.impratio != 1.0 else ""
        return f"{self.integrator}, {self.solver}, {law.cone}{more}{', stiff' if law.stiff else ''}"


PYRAMID, ELLIPSE = Law(), Law("elliptic")
FIRM, STIFF = Law("elliptic", impratio=10.0), Law("elliptic", stiff=True)
SETTINGS = (
    Setting("Newton", "Euler", PYRAMID),
    Setting("Newton", "implicitfast", PYRAMID),
    Setting("Newton", "RK4", PYRAMID),
    Setting("CG", "Euler", PYRAMID),
    Setting("PGS", "Euler", PYRAMID),
    Setting("Newton", "Euler", ELLIPSE),
    Setting("Newton", "implicitfast", ELLIPSE),
    Setting("Newton", "RK4", ELLIPSE),
    Setting("CG", "RK4", ELLIPSE),
    Setting("Newton", "RK4", FIRM),
    Setting("Newton", "implicitfast", STIFF),
    Setting("Newton", "RK4", STIFF),
)


@dataclass(frozen=True, eq=False)
class Feedback:
    """tau = tau_0 + K (q* - q) - D v, a number a joint."""

    torque: Array
    stiffness: Array
    damping: Array
    posture: Array

    def __call__(self, state: rbd.State, t: float) -> Array:
        """Torques (nu,) of a state."""
        return self.of_joints(state.q[7:], state.v[6:])

    def of_joints(self, q: Array, v: Array) -> Array:
        """Torques (nu,) of the joints' q and v, in Pinocchio's order."""
        return self.torque + self.stiffness * (self.posture - q) - self.damping * v


@dataclass(frozen=True, eq=False)
class Push:
    """A force at a body's centre of mass and a moment, in world axes, until a time."""

    body: str
    force: tuple[float, float, float]
    moment: tuple[float, float, float] = (0.0, 0.0, 0.0)
    until: float = np.inf
    offset: tuple[float, ...] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Way:
    """How ours steps: other constraints than those of the scene, an integrator, whether all steps are recorded."""

    constraints: Sequence[Constraint] | None = None
    integrator: Integrator | None = None
    all_recorded: bool = True


WAYS = {
    OURS: Way(),
    f"{OURS}, samples recorded": Way(all_recorded=False),
    f"{OURS}, extrapolate=True, samples recorded": Way(integrator=rbd.TimeStepping(extrapolate=True), all_recorded=False),
}


@dataclass(frozen=True, eq=False)
class Scene:
    """A motion for both engines.

    Attributes:
        name: Of it.
        start: First state.
        constraints: Ours.
        friction: Of them all.
        duration: [s].
        reference: Makes q (8, nq) at times, under Coulomb's law.
        feedback: Of its joints.
        push: From the start on, until one of the samples.
        ways: Ours.
        halved: Steps between samples of the limits of MuJoCo's laws.
    """

    name: str
    start: rbd.State
    constraints: Sequence[PointContact | SurfaceContact]
    friction: float
    duration: float
    reference: Callable[[Array], Array]
    feedback: Feedback | None = None
    push: Push | None = None
    ways: Mapping[str, Way] = field(default_factory=lambda: WAYS)
    halved: int = 512

    @cached_property
    def times(self) -> Array:
        """Those of the samples [s]."""
        return self.duration * np.arange(1, SAMPLES + 1) / SAMPLES

    @cached_property
    def rigid(self) -> Array:
        """The reference."""
        return self.reference(self.times)

    def error(self, q: Array, reference: Array) -> float:
        """What is drawn."""
        model, start = self.start.robot.model, self.start.q
        off = max(np.linalg.norm(pin.difference(model, a, b)) for a, b in zip(q, reference, strict=True))
        return float(off / max(np.linalg.norm(pin.difference(model, start, b)) for b in reference))

    def ours(self, n: int, way: str = OURS) -> tuple[float, Array]:
        """(seconds, q (8, nq)) of n steps between samples, in two runs where a push ends."""
        how = self.ways[way]
        constraints = self.constraints if how.constraints is None else how.constraints
        every = 1 if how.all_recorded else n
        push, step = self.push, self.duration / SAMPLES / n
        force = None if push is None else rbd.ExternalForce(push.body, push.force, push.moment, push.offset)
        first = self.duration if push is None else min(push.until, self.duration)
        parts = [(first, force), (self.duration - first, None)][: 1 + (first < self.duration)]
        state, out, begin = self.start, [], time.thread_time()
        for duration, external in parts:
            run = rbd.simulate(
                state, constraints, duration=duration, step=step, controller=self.feedback, external=external,
                integrator=how.integrator, record_every=every, progress=False,
            )  # fmt: skip
            state = run.state(-1)
            out.append(run.q[n // every :: n // every])
        return time.thread_time() - begin, np.concatenate(out)

    @cached_property
    def twin(self) -> MujocoTwin:
        """The same robot in MuJoCo, with its shapes and actuators."""
        return MujocoTwin(self.start.robot, self._add)

    def _add(self, spec: mujoco.MjSpec) -> None:
        mu = [self.friction, 0.0, 0.0]
        plane = {"type": mujoco.mjtGeom.mjGEOM_PLANE, "size": [5, 5, 1], "contype": 0, "conaffinity": 1}
        spec.worldbody.add_geom(friction=mu, condim=3, **plane)
        for contact in self.constraints:
            body = spec.body(contact.frame)
            for corner in _corners(contact):
                body.add_geom(
                    type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[BALL, 0, 0], pos=corner, friction=mu, condim=3, contype=1,
                    conaffinity=0, mass=0,
                )  # fmt: skip
        if self.feedback is not None:
            for i, name in enumerate(self.start.robot.model.names[2:]):
                motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
                motor.gaintype, motor.biastype = mujoco.mjtGain.mjGAIN_FIXED, mujoco.mjtBias.mjBIAS_AFFINE
                motor.gainprm[0] = 1.0
                motor.biasprm[:3] = 0.0, -self.feedback.stiffness[i], -self.feedback.damping[i]

    def set_up(self, setting: Setting, step: float) -> mujoco.MjData:
        """MuJoCo's data at the start, its model set."""
        m, feedback = self.twin.model, self.feedback
        m.opt.disableflags = mujoco.mjtDisableBit.mjDSBL_LIMIT  # rbd has no joint limits unless they are given
        m.opt.timestep = step
        m.opt.solver = getattr(mujoco.mjtSolver, f"mjSOL_{setting.solver.upper()}")
        m.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{setting.integrator.upper()}")
        m.opt.tolerance, m.opt.iterations = 1e-8, 100
        setting.law.on(m)
        at, data = self.twin.at(self.start.q, self.start.v).data, mujoco.MjData(m)
        data.qpos[:], data.qvel[:] = at.qpos, at.qvel
        if feedback is not None:
            data.ctrl[:] = feedback.torque + feedback.stiffness * feedback.posture
        return data

    def moved(self, data: mujoco.MjData, advance: Callable[[], float]) -> tuple[float, Array]:
        """(seconds, q (8, nq)) of a motion, a sample at a time."""
        push, seconds, out = self.push, 0.0, []
        for t in self.times:
            if push is not None:
                acts = t <= push.until + 1e-9
                data.xfrc_applied[self.twin.model.body(push.body).id] = np.array([*push.force, *push.moment]) * acts
            seconds += advance()
            out.append(self._q(data))
        return seconds, np.array(out)

    def theirs(self, setting: Setting, n: int) -> tuple[float, Array]:
        """(seconds, q (8, nq)) of n steps between samples."""
        m, data = self.twin.model, self.set_up(setting, self.duration / SAMPLES / n)

        def advance() -> float:
            start = time.thread_time()
            mujoco.mj_step(m, data, n)
            return time.thread_time() - start - CLOCK

        return self.moved(data, advance)

    def limit(self, law: Law, n: int, halvings: int = 12) -> Array:
        """What a law of MuJoCo's tends to, shape (8, nq): steps of order four, halved where a contact begins or ends."""
        m, data = self.twin.model, self.set_up(Setting("Newton", "RK4", law), 1.0)
        m.opt.tolerance, m.opt.iterations = 1e-15, 200
        kind = mujoco.mjtState.mjSTATE_INTEGRATION
        kept = np.empty(mujoco.mj_stateSize(m, kind))

        def stepped(h: float, halvings: int) -> None:
            before = data.contact.geom.tobytes()
            here = kept.copy()
            mujoco.mj_getState(m, data, here, kind)
            m.opt.timestep = h
            mujoco.mj_step(m, data)
            mujoco.mj_fwdPosition(m, data)
            if halvings and data.contact.geom.tobytes() != before:
                mujoco.mj_setState(m, data, here, kind)
                mujoco.mj_fwdPosition(m, data)
                stepped(0.5 * h, halvings - 1)
                stepped(0.5 * h, halvings - 1)

        def advance() -> float:
            for _ in range(n):
                stepped(self.duration / SAMPLES / n, halvings)
            return 0.0

        mujoco.mj_fwdPosition(m, data)
        return self.moved(data, advance)[1]

    def _q(self, data: mujoco.MjData) -> Array:
        """Pinocchio's q of MuJoCo's."""
        model, q = self.start.robot.model, np.empty(self.start.robot.model.nq)
        for theirs, ours in self.twin.joints:
            at = data.qpos[self.twin.model.jnt_qposadr[theirs] :]
            q[model.idx_qs[ours] : model.idx_qs[ours] + model.nqs[ours]] = [*at[:3], *at[4:7], at[3]] if ours == 1 else at[:1]
        return q

    @cached_property
    def limits(self) -> dict[Law, tuple[Array, float]]:
        """{law: (q (8, nq) of its limit, how far two of its finest differ)}."""
        out = {}
        for law in dict.fromkeys(setting.law for setting in SETTINGS):
            rough, fine = self.limit(law, self.halved // 2), self.limit(law, self.halved)
            out[law] = fine, self.error(rough, fine)
        return out

    def curves(self) -> dict[str, Curve]:
        """{way or setting: its curve}; and "way, against Coulomb's law" of MuJoCo's, by the same steps."""
        found: dict[str, Curve] = {}
        for way in self.ways:
            found[way], _ = _curve(LONGEST[OURS], lambda n, way=way: self.ours(n, way), lambda q: self.error(q, self.rigid))
        for setting in SETTINGS:
            reference, known = self.limits[setting.law]
            name = f"{THEIRS}, {setting}"
            found[name], motions = _curve(
                LONGEST[THEIRS],
                lambda n, setting=setting: self.theirs(setting, n),
                lambda q, to=reference, known=known: max(known, self.error(q, to)),
            )
            found[f"{COULOMB}, {setting}"] = [
                (t, self.error(q, self.rigid)) for (t, _), q in zip(found[name], motions, strict=True)
            ]
        return found


def _curve(
    longest: float, run: Callable[[int], tuple[float, Array]], error: Callable[[Array], float]
) -> tuple[Curve, list[Array]]:
    """(seconds, error) and q of steps that are halved again and again; those that fail or are too wrong are left out."""
    curve, motions, n, seconds = Curve(), [], 2, 0.0
    while seconds < longest and not (curve and curve[-1][1] < FINEST):
        try:
            seconds, q = run(n)
            for _ in range(2 if seconds < 0.3 * longest else 0):
                seconds = min(seconds, run(n)[0])
            if (off := error(q)) < WRONG:
                curve.append((seconds, off))
                motions.append(q)
        except SimulationStopped:
            pass
        n *= 2
    return curve, motions


def front(curves: Mapping[str, Curve], begin: str) -> list[tuple[float, float, str]]:
    """(seconds, error, name) of all runs of some curves that no other one beats in both, the fastest first."""
    runs = sorted((t, off, name) for name, curve in curves.items() if name.startswith(begin) for t, off in curve)
    return [run for i, run in enumerate(runs) if all(run[1] < other[1] for other in runs[:i])]


def time_at(level: float, runs: Sequence[tuple[float, float, str]]) -> tuple[float, str]:
    """(seconds, name) at which a front reaches an error, in logarithms straight between runs; infinite where it does not."""
    at = next((i for i, (_, off, _) in enumerate(runs) if off <= level), None)
    if at is None:
        return np.inf, ""
    t, off, name = runs[at]
    if at == 0:
        return t, name
    before, above, _ = runs[at - 1]
    share = np.log(above / level) / np.log(above / off)
    return float(before * (t / before) ** share), name


def _corners(foot: PointContact | SurfaceContact) -> Array:
    """Where a foot touches, in its frame, shape (k, 3) [m]."""
    if isinstance(foot, PointContact):
        return np.array([foot.offset])
    return foot.corners @ foot.placement.rotation.T + foot.placement.translation


# ------------------------------------------------------------------------------------------------------------------- scenes


def feedback_of(standing: rbd.State, torque: Array, fastest: float, stiffest: float) -> Feedback:
    """Gains from the inertia that a joint feels with all else free, as stiff as explicit steps of `fastest` [s] can be."""
    inertia = 1.0 / np.diag(np.linalg.inv(standing.M))[6:]
    stiffness = np.minimum(0.2 * inertia / fastest**2, stiffest)
    return Feedback(torque, stiffness, 0.25 * inertia / fastest, standing.q[7:])


def stance() -> Scene:
    """Talos on both soles is pushed, and holds its posture by a stiff feedback; friction holds."""
    robot = rbd.load_robot("talos")
    standing, soles, mu, until = robot.standing(), robot.soles(friction=0.7), 0.7, 0.1
    feedback = feedback_of(standing, rbd.hold(standing, soles).tau, 2e-3, 3000.0)
    link = "torso_2_link"
    twin = MujocoTwin(robot)
    offset = tuple(twin.model.body(link).ipos)
    push = Push(link, (60.0, 40.0, 0.0), until=until, offset=offset)
    sites = [Site(sole.frame, sole.placement) for sole in soles]
    plain = Robot(robot.model, [*sites, Site(link, pin.SE3(np.eye(3), np.array(offset)))], feedback.of_joints)
    pushed = plain.sites.pop()

    def force(placements: object) -> Array:
        J = pin.getFrameJacobian(plain.model, plain.data, pushed, pin.LOCAL_WORLD_ALIGNED)
        return J[:3].T @ np.array(push.force)

    held = Way(robot.soles(friction=None), rbd.RungeKutta4())
    ways = {**WAYS, f"{OURS}, RungeKutta4 on held soles": held}
    return Scene(
        "Talos, pushed on both soles", standing, soles, mu, 0.4,
        lambda times: pushed_stance(plain, standing.q, times, force, until), feedback, push, ways, 128,
    )  # fmt: skip


def crate() -> Scene:
    """A crate slides on its face against a pull, stops, and is tipped back over its rear edge."""
    robot, a, c, mu, speed = rbd.load_robot("crate"), 0.2, 0.5, 0.35, 1.0
    pull = 0.3 * GRAVITY
    moment = pull * c
    face = rbd.SurfaceContact(
        "face", "crate", half_lengths=(a, a), placement=pin.SE3(np.eye(3), np.array([0.0, 0.0, -c])), friction=mu, on=0.0
    )
    gyration = float(np.sqrt(robot.model.inertias[1].inertia[1, 1] / robot.mass))

    def reference(times: Array) -> Array:
        found = sliding_crate(times, length=a, height=c, gyration=gyration, mu=mu, speed=speed, pull=pull, moment=moment)
        return np.array([[x, 0, z, 0, -np.sin(0.5 * th), 0, np.cos(0.5 * th)] for x, z, th in found])

    push = Push("crate", (-robot.mass * pull, 0.0, 0.0), (0.0, -robot.mass * moment, 0.0))
    start = rbd.State(robot, [0, 0, c, 0, 0, 0, 1], [speed, 0, 0, 0, 0, 0])
    return Scene("a crate that slides and tips", start, [face], mu, 0.48, reference, push=push)


def drop() -> Scene:
    """Solo12, tilted a little, falls onto its feet, which slip for a moment after impacts; a feedback holds its posture."""
    robot, mu = rbd.load_robot("solo12"), 1.0
    standing, feet = robot.standing(), robot.feet(mu)
    feedback = feedback_of(standing, rbd.hold(standing, feet).tau, 1e-2, 10.0)
    q = standing.q.copy()
    q[2] += 0.04
    q[3:7] = pin.Quaternion(pin.rpy.rpyToMatrix(0.03, 0.02, 0.0)).coeffs()
    plain = Robot(robot.model, [Site(foot.frame, pin.SE3(np.eye(3), foot.offset)) for foot in feet], feedback.of_joints)

    def reference(times: Array) -> Array:
        return Dropped(plain, mu).motion(q, np.zeros(robot.nv), times)

    return Scene("Solo12, dropped", rbd.State(robot, q), feet, mu, 0.24, reference, feedback)


SCENES = (stance, crate, drop)
Found = dict[str, dict[str, Curve]]
"""{scene: its curves}."""


@cache
def measured() -> Found:
    """All curves of all scenes."""
    found = {}
    mujoco.set_mju_user_warning(lambda said: None)  # of steps that are too long; they would be written into a file
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RbdWarning)  # of long steps
        for make in SCENES:
            scene = make()
            scene.ours(16)
            found[scene.name] = scene.curves()
    return found


def work_rows() -> list[Row]:
    """Processor time of `rbd.simulate` as users call it, over that of MuJoCo's best setting, at some errors."""
    rows = []
    for name, curves in measured().items():
        for level, marks in LEVELS.items():
            ours, _ = time_at(level, front({OURS: curves[OURS]}, OURS))
            theirs, _ = time_at(level, front(curves, f"{THEIRS}, "))
            what = f"{name}, error {level:g}" + (
                f", which MuJoCo does not reach in {LONGEST[THEIRS]:g} s" if theirs == np.inf else ""
            )
            rows.append(Row(what, {"": ours / theirs if ours < np.inf else np.inf}, "x MuJoCo", marks))
    return rows


def work_table() -> list[list[str]]:
    """The cells of the page's table, headings first."""

    def told(level: float, curves: Mapping[str, Curve], begin: str) -> str:
        seconds, name = time_at(level, front(curves, begin))
        how = name.removeprefix(begin).removeprefix(", ")
        return "not reached" if seconds == np.inf else f"{1e3 * seconds:.3g} ms" + (f" ({how})" if how else "")

    cells = [["", "error", OURS, "its fastest way", "MuJoCo's best setting"]]
    for name, curves in measured().items():
        for level in LEVELS:
            asked = ({OURS: curves[OURS]}, OURS), (curves, OURS), (curves, f"{THEIRS}, ")
            times = [told(level, *each) for each in asked]
            cells.append([name, f"{level:.0e}".replace("e-0", "e-"), *times])
    return cells


def draw(picture: Path) -> Path:
    """Error over time, a scene each."""
    found = measured()
    figure = Figure(figsize=(9.6, 4.1), layout="constrained")
    for ax, (name, curves) in zip(figure.subplots(1, len(found), sharey=True), found.items(), strict=True):
        for what, curve in curves.items():
            if what.startswith(THEIRS + ", "):
                ax.loglog(*zip(*((1e3 * t, off) for t, off in curve), strict=True), color="0.82", lw=0.8, zorder=1)
        lines = {
            "MuJoCo, the best of its settings": (
                front(curves, f"{THEIRS}, "),
                {"color": "#d55e00", "lw": 2.0, "marker": "o", "ms": 3.5},
            ),
            "the same against Coulomb's law": (front(curves, COULOMB), {"color": "#d55e00", "lw": 1.2, "ls": ":"}),
            "rbd.simulate": (curves[OURS], {"color": "#0072b2", "lw": 2.0, "marker": "o", "ms": 3.5}),
            "the fastest way of rbd.simulate": (front(curves, OURS), {"color": "#0072b2", "lw": 1.2, "ls": "--"}),
        }
        for label, (runs, style) in lines.items():
            ax.loglog([1e3 * run[0] for run in runs], [run[1] for run in runs], label=label, **style)
        ax.plot([], [], color="0.82", lw=0.8, label="each of MuJoCo's settings")
        ax.set(title=name, xlabel="processor time [ms]", ylim=(5e-7, WRONG))
        ax.title.set_size(10)
        frame(ax, "both")
    figure.axes[0].set_ylabel("relative error of q")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9)
    figure.savefig(picture, dpi=110, metadata={"Software": None})
    with Image.open(picture) as drawn:
        drawn.convert("RGB").quantize(64).save(picture, optimize=True)
    return picture
