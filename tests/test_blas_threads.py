"""BLAS uses one thread while long work runs, and as many as before afterwards."""

from __future__ import annotations

import threading

import numpy as np
import pytest
import scipy.linalg
from threadpoolctl import threadpool_info, threadpool_limits

import rbd
from rbd.workers import one_blas_thread


def threads() -> int:
    """Of the BLAS that uses most; SciPy's is loaded."""
    scipy.linalg.blas.ddot(np.ones(1), np.ones(1))
    return max(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")


def test_the_first_block_sets_and_restores_whichever_ends_last() -> None:
    inside, leave, seen = threading.Event(), threading.Event(), list[int]()

    def work() -> None:
        with one_blas_thread():
            inside.set()
            leave.wait(10.0)
            seen.append(threads())

    with threadpool_limits(2, user_api="blas"):
        other = threading.Thread(target=work)
        with one_blas_thread():
            other.start()
            assert inside.wait(10.0)
            with one_blas_thread():
                assert threads() == 1
            assert threads() == 1
        assert threads() == 2
        leave.set()
        other.join()
        assert seen == [2]
        assert threads() == 2
        with one_blas_thread():
            assert threads() == 1


def test_a_simulation_runs_on_one_thread_and_restores_the_others_after_an_error() -> None:
    box, seen = rbd.testing.box(), list[int]()
    start = rbd.State(box, [0, 0, 1, 0, 0, 0, 1])

    def pushes(state: rbd.State, t: float) -> None:
        seen.append(threads())
        if len(seen) > 3:
            raise ValueError("enough")

    with threadpool_limits(2, user_api="blas"):
        with pytest.raises(rbd.errors.SimulationStopped):
            rbd.simulate(start, duration=0.1, step=1e-2, external=pushes)
        assert seen[0] == 1
        assert threads() == 2
