"""The least-constraint problem in arrays: cones, rows, force sets, residuals. Depends on NumPy, not on robots or solvers."""

from functools import partial as _partial

from rbd.modules import submodule as _submodule
from rbd.problem.answer import Answer, Status
from rbd.problem.cones import Bounds, Cone, EllipticCone, Free, FrictionCone, NonNegative, Product
from rbd.problem.corner_cones import LineCone, UnevenCone, WrenchCone
from rbd.problem.gauss_problem import GaussProblem
from rbd.problem.ground import Ground
from rbd.problem.motions import Speed
from rbd.problem.rows import Rows

__all__ = [
    "Answer",
    "Bounds",
    "Cone",
    "EllipticCone",
    "Free",
    "FrictionCone",
    "GaussProblem",
    "Ground",
    "LineCone",
    "NonNegative",
    "Product",
    "Rows",
    "Speed",
    "Status",
    "UnevenCone",
    "WrenchCone",
]


__getattr__ = _partial(_submodule, __name__)
