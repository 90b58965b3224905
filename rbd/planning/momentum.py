"""What contacts can do to the momentum of a robot over a whole plan, and the certificate that it is not enough.

A robot of mass m that is at rest at both ends of a motion of length T, its centre of mass at c_0 = 0 and c_T, needs forces f of
its contacts, at places p, with

    int f dt = -m g T,                int (T - t) f dt = m c_T - m g T^2 / 2,
    int p x f + (T - t)^2 / 2 f x g dt = 0,         int_0^{t_k} (t_k - t) f dt = m c_k - m g t_k^2 / 2 at a keyframe.

The first three are linear momentum, its integral, and angular momentum about c_0; they hold for any motion of its limbs.
Where a contact stands, c_k is within r_k of a place that its limbs' lengths give (`rbd.planning.distances`), in whatever pose.
All are linear in f. So, by Farkas' lemma, there are no such forces in cones |f_t| <= mu f_n if there are a, b, w and d_k with

    u(t, p) = a + (T - t) b + w x p + (T - t)^2 / 2 (g x w) + sum_k max(t_k - t, 0) d_k,        mu |u_t| <= u_n

wherever and whenever something stands, and int f . u dt, which then is not negative, had to be negative: what the middles of
those places give, and m sum_k r_k |d_k| more at most. u is quadratic in
time, so in the cone between two instants if its three coefficients in Bernstein's form are: the certificate holds at all
instants, for forces of any course, impulses too. Where there is no certificate there need not be a motion.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import numpy as np

from rbd.arrays import Array, cross_matrix, each_times, lazy
from rbd.constraints.convex.polygons import across
from rbd.displayed import Displayed
from rbd.planning.distances import Near, centre_of_mass_limits
from rbd.planning.helping import least_factors
from rbd.planning.stays import PlannedContacts, coefficient_of
from rbd.statics.limits import Limit

GRID = 0.05
"""Instants between which u is bounded by its coefficients are so far apart at most [s]."""
COUNTS = 1e-5
"""A contradiction counts where this is missing, over the weight and the time, or more ..."""
REACH = 1e3
"""... and the certificate excludes all forces whose normal parts are on average less than so many times the weight."""
SPEAKS = 0.01
"""Instants count at which forces would be needed of this share of the largest."""
HELPS, HALVED = 16.0, 14
"""Factors up to this are tried for friction and for time; how often their range is halved."""


@dataclass(frozen=True, eq=False)
class Standing:
    """A contact that stands.

    Attributes:
        name: Of the contact.
        start: First instant, counted from the beginning of the plan [s].
        end: Last instant [s].
        points: Its corners, seen from the centre of mass at the beginning, shape (c, 3) [m].
        axes: Two tangents and the normal, as rows, shape (3, 3).
        friction: Coulomb's coefficient.
    """

    name: str
    start: float
    end: float
    points: Array
    axes: Array
    friction: float


@dataclass(frozen=True, eq=False)
class Momentum:
    """What a plan asks of the momentum.

    Attributes:
        mass: Of the robot [kg].
        gravity: Shape (3,) [m/s2].
        stays: What stands, when.
        t: Times of the keyframes after the first, counted from it, shape (n,) [s].
        com: Their centres of mass, seen from that of the first, shape (n, 3) [m].
        rests: Whether it is at rest at the last.
        near: Where else it has to be, and how nearly: times and places are seen from the first keyframe.
    """

    mass: float
    gravity: Array
    stays: tuple[Standing, ...]
    t: Array
    com: Array
    rests: bool
    near: tuple[Near, ...] = ()

    @classmethod
    def of(cls, supports: PlannedContacts, share: float = 1.0, *, between: bool = False) -> Momentum:
        """Of keyframes and contacts.

        Args:
            supports: These.
            share: Of the friction.
            between: Whether the centre of mass is where keyframes between the first and the last have it.
        """
        first, stays = supports.keys[0], list[Standing]()
        for contact, own in zip(supports.contacts, supports.stays, strict=True):
            corners, mu = np.asarray(contact.corners), share * coefficient_of(contact)
            for s in own:
                points = (s.corners - corners.mean(axis=0)) @ s.X.rotation.T + s.X.translation - first[1].com
                axes = np.array([*across(s.normal), s.normal])
                stays.append(Standing(contact.name, s.start - first[0], s.end - first[0], points, axes, mu))
        keys = supports.keys[1:] if between else supports.keys[-1:]
        t, com = np.array([t - first[0] for t, _ in keys]), np.array([state.com - first[1].com for _, state in keys])
        robot, c = supports.robot, first[1].com
        near = tuple(replace(x, t=x.t - first[0], centre=x.centre - c) for x in centre_of_mass_limits(supports))
        rests = bool(supports.standing(supports.keys[-1][0]))
        return cls(robot.mass, np.asarray(robot.gravity), tuple(stays), t, com, rests, near)

    @lazy
    def known(self) -> tuple[Array, Array, Array]:
        """(times, places, distances) of all centres of mass that are known, keyframes first, shapes (k,), (k, 3) and (k,)."""
        t, c = [x.t for x in self.near], np.array([x.centre for x in self.near]).reshape(-1, 3)
        radius = np.array([0.0] * len(self.t) + [x.radius for x in self.near])
        return np.concatenate([self.t, t]), np.vstack([self.com, c]), radius

    @property
    def weight(self) -> float:
        """Mass times gravity [N]."""
        return self.mass * float(np.linalg.norm(self.gravity))

    @lazy
    def need(self) -> Array:
        """What int f . u dt has to be, for each multiplier, shape (6 + 3 k,) [N s, N m s, then N s2]."""
        T, m, g = self.t[-1], self.mass, self.gravity
        rest = np.concatenate([-m * g * T, np.zeros(3)])
        return np.concatenate([rest, *(m * c - 0.5 * m * g * t**2 for t, c in zip(*self.known[:2], strict=True))])

    def spared(self, y: Array) -> float:
        """How much more than that int f . u dt may be at most, by the distances of `near` [N s]."""
        return float(self.mass * self.known[2] @ np.linalg.norm(y[6:].reshape(-1, 3), axis=1))

    @lazy
    def units(self) -> Array:
        """Sizes of the multipliers that matter equally, shape (6 + 3 k,)."""
        reach = max([float(np.abs(s.points).max()) for s in self.stays] or [1.0])
        return np.concatenate([np.ones(3), np.full(3, 1.0 / reach), np.full(len(self.need) - 6, 1.0 / self.t[-1])])

    def direction(self, s: float, e: float, part: int, p: Array) -> Array:
        """The map from multipliers to the coefficient 0, 1 or 2 of u between s and e at a point, shape (3, 6 + 3 k)."""
        T, at = self.t[-1], (s, 0.5 * (s + e), e)[part]
        bend = 0.5 * ((T - s) ** 2, (T - s) * (T - e), (T - e) ** 2)[part]
        later = np.kron(np.maximum(self.known[0] - at, 0.0), np.eye(3))
        return np.hstack([np.eye(3), bend * cross_matrix(self.gravity) - cross_matrix(p), later])

    def grid(self, start: float, end: float) -> Array:
        """Instants of a stay, among them those whose centres of mass are known: u is a quadratic between two of them."""
        known = [start, *(float(t) for t in np.unique(self.known[0]) if start < t < end), end]
        return np.concatenate([
            *(np.linspace(a, b, max(round((b - a) / GRID), 1) + 1)[:-1] for a, b in zip(known[:-1], known[1:], strict=True)),
            [end],
        ])  # fmt: skip

    @lazy
    def cones(self) -> tuple[Array, Array, Array, Array]:
        """(U, stay, corner, t): maps to u in the axes of each point, shape (m, 3, 6 + 3 k), whose they are, and when."""
        U, stay, corner, times = [], [], [], []
        for i, own in enumerate(self.stays):
            t = self.grid(own.start, own.end)
            for j, p in enumerate(own.points):
                parts = [(s, e, part) for s, e in zip(t[:-1], t[1:], strict=True) for part in (0, 1)] + [(t[-2], t[-1], 2)]
                U += [own.axes @ self.direction(s, e, part, p) for s, e, part in parts]
                stay += [i] * len(parts)
                corner += [j] * len(parts)
                times += [(s, 0.5 * (s + e), e)[part] for s, e, part in parts]
        n = len(self.need)
        return np.array(U).reshape(-1, 3, n), np.array(stay, int), np.array(corner, int), np.array(times)

    @lazy
    def flights(self) -> tuple[tuple[float, float], ...]:
        """(start, end) of each time in which nothing stands [s]."""
        out, now = list[tuple[float, float]](), 0.0
        for start, end in sorted((s.start, s.end) for s in self.stays):
            out += [(now, start)] if start - now > 1e-9 else []
            now = max(now, end)
        T = float(self.t[-1])
        return tuple(out + ([(now, T)] if T - now > 1e-9 else []))

    @lazy
    def high_flight(self) -> str | None:
        """What the longest flight takes, in words, if it rises higher than the centre of mass can be over what stands.

        In a time T from one height to the same it rises by g T^2 / 8, and leaves the ground with g T / 2.
        """
        start, end = max(self.flights, key=lambda x: x[1] - x[0], default=(0.0, 0.0))
        T, g, reach = end - start, float(np.linalg.norm(self.gravity)), max((x.radius for x in self.near), default=np.inf)
        if g * T**2 / 8.0 <= reach:
            return None
        return (
            f"Nothing stands {_span(start, end)}: the centre of mass has to leave with about {0.5 * g * T:.2g} m/s and to rise "
            f"by about {g * T**2 / 8.0:.2g} m, and can be {reach:.2g} m from a contact at most."
        )

    @lazy
    def limits(self) -> tuple[Limit, ...]:
        """All that can be relaxed, first what one would rather not blame."""
        names = list(dict.fromkeys(s.name for s in self.stays))
        wide = {s.name for s in self.stays if len(s.points) > 1}
        out = [Limit("friction", name) for name in names] + [Limit("edge", name) for name in names if name in wide]
        out += [Limit("push", name) for name in names] + [Limit("flight", _span(*x)) for x in self.flights]
        out += [Limit("reach", name) for name in dict.fromkeys(x.name for x in self.near)]
        out += [Limit("keyframe", f"{t:g} s") for t in self.t]
        return (*out, Limit("rest", f"{self.t[-1]:g} s")) if self.rests else tuple(out)

    def relaxed(self, limit: Limit) -> Array:
        """Rows whose product with the multipliers is zero where a limit is relaxed, shape (r, 6 + 3 k)."""
        U, stay, corner, _ = self.cones
        n = U.shape[2]
        if limit.kind == "rest":
            return np.eye(n)[:6]
        if limit.kind == "keyframe":
            k = [f"{t:g} s" for t in self.t].index(limit.name)
            return np.eye(n)[6 + 3 * k : 9 + 3 * k]
        if limit.kind == "reach":
            own = 6 + 3 * (len(self.t) + np.array([i for i, x in enumerate(self.near) if x.name == limit.name]))
            return np.eye(n)[(own[:, None] + np.arange(3)).ravel()]
        if limit.kind == "flight":
            start, end = next(x for x in self.flights if _span(*x) == limit.name)
            t = self.grid(start, end)
            each = [self.direction(s, e, part, np.zeros(3)) for s, e in zip(t[:-1], t[1:], strict=True) for part in range(3)]
            return np.vstack([np.eye(n)[3:6], *each])
        own = np.array([s.name == limit.name for s in self.stays])[stay]
        if limit.kind == "edge":
            own &= corner > 0
            first = {(i, t): k for k, (i, j, t) in enumerate(zip(stay, corner, self.cones[3], strict=True)) if j == 0}
            return np.array([U[k, 2] - U[first[stay[k], self.cones[3][k]], 2] for k in np.flatnonzero(own)])
        return U[own, : 2 if limit.kind == "friction" else 3].reshape(-1, n)

    def solved(self, gone: Collection[Limit] = ()) -> tuple[float, Array, Array]:
        """(missing, y, forces): over the weight and the time, multipliers of length one or less, forces at the cones [N s].

        What is missing is the distance of what is needed from what contacts can give, over `units`.

        Args:
            gone: Limits that are relaxed.
        """
        import clarabel
        from scipy.sparse import csc_matrix

        U, stay, _, _ = self.cones
        n, mu = len(self.need), np.array([s.friction for s in self.stays])
        any_force = np.array([Limit("push", s.name) in gone for s in self.stays], bool)
        k = np.flatnonzero(~any_force[stay])
        fixed = [self.relaxed(limit) for limit in gone] + ([] if self.rests else [np.eye(n)[:6]])
        free = self.units[:, None] * _null(np.vstack([np.zeros((0, n)), *fixed]) * self.units)
        inside = U[k] @ free
        inside[:, :2] *= mu[stay[k], None, None]
        if not (d := free.shape[1]):
            return 0.0, np.zeros(n), np.zeros(len(U))
        size, r = self.weight * self.t[-1], len(self.near)
        A = np.vstack([-inside[:, [2, 0, 1]].reshape(3 * len(k), d), np.zeros((1, d)), -np.eye(d)])
        lengths = np.zeros((4 * r, d + r))  # of the multipliers of `near`, as unknowns of their own
        lengths[np.arange(0, 4 * r, 4), d + np.arange(r)] = -1.0
        lengths[np.arange(4 * r) % 4 > 0, :d] = -free[n - 3 * r :]
        A = np.vstack([np.pad(A, ((0, 0), (0, r))), lengths])
        b = np.zeros(len(A))
        b[3 * len(k)] = 1.0
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.max_threads = False, 1
        balls = [clarabel.SecondOrderConeT(4)] * r
        cones = [*[clarabel.SecondOrderConeT(3)] * len(k), clarabel.SecondOrderConeT(d + 1), *balls]
        cost = np.concatenate([free.T @ self.need, self.mass * self.known[2][len(self.t) :]]) / size
        forces = np.zeros(len(U))
        found = clarabel.DefaultSolver(csc_matrix((d + r, d + r)), cost, csc_matrix(A), b, cones, settings).solve()
        x = np.asarray(found.x)[:d]
        if str(found.status) not in ("Solved", "AlmostSolved") or not np.isfinite(x).all():
            return 0.0, np.zeros(n), forces
        forces[k] = size * np.asarray(found.z)[: 3 * len(k) : 3]
        y = free @ x
        return float(-(self.need @ y + self.spared(y))) / size, y, forces

    @property
    def refused(self) -> bool:
        """Whether contacts cannot give what is needed."""
        return self.solved()[0] >= COUNTS

    def certificate(self) -> MomentumCertificate | None:
        """Why no motion gives it what it needs, checked, with an irreducible set of limits; None where none was found."""
        if not self.refused:
            return None
        gone = list[Limit]()
        for limit in self.limits:
            if limit.kind == "push" and any(self._finer(x, limit, gone) for x in self.limits):
                continue
            if self.solved([*gone, limit])[0] >= COUNTS:
                gone.append(limit)
        kept = [x for x in self.limits if x not in gone]
        limits = tuple(x for x in kept if x.kind != "push" or not any(self._finer(y, x, gone) for y in kept))
        _, y, forces = self.solved(gone)
        t = np.unique(self.cones[3][forces > SPEAKS * forces.max(initial=0.0)])
        found = MomentumCertificate(self, y, limits, t)
        return found if found.reach > REACH * self.weight * self.t[-1] else None

    @staticmethod
    def _finer(other: Limit, push: Limit, gone: Collection[Limit]) -> bool:
        return other.name == push.name and other.kind in ("friction", "edge") and other not in gone

    def slower(self, factor: float) -> Momentum:
        """The same, with all times longer by a factor."""
        stays = [replace(s, start=factor * s.start, end=factor * s.end) for s in self.stays]
        near = [replace(x, t=factor * x.t) for x in self.near]
        return replace(self, stays=tuple(stays), t=factor * self.t, near=tuple(near))

    def rougher(self, factor: float) -> Momentum:
        """The same, with all coefficients of friction larger by a factor."""
        return replace(self, stays=tuple(replace(s, friction=factor * s.friction) for s in self.stays))

    def nearer(self, factor: float) -> Momentum:
        """The same, with keyframes nearer to the first by a factor."""
        return replace(self, com=self.com / factor)

    def longer(self, factor: float) -> Momentum:
        """The same, with limbs that reach farther by a factor."""
        return replace(self, near=tuple(replace(x, radius=factor * x.radius) for x in self.near))


@dataclass(frozen=True, eq=False, repr=False)
class MomentumCertificate(Displayed):
    """The certificate that contacts cannot give a robot the momentum that keyframes ask for, whatever it does with its limbs.

    Attributes:
        asked: Keyframes and contacts, an `rbd.planning.momentum.Momentum`.
        y: Multipliers a, w, b and d_k, b that of the last keyframe, shape (6 + 3 n,) [1, 1/m, 1/s].
        limits: An irreducible set of limits that contradict each other.
        t: Instants at which contacts would have to give more, shape (m,), from the first keyframe on [s].

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> stand, low = solo.standing(), {foot.name: [(0.0, 0.2), (0.4, 0.6)] for foot in solo.feet()}
        >>> ahead = stand.q + 0.3 * np.eye(solo.nq)[0]  # 30 cm in 0.6 s, where friction allows 0.1 g T^2 / 2 = 18 cm
        >>> try:
        ...     rbd.plan(solo, {0.0: stand, 0.6: ahead}, low, friction=0.1, progress=False)
        ... except rbd.errors.CannotPlan as error:
        ...     found = error.momentum
        >>> print(sorted({limit.kind for limit in found.limits}), list(found.helps), found.missing > 0.0)
        ['flight', 'friction', 'keyframe'] ['time', 'friction', 'distance'] True
    """

    asked: Momentum
    y: Array
    limits: tuple[Limit, ...]
    t: Array

    @lazy
    def size(self) -> float:
        """Largest length of u."""
        return float(np.linalg.norm(each_times(self.asked.cones[0], self.y), axis=1).max(initial=0.0)) or 1.0

    @property
    def missing(self) -> float:
        """Impulse that is missing at least: -int f . u dt, over the largest |u| [N s]; positive."""
        return float(-(self.asked.need @ self.y + self.asked.spared(self.y))) / self.size

    @property
    def reach(self) -> float:
        """Up to what normal impulses of all contacts, added up, it is valid [N s]: `missing` over mu |u_t| - u_n at worst."""
        U, stay, _, _ = self.asked.cones
        u, mu = each_times(U, self.y), np.array([s.friction for s in self.asked.stays])[stay]
        outside = float((mu * np.linalg.norm(u[:, :2], axis=1) - u[:, 2]).max(initial=0.0)) / self.size
        return self.missing / outside if outside > 0.0 else np.inf * np.sign(self.missing)

    def direction(self, t: float, point: Array) -> Array:
        """The u of a time and a place seen from the first centre of mass, shape (3,): no force there has f . u < 0."""
        return self.asked.direction(t, t, 0, np.asarray(point, float)) @ self.y / self.size

    @lazy
    def helps(self) -> dict[str, float]:
        """{what: least factor with which nothing is contradictory}, the smallest first; empty where none helps.

        "friction" makes all coefficients larger, "time" all durations, "distance" what keyframes are apart smaller, and "reach"
        the distances larger at which the centre of mass may be from contacts.
        """
        asked = self.asked
        ways = {"friction": asked.rougher, "time": asked.slower, "distance": asked.nearer, "reach": asked.longer}
        return least_factors(ways, HELPS, HALVED)

    def __str__(self) -> str:
        share, t = self.missing / (self.asked.weight * self.asked.t[-1]), self.t
        words = (
            f"whatever its limbs do, contacts lack an impulse of {self.missing:.3g} N s or more, {share:.2%} of what carries "
            f"its weight, from {t.min(initial=0.0):.2f} to {t.max(initial=0.0):.2f} s. Together these limits prevent it: "
            f"{'; '.join(map(str, self.limits))}."
        )
        each = [self._does(name, factor) for name, factor in self.helps.items()]
        return words + (f" Least would do: {'; or '.join(each)}." if each else "")

    def _does(self, name: str, factor: float) -> str:
        """What would end it, in units."""
        m, T = self.asked, float(self.asked.t[-1])
        if name == "time":
            return f"{(factor - 1.0) * T:.3g} s more time, {factor:.4g} times as much"
        if name == "distance":
            less = float(np.linalg.norm(m.com, axis=1).max()) * (1.0 - 1.0 / factor)
            return f"keyframes that are {100.0 * less:.3g} cm nearer to the first, {factor:.4g} times as near"
        if name == "reach":
            return f"a centre of mass that gets {factor:.4g} times as far from what stands"
        used = sorted({s.friction for s in m.stays})
        from_to = f"{factor * used[0]:.3g} instead of {used[0]:.3g}, " if len(used) == 1 else ""
        return f"friction of {from_to}{factor:.4g} times as much"

    def __repr__(self) -> str:
        return f"MomentumCertificate({len(self.limits)} limits, {self.missing:.3g} N s missing)"


def _null(rows: Array) -> Array:
    """A basis of what the rows make zero, shape (n, d)."""
    _, s, V = np.linalg.svd(rows)
    return np.asarray(V[int((s > 1e-9 * max(float(s.max(initial=0.0)), 1.0)).sum()) :].T)


def _span(start: float, end: float) -> str:
    return f"from {start:g} to {end:g} s"
