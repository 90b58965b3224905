"""Robot files broken on purpose: each must be refused by name, or load as a validated robot.

    python tests/fuzz.py --n 20000 --seed 0 --jobs 2 --keep folder        (mutant 1234 alone: --start 1234 --n 1)

Mutant i of seed s is always the same. Each is loaded in a fork of its own, with a limit of 10 s and 4 GB, and counts as
    refused    an `RbdError`, whose message is no longer than a screen
    valid      joints, links and masses are those of the file, read here once more; at a random (q, v) M is positive definite,
               all is finite, and Pinocchio's own reading of the file, where it has one, gives the same M
    failure    anything else: another exception, a warning that is not ours, a crash, a time-out, NaN, a lost link

With --mjcf, MJCF files instead, judged by MuJoCo: see tests/fuzz_mjcf.py.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import html
import importlib
import json
import os
import random
import re
import resource
import signal
import sys
import tempfile
import time
import warnings
import xml.etree.ElementTree as ElementTree
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pinocchio as pin
from forked import child, ended
from scipy.linalg import lapack

import rbd

TIME_LIMIT, MEMORY_LIMIT, SCREEN = 10.0, 4 << 30, 1500  # seconds, bytes, letters of the longest message that a person reads
Element = ElementTree.Element

REAL = ("bolt", "solo12", "go2", "panda", "ur5", "xarm7", "human", "talos")
_BODY = '<inertial><origin xyz="0.1 0 -0.2" rpy="0 0.1 0"/><mass value="{}"/>'
_BODY += '<inertia ixx="0.2" ixy="0" ixz="0.01" iyy="0.2" iyz="0" izz="0.1"/></inertial>'


def link(name: str, mass: float | None, shape: str = "") -> str:
    drawn = f"<{{0}}><geometry>{shape}</geometry></{{0}}>" if shape else ""
    body = "" if mass is None else _BODY.format(mass)
    return f'<link name="{name}">{body}{drawn.format("visual")}{drawn.format("collision")}</link>\n'


def joint(name: str, kind: str, parent: str, child: str, more: str = "") -> str:
    more += '<limit lower="-1.5" upper="1.5" effort="10" velocity="5"/>' * (kind in ("revolute", "prismatic"))
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0.1 -0.4" rpy="0.2 0 0"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>\n'


LITTLE = {
    "pendulum": "hinge revolute base rod",
    "tree": "a fixed l0 l1; b revolute l1 l2; c planar l2 l3; d prismatic l1 l4; e fixed l4 l5; f revolute l5 l6; "
    "g floating l0 l7",
    "table": "slide planar world slab; turn continuous slab arm",
}
MORE = {
    "b": '<axis xyz="0 1 0"/><dynamics damping="0.1" friction="0.2"/>',
    "d": '<axis xyz="0 0 1"/><safety_controller k_velocity="1"/>',
    "f": '<mimic joint="b" multiplier="2" offset="0.1"/>',
    "l2": '<sphere radius="0.1"/>',
    "slab": '<cylinder radius="0.3" length="0.1"/>',
    "arm": '<mesh filename="package://nowhere/arm.dae" scale="1 1 1"/>',
}


@cache
def sources() -> dict[str, bytes]:
    """{name: file} to be broken; do not change it."""
    out = {}
    for name, spec in LITTLE.items():
        joints = [each.split() for each in spec.split(";")]
        links = dict.fromkeys(end for each in joints for end in each[2:])
        parts = [link(n, None if n in ("l0", "l4") else 1.0 + k, MORE.get(n, "")) for k, n in enumerate(links)]
        parts += [joint(*each, MORE.get(each[0], "")) for each in joints]
        out[name] = f'<?xml version="1.0"?>\n<robot name="{name}">\n{"".join(parts)}</robot>\n'.encode()
    out |= {p.stem: p.read_bytes() for p in sorted((Path(__file__).parents[1] / "urdf").glob("*.urdf"))}
    return out | {name: rbd.robots.catalogue.find(name).urdf.read_bytes() for name in REAL}


VALUES = (
    "NaN nan inf -inf 1e400 -1e400 -1 0 -0 1 -1e-3 1e300 -1e300 1e150 1e20 1e9 -1e9 1e-20 1e-300 1e-320 1e-6 0.5 1.0f 0x10 1_0 "
    "1,5 ١ --1 + . e 1e text true None world universe root_joint fixed floating base_link ../../../../etc/passwd 1;2 file:///x"
).split() + [
    "", " ", "\t1\n", "1 2", "0 0 0", "1 2 3", "nan 0 0", "0 0 inf", "1 2 3 4", "1e200 0 0", "-1 -1 -1", "package://x/../../y.dae",
    "Ω\u202eΨ", "a b", "a\nb", "<&\"'>", "%s%n{}", "9" * 400, "1" * 5000, "x" * 100_000, "1 " * 10_000, "\u00a01",
]  # fmt: skip
FACTORS = (-1.0, 0.0, 1e3, 1e-3, 1e9, 1e-9, 1e30, 1e-30, 1e160, 1e-160, -0.3, 1.7)
KINDS = "revolute continuous prismatic fixed floating planar spherical ball Revolute screw".split() + ["", " fixed"]
TAGS = "link joint inertial mass inertia origin axis limit mimic parent child visual collision robot mujoco dynamics x".split()
BLOBS = [
    *b"]]> <!-- --> <![CDATA[ &lol; &#0; &#x41; <robot> </robot> > < /> \" ' <?php?> <a/> \0 \x80 \xff \xef\xbb\xbf".split(),
    *(b" " * 100_000, b" xmlns='u' ", b"<a/>" * 20_000, *[b"<a>" * n + b"</a>" * n for n in (50, 200, 5000, 200_000)]),
]
LAUGHS = b" [<!ENTITY a0 'ha'>" + b"".join(b"<!ENTITY a%d '&a%d;&a%d;'>" % (k, k - 1, k - 1) for k in range(1, 30)) + b"]"
HEADS = [b"<!DOCTYPE robot%s>" % more for more in (b"", b" SYSTEM 'file:///x'", LAUGHS)] + [b"\n", b"x", b"\xef\xbb\xbf"]
HEADS += [b"<!-- -->", *[b"<?xml version='1.0' encoding='%s'?>" % c for c in (b"utf-16", b"rot13", b"latin1")]]


class _Breaker:
    """The ways to break a file; every kind of element and of attribute is as likely as any other, however many there are."""

    TREE = ("remove duplicate move retype rewire grow scale rename " * 2 + "retype scale crowd rename").split()
    TEXT = ("set_value " * 5 + "swap_values unset_value").split()
    BYTES = ("flip splice splice " * 2 + "prologue").split()

    def __init__(self, data: bytes, rng: random.Random) -> None:
        self.data, self.rng = data, rng

    def apply(self, step: str) -> None:
        if step in self.TREE:
            self.tree = ElementTree.fromstring(self.data)
            self.above = defaultdict(lambda: Element("nowhere"), {child: e for e in self.tree.iter() for child in e})
            self.links, self.joints = ([e.get("name", "") for e in self.tree.iter(tag)] for tag in ("link", "joint"))
            getattr(self, step)()
            self.data = ElementTree.tostring(self.tree, xml_declaration=True, encoding="utf-8")
        else:
            self.data = getattr(self, step)()

    def any(self, *tags: str) -> Element:
        below = list(self.tree.iter())[1:] or [self.tree]
        tag = self.rng.choice(tags or sorted({e.tag for e in below}))
        return self.rng.choice([e for e in below if e.tag == tag] or below)

    def remove(self) -> None:
        one, many = self.any(), self.rng.random() < 0.3
        for above in list(self.tree.iter()):
            for e in list(above):
                if e is one or many and e.tag == one.tag and self.rng.random() < 0.3:
                    above.remove(e)

    def duplicate(self) -> None:
        one = self.any()
        twin, above = copy.deepcopy(one), self.above[one]
        twin.attrib |= {"name": twin.get("name", "") + "_"} if self.rng.random() < 0.4 else {}
        above.insert(self.rng.randrange(len(above) + 1), twin)

    def move(self) -> None:
        one, other = self.any(), self.any()
        if self.rng.random() < 0.5:
            one = copy.deepcopy(one)
            other = ElementTree.SubElement(self.rng.choice((self.tree, other)), self.rng.choice(TAGS))
        if one is not self.tree and other not in list(one.iter()):
            with contextlib.suppress(ValueError):
                self.above[one].remove(one)
            other.append(one)

    def rewire(self) -> None:
        self.any("parent", "child").set("link", self.rng.choice([*self.links, "world", "nothing"]))
        for end in self.any("joint") if self.rng.random() < 0.4 else ():
            end.tag = {"parent": "child", "child": "parent"}.get(end.tag, end.tag)

    def retype(self) -> None:
        for _ in range(self.rng.choice((1, 1, 3, 20))):
            self.any("joint").set("type", self.rng.choice(KINDS))
        if self.rng.random() < 0.3:
            self.rng.choice((self.tree, *[self.any()] * 9)).tag = self.rng.choice(TAGS)

    def scale(self) -> None:
        by = self.rng.choice(FACTORS)
        tags = self.rng.choice((("mass",), ("inertia",), ("mass", "inertia"), ("origin",)))
        for e in self.rng.choice((list(self.tree.iter()), [self.any(*tags)])):
            for key, value in e.attrib.items() if e.tag in tags else ():
                with contextlib.suppress(ValueError):
                    e.set(key, " ".join(repr(by * float(word)) for word in value.split()))

    def grow(self) -> None:
        """A chain, a star or a detached circle of new links; the long ones are welded."""
        n, shape = self.rng.choice((1, 3, 30, 120, 250, 900, 1900, 2500, 6000)), self.rng.choice(("chain", "star", "circle"))
        above = f"new{n - 1}" if shape == "circle" else self.rng.choice(self.links or ["world"])
        kinds = ("fixed",) if n > 250 else ("revolute", "fixed", "continuous", "floating", "planar")
        for k in range(n):
            self.tree.append(ElementTree.fromstring(link(f"new{k}", self.rng.choice((1.0, 0.01, None)))))
            self.tree.append(ElementTree.fromstring(joint(f"to{k}", self.rng.choice(kinds), html.escape(above), f"new{k}")))
            above = above if shape == "star" else f"new{k}"

    def crowd(self) -> None:
        one, n, what = self.any(), self.rng.choice((100, 9_000, 12_000)), self.rng.randrange(3)
        one.attrib.update({f"a{k}": "1" for k in range(n if what == 0 else 0)})
        self.above[one].extend([one] * (n // 10 if what == 1 else 0))
        one.text = "x" * 100 * n if what == 2 else one.text

    def rename(self) -> None:
        names = [*self.joints, *["", "root_joint", "universe", "world", "nothing", self.rng.choice(VALUES)] * 2]
        one, name = self.any("link", "joint"), self.rng.choice([self.any("link", "joint").get("name", ""), *names])
        if self.rng.random() < 0.3:
            ElementTree.SubElement(one, "mimic", joint=name, multiplier=self.rng.choice("1 0 nan x -2".split()))
        else:
            one.set("name", name)

    def attribute(self) -> tuple[int, int, bytes]:
        found: dict[tuple[bytes, bytes], list[tuple[int, int, bytes]]] = {}
        tag = b""
        for m in re.finditer(rb'<([\w:]+)|\s([\w:]+)="([^"]*)"', self.data):
            tag = m[1] or tag
            if m[2]:
                found.setdefault((tag, m[2]), []).append((m.start(3), m.end(3), m[2]))
        return self.rng.choice(found[self.rng.choice(sorted(found))]) if found else (0, 0, b"")

    def put(self, begin: int, end: int, new: bytes) -> bytes:
        return self.data[:begin] + new + self.data[end:]

    def set_value(self) -> bytes:
        begin, end, _ = self.attribute()
        new, words = html.escape(self.rng.choice(VALUES)).encode(), self.data[begin:end].split(b" ")
        k, whole, by = self.rng.randrange(len(words)), self.rng.random() < 0.4, self.rng.choice(FACTORS)
        with contextlib.suppress(ValueError):
            new = repr(float(words[k]) * by).encode() if self.rng.random() < 0.4 else new
        words[k] = new
        return self.put(begin, end, new if whole else b" ".join(words))

    def swap_values(self) -> bytes:
        (a, b, _), (c, d, _) = sorted((self.attribute(), self.attribute()))
        return self.data[:a] + self.data[c:d] + self.data[b:c] + self.data[a:b] + self.data[d:] if a < c else self.data

    def unset_value(self) -> bytes:
        begin, end, name = self.attribute()
        once = self.put(max(begin - len(name) - 2, 0), end + 1, b"")
        return self.rng.choice((once, self.put(end + 1, end + 1, b" " + name + b'="1"')))

    def flip(self) -> bytes:
        out = bytearray(self.data)
        for _ in range(self.rng.choice((1, 1, 3, 30)) if out else 0):
            out[self.rng.randrange(len(out))] ^= 1 << self.rng.randrange(8)
        return bytes(out)

    def splice(self) -> bytes:
        at, n = self.rng.randrange(len(self.data) + 1), self.rng.choice((0, 0, 1, 3, 30, 1000, len(self.data)))
        block, noise = self.data[at : at + n], self.rng.randbytes(min(n, 50))
        return self.put(at, at + n, self.rng.choice((b"", block + block, block + noise, *self.rng.sample(BLOBS, 2))))

    def prologue(self) -> bytes:
        if self.rng.random() < 0.2:
            coding = self.rng.choice(("utf-16", "utf-32", "utf-8-sig", "utf-7", "cp037"))
            return self.data.decode("utf-8", "replace").encode(coding, "replace")
        body = self.data.split(b"?>", 1)[-1].lstrip() if self.rng.random() < 0.7 else self.data
        return self.rng.choice(HEADS) + body.replace(b"</robot>", self.rng.choice((b"", b"&a29;")) + b"</robot>")


def mutant(seed: int, i: int, files: dict[str, bytes]) -> tuple[bytes, str, str]:
    """(file, root to load it with, what was done to it) of mutant i of a seed."""
    rng = random.Random(f"{seed}:{i}")
    name = rng.choices(list(files), [1.0 if k in REAL else 2.0 for k in files])[0]
    breaker, root = _Breaker(files[name], rng), rng.choice(("free_flyer", "free_flyer", "fixed"))
    ways = sorted(rng.choices((0, 1, 2), (5, 5, 2), k=rng.choice((1, 1, 1, 2, 2, 3))))  # trees first: they must be well-formed
    steps = [rng.choice((_Breaker.TREE, _Breaker.TEXT, _Breaker.BYTES)[way]) for way in ways]
    for step in steps:
        if len(breaker.data) < 1_000_000:  # else the tree's steps take too long
            breaker.apply(step)
    return breaker.data, root, f"{name}: {', '.join(steps)} ({root})"


def expected(data: bytes, root: str) -> tuple[set[str], dict[str, float]]:
    """(links, {moving joint: mass of the links it carries}) by our own reading of a file that was accepted."""
    tree = ElementTree.fromstring(data)
    above = {e.get("link"): j for j in tree.findall("joint") for e in j.findall("child")}
    masses = {j.get("name", ""): 0.0 for j in tree.findall("joint") if j.get("type") != "fixed"} | {"": 0.0}
    for one in tree.findall("link"):
        name, body = one.get("name"), one.find("inertial/mass")
        while name in above and above[name].get("type") == "fixed":
            name = next(e.get("link") for e in above[name].findall("parent"))
        carrier = above[name].get("name", "") if name in above else ""  # "" carries what is welded to the root link
        masses[carrier] += 0.0 if body is None else float(body.get("value", "nan"))
    moving = {name: mass for name, mass in masses.items() if name or root == "free_flyer"}
    return {e.get("name", "") for e in tree.findall("link")}, moving


def judge(path: Path, root: str, seed: int = 0) -> tuple[str, str]:
    """("refused", message), ("valid", "") or ("failure", what is wrong)."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", rbd.errors.ModelWarning)
            robot = rbd.load_robot(path, root=root)  # type: ignore[arg-type]
            rng = np.random.default_rng(seed)
            q = pin.integrate(robot.model, robot.neutral(), rng.uniform(-1, 1, robot.nv))
            state = rbd.State(robot, q, rng.uniform(-1, 1, robot.nv))
            a = rbd.dynamics.free_acceleration(state, np.zeros(robot.nu))
            if path.stat().st_size < 20_000:  # the meshes of large robots take too long
                robot.visual_model, robot.collision_model  # noqa: B018
    except rbd.RbdError as error:
        text = str(error)
        return ("refused", text) if 0 < len(text) <= SCREEN else ("failure", f"a message of {len(text)} letters: {text[:80]}")
    except Exception as error:
        return "failure", f"{type(error).__name__}: {error!s:.200}"
    links, masses = expected(path.read_bytes(), root)
    held = {n: i.mass for n, i in zip(robot.model.names, robot.model.inertias, strict=True) if n != "universe"}
    if root == "free_flyer":
        held[""] = held.pop(robot.model.names[1])
    found = {f.name for f in robot.model.frames if f.type == pin.FrameType.BODY}
    wrong = [n for n in masses if n not in held or abs(held[n] - masses[n]) > 1e-9 * max(1.0, abs(masses[n]))]
    faults = {
        f"links lost or new: {sorted(links ^ found)[:3]!r:.80}": links != found,
        f"joints lost or new: {sorted(masses.keys() ^ held.keys())[:3]!r:.80}": masses.keys() != held.keys(),
        f"mass is not the file's at joint {wrong[:1]!r:.60}": bool(wrong),
        "mass of the robot is not the sum": abs(robot.mass - sum(masses.values())) > 1e-9 * max(1.0, robot.mass),
        "not finite": not all(np.isfinite(x).all() for x in (state.M, state.h, state.com, a)),
        "M is not positive definite": lapack.dpotrf(state.M)[1] != 0,
        "M is not that of Pinocchio's own reading": _misread(path, root, state),
    }
    return next((("failure", text) for text, is_so in faults.items() if is_so), ("valid", ""))


def _misread(path: Path, root: str, state: rbd.State) -> bool:
    """Whether Pinocchio itself finds another robot in the file; one with other masses has lost inertials that are unusual."""
    base = (pin.JointModelFreeFlyer(), state.robot.model.names[1]) if root == "free_flyer" else ()
    try:
        model = pin.buildModelFromUrdf(str(path), *base)
        M = pin.crba(model, model.createData(), state.q)
    except (ValueError, RuntimeError):
        return False
    lost = abs(pin.computeTotalMass(model) - state.robot.mass) > 1e-9 * state.robot.mass
    return not lost and (M.shape != state.M.shape or bool(np.abs(M - state.M).max() > 1e-9 * np.abs(M).max()))


def run(
    seed: int, numbers: Iterable[int], jobs: int = 2, keep: Path | None = None, how: ModuleType | None = None
) -> Iterator[tuple[int, str, str]]:
    """(i, verdict, message) of each mutant, as it ends; files that fail are kept in a folder.

    `how` has sources, mutant and judge; by default this module, for URDF.
    """
    ending = "xml" if how else "urdf"
    how = sys.modules[__name__] if how is None else how
    files = how.sources()
    for name in ("rbd.robots.loading", "rbd.model.mjcf.pinocchio_model", "rbd.model.dynamics"):
        importlib.import_module(name)  # once: each fork would do it anew, which takes longer than its file
    limits = {resource.RLIMIT_AS: MEMORY_LIMIT, resource.RLIMIT_CORE: 0, resource.RLIMIT_CPU: 30}
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:

        def path_of(i: int) -> Path:
            return Path(folder) / f"mutant_{i}.{ending}"

        def judged(i: int) -> object:
            data, root, _ = how.mutant(seed, i, files)
            path_of(i).write_bytes(data)
            return how.judge(path_of(i), root)

        def start(i: int) -> tuple[int, int]:
            return child(lambda: judged(i), lambda error: ("failure", f"the judge failed: {error!r:.300}"), limits)

        for one in ended(start, numbers, jobs, TIME_LIMIT):
            why = f"not ready within {TIME_LIMIT:g} s" if one.late else f"crash by signal {one.signal}"
            verdict, message = json.loads(one.said) if one.said else ("failure", why)
            path = path_of(one.i)
            if keep is not None and verdict == "failure" and path.exists():
                keep.mkdir(parents=True, exist_ok=True)
                (keep / f"seed_{seed}_{path.name}").write_bytes(path.read_bytes())
            path.unlink(missing_ok=True)
            yield one.i, verdict, message


def main() -> int:
    """Run, show progress, print the counts; 1 if anything failed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("n", 20_000), ("seed", 0), ("start", 0), ("jobs", os.cpu_count() or 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--keep", type=Path, help="folder for the files that failed")
    parser.add_argument("--mjcf", action="store_true", help="MJCF files, judged by MuJoCo")
    given = parser.parse_args()
    how = __import__("fuzz_mjcf") if given.mjcf else sys.modules[__name__]
    counts, kinds, begin = Counter[str](), Counter[str](), time.monotonic()
    stops: list[int] = []
    signal.signal(signal.SIGINT, lambda number, _: stops.append(number))  # an exception can be lost while the process forks
    for i, verdict, message in run(
        given.seed, range(given.start, given.start + given.n), given.jobs, given.keep, how if given.mjcf else None
    ):
        counts[verdict] += 1
        kinds[verdict + ": " + re.sub(r"'[^']*'|\S+\.(?:urdf|xml)|-?\d\S*", "..", message.replace("\n", " "))[:90]] += 1
        if verdict == "failure" or given.n == 1:
            story = how.mutant(given.seed, i, how.sources())[2]
            again = f"{'--mjcf ' * given.mjcf}--seed {given.seed} --start {i} --n 1"
            print(f"\n{verdict}: {message}\n  {story}; again: python tests/fuzz.py {again}")
        if counts.total() % 10 == 0:
            print(f"\r{counts.total()} of {given.n}: {dict(counts)}", end="", file=sys.stderr, flush=True)
        if stops:
            break
    print("", *[f"{n:6} {what}" for what, n in kinds.most_common(40)], sep="\n")
    verdicts = ("refused", "valid", "failure", *(["unjudged"] if given.mjcf else []))
    told = ", ".join(f"{counts[verdict]} {verdict}" for verdict in verdicts)
    print(f"{counts.total()} mutants in {time.monotonic() - begin:.0f} s: {told}")
    return int(counts["failure"] > 0)


if __name__ == "__main__":
    sys.exit(main())
