"""Answers in numbers that a page recomputes their residuals from, without Python: M, J, h, tau, a, f and the sets of forces."""

from __future__ import annotations

import base64
import json
import zlib
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rbd.constraints.constraint import Constraint, listed
from rbd.errors import InputError, NoSolution
from rbd.errors.inputs import check_kind
from rbd.model.state import State
from rbd.problem.residuals import centroidal_terms

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.control.schedules import ExternalAt
    from rbd.model.external import External
    from rbd.simulation.trajectory import Trajectory

KB_A_MINUTE, LEAST = 60.0, 3
"""Frames of a motion take so much of its page, at least so many."""
REST = 1e-4
"""Points of a simulated motion that move no faster stick [m/s]."""
Frame = tuple[float | None, State, "Solution"]
"""Time in a motion, state, and the answer there."""


def verified(frames: Sequence[Frame], note: str = "") -> str:
    """JSON of a page's "verify" panel: headers of the frames, and their numbers as deflated float64 (verify.js).

    Args:
        frames: The answers.
        note: What the reader should know of them.
    """
    heads, numbers = zip(*(_described(*frame) for frame in frames), strict=True)
    data = b"".join(numbers)
    packed = base64.b64encode(zlib.compress(data, 9)).decode("ascii")
    return json.dumps({"verify": {"frames": heads, "size": len(data), "data": packed, "note": note}})


def _described(t: float | None, state: State, solution: Solution) -> tuple[dict[str, Any], bytes]:
    """(header, numbers) of an answer: sizes, names, columns of cones, and Python's residuals; arrays row by row."""
    P, a, f, weights, law = solution.residuals.answer
    T = P.force_set_of(law)
    w = T.weights_of(f) if weights is None else weights
    momentum = [] if P.balance is None else [P.balance.A_g, *centroidal_terms(P)]
    head = {
        "t": t, "nv": len(a), "m": len(f), "p": T.size, "coulomb": law.kind == "coulomb", "bilateral": P.bilateral,
        "law": str(law), "momentum": bool(momentum), "cones": T.cone_at.tolist(), "mu": T.mu.tolist(),
        "constraints": [[rows.name, s.start, s.stop] for rows, s in zip(P.rows, T.slices, strict=True)],
        "found": solution.residuals.values,
    }  # fmt: skip
    motion = [P.M[np.tril_indices(len(a))], P.J, a, state.h, P.rhs + state.h, P.offset, f]
    arrays = [*motion, T.G, T.H, T.offset, T.lower, T.upper, w, *momentum]
    return head, b"".join(np.ascontiguousarray(x, "<f8").tobytes() for x in arrays)


def motion_verified(run: Any, constraints: Any, external: External | ExternalAt = None) -> str:
    """The same of frames of a simulated motion: first, last, that of the largest residual, and some between, evenly.

    In each, `rbd.solve` answers for the state and the torques of the sample.

    Args:
        run: What `rbd.simulate` returned.
        constraints: Those of the motion, as they were given to it.
        external: External forces, as they were given to it; None: the force elements that it recorded.

    Raises:
        InputError: another kind of motion; a constraint that the motion did not have; no frame with an answer.
    """
    from rbd.simulation.trajectory import Trajectory

    check_kind("the motion of a page with verify=", run, Trajectory, "what rbd.simulate returned")
    given = listed(constraints)
    first = list(_answered(run, [0, len(run) - 1, int(np.nanargmax(run.residuals["law"]))], given, external))
    each = max(len(verified([frame])) for frame, _ in first) if first else 1
    most = max(round(1e3 * KB_A_MINUTE * max(1.0, run.duration / 60.0) / each), LEAST)
    more = np.linspace(0, len(run) - 1, min(max(most - len(first), 0), len(run)) + 2).round().astype(int)[1:-1]
    found = {frame[0]: (frame, off) for frame, off in [*first, *_answered(run, more.tolist(), given, external)]}
    if not found:
        raise InputError("rbd.solve has no answer in the frames of this motion: expected verify= with all its constraints.")
    frames = [found[t] for t in sorted(found, key=lambda t: -1.0 if t is None else t)]
    off = max(off for _, off in frames)
    note = f"rbd.solve in {len(frames)} of {len(run)} samples; the motion's accelerations differ by {off:.1e} at most."
    return verified([frame for frame, _ in frames], note)


def _answered(
    run: Trajectory, samples: Sequence[int], given: Sequence[Constraint], external: External | ExternalAt
) -> Iterator[tuple[Frame, float]]:
    """(frame, largest difference of the accelerations) of samples, those without an answer left out."""
    from rbd.answers.least_constraint import solve

    for i in dict.fromkeys(samples):
        state = run.state(i)
        acts = external(state, float(run.t[i])) if callable(external) else run.elements if external is None else external
        try:
            solution = solve(state, run.tau[i], run.touching(i, given), external=acts, law=run.law, rest_speed=REST)
        except (NoSolution, InputError):
            continue
        yield (float(run.t[i]), state, solution), float(np.abs(solution.a - run.a[i]).max())
