"""Scenes of the site without what they share: the viewer, and the triangles of one robot, stand once beside them.

`rbd.visual` writes a scene as one file that holds everything. Here each becomes a small page that loads scripts of the folder
`shared/`: that works from a disk, too, where a page may load scripts and no other files.
"""

from __future__ import annotations

import base64
import html
import json
import re
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

FOLDER = "shared"
NESTED = re.compile(r'srcdoc="([^"]*)"')
SCENE = re.compile(
    r'<script type="text/plain" id="library">(?P<library>[^<]*)</script>\s*'
    r'<script type="text/plain" id="pieces">(?P<pieces>[^<]*)</script>\s*'
    r"<script>(?P<stage>.*?)</script>\s*(?=<script>\s*let stage;\s*unpackPage\((?P<sizes>\[[\d, ]*\]))",
    re.DOTALL,
)
OWN = "script-src 'unsafe-inline'"
"""What the policy of a page allows; scripts beside it are added."""
JOIN = """
// The pieces of this page in its order, from the scripts beside it: the group of each, and its number there.
{
  const plain = inflated, order = ORDER;
  window.inflated = async (base64, lengths) => {
    if (base64) return plain(base64, lengths);
    const groups = new Map();
    for (const [name] of order) if (!groups.has(name)) groups.set(name, await plain(...sharedPieces[name]));
    return order.map(([name, i]) => groups.get(name)[i]);
  };
}
"""


@dataclass(frozen=True)
class Parts:
    """What a scene is made of: `library` and `stage` are those of all, `pieces` are bytes of its own or of one robot."""

    library: str
    stage: str
    pieces: tuple[bytes, ...]

    @classmethod
    def of(cls, found: re.Match[str]) -> Parts:
        """The parts of one scene within a page."""
        whole, at, pieces = zlib.decompress(base64.b64decode(found["pieces"])), 0, []
        for size in json.loads(found["sizes"])[1:]:
            pieces.append(whole[at : at + size])
            at += size
        return cls(found["library"], found["stage"], tuple(pieces))


def shared(pages: dict[str, str]) -> dict[str, str]:
    """{file: text} of all pages and of the scripts that they share.

    Args:
        pages: {name: a page of `rbd.visual`, with one scene, or several in frames}.
    """
    users: dict[bytes, set[str]] = {}
    for name, text in pages.items():
        for parts in _scenes(text):
            for piece in parts.pieces:
                users.setdefault(piece, set()).add(name)
    groups: dict[frozenset[str], list[bytes]] = {}
    for piece, of in users.items():
        groups.setdefault(frozenset(of), []).append(piece)
    scripts, places = {}, dict[bytes, tuple[str, int]]()
    for members in groups.values():
        data = base64.b64encode(zlib.compress(b"".join(members), 9)).decode()
        name = _named(data)
        scripts[f"{FOLDER}/{name}.js"] = (
            f'(window.sharedPieces ??= {{}})["{name}"] = ["{data}", {json.dumps([*map(len, members)])}];\n'
        )
        places |= {piece: (name, i) for i, piece in enumerate(members)}

    def joined(found: re.Match[str]) -> str:
        parts = Parts.of(found)
        viewer = _viewer(parts)
        scripts[f"{FOLDER}/{_named(viewer)}.js"] = viewer
        order = [places[piece] for piece in parts.pieces]
        sources = [_named(viewer), *dict.fromkeys(name for name, _ in order)]
        loads = "".join(f'<script src="{FOLDER}/{source}.js"></script>\n' for source in sources)
        join = JOIN.replace("ORDER", json.dumps(order))
        return f'<script type="text/plain" id="pieces"></script>\n{loads}<script>{join}</script>\n'

    return {f"{name}.html": _each(text, lambda page: SCENE.sub(joined, page)) for name, text in pages.items()} | scripts


def _scenes(text: str) -> Iterator[Parts]:
    for page in (text, *(html.unescape(inner) for inner in NESTED.findall(text))):
        yield from map(Parts.of, SCENE.finditer(page))


def _each(text: str, change: Callable[[str], str]) -> str:
    """A page, and the pages in its frames, changed, and allowed to load scripts beside them."""

    def whole(page: str) -> str:
        return change(page).replace(OWN, f"{OWN} 'self' file:", 1)

    return NESTED.sub(lambda inner: f'srcdoc="{html.escape(whole(html.unescape(inner[1])))}"', whole(text))


def _viewer(parts: Parts) -> str:
    element = 'Object.assign(document.createElement("script"), {type: "text/plain", id: "library", textContent: '
    return f'document.head.append({element}"{parts.library}"}}));\n{parts.stage}'


def _named(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:10]


def write_shared(raw: Path, folder: Path) -> None:
    """Write the pages of a folder into another, without what they share; scripts that no page loads any more are removed."""
    made = shared({page.stem: page.read_text(encoding="utf-8") for page in sorted(raw.glob("*.html"))})
    (folder / FOLDER).mkdir(parents=True, exist_ok=True)
    for old in (*folder.glob("*.html"), *(folder / FOLDER).glob("*.js")):
        if old.relative_to(folder).as_posix() not in made:
            old.unlink()
    for name, text in made.items():
        if not (folder / name).is_file() or (folder / name).read_text(encoding="utf-8") != text:
            (folder / name).write_text(text, encoding="utf-8")
