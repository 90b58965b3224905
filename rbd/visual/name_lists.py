"""Lists of names in a sentence."""

from __future__ import annotations

from collections.abc import Iterable


def joined(words: Iterable[str], most: int = 6) -> str:
    """Some words with commas, and how many more there are."""
    listed = list(words)
    more = f" and {len(listed) - most} more" if len(listed) > most else ""
    return ", ".join(listed[:most]) + more
