"""Pages of the notebooks of examples/notebooks, with their stored outputs."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any

from rbd_site.pages import TOP

FOLDER = TOP / "examples" / "notebooks"
FENCE = "`" * 6


def names() -> list[str]:
    """Names of the notebooks, which are those of their pages in the gallery."""
    return sorted(path.stem for path in FOLDER.glob("*.ipynb"))


def title(name: str) -> str:
    """The headline of a notebook."""
    return "".join(_read(FOLDER / f"{name}.ipynb")["cells"][0]["source"]).split("\n", 1)[0].removeprefix("# ")


def page(name: str) -> str:
    """A notebook in Markdown: its prose, its code, and the HTML of what its cells showed."""
    parts = []
    for cell in _read(FOLDER / f"{name}.ipynb")["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"{FENCE}python\n{source}\n{FENCE}")
        parts += [f"{FENCE}{{raw}} html\n{_shown(output)}\n{FENCE}" for output in cell.get("outputs", ())]
    return "\n\n".join([*parts, "The notebook itself: `examples/notebooks/" + name + ".ipynb`."]) + "\n"


def pages() -> dict[str, str]:
    """{file: text} of the pages of all notebooks."""
    return {f"gallery/{name}.md": page(name) for name in names()}


def _shown(output: dict[str, Any]) -> str:
    """What a cell printed or showed, as HTML."""
    data = output.get("data", {})
    if "text/html" in data:
        return f'<div class="notebook-output">{"".join(data["text/html"])}</div>'
    return f"<pre>{html.escape(''.join(output.get('text') or data['text/plain']))}</pre>"


def _read(path: Path) -> dict[str, Any]:
    return dict(json.loads(path.read_text(encoding="utf-8")))
