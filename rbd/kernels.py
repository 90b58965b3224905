"""Functions compiled by Numba, and the types of their arguments; imported only if Numba is installed and in use."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba

NUMBER, COUNT, FLAG = numba.float64, numba.int64, numba.boolean


def array(dim: int, kind: Any = NUMBER, *, written: bool = False) -> Any:
    """Numba's type of a C-contiguous array; one that is only read may be read-only."""
    return numba.types.Array(kind, dim, "C", readonly=not written)


def compiled(function: Callable[..., Any], signature: Any = None) -> Callable[..., Any]:
    """A function compiled when it is first called, and kept on disk; with a signature, compiled for these types alone.

    Where neither the package's folder nor the user's cache can be written, it is compiled anew in each process.
    """
    try:
        return numba.njit(signature, cache=True, error_model="numpy")(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        return numba.njit(signature, error_model="numpy")(function)
