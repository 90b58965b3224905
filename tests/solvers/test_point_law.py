"""The residual of the contact law at points: against the full certificate, and its compiled twin against NumPy."""

from __future__ import annotations

import numpy as np
import pytest

import rbd
from rbd import compiled
from rbd.problem.residuals import residuals_of
from rbd.solvers.point_law import law_residual, plain


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


@pytest.mark.parametrize("coulomb", [True, False])
def test_compiled_and_plain_agree(coulomb):
    """On random points, both laws; NaN in either stays NaN."""
    pytest.importorskip("numba", reason="the extra fast is not installed")
    for y, w, mu in draws():
        with compiled.use(True):
            fast = law_residual(np.eye(15), y, w, mu, coulomb=coulomb)
        with compiled.use(False):
            slow = law_residual(np.eye(15), y, w, mu, coulomb=coulomb)
        assert fast == pytest.approx(slow, rel=1e-9, abs=1e-15)
    y[4] = np.nan
    for on in (True, False):
        with compiled.use(on):
            assert not law_residual(np.eye(15), y, w, mu, coulomb=coulomb) <= 1.0


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
        told = plain(y, w, mu, law == "coulomb")
        assert max(full.feasibility.scaled, full.complementarity.scaled) <= told * (1.0 + 1e-9) + 1e-12


@pytest.mark.parametrize("coulomb", [True, False])
def test_a_few_points_in_floats_and_many_in_arrays_agree(coulomb):
    """Five points, and the same four times over, which are too many for floats; NaN in either stays NaN."""
    for y, w, mu in draws():
        few, many = plain(y, w, mu, coulomb), plain(np.tile(y, 4), np.tile(w, 4), np.tile(mu, 4), coulomb)
        assert few == pytest.approx(many, rel=1e-12, abs=1e-15)
    y[4] = np.nan
    assert not plain(y, w, mu, coulomb) <= 1.0 and not plain(np.tile(y, 4), np.tile(w, 4), np.tile(mu, 4), coulomb) <= 1.0
