"""Motion over time: smooth motion on constraints that hold, and contact with impacts."""

from rbd.control.controllers import HoldPosture
from rbd.control.pushes import Push, Pushes
from rbd.control.scripted import Sampled, TorqueScript
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
    "HoldPosture",
    "Projection",
    "Push",
    "Pushes",
    "RungeKutta4",
    "Sampled",
    "TimeStepping",
    "TorqueScript",
    "Trajectory",
    "simulate",
]
