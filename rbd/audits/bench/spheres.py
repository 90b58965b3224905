"""Spheres at rest in a box: large friction problems, in which every contact touches two bodies or one body and a wall."""

from __future__ import annotations

import math

import numpy as np

from rbd.arrays import Array, as_float, check_seed, check_whole
from rbd.audits.bench.friction import FrictionProblem
from rbd.audits.bench.scenes import tangents
from rbd.errors import InputError

_RADIUS, _DENSITY, _GRAVITY, _STEP = 0.05, 1000.0, 9.81, 1e-3
_SPREAD = 1.05  # distance of neighbours in a layer over their diameter: they do not touch
_TOUCH = 1e-9


def spheres_in_a_box(side: int = 10, layers: int = 11, *, friction: float = 0.5, seed: int = 0) -> FrictionProblem:
    """One step of time of spheres in layers of side^2 and (side - 1)^2 in turn, each in the hollows of the layer below.

    By default there are 1,005 spheres with 3,580 contacts, of which many do not determine the forces uniquely. The walls hold
    the outer spheres of every other layer. Impulses [N s], velocities [m/s].

    Args:
        side: Spheres along a side of the lowest layer, 2 to 100.
        layers: 1 to 100.
        friction: Mean coefficient; those of the contacts are drawn within two fifths of it.
        seed: Of the draws.

    Raises:
        InputError: on other numbers.

    Example:
        >>> problem = rbd.audits.bench.spheres_in_a_box(3, 2)
        >>> answer = rbd.audits.bench.solve(problem)
        >>> problem, answer.verdict, bool(np.abs(answer.u).max() < 1e-12)
        (FrictionProblem('13 spheres', global, nv=78, dim=3, contacts=37), 'solved', True)
    """
    side, layers, seed = check_whole("side", side, 100, least=2), check_whole("layers", layers, 100), check_seed(seed)
    if not 0.0 <= as_float(friction) < 1e6:
        raise InputError(f"friction is {friction!r:.80}; expected a number of 0 or more.")
    from scipy.sparse import coo_array, diags_array

    centres, width = _layers(side, layers)
    first, second, normals = _touching(centres, width)
    k, n = len(first), len(centres)
    axes = np.array([[normal, *tangents(normal)] for normal in normals])
    rows, columns, values = [], [], []
    for body, sign in ((first, 1.0), (second, -1.0)):
        some = np.flatnonzero(body >= 0)
        # The arm of a contact is -sign r n: its velocity is v + omega x arm.
        turns = -sign * _RADIUS * np.cross(normals[some][:, None], axes[some])
        J = sign * np.concatenate([axes[some], turns], axis=2)
        contact, row, column = np.meshgrid(np.arange(len(some)), np.arange(3), np.arange(6), indexing="ij")
        rows.append((6 * body[some][contact] + column).ravel())
        columns.append((3 * some[contact] + row).ravel())
        values.append(J.ravel())
    H = coo_array((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (6 * n, 3 * k))
    mass = _DENSITY * 4.0 / 3.0 * math.pi * _RADIUS**3
    inertia = np.tile(np.repeat([mass, 0.4 * mass * _RADIUS**2], 3), n)
    f = np.zeros(6 * n)
    f[2::6] = -mass * _GRAVITY * _STEP
    mu = friction * np.random.default_rng(seed).uniform(0.6, 1.4, k)
    return FrictionProblem(f"{n} spheres", 3, mu=mu, M=diags_array(inertia), H=H, f=f, w=np.zeros(3 * k))


def _layers(side: int, layers: int) -> tuple[Array, float]:
    """(centres, width of the box)."""
    pitch = 2.0 * _RADIUS * _SPREAD
    rise, found = math.sqrt(4.0 * _RADIUS**2 - 0.5 * pitch**2), []
    for layer in range(layers):
        at = np.arange(side - layer % 2) * pitch + _RADIUS + 0.5 * pitch * (layer % 2)
        x, y = np.meshgrid(at, at)
        found.append(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, _RADIUS + layer * rise)]))
    return np.vstack(found), (side - 1) * pitch + 2.0 * _RADIUS


def _touching(centres: Array, width: float) -> tuple[Array, Array, Array]:
    """(first body, second body or -1 of a wall, normal into the first) of the contacts."""
    from scipy.spatial import cKDTree

    pairs = cKDTree(centres).query_pairs(2.0 * _RADIUS * (1.0 + _TOUCH), output_type="ndarray")
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    between = (centres[pairs[:, 0]] - centres[pairs[:, 1]]) / (2.0 * _RADIUS)
    first, second, normals = [pairs[:, 0]], [pairs[:, 1]], [between / np.linalg.norm(between, axis=1)[:, None]]
    for axis, wall, sign in ((2, 0.0, 1.0), (0, 0.0, 1.0), (0, width, -1.0), (1, 0.0, 1.0), (1, width, -1.0)):
        own = np.flatnonzero(sign * (centres[:, axis] - wall) < _RADIUS * (1.0 + _TOUCH))
        first.append(own)
        second.append(np.full(len(own), -1))
        normals.append(np.tile(sign * np.eye(3)[axis], (len(own), 1)))
    return np.concatenate(first), np.concatenate(second), np.concatenate(normals)
