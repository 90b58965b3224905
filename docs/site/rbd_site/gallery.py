"""The gallery: a card and a page for each example, from its docstring and its section of examples/README.md."""

from __future__ import annotations

import ast
import re
from dataclasses import dataclass
from functools import cache

from rbd_site import notebooks
from rbd_site.pages import TOP

PAGE = TOP / "examples" / "README.md"
PICTURE = re.compile(r"!\[([^\]]*)\]\(\.\./docs/([^)]+)\)")

SUBJECTS = {
    "Statics": "01 02 03 08 09 24 30 39",
    "Contact laws": "04 05 06 07 19 27",
    "Control": "25 28 29 37 38",
    "Motion files": "26 35",
    "Simulation": "14 16 17 31 33 34 36",
    "Mechanisms": "10 11 12 13 15 32",
    "Planar chains and kinematics": "18 20 21 22 23",
}
"""{heading of the gallery: numbers of its examples}."""


@dataclass(frozen=True)
class Example:
    """An example.

    Attributes:
        name: Of its file, e.g. `14_push_recovery`.
        title: The heading of its section, without a number.
        slug: The anchor of that heading.
        section: The text of its section, with its printed answer.
    """

    name: str
    title: str
    slug: str
    section: str

    @property
    def question(self) -> str:
        """The first paragraph of its docstring, on one line."""
        doc = ast.get_docstring(ast.parse((TOP / "examples" / f"{self.name}.py").read_text(encoding="utf-8"))) or ""
        return " ".join(doc.split("\n\n")[0].split())

    @property
    def pictures(self) -> list[tuple[str, str]]:
        """(what one sees, file in docs/) of its pictures."""
        return PICTURE.findall(self.section)


@cache
def examples() -> tuple[Example, ...]:
    """All examples, in teaching order.

    Raises:
        ValueError: an example without a section, or a section without an example.
    """
    found = []
    for part in re.split(r"^## ", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)[1:]:
        heading, section = part.split("\n", 1)
        if file := re.search(r"\]\((\d\d_\w+)\.py\)", section):
            slug = re.sub(r"[^\w\- ]", "", heading.strip().lower()).replace(" ", "-")
            found.append(Example(file[1], re.sub(r"^\d\d ", "", heading.strip()), slug, section.strip()))
    files = {path.stem for path in (TOP / "examples").glob("[0-9][0-9]_*.py")}
    if {e.name for e in found} != files:
        raise ValueError(f"examples/README.md and examples/ differ by {sorted({e.name for e in found} ^ files)}")
    return tuple(sorted(found, key=lambda e: e.name))


@cache
def sections() -> dict[str, str]:
    """{anchor in examples/README.md: page of the gallery}."""
    return {example.slug: example.name for example in examples()}


def from_the_site(markdown: str) -> str:
    """Markdown of examples/README.md with its links as seen from docs/."""
    markdown = re.sub(r"\]\(\.\./docs/", "](/", markdown)
    markdown = re.sub(r"\]\((\d\d_\w+\.py)\)", r"](/../examples/\1)", markdown)
    markdown = re.sub(r"\]\(#([\w-]+)\)", lambda link: f"](/gallery/{sections()[link[1]]}.md)", markdown)
    return re.sub(r"\]\(\.\./", "](/../", markdown)


def example_page(example: Example) -> str:
    """The page of an example."""
    return f"# {example.title}\n\n{from_the_site(example.section)}\n\nThe whole example: `examples/{example.name}.py`.\n"


def card(example: Example) -> str:
    """The card of an example: its first picture, its title, its question."""
    shown = f":img-top: /{example.pictures[0][1]}\n:img-alt: {example.pictures[0][0]}\n" if example.pictures else ""
    return (
        f":::{{grid-item-card}} {example.title}\n{shown}:link: /gallery/{example.name}\n:link-type: doc\n"
        f":class-card: example\n\n{example.question}\n:::\n"
    )


def index_page() -> str:
    """All examples as cards, by subject.

    Raises:
        ValueError: an example without a subject, or with two.
    """
    numbers = " ".join(SUBJECTS.values()).split()
    if sorted(numbers) != [example.name[:2] for example in examples()]:
        raise ValueError(f"subjects have {sorted(numbers)}; expected each example once: set gallery.SUBJECTS")
    of = {example.name[:2]: example for example in examples()}
    names = "\n".join([*(example.name for example in examples()), *notebooks.names()])
    listed = "\n".join(f"- {{doc}}`{notebooks.title(name)} </gallery/{name}>`" for name in notebooks.names())
    intro = from_the_site(re.split(r"^## ", PAGE.read_text(encoding="utf-8"), maxsplit=1, flags=re.MULTILINE)[0])
    intro = intro.replace("# Examples", "# Gallery", 1)
    cards = "\n".join(
        f"## {subject}\n\n::::{{grid}} 1 2 2 3\n:gutter: 3\n\n{chr(10).join(card(of[n]) for n in numbers.split())}\n::::\n"
        for subject, numbers in SUBJECTS.items()
    )
    return f"{intro}\n{cards}\n## Notebooks\n\n{listed}\n\n```{{toctree}}\n:hidden:\n\n{names}\n```\n"


def pages() -> dict[str, str]:
    """{file: text} of all pages of the gallery."""
    return {"gallery/index.md": index_page(), **{f"gallery/{e.name}.md": example_page(e) for e in examples()}}
