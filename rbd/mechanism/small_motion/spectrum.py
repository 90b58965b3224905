"""Eigenvalues of a linear system without those of its symmetries, which rounding would spoil.

A direction of positions on which nothing depends (the place of a bicycle on its plane, the angle of its wheel) belongs to an
eigenvalue that is zero or, where the axes turn with the motion, imaginary. With the velocities that change with it these
zeros make Jordan blocks, in which an error e of the matrix moves eigenvalues by its root sqrt(e). So the subspace of all x
that never change a velocity (the one that velocities do not observe) is split off first,

    A (S, P) = (S, P) (A_s, A_sp; 0, A_p)

and the modes are those of A_p.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rbd.arrays import Array

INVARIANT = 1e-7
"""Changes up to this part of the largest count as none."""


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The eigenvalues and eigenvectors of A, those of symmetries apart.

    Attributes:
        S: Orthonormal basis of the positions on which nothing depends, shape (n, s), in scaled coordinates.
        symmetric: Eigenvalues on S, shape (s,) [1/s].
        values: The other eigenvalues, shape (n - s,), by descending real part [1/s].
        right: Eigenvectors x of unit length without their parts along S, columns, shape (n, n - s).
        whole: The same eigenvectors with their parts along S; these parts are zero where they do not exist (Jordan blocks).
        left: y with y^H A = lambda y^H, columns, shape (n, n - s), y^H x = 1.
        P: Orthonormal basis of what is perpendicular to S, shape (n, n - s).
        reduced: A_p, shape (n - s, n - s).
        condition: |y| |x|: how much an error of A changes the eigenvalue, shape (n - s,).
    """

    S: Array
    symmetric: Array
    values: Array
    right: Array
    whole: Array
    left: Array
    P: Array
    reduced: Array
    condition: Array


def spectrum_of(A: Array, C: Array, known: Array | None = None) -> Spectrum:
    """The spectrum of A, with the symmetries that no velocity C x observes split off.

    Args:
        A: Shape (n, n), in scaled coordinates.
        C: Velocities of x, shape (k, n), in scaled units.
        known: Further symmetries, which may change velocities, as columns, shape (n, j); those with A x = 0 are taken.
    """
    n, size = len(A), float(np.abs(A).max(initial=0.0)) or 1.0
    S = _kernel(C, max(1.0, float(np.abs(C).max(initial=0.0))))
    while S.shape[1]:
        AS = A @ S
        out = _kernel(AS - S @ (S.T @ AS), size)
        if out.shape[1] == S.shape[1]:
            break
        S = np.linalg.qr(S @ out)[0] if out.shape[1] else S[:, :0]
    for x in () if known is None else known.T:
        x = x / max(1e-300, float(np.linalg.norm(x)))
        fresh = x - S @ (S.T @ x)
        if np.linalg.norm(A @ x) <= INVARIANT * size and np.linalg.norm(fresh) > 1e-3:
            S = np.column_stack([S, fresh / np.linalg.norm(fresh)])
    P = np.linalg.svd(S.T)[2][S.shape[1] :].T if S.shape[1] else np.eye(n)
    A_p, A_s, A_sp = P.T @ A @ P, S.T @ A @ S, S.T @ A @ P
    values, vectors = np.linalg.eig(A_p) if len(A_p) else (np.zeros(0, complex), np.zeros((0, 0), complex))
    order = np.lexsort((-values.imag, -np.round(values.real / size, 12)))
    values, vectors = values[order].astype(complex), vectors[:, order].astype(complex)
    vectors /= np.linalg.norm(vectors, axis=0)
    # A defective A_p has no inverse of its eigenvectors: the pseudo-inverse's large entries say so by the condition.
    left = np.linalg.pinv(vectors, rcond=1e-15).conj().T if len(values) else vectors
    along = np.zeros((S.shape[1], len(values)), complex)
    for k, value in enumerate(values):
        shifted = value * np.eye(S.shape[1]) - A_s
        if S.shape[1] and np.linalg.svd(shifted, compute_uv=False)[-1] > INVARIANT * size:
            along[:, k] = np.linalg.solve(shifted, A_sp @ vectors[:, k])
    right = P @ vectors
    symmetric = np.linalg.eigvals(A_s).astype(complex) if len(A_s) else np.zeros(0, complex)
    condition = np.linalg.norm(left, axis=0) * np.linalg.norm(vectors, axis=0)
    return Spectrum(S, symmetric, values, right, right + S @ along, P @ left, P, A_p, condition)


def _kernel(A: Array, size: float) -> Array:
    """Orthonormal basis of A x = 0, shape (n, d); singular values up to a part of `size` are zero."""
    if not A.size:
        return np.eye(A.shape[1])
    _, s, Vt = np.linalg.svd(A)
    return np.asarray(Vt[int((s > INVARIANT * size).sum()) :].T)


def controllable(A: Array, B: Array) -> int:
    """Dimension of the x that inputs reach: of B, A B, A^2 B, ..., orthonormal directions one step at a time."""
    size = float(np.abs(A).max(initial=0.0)) or 1.0
    largest = float(np.linalg.norm(B, axis=0).max(initial=0.0))
    reached = _range(B / largest, 1.0) if largest else np.zeros((len(A), 0))
    newest = reached
    while newest.shape[1] and reached.shape[1] < len(A):
        more = A @ newest / size
        more -= reached @ (reached.T @ more)
        more -= reached @ (reached.T @ more)
        newest = _range(more, 1.0)
        reached = np.hstack([reached, newest])
    return reached.shape[1]


def _range(X: Array, size: float) -> Array:
    U, s, _ = np.linalg.svd(X, full_matrices=False)
    return np.asarray(U[:, s > INVARIANT * size])
