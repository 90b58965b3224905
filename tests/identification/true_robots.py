"""Robots with other inertias than their model, and what would be measured of them."""

from __future__ import annotations

import copy
from functools import lru_cache

import numpy as np
import pinocchio as pin

import rbd
from rbd.model.inertial import inertial_parameters
from rbd.motion.identification import MeasuredMotion
from rbd.motion.identification.possible import pseudo_inertia


def with_other_inertias(robot: rbd.Robot, seed: int = 1, size: float = 0.1) -> rbd.Robot:
    """A copy whose bodies' masses, centres and moments are off by some `size`; all bodies are possible."""
    rng, out = np.random.default_rng(seed), copy.deepcopy(robot)
    for i, theta in enumerate(inertial_parameters(robot)):
        L = np.linalg.cholesky(pseudo_inertia(theta))
        A = np.eye(4) + size * rng.normal(size=(4, 4))
        out.model.inertias[i + 1] = pin.PseudoInertia.FromMatrix(L @ A @ A.T @ L.T).toInertia()
    return out


def in_the_air(true: rbd.Robot, model: rbd.Robot, seed: int, frames: int) -> MeasuredMotion:
    """All joints wave, the base turns and falls as its momentum says; torques measured."""
    rng, n = np.random.default_rng(seed), true.nu
    w, phase = 2.0 * np.pi * rng.uniform(0.5, 2.0, (3, n)), rng.uniform(0.0, 6.3, (3, n))
    size, q0, t = rng.uniform(0.03, 0.25, (3, n)), true.standing().q, np.linspace(0.0, 4.0, frames)
    q, v, a, tau = [], [], [], []
    for time in t:
        angle = w * time + phase
        start = q0.copy()
        start[7:] += (size * np.sin(angle)).sum(axis=0)
        turned = np.concatenate([rng.uniform(-1.0, 1.0, 6), np.zeros(n)])
        rates = np.concatenate([rng.uniform(-1.0, 1.0, 6), (size * w * np.cos(angle)).sum(axis=0)])
        state = rbd.State(true, pin.integrate(true.model, start, turned), rates)
        joints = -(size * w * w * np.sin(angle)).sum(axis=0)
        M, h = state.M, state.h
        base = np.linalg.solve(M[:6, :6], -(M[:6, 6:] @ joints + h[:6]))
        accelerations = np.concatenate([base, joints])
        for kept, value in zip((q, v, a, tau), (state.q, rates, accelerations, (M @ accelerations + h)[6:]), strict=True):
            kept.append(value)
    # The base is another one at each time: samples, not a motion.
    motion = rbd.Motion.of_arrays(model, t, np.array(q), np.array(v), np.array(a), trust=True, quaternion="xyzw")
    return MeasuredMotion(motion, np.array(tau))


def on_its_feet(true: rbd.Robot, seed: int, duration: float) -> rbd.Trajectory:
    """Simulated, both soles held, all joints waving under soft position control."""
    rng, start, n = np.random.default_rng(seed), true.standing(), true.nu
    w, phase = rng.uniform(2.0, 8.0, (2, n)), rng.uniform(0.0, 6.3, (2, n))
    hold, reach = rbd.hold(start, true.soles()).tau, np.linalg.inv(np.linalg.inv(start.M)[6:, 6:])

    def control(state: rbd.State, t: float) -> np.ndarray:
        wanted = start.q[7:] + 0.15 * (np.sin(w * t + phase) - np.sin(phase)).sum(axis=0)
        return hold + reach @ (150.0 * (wanted - state.q[7:]) - 16.0 * state.v[6:])

    how = {"integrator": rbd.RungeKutta4(), "record_every": 2, "progress": False}
    return rbd.simulate(start, true.soles(None), duration=duration, step=4e-3, controller=control, **how)


@lru_cache(maxsize=1)
def g1() -> tuple[rbd.Robot, rbd.Robot]:
    """(model, true robot)."""
    model = rbd.load_robot("g1")
    return model, with_other_inertias(model)
