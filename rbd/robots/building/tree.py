"""The bodies, joints and frames of a model in the making, checked together: one tree, known names, masses where it moves."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from rbd.errors import ModelError, nearest
from rbd.robots.building.parts import Body, Frame, Joint


def check_tree(name: str, root: str, parts: Sequence[Body | Joint | Frame]) -> None:
    """Refuse what is no tree with one root, or moves without mass.

    Args:
        name: Of the robot, for messages.
        root: Kind of its root joint.
        parts: Its bodies, joints and frames; no body has two joints.

    Raises:
        ModelError: naming the part, what it names and the nearest names.
    """
    bodies = {part.name: part for part in parts if isinstance(part, Body)}
    joints = [part for part in parts if isinstance(part, Joint)]
    if not bodies:
        raise ModelError(f"{name}: it has no bodies; give it some: .body(name, rbd.robots.Box(...)).")
    for joint in joints:
        for end, body in (("parent", joint.parent), ("child", joint.child)):
            if body not in bodies:
                raise ModelError(
                    f"{name}: the {end} of joint {joint.name!r:.80} is {body!r:.80}; {_missing(body, root, bodies)}"
                )
    for part in parts:
        if isinstance(part, Frame) and part.body not in bodies:
            raise ModelError(f"{name}: frame {part.name!r:.80} is on {part.body!r:.80}; {_missing(part.body, root, bodies)}")
    made = [f"{part.name}_joint" for part in parts if isinstance(part, Frame)]
    if taken := [joint.name for joint in joints if joint.name in made]:
        frame = taken[0].removesuffix("_joint")
        raise ModelError(f"{name}: joint {taken[0]!r:.80} has the name of the file's joint of frame {frame!r:.80}; rename one.")
    moved = {joint.child: joint for joint in joints}
    roots = [body for body in bodies if body not in moved]
    if len(roots) != 1:
        found = ", ".join(f"{body!r:.80}" for body in roots[:6]) or "none: the joints make a circle, close it with .loop"
        hint = ": .joint(name, 'ground', body, kind)" if root == "fixed" else ""
        raise ModelError(
            f"{name}: expected one body that hangs on no joint, found {len(roots)}: {found}."
            + (f" Join the others to it by a joint, of kind 'free' if they float{hint}." if roots else "")
        )
    below = descendants(joints)
    reached = {roots[0], *below[roots[0]]} if roots[0] in below else {roots[0]}
    if lost := [body for body in bodies if body not in reached]:
        raise ModelError(
            f"{name}: body {lost[0]!r:.80} does not hang on the root {roots[0]!r:.80}: its joints make a circle. Take one of "
            "them out, and close the circle with .loop."
        )
    for joint in joints:
        beyond = (joint.child, *below.get(joint.child, ()))
        if joint.kind != "fixed" and not any(bodies[body].mass > 0.0 for body in beyond):
            more = f", nor has {beyond[1]!r:.80} that hangs on it" if len(beyond) > 1 else ""
            raise ModelError(
                f"{name}: body {joint.child!r:.80} moves in joint {joint.name!r:.80} and has no mass{more}. Give it a mass and "
                "an inertia, or make the joint 'fixed'."
            )


def descendants(joints: Iterable[Joint]) -> dict[str, list[str]]:
    """{body: all bodies that hang on it}; each body hangs on one joint at most. Bodies in a circle are not below the root."""
    children: dict[str, list[str]] = {}
    for joint in joints:
        children.setdefault(joint.parent, []).append(joint.child)
    out = {}
    for body in children:
        found: dict[str, None] = {}
        level = [body]
        while level:
            level = [child for each in level for child in children.get(each, ()) if child not in found]
            found.update(dict.fromkeys(level))
        out[body] = list(found)
    return out


def _missing(body: str, root: str, bodies: Iterable[str]) -> str:
    if body == "ground" and root != "fixed":
        return f"there is a ground where the root is fixed, RobotBuilder(name, root='fixed'), and here it is {root!r}."
    if body.lower() in ("world", "universe"):
        return "what is fixed is called 'ground', where RobotBuilder(name, root='fixed')."
    return f"{nearest(body, bodies)}. Declare it: .body({body!r:.80}, ...)."
