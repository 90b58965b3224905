"""A robot with its forces, in three dimensions: live in a browser, or as one page in a file."""

from __future__ import annotations

import json
import webbrowser
from collections.abc import Collection, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, cast

import numpy as np

from rbd.arrays import Array, check_flag, check_positive
from rbd.constraints.terrain.terrain import Terrain
from rbd.displayed import Displayed
from rbd.errors import InputError, PictureError
from rbd.model.checked_model import CheckedModel
from rbd.model.external import External
from rbd.model.state import State
from rbd.records import fixed, vector
from rbd.visual.drawn_robot import Details, DrawnRobot, OtherPoses, check_poses
from rbd.visual.marks.mark import Mark, Sizes
from rbd.visual.marks.picture import Picture, legend_data
from rbd.visual.marks.regions import Drawn, left_out_of, marks_of
from rbd.visual.marks.shown_force import ShownForce
from rbd.visual.marks.surfaces import ShownSurface, surface_marks
from rbd.visual.marks.terrain import ShownTerrain, terrain_marks
from rbd.visual.packed_meshes import described, send_mark, send_part
from rbd.visual.pages.browser import Browser, Closing
from rbd.visual.pages.link import checked_layers, checked_view
from rbd.visual.pages.page import offline_page, photograph, write_page
from rbd.visual.pages.recorder import Recorder, ViewerNode, drawn_together
from rbd.visual.robot_layers import a_direction, camera_and_ground, facing, frames, front_of, normal_of, seen_from, unhidden
from rbd.visual.robot_meshes import RobotPart, missing_note, robot_parts
from rbd.visual.style import a_page, a_picture, contact_colors
from rbd.visual.verified_frames import verified

if TYPE_CHECKING:
    from rbd.answers.solution import Solution
    from rbd.robots.robot import Robot
    from rbd.statics.actuation import Actuation
    from rbd.visual.pages.server import LiveServer


class Scene(Displayed, Closing):
    """A picture of a robot in contact: meshes, forces, friction cones, support polygon, centre of mass.

    Every arrow starts where its force acts and points along the force on the robot; its length is the force times one
    scale for the whole scene, stated in the legend. A sole's big arrow is the resultant at the centre of pressure, its
    thin ones are the corner forces; an arrow that leaves its translucent cone slips. Between two bodies, the thin pale
    opposite arrow is the force on the second; so it is of a loop. Moments and the torques of stops, brakes and gears are bent
    arrows about their axes. Motor torques are arcs too, whose length and colour tell the share of the limit: layer "joint
    torques", off at first. Walls, slopes and moving ground that contacts touch are drawn as pieces of their planes, terrain as
    solids with the shadows on it, in place of the level ground. Marks
    shine faintly through the robot. The legend tells in words what is left out.

    Args:
        robot: Whose meshes to draw; without visual shapes a skeleton with inertia ellipsoids and collision shapes.
        arrow_per_weight: Length of an arrow as large as the robot's weight [m]. By default 1 m for a human's size,
            and about half the robot's size otherwise.
        ground: Whether to draw the ground z = 0 as a grid.
        seen_from: Direction from the robot to the camera at first, in W, shape (3,). By default from the front left: the
            front is where the x axes of the soles shown point (iCub looks along -x), or W's x; turned about the vertical where
            terrain hides the robot. Mechanisms with loops in a vertical plane are seen from before it, with x to the right.
        legend: Whether to write names, forces and the scale next to the picture.
        layers: {layer: whether it is shown at first}, where that is to differ from `rbd.visual.pages.link.LAYERS`; the page can
            change it.
        view: Where the camera stands at first: "start", which is `seen_from`, "front", "side" or "top"; the page can change it.

    Example:
        >>> robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        >>> with rbd.visual.Scene(robot) as scene:
        ...     scene.show(robot.at("assembled"))
        ...     print(scene.export("four_bar.html").name)
        four_bar.html
    """

    def __init__(
        self,
        robot: Robot,
        *,
        arrow_per_weight: float | None = None,
        ground: bool = True,
        seen_from: Sequence[float] | Array | None = None,
        legend: bool = True,
        layers: Mapping[str, bool] | None = None,
        view: str = "start",
    ) -> None:
        if not isinstance(robot, CheckedModel):
            raise InputError(f"Scene wants a robot, got {robot!r:.80}. Load one with rbd.load_robot(name).")
        if arrow_per_weight is not None:
            arrow_per_weight = check_positive("arrow_per_weight", arrow_per_weight, 1e100)
        self._seen_from = a_direction(seen_from)
        self._legend = legend
        self._layers = checked_layers(layers)
        self._opens = checked_view(view)
        self.robot = robot
        """The robot whose scene it is."""
        self._arrow_per_weight = arrow_per_weight
        self._ground = ground
        self.recorder = Recorder()
        """The messages of the scene, to its pages and from them."""
        self._viewer = ViewerNode(self.recorder)
        self._body = DrawnRobot(robot, self._viewer, self.recorder)
        self._sizes: Sizes | None = None
        self._seen: list[str] = []
        self._marks: list[Mark] = []
        self._around_marks: list[Mark] = []
        self._picture = Picture(np.zeros(3))
        self._given: tuple[State, Solution | Actuation | None]
        self._server: LiveServer | None = None
        self._around = np.zeros((0, 3))
        self._moving = False
        self._staged_from: Sequence[float] = ()
        self._statics: tuple[Drawn, ...] = ()
        self._terrains: tuple[ShownTerrain, ...] = ()
        self._planes: tuple[ShownSurface, ...] = ()
        self._scenery: list[Mark] = []
        self._level = True
        self.title = robot.name
        """Of its page: the robot's name, or the headline of a motion."""

    def __repr__(self) -> str:
        return f"Scene({str(self).partition(chr(10))[0]})"

    def __str__(self) -> str:
        if not self.shown:
            return f"{self.robot.name}: the scene is empty; call scene.show(state, solution) first"
        forces = [f"  {c.name}: {vector(c.force, 2)} N" for c in self.contacts]
        upward = fixed(sum(float(c.force[2]) for c in self.contacts), 2)
        said = f"its contacts push it up by {upward} N" if forces else "no contact forces are shown"
        return "\n".join([f"{self.robot.name}: {said}", *forces])

    @property
    def shown(self) -> bool:
        """Whether a state has been shown."""
        return self._sizes is not None

    @property
    def contacts(self) -> tuple[ShownForce, ...]:
        """The contact forces now in the picture."""
        return self._picture.contacts

    @property
    def drawn(self) -> tuple[Mark, ...]:
        """The marks now in the picture: arrows, cones, patches, polygon, centre of mass and terrain, by their points in W."""
        return (*self._scenery, *self._marks, *self._around_marks)

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the picture does not show, or not in full, in words; the legend has them too."""
        return (*self._picture.left_out(self.sizes), *left_out_of(self._statics, self.sizes))

    @property
    def metres_per_newton(self) -> float:
        """Length of an arrow over its force [m/N]; constant from the first `show` on."""
        return self.sizes.metres_per_newton

    @property
    def sizes(self) -> Sizes:
        """Sizes of the marks; constant from the first `show` on.

        Raises:
            PictureError: nothing has been shown yet.
        """
        if self._sizes is None:
            raise PictureError("the scene is empty: call scene.show(state, solution) first.")
        return self._sizes

    @property
    def url(self) -> str:
        """Address of the live scene; starts its server, which listens on 127.0.0.1 only."""
        if self._server is None:
            from rbd.visual.pages.server import LiveServer

            self._server = LiveServer(self.recorder, self.robot.name)
        return self._server.url

    def open(self) -> str:
        """Open the live scene in the default browser; returns its address. What `show` draws later appears there at once."""
        webbrowser.open(self.url, new=2)
        return self.url

    @drawn_together
    def show(
        self,
        state: State,
        solution: Solution | Actuation | None = None,
        *,
        external: External = None,
        without: Collection[str] = (),
    ) -> None:
        """Draw the robot in this state with the forces of this solution, in place of what was shown.

        Args:
            state: Where the robot is. Velocities are not drawn.
            solution: Its forces, from `solve` or `hold`; None draws the robot and its centre of mass only.
            external: What was given to `solve`: each `ExternalForce` is drawn from the point it acts on, springs and other
                force elements where they are. A generalised force has no such point: `left_out` and the legend tell it.
                Without it the force elements are those of the solution.
            without: Layers whose marks are not made, which saves time: "joint torques" takes half of it.

        Raises:
            InputError: if the state is of a robot with other joints, or `external` is not what `solve` takes.
        """
        model = self.robot.model
        if not isinstance(state, State):
            raise InputError(f"show wants a State first, got {state!r:.80}. Make one: rbd.State(robot, q).")
        if solution is not None and not hasattr(solution, "corner_forces"):
            raise InputError(f"solution is {solution!r:.80}; expected what rbd.solve or rbd.hold returned, or None.")
        if len(state.q) != model.nq:
            raise InputError(
                f"the state has {len(state.q)} coordinates, {self.robot.name!r} has {model.nq}; "
                "show a state of the robot that the scene was made for."
            )
        reframed = self._sizes is None or self._moving
        if self._moving:
            self.recorder.post("motion", json.dumps({"motion": None}))
            self._around, self._moving, self._staged_from = np.zeros((0, 3)), False, ()
        self._body.place(np.asarray(state.q, float), again=reframed)
        self._picture, self._given = Picture.of(state, solution, external), (state, solution)
        if self._sizes is None:
            moment = self._picture.largest_moment
            self._sizes = Sizes.of(self.robot, self._body.cloud, self._arrow_per_weight, moment)
        self._seen += [name for name in self._picture.colored if name not in self._seen]
        self._marks = self._picture.marks(contact_colors(self._seen), self._sizes, without)
        self._around_marks = marks_of(self._statics, self._sizes)
        self._send_marks()
        if reframed:
            self.recorder.post("view", self._view())

    @drawn_together
    def draw(self, *statics: Drawn) -> None:
        """Draw regions, largest pushes, wrench cones and footprints around the robot shown, until the next `draw`.

        Raises:
            InputError: of something else.
            PictureError: if nothing has been shown yet.
        """
        self._around_marks, self._statics = marks_of(statics, self.sizes), statics
        self._send_marks()

    @drawn_together
    def stand_on(self, *grounds: Terrain | ShownTerrain | ShownSurface) -> None:
        """Draw terrains around the robot, until the next call; those that contacts of a solution are on are drawn anyway.

        Pages of motions draw pieces of planes so too, `rbd.visual.marks.surfaces.ShownSurface`.

        Raises:
            InputError: of something else.
            PictureError: if nothing has been shown yet.
        """
        _ = self.sizes  # refuses an empty scene
        for one in grounds:
            if not isinstance(one, Terrain | ShownTerrain | ShownSurface):
                raise InputError(f"{one!r:.80} is no terrain; expected rbd.Terrain.")
        self._planes = tuple(one for one in grounds if isinstance(one, ShownSurface))
        terrains = [one for one in grounds if not isinstance(one, ShownSurface)]
        self._terrains = tuple(t if isinstance(t, ShownTerrain) else ShownTerrain.about(t, self._body.cloud) for t in terrains)
        self._send_marks()
        self.recorder.post("view", self._view())

    @drawn_together
    def beside(self, states: Mapping[str, State], *, shown: str = "", details: Details = None, note: str = "") -> None:
        """Draw the robot in further poses at the same place, each in one colour, until the next call: branches, for example.

        They stay until the next call; `{}` takes them away. The legend names them. Bars that have one place in several poses
        are striped in the colours of all these. Without `shown` the robot keeps its colours, and the poses are translucent.

        Args:
            states: {name: where the robot is}, of the scene's robot.
            shown: Name of the pose that `show` drew: it gets one colour too, and its place in the legend among `states`, if it
                is one of these.
            details: {name: lines below the name in the legend}, such as joint angles.
            note: A line below the legend.

        Raises:
            InputError: if an entry is not a state, or has another size.
            PictureError: if nothing has been shown yet.
        """
        _ = self.sizes  # refuses an empty scene
        check_poses(self.robot, states, shown)
        self._body.draw_poses(OtherPoses(states, shown, details or {}, note))
        self._write_legend()

    def export(self, path: str | PathLike[str], *, verify: bool = False) -> Path:
        """Write the scene as one HTML file that needs no network and no server; returns its path.

        The camera is placed so that robot and arrows fill the view; it can be turned in the browser.

        Args:
            path: Of the page, ends in .html.
            verify: Whether the page has a button "verify": it carries M, J, h, tau, a, f and the sets of forces, computes the
                residuals anew in the browser, compares them with those of the solution, and shows which contacts leave their
                cones if friction is less. Some 5 to 10 kB more.

        Raises:
            InputError: verify=True without a solution of `rbd.solve` in the scene.
            PictureError: if nothing has been shown, or the file cannot be written.
        """
        target = a_page(path)
        check_flag("verify of export", verify)
        write_page(target, self.page(self._verified() if verify else ""))
        return target

    def _verified(self) -> str:
        """What the verifier on the page needs."""
        state, solution = self._given
        if not hasattr(solution, "residuals") or not hasattr(solution, "law"):
            raise InputError("verify=True needs an answer of rbd.solve in the scene: scene.show(state, solution) first.")
        return verified([(None, state, cast("Solution", solution))])

    def screenshot(
        self, path: str | PathLike[str], *, width: int = 1280, height: int = 960, browser: Browser | None = None
    ) -> Path:
        """Draw the scene in headless Chromium and write it as a PNG; returns the picture's path.

        Args:
            path: Of the picture.
            width: Pixels across.
            height: Pixels down.
            browser: An open browser, for many pictures; by default one is started for this picture.

        Raises:
            InputError: if the size is no number of pixels.
            PictureError: nothing has been shown, no browser, or the file cannot be written.
        """
        return photograph(self.page(), a_picture(path), width, height, browser)

    def page(self, verify: str = "") -> str:
        """The page that `export` writes, as text; with answers to be verified, of `rbd.visual.verified_frames`."""
        # A live viewer keeps its camera while the robot moves; a page is framed for its contents.
        return offline_page(self.title, [*self.recorder.messages()[0], self._view(), *([verify] if verify else [])])

    def stage_motion(
        self,
        motion: str,
        around: Array,
        further: Mapping[str, Sequence[RobotPart]] | None = None,
        *,
        title: str | None = None,
        seen_from: Sequence[float] = (),
    ) -> None:
        """Send the page the data to move the robot by itself, in place of the marks, until the next `show`.

        Args:
            motion: JSON, as `MotionPage` writes it.
            around: Points in W that the camera is to see, shape (n, 3) [m].
            further: {path in the viewer: pieces of another robot, which the motion moves too}.
            title: Of the page.
            seen_from: Direction from the robot to the camera at first, in W; by default that of the scene.
        """
        _ = self.sizes  # refuses an empty scene
        self.title = title or self.robot.name
        for path, parts in (further or {}).items():
            for i, part in enumerate(parts):
                send_part(self._viewer, f"{path}/{i}", part)
        self._marks, self._around_marks, self._around, self._moving = [], [], around, True
        self._staged_from = seen_from
        self._send_marks()
        self.recorder.post("motion", motion)
        self.recorder.post("view", self._view())

    def pause_motion(self) -> None:
        """Stop the motion from `stage_motion` where its page shows it."""
        self.recorder.post("paused", json.dumps({"paused": True}))

    def wait_for_viewer(self, seconds: float) -> bool:
        """Wait until a browser shows the live scene; whether one does."""
        _ = self.url
        return self._server is not None and self._server.wait_for_viewer(seconds)

    def close(self) -> None:
        """Stop the live server, if one runs. The scene can still be exported."""
        if self._server is not None:
            self._server.close()
            self._server = None

    def _send_marks(self) -> None:
        """Send the marks, the frames, the layers, and the layer and label of every mark; and the legend."""
        self._viewer["marks"].delete()
        shown = self._shown_terrains()
        self._scenery = [mark for i, one in enumerate(shown) for mark in terrain_marks(i, one, self.sizes) if len(mark.points)]
        self._level = not self._scenery
        beyond = len(self._picture.surfaces)
        self._scenery += [mark for i, one in enumerate(self._planes, beyond) for mark in surface_marks(i, one, self.sizes)]
        for mark in self.drawn:
            send_mark(self._viewer, mark)
        self.recorder.post("frames", frames(self.robot, self._body.data, self._picture.contacts, self.sizes.body))
        self.recorder.post("marks", described(self.drawn, self._layers))
        self._write_legend()

    def _shown_terrains(self) -> list[ShownTerrain]:
        """Those that are asked for, and those that the contacts are on."""
        known = {id(one.terrain) for one in self._terrains}
        further = [t for t in self._picture.terrains if id(t) not in known]
        return [*self._terrains, *(ShownTerrain.about(t, self._body.cloud) for t in further)]

    def _write_legend(self) -> None:
        if not self._legend:
            return
        colors, poses = contact_colors(self._seen), self._body.poses
        note = " ".join(filter(None, [missing_note(robot_parts(self.robot)), poses.note]))
        of = poses.shown or ("the first pose" if poses else "")
        words = poses.entries(), note, self._shown_terrains(), of
        what = legend_data(self.robot.name, self._picture, colors, self.sizes, self._statics, *words)
        self.recorder.post("legend", json.dumps({"legend": what}))

    def _view(self) -> str:
        """Camera, light and ground for the present scene, in the page's format."""
        size = self.sizes.body  # refuses an empty scene
        drawn = [mark.points for mark in (*self._marks, *self._around_marks) if self._layers[mark.layer]]
        body, normal = self._body, normal_of(self.robot, self._given[0].q)
        clouds, level = [body.cloud, body.further, self._around, *drawn], self._ground and self._level
        if normal is None:
            front = front_of(self.robot, body.data, self._picture.contacts)
        else:  # bars that pass below z = 0 stand on no ground
            front = np.round(normal[:2] / np.linalg.norm(normal[:2]), 4).tolist()
            level &= bool(min(c[:, 2].min(initial=0.0) for c in clouds[:3]) > -1e-3 * size)
        direction = self._staged_from or self.direction([shown.terrain for shown in self._shown_terrains()], body.cloud)
        return camera_and_ground(clouds, direction, front, opens=self._opens, body=size, ground=level)

    def direction(self, terrains: Sequence[Terrain] = (), points: Array | None = None) -> list[float]:
        """From the robot to the camera at first, in W.

        Args:
            terrains: Are not to hide the robot.
            points: Where the robot is, in W, shape (n, 3) [m]; by default where it is shown.
        """
        if self._seen_from is not None:
            return self._seen_from
        if (normal := normal_of(self.robot, self._given[0].q)) is not None:
            return facing(normal)
        return unhidden(seen_from(self._picture.contacts), terrains, self._body.cloud if points is None else points)
