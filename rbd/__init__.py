"""Robots in contact: Gauss's least-constraint problem on Pinocchio and ProxSuite, every answer with its proof."""

from rbd import dynamics
from rbd.cones import Box, Free, FrictionCone, NonNegative, Product, WrenchCone
from rbd.constraints import PointContact, SurfaceContact
from rbd.equilibrium import Hold, hold
from rbd.errors import (
    CannotHold,
    ContactMoves,
    InputError,
    ModelError,
    NoSolution,
    NotAtRest,
    RbdError,
    Unsupported,
)
from rbd.external import ExternalForce
from rbd.least_constraint import gauss_problem, solve
from rbd.problem import GaussProblem
from rbd.robot import Robot, load_robot
from rbd.rows import Rows
from rbd.solution import Solution, Status
from rbd.solvers.kkt import KKT
from rbd.solvers.proxqp import ProxQP
from rbd.state import State

__version__ = "0.1.0"
