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


@pytest.mark.skipif(find_browser() is None, reason="no Chromium on this machine")
def test_parts_and_shared_torques_have_pages(held: RobustHold, browser: Browser, tmp_path: Path):
    """Each member takes the forces of its part; torques of one for all, or of a law of the push, are those of the proof."""
    state, feet = held.loads.state, rbd.load_robot("solo12").feet(friction=0.7)
    crate = rbd.load_robot(Path(__file__).parents[2] / "urdf" / "crate.urdf")
    base = rbd.SurfaceContact("base", "crate", half_lengths=(0.2, 0.2), friction=0.3)
    push = {"base_link": [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]}
    proofs = {
        "parts": hold(crate.at(), [base], com={"crate": (0.15, 0.15, 0.0)}),
        "one": hold(state, feet, friction=0.5, torques="one"),
        "affine": hold(state, feet, pushes=push, friction=0.5, torques="affine"),
    }
    for name, proof in proofs.items():
        assert isinstance(proof, RobustHold) and (proof.parts > 1) == (name == "parts")
        with browser.open(proof.export(tmp_path / f"{name}.html"), width=1100, height=800) as page:
            worst = page.evaluate(SET)
            assert proof.margin - 1e-9 < worst["slack"] < proof.margin + 1.0
            words = page.evaluate("(draw(), document.getElementById('says').textContent)")
            assert (f" of {proof.parts} of the set." in words) == (name == "parts")


def test_other_proofs_have_no_page(held: RobustHold, tmp_path: Path):
    """A box of poses would need the robot at each of them."""
    poses = hold(held.loads.state, rbd.load_robot("solo12").feet(friction=0.7), joints={"FL_HFE": (0.79, 0.81)})
    with pytest.raises(rbd.InputError, match="at one pose, without joints="):
        poses.export(tmp_path / "members.html")
