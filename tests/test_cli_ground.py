"""The option --ground of `rbd stand`, `region`, `simulate` and `check`, and `ground=` of `rbd.find_pose`."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from typer.testing import CliRunner

import rbd
from rbd.cli.app import app
from rbd.cli.ground_option import AHEAD, ground_of
from rbd.robots.posture import corner_points

runner = CliRunner()
WORLD = """<robot name="w"><link name="floor"><collision><origin xyz="0 0 -0.5"/><geometry><box size="4 4 1"/></geometry>
</collision></link></robot>"""


def run(*arguments: str | Path) -> tuple[int, str, str]:
    """(exit code, what is printed, what is complained)."""
    answer = runner.invoke(app, [*map(str, arguments)])
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer.exit_code, answer.stdout, answer.stderr


def test_words_and_files(tmp_path: Path) -> None:
    """A height; stairs as of `Terrain.stairs`, ahead of the origin; a slope that rises along x; the shapes of a file."""
    assert ground_of("0.25") == 0.25
    stairs, own = ground_of("stairs:0.1,0.3,5"), rbd.Terrain.stairs(0.1, 0.3, 5, start=(AHEAD, 0, 0))
    points = np.column_stack([np.linspace(-1.0, 3.0, 50), np.zeros(50), np.ones(50)])
    np.testing.assert_array_equal(stairs.heights_of(points), own.heights_of(points))
    assert float(ground_of("stairs:-0.1,0.3,2,0.2").ground_at(0.6, 0.0).point[2]) == pytest.approx(-0.2)
    slope = ground_of("slope:8")
    np.testing.assert_allclose(slope.heights_of(points), 1.0 - np.tan(np.deg2rad(8.0)) * points[:, 0], atol=1e-12)
    (tmp_path / "w.urdf").write_text(WORLD)
    assert float(ground_of(str(tmp_path / "w.urdf")).ground_at(1.0, 1.0).point[2]) == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("stiars:0.1,0.3,5", "nearest: 'stairs'"),
        ("hills", "expected a height in metres, stairs:"),
        ("stairs", "expected stairs:RISE,DEPTH,STEPS"),
        ("stairs:0.1,0.3", "e.g. stairs:0.1,0.3,5"),
        ("stairs:0.1,0.3,2.5", "e.g. stairs:0.1,0.3,5"),
        ("stairs:0.1,nan,2", "e.g. stairs:0.1,0.3,5"),
        ("stairs:0.1,-0.3,2", "depth of stairs"),
        ("slope:steep", "e.g. slope:8"),
        ("slope:nan", "e.g. slope:8"),
        ("slope:95", "less than 80"),
        ("nan", "a height in metres"),
        ("none.urdf", "none.urdf"),
        ("none.stl", "there is no file"),
    ],
)
def test_what_is_refused(text: str, says: str) -> None:
    """Exit code 2, with what was expected and the nearest word."""
    code, _, err = run("stand", "solo12", "--ground", text)
    assert code == 2 and says in err.replace("\n", " ")


def test_stand_and_region_on_a_slope(tmp_path: Path) -> None:
    """The feet are on the slope, the centre of mass is where it is over level ground, friction carries tan 8 degrees."""
    code, out, err = run("stand", "talos", "--ground", "slope:8", "--json", tmp_path / "x.json")
    assert code == 0 and not err and "talos stands" in out
    forces = json.loads((tmp_path / "x.json").read_text())["contacts"]
    assert len(forces) == 2 and "slope" not in err
    talos, slope = rbd.load_robot("talos"), ground_of("slope:8")
    state = rbd.find_pose(talos, ground=slope, com=talos.standing().com[:2]).state
    assert np.abs(slope.distances(corner_points(state, talos.soles()))).max() < 1e-9
    held = rbd.hold(state, talos.soles(on=slope))
    total = np.sum([f[:3] for f in held.forces.values()], axis=0)
    np.testing.assert_allclose(total, [0.0, 0.0, talos.mass * 9.81], atol=1e-6)
    for contact in held.contacts.values():
        assert contact.tangential / contact.normal == pytest.approx(np.tan(np.deg2rad(8.0)), abs=0.05)
    code, out, _ = run("region", "talos", "--ground", "slope:8")
    assert code == 0 and "it can stand" in out


def test_feet_on_two_treads() -> None:
    """One foot on the floor, one on the first step: each on its own tread, the pose balanced between them."""
    talos, stairs = rbd.load_robot("talos"), rbd.Terrain.stairs(0.1, 0.3, 3, start=(0.12, 0, 0))
    places = {"left_sole": (0.25, 0.085, 0.1), "right_sole": None}
    state = rbd.find_pose(talos, places, ground=stairs, com=(0.1, 0.0)).state
    assert np.abs(stairs.heights_of(corner_points(state, talos.soles()))).max() < 1e-9
    rbd.hold(state, talos.soles(on=stairs))
    with pytest.raises(rbd.InputError, match="no terrain at x"):
        rbd.find_pose(talos, ground=rbd.Terrain.boxes([(3, 3, -1), (4, 4, 0)]))


def test_standing_on_ground() -> None:
    """The base alone is moved: onto a height, and tilted onto a slope, joints as in the posture."""
    solo, slope = rbd.load_robot("solo12"), ground_of("slope:8")
    level = solo.standing()
    np.testing.assert_allclose(solo.standing(ground=0.3).q, level.q + 0.3 * np.eye(solo.nq)[2], atol=1e-9)
    state = solo.standing(ground=slope)
    np.testing.assert_allclose(state.q[7:], level.q[7:], atol=1e-12)
    assert np.abs(slope.distances(corner_points(state, solo.feet()))).max() < 1e-9
    with pytest.raises(rbd.InputError, match="no terrain at x"):
        solo.standing(ground=rbd.Terrain.boxes([(3, 3, -1), (4, 4, 0)]))


def test_simulate_on_terrain(tmp_path: Path) -> None:
    """A robot on a slope stays; a box laid on a step rests there; a robot that touches nothing has no use of ground."""
    code, out, err = run("simulate", "solo12", "--duration", "0.05", "--ground", "slope:5", "--save", tmp_path / "x.npz")
    assert code == 0 and "at rest" in out and not err
    (terrain,) = rbd.Trajectory.load(tmp_path / "x.npz").terrains
    assert terrain.names == ("slope",)
    box = str(Path(__file__).parents[1] / "urdf" / "box.urdf")
    code, out, _ = run(
        "simulate", box, "--bodies", "--duration", "0.05", "--ground", "stairs:0.1,0.6,2,-0.3", "--save", tmp_path / "b.npz"
    )
    on_step, on_floor = rbd.Trajectory.load(tmp_path / "b.npz"), run(
        "simulate", box, "--bodies", "--duration", "0.05", "--save", tmp_path / "f.npz"
    )
    assert code == 0 == on_floor[0]
    lower = rbd.Trajectory.load(tmp_path / "f.npz").q[-1, 2]
    assert on_step.q[-1, 2] == pytest.approx(lower + 0.1, abs=1e-9)
    code, _, err = run("simulate", "ur5", "--ground", "slope:5")
    assert code == 2 and "--ground is of no use" in err


def test_check_on_terrain(tmp_path: Path) -> None:
    """A robot on the first step: possible on those stairs, in the ground on others."""
    g1 = rbd.load_robot("g1")
    state = g1.standing()
    q = np.tile(pin.integrate(g1.model, state.q, np.r_[0.0, 0.0, 0.1, np.zeros(g1.nv - 3)]), (30, 1))
    np.savetxt(tmp_path / "stands.csv", q, delimiter=",", fmt="%.6f")
    given = ("check", tmp_path / "stands.csv", "--robot", "g1", "--rate", "30", "--no-self-collision", "--ground")
    assert run(*given, "stairs:0.1,0.8,1,-0.4")[0] == 0
    code, out, _ = run(*given, "stairs:0.1,0.8,1,2")
    assert code == 1 and "floats" in out
    assert run(*given, "stares:0.1")[0] == 2


def test_a_sweep_has_no_ground() -> None:
    code, _, err = run("stand", "talos", "--sweep", "friction=0.5,0.7", "--ground", "slope:8")
    assert code == 2 and "--ground is of one case" in err
