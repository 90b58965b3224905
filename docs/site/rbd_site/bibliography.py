"""The page of references, from docs/references.bib. Identifiers stand as text: no page links to an address outside."""

from __future__ import annotations

import re
from functools import cache

from docutils import nodes
from pybtex.database import Entry, Person, parse_file
from pybtex.richtext import Text

from rbd_site.pages import TOP

FILE = TOP / "docs" / "references.bib"
ADDRESS = re.compile(r"(?:https?://)?(?:dx\.)?(?:doi\.org/)?(\S+)")


@cache
def entries() -> dict[str, Entry]:
    """{key: entry}."""
    return dict(parse_file(str(FILE)).entries)


def keys() -> set[str]:
    """All keys of the bibliography."""
    return set(entries())


def anchor(key: str) -> str:
    """The anchor of a reference on the page."""
    return nodes.make_id(f"ref-{key}")


def written(person: Person) -> str:
    """A name as one writes it: first names, then the family's."""
    parts = (*person.rich_first_names, *person.rich_middle_names, *person.rich_prelast_names, *person.rich_last_names)
    return " ".join(str(part) for part in (*parts, *person.rich_lineage_names))


def text_of(entry: Entry, field: str) -> str:
    """A field as plain text, without addresses."""
    raw = re.sub(r"\\url\{https?://([^}]*)\}", r"\1", entry.fields.get(field, ""))
    if not raw:
        return ""
    plain = str(Text.from_latex(raw))
    return re.sub(r"https?://", "", plain).replace("--", "\N{EN DASH}").replace("``", '"').replace("''", '"')


def line(entry: Entry) -> str:
    """A reference as reStructuredText: authors, title, where it appeared, year, note."""
    people = entry.persons.get("author") or entry.persons.get("editor") or []
    names = [written(person) for person in people]
    authors = " and ".join([", ".join(names[:-1]), names[-1]]) if len(names) > 1 else "".join(names)
    get = {field: text_of(entry, field) for field in entry.fields}
    within = get.get("journal") or get.get("booktitle") or get.get("school") or get.get("institution") or ""
    numbers = ", ".join(
        part
        for part in (
            get.get("series", ""),
            f"volume {get['volume']}" + (f"({get['number']})" if "number" in get else "") if "volume" in get else "",
            f"pages {get['pages']}" if "pages" in get else "",
            get.get("publisher", ""),
            f"{get['edition']} edition" if "edition" in get else "",
            get.get("year", ""),
        )
        if part
    )
    doi = f"DOI {ADDRESS.fullmatch(get['doi'])[1]}" if get.get("doi") else ""  # type: ignore[index]
    where = ", ".join(part for part in (f"*{escaped(within)}*" if within else "", escaped(numbers)) if part)
    parts = [escaped(authors), escaped(get.get("title", "")), where, escaped(doi), escaped(get.get("note", ""))]
    return " ".join(part if part.endswith(".") else f"{part}." for part in parts if part)


def escaped(text: str) -> str:
    """Text that reStructuredText shows as it is."""
    return re.sub(r"([\\*`_|\[\]])", r"\\\1", " ".join(text.split()))


def page() -> str:
    """The page, in reStructuredText."""
    made = ["Bibliography\n============\n\nTexts that pages and docstrings cite, by key.\n"]
    for key in sorted(entries(), key=str.lower):
        made.append(f".. _{anchor(key)}:\n\n**{key}**\n   {line(entries()[key])}\n")
    return "\n".join(made)
