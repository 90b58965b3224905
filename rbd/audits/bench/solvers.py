"""Solvers of friction problems, ours and others', each judged by the residual that the problem gives its forces.

What a solver claims is not asked. A solver that takes no such problem (rolling, a W that is not symmetric) says why. MuJoCo's
and Clarabel's law is the convex one, in which points that slide also lift: `FrictionAnswer.convex_map` judges them by it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from rbd.arrays import Array
from rbd.audits.bench.friction import FrictionAnswer, FrictionProblem, solve
from rbd.displayed import Displayed
from rbd.errors import InputError, Unsupported
from rbd.errors.inputs import check_choice, check_kind, listed_items
from rbd.solvers.conic_newton import interior_point
from rbd.solvers.default import GaussFirst
from rbd.solvers.newton import Scaled, scaled
from rbd.solvers.pinocchio_admm import admm, pgs
from rbd.solvers.proxqp import ProxQP

_ITERATIONS = 5000
_TOLERANCE = 1e-13
_HARD = 1e-10


def _sparse_newton(P: FrictionProblem) -> Array:
    return solve(P).r


def _default(P: FrictionProblem) -> Array:
    return P.forces_of(GaussFirst().solve(P.gauss).multipliers)


def _pyramids(P: FrictionProblem) -> Array:
    return P.forces_of(ProxQP().solve(P.gauss).multipliers)


def _scaled(P: FrictionProblem) -> Scaled:
    T = P.gauss.force_set
    return scaled(T.G.T @ P.gauss.delassus @ T.G, T.G.T @ P.gauss.free_row_acceleration, T)


def _admm(P: FrictionProblem) -> Array:
    S = _scaled(P)
    w, _ = admm(S, np.zeros(len(S.q)), coulomb=True, iterations=_ITERATIONS, tolerance=_TOLERANCE)
    return P.forces_of(S.weights(w))


def _pgs(P: FrictionProblem) -> Array:
    S = _scaled(P)
    return P.forces_of(S.weights(pgs(S, iterations=_ITERATIONS, tolerance=_TOLERANCE)))


def _clarabel(P: FrictionProblem) -> Array:
    S = _scaled(P)
    return P.forces_of(S.weights(interior_point(S.convex()).x))


def _mujoco(P: FrictionProblem) -> Array:
    """MuJoCo's PGS with elliptic cones on this W and q: in a model of as many spheres on a plane, whose matrices it replaces.

    Its contacts are soft; here by 1e-10 of the contacts' mobility.
    """
    try:
        import mujoco
    except ImportError as error:
        raise InputError("mujoco is not installed here. Install the extra: pip install 'rbd-contact[mujoco]'") from error
    if P.dim != 3:
        raise Unsupported(f"{P.name}: MuJoCo's contacts are in space.")
    body = '<body pos="{} 0 0.0999"><freejoint/><geom type="sphere" size="0.1" condim="3" friction="{} 0 0"/></body>'
    spheres = "".join(body.format(3 * i, max(mu, 1e-5)) for i, mu in enumerate(P.mu.tolist()))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option cone="elliptic" jacobian="dense" solver="PGS" iterations="{_ITERATIONS}" tolerance="0">'
        '<flag warmstart="disable" island="disable"/></option><worldbody>'
        f'<geom type="plane" size="0 0 1" condim="3" friction="0 0 0"/>{spheres}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    k, W = len(P.mu), P.delassus.toarray()
    order = np.asarray(data.contact.geom).max(axis=1) - 1
    if data.nefc != 3 * k or not np.array_equal(order, np.arange(k)):
        raise Unsupported(f"{P.name}: MuJoCo made {data.nefc} rows of {k} contacts.")
    soft = _HARD * np.abs(W.diagonal()).max()
    data.efc_AR[:] = (W + soft * np.eye(3 * k)).ravel()
    data.efc_R[:], data.efc_D[:] = soft, 1.0 / soft
    data.efc_aref[:] = data.efc_J.reshape(3 * k, -1) @ data.qacc_smooth - P.free
    mujoco.mj_fwdConstraint(model, data)
    return np.array(data.efc_force)


SOLVERS: Mapping[str, Callable[[FrictionProblem], Array]] = MappingProxyType({
    "rbd, sparse Newton": _sparse_newton,
    "rbd, default solver": _default,
    "Pinocchio, ADMM": _admm,
    "Pinocchio, PGS": _pgs,
    "ProxSuite, pyramids of 4 facets": _pyramids,
    "Clarabel, convex law": _clarabel,
    "MuJoCo, PGS, convex law": _mujoco,
})  # fmt: skip
"""{name: function of a problem that gives its forces, shape (k dim,)}."""


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Displayed):
    """Answers of several solvers to the same problems.

    Attributes:
        answers: {solver: an answer to each problem, or the reason why there is none}.

    Example:
        >>> problems = list(rbd.audits.bench.humanoid_problems(2))
        >>> found = rbd.audits.bench.compare(problems, ["rbd, sparse Newton", "Clarabel, convex law"])
        >>> found.solved("rbd, sparse Newton"), found.solved("Clarabel, convex law") < 2
        (2, True)
    """

    answers: dict[str, tuple[FrictionAnswer | str, ...]]

    def taken(self, solver: str) -> list[FrictionAnswer]:
        """The answers of a solver, problems left out that it does not take."""
        return [answer for answer in self.answers[solver] if isinstance(answer, FrictionAnswer)]

    def solved(self, solver: str) -> int:
        """How many problems it solved, by the natural map."""
        return sum(answer.solved for answer in self.taken(solver))

    def table(self) -> str:
        """Markdown: of each solver the problems taken and solved, its natural maps and times."""
        head = (
            "| solver | taken | solved | natural map, median | worst | convex law's map, median | time, median [ms] |\n"
            "| --- | ---: | ---: | ---: | ---: | ---: | ---: |\n"
        )
        lines = []
        for name in self.answers:
            own = self.taken(name)
            maps, times = [answer.natural_map for answer in own] or [np.nan], [answer.seconds for answer in own] or [np.nan]
            convex = np.median([answer.convex_map for answer in own] or [np.nan])
            lines.append(
                f"| {name} | {len(own)} | {self.solved(name)} | {np.median(maps):.0e} | {max(maps):.0e} | {convex:.0e} | "
                f"{1e3 * np.median(times):.2g} |\n"
            )
        return head + "".join(lines)


def compare(problems: Iterable[FrictionProblem], solvers: Sequence[str] = tuple(SOLVERS)) -> Comparison:
    """The answers of solvers to problems, each recomputed.

    Args:
        problems: The problems.
        solvers: Some names of `SOLVERS`.

    Raises:
        InputError: an unknown solver, or one that is not installed.

    Example:
        >>> slides = rbd.audits.bench.FrictionProblem("slides", 3, mu=[0.5], W=np.eye(3), q=[-1.0, 2.0, 0.0])
        >>> found = rbd.audits.bench.compare([slides])
        >>> [name for name in rbd.audits.bench.SOLVERS if found.solved(name)]
        ['rbd, sparse Newton', 'rbd, default solver', 'Pinocchio, ADMM', 'Pinocchio, PGS']
    """
    names = listed_items("solvers", solvers, "names of SOLVERS")
    for name in names:
        check_choice("a solver", name, SOLVERS)
    found: dict[str, list[FrictionAnswer | str]] = {name: [] for name in names}
    for problem in problems if isinstance(problems, Iterator) else listed_items("problems", problems, "friction problems"):
        check_kind("a problem", problem, FrictionProblem, "a FrictionProblem")
        for name in names:
            found[name].append(_judged(problem, name))
    return Comparison({name: tuple(answers) for name, answers in found.items()})


def _judged(problem: FrictionProblem, name: str) -> FrictionAnswer | str:
    start = time.process_time()
    try:
        r = SOLVERS[name](problem)
    except Unsupported as error:
        return str(error)
    return problem.answer(np.where(np.isfinite(r), r, 0.0), name, time.process_time() - start)
