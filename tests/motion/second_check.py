"""A second check of a frame, by other programs than `rbd.check_motion`: SCS for what is missing, HiGHS for torques.

It computes inverse dynamics, corners and Jacobians of its own, by Pinocchio's recursive Newton-Euler algorithm and frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
import scs
from scipy.optimize import linprog
from scipy.sparse import csc_matrix

import rbd
from rbd.arrays import Array

GRAVITY = 9.81
LENGTH = 0.3


@dataclass(frozen=True)
class Frame:
    """The equations of motion of a frame: base rows A f = b, scaled by the weight, and torques tau = need - T f.

    Forces f are those at the corners that touch, over the weight, shape (3 k,).
    """

    A: Array
    b: Array
    T: Array
    need: Array
    limit: Array

    @classmethod
    def of(cls, robot: rbd.Robot, q: Array, v: Array, a: Array, touches: Array) -> Frame:
        """That of a robot of which some of the corners of both soles touch.

        Args:
            robot: The robot.
            q: Configuration.
            v: Velocity.
            a: Acceleration.
            touches: Which corners touch, shape (8,): of the left sole, then of the right.
        """
        model, data, weight = robot.model, robot.model.createData(), robot.mass * GRAVITY
        force = np.array(pin.rnea(model, data, q, v, a))
        com = np.array(pin.centerOfMass(model, data, q))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        corners = []
        for sole in robot.soles(0.7):
            frame = model.getFrameId(sole.frame)
            J = pin.getFrameJacobian(model, data, frame, pin.LOCAL_WORLD_ALIGNED)
            X = data.oMf[frame]
            for corner in sole.corners:
                arm = X.act(sole.placement.act(corner)) - X.translation
                corners.append(J[:3] - pin.skew(arm) @ J[3:])
        chosen = [J for J, on in zip(corners, touches, strict=True) if on]
        J = np.concatenate(chosen) if chosen else np.zeros((0, robot.nv))
        R = pin.Quaternion(q[3:7]).toRotationMatrix()
        about_com = np.zeros((6, 6))
        about_com[:3, :3] = about_com[3:, 3:] = R
        about_com[3:, :3] = -pin.skew(com - q[:3]) @ R
        about_com[3:] /= LENGTH
        return cls(about_com @ J[:, :6].T, about_com @ force[:6] / weight, weight * J[:, 6:].T, force[6:], robot.effort_limit)

    def missing(self, mu: float) -> float:
        """The least norm of b - A f with f in circular cones, by SCS."""
        m = self.A.shape[1]
        if not m:
            return float(np.linalg.norm(self.b))
        G = np.zeros((7 + m, m + 1))  # of x = (f, size): the cones are of h - G x
        G[0, m], G[1:7, :m] = -1.0, self.A
        for i in range(7, 7 + m, 3):
            G[i, i - 5], G[i + 1, i - 7], G[i + 2, i - 6] = -mu, -1.0, -1.0
        h = np.concatenate([[0.0], self.b, np.zeros(m)])
        data = {"A": csc_matrix(G), "b": h, "c": np.concatenate([np.zeros(m), [1.0]])}
        cones = {"q": [7] + [3] * (m // 3)}
        found = scs.SCS(data, cones, verbose=False, eps_abs=1e-9, eps_rel=1e-9, max_iters=200_000).solve()
        if found["info"]["status"] != "solved":
            raise AssertionError(f"SCS says {found['info']['status']}")
        return float(np.linalg.norm(self.b - self.A @ found["x"][:m]))

    def most_used_torque(self, mu: float, facets: int = 32, *, outside: bool = False) -> float:
        """The least share of the limits with which balance is possible, by HiGHS; inf where no torques balance.

        Args:
            mu: Friction.
            facets: Of the pyramids that replace the cones.
            outside: Pyramids around the cones, which can only need less torque; else inside.
        """
        m = self.A.shape[1]
        angle = (2.0 * np.arange(facets) + 1.0) * np.pi / facets
        wide = mu / np.cos(np.pi / facets) if outside else mu
        edges = np.array([wide * np.cos(angle), wide * np.sin(angle), np.ones(facets)])
        rays = np.kron(np.eye(m // 3), edges)
        T = self.T @ rays / self.limit[:, None]
        t = self.need / self.limit
        n = rays.shape[1]
        share = np.ones((len(t), 1))
        found = linprog(
            np.concatenate([np.zeros(n), [1.0]]),
            np.concatenate([np.concatenate([-T, -share], axis=1), np.concatenate([T, -share], axis=1)]),
            np.concatenate([-t, t]),
            np.concatenate([self.A @ rays, np.zeros((6, 1))], axis=1),
            self.b,
            method="highs",
        )
        return float(found.fun) if found.status == 0 else np.inf
