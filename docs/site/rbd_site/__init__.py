"""What the site adds to Sphinx: pages from outside docs/, API, gallery, links, folded tests, search, sources, scenes, maths."""

import gc

from sphinx.application import Sphinx

from rbd_site import api, folded, formulas, links, mathjax, pages, scenes, searching, smaller, sources, subscripts


def setup(app: Sphinx) -> dict[str, bool]:
    """Register all parts of the site with Sphinx.

    A page is a tree of nodes, most of which live for the whole build: looking through them for garbage again and again
    takes a third of its time.
    """
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)
    for part in (pages, api, links, folded, formulas, searching, sources, scenes, mathjax, subscripts, smaller):
        part.setup(app)
    return {"parallel_read_safe": False, "parallel_write_safe": True}
