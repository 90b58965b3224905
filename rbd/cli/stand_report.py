"""The report of `rbd stand`: tables for the terminal, plain data for a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Group

from rbd.arrays import Array
from rbd.cli.terminal import Table
from rbd.problem.contact_force import ContactForce
from rbd.solution import Solution
from rbd.statics.equilibrium import Hold

UNITS = {"stationarity": "N", "feasibility": "m/s2", "cone": "N", "complementarity": "N m/s2", "centroidal": "N"}
LARGEST_TORQUES = 5


@dataclass(frozen=True, eq=False)
class StandReport:
    """A robot held by its feet, perhaps pushed.

    Attributes:
        held: Torques found without the push.
        solution: Motion and forces under those torques and the push.
        push: World force [N], or None.
        at: Frame that is pushed, or None.
        seconds: {what: time taken [s]}.
    """

    held: Hold
    solution: Solution
    push: Array | None
    at: str | None
    seconds: Mapping[str, float]

    @property
    def com_acceleration(self) -> tuple[Array, Array]:
        """Acceleration of the centre of mass with and without its contacts, each (3,) [m/s2]; NaN on a fixed base."""
        balance = self.solution.problem.balance
        if balance is None:
            return np.full(3, np.nan), np.full(3, np.nan)
        mass = self.held.state.robot.mass
        rates = (balance.A_g @ a + balance.rate_bias for a in (self.solution.a, self.solution.a_free))
        with_contacts, without = (rate[:3] / mass for rate in rates)
        return with_contacts, without

    @property
    def distance(self) -> float:
        """|a - a_free| in the inertia metric, sqrt((a - a_free)^T M (a - a_free)) [N^1/2 m^1/2 / s]."""
        return math.sqrt(2.0 * self.solution.gauss)

    def data(self) -> dict[str, Any]:
        """Everything as numbers, lists and text: SI units, world axes, forces on the robot."""
        robot, s = self.held.state.robot, self.solution
        with_contacts, without = self.com_acceleration
        return {
            "robot": robot.name,
            "mass": robot.mass,
            "push": None if self.push is None else {"force": self.push.tolist(), "frame": self.at},
            "status": str(s.status),
            "law": str(s.law),
            "solver": s.solver,
            "method": s.method,
            "rows": s.problem.m,
            "rank": s.rank,
            "contacts": {name: self._contact(name, c) for name, c in s.contacts.items()},
            "centre_of_mass": self.held.state.com.tolist(),
            "centre_of_mass_acceleration": _plain(with_contacts),
            "centre_of_mass_acceleration_without_contacts": _plain(without),
            "tau": dict(zip(robot.actuated_names, self.held.tau.tolist(), strict=True)),
            "effort_limit": {n: _plain(x) for n, x in zip(robot.actuated_names, robot.effort_limit, strict=True)},
            "a": s.a.tolist(),
            "a_free": s.a_free.tolist(),
            "gauss": {"value": float(s.gauss), "shares": s.gauss.shares, "distance": self.distance},
            "residuals": {name: {"value": float(getattr(s.residuals, name)), "scaled": scaled, "unit": UNITS[name]}
                          for name, scaled in s.residuals.scaled.items()},
            "seconds": dict(self.seconds),
        }  # fmt: skip

    def _contact(self, name: str, c: ContactForce) -> dict[str, Any]:
        force = self.solution.forces[name]
        return {
            "force": force[:3].tolist(),
            "moment": force[3:].tolist() if len(force) == 6 else None,
            "normal": c.normal,
            "tangential": c.tangential,
            "friction_used": c.friction_used,
            "centre_of_pressure": None if c.centre_of_pressure is None else c.centre_of_pressure.tolist(),
            "corner_forces": self.solution.corner_forces[name].tolist(),
        }

    def __rich__(self) -> Group:
        """The tables of the command line."""
        return Group(self._contacts_table(), self._torques_table(), self._summary_table())

    def _contacts_table(self) -> Table:
        table = Table(self._headline())
        table.add_column("contact")
        for heading in ("force x, y, z [N]", "normal [N]", "tangential [N]", "friction used", "centre of pressure [m]"):
            table.add_column(heading, justify="right")
        for name, c in self.solution.contacts.items():
            used = "-" if c.friction_used is None else f"{100 * c.friction_used:.1f} %"
            cop = "-" if c.centre_of_pressure is None else rounded(c.centre_of_pressure, 3)
            table.add_row(name, rounded(c.force, 2), f"{c.normal:.2f}", f"{c.tangential:.2f}", used, cop)
        total = sum((c.force for c in self.solution.contacts.values()), np.zeros(3))
        table.add_section()
        table.add_row("sum", rounded(total, 2), "", "", "", "")
        return table

    def _headline(self) -> str:
        robot = self.held.state.robot
        weight = robot.mass * float(np.linalg.norm(robot.gravity))
        pushed = "" if self.push is None else f", pushed with ({rounded(self.push, 1)}) N at {self.at}"
        return f"{robot.name}: {robot.mass:.3f} kg, weight {weight:.2f} N{pushed}"

    def _torques_table(self) -> Table:
        robot, tau = self.held.state.robot, self.held.tau
        table = Table("largest holding torques")
        table.add_column("joint")
        for heading in ("torque [N m]", "limit [N m]", "of limit"):
            table.add_column(heading, justify="right")
        used = np.abs(tau) / robot.effort_limit
        limited = bool(np.isfinite(robot.effort_limit).any())
        for i in np.argsort(-used if limited else -np.abs(tau))[:LARGEST_TORQUES]:
            limit, share = "none", "-"
            if np.isfinite(robot.effort_limit[i]):
                limit, share = f"{robot.effort_limit[i]:.1f}", f"{100 * used[i]:.1f} %"
            table.add_row(robot.actuated_names[i], f"{tau[i]:.3f}", limit, share)
        return table

    def _summary_table(self) -> Table:
        s = self.solution
        with_contacts, without = self.com_acceleration
        table = Table("motion and proof", headings=False)
        table.add_column("what")
        table.add_column("value")
        table.add_row("status", f"{s.status} by {s.method}, law: {s.law}; {s.problem.m} rows of rank {s.rank}")
        table.add_row("centre of mass", f"({rounded(self.held.state.com, 3)}) m")
        table.add_row("its acceleration", f"({rounded(with_contacts, 3)}) m/s2")
        table.add_row("without contacts", f"({rounded(without, 3)}) m/s2")
        table.add_row("|a - a_free| in M", f"{self.distance:.4f} sqrt(N m)/s, 1/2 of its square: {float(s.gauss):.4f} N m/s2")
        for name, scaled in s.residuals.scaled.items():
            table.add_row(f"residual: {name}", f"{float(getattr(s.residuals, name)):.1e} {UNITS[name]} (scaled {scaled:.1e})")
        table.add_row("times", ", ".join(f"{what} {1e3 * t:.2f} ms" for what, t in self.seconds.items()))
        return table


def rounded(values: Array, digits: int) -> str:
    """Numbers with so many digits, separated by commas."""
    # Rounding before adding zero turns -0.00 into 0.00
    return ", ".join(f"{x:.{digits}f}" for x in np.round(values, digits) + 0.0)


def _plain(values: Array | float) -> Any:
    """Lists and floats; None in place of what JSON cannot say."""
    if np.ndim(values):
        return [_plain(x) for x in np.asarray(values)]
    return float(values) if math.isfinite(values) else None
