"""Pictures of the built site as lossless WebP, which takes half of PNG: the pages name those."""

from __future__ import annotations

import re
from pathlib import Path

from PIL import Image
from sphinx.application import Sphinx
from sphinx.util.display import status_iterator

NAMED = re.compile(r"(_images/[\w.-]+)\.png")


def smaller(png: Path) -> Path:
    """The same picture beside it, to the last bit, as WebP."""
    with Image.open(png) as picture:
        exact = (
            picture if picture.mode in ("RGB", "RGBA") else picture.convert("RGBA" if "transparency" in picture.info else "RGB")
        )
        exact.save(png.with_suffix(".webp"), lossless=True, method=4, quality=60)
    return png.with_suffix(".webp")


def convert(app: Sphinx, error: Exception | None) -> None:
    """Replace the pictures that were copied, and what names them."""
    if error is not None or app.builder.format != "html":
        return
    out = Path(app.outdir)
    pictures = sorted((out / "_images").glob("*.png"))
    for png in status_iterator(
        pictures, "making pictures smaller... ", "brown", len(pictures), app.verbosity, lambda png: png.stem
    ):
        if not (webp := png.with_suffix(".webp")).is_file() or webp.stat().st_mtime < png.stat().st_mtime:
            smaller(png)
        png.unlink()
    for page in out.rglob("*.html"):
        text = page.read_text(encoding="utf-8")
        if (named := NAMED.sub(r"\1.webp", text)) != text:
            page.write_text(named, encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("build-finished", convert)
