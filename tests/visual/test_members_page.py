"""The page of one member of a set that is proved to be held."""

from __future__ import annotations

from pathlib import Path

import pytest

import rbd
from rbd.robust import PushSet, RobustHold, hold
from rbd.visual.pages.browser import Browser, find_browser

SET = """(() => {
  const worst = { slack: Infinity, cone: 0 };
  for (let i = 0; i < 200; i++) {
    for (const s of D.sliders) {
      const [low, high] = s.unit ? [-1, 1] : s.name === "friction" ? [1, 2] : s.name === "push2" ? [0, 0] : [-2, 2];
      value[s.name] = i % 3 ? low + Math.random() * (high - low) : Math.random() < 0.5 ? low : high;
    }
    const m = member();
    if (m.beyond.length) return m.beyond;
    worst.slack = Math.min(worst.slack, m.slack); worst.cone = Math.max(worst.cone, m.cone);
  }
  return worst;
})()"""
MOVE = """(([name, to]) => {
  const input = document.getElementById(name); input.value = to; input.dispatchEvent(new Event("input"));
  return [document.body.className, document.getElementById("says").textContent];
})"""


@pytest.fixture(scope="module")
def held() -> RobustHold:
    """Solo, pushed to any side, of uncertain masses and place of the trunk's centre of mass."""
    solo = rbd.load_robot("solo12")
    push = PushSet.box("base_link", (-2, -2, 0), (2, 2, 0))
    found = hold(solo.standing(), solo.feet(friction=0.7), pushes=push, friction=0.5, mass=0.05, com={"base_link": 0.005})
    assert isinstance(found, RobustHold)
    return found


@pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine")
def test_members_of_the_set_keep_the_margin_and_others_are_marked(held: RobustHold, browser: Browser, tmp_path: Path):
    """Forces that the page combines keep every limit by the proved margin at random members, and nearly use it up at some."""
    with browser.open(held.export(tmp_path / "members.html"), width=1100, height=800) as page:
        worst = page.evaluate(SET)
        assert held.margin - 1e-9 < worst["slack"] < held.margin + 1.0 and 0.0 < worst["cone"] < 1.0
        for name, to, what in (("push0", 2.9, "the push"), ("mass", 1.2, "masses"), ("friction", 0.9, "the friction")):
            page.evaluate("for (const s of D.sliders) value[s.name] = s.start")
            shown, words = page.evaluate(f"{MOVE}(['{name}', {to}])")
            assert shown == "beyond" and words == f"Beyond the set by {what}: nothing is proved here."
        page.evaluate("for (const s of D.sliders) value[s.name] = s.start")
        shown, words = page.evaluate(f"{MOVE}(['push0', 1.9])")
        assert shown == "" and words.startswith("Held: ")


def test_other_proofs_have_no_page(held: RobustHold, tmp_path: Path):
    """One torque for all has no forces of each member."""
    one = hold(held.loads.state, rbd.load_robot("solo12").feet(friction=0.7), friction=0.5, torques="one")
    with pytest.raises(rbd.InputError, match="torques='each'"):
        one.export(tmp_path / "members.html")
