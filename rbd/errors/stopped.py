"""`StudyStopped`: a study ended early, and what it found till then."""

from __future__ import annotations

from typing import Any

from rbd.errors.reasons import RbdError, Reason


class StudyStopped(RbdError):
    """A study ended before all samples were computed: a full disk, a store that went away, a chunk that kills its workers.

    What was finished is kept: with `out=`, the same call goes on from there.

    Attributes:
        dataset: What is kept, as `rbd.study` returns it, `ok` False and `reason` "not_run" where nothing was computed; None
            where it could not be read.

    Example:
        >>> try:
        ...     raise rbd.errors.StudyStopped("push.zarr cannot be written: No space left on device.", dataset=None)
        ... except rbd.RbdError as error:
        ...     print(error, error.dataset)
        push.zarr cannot be written: No space left on device. None
    """

    reason = Reason.STUDY_STOPPED

    def __init__(self, message: str, *, dataset: Any = None) -> None:
        super().__init__(message)
        self.dataset = dataset
