"""Bounds of a motion's forces between two instants: how far from the straight line between their values they can be.

    |f(t) - (1 - s) f(t0) - s f(t1)|  <=  (t1 - t0)^2 / 8  max |f''|        for t between, s = (t - t0) / (t1 - t0)

The second derivatives are bounded body by body with the triangle inequality, from bounds of the derivatives of coordinates.
With w, w', ... bounds of a body's spin and its derivatives, those of a vector fixed to it are 1, w, w' + w^2, ... times its
length. Rounding is not considered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array
from rbd.model.checked_model import CheckedModel
from rbd.planning.curve import of_product


@dataclass(frozen=True, eq=False)
class Bounds:
    """Largest norms of what bodies do in m intervals of time, by order of the derivative.

    Attributes:
        turn: Of a unit vector fixed to the body of each joint, shape (5, joints, m).
        place: Of the joints' origins; order 0 is not bounded, and zero, shape (5, joints, m).
        com: The same of the bodies' centres of mass.
        force: Of mass times acceleration less gravity, orders 0 to 2, shape (3, joints, m) [N].
        moment: Of the moment about the centre of mass, shape (3, joints, m) [N m].
    """

    turn: Array
    place: Array
    com: Array
    force: Array
    moment: Array

    @classmethod
    def of(cls, robot: CheckedModel, sizes: Array) -> Bounds:
        """From those of the coordinates' derivatives 1 to 3, shape (3, m, nv); the fourth is zero.

        Args:
            robot: The robot, with a floating base as its first joint.
            sizes: See `rbd.planning.curve.Curve.sizes`.
        """
        model, m = robot.model, sizes.shape[1]
        spin = np.zeros((4, model.njoints, m))  # w, w', w'', w'''
        place, com = np.zeros((2, 5, model.njoints, m))
        force, moment = np.zeros((2, 3, model.njoints, m))
        turn = np.zeros((5, model.njoints, m))
        turn[0] = 1.0
        gravity = float(np.linalg.norm(model.gravity.linear))
        rate = np.zeros((5, m, robot.nv))
        rate[1:4] = sizes
        for j in range(1, model.njoints):
            own, parent, joint = spin[:, j], model.parents[j], model.joints[j]
            own[:] = spin[:, parent]
            place[:, j] = place[:, parent]
            if j == 1:
                place[1:4, j] = np.linalg.norm(sizes[:, :, :3], axis=2)
                hinges = [3, 4, 5]
            else:
                arm = np.zeros((5, m))
                arm[0] = np.linalg.norm(model.jointPlacements[j].translation)
                place[1:, j] += of_product(turn[:, parent], arm)[1:]
                hinges = [joint.idx_v] if joint.shortname().startswith(("JointModelR", "JointModelH")) else []
                if not hinges:
                    slide = rate[:, :, joint.idx_v].copy()
                    slide[0] = np.abs([model.lowerPositionLimit[joint.idx_q], model.upperPositionLimit[joint.idx_q]]).max()
                    place[1:, j] += of_product(turn[:, parent], slide)[1:]
            for i in hinges:  # z q' is added to the spin, with z fixed to what was before
                own += of_product(_fixed(own), rate[1:, :, i])[:4]
            turn[:, j] = _fixed(own)
            body = model.inertias[j]
            arm = np.zeros((5, m))
            arm[0] = np.linalg.norm(body.lever)
            com[:, j] = place[:, j]
            com[1:, j] += of_product(turn[:, j], arm)[1:]
            force[:, j] = body.mass * com[2:, j]
            force[0, j] += body.mass * gravity
            moment[:, j] = _moment(own, float(np.linalg.eigvalsh(body.inertia).max()))
        return cls(turn, place, com, force, moment)

    def wrench(self, reach: Array) -> tuple[Array, Array]:
        """Second derivatives of the wrench that moves all bodies, about the origin, shapes (m,) [N/s2, N m/s2].

        Args:
            reach: How far centres of mass are from the origin, shape (joints, m) [m].
        """
        arms = self.com[:3].copy()
        arms[0] = reach
        return self.force[2].sum(axis=0), (of_product(arms, self.force)[2] + self.moment[2]).sum(axis=0)

    def torques(self, moves: Array, joints: Array, apart: Array, points: Array, forces: Array, changes: Array) -> Array:
        """Second derivatives of the torques of joints, shape (k, m) [N m/s2]: of bodies that move and of points that rest.

        Args:
            moves: Which bodies each of the k joints moves, shape (k, joints).
            joints: Their numbers, shape (k,).
            apart: How far the bodies' centres of mass are from these joints, shape (k, joints, m) [m].
            points: How far points at which forces act are from them, infinite where a joint does not move them, (k, points, m).
            forces: Their forces' norms, shape (points, m) [N].
            changes: And those of their rates [N/s].
        """
        out = np.empty((len(joints), self.com.shape[2]))
        for i, j in enumerate(joints):
            some = moves[i]
            arms = self.com[:3, some] + self.place[:3, j, None]
            arms[0] = apart[i, some]
            sums = (of_product(arms, self.force[:, some]) + self.moment[:, some]).sum(axis=1)
            own = np.isfinite(points[i, :, 0])
            levers = np.broadcast_to(self.place[:3, j, None], (3, own.sum(), self.com.shape[2])).copy()
            levers[0] = points[i, own]
            pushed = np.array([forces[own], changes[own], 0.0 * forces[own]])
            sums = sums + of_product(levers, pushed).sum(axis=1)
            out[i] = of_product(self.turn[:3, j], sums)[2]
        return out


def _fixed(spin: Array) -> Array:
    """Of a unit vector fixed to a body: its derivatives 0 to 4, from those 0 to 3 of the spin."""
    w, a, b, c = spin
    return np.array([
        np.ones_like(w), w, a + w**2, b + 3.0 * w * a + w**3, c + 4.0 * w * b + 3.0 * a**2 + 6.0 * w**2 * a + w**4
    ])  # fmt: skip


def _moment(spin: Array, inertia: float) -> Array:
    """Of the rate of a body's angular momentum about its centre of mass: derivatives 0 to 2, from those of its spin."""
    w, a, b, c = spin
    own = np.array([w, a, b + w * a, c + 2.0 * w * b + w**2 * a])  # of the spin in the body's axes
    in_body = inertia * (own[1:] + of_product(own[:3], own[:3]))
    turned = np.array([np.ones_like(w), w, a + w**2])
    return of_product(turned, in_body)
