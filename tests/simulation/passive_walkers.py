"""Walkers on a slope, for `rbd.simulate`, and the same by the planar equations of two angles, integrated by SciPy.

Angles are those of the legs from the slope's normal, counterclockwise, of the stance leg and of the swing leg; s is along the
slope, n its normal. Feet are arcs of radius r about a point of the leg, r = 0: points.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
import pinocchio as pin
from scipy.integrate import solve_ivp

import rbd
from rbd.model.checked_model import CheckedModel

SIDES = ("left", "right")


@dataclass(frozen=True)
class Walker:
    """Two straight legs of mass m and inertia I, centre of mass c below the hip, a mass M at the hip."""

    M: float
    m: float
    inertia: float
    c: float
    r: float
    g: float
    slope: float
    length: float = 1.0

    @cached_property
    def normal(self):
        """Of the slope, in W."""
        return np.array([np.sin(self.slope), 0.0, np.cos(self.slope)])

    @cached_property
    def along(self):
        """Down the slope, in W."""
        return np.array([np.cos(self.slope), 0.0, -np.sin(self.slope)])

    @cached_property
    def robot(self):
        """Hip on two sliders, legs on hinges."""
        model = pin.Model()
        model.gravity.linear = np.array([0.0, 0.0, -self.g])
        x = model.addJoint(0, pin.JointModelPX(), pin.SE3.Identity(), "x")
        hip = model.addJoint(x, pin.JointModelPZ(), pin.SE3.Identity(), "z")
        model.appendBodyToJoint(hip, pin.Inertia(self.M, np.zeros(3), np.zeros((3, 3))), pin.SE3.Identity())
        for side in SIDES:
            leg = model.addJoint(hip, pin.JointModelRY(), pin.SE3.Identity(), f"{side}_hip")
            solid = pin.Inertia(self.m, np.array([0.0, 0.0, -self.c]), np.diag([0.0, self.inertia, 0.0]))
            model.appendBodyToJoint(leg, solid, pin.SE3.Identity())
            centre = pin.SE3(np.eye(3), np.array([0.0, 0.0, self.r - self.length]))
            model.addFrame(pin.Frame(side, leg, 0, centre, pin.FrameType.OP_FRAME))
        return CheckedModel(model, name="walker")

    @cached_property
    def feet(self):
        """Bilateral: they roll, or stay where they touched."""
        plane = rbd.Ground(point=(0.0, 0.0, 0.0), normal=self.normal)
        if self.r:
            return [rbd.RollingDisk(side, side, radius=self.r, on=plane) for side in SIDES]
        return [rbd.PointContact(side, side, friction=None, on=plane) for side in SIDES]

    @cached_property
    def strikes(self):
        """Both legs at the same angle from the normal, the swing leg ahead: its foot touches, and the other one leaves."""

        def apart(state):
            return state.q[2] + state.q[3] - 2.0 * self.slope

        switch = [rbd.simulation.Switch(on=one, off=other) for one, other in (SIDES, SIDES[::-1])]
        return [
            rbd.simulation.StateEvent(apart, f"{one} strikes", direction=1, while_off=one, then=then)
            for one, then in zip(SIDES, switch, strict=True)
        ]

    def start(self, y):
        """The state with the left foot on the slope, from (stance angle, swing angle, their rates)."""
        p, w, dp, dw = y
        hip, v = self._hip(p), self._hip_rate(p) * dp
        place, rate = (a[0] * self.along + a[1] * self.normal for a in (hip, v))
        q = [place[0], place[2], self.slope - p, self.slope - w]
        return rbd.State(self.robot, q, [rate[0], rate[2], -dp, -dw])

    def angles(self, state, stance):
        """(stance angle, swing angle, their rates) of a state."""
        one, other = (2, 3) if stance == "left" else (3, 2)
        p, w = (self.slope - state.q[i] for i in (one, other))
        return np.array([p, w, -state.v[one], -state.v[other]])

    def _hip(self, p):
        """(s, n) of the hip, over the place where the foot touches at p = 0; it rolls by -r p."""
        reach = self.length - self.r
        return np.array([-self.r * p - reach * np.sin(p), self.r + reach * np.cos(p)])

    def _hip_rate(self, p):
        reach = self.length - self.r
        return np.array([-self.r - reach * np.cos(p), -reach * np.sin(p)])

    def _jacobians(self, p, w):
        """d/d(p, w) of hip, stance leg's and swing leg's centres of mass, each (2, 2)."""
        hip = np.column_stack([self._hip_rate(p), np.zeros(2)])
        up, uw = (np.array([np.cos(a), np.sin(a)]) for a in (p, w))
        stance = hip + self.c * np.column_stack([up, np.zeros(2)])
        swing = hip + self.c * np.column_stack([np.zeros(2), uw])
        return hip, stance, swing

    def rates(self, _, y):
        """Of (p, w, p', w'), by d'Alembert's principle."""
        p, w, dp, dw = y
        reach, gravity = self.length - self.r, self.g * np.array([np.sin(self.slope), -np.cos(self.slope)])
        hip, stance, swing = self._jacobians(p, w)
        bias = np.array([reach * np.sin(p), -reach * np.cos(p)]) * dp * dp
        biases = (bias, bias + self.c * np.array([-np.sin(p), np.cos(p)]) * dp * dp,
                  bias + self.c * np.array([-np.sin(w), np.cos(w)]) * dw * dw)  # fmt: skip
        M, f = self.inertia * np.eye(2), np.zeros(2)
        for mass, J, b in zip((self.M, self.m, self.m), (hip, stance, swing), biases, strict=True):
            M = M + mass * J.T @ J
            f = f + mass * J.T @ (gravity - b)
        return [dp, dw, *np.linalg.solve(M, f)]

    def struck(self, y):
        """After the strike: angular momentum about the new contact, and of the trailing leg about the hip, is kept."""
        p, w, dp, dw = y
        hip, stance, swing = self._jacobians(p, w)
        rates = np.array([dp, dw])
        before = [hip @ rates, stance @ rates, swing @ rates]
        hip_at = self._hip(w) + [self.r * w, 0.0]  # from the new contact
        old, new = (hip_at + self.c * np.array([np.sin(a), -np.cos(a)]) for a in (p, w))

        def cross(a, b):
            return a[0] * b[1] - a[1] * b[0]

        def momenta(v_hip, v_old, v_new, rate_old, rate_new):
            whole = self.M * cross(hip_at, v_hip) + self.m * (cross(old, v_old) + cross(new, v_new))
            return [
                whole + self.inertia * (rate_old + rate_new),
                self.m * cross(old - hip_at, v_old) + self.inertia * rate_old,
            ]

        kept = momenta(before[0], before[1], before[2], dp, dw)
        J_hip, J_new, J_old = self._jacobians(w, p)  # the new stance leg is at w
        columns = [momenta(J_hip[:, i], J_old[:, i], J_new[:, i], float(i == 1), float(i == 0)) for i in (0, 1)]
        after = np.linalg.solve(np.array(columns).T, kept)
        return np.array([w, p, *after])

    def step(self, y):
        """(after the next strike, its period) of a step that begins after a strike."""
        solve = partial(solve_ivp, self.rates, method="DOP853", rtol=1e-12, atol=1e-13)
        both, first = (lambda _, x: x[0] + x[1]), 0.1 / np.sqrt(self.g)  # the angles' sum is zero at the start, too
        both.terminal, both.direction = True, -1
        begun = solve((0.0, first), y).y[:, -1]
        found = solve((first, 10.0 / np.sqrt(self.g)), begun, events=both)
        return self.struck(found.y[:, -1]), float(found.t[-1])


MCGEER = Walker(M=1.0, m=0.5, inertia=0.02, c=0.5, r=0.2, g=1.0, slope=0.01, length=1.2)
"""Straight legs, round feet, a mass at the hip, as [McGeer1990]; the numbers are those of Bhounsule's `passivewalker(2)`, 2009.

His fixed point, (0.189472782205104, -0.239124222551699, 0.378945564410209, -0.053691703909393), is not that of this walker: his
heel strike counts the spin of the trailing leg about the hip with the rate of the other leg. With that, `struck` gives it to
1e-13, and so does a leg without inertia, see `SIMPLEST`.
"""
SIMPLEST = Walker(M=1000.0, m=1.0, inertia=0.0, c=1.0, r=0.0, g=1.0, slope=0.009)
"""The walker of Garcia, Chatterjee, Ruina and Coleman (1998), its feet a thousandth of its hip."""
GAIT = np.array([0.200161072169750, -0.200161072169750, -0.199906060087682, -0.199906060087682 + 0.015805473227965])
"""Its fixed point by Bhounsule's `passivewalker(1)`: angles and rates after a strike."""
COMPASS = Walker(M=10.0, m=5.0, inertia=0.0, c=0.5, r=0.0, g=9.81, slope=np.radians(3.0))
"""The compass gait of Goswami, Thuilot and Espiau (1998)."""
