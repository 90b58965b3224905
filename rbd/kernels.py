"""Functions compiled by Numba, and the types of their arguments; imported only where such functions are used."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np

from rbd.installation import in_use

if in_use():
    import numba

NUMBER, COUNT, FLAG = (numba.float64, numba.int64, numba.boolean) if in_use() else (None, None, None)


def array(dim: int, kind: Any = NUMBER, *, written: bool = False, layout: Literal["C", "A"] = "C") -> Any:
    """Numba's type of an array; one that is only read may be read-only."""
    return numba.types.Array(kind, dim, layout, readonly=not written) if in_use() else None


def signature(result: Any, *arguments: Any) -> Any:
    """Of a function of these arguments; a tuple of results is a tuple of types."""
    if not in_use():
        return None
    return (numba.types.Tuple(result) if isinstance(result, tuple) else result)(*arguments)


def compiled(function: Callable[..., Any], types: Any = None) -> Callable[..., Any]:
    """A function compiled when it is first called, and kept on disk; with a signature, compiled for these types alone.

    Where neither the package's folder nor the user's cache can be written, it is compiled anew in each process.
    """
    if not in_use():
        return np.errstate(all="ignore")(function)
    try:
        made = numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError as error:
        if "cannot cache" not in str(error):
            raise
        made = numba.njit(error_model="numpy")(function)
    else:
        _without_what_is_gone(made)
    if types is not None:
        made.compile(types)
        made.disable_compile()
    return made


def _without_what_is_gone(function: Any) -> None:
    """Empty a function's store on disk where it names a class that is gone: Numba would end with an ImportError."""
    try:
        function._cache._cache_file._load_index()
    except (ImportError, AttributeError):
        function._cache.flush()
