"""The bench measures what it says: its draws stick or slip, its peers find the same motion, its parts add up. No times."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import bench_pages
import numpy as np
import pytest
from bench_answers import solving
from bench_control import SUPPORTS, stepping
from bench_draws import Draws
from bench_peers import ConstraintDynamics, PlainProxQP, PlainScript
from bench_profile import by_part
from bench_timing import Row, table_of, turns, versions

import rbd

pytestmark = pytest.mark.filterwarnings("ignore::rbd.errors.RbdWarning")
TOP = Path(__file__).parents[1]
FEW = 12


@pytest.fixture(scope="module", params=["talos", "g1"])
def draws(request: pytest.FixtureRequest) -> Draws:
    """Those of one robot."""
    return Draws(rbd.load_robot(request.param))


def test_draws_stick_or_slip_under_the_law_that_is_asked(draws):
    """Soles at rest before; contact accelerations by `rbd.solve` are zero, or not."""
    for found, law, slips in (
        (draws.sticking(FEW), "coulomb", False),
        (draws.sticking(FEW), "convex", False),
        (draws.slipping("coulomb", FEW), "coulomb", True),
        (draws.slipping("convex", FEW), "convex", True),
    ):
        assert len(found) == FEW and len({q.tobytes() for q, _, _ in found}) == FEW
        for q, v, tau in found:
            state = rbd.State(draws.robot, q, v)
            assert v.any() and all(np.abs(sole.rows(state).velocity).max() < 1e-14 for sole in draws.held)
            s = rbd.solve(state, tau, draws.frictional, law=law)
            assert (max(np.abs(c).max() for c in s.accelerations.values()) > 1e-6) == slips


def test_the_peers_find_the_same_motion(draws):
    """`constraintDynamics` and the NumPy script with held soles; the ProxQP script with frictional ones that slip."""
    stick, slip = draws.sticking(FEW), draws.slipping("convex", FEW)
    for theirs, ours in (
        (ConstraintDynamics(draws).column(stick), solving(draws, stick, draws.held)),
        (PlainScript(draws).column(stick), solving(draws, stick, draws.held)),
        (PlainProxQP(draws).column(slip), solving(draws, slip, draws.frictional, solver=rbd.ProxQP())),
    ):
        for i in range(FEW):
            a = ours(i).a
            assert np.abs(theirs(i) - a).max() < 1e-8 * max(1.0, np.abs(a).max())


def test_steps_of_control_are_certified_and_keep_their_contacts(draws):
    """On both soles and on one, left and right in turn; with a task for the foot that swings."""
    for support, count in zip(SUPPORTS, (2, 1), strict=True):
        run = stepping(draws, draws.sticking(FEW), support)
        found = [run(i) for i in range(FEW)]
        assert all(each.status == "solved" and each.violation is None for each in found)
        assert {len(each.constraints) for each in found} == {count}
        assert len({each.constraints[0].name for each in found}) == 3 - count


def test_sixty_four_points_are_vertices_inside_the_soles(draws):
    """32 each, no three on a line, none beyond the edge of the sole."""
    for sole, round_ in zip(draws.frictional, draws.rounded, strict=True):
        points, reach = round_.corners[:, :2], np.abs(sole.corners[:, :2]).max(axis=0)
        assert len(points) == 32 and (np.abs(points) <= reach).all()
        sides = np.roll(points, -1, axis=0) - points
        turn = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
        assert (turn > 0.0).all()


@pytest.mark.parametrize(
    ("values", "marks", "verdict"),
    [
        ({"talos": 2.9, "g1": 3.0}, (4.0, 3.0), "second"),
        ({"talos": 2.9, "g1": 3.1}, (4.0, 3.0), "first"),
        ({"talos": 2.9, "g1": 4.1}, (4.0, 3.0), "missed"),
        ({"": 9.0}, (10.0,), "met"),
        ({"": 9.0}, (), ""),
    ],
)
def test_the_slowest_robot_decides_which_mark_is_met(values, marks, verdict):
    """Second, first, or none of two marks; met or missed of one."""
    row = Row("row", values, marks=marks)
    assert row.verdict == verdict
    assert table_of("title", [row]).row_count == 1


def test_columns_take_turns():
    """Each column has some calls, then the next: no column has all of its calls at once; each call is counted."""
    order: list[str] = []
    columns = {name: lambda i, name=name: order.append(f"{name}{i}") for name in "ab"}
    times = turns(columns, draws=4, turn=2, rounds=1)
    assert order == ["a0", "b0", "a0", "a1", "b0", "b1", "a2", "a3", "b2", "b3"]
    assert {name: len(t) for name, t in times.items()} == {"a": 4, "b": 4}


def test_the_pages_have_a_place_for_the_tables(tmp_path):
    """Each page is written between its marks, and a page without them is refused."""
    rows = {"answers": [Row("held", {"talos": 2.91, "g1": 3.0}, "x", (4.0, 3.0)), Row("alone", {"": 0.5}, "s")]}
    accuracy = {"talos": {"ours": (1e-3, 1e-9), "theirs": (1.0, None)}}
    few = Row(bench_pages.FEW[0], {"talos": 2.91}, "x", (4.0, 3.0))
    for name, place in (("README.md", "speed"), ("docs/reference/speed.md", "speed"), ("docs/design/speed.md", "profile")):
        text = (TOP / name).read_text(encoding="utf-8")
        page = tmp_path / f"{place}.md"
        page.write_text(text, encoding="utf-8")
        if name == "README.md":
            new = bench_pages.readme(page, {"answers": [*rows["answers"], few]})
            assert new.splitlines()[2:] == [f"| {few.what} | 2.91 | x |"]
        elif place == "speed":
            new = bench_pages.reference(page, rows, accuracy)
            assert "| held | 2.91 | 3.00 | | x | 4 | 3 |" in new and "| alone | | | 0.50 | s | | |" in new
        else:
            new = bench_pages.design(page, {"a call": {"held": (1e-5, {"State": 0.25, "record": 0.75})}})
            assert "| record | 7.5 | 75 |" in new and "| all | 10.0 | 100 |" in new
        assert ("| ours | 1e-03 J | 1e-09 m |" in new) == (name == "docs/reference/speed.md")
        begin, end = text.index(f"<!-- {place}"), text.index(f"<!-- end of {place}")
        assert page.read_text(encoding="utf-8").startswith(text[:begin]) and text[end:] in page.read_text(encoding="utf-8")
        assert new in page.read_text(encoding="utf-8")
    page.write_text("nothing", encoding="utf-8")
    with pytest.raises(ValueError, match="no place"):
        bench_pages.design(page, {})


def test_the_readme_has_rows_of_the_page():
    """Every row of the README's table stands in the first table of docs/reference/speed.md, with the same numbers."""

    def rows(name: str) -> set[tuple[str, ...]]:
        text = (TOP / name).read_text(encoding="utf-8")
        table = text.split("<!-- speed: made by tests/bench.py -->")[1].split("\n\n")[0].split("<!-- end")[0]
        cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.strip().splitlines()[2:]]
        return {tuple(cell for cell in row if cell) for row in cells}

    few, all_ = rows("README.md"), rows("docs/reference/speed.md")
    assert {row[0] for row in few} == set(bench_pages.FEW)
    for row in few:
        assert any(row == other[: len(row)] for other in all_), row


def test_parts_of_a_profile_add_up(talos):
    """States alone are the part of states; shares add up to one; Pinocchio's functions are what they were."""
    import pinocchio as pin

    before = pin.crba
    q = talos.standing().q
    parts = by_part([lambda: [rbd.State(talos, q) for _ in range(200)]] * 3)
    assert sum(parts.values()) == pytest.approx(1.0) and parts["State"] == max(parts.values())
    assert pin.crba is before


def test_the_versions_of_what_is_measured_are_told():
    """Python, Pinocchio, NumPy, and what is not installed says so."""
    told = versions()
    assert told["python"] == ".".join(map(str, sys.version_info[:3])) and told["numpy"] == np.__version__
    assert {"pin", "scipy", "proxsuite", "numba", "mujoco", "BLAS", "processor"} <= set(told)
    assert time.get_clock_info("thread_time").resolution <= 1e-6  # else single calls cannot be told apart
