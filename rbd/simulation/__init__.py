"""Motion over time: smooth motion on constraints that hold, and contact with impacts."""

from rbd.mechanism.projection import Projection
from rbd.simulation.adaptive import Adaptive
from rbd.simulation.door import simulate
from rbd.simulation.moment import Event
from rbd.simulation.runge_kutta import RungeKutta4
from rbd.simulation.stepping import TimeStepping
from rbd.simulation.trajectory import Trajectory

__all__ = [
    "Adaptive",
    "Event",
    "Projection",
    "RungeKutta4",
    "TimeStepping",
    "Trajectory",
    "simulate",
]
