"""Contact forces of any engine judged by the equation of motion and the laws of contact; problems for comparing solvers."""

from functools import partial as _partial

from rbd.audits.auditing import audit
from rbd.audits.causes import CAUSES, Thresholds
from rbd.audits.drake_records import from_drake
from rbd.audits.engines_compared import EnginesCompared, Parting, compare
from rbd.audits.explanations import Explanation
from rbd.audits.mujoco_records import from_mujoco
from rbd.audits.own_records import from_solutions, from_trajectory
from rbd.audits.record import Record
from rbd.audits.report import AuditReport
from rbd.modules import submodule as _submodule

__all__ = [
    "CAUSES",
    "AuditReport",
    "EnginesCompared",
    "Explanation",
    "Parting",
    "Record",
    "Thresholds",
    "audit",
    "compare",
    "from_drake",
    "from_mujoco",
    "from_solutions",
    "from_trajectory",
]


__getattr__ = _partial(_submodule, __name__)
