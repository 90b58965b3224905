"""Loop files as text: YAML 1.2 of plain data, in which no key comes twice."""

from __future__ import annotations

import re
import stat
from pathlib import Path
from typing import Any

import yaml

from rbd.errors import ModelError

LARGEST_FILE = 200_000
"""Bytes. Larger files would take seconds to read, and no robot needs them."""
DEEPEST = 8
"""Lists inside lists; the format needs four."""


class Loader(yaml.SafeLoader):
    """YAML 1.2's numbers and truth values; no aliases, repeated keys or deep nesting."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}
    depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        """One node; an alias may expand to a thousand nodes, each an alias of a thousand others."""
        event = self.peek_event()
        tag = getattr(event, "tag", None)
        if isinstance(event, yaml.AliasEvent) or tag is not None:
            what = "an alias" if tag is None else f"a tag, {tag!r:.80},"
            raise yaml.YAMLError(f"it has {what} in line {event.start_mark.line + 1}; write it out in plain words")
        if self.depth >= DEEPEST:
            raise yaml.YAMLError(f"more than {DEEPEST} lists or pairs inside each other")
        self.depth += 1
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        """A dictionary; YAML's readers silently drop repeated keys."""
        seen: set[str] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if key.value in seen:
                    raise yaml.YAMLError(f"key {key.value!r:.80} comes twice, again in line {key.start_mark.line + 1}")
                seen.add(key.value)
        return super().construct_mapping(node, deep)


for _tag, _pattern, _first in (
    ("null", r"~|null|", ["~", "n", ""]),
    ("bool", r"true|false", ["t", "f"]),
    ("int", r"[-+]?(?:0|[1-9][0-9]*)", list("-+0123456789")),
    ("float", r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?", list("-+.0123456789")),
):
    Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_tag}", re.compile(f"(?:{_pattern})$", re.ASCII), _first)


def bytes_of(path: Path) -> bytes:
    """The bytes of a loop file, no more than one beyond the largest size.

    Raises:
        ModelError: no regular file, or one that cannot be read.
    """
    name = f"{path.name:.120}"
    try:
        found = path.stat()
        if not stat.S_ISREG(found.st_mode):  # a pipe would be waited for, a device has no end
            raise ModelError(f"{name} is no regular file; expected a loop file in YAML.")
        with path.open("rb") as file:
            return file.read(LARGEST_FILE + 1)
    except (OSError, ValueError) as error:
        raise ModelError(f"{name} cannot be read: {getattr(error, 'strerror', None) or error}.") from None


def parsed(name: str, data: bytes) -> object:
    """What the text of a loop file says, in plain dictionaries, lists, words and numbers.

    Raises:
        ModelError: too large, or no YAML of plain data.
    """
    if len(data) > LARGEST_FILE:
        raise ModelError(f"{name} is larger than {LARGEST_FILE / 1000:g} kB; no mechanism needs so much.")
    try:
        return yaml.load(data.decode("utf-8"), Loader=Loader)  # a SafeLoader: plain data only
    except UnicodeDecodeError as error:
        raise ModelError(f"{name} cannot be read as YAML: byte {error.start} is not UTF-8.") from None
    except (yaml.YAMLError, ValueError, OverflowError, RecursionError) as error:
        message = " ".join(str(error).split())
        raise ModelError(f"{name} cannot be read as YAML: {message:.400}.") from None
