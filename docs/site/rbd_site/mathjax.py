"""MathJax from the installed package, so that a page needs no network: the script and its fonts, 2 MB of 24."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path

from sphinx.application import Sphinx

NEEDED = ("tex-chtml-full.js", "output/chtml/fonts/woff-v2", "sre/mathmaps/en.json")


def mathjax_folder() -> Path:
    """Where the package `sphinx-mathjax-offline` keeps MathJax.

    Raises:
        FileNotFoundError: it is not installed.
    """
    # Its name has a hyphen: it can be found, not imported.
    found = importlib.util.find_spec("sphinx-mathjax-offline")
    if found is None or found.origin is None:
        raise FileNotFoundError("sphinx-mathjax-offline is not installed: pip install 'rbd-contact[docs]'")
    return Path(found.origin).parent / "static" / "mathjax"


def copy_mathjax(app: Sphinx, error: Exception | None) -> None:
    """Copy what pages need of MathJax into the built site."""
    if error is not None or app.builder.format != "html":
        return
    source, target = mathjax_folder(), Path(app.outdir) / "_static" / "mathjax"
    for name in NEEDED:
        if (source / name).is_dir():
            shutil.copytree(source / name, target / name, dirs_exist_ok=True)
        elif not (target / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(source / name, target / name)


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("build-finished", copy_mathjax)
