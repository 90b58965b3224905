"""What notebooks show of records: every public class has it, in bounded length, with units, well-formed, names escaped."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import sympy
import test_copies
from copied import instances

import rbd
from rbd.displayed import Displayed
from rbd.records import documented, rows_of, words
from rbd.visual.notebook.shown import MOST_LETTERS, card_html, chart_svg, contact_motions, html_of, printed
from rbd.visual.playback.curves import CurveLine, chart

sys.path.insert(0, str(Path(__file__).parents[1] / "docs" / "site"))
from rbd_site.public import PACKAGES, names_of  # noqa: E402

MOST_BYTES = 40_000
"""The longest card of a record, curves and folded parts included."""
VOID = {"br", "img", "hr", "path", "polyline", "polygon", "circle", "rect"}
CHECKED = "contact_answers motions measured identified mechanisms more_constraints reference_motions planar_chains".split()


class Balanced(HTMLParser):
    """Reads HTML and notes what is open, what is not closed as it was opened, and what could run."""

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.wrong: list[str] = []
        self.words: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Opens an element."""
        if tag not in VOID:
            self.open.append(tag)
        if tag in ("script", "style", "link") or any(name.startswith("on") for name, _ in attrs):
            self.wrong.append(f"<{tag}> with {attrs}")

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """An element without contents."""

    def handle_endtag(self, tag: str) -> None:
        """Closes an element."""
        if not self.open or self.open.pop() != tag:
            self.wrong.append(f"</{tag}>")

    def handle_data(self, data: str) -> None:
        """Text."""
        self.words.append(data)


def read(html: str) -> Balanced:
    """HTML, read to its end."""
    reader = Balanced()
    reader.feed(html)
    reader.close()
    return reader


def public_records() -> Iterator[tuple[str, type]]:
    """(name, class) of all public classes, without protocols and enumerations."""
    for package in ("rbd", *PACKAGES):
        for public in names_of(package).values():
            kind = public.value
            if kind in (rbd.visual.Browser, rbd.visual.Explorer, rbd.studies.Workers):  # tools that run, and nothing to look at
                continue
            if isinstance(kind, type) and not getattr(kind, "_is_protocol", False) and not issubclass(kind, Enum | Warning):
                yield public.name, kind


@pytest.fixture(scope="module")
def records() -> dict[type, list[Any]]:
    """{class: some of its instances}, of all that the questions of `test_copies` answer."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return instances([answer for ask in CHECKED for answer in getattr(test_copies, ask)()])


def test_every_public_class_is_shown_in_notebooks() -> None:
    """What a user can get at the end of a cell has `_repr_html_`; expressions have their formula."""
    without = [name for name, kind in public_records() if not hasattr(kind, "_repr_html_")]
    assert without == []


def test_there_is_one_way() -> None:
    """All use the method that they inherit; only a named tuple, which inherits nothing, has its own."""
    own = {name for name, kind in public_records() if "_repr_html_" in vars(kind)}
    assert own == {"rbd.control.Reference"}
    assert "_repr_html_" in vars(Displayed)


def test_all_records_are_shown_well_formed_and_short(records: dict[type, list[Any]]) -> None:
    """No array is dumped: at most so many letters, no run of numbers; elements are closed; nothing runs; a result is said."""
    wrong, seen = [], 0
    for kind, some in records.items():
        if not hasattr(kind, "_repr_html_") or kind in (rbd.visual.Scene, rbd.Terrain):  # pages
            continue
        for one in some[:2]:
            html, seen = one._repr_html_(), seen + 1
            found = read(html)
            text = " ".join(found.words)
            if found.open or found.wrong:
                wrong.append(f"{kind.__name__}: {found.open} {found.wrong}")
            if len(html) > MOST_BYTES:
                wrong.append(f"{kind.__name__} has {len(html)} letters")
            if long := re.search(r"(?:-?\d+\.\d*(?:e-?\d+)?[,\s]+){13}", re.sub(r"<pre.*?</pre>", "", text, flags=re.DOTALL)):
                wrong.append(f"{kind.__name__}: {long[0]}")
            if not re.search(r"<strong>.{3,}</strong>", html):
                wrong.append(f"{kind.__name__} says no result")
            if re.search(r"color:\s*(white|black|#fff|#000)|background:\s*(?!none)", html):
                wrong.append(f"{kind.__name__} has a colour that one of the themes hides")
    assert not wrong, "\n".join(wrong)
    assert seen > 150


def test_results_come_first_and_numbers_have_units(talos: rbd.Robot) -> None:
    """The first line says what a user asked; texts and cells say in which unit."""
    state, soles = talos.standing(), talos.soles()
    held = rbd.hold(state, soles)
    region = rbd.statics.support_region(state, soles)
    four_bar = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    expected = {
        "held: largest torque 24.1 % of its limit (arm_left_4_joint)": (held, " N ", ">N m</td"),
        "stays as it is": (rbd.solve(state, held.tau, soles), ">m/s2 or rad/s2</td", "friction used"),
        "mm inside": (region, "cm2", ">m</td"),
        "It moves with 1 degree of freedom": (rbd.mechanism.mobility(four_bar.at("assembled")), ">field</t", "singular values"),
        "32 motors, 38 degrees of freedom, 90.27 kg": (talos, "at most 300 N m", "-0.3491 to 1.571"),
        "talos at rest; centre of mass at": (state, " deg", ">m/s or rad/s</td"),
    }
    for said, (record, *parts) in expected.items():
        html = html_of(record)
        first = re.search(r"<strong>(.*?)</strong>", html)
        assert first and said in first[1], first
        assert all(part in html for part in parts), html


def test_the_forces_shown_are_those_of_the_solution(talos: rbd.Robot) -> None:
    """Normal force, friction used and what each contact does, as in the solution."""
    state, soles = talos.standing(), talos.soles()
    solution = rbd.solve(state, rbd.hold(state, soles).tau, soles)
    text = printed(solution)
    for name, force in solution.contacts.items():
        assert re.search(rf"{name} +{force.normal:.3f} N .* {100 * force.friction_used:.1f} %", text)
    assert contact_motions(solution) == dict.fromkeys(solution.contacts, "sticks")


def test_a_contact_that_slips_or_lifts_is_said_to() -> None:
    """A box pushed harder than its friction starts to slip, at the acceleration that the closed form gives."""
    box = rbd.testing.box(mass=10.0)
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6)
    state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
    slips = rbd.solve(state, [], [face], external=[rbd.ExternalForce("box", (80.0, 0.0, 0.0))])
    assert printed(slips).startswith("it accelerates; face starts to slip, 2.11 m/s2\n")  # (80 - 0.6 * 98.1) / 10
    lifts = rbd.solve(state, [], [face], external=[rbd.ExternalForce("box", (0.0, 0.0, 120.0))])
    assert "face lifts off" in printed(lifts).split("\n")[0]


def test_what_is_not_possible_is_said_first(talos: rbd.Robot) -> None:
    """An error at the end of a cell names the limits in its way; a report of a hop counts the frames that float."""
    with pytest.raises(rbd.CannotHold) as caught:
        rbd.hold(talos.standing(), talos.soles()[:1])
    text = printed(caught.value)
    assert text.startswith("CannotHold: ") and all(str(limit) in text for limit in caught.value.limits)
    solo = rbd.load_robot("solo12")
    low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
    report = rbd.check_motion(rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.3, 0.6], rate=50.0))
    html = html_of(report)
    assert "<strong>minimum jerk: 7 of 31 frames possible</strong>" in html and html.count("<svg") == 2
    assert "22.6 % of the frames" in html and re.search(r"floats +24 frames", html)


def drawn(values: np.ndarray, name: str = "x") -> str:
    """One curve over a second, as SVG."""
    line = CurveLine(name, "#0072b2", values)
    return chart_svg(np.linspace(0.0, 1.0, len(values)), chart(name, name, [line]))


def test_names_are_escaped_everywhere() -> None:
    """A name with tags in it is shown as it is, in cells, in the first line and in drawings."""
    evil = "<img src=x onerror=alert(1)>&\"'"
    html = card_html(f"{evil}\n{evil}", [(evil,) * 4], drawn(np.ones(5), evil))
    assert "<img" not in html and read(html).wrong == [] and read(html).open == []
    lock = rbd.JointLock(evil, evil, position=0.0)
    assert "<img" not in html_of(lock) and "&lt;img" in html_of(lock)


def test_long_things_are_cut_and_counted() -> None:
    """A long cell ends in an ellipsis, a long table and a long text in a count, a long array is shape and range."""
    html = card_html("long" + "\nline" * 100, [("x" * 1000,)] * 100)
    assert "x" * MOST_LETTERS not in html and "and 60 more</p>" in html and "and 60 more lines" in html
    assert words(np.linspace(-1.0, 2.0, 700).reshape(100, 7)) == "shape (100, 7), -1 to 2"
    assert words(np.array([1.0, np.nan])) == "(1, -)" and words(np.zeros((0, 3))) == "empty, shape (0, 3)"
    assert words(np.ones(3, bool)) == "shape (3,), 3 true"
    assert len(drawn(np.random.default_rng(0).normal(size=10**5))) < 8000


def test_curves_reach_their_extremes_and_have_gaps() -> None:
    """A spike of one sample among ten thousand is drawn; nothing where there is no number."""
    x = np.zeros(10_000)
    x[4321] = 7.0
    heights = [float(y) for y in re.findall(r"[ML][\d.]+ ([\d.]+)", drawn(x).rpartition('<path d="')[2])]
    assert min(heights) == pytest.approx(110.0 - 90.0 / 1.08, abs=0.1) and max(heights) == 110.0  # of an axis from 0 to 7.56
    assert drawn(np.array([1.0, 2.0, np.nan, 2.0, 1.0])).rpartition('<path d="')[2].split('"')[0].count("M") == 2


def test_fields_have_the_units_of_their_docstring() -> None:
    """The general table takes unit and meaning of a field from `Attributes:`."""

    @dataclass(frozen=True)
    class Spring(Displayed):
        """A spring.

        Attributes:
            stiffness: How hard it is [N/m], as in [Hooke1678].
            name: Its name.
        """

        stiffness: float
        name: str

    assert documented(Spring)["stiffness"] == ("N/m", "How hard it is, as in")
    assert rows_of(Spring(2.5, "a"))[0] == ("stiffness", "2.5", "N/m", "How hard it is, as in")
    assert "Spring: A spring" in Spring(2.5, "a")._repr_html_()


def test_an_empty_scene_says_so(talos: rbd.Robot) -> None:
    """And starts no browser."""
    with rbd.visual.Scene(talos) as scene:
        assert "call scene.show" in html_of(scene)
        assert repr(scene) == "Scene(talos: the scene is empty; call scene.show(state, solution) first)"


def test_counts_and_halves_are_written_as_they_are_read() -> None:
    """One motor is no "motors"; numbers of SymPy are numbers, not the names of their classes; a joint table is the table."""
    bars = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
    assert printed(bars).startswith("four_bar: 1 motor, 3 degrees of freedom, 7.00 kg, fixed base")
    half, g = sympy.Rational(1, 2), sympy.Symbol("g")
    assert words(half) == "1/2" and words((half, 2 * g)) == "1/2, 2*g" and words(g) == "g"
    assert "continuous about -y" in html_of(bars.joints) and html_of(bars.joints).count("<strong>3 joints of four_bar<") == 1
