"""Proofs in fractions of what programs found in floating point: that a set is held, or that some members cannot be.

What rounding leaves is covered by the proof itself: a right inverse of the idle rows repairs what forces miss, and a virtual
velocity is moved into the cones that it must be in. `rbd.robust.verifier` is the judge of both, here as for a file.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from rbd.arrays import Array, lazy
from rbd.robust import verifier
from rbd.robust.program import Held, Repair, Way, largest, right_inverse
from rbd.robust.uncertain_loads import UncertainLoads

_BITS = 42
"""Of a force, below the robot's weight."""
_KEPT = Fraction(1, 2**40)
"""Share of a margin by which what is claimed is less than what is proved, at most."""
_REACHES = (1e9, 1e6, 1e4, 100.0)
"""Forces, over the robot's weight, up to which a contradiction is looked for."""
_STEPS = 8
"""Of the search of a member that cannot be held, from one corner."""
_CORNERS = 12
"""At which it begins."""


def text(values: Any) -> Any:
    """Arrays, fractions and floats as JSON can have them: exact, as "p/q"; infinity as None."""
    if isinstance(values, np.ndarray | list | tuple):
        return [text(x) for x in values]
    if isinstance(values, Fraction):
        return str(values)
    return str(Fraction(float(values))) if np.isfinite(values) else None


def whole(values: Array) -> list[int]:
    """Numbers of rows or columns."""
    return [int(x) for x in values]


def of_set(loads: UncertainLoads) -> dict[str, Any]:
    """The data that change with the part of a box of poses."""
    return {
        "forces": text(loads.balance.per_weight),
        "forces_radius": text(loads.forces_radius),
        "loads": text(loads.corners),
        "load_radius": text(loads.load_radius),
        "parameters": text(loads.columns),
        "slopes": [[i, text(loads.turns[i][0]), text(loads.turns[i][1])] for i in sorted(loads.turns)],
    }


def document_of(
    loads: UncertainLoads, about: Mapping[str, Any], claim: Mapping[str, Any], proof: Mapping[str, Any]
) -> dict[str, Any]:
    """The certificate as a file has it."""
    balance, robot = loads.balance, loads.state.robot
    low, high = loads.limits
    data = {
        "idle": whole(robot.unactuated),
        "motors": whole(robot.actuated),
        "cones": [whole(cone) for cone in balance.sets.cone_columns],
        "friction": text(balance.sets.mu),
        "lower": text(balance.sets.lower),
        "upper": text(balance.sets.upper),
        "torque_low": text(np.asarray(low)),
        "torque_high": text(np.asarray(high)),
        "pushes": text(loads.components),
    } | of_set(loads)
    found = {"kind": verifier.KIND, "about": dict(about), "data": data, "claim": dict(claim), "proof": dict(proof)}
    return found | {"sha256": verifier.digest(found)}


@dataclass(frozen=True, eq=False)
class Prover:
    """Searches proofs over a set of loads.

    Attributes:
        loads: The set.
        torques: "each", "one" or "affine".
    """

    loads: UncertainLoads
    torques: str

    @lazy
    def exact_data(self) -> Any:
        """The data in fractions."""
        return verifier.data_of(document_of(self.loads, {}, {}, {})["data"])

    def witness(self, low: Array, high: Array, margin: float) -> tuple[Held, dict[str, Any] | None]:
        """(what the program found, its proof), over a box of numbers t; no proof where the margin is less."""
        L, middle, half = self.loads, 0.5 * (low + high), 0.5 * (high - low)
        part, columns = L.within(middle), half[:, None] * L.columns
        turns = {i: (half[i] * S, half[i] * own) for i, (S, own) in L.turns.items()}
        repair = Repair.of(part, turns)
        if self.torques == "each":  # corners have nothing in common
            each = [
                largest(
                    part, load[None], columns, turns={i: (S, own[v : v + 1]) for i, (S, own) in turns.items()}, repair=repair
                )
                for v, load in enumerate(part.corners)
            ]
            found = replace(
                each[0], value=min(one.value for one in each), forces=np.concatenate([one.forces for one in each]),
                corrections=np.concatenate([one.corrections for one in each]),
                velocities=np.array([one.velocities[0] * (one.value <= each[_least(each)].value) for one in each]),
            )  # fmt: skip
        else:
            found = largest(part, part.corners, columns, self.torques, components=L.components, turns=turns, repair=repair)
        enough = found.value >= margin - 1e-6 * L.balance.unit
        return found, self.rounded(found, part, columns, turns) if enough else None

    def rounded(
        self, found: Held, part: UncertainLoads, columns: Array, turns: Mapping[int, tuple[Array, Array]]
    ) -> dict[str, Any]:
        """The answer of a program as short fractions, its errors in the idle rows repaired to rounding."""
        idle, unit = part.state.robot.unactuated, part.balance.unit
        A = part.balance.per_weight[idle]
        X = right_inverse(part)
        forces, corrections = found.forces.copy(), found.corrections.copy()
        for _ in range(2):
            squares = sum((0.5 * corrections[:, i] @ S[idle].T for i, (S, _) in turns.items()), np.zeros((1, len(idle))))
            forces -= ((forces @ A.T) + squares - part.corners[:, idle]) @ X.T
            wanted = np.repeat(columns[None], len(forces), axis=0)
            for i, (S, own) in turns.items():
                wanted[:, i] += own - forces @ S.T
            corrections -= ((corrections @ A.T) - wanted[:, :, idle]) @ X.T
        step = 2.0 ** (np.floor(np.log2(unit)) - _BITS)
        proof = {
            "forces": text(np.round(forces / step) * step),
            "corrections": text(np.round(corrections / step) * step),
            "inverse": text(X),
        }
        if self.torques != "each":
            proof |= {"torque": text(np.round(found.torque / step) * step), "gain": text(found.gain)}
        return proof

    def refuted(self, found: Held, low: Array, high: Array, margin: float) -> dict[str, Any] | None:
        """A proof that members of a box cannot be held with a margin; None where none is found."""
        return self._refuted_alone(found, low, high, margin) if self.torques == "each" else self._refuted_together(margin)

    def worst(self, found: Held, low: Array, high: Array, margin: float) -> tuple[int, Array, Held]:
        """(corner, t, answer) of the member with the least margin that the search finds, t within a box."""
        L, best = self.loads, None
        weight = np.abs(np.nan_to_num(found.velocities)).sum(axis=1)
        for v in np.argsort(-weight, kind="stable")[:_CORNERS]:
            signs = np.sign(np.nan_to_num(found.velocities[v]) @ L.columns.T)
            for _ in range(_STEPS):
                t = L.inside(0.5 * (low + high) + 0.5 * (high - low) * signs)
                own = largest(L.within(t), L.load(int(v), t)[None], np.zeros((0, L.corners.shape[1])))
                if best is None or own.value < best[2].value:
                    best = int(v), t, own
                turned = np.sign(L.slopes(int(v), np.nan_to_num(own.forces[0])) @ np.nan_to_num(own.velocities[0]))
                turned = np.where(turned == 0.0, signs, turned)
                if own.value < margin or (turned == signs).all():
                    break
                signs = turned
            if best is not None and best[2].value < margin:
                break
        assert best is not None
        return best

    def _refuted_alone(self, found: Held, low: Array, high: Array, margin: float) -> dict[str, Any] | None:
        vertex, t, own = self.worst(found, low, high, margin)
        return self.contradiction([(vertex, t)], own.velocities, margin) if own.value < margin else None

    def _refuted_together(self, margin: float) -> dict[str, Any] | None:
        """Members whose torques follow one law and that cannot be held together: the corners, and each column's ends there."""
        L = self.loads
        corners, ends = _together(L)
        for members in (corners, corners + ends):
            stacked = np.array([L.load(v, t) for v, t in members])
            components = L.components[[v for v, _ in members]]
            own = largest(L, stacked, np.zeros((0, stacked.shape[1])), self.torques, components=components)
            if own.value < margin and (proof := self.contradiction(members, own.velocities, margin)) is not None:
                return proof
        return None

    def contradiction(self, members: list[tuple[int, Array]], velocities: Array, margin: float) -> dict[str, Any] | None:
        """The proof of virtual velocities that members cannot be held, checked in fractions; None where it is none."""
        L, robot = self.loads, self.loads.state.robot
        size = float(np.abs(velocities).max(initial=0.0))
        if not (np.isfinite(size) and size > 0.0):
            return None
        Y, places = velocities / size, [L.within(t).balance.per_weight for _, t in members]
        low, high = L.limits
        limitless = robot.actuated[~(np.isfinite(low) & np.isfinite(high))]
        if self.torques == "each":
            Y[:, limitless] = 0.0
        else:
            Y[0, limitless] -= Y[:, limitless].sum(axis=0)
        inward = self._inward()
        for step in (0.0, 1.0, 2.0, 8.0):
            moved = Y + step * np.array([self._outside(P.T @ y) for P, y in zip(places, Y, strict=True)])[:, None] * inward
            exact = text(np.round(moved * 2.0**50) / 2.0**50)
            shares = self._shares(members)
            for reach in _REACHES:
                proof = {
                    "members": [{"vertex": v, "parameters": text(t)} for v, t in members],
                    "velocities": exact,
                    "shares": shares,
                    "reach": text(reach * L.balance.unit),
                }
                if verifier.gap(self.exact_data, proof, self.torques, Fraction(margin)) > 0:
                    return proof
        return None

    def _shares(self, members: list[tuple[int, Array]]) -> list[dict[str, str]]:
        """Each member's torques as a combination of those of base members: itself; the first; of an affine law, corners."""
        if self.torques == "each":
            return [{str(k): "1"} for k in range(len(members))]
        if self.torques == "one":
            return [{"0": "1"} for _ in members]
        points = [[Fraction(1), *map(Fraction, self.loads.components[v].tolist())] for v, _ in members]
        bases: list[int] = []
        for k in range(len(members)):
            if _combination(points[k], [points[b] for b in bases]) is None:
                bases.append(k)
        out = []
        for point in points:
            found = _combination(point, [points[b] for b in bases])
            out.append({str(b): str(s) for b, s in zip(bases, found or [], strict=True) if s})
        return out

    def _outside(self, r: Array) -> float:
        """How far a velocity is from where all points that it moves separate."""
        sets = self.loads.balance.sets
        R = r[sets.cone_columns]
        worst = (R[:, 2] + sets.mu * np.hypot(R[:, 0], R[:, 1])).max(initial=0.0)
        half = np.isfinite(sets.lower) & ~np.isfinite(sets.upper)
        blur = 4.0 * float(self.loads.forces_radius.max(initial=0.0)) * len(self.loads.forces_radius) + 2.0**-48
        return max(float(worst), float(r[half].max(initial=0.0)), 0.0) + blur

    def _inward(self) -> Array:
        """A velocity of the base that moves all points away from their ground at 1 m/s or more, as nearly as there is one."""
        balance, idle = self.loads.balance, self.loads.state.robot.unactuated
        wanted = np.zeros(balance.sets.size)
        wanted[balance.sets.cone_columns[:, 2]] = -1.0
        out = np.zeros(balance.per_weight.shape[0])
        out[idle] = np.linalg.lstsq(balance.per_weight[idle].T, wanted, rcond=1e-9)[0]
        return out


def _least(each: list[Held]) -> int:
    """The number of the least margin."""
    return int(np.argmin([one.value for one in each]))


def _combination(point: list[Fraction], others: list[list[Fraction]]) -> list[Fraction] | None:
    """Numbers with sum of numbers times others = point, exactly; None where there are none. The others are independent."""
    rows = [[*(o[i] for o in others), point[i]] for i in range(len(point))]
    n, at = len(others), 0
    for column in range(n):
        pivot = next((i for i in range(at, len(rows)) if rows[i][column]), None)
        if pivot is None:
            return None
        rows[at], rows[pivot] = rows[pivot], rows[at]
        rows[at] = [x / rows[at][column] for x in rows[at]]
        for i in range(len(rows)):
            if i != at and rows[i][column]:
                rows[i] = [x - rows[i][column] * y for x, y in zip(rows[i], rows[at], strict=True)]
        at += 1
    return [rows[i][n] for i in range(n)] if not any(row[n] for row in rows[at:]) else None


def claimed(slack: Fraction) -> Fraction:
    """What is claimed of a margin: a short fraction below it, by less than 2^-38 of it."""
    if slack <= 0:
        return Fraction(0)
    step = Fraction(2) ** (slack.numerator.bit_length() - slack.denominator.bit_length()) * _KEPT
    return slack // step * step


def _together(L: UncertainLoads) -> tuple[list[tuple[int, Array]], list[tuple[int, Array]]]:
    """Members that share torques: the corners of the pushes, and both ends of each uncertain number at the first of them."""
    n = len(L.columns)
    ends = [(0, sign * row) for row in np.eye(n) for sign in (1.0, -1.0)]
    return [(v, np.zeros(n)) for v in range(len(L.corners))], ends


def worst_along(
    L: UncertainLoads,
    vertices: Array,
    margin: float,
    way: Way,
    beside: Way | None,
    most: float,
    torques: str = "each",
    components: Array | None = None,
) -> tuple[list[tuple[int, Array]], Held]:
    """(members as (corner, t), answer) of the least extent along a way that the search finds: one, or some that share torques.

    Args:
        L: The loads.
        vertices: Numbers of corners at which it begins.
        margin: What is kept.
        way: What the extent adds.
        beside: What a further number of any size adds, or None.
        most: Larger extents are not looked for.
        torques: As of `largest`.
        components: As of `largest`, at all corners.
    """
    best: tuple[int, Array, Held] | None = None
    nothing, worst = np.zeros((0, L.corners.shape[1])), list[tuple[int, Array]]()

    def alone(members: list[tuple[int, Array]], of: UncertainLoads, torques: str) -> Held:
        loads = np.array([L.load(v, t) for v, t in members])
        ways, free = (None if w is None else Way(np.array([w.at(v, t) for v, t in members]), nothing) for w in (way, beside))
        own = None if components is None else components[[v for v, _ in members]]
        return largest(
            of, loads, nothing, torques, components=own, margin=margin, ways=ways, free=free, at_most=most,
        )  # fmt: skip

    for v in vertices[:_CORNERS].tolist():
        signs = np.zeros(len(L.columns))
        for _ in range(_STEPS):
            t = L.inside(signs)
            found = alone([(v, t)], L.within(t), "each")
            if best is None or found.value < best[2].value:
                best = v, t, found
            if not np.isfinite(found.value):
                break
            slopes = L.slopes(v, found.forces[0]) + found.value * way.slopes(v)
            slopes += 0.0 if beside is None else found.aside * beside.slopes(v)
            turned = np.sign(slopes @ found.velocities[0])
            turned = np.where(turned == 0.0, signs, turned)
            if (turned == signs).all():
                break
            signs = turned
        worst.append((v, t))
    assert best is not None
    if torques == "each":
        return [best[:2]], best[2]
    corners, ends = _together(L)
    members = [*corners, *[(v, t) for v, t in worst if t.any()], *ends]
    return members, alone(members, L, torques)
