"""Lagrange's equations of a planar chain, written down pair by pair of links.

In the absolute angles phi_i of the links the kinetic energy is a sum over pairs of links, and the potential energy one over
links, with the constants mu_ij and nu_i of `rbd.planar.bodies`:

    T = 1/2 sum_ij mu_ij cos(phi_i - phi_j) w_i w_j,        V = g sum_i nu_i sin phi_i,        w_i = d phi_i / dt

so the moment that moves link i is E_i = sum_j mu_ij (cos(phi_i - phi_j) dw_j/dt + sin(phi_i - phi_j) w_j^2) + g nu_i cos phi_i.
Other angles are phi = S q + s with constant S: M, the Christoffel symbols and the forces transform with S as tensors, and
nothing is differentiated or simplified. Two links meet in one cosine whose angle is the sum of the joint angles between them.
"""

from __future__ import annotations

from dataclasses import dataclass

import sympy as sp

from rbd.arrays import lazy
from rbd.planar.angles import Symbols
from rbd.planar.bodies import Bodies
from rbd.planar.chain import Chain


@dataclass(frozen=True, eq=False)
class Pairs:
    """The terms of the equations of motion, in the angles q of a chain.

    Attributes:
        chain: The chain.
        bodies: Masses, centres of mass, inertias.
        gravity: Along -y [m/s2].
    """

    chain: Chain
    bodies: Bodies
    gravity: sp.Expr

    @lazy
    def S(self) -> Symbols:  # noqa: N802  the letter of the equation
        """S of phi = S q + s, shape (n, n): whole numbers."""
        return self.chain.segment_angles.jacobian(self.chain.q)

    @lazy
    def rates(self) -> Symbols:
        """Rates of the links, w = S qd, shape (n, 1) [rad/s]."""
        return self.S * self.chain.qd

    def mass_matrix(self) -> Symbols:
        """M_ab = sum_ij S_ia S_jb mu_ij cos(phi_i - phi_j), shape (n, n) [kg m2]."""
        n, S, mu = self.chain.n, self.S, self.bodies.coupling

        def entry(a: int, b: int) -> sp.Expr:
            own = (S[i, a] * S[i, b] * mu(i, i) for i in range(n))
            return sp.Add(*own, *((S[i, a] * S[j, b] + S[j, a] * S[i, b]) * c for (i, j), c in self._cosines.items()))

        return sp.ImmutableMatrix(n, n, entry)

    def christoffel(self) -> sp.ImmutableDenseNDimArray:
        """G_abc = sum_ij S_ia S_jb S_jc mu_ij sin(phi_i - phi_j), shape (n, n, n) [kg m2]: links feel only G_ijj."""
        n, S = self.chain.n, self.S

        def entry(a: int, b: int, c: int) -> sp.Expr:
            turns = self._sines.items()
            return sp.Add(*((S[i, a] * S[j, b] * S[j, c] - S[j, a] * S[i, b] * S[i, c]) * s for (i, j), s in turns))

        entries = [entry(a, b, c) for a in range(n) for b in range(n) for c in range(n)]
        return sp.ImmutableDenseNDimArray(entries, (n, n, n))

    def coriolis_matrix(self) -> Symbols:
        """C_ab = sum_c G_abc qd_c, the rates of each pair kept together, shape (n, n) [kg m2/s]."""
        n, S, w = self.chain.n, self.S, self.rates

        def entry(a: int, b: int) -> sp.Expr:
            return sp.Add(*(s * (S[i, a] * S[j, b] * w[j] - S[j, a] * S[i, b] * w[i]) for (i, j), s in self._sines.items()))

        return sp.ImmutableMatrix(n, n, entry)

    def gravity_moments(self) -> Symbols:
        """g_a = dV/dq_a = g sum_i S_ia nu_i cos phi_i, shape (n, 1) [N m]."""
        return sp.ImmutableMatrix([sp.Add(*self._weights(a)) for a in range(self.chain.n)])

    def coriolis_forces(self) -> Symbols:
        """C qd, shape (n, 1) [N m], in the links' rates w_i."""
        return sp.ImmutableMatrix([sp.Add(*self._turning(a)) for a in range(self.chain.n)])

    def bias(self) -> Symbols:
        """C qd + g, shape (n, 1) [N m]."""
        return sp.ImmutableMatrix([sp.Add(*self._turning(a), *self._weights(a)) for a in range(self.chain.n)])

    def equations(self) -> Symbols:
        """M qdd + C qd + g, shape (n, 1) [N m]: S^T E, the accelerations of each pair of links kept together."""
        n, S, speeding = self.chain.n, self.S, self.S * self.chain.qdd

        def force(a: int) -> sp.Expr:
            own = (S[i, a] * self.bodies.coupling(i, i) * speeding[i] for i in range(n))
            pushed = (c * (S[i, a] * speeding[j] + S[j, a] * speeding[i]) for (i, j), c in self._cosines.items())
            return sp.Add(*own, *pushed, *self._turning(a), *self._weights(a))

        return sp.ImmutableMatrix([force(a) for a in range(n)])

    def kinetic_energy(self) -> sp.Expr:
        """T = 1/2 sum_i mu_ii w_i^2 + sum_{i<j} mu_ij cos(phi_i - phi_j) w_i w_j [J]."""
        w = self.rates
        own = (self.bodies.coupling(i, i) * w[i] ** 2 / 2 for i in range(self.chain.n))
        return sp.Add(*own, *(c * w[i] * w[j] for (i, j), c in self._cosines.items()))

    def potential_energy(self) -> sp.Expr:
        """V = g sum_i nu_i sin phi_i [J], zero with all centres of mass at the base's height."""
        heights = zip(self.bodies.first_moments, self.chain.segment_angles, strict=True)
        total = sp.Add(*(nu * sp.sin(phi) for nu, phi in heights))
        return -self.gravity * -total if total.could_extract_minus_sign() else self.gravity * total

    @lazy
    def _cosines(self) -> dict[tuple[int, int], sp.Expr]:
        return self._by_pair(sp.cos)

    @lazy
    def _sines(self) -> dict[tuple[int, int], sp.Expr]:
        return self._by_pair(sp.sin)

    def _by_pair(self, function: type[sp.Function]) -> dict[tuple[int, int], sp.Expr]:
        """{(i, j) with i < j: mu_ij times a function of phi_i - phi_j}."""
        n, phi, mu = self.chain.n, self.chain.segment_angles, self.bodies.coupling
        return {(i, j): mu(i, j) * function(phi[i] - phi[j]) for i in range(n) for j in range(i + 1, n)}

    def _turning(self, a: int) -> list[sp.Expr]:
        """What the turning of the links does to coordinate a: mu_ij sin(phi_i - phi_j) (S_ia w_j^2 - S_ja w_i^2) of a pair."""
        S, w, out = self.S, self.rates, []
        for (i, j), s in self._sines.items():
            if S[i, a] == S[j, a]:  # both links are moved: only their relative turning is felt
                out.append(s * S[i, a] * (w[j] - w[i]) * (w[j] + w[i]))
            else:
                out.append(s * (S[i, a] * w[j] ** 2 - S[j, a] * w[i] ** 2))
        return out

    def _weights(self, a: int) -> list[sp.Expr]:
        phi, nu = self.chain.segment_angles, self.bodies.first_moments
        return [self.S[i, a] * self.gravity * nu[i] * sp.cos(phi[i]) for i in range(self.chain.n)]
