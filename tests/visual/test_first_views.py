"""From where a page looks first: before the plane of a mechanism, and not through stairs."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import rbd
from rbd.cli.mechanism_report import report_mechanism
from rbd.visual import Scene
from rbd.visual.robot_layers import FRONT_LEFT, normal_of

URDF = Path(__file__).parents[2] / "urdf"
STAIRS = rbd.Terrain.stairs(rise=0.15, depth=0.3, n=8)


def view_of(page: str) -> dict[str, object]:
    """The camera's data of a page that is written, the last of them."""
    return json.loads(re.findall(r'stage\.note\((\{"view".*\})\);', page)[-1])["view"]


def right_of(direction: object) -> np.ndarray:
    """What is to the right on the page, in W, of length 1."""
    right = np.cross([0.0, 0.0, 1.0], np.array(direction, float))
    return right / np.linalg.norm(right)


@pytest.mark.parametrize("name", ["four_bar", "five_bar", "six_bar", "slider_crank", "built"])
def test_planar_mechanisms_are_seen_as_in_figures(name: str) -> None:
    """With W's x to the right and z up, as in plots of traces: a crank is on the left. None stands on a ground."""
    robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0) if name == "built" else rbd.load_robot(name)
    with Scene(robot) as scene:
        scene.show(robot.at(next(iter(robot.postures))))
        view = view_of(scene.page())
    assert right_of(view["direction"])[0] > 0.98 and view["front"] == [0.0, -1.0] and view["cell"] == 0.0


def test_the_side_from_which_a_plane_is_seen_does_not_hang_on_the_signs_of_axes(tmp_path: Path) -> None:
    """With all axes turned round the picture is the same; a robot in space, and one on wheels, have no such plane."""
    text = (URDF / "four_bar.urdf").read_text(encoding="utf-8")
    (tmp_path / "turned.urdf").write_text(text.replace('<axis xyz="0 -1 0"/>', '<axis xyz="0 1 0"/>'), encoding="utf-8")
    (tmp_path / "turned.loops.yaml").write_text((URDF / "four_bar.loops.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    turned, given = rbd.load_robot(tmp_path / "turned.urdf"), rbd.load_robot("four_bar")
    assert turned.model.nv == given.model.nv and text.count('<axis xyz="0 -1 0"/>') == turned.model.nv
    for robot in (turned, given):
        normal = normal_of(robot, robot.at().q)
        assert normal is not None
        np.testing.assert_allclose(normal, [0.0, -1.0, 0.0], atol=1e-12)
    for robot in (rbd.load_robot("unicycle"), rbd.load_robot("box"), rbd.load_robot("ur5")):
        assert normal_of(robot, robot.at().q) is None


def test_the_centre_of_mass_of_one_branch_is_told_apart() -> None:
    """The legend names the branch to which it belongs; of a single pose there is no need."""
    robot = rbd.load_robot("four_bar")
    report = report_mechanism(robot, robot.at("assembled").q, tries=40)

    def names(page: str) -> list[str]:
        return [
            each["name"] for each in json.loads(re.findall(r'stage\.note\((\{"legend".*\})\);', page)[-1])["legend"]["entries"]
        ]

    with Scene(robot) as scene:
        scene.show(report.state)
        assert "centre of mass, drop line" in names(scene.page())
        scene.beside(report.poses(), shown=report.shown)
        assert report.shown and f"centre of mass of {report.shown}, drop line" in names(scene.page())
        scene.beside({"crossed": robot.at("crossed")})
        assert "centre of mass of the first pose, drop line" in names(scene.page())


def hidden(direction: object, points: np.ndarray) -> int:
    """How many points are behind or inside of the stairs, for a camera at 3 m."""
    way = np.array(direction, float) / np.linalg.norm(np.array(direction, float))
    along = points[:, None] + np.linspace(0.05, 3.0, 40)[:, None] * way
    return int((STAIRS.distances(along.reshape(-1, 3)).reshape(len(points), -1) < -1e-3).any(axis=1).sum())


def test_stairs_do_not_hide_what_is_on_them(tmp_path: Path) -> None:
    """Of a box on the third tread the front left is hidden by those ahead; pages of it look past them."""
    box = rbd.load_robot("box")
    corners = np.array([[x, y, z] for x in (0.45, 0.85) for y in (-0.2, 0.2) for z in (0.5, 0.65)])
    face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.1), friction=0.6, on=STAIRS)
    state = rbd.State(box, [0.65, 0.0, 0.45, 0, 0, 0, 1])
    moved = rbd.simulate(state, [face], duration=0.02, step=5e-3, progress=False)
    with Scene(box) as scene:
        scene.show(state, rbd.solve(state, [], [face]))
        seen = view_of(scene.page())["direction"]
        scene.show(rbd.State(box, [-1.5, 0.0, 0.0, 0, 0, 0, 1]))
        assert view_of(scene.page())["direction"] == list(FRONT_LEFT)  # no terrain in the picture
    page = moved.export(tmp_path / "moved.html").read_text(encoding="utf-8")
    assert hidden(FRONT_LEFT, corners) >= 4
    assert hidden(seen, corners) == 0 and hidden(view_of(page)["direction"], corners) == 0
    with Scene(box, seen_from=(1.0, 0.0, 0.2)) as scene:
        scene.show(state, rbd.solve(state, [], [face]))
        assert view_of(scene.page())["direction"] == [1.0, 0.0, 0.2]  # what is asked for is done
