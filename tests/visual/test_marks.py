"""Marks of forces: what their geometry and their labels say, read back as numbers."""

from __future__ import annotations

import json

import numpy as np
import pinocchio as pin
import pytest

import rbd
from rbd.visual import Scene
from rbd.visual.marks.contacts import not_supporting, shown_forces
from rbd.visual.marks.mark import FULL_TURN, SMALLEST_ARC, Sizes, share_color
from rbd.visual.marks.other_constraints import BAR, motor_torques
from rbd.visual.marks.picture import Picture
from rbd.visual.marks.surfaces import surface_marks
from rbd.visual.pages.link import LAYERS
from rbd.visual.playback.animation import shown_motion
from rbd.visual.playback.motion_frames import frames_of
from rbd.visual.shapes import axes_along

PUSH = rbd.ExternalForce("torso_2_link", [0.0, 60.0, 0.0], moment=[0.0, 0.0, 12.0])


@pytest.fixture(scope="module")
def solo() -> rbd.Robot:
    """A quadruped on four points."""
    return rbd.load_robot("solo12")


@pytest.fixture(scope="module")
def pushed(talos) -> tuple[rbd.State, rbd.Actuation]:
    """Talos at rest on two soles, pushed sideways and turned."""
    state = talos.standing()
    return state, rbd.hold(state, talos.soles(friction=0.7), external=PUSH)


def shown(robot, state, solution=None, external=None, **given):
    """({path: mark}, scene) of a picture."""
    scene = Scene(robot, **given)
    scene.show(state, solution, external=external)
    return {mark.path: mark for mark in scene.drawn}, scene


def notes_and_entries(scene) -> tuple[list[str], dict[str, dict[str, str]]]:
    """The notes of the legend, and its entries by name."""
    message = next(m for m in scene.recorder.messages()[0] if isinstance(m, str) and m.startswith('{"legend"'))
    legend = json.loads(message)["legend"]
    return legend["notes"], {entry["name"]: entry for entry in legend["entries"]}


class TestLabels:
    """Every mark has a layer and a label; labels tell the solved numbers."""

    def test_every_mark_has_a_layer_and_a_label(self, talos, pushed):
        """The layers are those of the page's list, the first line of a tag is short."""
        marks, _ = shown(talos, *pushed, PUSH)
        assert {mark.layer for mark in marks.values()} <= set(LAYERS)
        assert {marks[f"contacts/left_sole/{part}"].layer for part in ("cone", "rim")} == {"cones"}
        assert marks["contacts/left_sole/corner_forces"].layer == "corner forces" and marks["pushes/0/force"].layer == "pushes"
        assert marks["support/area"].layer == "support polygon" and marks["com/ball"].layer == "centre of mass"
        for path, mark in marks.items():
            assert mark.label is not None and mark.label.title and mark.label.lines, path
            assert np.isfinite(mark.label.at).all() and (not mark.label.tag or len(mark.label.lines[0]) < 40)

    def test_a_label_tells_the_solved_numbers(self, talos, pushed):
        """|f|, the force on the robot, normal and tangential parts, friction used, centre of pressure."""
        state, held = pushed
        marks, _ = shown(talos, state, held, PUSH)
        force, contact = held.forces["left_sole"], held.contacts["left_sole"]
        lines = marks["contacts/left_sole/force"].label.lines
        assert lines[0] == f"|f| {np.linalg.norm(force[:3]):.4g} N"
        told = np.array([float(x) for x in lines[1].split("(")[1].split(")")[0].split(",")])
        assert lines[1].startswith("force on the robot") and np.abs(told - force[:3]).max() < 0.06
        assert lines[2] == f"normal {contact.normal:.4g} N, tangential {contact.tangential:.4g} N"
        assert lines[3] == f"friction used {100 * contact.friction_used:.1f} % of mu 0.7"
        assert lines[-1].startswith("centre of pressure (")
        assert "force on the robot (0, 60, 0) N" in marks["pushes/0/force"].label.lines

    def test_the_legend_tells_normal_force_and_size_apart(self, talos, pushed):
        """Both with their names; the push with its vector."""
        state, held = pushed
        _, scene = shown(talos, state, held, PUSH)
        _, entries = notes_and_entries(scene)
        contact = held.contacts["left_sole"]
        assert entries["left_sole"]["value"] == f"|f| {np.linalg.norm(contact.force):.4g} N"
        assert entries["left_sole"]["detail"].startswith(f"normal {contact.normal:.4g} N, friction ")
        assert entries["push on torso_2_link"]["detail"] == "(0, 60, 0) N, moment (0, 0, 12) N m"


class TestSupport:
    """The support polygon lies on the ground that carries."""

    def test_on_a_slope_it_lies_in_the_plane(self, talos):
        """On 10 degrees, without a plane told: all corners within 1e-9 m of it; the mark is parallel to it."""
        X = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.radians(10.0), 0.0), np.array([0.2, 0.0, 0.3]))
        q = talos.standing().q.copy()
        q[:7] = pin.SE3ToXYZQUAT(X * pin.XYZQUATToSE3(q[:7]))
        state = rbd.State(talos, q)
        solution = rbd.solve(state, np.zeros(talos.nu), talos.soles(friction=1.0, on=None))
        marks, scene = shown(talos, state, solution)
        n = X.rotation[:, 2]
        off = (scene._picture.outline - X.translation) @ n
        assert len(off) >= 4 and np.abs(off).max() < 1e-9
        drawn = (marks["support/area"].points - X.translation) @ n
        assert np.ptp(drawn) < 1e-9 and 0.0 < drawn[0] < 0.01

    def test_it_shines_through_the_feet(self, talos, pushed):
        """Area and edge are drawn through what hides them."""
        marks, _ = shown(talos, *pushed)
        assert marks["support/area"].seen_through and marks["support/outline"].seen_through


class TestMoments:
    """Arcs about the axis of a moment."""

    def test_the_angle_of_the_arc_is_the_moment(self, talos, pushed):
        """The tip is at that share of the full turn about the moment's axis, on the circle."""
        marks, scene = shown(talos, *pushed, PUSH)
        mark, sizes = marks["pushes/0/moment"], scene.sizes
        centre = pushed[0].frame(PUSH.frame, PUSH.offset).X_WF.translation
        expected = 12.0 / sizes.full_moment * FULL_TURN
        assert tip_angle(mark.points, centre, np.array([0.0, 0.0, 1.0]), sizes.arc) == pytest.approx(expected, abs=1e-9)
        assert mark.layer == "moments" and mark.label.lines[0] == "|m| 12 N m"


def tip_angle(vertices, centre, axis, radius) -> float:
    """The angle that an arc turns from its beginning to its tip [rad], in (-2 pi, 2 pi)."""
    local = (vertices - centre) @ axes_along(axis)
    on_circle = (np.abs(np.hypot(local[:, 0], local[:, 1]) - radius) < 1e-9) & (np.abs(local[:, 2]) < 1e-9)
    angles = np.arctan2(local[on_circle, 1], local[on_circle, 0]) % (2.0 * np.pi)
    return float(angles[-1])  # the tip of the head is the last point on the circle


def arrow_ends(mark) -> tuple[np.ndarray, np.ndarray]:
    """(start, tip) of an arrow's mark: its first vertices are the start, its last ones the tip."""
    return mark.points[0], mark.points[-1]


class TestLoops:
    """The force of a loop on one body, and its opposite on the other."""

    def test_the_four_bar_s_pin_pulls_both_bars_alike(self):
        """Both arrows start at the pin, and are equal and opposite: force times scale."""
        robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        state = robot.at("assembled")
        loops = robot.loops()
        solution = rbd.solve(state, np.zeros(robot.nu), loops)
        marks, scene = shown(robot, state, solution)
        name = loops[0].name
        force, pin_at = solution.forces[name][:3], state.frame(loops[0].frame_b).X_WF.translation
        assert np.linalg.norm(force) > 1.0
        for part, sign in (("force", 1.0), ("reaction", -1.0)):
            start, tip = arrow_ends(marks[f"loops/{name}/{part}"])
            assert start == pytest.approx(pin_at, abs=1e-12)
            assert tip - start == pytest.approx(sign * scene.metres_per_newton * force, abs=1e-12)
        assert marks[f"loops/{name}/force"].layer == "loop forces" and not scene.left_out
        assert f"on {loops[0].frame_b}" in notes_and_entries(scene)[1][name]["detail"]

    def test_a_weld_has_a_moment_too(self):
        """A box welded to the ground beside its weight: the moment is drawn at the second frame."""
        box = rbd.testing.box(mass=10.0)
        weld = rbd.LoopClosure("weld", "universe", "box", kind="rigid")
        state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
        load = rbd.ExternalForce("box", (0.0, 0.0, 0.0), moment=(0.0, 7.0, 0.0))
        solution = rbd.solve(state, [], [weld], external=load)
        loop = next(force for force in Picture.of(state, solution, load).forces if force.name == "weld")
        assert loop.on == "box" and loop.against == "" and loop.moment == pytest.approx([0.0, -7.0, 0.0], abs=1e-9)
        assert loop.force == pytest.approx([0.0, 0.0, 98.1])


class TestTorques:
    """Motor torques as shares of their limits."""

    def test_the_arc_s_angle_is_the_share_of_the_limit(self, talos, pushed):
        """Of every revolute joint with a limit, about its axis, with the torque's sign; the colour tells the share."""
        state, held = pushed
        marks, scene = shown(talos, state, held, PUSH)
        checked = 0
        for t, tau, limit in zip(motor_torques(state, held), held.tau, talos.effort_limit, strict=True):
            assert t.value == tau and t.limit == limit
            mark = marks.get(f"torques/{t.name}/torque")
            if t.slides or not np.isfinite(limit) or abs(tau) / limit * FULL_TURN < SMALLEST_ARC:
                continue
            expected = tau / limit * FULL_TURN % (2.0 * np.pi)
            assert tip_angle(mark.points, t.point, t.axis, scene.sizes.arc) == pytest.approx(expected, abs=1e-9)
            assert mark.color == share_color(abs(tau) / limit) and mark.layer == "joint torques"
            checked += 1
        assert checked > 5 and not LAYERS["joint torques"]

    def test_the_axis_is_the_joint_s(self, talos, pushed):
        """The power of a torque is torque times rate: the axis is that of the child body's turning."""
        state, held = pushed
        for t in motor_torques(state, held)[:8]:
            joint = talos.joints[t.name]
            v = np.zeros(talos.nv)
            v[joint.v] = 1.0
            J = state.frame(t.name).J
            assert (J @ v)[3:] == pytest.approx(t.axis, abs=1e-12)

    def test_of_a_solution_they_are_what_was_given(self, talos):
        """`rbd.solve` is given tau; the picture has it from the equations of motion, with a push in them too."""
        state, tau = talos.standing(), np.linspace(-0.9, 0.9, talos.nu)
        solution = rbd.solve(state, tau, talos.soles(), external=PUSH)
        assert [t.value for t in motor_torques(state, solution)] == pytest.approx(tau, abs=1e-9)

    def test_a_sliding_joint_has_a_bar(self, tmp_path):
        """A cart on a rail: a bar along the rail, of the share of the limit."""
        text = (
            '<robot name="cart"><link name="rail"/><link name="cart"><inertial><mass value="2"/>'
            '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="slide" type="prismatic">'
            '<parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>'
            '<limit lower="-1" upper="1" effort="20" velocity="1"/></joint></robot>'
        )

        (tmp_path / "cart.urdf").write_text(text)
        cart = rbd.load_robot(tmp_path / "cart.urdf", root="fixed")
        state = cart.at()
        marks, scene = shown(cart, state, rbd.solve(state, [-5.0], []))
        start, tip = arrow_ends(marks["torques/slide/torque"])
        assert tip - start == pytest.approx([-0.25 * BAR * scene.sizes.body, 0.0, 0.0], abs=1e-9)
        assert marks["torques/slide/torque"].label.lines[0] == "-5 N, 25 %"

    def test_a_stop_s_torque_is_drawn_at_its_joint(self):
        """A pendulum on its stop: m g / 2 about the joint, among the moments."""
        pendulum = rbd.planar.to_robot(rbd.planar.Chain(1, lengths=[1.0]), masses=[1.0])
        stop = rbd.JointLimit("stop", "joint_1", lower=0.0)
        state = pendulum.at([0.0])
        marks, scene = shown(pendulum, state, rbd.solve(state, [0.0], [stop]))
        (stopped,) = scene._picture.forces
        arc, axis = marks["joints/stop/joint_1/moment"], stopped.moment / stopped.size
        assert stopped.size == pytest.approx(4.905) and arc.layer == "moments"
        expected = 4.905 / scene.sizes.full_moment * FULL_TURN
        assert scene.sizes.full_moment == 5.0  # the first picture's largest moment, rounded up
        angle = tip_angle(arc.points, stopped.start, axis, scene.sizes.arc)
        assert angle == pytest.approx(expected % (2.0 * np.pi), abs=1e-9)


class TestSurfaces:
    """Planes that contacts touch."""

    def test_a_wall_behind_a_hand_contains_its_point(self, talos):
        """The wall is vertical, through the hand, and reaches beyond it; the floor is not drawn twice."""
        state = talos.standing()
        wall = rbd.Ground(normal=(0.0, -1.0, 0.0))
        hand = rbd.PointContact("hand", "gripper_left_base_link", on=wall, friction=0.5)
        marks, scene = shown(talos, state, rbd.hold(state, [*talos.soles(friction=0.7), hand]))
        assert [s.names for s in scene._picture.surfaces] == [("hand",)]
        area, at = marks["surfaces/0/area"].points, state.frame("gripper_left_base_link").X_WF.translation
        assert np.abs(area[:, 1] - at[1]).max() < scene.sizes.lift
        assert (area.min(axis=0)[[0, 2]] < at[[0, 2]]).all() and (area.max(axis=0)[[0, 2]] > at[[0, 2]]).all()
        assert marks["surfaces/0/area"].label.title == "wall" and marks["surfaces/0/area"].layer == "surfaces"
        assert "Not in the support polygon: hand (steeper than 45 degrees)." in scene.left_out

    def test_a_belt_has_arrows_of_its_velocity(self):
        """Though its plane is the floor's: it moves. The label has the number, the arrows its direction."""
        box = rbd.testing.box(mass=10.0)
        belt = rbd.Ground(velocity=(0.0, 0.5, 0.0))
        face = rbd.SurfaceContact("face", "box", half_lengths=(0.2, 0.2), friction=0.6, on=belt)
        state = rbd.State(box, [0, 0, 0, 0, 0, 0, 1])
        picture = Picture.of(state, rbd.solve(state, [], [face], solver=rbd.ConeSolver()), None)
        surface = picture.surfaces[0]
        assert surface.moves and surface.title == "moving ground" and surface.lines[0] == "velocity (0, 0.5, 0) m/s"
        marks = {mark.path: mark for mark in surface_marks(0, surface, Sizes(1.0, 1e-3))}
        spread = np.ptp(marks["surfaces/0/velocity"].points, axis=0)
        flat = np.ptp(marks["surfaces/0/area"].points, axis=0)
        assert spread[1] - 2.0 / 3.0 * flat[1] == pytest.approx(0.16, abs=1e-9)

    def test_a_turntable_s_arrows_go_around(self, solo):
        """The velocity of its material is W x r about its axis; four feet on it are one surface."""
        table = rbd.Ground(point=(0, 0, 0), velocity=(0, 0, 0, 0, 0, 1.7), about=(0, 0, 0))
        state = solo.standing()
        solution = rbd.solve(state, np.zeros(solo.nu), solo.feet(friction=0.7, on=table), solver=rbd.ConeSolver())
        surfaces = Picture.of(state, solution, None).surfaces
        assert len(surfaces) == 1 and len(surfaces[0].names) == 4
        assert surfaces[0].velocity(np.array([[0.5, 0.0, 0.0]])) == pytest.approx(np.array([[0.0, 0.85, 0.0]]))

    def test_stairs_are_two_surfaces(self, talos):
        """One at each height; the floor is not among them."""
        state = talos.standing()
        stair = rbd.find_pose(talos, {"left_sole": (0.3, 0.085, 0.17), "right_sole": (0.0, -0.085, 0.0)}, com=(0.15, 0.0))
        state = stair.state
        solution = rbd.hold(state, talos.soles(on={"left_sole": 0.17}))
        _, scene = shown(talos, state, solution)
        assert [s.title for s in scene._picture.surfaces] == ["ground at 0.17 m"]


class TestLeftOut:
    """What is not in the picture is told in words."""

    def test_a_generalised_force_is_told(self, talos, pushed):
        """It has no point: the rest is drawn, the legend tells its largest entry."""
        state, held = pushed
        force = np.zeros(talos.nv)
        force[talos.joints["leg_left_4_joint"].v] = -3.5
        marks, scene = shown(talos, state, held, force)
        assert "contacts/left_sole/force" in marks and not any(path.startswith("pushes/") for path in marks)
        words = [w for w in scene.left_out if "generalised" in w]
        assert words and "-3.5 at leg_left_4_joint" in words[0] and words[0] in notes_and_entries(scene)[0]
        assert not shown(talos, state, held, np.zeros(talos.nv))[1].left_out

    def test_a_function_s_force_is_told(self):
        """A rod by a function of q acts on many coordinates: no arrow, but a note."""
        bead = rbd.testing.box(mass=2.0)
        rod = rbd.FunctionConstraint("rod", lambda q: np.linalg.norm(q[:3]) - 1.0)
        state = rbd.State(bead, [0.6, 0, 0.8, 0, 0, 0, 1])
        words = Picture.of(state, rbd.solve(state, [], [rod]), None).unshown
        assert len(words) == 1 and words[0].startswith("The force of rod is not drawn: 1 row on")

    def test_a_contact_without_load_is_told(self):
        """Four points under a crate that is pushed till it tips: those behind are not in the support polygon."""
        box = rbd.testing.box(mass=10.0)
        spots = {"front": 0.2, "back": -0.2}
        feet = [rbd.PointContact(name, "box", offset=(x, 0.0, 0.0), friction=0.9) for name, x in spots.items()]
        tip = rbd.ExternalForce("box", (0.0, 0.0, 0.0), moment=(0.0, 25.0, 0.0))
        contacts = shown_forces(rbd.solve(rbd.State(box, [0, 0, 0, 0, 0, 0, 1]), [], feet, external=tip))
        assert not_supporting(contacts) == ["Not in the support polygon: back (no load)."]

    def test_a_force_longer_than_the_picture_is_cut_and_told(self, talos, pushed):
        """Two heads, at the longest length, and a note that names it."""
        state, held = pushed
        huge = rbd.ExternalForce("torso_2_link", (1e5, 0.0, 0.0))
        marks, scene = shown(talos, state, held, huge)
        at = state.frame("torso_2_link").X_WF.translation
        assert marks["pushes/0/force"].points[:, 0].max() == pytest.approx(at[0] + scene.sizes.longest)
        assert "Double arrowhead: not drawn to full length (push on torso_2_link)." in scene.left_out

    def test_wheels_and_edges_have_their_force_where_they_touch(self):
        """A knife edge and a rolling disk: an arrow at the contact's point."""
        sleigh = rbd.testing.box(mass=4.0)
        blade = rbd.KnifeEdge("blade", "box", direction=(1, 0, 0), offset=(0.3, 0.0, 0.0))
        moving = rbd.State(sleigh, [0, 0, 0, 0, 0, 0, 1], [2.0, 0.0, 0, 0, 0, 0.0])
        picture = Picture.of(moving, rbd.solve(moving, [], [blade], external=rbd.ExternalForce("box", (0, 9.0, 0))), None)
        assert picture.contacts[0].start == pytest.approx([0.3, 0.0, 0.0]) and abs(picture.contacts[0].force[1]) > 0.1
        disk = rbd.testing.box(mass=1.0, size=(0.5, 0.01, 0.5))
        rolls = rbd.State(disk, [0, 0, 0.25, 0, 0, 0, 1], [0.5, 0, 0, 0, 2.0, 0])
        picture = Picture.of(rolls, rbd.solve(rolls, [], [rbd.RollingDisk("coin", "box", radius=0.25)]), None)
        assert picture.contacts[0].start == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
        assert picture.contacts[0].force == pytest.approx([0.0, 0.0, 9.81])

    def test_a_motion_tells_what_it_does_not_draw(self):
        """A loop's forces have no recorded point, a generalised force has none at all."""
        robot = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        swing = rbd.simulate(robot.at("assembled"), robot.loops(), duration=0.02, step=1e-2, progress=False)
        joints = [1, 2, 3]
        assert frames_of(shown_motion(swing), joints).left_out == ("Not drawn: the forces of coupler_pin.",)
        words = frames_of(shown_motion(swing), joints, external=np.array([1.0, 0.0, 0.0])).left_out
        assert words[0] == "The generalised external force is not drawn: it has no point of application."


def test_the_page_draws_the_polygon_in_the_plane_of_the_soles(browser, talos, tmp_path):
    """On a slope of 10 degrees, read back from the browser: all corners within the rounding of a packed mesh of one plane."""
    X = pin.SE3(pin.rpy.rpyToMatrix(0.0, np.radians(10.0), 0.0), np.array([0.0, 0.0, 0.3]))
    q = talos.standing().q.copy()
    q[:7] = pin.SE3ToXYZQUAT(X * pin.XYZQUATToSE3(q[:7]))
    state = rbd.State(talos, q)
    ramp = rbd.Ground(point=X.translation, normal=X.rotation[:, 2])
    _, scene = shown(talos, state, rbd.solve(state, np.zeros(talos.nu), talos.soles(friction=1.0, on=ramp)))
    script = """(() => {
      const points = [];
      stage.layers.object("marks/support/area").traverse((each) => {
        if (!each.isMesh) return;
        each.updateWorldMatrix(true, false);
        const at = each.geometry.attributes.position;
        for (let i = 0; i < at.count; i++) {
          const p = new MeshCat.THREE.Vector3().fromBufferAttribute(at, i).applyMatrix4(each.matrixWorld);
          points.push([p.x, -p.z, p.y]);
        }
      });
      return {points, surfaces: stage.layers.listed.filter((one) => one.layer === "surfaces").length,
              shown: stage.layers.object("marks/torques/leg_left_4_joint/limit").visible};
    })()"""
    with browser.open(scene.export(tmp_path / "slope.html"), width=400, height=300) as page:
        found = page.evaluate(script)
        page.evaluate("stage.layers.show('joint torques', true)")
        torques = page.evaluate('stage.layers.object("marks/torques/leg_left_4_joint/limit").visible')
    off = ramp.distances(np.array(found["points"]))
    assert len(off) >= 4 and 0.0 < off.min() and np.ptp(off) < 2e-4 and off.max() < 0.01
    assert found["surfaces"] == 3 and not found["shown"] and torques


class TestOtherConstraints:
    """Forces of what is no contact on a patch: loops, points of shapes; what cannot be placed is said."""

    def test_a_rigid_loop_has_a_force_on_each_body_and_a_moment(self):
        """Equal and opposite at the pin; the label tells the numbers."""
        bars = rbd.mechanism.four_bar(1.0, 3.0, 3.0, 4.0)
        weld = rbd.LoopClosure("weld", "coupler_tip", "rocker_tip", kind="revolute", axis=(0, 1, 0))
        state = bars.at("assembled")
        solution = rbd.solve(state, [0.0], [weld], loops=False)
        marks, _ = shown(bars, state, solution)
        own, other = marks["loops/weld/force"], marks["loops/weld/reaction"]
        force = solution.forces["weld"][:3]
        assert f"{np.linalg.norm(force):.4g}"[:3] in " ".join(own.label.lines) and "gets the opposite" in " ".join(
            own.label.lines
        )
        assert other.label.lines[1].startswith("the opposite of that on") and other.opacity < own.opacity

    @pytest.mark.parametrize(("kind", "length", "taut"), [("rod", 1.0, True), ("rope", 1.0, True), ("rope", 1.5, False)])
    def test_a_rod_or_rope_is_a_line_between_its_ends(self, kind, length, taut):
        """With its length; a slack rope too, which has no force."""
        box = rbd.load_robot("urdf/box.urdf", root="free_flyer")
        state = rbd.State(box, [0.6, 0, -0.8, 0, 0, 0, 1])
        link = rbd.LoopClosure("link", "universe", "box", kind=kind, length=length)
        marks, _ = shown(box, state, rbd.solve(state, [], [link]))
        assert marks["links/link"].points == pytest.approx(np.array([[0.0, 0.0, 0.0], [0.6, 0.0, -0.8]]))
        assert "1 m long" in marks["links/link"].label.lines[0] and ("loops/link/force" in marks) == taut

    def test_forces_between_bodies_at_points_of_their_shapes_are_one_mark(self):
        """A box on another: what acts on the lower one, 196.2 N from the floor less 98.1 N, is its weight."""
        boxes = [rbd.load_robot("urdf/box.urdf", root="free_flyer") for _ in range(2)]
        both = rbd.robots.merge_robots(*boxes, names=("low", "high"))
        state = rbd.State(both, [0, 0, 0.1, 0, 0, 0, 1, 0, 0, 0.3, 0, 0, 0, 1])
        pair = [shape.name for shape in both.collision_model.geometryObjects]
        touching = rbd.CollisionContacts("all", both, ground=True, pairs=[pair])
        marks, _ = shown(both, state, rbd.solve(state, [], [touching]))
        told = marks["points/all"].label.lines
        assert told[0] == "8 points" and told[1] == "sum of the forces (0, 0, 98.1) N" and len(told) == 10
