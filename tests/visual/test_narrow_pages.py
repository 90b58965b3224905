"""Pages as they open on a phone, 420 pixels across: what is cut, hidden, broken over two lines, or cannot be read."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import rbd
from rbd.studies import check_motions
from rbd.visual.pages.browser import Browser, BrowserPage
from rbd.visual.pages.page import OLD_BROWSER, SCRIPTS, STYLES, text_of

LONG = "a_" + "very" * 12 + "_long_name_of_a_dance"
SINCE = {r"\?\?=|\|\|=": 85, r"\breplaceChildren": 86, r"\binset:": 87, r"\bsignal\b": 90, r"\.at\(-": 92, r"\bhasOwn\b": 93,
         r"\bstatic ?\{": 94, r"\bfindLast": 97, r"\bstructuredClone\b": 98, r":has\(": 105, r"\btoSorted": 110,
         r"\bcolor-mix\(": 111, r"\(from ": 119}  # fmt: skip
"""First version of Chrome with a feature of scripts and styles, of those newer than `?.`."""


@pytest.fixture(scope="module")
def index(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of two motions of Solo12 with long names, which lift a sole too fast."""
    top: Path = tmp_path_factory.mktemp("phone")
    solo = rbd.load_robot("solo12")
    low, high = solo.standing().q, solo.standing().q + 0.15 * np.eye(solo.nq)[2]
    for i in range(2):
        rbd.motion.minimum_jerk(solo, [low, high, low], [0.0, 0.1, 0.2], rate=40.0).save(top / f"{LONG}{i}.npz")
    checks = check_motions(top, robot="solo12", workers=0, progress=False)
    return checks.export(top / "page", pages=2)


@pytest.fixture(scope="module")
def motion(index: Path, browser: Browser) -> Iterator[BrowserPage]:
    """The page of one of these motions, as a phone opens it."""
    with browser.open(index.parent / f"{LONG}0.html", width=420, height=900) as page:
        yield page


def pixels(page: BrowserPage) -> np.ndarray:
    """The page as it is, as numbers from 0 to 255, shape (height, width, 3)."""
    return np.asarray(Image.open(io.BytesIO(page.picture())).convert("RGB"), float)


def test_names_stay_in_their_cards_and_numbers_with_their_units(index: Path, browser: Browser) -> None:
    """At both widths; no number is in front of a space that may break, and its unit."""
    outside = """[...document.querySelectorAll("figure, .tile, .bars")].filter((box) => {
      const { right } = box.getBoundingClientRect();
      const range = document.createRange();
      range.selectNodeContents(box);
      return [...range.getClientRects()].some((each) => each.right > right + 0.5);
    }).length"""
    for width in (1280, 420):
        with browser.open(index, width=width, height=600) as page:
            assert page.evaluate(outside) == 0
            assert page.evaluate("document.documentElement.scrollWidth") <= width
            words = page.evaluate("document.body.innerText")
    assert not re.findall(r"\d (?:%|s|min|mm|mm/s|degrees)\b|\d %", words)
    assert re.search("\\d\u00a0%", words)


def test_a_table_that_is_cut_has_shaded_edges(index: Path, browser: Browser) -> None:
    """On the side to which it can be scrolled, and on no other; none where all of it is seen."""

    def edges(page: BrowserPage) -> tuple[bool, bool]:
        box = "document.querySelector('.scroll').getBoundingClientRect()"
        left, top, right, bottom = page.evaluate(f"['left', 'top', 'right', 'bottom'].map((side) => {box}[side])")
        seen = pixels(page)[round(top) + 4 : round(bottom) - 4]
        paper = pixels(page)[2, 2]
        return tuple(bool((np.abs(seen[:, round(x)] - paper).max(axis=1) > 20.0).mean() > 0.9) for x in (left + 1, right - 3))

    with browser.open(index, width=420, height=600) as page:
        for scheme in ("light", "dark"):
            page.prefer(scheme)
            page.evaluate("document.querySelector('.scroll').scrollIntoView({ block: 'center' })")
            found = []
            for share in (0.0, 0.5, 1.0):
                page.evaluate(
                    f"(() => {{ const t = document.querySelector('.scroll'); t.scrollLeft = {share} * t.scrollWidth; }})()"
                )
                if share == 0.5:
                    page.evaluate("(() => { const t = document.querySelector('.scroll'); t.scrollLeft = 60; })()")
                found.append(edges(page))
            assert found == [(False, True), (True, True), (True, False)], scheme


def test_curves_start_folded_and_the_robot_is_above_what_covers_the_page(motion: BrowserPage, browser: Browser) -> None:
    """The lowest point that the camera is to see is above bar and curves as the page opens: folded, and 700 across not."""
    lowest = """(() => {
      const top = (each) => each.getBoundingClientRect().top;
      const ys = stage.view.points.map((p) => stage.project(p)[1]);
      const boxes = [stage.player.curves.panel, stage.player.footer].map(top);
      return [stage.player.curves.folded, Math.max(...ys), Math.min(...boxes)];
    })()"""
    folded, low, covered = motion.evaluate(lowest)
    assert folded and 0.0 < low < covered + 1.0 and covered > 450.0
    with browser.open(Path(motion.evaluate("decodeURIComponent(location.pathname)")), width=700, height=900) as wide:
        folded, low, covered = wide.evaluate(lowest)
        assert not folded and 0.0 < low < covered + 1.0
    apart = motion.evaluate(
        "document.querySelector('.toolbar .row').getBoundingClientRect().left - stage.legend.getBoundingClientRect().right"
    )
    assert apart > 0.0  # the folded legend is beside the buttons


def test_names_of_lanes_can_be_read_on_any_colour(motion: BrowserPage) -> None:
    """A contrast of 4.5 with every pixel behind them, on lanes filled, striped and dotted in black, yellow and blue."""
    box = """(() => {
      const name = document.querySelector(".lane.named > span"), { left, top, right, bottom } = name.getBoundingClientRect();
      const ink = getComputedStyle(name).color.match(/\\d+/g).map(Number);
      name.style.color = "transparent";
      return { ink, box: [left, top, right, bottom].map(Math.round) };
    })()"""
    fill = """((kind, color) => {
      const name = document.querySelector(".lane.named > span");
      name.style.color = "";
      for (const each of name.parentElement.querySelectorAll(":scope > div")) each.remove();
      const made = make("div", kind, name.parentElement);
      name.before(made);
      Object.assign(theme.paint(made, "color", color).style, { left: "0%", width: "100%" });
    })"""

    def luminance(rgb: np.ndarray) -> np.ndarray:
        s = np.asarray(rgb) / 255.0
        return np.where(s <= 0.04045, s / 12.92, ((s + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]

    worst = []
    for scheme in ("light", "dark"):
        motion.prefer(scheme)
        for kind in ("", "slips", "creeps"):
            for color in ("#000000", "#f0e442", "#0072b2"):
                motion.evaluate(f"{fill}({kind!r}, {color!r})")
                found = motion.evaluate(box)
                left, top, right, bottom = found["box"]
                seen, ink = luminance(pixels(motion)[top + 1 : bottom - 1, left + 1 : right - 1]), luminance(found["ink"])
                contrast = (np.maximum(seen, ink) + 0.05) / (np.minimum(seen, ink) + 0.05)
                worst.append((float(contrast.min()), scheme, kind, color))
    motion.prefer("light")
    assert min(worst)[0] >= 4.5, min(worst)


def test_words_of_legends_keep_numbers_and_units_together(motion: BrowserPage) -> None:
    """A line may end before a number, not after it."""
    said = motion.evaluate("unbroken('normal 446.2 N, friction used 3.4 % of mu 0.7, 1 m of arrow, 2 of 3')")
    assert said == "normal 446.2\u00a0N, friction used 3.4\u00a0% of\u00a0mu\u00a00.7, 1\u00a0m of arrow, 2 of 3"


def test_old_browsers_are_told_the_versions_that_the_scripts_need(
    motion: BrowserPage, browser: Browser, tmp_path: Path
) -> None:
    """The newest feature of all scripts and styles is in the version named; the words come where scripts cannot be read."""
    libraries = ("uplot/uPlot.iife.min.js", "viewer/viewer.min.js")
    texts = "\n".join(text_of("rbd.visual.pages", f"web/{name}") for name in (*SCRIPTS, *STYLES, *libraries))
    needed = max(version for word, version in SINCE.items() if re.search(word, texts))
    assert f"Chrome and Edge {needed}," in OLD_BROWSER
    page = Path(motion.evaluate("decodeURIComponent(location.pathname)")).read_text(encoding="utf-8")
    page = page.replace("class Stage {", "class Stage { a new word", 1).replace('id="meshcat-pane"', "")
    (tmp_path / "old.html").write_text(page, encoding="utf-8")
    with browser.open(tmp_path / "old.html", width=420, height=300, before="window.onerror = () => true") as old:
        assert old.evaluate("document.body.innerText").strip() == OLD_BROWSER
