"""The built site made smaller: pictures as WebP, icons once for all pages, marks without a style left out."""

from __future__ import annotations

import io
import json
import re
from pathlib import Path

import furo
from PIL import Image
from sphinx.application import Sphinx
from sphinx.util.display import status_iterator

NAMED = re.compile(r"(_images/[\w.-]+)\.png")
AS_IT_IS = re.compile(r"(<pre\b.*?</pre>|<script\b.*?</script>|<textarea\b.*?</textarea>|<style\b.*?</style>)", re.DOTALL)
PLAIN = re.compile(r'<span class="(?:pre|w|p)">([^<]*)</span>')
"""Marks that the theme does not style, or only colours in signatures."""
SAID_ALREADY = re.compile(r' title="(?:rbd\.[\w.]+|Link to this heading|Link to this definition)"')
NEAR, PHOTOGRAPH = 90, 0.6
"""Quality of photographs of scenes: those that then take less than this share of what the exact picture takes."""
ICONS = Path(furo.__file__).parent / "theme" / "furo" / "partials" / "icons.html"


def smaller(page: str) -> str:
    """A page that names the smaller pictures, without what changes nothing on it."""
    parts = AS_IT_IS.split(NAMED.sub(r"\1.webp", page))
    parts[::2] = [re.sub(r"\s*\n\s*", "\n", SAID_ALREADY.sub("", PLAIN.sub(r"\1", part))) for part in parts[::2]]
    return "".join(parts)


def as_webp(png: Path) -> None:
    """The picture beside it as WebP: drawings to the last bit; what is much smaller with losses that one does not see, so."""
    with Image.open(png) as picture:
        shown = (
            picture if picture.mode in ("RGB", "RGBA") else picture.convert("RGBA" if "transparency" in picture.info else "RGB")
        )
        exact, near = io.BytesIO(), io.BytesIO()
        shown.save(exact, "webp", lossless=True, method=4, quality=60)
        shown.save(near, "webp", method=4, quality=NEAR)
    kept = near if near.tell() < PHOTOGRAPH * exact.tell() else exact
    png.with_suffix(".webp").write_bytes(kept.getvalue())


def make_smaller(app: Sphinx, error: Exception | None) -> None:
    """Change what was written by this build; what is changed already stays."""
    if error is not None or app.builder.format != "html":
        return
    out = Path(app.outdir)
    icons = json.dumps(re.sub(r"{#.*?#}", "", ICONS.read_text(encoding="utf-8"), flags=re.DOTALL).strip())
    (out / "_static" / "icons.js").write_text(
        f'document.currentScript.insertAdjacentHTML("beforebegin", {icons});\n', encoding="utf-8"
    )
    for unread in (out / "_static").rglob("*.map"):
        unread.unlink()
    pictures = sorted((out / "_images").glob("*.png"))
    for png in status_iterator(
        pictures, "making pictures smaller... ", "brown", len(pictures), app.verbosity, lambda png: png.stem
    ):
        if not (webp := png.with_suffix(".webp")).is_file() or webp.stat().st_mtime < png.stat().st_mtime:
            as_webp(png)
        png.unlink()
    pages = [page for page in out.rglob("*.html") if page.relative_to(out).parts[0] not in ("scenes", "source")]
    for page in status_iterator(pages, "making pages smaller... ", "brown", len(pages), app.verbosity, lambda page: page.stem):
        text = page.read_text(encoding="utf-8")
        if (less := smaller(text)) != text:
            page.write_text(less, encoding="utf-8")


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("build-finished", make_smaller)
