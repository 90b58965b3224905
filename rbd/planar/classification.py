"""Classification of a planar chain: base, end point, open, closed, serial, parallel, mobility, redundancy.

`rbd.mechanism.classify` gives the same for any robot in space; on the robot that a chain is exported to, both agree.
Source: [Duarte2021], "Properties of kinematic chains".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import sympy

from rbd.arrays import Array
from rbd.displayed import Displayed
from rbd.errors import InputError
from rbd.planar.chain import Chain, check_chain
from rbd.planar.constrained_chain import ConstrainedChain
from rbd.planar.expressions import coordinate
from rbd.planar.inverse_kinematics import TOLERANCE, inverse
from rbd.planar.numeric import ROUND_OFF

MEANINGS = {
    "base": "The end of the chain that stays where it is.",
    "end point": "The other end, which can move unless it is pinned: a hand, a foot, a tool.",
    "open or closed": "Open: one path of links leads from base to end. Closed: they form a loop with the ground.",
    "serial or parallel": "Serial: one link after another, no branches, no loops. Parallel: several chains lead to what moves.",
    "degrees of freedom": "Numbers that determine the pose: one angle per hinge, before anything constrains them.",
    "mobility": "Degrees of freedom that relations and pins leave: how many motions are independent.",
    "degrees of freedom of the end point": "Independent directions in which the end point can move: at most two in a plane.",
    "redundancy": "Mobility less the degrees of freedom of the end point: motions that leave it where it is.",
}
"""Meaning of each term, in one line."""


@dataclass(frozen=True)
class ChainClass(Displayed):
    """Classification of a planar chain, with its mobility; ranks are generic: singular poses do not count.

    Attributes:
        base: Its base.
        end_point: Where it ends.
        kind: "serial", or "parallel" where the end point is pinned.
        closed: Whether there is a loop.
        degrees_of_freedom: Of its joints: n.
        mobility: What relations and pins leave of them.
        end_dof: Those of the end point.
        note: Remark on special cases; else empty.

    Example:
        >>> kind = rbd.planar.classify(rbd.planar.Chain(3, lengths=[1.0, 3.0, 3.0]), pinned=[4.0, 0.0])
        >>> kind.kind, kind.closed, kind.degrees_of_freedom, kind.mobility, kind.redundancy
        ('parallel', True, 3, 1, 1)
    """

    base: str
    end_point: str
    kind: str
    closed: bool
    degrees_of_freedom: int
    mobility: int
    end_dof: int
    note: str

    @property
    def redundancy(self) -> int:
        """Mobility less the degrees of freedom of the end point."""
        return self.mobility - self.end_dof

    @property
    def terms(self) -> dict[str, int | str]:
        """{term: its value}, in the order of `MEANINGS`, which says what each means."""
        return {
            "base": self.base,
            "end point": self.end_point,
            "open or closed": "closed" if self.closed else "open",
            "serial or parallel": self.kind,
            "degrees of freedom": self.degrees_of_freedom,
            "mobility": self.mobility,
            "degrees of freedom of the end point": self.end_dof,
            "redundancy": self.redundancy,
        }

    def __str__(self) -> str:
        values = self.terms
        first, second = max(map(len, values)), max(len(str(value)) for value in values.values())
        lines = [f"{word:<{first}}  {value!s:<{second}}  {MEANINGS[word]}" for word, value in values.items()]
        return "\n".join([*lines, self.note] if self.note else lines)


def classify(chain: Chain | ConstrainedChain, *, pinned: Sequence[Any] | Array | None = None) -> ChainClass:
    """Classification of a chain: open or closed, serial or parallel; its mobility and its redundancy.

    Args:
        chain: A chain, or one under relations of its angles. A relation takes degrees of freedom and closes no loop, as a joint
            coupling does.
        pinned: Where the end point is hinged to the ground, x and y [m]: the chain is then closed. Numbers, if the lengths
            are; else any expressions, assumed within reach.

    Raises:
        InputError: not a chain, a pin out of reach, or a pin of a chain under relations.

    Example:
        >>> kind = rbd.planar.classify(rbd.planar.Chain(3))
        >>> kind.kind, kind.closed, kind.mobility, kind.end_dof, kind.redundancy
        ('serial', False, 3, 2, 1)
    """
    n = chain.chain.n if isinstance(chain, ConstrainedChain) else check_chain(chain).n
    mobility, rank, note, end = n, min(n, 2), "", f"the far end of link {n}"
    if isinstance(chain, ConstrainedChain):
        if pinned is not None:
            raise InputError("a pin came for a chain under relations; expected one without: classify(chain.chain, pinned=...).")
        mobility, rank = chain.mobility, _end_rank(chain)
        if rank == 0:
            what = "hold the end point where it is, though links move" if mobility else "leave nothing that moves: a structure"
            note = f"Relations {what}."
    elif pinned is not None:
        mobility, note = _pinned(chain, pinned)
        at = ", ".join(f"{x:g}" if isinstance(x, int | float | np.number) else str(x) for x in pinned)
        rank, end = 0, f"{end}, pinned at ({at})"
    closed = pinned is not None
    kind = "parallel" if closed else "serial"
    return ChainClass("the origin, on the ground", end, kind, closed, n, mobility, rank, note)


def _pinned(chain: Chain, pinned: Any) -> tuple[int, str]:
    """Mobility with the end point pinned, and a remark: n - 2, except where all links must be on one line."""
    structure = "Nothing moves: a structure."
    generic = max(chain.n - 2, 0)
    if not chain.is_numeric:
        if not isinstance(pinned, list | tuple | np.ndarray | sympy.MatrixBase) or len(pinned) != 2 or None in pinned:
            raise InputError(f"pinned is {pinned!r:.80}; expected x and y of the pin.")
        for name, value in zip("xy", pinned, strict=True):
            coordinate(name, value)
        return generic, "If the chain reaches the pin, and is not in line there." + (f" {structure}" if generic == 0 else "")
    arm, found = chain.numeric, inverse(chain, pinned)
    if not found.reachable:
        raise InputError(f"the end point cannot be pinned there: {found.note}")
    r = float(np.hypot(*found.target))
    edge = max(TOLERANCE, ROUND_OFF) * arm.outer
    # The links lie on one line if it takes their whole length, or one of them against all others.
    lined = r >= arm.outer - edge or (2.0 * float(arm.ell.max()) >= arm.outer + r - edge)
    if not lined or chain.n == 1:
        return generic, structure if generic == 0 else ""
    if r <= edge:
        return 1, "The end point is pinned at the base: all links are in line, and turn together about it."
    return 0, f"{structure} All links are in line, the only pose: the slightest play lets them bend."


def _end_rank(chain: ConstrainedChain) -> int:
    """Degrees of freedom of the end point of a chain under relations: the largest rank of its Jacobian over configurations."""
    if not chain.mobility:
        return 0
    J = chain.jacobian()
    if J.is_zero_matrix:
        return 0
    angles = {angle: sympy.Dummy() for angle in chain.chain.q}
    symbols = sorted(J.xreplace(angles).free_symbols - set(angles.values()), key=str)
    rng = np.random.default_rng(7)
    at = chain.reduced.points or tuple(({}, rng.uniform(-3.0, 3.0, chain.coordinates.rows)) for _ in range(5))
    found = []
    for known, s in at[:8]:
        values = {p: known.get(p, float(rng.uniform(0.8, 1.2))) for p in symbols}
        found.append(np.linalg.svd(chain.function(J, parameters=values)(s).reshape(J.shape), compute_uv=False))
    return int(np.max(np.sum(np.array(found) > 1e-7 * np.max(found), axis=1)))
