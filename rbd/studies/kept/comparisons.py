"""What is kept of a comparison of both laws, and of the degrees of freedom of a mechanism."""

from __future__ import annotations

import numpy as np

from rbd.answers.many import naming
from rbd.answers.many.naming import Named
from rbd.studies.comparison import LawComparison
from rbd.studies.kept.answers import verdict_of
from rbd.studies.kept.registry import Kept, Kind, Verdict, number, one


def _worst(both: LawComparison) -> list[Named]:
    return [naming.worst_residual(np.fmax(both.convex.residuals.worst, both.coulomb.residuals.worst))]


def _ratios(both: LawComparison) -> list[Named]:
    return [
        found
        for name, ratio in both.normal_ratio.items()
        for found in number(
            f"normal_ratio_{naming.key(name)}", ratio, "1", f"normal force of {name}, convex over Coulomb's law"
        )
    ]


def _lift_off(both: LawComparison) -> list[Named]:
    return [
        found
        for name, contact in both.under_convex.items()
        for found in number(
            f"lift_off_{naming.key(name)}", contact.lift_off, "m/s2", f"normal acceleration of {name} under the convex law"
        )
    ]


def _verdict(both: LawComparison) -> Verdict:
    return verdict_of(both.convex) or verdict_of(both.coulomb)


KINDS = {
    "rbd.studies.comparison.LawComparison": Kind(
        {
            "worst_residual": Kept("largest scaled residual of both answers", _worst),
            **one("difference", "difference of the accelerations, relative", lambda both: both.difference),
            **one("agree", "whether both laws give one motion, to 1e-7, and no other", lambda both: both.agree, ""),
            "normal_ratio": Kept("normal force of each contact, convex over Coulomb's law", _ratios),
            "lift_off": Kept("normal acceleration of each loaded contact under the convex law", _lift_off, False),
            **one("motions", "number of motions under Coulomb's law", lambda both: 1 + len(both.coulomb.others), default=False),
        },
        ("worst_residual",),
        _verdict,
    ),
    "rbd.mechanism.degrees_of_freedom.Mobility": Kind(
        {
            **one("counted", "degrees of freedom that Gruebler and Kutzbach count", lambda found: found.count.value),
            **one("instantaneous", "degrees of freedom of the velocities that J allows", lambda found: found.instantaneous),
            **one("finite", "degrees of freedom of finite motions", lambda found: found.finite),
            **one("rank", "rank of J", lambda found: found.rank),
            **one("singular", "whether the rank of J is lower here than nearby", lambda found: found.singular, ""),
            **one("verdict", "the conclusion, in words", lambda found: found.verdict, "", default=False),
        }
    ),
}
"""What is kept of each class."""
