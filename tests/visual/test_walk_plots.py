"""Pictures of walks: the plan from above, from the side and over time; torques against limits; footprints on a page."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

import rbd
from rbd.control import Walk
from rbd.control.walking.plan import WalkPlan
from rbd.errors import InputError
from rbd.visual.marks.regions import planned_footprints
from rbd.visual.pages.browser import Browser
from rbd.visual.playback.followed_plans import drawn_plans
from rbd.visual.playback.shown_motion import ShownMotion
from rbd.visual.style import contact_colors


@pytest.fixture(scope="module")
def stairs(talos: rbd.Robot) -> Walk:
    """Four steps onto one stair."""
    return Walk(talos, 4, terrain=rbd.Terrain.stairs(0.1, 0.5, 1, start=(0.25, 0.0, 0.0)))


def test_a_plan_is_drawn_from_above(stairs: Walk) -> None:
    """Footprints with the corners of the soles, numbered as they land; treads with their heights; the centre of mass."""
    plan = stairs.plan
    ax = Figure().subplots()
    path, *_ = rbd.visual.plot_walk(ax, plan)
    assert np.array_equal(np.transpose(path.get_data()), plan.centroid.com[:, :2])
    corners = {foot.name: foot.corners for foot in stairs.contacts}
    wanted = [np.array([step.pose.act(c)[:2] for c in corners[step.foot]]) for step in plan.footsteps]
    drawn = [patch.get_xy()[:4] for patch in ax.patches if isinstance(patch, Polygon)]
    assert all(any(np.abs(one - other).max() < 1e-12 for other in drawn if one.shape == other.shape) for one in wanted)
    numbers = {text.get_text(): text.get_position() for text in ax.texts if text.get_text().isdigit()}
    assert list(numbers) and {int(n) for n in numbers} == {1, 2, 3, 4}
    for i, corner in enumerate(wanted):
        assert numbers[str(i + 1)] == pytest.approx(corner.mean(axis=0))
    assert {text.get_text().strip() for text in ax.texts} >= {"0 cm", "10 cm"}
    assert ax.get_aspect() == 1.0


def test_ways_of_feet_and_their_stays(stairs: Walk) -> None:
    """As high as planned, as far as the foot comes; a bar from landing to lift-off."""
    plan = stairs.plan
    above, side, time = Figure().subplots(3)
    rbd.visual.plot_walk([above, side, time], plan)
    ways = [line.get_xydata() for line in side.lines if len(line.get_xydata()) > 10 and line.get_color() != "#66717d"]
    swings = [swing for own in plan.swings.values() for swing in own]
    assert len(ways) == len(swings) == 4
    for way, swing in zip(ways, swings, strict=True):
        far = np.linalg.norm((swing.end.translation - swing.begin.translation)[:2])
        assert np.ptp(way[:, 0]) == pytest.approx(far, abs=1e-9)
        raised = 0.0 if swing.heel is None else swing.toes * np.linalg.norm(swing.heel)  # the toes are no lower
        assert swing.top - 1e-3 < way[:, 1].max() < swing.top + raised + 1e-3
        assert way[-1, 1] == pytest.approx(swing.end.translation[2])
    bars = [bar for bar in time.collections if isinstance(bar, PolyCollection)]
    for bar, (foot, own) in zip(bars, plan.swings.items(), strict=True):
        edges = np.array([path.vertices[:, 0] for path in bar.get_paths()])
        assert edges.min(axis=1) == pytest.approx([0.0, *(s.landing for s in own)]), foot
        assert edges.max(axis=1) == pytest.approx([*(s.start for s in own), plan.duration])


def put_elsewhere(walk: Walk) -> WalkPlan:
    """The first foot is put 5 cm farther and 2 cm below the ground, halfway through its swing."""
    foot, plan = walk.plan.footsteps[0].foot, walk.plan
    first, *later = plan.swings[foot]
    end = pin.SE3(first.end.rotation, first.end.translation + [0.05, 0.0, -0.02])
    moved = first.redirected(first.start + 0.5 * first.T, end, first.landing)
    return replace(plan, swings={**plan.swings, foot: (moved, *later)})


def test_a_foot_that_is_put_elsewhere_on_its_way_is_drawn_from_there() -> None:
    """What it did before is not known to its last way: no picture has it; none goes below the ground."""
    walk = Walk(rbd.load_robot("solo12"), 2, gait="crawl")
    plan = put_elsewhere(walk)
    foot = walk.plan.footsteps[0].foot
    (moved,) = plan.swings[foot]
    was = walk.plan.swings[foot][0].at(moved.known)[0].translation
    assert moved.known == pytest.approx(moved.start + 0.5 * moved.T)
    way = plan.way(moved, 9)
    assert way[0] == pytest.approx(was, abs=1e-12) and way[-1] == pytest.approx([*moved.end.translation[:2], 0.0], abs=1e-12)
    assert way[:, 2].min() == 0.0 and plan.outline(foot, moved.end)[:, 2] == pytest.approx(0.0)
    color = contact_colors(plan.poses)[foot]
    (line,) = [line for line in plan.plot()[0].figure.axes[1].lines if line.get_color() == color and line.get_lw() == 1.5]
    s, z = line.get_data()
    lifted = plan.poses[foot].translation
    assert s[0] - s[-1] == pytest.approx(-np.linalg.norm(np.diff(plan.way(moved, 61)[:, :2], axis=0), axis=1).sum())
    ahead = walk.plan.centroid.com[-1] - walk.plan.centroid.com[0]
    ahead = ahead[:2] / np.linalg.norm(ahead[:2])
    middle = np.mean([X.translation[:2] for X in plan.poses.values()], axis=0)
    assert s[0] == pytest.approx(ahead @ (lifted[:2] - middle) + np.linalg.norm((was - lifted)[:2])) and z.min() >= 0.0


def test_point_feet_that_land_together_share_a_number() -> None:
    """A trot of two swings: numbers 1 and 2, twice each."""
    plan = Walk(rbd.load_robot("solo12"), 2, gait="trot").plan
    axes = plan.plot()[0].figure.axes
    assert sorted(text.get_text() for text in axes[0].texts) == ["1", "1", "2", "2"]
    assert [label.get_text() for label in axes[2].get_yticklabels()] == list(plan.poses)


def test_torques_against_limits(stairs: Walk) -> None:
    """In per cent, the limit dashed; bars where contacts were counted on."""
    short = rbd.simulate(stairs.state, stairs.contacts, duration=0.05, step=2e-3, controller=stairs, progress=False)
    log = stairs.log
    torques, contacts = Figure().subplots(2)
    lines = rbd.visual.plot_control([torques, contacts], log)
    most = max(float(line.get_ydata().max()) for line in torques.lines if line.get_label() != "limit")
    assert most == pytest.approx(100.0 * log.torque_share.max()) and len(short) > 20
    assert {line.get_label() for line in torques.lines} >= {"limit", "largest of the others"}
    assert lines[0] in torques.lines and len(contacts.collections) == 4
    assert rbd.visual.plot_control(torques, log)


def test_a_page_has_each_plan_while_it_was_followed_and_the_capture_point(tmp_path: Path, browser: Browser) -> None:
    """Footholds of the first plan, then those of the second; c + c' / w moves over the ground; a region stays."""
    walk = Walk(rbd.load_robot("solo12"), 2, gait="trot")
    first, second = walk.plan, put_elsewhere(walk)
    run = rbd.simulate(
        walk.state, walk.contacts, duration=0.6, step=2e-3, controller=walk, external=pushed, record_every=5, progress=False
    )  # fmt: skip
    shown, times = ShownMotion.of_trajectory(run), np.linspace(0.0, 0.6, 7)
    marks, spans, moved = drawn_plans([(0.0, first), (0.3, second)], shown, times)
    assert spans == [(0.0, 0.3)] * 4 + [(0.3, 1.6)] * 4 + [(0.0, 1.6)] and len(marks) == 9
    h = walk.state.com[2] - np.mean([X.translation[2] for X in first.poses.values()])
    x = run.com + run.momentum[:, :3] / run.robot.mass * np.sqrt(h / 9.81)
    wanted = np.column_stack([np.interp(times, run.t, x[:, 0]), np.interp(times, run.t, x[:, 1]), np.zeros(7)])
    assert marks[-1].place + moved == pytest.approx(wanted, abs=1e-9) and np.abs(moved[:, 1]).max() > 0.01
    landed = first.footsteps[0].end
    assert [len(one.outlines) for one in planned_footprints(first, landed - 1e-3)] == [1] * 4
    assert not planned_footprints(first, first.duration)
    region = rbd.control.capture_region(walk.state, walk.contacts)
    page = run.export(tmp_path / "walk.html", plan=[(0.0, first), (0.3, second)], regions=[region])
    with browser.open(page, width=500, height=400, fragment="t=0.1") as seen:
        for t, on in ((0.1, True), (0.2, True), (0.4, False)):
            seen.evaluate(f"stage.player.go({t})" if t > 0.1 else "0")  # the page opens at 0.1 s
            one, other, polygon = (f"stage.layers.object('marks/statics/{i}').visible" for i in (1, 5, 0))
            assert seen.evaluate(f"[{one}, {other}, {polygon}]") == [on, not on, True]
            place = seen.evaluate("stage.layers.object('marks/statics/9').position.toArray()")
            x_t = [np.interp(t, run.t, x[:, i]) - x[0, i] for i in (0, 1)]
            assert place == pytest.approx([*x_t, 0.0], abs=2e-3)  # frames are 1/30 s apart, the page goes straight between them
        assert {"capture point", "capture region"} <= set(
            seen.evaluate("[...document.querySelectorAll('#legend td')].map((cell) => cell.textContent)")
        )


def pushed(state: rbd.State, t: float) -> tuple[rbd.ExternalForce, ...]:
    """8 N to the left for 0.2 s."""
    return (rbd.ExternalForce("base_link", force=(0.0, 8.0 * (t < 0.2), 0.0)),)


def test_a_page_has_the_footprints_of_the_plan(stairs: Walk, tmp_path: Path) -> None:
    """In the colours of the contacts, where the feet are to be put down; of no plan there is a message."""
    run = rbd.simulate(stairs.state, stairs.contacts, duration=0.02, step=2e-3, controller=stairs, progress=False)
    found = planned_footprints(stairs.plan)
    assert [(one.name, one.color) for one in found] == [
        (f"{foot}, as planned", color) for foot, color in contact_colors(stairs.plan.poses).items()
    ]
    places = [outline.mean(axis=0) for one in found for outline in one.outlines]
    steps = [step.pose.translation for foot in stairs.plan.poses for step in stairs.plan.footsteps if step.foot == foot]
    assert places == pytest.approx(np.array(steps), abs=1e-9)
    page = run.export(tmp_path / "walk.html", plan=stairs.plan)
    assert "footprints of left_sole, as planned" in page.read_text()
    with pytest.raises(InputError, match="plan is 'walk'; expected"):
        run.export(tmp_path / "walk.html", plan="walk")
    with pytest.raises(InputError, match="plan has 3; expected walk.plan of"):
        run.export(tmp_path / "walk.html", plan=[3])
    with pytest.raises(InputError, match=r"plan has the times \[1.0, 1.0\]; expected numbers that increase"):
        run.export(tmp_path / "walk.html", plan=[(1.0, stairs.plan)] * 2)
    with pytest.raises(InputError, match="plan is of solo12; expected one of talos"):
        run.export(tmp_path / "walk.html", plan=Walk(rbd.load_robot("solo12"), 1).plan)
    with pytest.raises(InputError, match="regions is 3; expected a list"):
        run.export(tmp_path / "walk.html", regions=3)
    with pytest.raises(InputError, match="axes are 4; expected one to 3"):
        rbd.visual.plot_walk(list(Figure().subplots(4)), stairs.plan)
