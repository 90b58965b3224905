"""Friction problems of humanoids: real robots in drawn poses, motions and contacts; a seed gives the same problems again.

Each is one step of time of a robot's inertia M and momentum, in impulses r [N s] and velocities u [m/s] after it:

    M v+ = M v + dt (S^T tau - h) + J^T r,    u = J v+

with dt = 0 of a fall, whose contacts begin with an impact. Points of soles and palms are contacts of their own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import pinocchio as pin

from rbd.arrays import Array, check_seed, check_whole
from rbd.audits.bench.friction import FrictionProblem
from rbd.constraints import SurfaceContact
from rbd.errors.inputs import check_choice, listed_items
from rbd.model.state import State
from rbd.robots import load_robot

SCENES = ("stand", "hands on walls", "stairs", "fall", "jam", "Painleve", "redundant soles")
"""The kinds of problems, in the order in which they are drawn."""
_HANDS = {
    "talos": ("gripper_left_base_link", "gripper_right_base_link"),
    "g1": ("left_rubber_hand", "right_rubber_hand"),
    "romeo": ("l_wrist", "r_wrist"),
    "icub": ("l_hand", "r_hand"),
}
_PALM = 0.03  # half the side of a palm [m]
_STEP = 1e-2


def humanoid_problems(count: int = 1000, *, seed: int = 0, scenes: Sequence[str] = SCENES) -> Iterator[FrictionProblem]:
    """Problems of humanoids, one scene and robot after the other.

    Args:
        count: How many.
        seed: Of the draws; a problem depends on it and on its number alone.
        scenes: Some of `SCENES`.

    Raises:
        InputError: an unknown scene, or no whole number.

    Example:
        >>> problem = next(rbd.audits.bench.humanoid_problems(1))
        >>> problem, rbd.audits.bench.solve(problem).verdict
        (FrictionProblem('0000 stand, talos', global, nv=38, dim=3, contacts=8), 'solved')
    """
    chosen = listed_items("scenes", scenes, "scenes' names")
    for scene in chosen or [""]:
        check_choice("a scene", scene, SCENES)
    count, seed = check_whole("count", count, least=0), check_seed(seed)
    robots = tuple(_HANDS)
    for i in range(count):
        kind, name = chosen[i % len(chosen)], robots[i // len(chosen) % len(robots)]
        yield _problem(f"{i:04d} {kind}, {name}", kind, name, np.random.default_rng([seed, i]))


@lru_cache(maxsize=len(_HANDS))
def _standing(name: str) -> tuple[State, tuple[SurfaceContact, ...]]:
    """(the robot in its standing posture, its soles)."""
    robot = load_robot(name)
    return robot.standing(), tuple(foot for foot in robot.feet() if isinstance(foot, SurfaceContact))


def _problem(title: str, kind: str, name: str, rng: np.random.Generator) -> FrictionProblem:
    standing, feet = _standing(name)
    state, fall = _moved(standing, kind, rng), kind == "fall"
    points = _soles(state, feet, kind, rng)
    if kind in ("hands on walls", "jam", "fall"):
        points += _palms(state, name, kind, rng)
    low, high = (0.8, 1.5) if kind == "jam" else (0.2, 1.0)
    mu = rng.uniform(low, high, len(points))
    if kind == "Painleve":
        state, mu = _dragged(state, points, rng)
    H = np.hstack([J.T for J in points])
    tau = state.h.copy()
    if kind != "Painleve":  # its joints hold their links alone, so that it goes on sliding as it does
        tau -= H @ np.linalg.lstsq(H[:6], state.h[:6], rcond=1e-10)[0]  # with some forces that carry the weight
    tau[:6] = 0.0
    tau[6:] *= rng.uniform(0.8, 1.2, len(tau) - 6)
    if kind == "jam":  # it presses outwards
        tau[6:] += rng.normal(scale=0.5, size=len(tau) - 6) * np.abs(state.h[6:]).max()
    free = state.M @ state.v + (0.0 if fall else _STEP) * (tau - state.h)
    about = f"{kind} of {name}, drawn by rbd.audits.bench.humanoid_problems; impulses [N s], velocities [m/s]"
    return FrictionProblem(title, 3, mu=mu, M=state.M, H=H, f=free, w=np.zeros(H.shape[1]), about=about)


def _moved(state: State, kind: str, rng: np.random.Generator) -> State:
    """The standing robot with its joints, base and velocities drawn for a scene."""
    robot, nv = state.robot, state.robot.nv
    bend = {"stand": 0.02, "redundant soles": 0.02, "Painleve": 0.1}.get(kind, 0.2)
    turned = rng.normal(scale=bend, size=nv)
    turned[:6] = rng.normal(scale=0.02 if kind != "fall" else 0.3, size=6)
    q = pin.integrate(robot.model, state.q, turned)
    pushed = 0.5 if kind != "Painleve" and rng.random() < 0.5 else 0.02
    v = rng.normal(scale=pushed, size=nv)
    if kind == "fall":
        v = rng.normal(scale=0.5, size=nv)
        v[2] -= rng.uniform(1.0, 3.0)
    return State(robot, q, v)


def _dragged(state: State, points: Sequence[Array], rng: np.random.Generator) -> tuple[State, Array]:
    """(the robot sliding, frictions), so that Painleve's paradox holds where the first point slides.

    Friction against the slip d presses it down by more than the normal force lifts it: W_nn - mu W_nt . d < 0. It slides along
    W_nt, and mu is above W_nn / |W_nt|.
    """
    blocks = [J @ np.linalg.solve(state.M, J.T) for J in points]
    along, v = blocks[0][0, 1:] / np.linalg.norm(blocks[0][0, 1:]), state.v.copy()
    v[:3] += rng.uniform(0.5, 2.0) * (along @ points[0][1:, :3])  # the base moves, and the point with it,
    v[:3] -= rng.uniform(0.2, 0.6) * points[0][0, :3]  # towards the ground
    critical = np.array([W[0, 0] / np.linalg.norm(W[0, 1:]) for W in blocks])
    return State(state.robot, state.q, v), np.minimum(critical, 20.0) * rng.uniform(1.1, 2.0, len(points))


def _soles(state: State, feet: Sequence[SurfaceContact], kind: str, rng: np.random.Generator) -> list[Array]:
    """Jacobians of points of both soles, normal first: their corners, the front edge on a stair, a grid where redundant."""
    found, tilt = [], {"stairs": 0.05, "fall": 0.0}.get(kind, 0.02)
    for i, foot in enumerate(feet):
        corners, placement = np.asarray(foot.corners), foot.placement
        if kind == "stairs" and i == 0:
            corners = corners * [0.3, 1.0, 1.0] + [0.7 * corners[:, 0].max(), 0.0, 0.0]
        elif kind == "Painleve":
            corners = corners[np.argsort(-corners[:, 0])[: rng.integers(1, 3)]]
            if i and rng.random() < 0.5:
                continue  # it drags one foot
        elif kind == "redundant soles":
            across = rng.integers(3, 6, 2)
            low, high = corners.min(axis=0), corners.max(axis=0)
            grid = np.meshgrid(*(np.linspace(low[k], high[k], across[k]) for k in (0, 1)), [corners[0, 2]])
            corners = np.column_stack([axis.ravel() for axis in grid])
        normal = _unit(np.array([0.0, 0.0, 1.0]) + tilt * rng.normal(size=3))
        found += _jacobians(state, foot.frame, [placement.act(corner) for corner in corners], normal)
    return found


def _palms(state: State, name: str, kind: str, rng: np.random.Generator) -> list[Array]:
    """Jacobians of four points of each palm on a wall: beside the robot, or before it."""
    found, before = [], kind == "hands on walls" and rng.random() < 0.5
    for side, frame in zip((1.0, -1.0), _HANDS[name], strict=True):
        out = np.array([1.0, 0.0, 0.0]) if before else np.array([0.0, side, 0.0])
        if kind == "fall":
            out = np.array([0.0, 0.0, -1.0])
        normal = _unit(-out + 0.1 * rng.normal(size=3))
        R = state.frame(frame).X_WF.rotation
        square = [R.T @ (x * _PALM * t + y * _PALM * b) for t, b in (tangents(normal),) for x in (-1, 1) for y in (-1, 1)]
        found += _jacobians(state, frame, square, normal)
    return found


def _jacobians(state: State, frame: str, points: Sequence[Array], normal: Array) -> list[Array]:
    """Of points of a frame, in its axes: rows along the normal and two tangents, shape (3, nv) each."""
    F, axes = state.frame(frame), np.array([normal, *tangents(normal)])
    return [axes @ (F.J[:3] - pin.skew(F.X_WF.rotation @ p) @ F.J[3:]) for p in points]


def tangents(normal: Array) -> tuple[Array, Array]:
    """Two unit vectors that stand on a unit normal, and on each other."""
    t = _unit(np.cross(normal, np.eye(3)[np.abs(normal).argmin()]))
    return t, np.cross(normal, t)


def _unit(x: Array) -> Array:
    return np.asarray(x / np.linalg.norm(x))
