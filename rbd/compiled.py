"""Whether arithmetic in loops is compiled, by Numba; with RBD_COMPILED=0 in the environment the same functions run interpreted.

Numba is imported with the first contact problem, or when shapes are first looked for on a plane, not with `rbd`.
"""

from __future__ import annotations

import os
from functools import lru_cache


@lru_cache(maxsize=1)
def in_use() -> bool:
    """Whether functions in loops are compiled; else they take some hundred times as long."""
    return os.environ.get("RBD_COMPILED", "1") != "0"
