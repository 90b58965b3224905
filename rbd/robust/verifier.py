"""Check a certificate file of `rbd.robust` in exact arithmetic; it imports the standard library alone, and runs on its own.

    python verifier.py file.json            exit code 0: the claim is proved; 1: it is not; 2: no certificate file
The data: rows with a motor and `idle` ones; generalised forces P of unit contact forces, each within its `forces_radius`; loads
at the corners of the set of pushes, and for each uncertain number t in [-1, 1] a column D; a load is within `load_radius`.
Numbers of a pose change P too, by their `slopes`. A member L = sum of shares of `loads` + sum of t D is held by
    P f + S^T tau = L,    |f_t| + margin <= friction f_n,    lower + margin <= f <= upper - margin,    the same of torques.
A claim "held": each member is. Its proof has forces f at each corner of the pushes, and F for each t there. What they miss in
the idle rows, products of slopes, F, t and t too, a right inverse X repairs: P X = 1 + e, |e| <= E, and missed + E y < y shows
that X z is added, |z| <= y. With fix = |X| y checked is
    |f_t| + sum |F_t| + fix + margin <= friction (f_n - sum |F_n| - fix)      and the same of bounds and torques.
A set may be split; parts of a box of poses have their own data. Torques of "each" member, "one" for all, or "affine" in the
push; they miss `balance` at most. A claim "refuted": some members cannot be held, together if they share torques. By virtual
velocities y of them the sum of y . L is more than that of y . (P f + S^T tau) with numbers up to `reach`.
"""

import hashlib
import json
import math
import sys
from fractions import Fraction
from pathlib import Path
from types import SimpleNamespace
from typing import Any

KIND, ZERO, ONE = "rbd.robust certificate 2", Fraction(0), Fraction(1)
NO_CERTIFICATE = (OSError, LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError)


def digest(document: dict[str, Any]) -> str:
    """SHA-256 of all but the digest itself, as JSON with sorted keys."""
    return hashlib.sha256(json.dumps({**document, "sha256": ""}, sort_keys=True).encode()).hexdigest()


def exact(value: Any) -> Any:
    """The same with fractions in place of texts."""
    if isinstance(value, float):
        raise ValueError(f"{value} is no fraction")
    return [exact(x) for x in value] if isinstance(value, list) else Fraction(value) if isinstance(value, str) else value


def length(x: Fraction, y: Fraction) -> Fraction:
    """At least the length of a vector, and no more than 2^-79 above it."""
    square = (x * x + y * y) * 2**160
    return Fraction(math.isqrt(-(-square.numerator // square.denominator)) + 1, 2**80) if square else ZERO


def dot(x: Any, y: Any) -> Fraction:
    """Sum of products."""
    return sum((a * b for a, b in zip(x, y, strict=True) if a and b), ZERO)


def data_of(given: dict[str, Any]) -> Any:
    """The data of a file in fractions; sizes that do not agree are refused."""
    D = SimpleNamespace(**{name: exact(value) for name, value in given.items()})
    rows, p, nu = len(D.forces), len(D.lower), len(D.motors)
    in_cones, turned = [j for cone in D.cones for j in cone], {i for i, _, _ in D.slopes}
    right = {len(x) for x in (*D.loads, *D.parameters, D.load_radius, D.forces_radius)} == {rows} and len(D.loads) > 0
    right &= {len(x) for x in D.forces + D.forces_radius + [D.upper]} == {p} and len(D.torque_low) == len(D.torque_high) == nu
    right &= sorted(D.idle + D.motors) == list(range(rows)) and len(D.pushes) == len(D.loads) and len(D.slopes) == len(turned)
    right &= all(len(S) == rows and {len(x) for x in S} == {p} and len(own) == len(D.loads) for _, S, own in D.slopes)
    right &= len(set(in_cones)) == 3 * len(D.cones) == 3 * len(D.friction) and set(in_cones) <= set(range(p))
    if not (right and all(mu > 0 for mu in D.friction) and min(sum(D.forces_radius, D.load_radius)) >= 0):
        raise ValueError("sizes or signs of the data do not agree")
    return SimpleNamespace(**vars(D), given=given, turned=turned, bounded=[j for j in range(p) if j not in in_cones])


def load_at(data: Any, vertex: int, t: Any) -> list[Fraction]:
    """Load of a corner of the pushes with these numbers t."""
    load = [L + dot(t, [D[k] for D in data.parameters]) for k, L in enumerate(data.loads[vertex])]
    return [L + sum(t[i] * own[vertex][k] for i, _, own in data.slopes) for k, L in enumerate(load)]


def forces_at(data: Any, t: Any) -> list[list[Fraction]]:
    """P with these numbers t."""
    return [[x + sum(t[i] * S[k][j] for i, S, _ in data.slopes) for j, x in enumerate(r)] for k, r in enumerate(data.forces)]


def leaf(data: Any, proof: Any, low: list[Fraction], high: list[Fraction], torques: str) -> tuple[Fraction, Fraction]:
    """(least slack, largest imbalance) of a proof over a box of numbers t."""
    middle, half = ([(b + s * a) / 2 for a, b in zip(low, high, strict=True)] for s in (1, -1))
    turns = [(i, [[half[i] * x for x in row] for row in S], loads) for i, S, loads in data.slopes]
    X, P, radius, rows = exact(proof["inverse"]), forces_at(data, middle), data.forces_radius, range(len(data.forces))
    wide = [[r + sum(abs(S[k][j]) for _, S, _ in turns) for j, r in enumerate(radius[k])] for k in rows]
    columns = [(at, [x[i] for x in X]) for i, at in enumerate(data.idle)]
    E = [[abs(dot(P[k], x) - (k == at)) + dot(radius[k], list(map(abs, x))) + sum(abs(dot(S[k], x)) for _, S, _ in turns)
          for at, x in columns] for k in data.idle]  # fmt: skip
    slack, imbalance = list[Fraction](), [ZERO]
    for v, (f, F, _) in enumerate(zip(exact(proof["forces"]), exact(proof["corrections"]), data.loads, strict=True)):
        missed = [[dot(P[k], G) - h * D[k] for k in rows] for h, G, D in zip(half, F, data.parameters, strict=True)]
        left, both = [dot(row, f) - L for row, L in zip(P, load_at(data, v, middle), strict=True)], dict[Any, list[Fraction]]()
        for i, S, loads in turns:
            missed[i] = [x + dot(S[k], f) - half[i] * loads[v][k] for k, x in enumerate(missed[i])]
            for j, G in enumerate(F):  # products of t_i and t_j; t_i^2 is one half, and up to one half of it
                found, share = both.get((min(i, j), max(i, j)), [ZERO] * len(P)), Fraction(1, 1 + (i == j))
                both[min(i, j), max(i, j)] = [x + share * dot(row, G) for x, row in zip(found, S, strict=True)]
            left = [x + y for x, y in zip(left, both[i, i], strict=True)]
        size = [sum((abs(G[j]) for G in F), ZERO) for j in range(len(X))]
        used = [abs(x) + s for x, s in zip(f, size, strict=True)]
        more = [sum((abs(m[k]) for m in [*missed, *both.values()]), data.load_radius[k]) + dot(radius[k], used) for k in rows]
        idle = y = [abs(left[k]) + more[k] for k in data.idle]
        for _ in range(24):
            y = [Fraction(math.floor((x + dot(row, y)) * 101 * 2**80) + 1, 100 * 2**80) for x, row in zip(idle, E, strict=True)]
        slack += [-ONE for x, row, bound in zip(idle, E, y, strict=True) if x + dot(row, y) >= bound]
        fix = [dot(list(map(abs, x)), y) for x in X]
        for (a, b, n), mu in zip(data.cones, data.friction, strict=True):
            aside = length(f[a], f[b]) + sum(length(G[a], G[b]) for G in F) + fix[a] + fix[b]
            slack.append(mu * (f[n] - size[n] - fix[n]) - aside)
        for j in data.bounded:
            slack += [s * (f[j] - x) - size[j] - fix[j] for s, x in ((1, data.lower[j]), (-1, data.upper[j])) if x is not None]
        for i, (k, least, top) in enumerate(zip(data.motors, data.torque_low, data.torque_high, strict=True)):
            tau, about = -left[k], more[k] + sum((abs(x) + w) * s for x, w, s in zip(P[k], wide[k], fix, strict=True))
            if torques != "each":
                law = exact(proof["torque"])[i] + (dot(exact(proof["gain"])[i], data.pushes[v]) if torques == "affine" else 0)
                imbalance.append(abs(tau - law) + about)
                tau, about = law, ZERO
            slack += [sign * (tau - end) - about for sign, end in ((1, least), (-1, top)) if end is not None]
    return min(slack), max(imbalance)


def held(data: Any, proof: Any, torques: str, low: Any = None, high: Any = None) -> tuple[Fraction, Fraction]:
    """(least slack, imbalance) over all parts of the set: of parts the imbalance is zero, as each member has its torques."""
    low, high = (low, high) if low else ([-ONE] * len(data.parameters), [ONE] * len(data.parameters))
    if "split" not in proof:
        if "data" in proof:  # of this part alone; t of joints are from -1 to 1 in it
            own = ("forces", "forces_radius", "loads", "load_radius", "parameters", "slopes")
            if exact(proof["box"]) != [low, high]:
                raise ValueError("a part has data of another part")
            data = data_of(data.given | {name: proof["data"][name] for name in own})
            low, high = ([e if i in data.turned else x for i, x in enumerate(xs)] for e, xs in ((-ONE, low), (ONE, high)))
        return leaf(data, proof, low, high, torques)
    i, at = proof["split"], Fraction(proof["at"])
    if torques != "each" or not (0 <= i < len(low) and low[i] <= at <= high[i]):
        raise ValueError("a part is split outside of it")
    below = held(data, proof["below"], torques, low, [*high[:i], at, *high[i + 1 :]])
    return min(below, held(data, proof["above"], torques, [*low[:i], at, *low[i + 1 :]], high))


def largest(slope: Fraction, blur: Fraction, low: Any, high: Any, margin: Fraction, reach: Fraction) -> Fraction:
    """The largest slope * x + blur * |x| over an interval less a margin at its ends; ends that are missing are at `reach`."""
    ends = [-reach if low is None else low + margin, reach if high is None else high - margin]
    return max(slope * x + blur * abs(x) for x in ends)


def gap(data: Any, proof: Any, torques: str, margin: Fraction) -> Fraction:
    """By how much y . L exceeds what forces and torques can be: positive of members that cannot be held."""
    members, Y, shares = proof["members"], exact(proof["velocities"]), proof["shares"]
    reach, total, at_bases, none = Fraction(proof["reach"]), ZERO, dict[int, list[Fraction]](), [ZERO] * len(data.motors)
    for k, (member, y) in enumerate(zip(members, Y, strict=True)):
        t, own = exact(member["parameters"]), {int(b): Fraction(s) for b, s in shares[k].items()}
        pushes = [[s * x for x in data.pushes[members[b]["vertex"]]] for b, s in own.items()]
        affine = list(map(sum, zip(*pushes, strict=True))) == data.pushes[member["vertex"]]
        follows = torques == "one" or own == {k: 1} or (torques == "affine" and affine)
        if any(abs(x) > 1 for x in t) or sum(own.values()) != 1 or not follows or reach <= 0:
            raise ValueError("a member is none of the set, or its torques are none of the law")
        u = [dot(column, list(map(abs, y))) for column in zip(*data.forces_radius, strict=True)]
        total += dot(y, load_at(data, member["vertex"], t)) - dot(data.load_radius, [abs(x) for x in y])
        r = [dot(y, column) for column in zip(*forces_at(data, t), strict=True)]
        for (a, b, n), mu in zip(data.cones, data.friction, strict=True):
            total -= max(ZERO, r[n] + u[n] + mu * (length(r[a], r[b]) + u[a] + u[b])) * reach + (r[n] + u[n]) * margin / mu
        for j in data.bounded:
            total -= largest(r[j], u[j], data.lower[j], data.upper[j], margin, reach)
        for b, s in own.items():
            at_bases[b] = [x + s * y[row] for x, row in zip(at_bases.get(b, none), data.motors, strict=True)]
    for sums in at_bases.values():
        ends = zip(sums, data.torque_low, data.torque_high, strict=True)
        total -= sum(largest(x, ZERO, low, high, margin, reach) for x, low, high in ends)
    return total


def verify(document: Any) -> tuple[bool, str]:
    """(whether the claim is proved, what was checked in words); errors of Python where it is no certificate."""
    if digest(document) != document["sha256"]:
        return False, "the file was changed after it was written: its SHA-256 is another"
    claim, data = document["claim"], data_of(document["data"])
    margin, balance, torques = Fraction(claim["margin"]), Fraction(claim["balance"]), claim["torques"]
    known = document["kind"] == KIND and torques in ("each", "one", "affine") and claim["says"] in ("held", "refuted")
    if not known or margin < 0:
        raise ValueError(f"the kind is not {KIND!r}, or the claim is none that is known")
    if claim["says"] == "refuted":
        more = gap(data, document["proof"], torques, margin)
        return more > 0, f"refuted: the virtual work exceeds what forces and torques can do by {float(more):.3g}"
    slack, left = held(data, document["proof"], torques)
    words = f"{float(slack):.9g} N (N m) to each limit, {float(margin):.9g} are claimed; shared torques miss {float(left):.3g}"
    return slack >= margin and left <= balance, f"held: every member has {words}, of {float(balance):.3g} claimed"


def main(arguments: list[str]) -> int:
    """Check a file and say what was found."""
    try:
        proved, words = verify(json.loads(Path(arguments[0]).read_bytes()))
    except NO_CERTIFICATE as error:
        print(f"no certificate: {error!r}", file=sys.stderr)
        return 2
    print(f"{'proved' if proved else 'NOT PROVED'}: {words}")
    return int(not proved)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
