"""Each segment's angle from the horizontal, or each joint's from the segment before: which equations change, and which do not?

Problem 5 of the text [Duarte2021]. With th for joint angles and ps for segment angles, ps1 = th1 and ps2 = th1 + th2. Position,
velocity and acceleration are the same vectors, written differently. The Jacobians differ by that map. The parts of the
acceleration differ too: segments have no Coriolis part at all.
"""

from dataclasses import dataclass

import numpy as np
import sympy as sp
from sympy.physics.mechanics import msprint

import rbd.planar


@dataclass(frozen=True)
class Result:
    """Differences in symbols after ps = A th, which shall be zero; parts in numbers {angles: (3, 2)}; both determinants."""

    left: dict[str, sp.Matrix]
    parts: dict[str, np.ndarray]
    determinants: dict[str, sp.Expr]


def main(show: bool = True) -> Result:
    joint, segment = rbd.planar.Chain(2), rbd.planar.Chain(2, angles="segment")
    for name, chain in (("joint", joint), ("segment", segment)):
        print(f"With {name} angles:")
        for what, value in (
            ("position", chain.position()),
            ("velocity", chain.velocity()),
            ("acceleration", chain.acceleration()),
            ("Jacobian", chain.jacobian()),
        ):
            for axis, row in zip("xy", value.tolist(), strict=True):
                print(f"  {what} {axis}: {short('  |  '.join(msprint(entry) for entry in row), name)}")
        print(f"  det J = {short(msprint(chain.determinant()), name)}")
    to_segment = joint.angle_map("segment")
    A, there = to_segment.matrix, dict(zip(segment.q, to_segment(joint.q), strict=True))

    def put_in(expression: sp.Matrix) -> sp.Matrix:
        """Put ps = A th into an expression of the chain of segment angles."""
        return expression.subs(there, simultaneous=True).doit()

    left = {
        "position": joint.position() - put_in(segment.position()),
        "velocity": joint.velocity() - put_in(segment.velocity()),
        "acceleration": joint.acceleration() - put_in(segment.acceleration()),
        "Jacobian": joint.jacobian() - put_in(segment.jacobian()) * A,
    }
    left = {what: sp.simplify(sp.expand(difference)) for what, difference in left.items()}
    print("With ps = A th put in, the difference is", ", ".join(f"{what} {list(x)}" for what, x in left.items()))

    q, qd, qdd = np.array([0.4, 0.9]), np.array([2.0, -1.0]), np.array([3.0, 5.0])
    parts = {}
    print("At th = (0.4, 0.9) rad, th' = (2, -1) rad/s, th'' = (3, 5) rad/s2, links of 0.5 m, in m/s2:")
    print("           tangential          centripetal         Coriolis            sum")
    for name in ("joint", "segment"):
        chain = rbd.planar.Chain(2, lengths=(0.5, 0.5), angles=name)
        go = rbd.planar.Chain(2).angle_map(name)
        found = chain.numeric.split(go(q), go.rates(qd), go.rates(qdd))
        parts[name] = np.array([found.tangential, found.centripetal, found.coriolis])
        print(f"{name:8}" + "".join(f"{x + 0.0:10.4f}{y + 0.0:9.4f} " for x, y in (*parts[name], found.total)))
    return Result(left, parts, {"joint": joint.determinant(), "segment": segment.determinant()})


def short(text: str, name: str) -> str:
    """Write th for joint angles, ps for those of segments, l for lengths."""
    return text.replace("theta_", "th" if name == "joint" else "ps").replace("ell_", "l")


def check(result: Result) -> None:
    """The same motion, another Jacobian, other parts: what is Coriolis in joint angles is centripetal in those of segments."""
    assert all(x.is_zero_matrix for x in result.left.values())
    joint, segment = result.parts["joint"], result.parts["segment"]
    assert np.allclose(joint.sum(axis=0), segment.sum(axis=0), atol=1e-12)
    assert np.allclose(joint[0], segment[0], atol=1e-12), "the map is linear: J th'' is the same vector"
    assert np.all(segment[2] == 0.0) and np.abs(joint[2]).max() > 0.1
    assert np.allclose(joint[1] + joint[2], segment[1], atol=1e-12)
    ell_1, ell_2 = rbd.planar.Chain(2).lengths
    th, ps = rbd.planar.Chain(2).q, rbd.planar.Chain(2, angles="segment").q
    assert sp.simplify(result.determinants["joint"] - ell_1 * ell_2 * sp.sin(th[1])) == 0
    assert sp.simplify(result.determinants["segment"] - ell_1 * ell_2 * sp.sin(ps[1] - ps[0])) == 0


if __name__ == "__main__":
    check(main())
