"""`plan`: a motion from keyframe to keyframe over given contacts that is possible at every instant, with its certificate."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.arrays import Array, as_float, check_flag, check_number, each_times, lazy
from rbd.centroid import CentroidCosts
from rbd.centroid.program import INNER
from rbd.constraints.contact import Contact
from rbd.constraints.convex.polygons import across
from rbd.constraints.surface import On
from rbd.constraints.terrain.terrain import Terrain
from rbd.control.schedules import TorqueSchedule
from rbd.displayed import Displayed, drawing
from rbd.errors import CannotMove, CannotPlan, DistantContactWarning, InputError, NoSolution
from rbd.errors.inputs import check_choice, check_kind
from rbd.mechanism.projection import project_acceleration, project_velocity
from rbd.model.state import State
from rbd.motion.reference_motion import Motion
from rbd.motion.self_collision import BodyPairs
from rbd.planning.certificate import Intervals, Pushes, at_instants, certified
from rbd.planning.contact_search import ContactSearch
from rbd.planning.curve import Curve
from rbd.planning.distances import too_far_apart
from rbd.planning.free_times import shortest
from rbd.planning.helping import Instant, limited
from rbd.planning.kept_limits import Between, between
from rbd.planning.kept_off import HALVED, over_ground, too_near
from rbd.planning.momentum import Momentum, MomentumCertificate
from rbd.planning.solving import Knots
from rbd.planning.stays import PlannedContacts, planned_contacts
from rbd.robots.robot import Robot
from rbd.simulation.progress_bar import progress_of
from rbd.statics.limits import Limit
from rbd.workers import one_blas_thread

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes

SHARES, LOADED = (0.86, INNER), (0.25, 1e-3)
"""Shares of friction and of soles with which plans are sought; what points press with at least, first and at last."""
SPARED, PER_SECOND = (0.03, 0.005), 100.0
"""Shares of friction and of soles that the last try leaves unused at 100 knots a second; they fall with the square of h."""
RATES, FLIGHT_RATES = (50.0, 100.0), (300.0, 400.0)
"""Knots a second that are tried in turn; and where nothing stands for a time."""
COARSE, HOPELESS = 50.0, 0.5
"""Knots a second of a first plan where a flight rises higher than the centre of mass can be over what it leaves; if that misses
so much of the weight, no finer one is tried. Plans that were found later missed up to 0.07 of it, others 0.9 to 90."""
COM, FLYING_COM = 0.02, 0.005
"""Deviation of the centre of mass that costs as much as the others of `CentroidCosts` [m]; and where nothing stands for a time:
with more it leaves the ground on legs that are nearly straight, and they have no way left on which to come to rest."""
SAMPLED = 200.0
"""Frames a second of a plan's motion."""


@dataclass(frozen=True, eq=False, repr=False)
class Plan(Displayed):
    """A motion over contacts that is possible at every instant: forces within friction, torques within limits.

    Attributes:
        robot: The robot.
        contacts: The contacts, and when each stands, as `rbd.control.follow` reads them.
        curve: Cubics of the coordinates.
        pushes: Forces of the plan at its knots.
        intervals: What is known of each interval of time, the certificate.
        between: Limits of joints and of speeds at all times; bodies apart, where all forces are certified.
        friction: Coulomb's coefficient of feet that are given by name.
        floor: What they stand on.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> stand = solo.standing()
        >>> low = {"com": stand.com - [0.0, 0.0, 0.05]}
        >>> feet = {foot.name: True for foot in solo.feet()}
        >>> plan = rbd.plan(solo, {0.0: stand, 0.6: low, 1.2: stand}, feet, progress=False)
        >>> print(plan.certified, f"{plan.state(0.6).com[2] - stand.com[2]:.3f} m")
        True -0.050 m
    """

    robot: Robot
    contacts: PlannedContacts
    curve: Curve
    pushes: Pushes
    intervals: Intervals
    between: Between
    friction: float
    floor: On

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.curve.t[-1] - self.curve.t[0])

    @property
    def certified(self) -> bool:
        """Whether every instant is certified to be possible."""
        return bool(self.intervals.sure.all() and self.between.holds)

    @property
    def friction_use(self) -> float:
        """Largest share of the friction that a force of more than 1 N needs at the ends of intervals."""
        return float(self.friction_shares.max(initial=0.0))

    @lazy
    def normal_forces(self) -> Array:
        """Of all points, at both ends of the intervals of its certificate, shape (2, m, k) [N]."""
        return self._local_forces[..., 2]

    @lazy
    def friction_shares(self) -> Array:
        """Share of the friction that each of these forces needs, shape (2, m, k); zero below 1 N."""
        f, n = self._local_forces, self.normal_forces
        return np.where(n > 1.0, np.hypot(f[..., 0], f[..., 1]) / np.maximum(self.pushes.friction * n, 1e-9), 0.0)

    @lazy
    def _local_forces(self) -> Array:
        return each_times(self._axes, self.intervals.forces)

    @property
    def torque_use(self) -> float:
        """Largest share of a torque limit that is used."""
        limit = self.robot.effort_limit
        return float((np.abs(self.intervals.torques).max(axis=(0, 1)) / limit)[limit > 0.0].max(initial=0.0))

    @property
    def missing(self) -> float:
        """Most of what forces leave of the wrench on the base at any time, over the weight, and over 0.3 m times the weight."""
        return float((self.intervals.missing.max(axis=0) + self.intervals.lost).max())

    @property
    def drift(self) -> float:
        """How far a point that stands is from where it rests, at most, at all times [m]."""
        return float(self.intervals.drift.max())

    @lazy
    def motion(self) -> Motion:
        """The plan at 200 frames a second."""
        n = max(round(SAMPLED * self.duration), 2)
        t = np.linspace(self.curve.t[0], self.curve.t[-1], n + 1)
        q, v, a = self.curve.at(t)
        ground = self.floor if isinstance(self.floor, Terrain | float) else None
        return Motion.of_arrays(self.robot, t, q, v, a, source="plan", ground=ground, quaternion="xyzw", trust=True)

    @property
    def t(self) -> Array:
        """Times of its `motion`, shape (n,) [s]."""
        return self.motion.t

    @property
    def q(self) -> Array:
        """Configurations of its `motion`, shape (n, nq)."""
        return self.motion.q

    @property
    def v(self) -> Array:
        """Velocities of its `motion`, shape (n, nv)."""
        return self.motion.v

    @property
    def a(self) -> Array:
        """Accelerations of its `motion`, shape (n, nv)."""
        return self.motion.a

    def state(self, t: float) -> State:
        """The robot at a time."""
        q, v, _ = self.curve.at(np.array([self._time(t)]))
        return State(self.robot, q[0], v[0])

    def acceleration(self, t: float) -> Array:
        """Its acceleration at a time, shape (nv,)."""
        return np.asarray(self.curve.at(np.array([self._time(t)]))[2][0])

    def forces(self, t: float) -> dict[str, Array]:
        """{contact: forces at its corners, in W, shape (k, 3) [N]} at a time, of the contacts that stand.

        They balance the motion, but for `missing`, and are in their cones where that is certified.
        """
        x = self._time(t)
        (f,), _ = at_instants(self.curve, self.pushes, self.intervals, np.array([x]))
        i = int(self.intervals.at(x)[0])
        sizes = np.cumsum([len(np.asarray(c.corners)) for c in self.contacts.contacts])[:-1]
        each = zip(self.contacts.contacts, np.split(f, sizes), np.split(self.intervals.on[i], sizes), strict=True)
        return {c.name: part for c, part, on in each if on.any()}

    def torques(self, t: float) -> Array:
        """Torques of the motors at a time, shape (nu,) [N, N m]: with `forces(t)` they give the motion.

        They are within their limits where that is certified.
        """
        return np.asarray(at_instants(self.curve, self.pushes, self.intervals, np.array([self._time(t)]))[1][0])

    @lazy
    def schedule(self) -> TorqueSchedule:
        """Its torques over time, without feedback: linear between the ends of the intervals of its certificate.

        They are off `torques(t)` between these by `intervals.off_line` at most.
        """
        x = self.intervals
        t, tau = np.concatenate([x.start, x.end[-1:]]), np.concatenate([x.torques[0], x.torques[1, -1:]])
        return TorqueSchedule(t, tau)

    def plot(self, axes: Axes | Sequence[Axes] | None = None) -> list[Artist]:
        """Forces, what is used of limits, contacts and what is not certified over time; see `rbd.visual.plot_plan`."""
        return drawing("plot_plan")(axes, self)

    def _time(self, t: float) -> float:
        x = as_float(t)
        if not self.curve.t[0] - 1e-9 <= x <= self.curve.t[-1] + 1e-9:
            raise InputError(f"{t!r:.40} s is outside of the plan; expected {self.curve.t[0]:g} to {self.curve.t[-1]:g} s.")
        return float(np.clip(x, self.curve.t[0], self.curve.t[-1]))

    @lazy
    def _axes(self) -> Array:
        return self.pushes.axes[self.pushes.before(self.intervals.start, self.intervals.end)]

    def __str__(self) -> str:
        x, names, drift = self.intervals, ", ".join(c.name for c in self.contacts.contacts), 1e3 * self.drift
        length = float((x.end - x.start)[x.sure].sum()) / self.duration
        says = "possible at every instant, certified" if self.certified else f"certified in {length:.1%} of its time"
        return "\n".join([
            f"a plan of {self.robot.name}, {self.duration:.2f} s on {names}: {says}",
            f"  {len(x.start)} intervals of {1e3 * (x.end - x.start).min():.2g} to {1e3 * (x.end - x.start).max():.2g} ms, "
            "each with a bound of the second derivatives of wrench and torques",
            f"  friction: {self.friction_use:.0%} of mu used; torques: {self.torque_use:.0%} of their limits",
            f"  missing on the base: at most {self.missing:.1e} of the weight; drift of contacts: at most {drift:.2g} mm",
            *self._clear,
        ])  # fmt: skip

    @property
    def _clear(self) -> list[str]:
        """How near links come to the ground, in words."""
        off = self.between.off_ground
        if off is None:
            return []
        link, piece, gap, t = off.nearest
        near = f"; {link!r:.80} comes nearest, to {piece!r:.80} at {t:.2f} s" if piece else ""
        return [f"  links without a contact: {1e3 * gap:.1f} mm or more off the ground{near}"]


def plan(
    robot: Robot,
    keyframes: Mapping[float, Any],
    contacts: Mapping[Any, Any] | str,
    *,
    friction: float = 0.6,
    ground: On = 0.0,
    times: str = "given",
    cost: CentroidCosts | None = None,
    limits: bool | float = True,
    self_collision: bool = True,
    clearance: float | None = 0.0,
    rate: float | None = None,
    hands: Sequence[Contact] = (),
    progress: bool = True,
) -> Plan:
    """A motion from keyframe to keyframe over given contacts, possible at every instant, with its forces and torques.

    Poses between keyframes and forces are found together: the centroid's program (`rbd.centroid`) plans the centre of mass,
    whole-body poses follow it with contacts in place, bodies apart, torques and joints within limits, in turn until both agree.
    The answer is a cubic spline. For each interval of it forces at both ends balance it exactly in their cones, and bounds of
    second derivatives show that nothing is exceeded between; intervals are halved until that is so.

    Where contacts do not resist every wrench (nothing touches, or two points), up to 0.2 % of the weight may be missing.
    Limits of joints and speeds hold, and bodies are apart, at all times (`rbd.planning.kept_limits`). Contacts do not slide.

    Args:
        robot: The robot, with a floating base.
        keyframes: {time [s]: pose}, two or more. A pose is a `State`, q, or targets of `rbd.find_pose` ({foot,
            contact or frame: place, "com": place}), to which contacts that stand are added where they stand; without "com" the
            centre of mass is over their middle. Or the name of a posture, put onto its contacts. It is at rest in
            the first and the last, and passes near the others.
        contacts: {foot or contact: [(start, end), ...]}: when it stands [s], True for all the time. Where it stands the
            keyframes within that time say. Feet are given by name; other contacts as `rbd.PointContact(...)`,
            `rbd.SurfaceContact(...)`, with their own surface `on=` and friction. Times are rounded to knots, 20 to
            2.5 ms apart.
            "search": which foot is put down where, one after the other, between two keyframes in which all feet stand, is
            found (`rbd.planning.contact_search`); each step, and what is between, gets time by what moves. Where steps do not
            get there, leaps are tried, and then steps with one of `hands` on its surface.
        friction: Coulomb's coefficient of feet that are given by name; 86 % are used to find a plan, more at last: see `rate`.
        ground: What those feet stand on: a height [m], `rbd.Ground`, or `rbd.Terrain`.
        times: "given", or "free": all but those of flights are made longer or shorter by one factor, until the shortest plan
            is found, within 10 % or of eight that are tried; those given are the first. Then with times that are shared out
            by what moves, of four.
        cost: What sizes of deviations of the centre of mass and of forces matter equally; None: as usual.
        limits: Whether the robot's torque limits count, or a share of them; 75 % of that are used to find the plan.
        self_collision: Whether bodies are kept apart.
        clearance: How far links without a contact stay off the ground, and off terrain on which contacts stand, at least [m];
            None: they are not kept off.
        rate: Knots a second; None: 50, then 100, and 300, then 400 where nothing stands for a time. Accelerations are linear
            over the time h between two knots, and zero at the first two and the last two: of what a limit of accelerations
            allows in a time T from rest to rest (1 - 3 h / T)^2 can be found. 1 - 0.03 (h / 0.01 s)^2 of the friction is used
            at last, but not less than 86 %.
        hands: Of contacts="search": points that may touch surfaces of their own, `rbd.PointContact("hand", frame, on=rail)`.
        progress: Show a bar on a terminal.

    Raises:
        InputError: keyframes in which a contact that stands is elsewhere, floats or is inside its surface; a contact of which
            no keyframe says where it stands; no feet of that name; times that are none.
        CannotReach: a keyframe's targets; with the nearest pose.
        CannotPlan: there is no such motion, or none was found; with the instants, the limits that contradict each other there,
            and the plan that came nearest; or with the certificate that contacts cannot give the momentum that is asked for.

    Example:
        >>> g1 = rbd.load_robot("g1")
        >>> stand = g1.standing()
        >>> right = {"com": stand.com - [0.0, 0.05, 0.0]}
        >>> plan = rbd.plan(g1, {0.0: stand, 1.0: right}, {"left_sole": True, "right_sole": True}, progress=False)
        >>> print(plan.certified, sorted(plan.forces(1.0)), plan.missing < 1e-9)
        True ['left_sole', 'right_sole'] True
    """
    check_kind("the robot of plan", robot, Robot, "a robot: rbd.load_robot(name)")
    if not robot.floating:
        raise InputError(f"{robot.name} has no floating base, and plan wants one; load it without root=.")
    mu = check_number("friction of plan", friction, 1e-3, 1e3, expected="a coefficient above 0")
    if not isinstance(limits, bool | np.bool_):
        limits = check_number("limits of plan", limits, 0.01, 10.0, expected="True, False, or a share of limits, 0.6")
    check_choice("times of plan", times, ("given", "free"))
    check_flag("self_collision of plan", self_collision)
    check_flag("progress of plan", progress)
    if clearance is not None:
        clearance = check_number("clearance of plan", clearance, 0.0, 1.0, expected="a distance of 0 to 1 m, or None")
    rate = None if rate is None else check_number("rate of plan", rate, 10.0, 5000.0, expected="knots a second, 400")
    check_kind("cost of plan", cost, CentroidCosts | None, "rbd.centroid.CentroidCosts(com=0.02)")
    torques = limited(robot, limits).limits_at
    planned = _Settings(mu, ground, cost, limits, self_collision, clearance, torques, progress, rate).planned
    if times == "free":
        planned = partial(shortest, planned=planned)
    if not isinstance(contacts, str):
        if hands:
            raise InputError("hands of plan are those that contacts='search' may use; give them among contacts, with times.")
        return planned(planned_contacts(robot, keyframes, contacts, friction=mu, ground=ground))
    check_choice("contacts of plan", contacts, ("search",))
    return ContactSearch.of(
        robot, keyframes, friction=mu, ground=ground, limited=limited(robot, limits), self_collision=self_collision,
        hands=hands,
    ).first(planned)  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Settings:
    """What `plan` was given, of each plan that is tried."""

    friction: float
    ground: On
    costs: CentroidCosts | None
    limits: bool | float
    self_collision: bool
    clearance: float | None
    torques: Callable[[Array], tuple[Array, Array]]
    progress: bool
    rate: float | None

    def tries(self, flies: bool) -> list[tuple[float, float, float, float]]:
        """(knots a second, shares of friction and of soles, and of what points press with at least) that are tried in turn."""
        rates = (FLIGHT_RATES if flies else RATES) if self.rate is None else (self.rate,)
        friction, inner = (max(x, 1.0 - y * (PER_SECOND / rates[-1]) ** 2) for x, y in zip(SHARES, SPARED, strict=True))
        last = [(rates[-1], friction, inner, LOADED[1])] if self.rate is not None or not flies else []
        return [*((rate, *SHARES, LOADED[0]) for rate in rates), *last]

    def planned(self, supports: PlannedContacts) -> Plan:
        """The plan over these contacts, at these times.

        Raises:
            CannotPlan: there is none, or none was found.
        """
        robot = supports.robot
        _check_rest(supports, self.limits)
        if (far := too_far_apart(supports)) is not None:
            raise CannotPlan(
                f"there is no plan of {robot.name}: {far}.", t=(far.t,), irreducible=True, certificate=far,
                limits=tuple(Limit("reach", name) for name in far.names),
            )  # fmt: skip
        if (why := (momentum := Momentum.of(supports)).certificate()) is not None:
            raise _without_momentum(f"there is no plan of {robot.name}", why)
        over = None if self.clearance is None else over_ground(supports, self.ground, self.clearance)
        if over is not None and (near := too_near(supports, over)) is not None:
            at, link, said = near
            raise CannotPlan(
                f"there is no plan of {robot.name}: in the keyframe at {at:g} s {said}; give a pose in which it is not, or "
                "clearance=None.", t=(at,), limits=(Limit("ground", link),), irreducible=True,
            )  # fmt: skip
        costs = CentroidCosts(com=FLYING_COM if supports.flies else COM) if self.costs is None else self.costs
        found, failed = list[Plan](), None
        with one_blas_thread(), progress_of((0.0, 1.0), shown=self.progress, doing=f"planning {robot.name}") as done:
            first, last = supports.keys[0][0], supports.keys[-1][0]
            high, tries = momentum.high_flight, self.tries(supports.flies)
            coarse = [(min(COARSE, tries[0][0]), *SHARES, LOADED[0])] * (high is not None)
            tries = coarse + tries
            for i, (rate, friction, inner, loaded) in enumerate(tries):
                bodies = BodyPairs.of(robot) if self.self_collision else None  # which know the poses before
                t = np.linspace(first, last, max(round((last - first) * rate), 8) + 1)
                knots = Knots(supports.on_knots(t), t, friction, inner, loaded, self.torques, bodies, over, costs)
                try:
                    made = _planned(knots, self.friction, self.ground, lambda share, i=i: done((i + share) / len(tries)))
                except NoSolution as error:
                    failed = error
                    continue
                found.append(made)
                if made.certified:
                    return made
                if high is not None and i == 0 and made.intervals.missing.max() > HOPELESS:
                    nearest = _of_nearest(found, self.limits)
                    nearest.args = (f"{nearest.args[0]} {high}",)
                    raise nearest
        raise _failure(supports, found, failed, self.limits, tries[-1][1])


def _check_rest(supports: PlannedContacts, limits: bool | float) -> None:
    """Refuse a first or last keyframe that cannot be held."""
    robot = limited(supports.robot, limits)
    for t, state in (supports.keys[0], supports.keys[-1]):
        if stands := supports.standing(t):
            wanted = Instant(State(robot, state.q), None, stands)
            try:
                wanted.check()
            except CannotMove as error:
                raise _told(f"there is no plan: at rest at {t:g} s", error, wanted, (t,), None) from error


def _told(said: str, error: CannotMove, wanted: Instant, t: tuple[float, ...], best: Plan | None) -> CannotPlan:
    helps = wanted.helps(error)
    return CannotPlan(
        f"{said} {error}{wanted.said(error, helps)}", t=t, plan=best, helps=helps, limits=error.limits,
        irreducible=error.irreducible, certificate=error.certificate, missing=error.missing, excess=error.excess,
        reason=error.reason,
    )  # fmt: skip


def _planned(knots: Knots, friction: float, ground: On, done: Any) -> Plan:
    q, centroid = knots.solved(done)
    supports, group = knots.supports, knots.group
    R, p, _ = supports.paths(knots.t)
    axes = np.array([[[*across(n), n] for n in row] for row in knots.normals.reshape(-1, len(supports.contacts), 3)])
    forces = centroid.forces.copy()
    for f in range(len(supports.contacts)):  # the same resultant at the corners themselves
        own = group == f
        forces[:, own] = knots.inner * forces[:, own] + (1.0 - knots.inner) * forces[:, own].mean(axis=1, keepdims=True)
    pushes = Pushes(
        knots.t, knots.feet.joint[group], knots.on[:, group], knots.corners(R, p), axes[:, group], forces,
        knots.coefficients[group],
    )  # fmt: skip
    curve = Curve.of(supports.robot, knots.t, q)
    keys = np.array([state.q for _, state in supports.keys])
    intervals = certified(curve, pushes, knots.torques)
    sure = bool(intervals.sure.all())  # else it is no plan however far bodies are apart
    kept = between(curve, keys, knots.bodies if sure else None, knots.over, HALVED if sure else 0)
    return Plan(supports.robot, supports, curve, pushes, intervals, kept, friction, ground)


def _failure(
    supports: PlannedContacts, found: list[Plan], failed: NoSolution | None, limits: bool | float, share: float
) -> CannotPlan:
    """Why there is no plan: by the momentum that is asked for, or by the instants of the nearest plan."""
    if not found:
        said = f"no plan of {supports.robot.name} was found with {share:.0%} of the friction"
        if (why := Momentum.of(supports, share).certificate()) is not None:
            return _without_momentum(said, why)
        return CannotPlan(f"{said}: {failed} More knots a second, rate=, come nearer to what limits allow.", t=())
    error = _of_nearest(found, limits)
    best: Plan | None = error.plan
    off = None if best is None or best.intervals.sure.all() else best.between.off_ground
    if off is not None and not off.holds:
        t, words, _ = off.worst
        error.args = (f"{error.args[0]} In that plan, at {t:.3f} s, {words}.",)
    why = Momentum.of(supports, between=True).certificate() if len(supports.keys) > 2 else None
    if why is None:
        return error
    error.momentum = why
    error.args = (f"{error.args[0]} No motion passes through the keyframes' centres of mass exactly: {why}",)
    return error


def _without_momentum(said: str, why: MomentumCertificate) -> CannotPlan:
    return CannotPlan(
        f"{said}: {why}", t=tuple(why.t.tolist()), limits=why.limits, irreducible=True, certificate=why, momentum=why,
        helps=why.helps,
    )  # fmt: skip


def _of_nearest(found: list[Plan], limits: bool | float) -> CannotPlan:
    """Why it is none: the instant at which most is missing, and the limits that contradict each other there."""
    best = max(found, key=lambda plan: float((plan.intervals.end - plan.intervals.start)[plan.intervals.sure].sum()))
    x = best.intervals
    bad = np.flatnonzero(~x.sure)
    if not len(bad):
        t, said, named = best.between.worst
        said = f"no plan was found: at {t:.3f} s {said}; give keyframes between, or more time."
        return CannotPlan(said, t=(t,), plan=best, limits=named)
    worst = int(bad[np.argmax((x.missing[:, bad].max(axis=0)) + np.maximum(-x.slack[:, bad].min(axis=0), 0.0))])
    times = tuple(float(t) for t in x.start[bad])
    t = float((x.start if x.missing[0, worst] >= x.missing[1, worst] else x.end)[worst])
    stands = best.contacts.standing(0.5 * float(x.start[worst] + x.end[worst]))
    state = best.state(t).on(limited(best.robot, limits))
    spans = f"{times[0]:.2f} s" if len(times) == 1 else f"{len(times)} instants from {times[0]:.2f} to {times[-1]:.2f} s"
    try:
        a = best.acceleration(t)
        if stands:
            state = project_velocity(state, stands)
            a = project_acceleration(state, a, stands).a
        wanted = Instant(state, a, stands)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DistantContactWarning)  # poses of what is impossible may not reach
            wanted.check()
    except CannotMove as error:
        return _told(f"no plan was found: at {t:.3f} s, one of {spans},", error, wanted, times, best)
    except NoSolution as error:
        return CannotPlan(f"no plan was found: at {t:.3f} s, one of {spans}, {error}", t=times, plan=best)
    share = float((x.end - x.start)[x.sure].sum()) / best.duration
    said = (
        f"the nearest plan is certified in {share:.1%} of its time: not at {spans}. Give contacts more time to change, or "
        "keyframes of more balance; error.plan is that plan."
    )
    return CannotPlan(said, t=times, plan=best)
