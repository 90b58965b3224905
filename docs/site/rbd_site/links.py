"""Links from plain Markdown: names of the package, tests, examples and citations become links.

`rbd.solve` opens its page of the API, or its source where it has none, and a room in the table of docs/architecture.md the
list of its modules; `tests/x.py::test_y` the test; [Gauss1829] the bibliography; a relative link to a file of the repository
its highlighted page.
"""

from __future__ import annotations

import re
from pathlib import Path

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util.nodes import make_refnode

from rbd_site import bibliography, gallery, modules, sources
from rbd_site.pages import TOP
from rbd_site.public import PACKAGES, homes, place_of, short_names

NAME = re.compile(r"(rbd(?:\.[A-Za-z]\w*)+)(?:\(.*\))?")
FILE = re.compile(r"((?:rbd|tests|examples|docs|urdf)/[\w/.]+\.(?:py|toml|yaml|urdf|md))(?:::(\w+))?")
CITATION = re.compile(r"\[([A-Z][A-Za-z]+(?:\d{4}|Motion|Multiplier))\]")


def documented(dotted: str) -> str | None:
    """The name under which the API documents `rbd.some.name` or one of its members, or None."""
    parts = dotted.split(".")
    for n in range(len(parts), 1, -1):
        if home := homes().get(".".join(parts[:n])):
            return ".".join([home, *parts[n:]])
    return None


def up(docname: str, address: str) -> str:
    """An address from the top of the site, as seen from a page."""
    return "../" * docname.count("/") + address


def to_source(env: BuildEnvironment, docname: str, file: Path, shown: nodes.Node, name: str | None = None) -> nodes.reference:
    """A link to a source file's page."""
    sources.asked(env, docname, file)
    uri = up(docname, sources.address(file, name))
    return nodes.reference("", "", shown, internal=True, refuri=uri, classes=["to-source"])


def linked_literal(env: BuildEnvironment, docname: str, literal: nodes.literal) -> nodes.Element | None:
    """The link that stands in for a name in code quotes, or None."""
    text, shown = literal.astext(), literal.deepcopy()
    if docname == modules.AT_HOME and text in modules.packages() and has_parent(literal, nodes.table):
        return nodes.reference("", "", shown, internal=True, refuri=up(docname, modules.address(text)))
    if found := FILE.fullmatch(text):
        file = TOP / found[1]
        if file.suffix == ".md":
            name = env.project.path2doc(file)
            return doc_link(docname, name, shown) if name in env.found_docs else None
        return to_source(env, docname, file, shown, found[2]) if file.is_file() else None
    dotted = found[1] if (found := NAME.fullmatch(text)) else short_names().get(text)
    if dotted is None:
        return None
    if dotted in PACKAGES:
        return doc_link(docname, f"api/{dotted}", shown)
    place = place_of(dotted)
    return addnodes.pending_xref(
        "",
        shown,
        refdomain="py",
        reftype="obj",
        reftarget=documented(dotted) or dotted,
        refdoc=docname,
        refexplicit=True,
        rbd_source=sources.address(*place) if place and place[0].is_relative_to(TOP) else None,
    )


def doc_link(docname: str, target: str, shown: nodes.Node) -> nodes.Element:
    """A link to a page."""
    where = {"refdomain": "std", "reftype": "doc", "reftarget": "/" + target, "refdoc": docname, "refexplicit": True}
    return addnodes.pending_xref("", shown, **where)


def linked_file(env: BuildEnvironment, docname: str, link: addnodes.download_reference) -> nodes.Element | None:
    """The link to a highlighted page that stands in for a link to a file; of a notebook, to its page in the gallery."""
    _, path = env.relfn2path(link["reftarget"], docname)
    file = Path(path)
    if file.suffix == ".ipynb":
        return doc_link(docname, f"gallery/{file.stem}", link[0])
    if not file.is_relative_to(TOP) or file.suffix not in (".py", ".toml", ".yaml", ".urdf", ".bib", ".md", ""):
        return None
    return to_source(env, docname, file, link[0])


def cited(docname: str, text: nodes.Text) -> list[nodes.Node] | None:
    """The text with each [Key] as a link to the bibliography, or None if it cites nothing."""
    parts = CITATION.split(str(text))
    if len(parts) == 1:
        return None
    made: list[nodes.Node] = []
    for plain, key in zip(parts[::2], [*parts[1::2], None], strict=True):
        made.append(nodes.Text(plain))
        if key in bibliography.keys():
            uri = up(docname, f"bibliography.html#{bibliography.anchor(key)}")
            made.append(nodes.reference("", f"[{key}]", internal=True, refuri=uri, classes=["citation"]))
        elif key:
            made.append(nodes.Text(f"[{key}]"))
    return made


def has_parent(node: nodes.Node, *kinds: type) -> bool:
    """Whether the node stands within one of these."""
    above = node.parent
    while above is not None:
        if isinstance(above, kinds):
            return True
        above = above.parent
    return False


def link_all(app: Sphinx, doctree: nodes.document) -> None:
    """Put links into a page that was read."""
    env, docname = app.env, app.env.docname
    linked = (nodes.reference, addnodes.pending_xref, addnodes.download_reference, addnodes.desc_signature, nodes.title)
    for download in list(doctree.findall(addnodes.download_reference)):
        if instead := linked_file(env, docname, download):
            download.replace_self(instead)
    for literal in list(doctree.findall(nodes.literal)):
        if not has_parent(literal, *linked) and (made := linked_literal(env, docname, literal)) is not None:
            literal.replace_self(made)
    if docname == "bibliography":
        return
    for text in list(doctree.findall(nodes.Text)):
        apart = (*linked, nodes.literal, nodes.literal_block, nodes.math, nodes.math_block, nodes.raw)
        if "[" in text and not has_parent(text, *apart) and (made_of := cited(docname, text)):
            text.parent.replace(text, made_of)
    for link in doctree.findall(addnodes.pending_xref):
        if link.get("reftarget") == "gallery/index" and link.get("reftargetid") in gallery.sections():
            link["reftarget"], link["reftargetid"] = f"gallery/{gallery.sections()[link['reftargetid']]}", None


def without_page(app: Sphinx, env: BuildEnvironment, node: addnodes.pending_xref, shown: nodes.Element) -> nodes.Element | None:
    """A member that has no entry of its own leads to its class; a name without a page to its source."""
    if "rbd_source" not in node:
        return None
    objects, name, docname = env.domains.python_domain.objects, node["reftarget"], node["refdoc"]
    while name.count(".") > 1:
        name = name.rsplit(".", 1)[0]
        if name in objects and objects[name].objtype in ("class", "exception"):
            return make_refnode(app.builder, docname, objects[name].docname, objects[name].node_id, shown)
    if node["rbd_source"] is None:
        return None
    return nodes.reference("", "", shown, internal=True, refuri=up(docname, node["rbd_source"]), classes=["to-source"])


def setup(app: Sphinx) -> None:
    """Register with Sphinx."""
    app.connect("doctree-read", link_all, priority=100)
    app.connect("missing-reference", without_page)
