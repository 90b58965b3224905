"""`hold`: a proof that every member of a set can be held at a pose, or a member that cannot, with the proof of that."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from rbd.arrays import Array, check_number, check_whole
from rbd.constraints.constraint import Constraint, listed
from rbd.displayed import Displayed, drawing
from rbd.errors import NoSolution
from rbd.errors.inputs import check_choice
from rbd.model.output_files import write_text
from rbd.model.state import State
from rbd.records import Field, counted, joined, vector
from rbd.robust import verifier
from rbd.robust.pose_bounds import Boxed
from rbd.robust.poses import GivenSet
from rbd.robust.program import Held
from rbd.robust.proofs import Prover, claimed, document_of, of_set, text
from rbd.robust.sets import Boxes, Masses, Member
from rbd.robust.uncertain_loads import UncertainLoads

TORQUES = ("each", "one", "affine")
BEHIND = (1e-8, 1e-6, 1e-4, 1e-2)
"""Shares that `held_behind` tries, one after the other."""
_ALLOWED = 1e-6
"""Largest imbalance of one torque, or of an affine law, over the robot's weight: beyond it nothing is claimed."""


class _Certified:
    """What both answers have: a certificate that can be kept and checked."""

    loads: UncertainLoads
    document: Mapping[str, Any]

    def save(self, path: str | Path) -> Path:
        """Write the certificate, for `rbd verify` or `rbd/robust/verifier.py`; returns its path.

        Args:
            path: Of a JSON file.

        Raises:
            InputError: it cannot be written.
        """
        file = Path(path)
        write_text(file, json.dumps(self.document, indent=None, separators=(",", ":")) + "\n")
        return file

    def verify(self) -> bool:
        """Whether the verifier agrees, in exact arithmetic."""
        return verifier.verify(self.document)[0]


@dataclass(frozen=True, eq=False)
class RobustHold(_Certified, Displayed):
    """A proof that every member of a set can be held at a pose.

    Attributes:
        loads: The set of loads.
        torques: "each": torques of each member; "one": the same of all; "affine": an affine function of the push.
        margin: Every member is held so far from each limit: of friction, |f_t| + margin <= mu f_n at each point [N]; of
            torques, and of other bounds of forces, their distance to the limit [N, N m].
        balance: What is left of one torque, or an affine law, in each row with a motor, at most; 0 of torques of each [N, N m].
        torque: Of "one" and "affine" without a push, shape (nu,) [N, N m]; none of "each".
        gain: Of "affine", torques of a unit push, shape (nu, d).
        parts: Into how many parts the set was split.
        document: The certificate, as a file has it.

    Example:
        >>> solo = rbd.load_robot("solo12")
        >>> push = rbd.robust.PushSet.box("base_link", (-2, -2, 0), (2, 2, 0))
        >>> held = rbd.robust.hold(solo.standing(), solo.feet(friction=0.7), pushes=push, friction=0.5, mass=0.05)
        >>> held.proved, round(held.margin, 3), held.verify()
        (True, 2.205, True)
    """

    loads: UncertainLoads
    torques: str
    margin: float
    balance: float
    torque: Array
    gain: Array
    parts: int
    document: Mapping[str, Any]
    proved: ClassVar[bool] = True

    @property
    def forces(self) -> Array:
        """Weights of the proof at the corners of the pushes and the middle of all else, shape (k, p) [N]; of its first part."""
        return self._of_first_part("forces")

    @property
    def corrections(self) -> Array:
        """What each uncertain number adds to `forces` at its upper end, shape (k, n, p) [N]; of the first part."""
        return self._of_first_part("corrections")

    def _of_first_part(self, name: str) -> Array:
        part = self.document["proof"]
        while "split" in part:
            part = part["below"]
        return np.array(verifier.exact(part[name]), float)

    def export(self, path: str | Path) -> Path:
        """Write a page whose sliders move one member within the set, with its forces: see `rbd.visual.export_members`."""
        return Path(drawing("export_members")(self, path))

    fields: ClassVar[tuple[Field, ...]] = (
        Field("proved", (), "", "whether every member can be held: it can"),
        Field("margin", (), "N, N m", "distance of every member from each limit", certificate=True),
        Field("balance", (), "N, N m", "what one torque or an affine law leaves, at most"),
        Field("parts", (), "", "into how many parts the set was split"),
    )

    def __str__(self) -> str:
        own = {"each": "torques of its own", "one": "the same torques", "affine": "torques that are a law of the push"}
        by = f", by {own[self.torques]}" if self.loads.state.robot.nu else ""
        return (
            f"held: every member of {set_words(self.loads)}, with {kept_words(self.loads, self.margin)}{by}; "
            f"proved in {counted(self.parts, 'part')}."
        )


@dataclass(frozen=True, eq=False)
class Counterexample(_Certified, Displayed):
    """Members of a set that cannot be held at a pose, with the proof: one, or several that no shared torque holds.

    Attributes:
        loads: The set of loads.
        torques: As asked for.
        margin: What was to be kept [N, N m].
        members: The member; of torques that are shared, those that cannot be held together.
        velocities: Virtual velocity of each, shape (k, nv), that proves it: the members' loads do more work along them than
            contact forces and torques can. The largest entry is one.
        reach: The proof holds for forces up to this [N].
        gap: By how much the work is more [W].
        document: The certificate, as a file has it.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> sole = rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.2), friction=0.5)
        >>> state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
        >>> found = rbd.robust.hold(state, [sole], pushes={"box": [(0, 0, 0), (60, 0, 0)]}, mass={"box": 0.1})
        >>> found.proved, found.members[0].push["box"], found.verify()
        (False, array([60.,  0.,  0.]), True)
    """

    loads: UncertainLoads
    torques: str
    margin: float
    members: tuple[Member, ...]
    velocities: Array
    reach: float
    gap: float
    document: Mapping[str, Any]
    proved: ClassVar[bool] = False

    fields: ClassVar[tuple[Field, ...]] = (
        Field("proved", (), "", "whether every member can be held: one, or some together, cannot"),
        Field("margin", (), "N, N m", "what was to be kept"),
        Field("members", (), "", "what cannot be held, in words", lambda x: [str(member) for member in x.members]),
        Field("gap", (), "W", "by how much the work of the load is more than forces and torques can do", certificate=True),
        Field("reach", (), "N", "the proof holds for forces up to this"),
    )

    def __str__(self) -> str:
        kept = f" with {kept_words(self.loads, self.margin)}" if self.margin else ""
        if len(self.members) == 1:
            return f"a member cannot be held{kept}: {self.members[0]}."
        what = "one torque" if self.torques == "one" else "torques that are affine in the push"
        some = "; ".join(map(str, self.members[:2])) + ("; ..." if len(self.members) > 2 else "")
        return (
            f"no {what} hold{'s' if self.torques == 'one' else ''} these {len(self.members)} members{kept}: {some}. "
            "torques='each' asks for torques of each member, as motors that hold positions give."
        )


def kept_words(loads: UncertainLoads, margin: float) -> str:
    """A margin with its units: of contact forces, and of the torques and forces of motors that have a limit."""
    robot, (low, high) = loads.state.robot, loads.limits
    limited = [robot.actuated_names[i] for i in np.flatnonzero(np.isfinite(low) | np.isfinite(high))]
    slides = {robot.model.joints[robot.joint_id(name)].shortname().startswith("JointModelP") for name in limited}
    words = [f"{margin:.4g} N to each limit of contact forces"]
    words += [f"{margin:.4g} N m to each torque limit"] if False in slides else []
    words += [f"{margin:.4g} N to each limit of motors that slide"] if True in slides else []
    return " and ".join(words)


def set_words(loads: UncertainLoads) -> str:
    """What is uncertain, as text."""
    words = [f"pushes at {s.frame} within {counted(len(np.asarray(s.corners)), 'corner')}" for s in loads.pushes]
    links = list(dict.fromkeys(name.partition(" of ")[0] for name in loads.names if name.startswith("mass")))
    count = sum(name.startswith("mass") for name in loads.names)
    words += [counted(count, "mass", "masses")] if links else []
    count = sum(name.startswith("joint ") for name in loads.names)
    words += [counted(count, "joint")] if count else []
    boxes = list(dict.fromkeys(name.split("centre of mass of ")[1] for name in loads.names if "centre of mass" in name))
    words += [f"centre of mass of {joined(boxes, 3)}"] if boxes else []
    rough = sorted(set(loads.balance.sets.mu.tolist()))
    words += [f"friction of at least {rough[0]:.4g}{f' to {rough[-1]:.4g}' if len(rough) > 1 else ''}"] if rough else []
    return "the set (" + (", ".join(words) or "the robot as it is") + ")"


def hold(
    state: State,
    contacts: Sequence[Constraint],
    *,
    pushes: object = None,
    friction: float | Mapping[str, float] | None = None,
    mass: Masses = None,
    com: Boxes = None,
    joints: Boxed | None = None,
    torques: str = "each",
    margin: float = 0.0,
    loops: bool = True,
    most_parts: int = 64,
) -> RobustHold | Counterexample:
    """A proof that a robot can be held at a pose whatever member of a set is true, or a member that it cannot be held with.

    For every push w, mass m and centre of mass c of the set there are contact forces f and torques with

        S^T tau + J^T f + J_P^T w = g(m, m c),    |f_t| + margin <= mu f_n,    least + margin <= tau <= most - margin

    mu the least coefficients: with more friction the same forces are possible. The set of loads is a polytope of pushes plus
    an affine image of a box (`rbd.robust.uncertain_loads`); the proof has forces at the corners and an affine correction for
    masses and centres of mass, and is found by one conic program, whatever their number. That there is such a proof is
    sufficient: where there is none the set is split, and a member that cannot be held is looked for.

    Args:
        state: The pose; v must be zero.
        contacts: What it stands on, at least one.
        pushes: A `rbd.robust.PushSet`, several (any of each at the same time), or {frame: corners (k, 3) or (k, 6) in W
            [N, N m]}. Without one there is no push.
        friction: Least coefficient of all contacts that have one, or {contact: it}; that of the contacts if not given.
        mass: {link: (low, high) [kg], or a share as 0.05 for +-5 %}, or a share of all links. A link counts with all that is
            fixed to it.
        com: {link: half-width, or three of them, of a box [m]} about the file's place, in the axes of the link's frame.
        joints: {joint: (low, high) [rad, m]}, a box of poses: other joints and the base stay as in the state; points of
            contacts move with their links, and their planes stay as in the middle of the box.
        torques: "each": each member has its own torques, as of motors that hold positions. "one": the same for all, sent
            without knowing the member; "affine": an affine function of the push, which is measured. Where a robot has joints,
            one torque cannot balance two loads unless contact forces alone can take their difference.
        margin: Every member is to keep so far from each limit [N, and N m of torques]; what is proved may be more.
        loops: Whether the robot's own loops hold.
        most_parts: Into how many parts the set may be split.

    Returns:
        The proof, or members that cannot be held; `proved` says which. Both are checked in exact arithmetic before they are
        returned, and `save` keeps them. What is neglected: that the rounding between the robot's numbers and M, J, g is within
        its bound (a hundred operations a joint) is stated, not checked.

    Raises:
        NotAtRest: if `|v|` exceeds 1e-9, or what a contact touches moves.
        InputError: sets that are empty, reversed or none.
        UnknownName: frames, links or contacts that are not there, with the nearest names.
        NoSolution: neither was proved; names the part that was not decided.

    Example:
        >>> box = rbd.testing.box(mass=10.0)
        >>> sole = rbd.SurfaceContact("base", "box", half_lengths=(0.2, 0.2), friction=0.5)
        >>> state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
        >>> held = rbd.robust.hold(state, [sole], pushes={"box": [(0, 0, 0), (40, 0, 0)]}, mass={"box": 0.1})
        >>> held.proved, round(4 * held.margin, 3)  # 0.5 x 9 kg x 9.81 m/s2 - 40 N, at four points
        (True, 4.145)
    """
    check_choice("torques", torques, TORQUES)
    kept = check_number("margin", margin, 0.0, 1e9, expected="a force [N], zero or more")
    most = check_whole("most_parts", most_parts, 100_000, least=1)
    given = GivenSet(state, listed(contacts), pushes, friction, mass, com, joints, loops)
    return decided(given, torques, kept, most)


def decided(given: GivenSet, torques: str, margin: float, most_parts: int) -> RobustHold | Counterexample:
    """The answer over a set, of a box of poses with its own bounds in each part.

    Raises:
        NoSolution: neither was proved.
    """
    loads, n = given.whole, len(given.whole.columns)
    search = _Search(given, torques, margin, most_parts if torques == "each" else 1)
    proof = search.over(-np.ones(n), np.ones(n))
    if search.against is not None:
        return search.against
    assert proof is not None
    slack, left = min(search.shown)[0], max(each[1] for each in search.shown)
    shown = claimed(slack)
    claim = {"says": "held", "torques": torques, "margin": text(shown), "balance": text(left)}
    torque = np.array([float(Fraction(x)) for x in proof.get("torque", [])])
    gain = np.array([[float(Fraction(x)) for x in row] for row in proof.get("gain", [])])
    gain = gain.reshape(loads.state.robot.nu, loads.components.shape[1] if torques == "affine" else 0)
    document = document_of(loads, _about(loads), claim, proof)
    return RobustHold(loads, torques, float(shown), float(left), torque, gain, search.parts, document)


def held_behind(
    given: Callable[[float], GivenSet], torques: str, margin: float, most_parts: int = 1, shares: Sequence[float] = BEHIND
) -> tuple[float, RobustHold] | None:
    """(share, proof): by which share what is proved stays behind what a program in floating point finds; None: by none of some.

    Args:
        given: The set that stays behind by a share.
        torques: As of `hold`.
        margin: What is kept.
        most_parts: As of `hold`.
        shares: That are tried, one after the other.
    """
    for share in shares:
        with suppress(NoSolution):
            if isinstance(answer := decided(given(share), torques, margin, most_parts), RobustHold):
                return share, answer
    return None


def at_pose(alone: Counterexample, joints: Mapping[str, float]) -> Counterexample:
    """The same as a member of a box of poses."""
    return replace(alone, members=tuple([replace(member, joints=joints) for member in alone.members]))


def counterexample(prover: Prover, against: Mapping[str, Any], margin: float) -> Counterexample:
    """The answer with members that cannot be held, of their proof."""
    loads, torques = prover.loads, prover.torques
    claim = {"says": "refuted", "torques": torques, "margin": text(Fraction(margin)), "balance": "0"}
    gap = verifier.gap(prover.exact_data, against, torques, Fraction(margin))
    numbers = [np.array([float(Fraction(x)) for x in m["parameters"]]) for m in against["members"]]
    members = tuple([loads.member(m["vertex"], t) for m, t in zip(against["members"], numbers, strict=True)])
    velocities = np.array([[float(Fraction(x)) for x in y] for y in against["velocities"]])
    document = document_of(loads, _about(loads), claim, against)
    return Counterexample(
        loads, torques, margin, members, velocities, float(Fraction(against["reach"])), float(gap), document
    )  # fmt: skip


def _about(loads: UncertainLoads) -> dict[str, Any]:
    """What a file says of its data in words."""
    return {
        "robot": loads.state.robot.name,
        "q": loads.state.q.tolist(),
        "contacts": [r.name for r in loads.balance.rows],
        "set": set_words(loads),
        "points of pushes": [f"{s.frame} + {vector(np.asarray(s.offset))}" for s in loads.pushes],
        "numbers": list(loads.names),
        "links": [list(link) for link in loads.links],
        "rounding": "forces_radius and load_radius bound 100 operations a joint, of relative error 2^-53 each, from the "
        "robot's file to these numbers: 66 of its rotation (22 an entry, three times that as an error of all it carries), 4 of "
        "its place, 30 of axes, masses and sums; over a box of joints interval arithmetic bounds the rest. Stated, and not "
        "checked by the verifier",
    }


class _Search:
    """Proofs over parts of a set, until all are proved, one is refuted, or there are too many."""

    def __init__(self, given: GivenSet, torques: str, margin: float, most: int) -> None:
        self.given, self.prover, self.margin, self.most, self.parts = given, Prover(given.whole, torques), margin, most, 1
        self.against: Counterexample | None = None
        self.shown: list[tuple[Fraction, Fraction]] = []

    def over(self, low: Array, high: Array) -> dict[str, Any] | None:
        """The proof over a box of numbers t; None where a member was found that cannot be held.

        Raises:
            NoSolution: neither, and there may be no more parts.
        """
        own = bool(self.prover.loads.turns) and bool((high - low < 2.0).any())
        prover, ends = self._of_part(low, high) if own else (self.prover, (low, high))
        L, torques = prover.loads, prover.torques
        found, proof = prover.witness(*ends, self.margin)
        if proof is not None:
            exact_ends = [[Fraction(float(x)) for x in end] for end in ends]
            slack, left = verifier.leaf(prover.exact_data, proof, exact_ends[0], exact_ends[1], torques)
            if slack >= Fraction(self.margin) and left <= Fraction(_ALLOWED * L.balance.unit):
                self.shown.append((slack, left))
                return proof | ({"box": text([low, high]), "data": of_set(L)} if own else {})
        against = None if L.turns and torques == "each" else prover.refuted(found, *ends, self.margin)
        if against is not None:
            self.against = counterexample(prover, against, self.margin)
        elif L.turns:
            self.against = self._alone(prover, found, *ends)
        if self.against is not None:
            return None
        weight = np.abs(np.nan_to_num(found.velocities) @ L.columns.T).sum(axis=0) * (high - low)
        for i, (S, _) in L.turns.items():  # what is missed is of second order: by how far points move
            weight[i] = np.abs(S[L.state.robot.unactuated]).sum() * L.balance.unit
        if self.parts >= self.most or not len(weight):
            raise NoSolution(self._undecided(low, high, found.value))
        i = int(np.argmax(weight if weight.any() else high - low))
        at = 0.5 * (low[i] + high[i])
        self.parts += 1
        below_high, above_low = high.copy(), low.copy()
        below_high[i] = above_low[i] = at
        below = self.over(low, below_high)
        above = None if below is None else self.over(above_low, high)
        return None if above is None else {"split": i, "at": text(Fraction(at)), "below": below, "above": above}

    def _of_part(self, low: Array, high: Array) -> tuple[Prover, tuple[Array, Array]]:
        """Bounds of a part of a box of poses, and its numbers t: those of joints are again from -1 to 1."""
        whole = self.prover.loads
        turned = np.isin(np.arange(len(low)), list(whole.turns))
        prover = Prover(self.given.part({i: (low[i], high[i]) for i in whole.turns}), self.prover.torques)
        return prover, (np.where(turned, -1.0, low), np.where(turned, 1.0, high))

    def _alone(self, prover: Prover, found: Held, low: Array, high: Array) -> Counterexample | None:
        """The worst pose that a search finds, where it cannot be held: alone it has no bounds over a box, so that is proved."""
        corner, t, worst = Prover(prover.loads, "each").worst(found, low, high, self.margin)
        if worst.value >= self.margin:
            return None
        where = self.given.pose_of(prover.loads.member(corner, t))
        with suppress(NoSolution):
            alone = decided(self.given.at_pose(where), prover.torques, self.margin, 1)
            if isinstance(alone, Counterexample):
                return at_pose(alone, where)
        return None

    def _undecided(self, low: Array, high: Array, value: float) -> str:
        L = self.prover.loads
        part = [
            f"{name} within {low[i]:g} to {high[i]:g} half-widths" for i, name in enumerate(L.names) if high[i] - low[i] < 2.0
        ]
        where = f"the part with {joined(part, 4)}" if part else "the set as a whole"
        best = "no forces were found" if not np.isfinite(value) else f"the largest margin found is {value:.3g} N (N m)"
        more = "a larger most_parts, a smaller set, or a smaller margin" if self.prover.torques == "each" else "torques='each'"
        asked = f"{self.margin:g} N (N m) was asked for" if self.margin else "it must not be negative"
        return f"{L.state.robot.name}: not decided in {where}: {best}; {asked}. Try {more}."
