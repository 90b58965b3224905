"""The search index: each word's stem is found once for all pages, not once a page."""

from __future__ import annotations

from functools import cache

from sphinx.application import Sphinx
from sphinx.search.en import SearchEnglish

STEMMER = SearchEnglish({})


@cache
def stem_of(word: str) -> str:
    """The stem of an English word."""
    return STEMMER.stem(word)


class English(SearchEnglish):
    """English with stems remembered."""

    def stem(self, word: str) -> str:
        """The stem of a word."""
        return stem_of(word)


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.add_search_language(English)
