"""The residual of the contact law at points: against the full certificate, and against the law in NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd.problem.cones import projection
from rbd.problem.residuals import residuals_of
from rbd.solvers.law_kernel import LEAST_PUSH, cone_miss


def law_residual(y, w, mu, *, coulomb):
    """The largest of all points."""
    each = zip(y.reshape(-1, 3).tolist(), w.reshape(-1, 3).tolist(), mu.tolist(), strict=True)
    return np.max([cone_miss(*u, *f, m, coulomb) for u, f, m in each])


def draws(n=200):
    """Accelerations and weights in their cones of five points; some loaded, some not, some at rest."""
    rng, mu = np.random.default_rng(3), np.array([0.1, 0.5, 0.7, 1.0, 3.0])
    for _ in range(n):
        y, w = (
            rng.normal(size=(5, 3)) * 10.0 ** rng.uniform(-12, 2, (5, 1)),
            rng.normal(size=(5, 3)) * 10.0 ** rng.uniform(-6, 3, (5, 1)),
        )
        w[:, 2] = np.abs(w[:, 2])
        w[:, :2] *= np.minimum(1.0, mu * w[:, 2] / np.hypot(w[:, 0], w[:, 1]))[:, None]
        w[rng.random(5) < 0.3] = 0.0
        y[rng.random(5) < 0.3] = 0.0
        yield y.ravel(), w.ravel(), mu


def in_arrays(y, w, mu, *, coulomb):
    """(how far points sink, their distance to the law), of all points at once."""
    sinks = -y[:, 2]
    if not coulomb:
        sinks = np.maximum(sinks, (mu * np.hypot(y[:, 0], y[:, 1]) - np.maximum(y[:, 2], 0.0)) / (1.0 + mu))
    push = np.maximum(np.linalg.norm(w, axis=1), LEAST_PUSH)
    moved = w - push[:, None] * y
    found = projection(moved.T, mu, coulomb=coulomb)
    nearest = np.column_stack([found.factor[:, None] * moved[:, :2], found.normal])
    return sinks, np.linalg.norm(nearest - w, axis=1) / push


@pytest.mark.parametrize("coulomb", [True, False])
def test_points_one_by_one_and_in_arrays_agree(coulomb):
    """On random points, both laws; NaN stays NaN."""
    for y, w, mu in draws():
        sinks, far = in_arrays(y.reshape(-1, 3), w.reshape(-1, 3), mu, coulomb=coulomb)
        told = law_residual(y, w, mu, coulomb=coulomb)
        assert told == pytest.approx(max(0.0, sinks.max(), far.max()), rel=1e-9, abs=1e-15)
    y[4] = np.nan
    assert not law_residual(y, w, mu, coulomb=coulomb) <= 1.0


@pytest.mark.parametrize("law", ["coulomb", "convex"])
def test_it_bounds_the_full_certificate(law):
    """Five masses of 1 kg, each with a contact: the acceleration y takes the force w and the push y - w."""
    for y, w, mu in draws(50):
        eye, own = np.eye(15), range(0, 15, 3)
        rows = [
            rbd.Rows(f"p{i}", eye[i : i + 3], np.zeros(3), rbd.problem.FrictionCone(m)) for i, m in zip(own, mu, strict=True)
        ]
        problem = rbd.GaussProblem(np.eye(15), y - w, rows)
        full = residuals_of(problem, y, w, w, law)
        told = law_residual(y, w, mu, coulomb=law == "coulomb")
        assert max(full.feasibility.scaled, full.complementarity.scaled) <= told * (1.0 + 1e-9) + 1e-12
