"""Light and dark pages: as the reader's system has it, by a button, by the address; text that can be read in both."""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.visual.pages.browser import Browser, BrowserPage
from rbd.visual.pages.page import system_colors
from rbd.visual.style import COM_COLOR, MODE_COLORS

LEAST = 4.5
"""Contrast of text, by WCAG 2.2, level AA."""
CONTRASTS = """(() => {
  const parts = (color) => {
    const found = color.match(/[\\d.]+/g).map(Number);
    return found.length > 3 ? found : [...found.slice(0, 3), 1];
  };
  const over = ([r, g, b, a], under) => [r, g, b].map((x, i) => a * x + (1 - a) * under[i]);
  const grounds = [theme.look.top, theme.look.bottom].map((color) => color.map((x) => 255 * x));
  const found = {};
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const box = node.parentElement, text = node.textContent.trim();
    if (!text || !box.checkVisibility() || box.closest("script, svg, .dg, .event")) continue;
    const chain = [];
    for (let each = box; each; each = each.parentElement) chain.unshift(getComputedStyle(each));
    for (const ground of grounds) {
      const whole = chain.reduce((alpha, style) => alpha * Number(style.opacity), 1);
      let back = ground;
      for (const style of chain.slice(2)) back = over(parts(style.backgroundColor), back);
      const [r, g, b, a] = parts(chain[chain.length - 1].color);
      const [light, dark] = [over([r, g, b, a * whole], back), back].map(luminance).sort((x, y) => y - x);
      const contrast = (light + 0.05) / (dark + 0.05);
      found[text] = Math.min(found[text] ?? 99, contrast);
    }
  }
  return found;
})()"""
"""{text on the page: its contrast to what is behind it}: panels over the upper or the lower end of the backdrop."""


def test_pages_without_a_scene_have_the_same_colours() -> None:
    """Tables of checks and sets of members: each colour in both looks, the dark one where the reader's system is dark."""
    light, dark = system_colors().split("@media (prefers-color-scheme: dark) { :root {")
    names = [re.findall(r"(--[a-z-]+):", text) for text in (light, dark)]
    assert names[0] == names[1] and len(set(names[0])) == len(names[0]) > 10
    assert dark.rstrip().endswith("} }") and dark.count("{") + 2 == dark.count("}")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    box, folder = rbd.load_robot("urdf/box.urdf"), tmp_path_factory.mktemp("themes")
    below = pin.SE3(np.eye(3), np.array([0.0, 0.0, -0.1]))
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), placement=below, friction=0.4, on=0.0)
    start = rbd.State(box, [0, 0, 0.11, 0, 0, 0, 1], [1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    run = rbd.simulate(start, [face], duration=0.2, step=5e-3, progress=False)
    state = box.at([0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0])
    with rbd.visual.Scene(box) as scene:
        scene.show(state, rbd.solve(state, [], [face]))
        scene.export(folder / "scene.html")
    return {"motion": run.export(folder / "motion.html"), "scene": folder / "scene.html"}


@pytest.fixture(scope="module", params=["motion", "scene"])
def shown(request: pytest.FixtureRequest, pages: dict[str, Path], browser: Browser) -> Iterator[BrowserPage]:
    """The page in a small window; it draws once, and then no more: these tests need no picture."""
    with browser.open(pages[request.param], width=640, height=400) as page:
        page.evaluate("void (stage.viewer.renderer.render = () => {})")
        yield page


def themed(shown: BrowserPage, scheme: str) -> BrowserPage:
    shown.prefer(scheme)
    shown.wait(f"document.documentElement.dataset.theme === '{scheme}'", seconds=20.0)
    return shown


def test_text_can_be_read(shown: BrowserPage) -> None:
    """Legend, buttons, curves, bar, labels, layers and help, dark and light: 4.5 to 1 at least."""
    found: dict[str, float] = {}
    shown.evaluate("foldLegend(stage.legend, false)")
    for scheme, panel in product(("dark", "light"), ("layers", "help")):
        themed(shown, scheme)
        shown.evaluate(f"stage.toolbar.open('{panel}'); stage.toolbar.show('labels', true); stage.viewer.render()")
        for text, contrast in shown.evaluate(CONTRASTS).items():
            found[text] = min(contrast, found.get(text, np.inf))
    assert {"centre of mass", "layers", "views: start, front, side, top"} < {*found}
    assert len(found) > 25
    assert {text: round(contrast, 2) for text, contrast in found.items() if contrast < LEAST} == {}


def test_the_page_is_as_the_system_until_it_is_asked(shown: BrowserPage) -> None:
    """Backdrop, lamps, marks and swatches follow; a button turns it, the address keeps that; what is black becomes white."""
    look = """(() => {
      const ball = stage.player ? stage.player.cast.ball.children[0] : stage.layers.object("marks/com/ball").children[0];
      const swatch = [...document.querySelectorAll("#legend [data-given]")].find((each) => each.dataset.given.endsWith("%s"));
      const { data } = stage.viewer.scene.background.image;
      return [data[0], ball.material.color.getHexString(), getComputedStyle(swatch).backgroundColor, stage.views.link()];
    })()"""
    seen = {scheme: themed(shown, scheme).evaluate(look % COM_COLOR) for scheme in ("dark", "light")}
    assert seen["dark"][0] < 100 < 200 < seen["light"][0]
    assert (seen["light"][1], seen["dark"][1]) == (COM_COLOR[1:], "f2f5f7")
    assert (seen["light"][2], seen["dark"][2]) == ("rgb(26, 26, 26)", "rgb(242, 245, 247)")
    shown.key("d")
    assert shown.evaluate("[theme.name, theme.asked]") == ["dark", "dark"]
    assert shown.evaluate(look % COM_COLOR)[:3] == seen["dark"][:3]
    assert "theme=dark" in shown.evaluate("stage.views.link()")
    shown.key("d")
    assert shown.evaluate("[theme.name, theme.asked]") == ["light", ""]
    shown.evaluate("clearTimeout(stage.views.waiting); window.location.hash = 'theme=dark'")
    shown.wait("theme.name === 'dark'", seconds=20.0)
    shown.evaluate("theme.choose('')")
    themed(shown, "dark")
    colors = [list(bytes.fromhex(shown.evaluate(f"theme.shade('{color}')")[1:])) for color in MODE_COLORS.values()]
    apart = [np.abs(np.subtract(a, b)).max() for i, a in enumerate(colors) for b in colors[:i]]
    assert min(apart) > 25  # modes, of which some are made lighter, differ by a tenth of the scale
