"""Functions that tests study; other processes import them from here."""

from __future__ import annotations

import os
import signal
import sys
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

CALLS = []


def sums(x: float, y: float) -> dict[str, float]:
    """Two numbers; some samples have no result."""
    if y > 0.8:
        raise ValueError(f"y is {y}")
    return {"sum": x + y, "product": np.sin(x) * y}


def drawn(x: float, rng: np.random.Generator) -> float:
    """A random number."""
    return float(x + rng.standard_normal())


class Drawn:
    """`drawn`, which ends the study as Ctrl-C does after some samples; other processes get it without an end."""

    def __init__(self, after: int = 10**9) -> None:
        self._after = after

    def __reduce__(self) -> tuple[type, tuple[()]]:
        """When it ends the study is no part of what it computes."""
        return Drawn, ()

    def __call__(self, x: float, rng: np.random.Generator) -> float:
        """As `drawn`."""
        self._after -= 1
        if self._after < 0:
            raise KeyboardInterrupt
        return drawn(x, rng)


def sizes(x: np.ndarray) -> dict[str, np.ndarray]:
    """Of each sample of a batch, how many there are, and a sum whose last bits depend on that."""
    return {"size": np.full(len(x), len(x)), "share": x / np.sum(np.sqrt(x))}


def batch_drawn(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Random numbers, one generator a batch."""
    return np.asarray(x + rng.standard_normal(len(x)))


def with_one_bad_sample(x: np.ndarray) -> dict[str, np.ndarray]:
    """Changes what it is given, and fails where 700 is among it."""
    x += 0.5
    if (x == 700.5).any():
        raise ValueError("no number of mine")
    return {"above": x, "size": np.full(len(x), len(x))}


def only_whole_batches(x: np.ndarray) -> np.ndarray:
    """Fails for the second batch, and cannot take one sample."""
    if x[0] == 512 and len(x) > 1:
        raise ValueError("no batch of mine")
    if len(x) == 1:
        raise IndexError("x has no second entry")
    return x


def without_short_axes(x: np.ndarray) -> np.ndarray:
    """Fails for the second batch, and returns one sample without its axis."""
    if x[0] == 512 and len(x) > 1:
        raise ValueError("no batch of mine")
    return np.squeeze(x)


def inverse(x: float) -> float:
    """1 / x."""
    return float(1.0 / np.float64(x))


def applied(law: Callable[[float], float], x: float) -> float:
    """A law at x."""
    return law(x)


def ends_at_three(x: float) -> float:
    """Ends the process, as functions do that were scripts."""
    if x == 3:
        sys.exit("no case of mine")
    return x


def where(x: float) -> dict[str, float]:
    """The process, its number of calls, and its BLAS threads."""
    CALLS.append(x)
    time.sleep(0.002)
    return {"process": os.getpid(), "calls": len(CALLS), "threads": int(os.environ.get("OPENBLAS_NUM_THREADS", -1))}


def warned(x: float) -> float:
    """Warns of two kinds."""
    if x >= 3:
        warnings.warn(f"x is {x:g}", RuntimeWarning, stacklevel=2)
    if x == 5:
        warnings.warn("five", UserWarning, stacklevel=2)
    return x


def killed_once(x: float, mark: str) -> float:
    """The process that computes 7 first is killed."""
    time.sleep(0.002)
    path = Path(mark)
    if x == 7 and not path.exists():
        path.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return x


def killed_at_seven(x: float) -> float:
    """Each process that computes 7 is killed."""
    if x == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.002)
    return x


def killed(x: float) -> float:
    """Every process is killed."""
    os.kill(os.getpid(), signal.SIGKILL)
    return x
