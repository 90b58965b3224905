"""Motion over time: smooth motion on bilateral constraints, and contact with impacts."""

from functools import partial as _partial

from rbd.mechanism.projection import Projection
from rbd.modules import submodule as _submodule
from rbd.simulation.events import StateEvent, Switch
from rbd.simulation.impacts import Impact, impact
from rbd.simulation.integrators import DormandPrince8, RungeKutta4, TimeStepping
from rbd.simulation.periodic import Floquet, floquet
from rbd.simulation.run import simulate
from rbd.simulation.simulated_motion import Event
from rbd.simulation.trajectory import Trajectory

__all__ = [
    "DormandPrince8",
    "Event",
    "Floquet",
    "Impact",
    "Projection",
    "RungeKutta4",
    "StateEvent",
    "Switch",
    "TimeStepping",
    "Trajectory",
    "floquet",
    "impact",
    "simulate",
]


__getattr__ = _partial(_submodule, __name__)
