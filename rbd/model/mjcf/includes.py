"""The <include> elements of an MJCF file, carried out before MuJoCo reads it: from the file's folders only, within limits."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

from rbd.model.input_files import FileLimits, is_file, read_xml
from rbd.model.urdf import Complaints

Element = ElementTree.Element
MOST_FILES = 100


def carry_out_includes(path: Path, root: Element, limits: FileLimits, folders: tuple[Path, ...] = ()) -> None:
    """Replace the <include> elements by the contents of the included files.

    Args:
        path: The main file.
        root: Its first element, which is changed.
        limits: For each included file, and for all together.
        folders: Folders of included files, besides the main file's folder.

    Raises:
        ModelError: a file that is missing, outside the folders, included twice, or broken.
    """
    if root.find(".//include") is not None:
        inside = tuple(folder.resolve() for folder in (path.parent, *folders))
        _Includer(Complaints(path.name), path, limits, inside, {path.resolve()}).expand(root, path, 1)


@dataclass
class _Includer:
    wrong: Complaints
    main: Path
    limits: FileLimits
    inside: tuple[Path, ...]
    seen: set[Path] = field(default_factory=set)
    size: int = 0
    elements: int = 0

    def expand(self, element: Element, file: Path, depth: int) -> None:
        if depth > self.limits.max_depth:
            self.wrong.stop(f"its includes bring elements {depth} deep inside each other.")
        children: list[Element] = []
        for child in element:
            if child.tag == "include":
                found = self.find(child, file)
                top = self.read(found)
                self.expand(top, found, depth)
                children.extend(top)
            else:
                self.expand(child, file, depth + 1)
                children.append(child)
        element[:] = children

    def find(self, element: Element, file: Path) -> Path:
        """The included file; its name is relative to the including file's folder, else to the main file's."""
        name = element.get("file", "")
        for start in (file.parent, self.main.parent):
            if not is_file(start / name):
                continue
            place = (start / name).resolve()
            if not any(place.is_relative_to(folder) for folder in self.inside):
                self.wrong.stop(
                    f"<include> names the file {name!r:.200}, outside the folder of {self.wrong.file}. Copy it "
                    "there, or give the folder above both: load_robot(..., package_dirs=[folder])."
                )
            return place
        self.wrong.stop(f"<include> is not read: its file {name!r:.200} is not there.")

    def read(self, found: Path) -> Element:
        if found in self.seen:
            self.wrong.stop(f"<include> brings {found.name!r:.200} a second time; expected each file once.")
        self.seen.add(found)
        self.size += found.stat().st_size
        top = read_xml(found, self.limits)
        self.elements += sum(1 for _ in top.iter())
        if len(self.seen) > MOST_FILES or self.size > self.limits.max_bytes or self.elements > self.limits.max_elements:
            self.wrong.stop(
                f"its includes bring more than {MOST_FILES} files, {self.limits.max_bytes / 1e6:g} MB or "
                f"{self.limits.max_elements} elements."
            )
        if top.tag not in ("mujoco", "mujocoinclude"):
            self.wrong.stop(f"<include> brings {found.name!r:.80}, whose first element is <{top.tag:.40}>; expected <mujoco>.")
        return top
