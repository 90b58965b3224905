"""How does one build a mechanism without a file, and is it the published one?

Three models by `rbd.RobotBuilder`, in twenty lines each: Andrews' squeezer with its spring, whose motion over 0.03 s is known
to many digits (test set for IVP solvers); the Bricard mechanism of IFToMM, six hinges around a cube, which counts as rigid and
moves; and the simplest walker (Garcia and others, 1998), whose step down a slope brings it back to where it began.
"""

from pathlib import Path

import numpy as np

import rbd
from rbd.robots import PointMass, Rod
from rbd.simulation import StateEvent, Switch

REFERENCE = {"beta": 15.81077119629904, "theta": -15.75637105984298, "gamma": 0.04082224013073101, "phi": -0.5347301163226948,
             "delta": 0.5244099658805304, "omega": 0.5347301163226948, "epsilon": 1.048080741042263}  # fmt: skip
"""The squeezer's angles at 0.03 s [rad]."""
SLOPE, FOOT = 0.009, 1e-4  # of the walker's ground [rad]; mass of a foot [kg], that of the hip is 1 kg
CYCLE = np.array([0.200310900544287, -0.199832473004977, -0.015822999948318])
"""The walker on this slope, feet without mass, at a step's start: angle and rate of the leg that stands, rate of the hip."""
EXACT = rbd.DormandPrince8(rtol=1e-12, atol=1e-13)


def squeezer() -> rbd.Robot:
    """Seven bodies in a plane, driven at K1; K2, K3, K4 and K6 end in one point. A body's axes are at the pin it hangs on."""
    b = rbd.RobotBuilder("squeezer", root="fixed", about="Andrews' squeezer, of the test set for IVP solvers.")
    A, B = (-0.06934, -0.00227, 0), (-0.03635, 0.03273, 0)
    for name, parent, pin, tip, mass, inertia, com in (
        ("beta K1", "ground", (0, 0, 0), (0.007, 0, 0), 0.04325, 2.194e-6, (0.00092, 0, 0)),
        ("theta K2", "K1", (0.007, 0, 0), (-0.028, 0, 0), 0.00365, 4.410e-7, (-0.0115, 0, 0)),
        ("gamma K3", "ground", B, (0, -0.035, 0), 0.02373, 5.255e-6, (0.01874, -0.01043, 0)),
        ("delta K5", "ground", A, (0.04, 0, 0), 0.0705, 1.169e-5, (0.02308, 0.00916, 0)),
        ("phi K4", "K5", (0.04, 0, 0), (0, -0.02, 0), 0.00706, 5.667e-7, (0, -0.00579, 0)),
        ("epsilon K7", "ground", A, (0, -0.04, 0), 0.05498, 1.912e-5, (0.01228, -0.00449, 0)),
        ("omega K6", "K7", (0, -0.04, 0), (0.02, 0, 0), 0.00706, 5.667e-7, (0.00579, 0, 0)),
    ):
        angle, body = name.split()
        b.body(body, Rod((0, 0, 0), tip), mass=mass, com=com, inertia=(inertia / 2, inertia / 2, inertia))
        b.joint(angle, parent, body, at=pin, axis=(0, 0, 1), motor=body == "K1")
        if body in ("K3", "K4", "K6"):
            b.loop(f"K2 {body}", ("K2", (-0.028, 0, 0)), (body, tip), kind="planar", axis=(0, 0, 1))
    b.frame("D", "K3", (0.02, -0.018, 0))  # where the spring pulls
    b.posture("start", {"beta": -0.0617138900142764496, "gamma": 0.455279819163070380, "phi": 0.222668390165885885,
        "delta": 0.487364979543842550, "omega": -0.222668390165885885, "epsilon": 1.23054744454982120})  # fmt: skip
    return b.robot()


def bricard() -> rbd.Robot:
    """Six bars of 1 m and 1 kg along edges of a cube, one of them fixed; each hinge is across its two bars."""
    corners = np.array([(0, 0, 0), (1, 0, 0), (1, 1, 0), (1, 1, 1), (0, 1, 1), (0, 0, 1)], float)
    along = np.roll(corners, -1, axis=0) - corners
    axes = np.cross(np.roll(along, 1, axis=0), along)
    b = rbd.RobotBuilder("bricard", root="fixed", about="The Bricard mechanism of IFToMM's library.")
    for i in range(6):
        b.body(f"bar {i}", Rod((0, 0, 0), along[i], mass=1.0))
        if i:
            b.joint(f"hinge {i}", f"bar {i - 1}", f"bar {i}", at=along[i - 1], axis=axes[i])
    b.loop("hinge 0", ("bar 5", along[5]), "bar 0", kind="revolute", axis=axes[0])
    return b.robot()


def walker(foot: float = FOOT) -> rbd.Robot:
    """Two straight legs of 1 m on point feet, 1 kg at the hip; gravity of 1 m/s2 is turned by the slope."""
    b = rbd.RobotBuilder("walker", root="planar", plane="xz", about="The simplest walker.")
    for leg, hip in (("left", [PointMass(1.0)]), ("right", [])):
        b.body(leg, Rod((0, 0, 0), (0, 0, -1)), PointMass(foot, at=(0, 0, -1)), *hip)
        b.frame(f"{leg}_foot", leg, (0, 0, -1))
    b.joint("hip", "left", "right", axis=(0, -1, 0))
    return b.robot(gravity=(np.sin(SLOPE), 0, -np.cos(SLOPE)))


def main(show: bool = True) -> dict[str, rbd.Trajectory]:
    andrews, hexagon = squeezer(), bricard()
    pull = {"external": rbd.Spring("D", to=(0.014, 0.072, 0), stiffness=4530.0, rest=0.07785), "controller": lambda *_: [0.033]}
    turned = rbd.simulate(andrews.at("start"), andrews.loops(), duration=0.03, step=1e-3, integrator=EXACT, **pull)
    swung = rbd.simulate(hexagon.at(), hexagon.loops(), duration=2.0, step=0.02, integrator=EXACT)
    free, stepped = rbd.mechanism.mobility(hexagon.at()), step(walker())
    result = {"squeezer": turned, "bricard": swung, "walker": stepped}
    print(f"{andrews}, {len(andrews.loops())} loops")
    print(
        f"  at 0.03 s beta is {turned[-1].state.q[0]:.7f} rad; all angles as published, to eight decimals: {off(turned) < 1e-8}"
    )
    print(f"{hexagon}; degrees of freedom: {free.count.value} by counting, {free.finite} in truth")
    print(f"  energy kept over 2 s, to ten digits: {np.ptp(swung.energy) < 1e-10 * swung.kinetic.max()}")
    print(f"{stepped.robot}; a step takes {stepped.t[-1]:.3f} s")
    print(f"  then the legs move as the others did before, to {np.abs(again(stepped)).max():.4f} rad; feet: {FOOT:g} kg")
    if show:
        from matplotlib.figure import Figure  # in the extra `plot`

        figure = Figure(figsize=(9.0, 3.4), layout="constrained")
        plot([figure.add_subplot(1, 3, i, projection="3d" if i == 2 else None) for i in (1, 2, 3)], result)
        Path("out").mkdir(exist_ok=True)
        figure.savefig("out/32_models_in_memory.png", dpi=150)
        print("See out/32_models_in_memory.png.")
    return result


def step(robot: rbd.Robot) -> rbd.Trajectory:
    """From one heel strike through the next; straight legs scuff when they pass each other, which is ignored."""
    th, rate, hip = CYCLE
    start = robot.at([-np.sin(th), np.cos(th), np.cos(th), np.sin(th), -2 * th], [-rate, 0, rate, -hip])
    feet = [rbd.PointContact(leg, f"{leg}_foot", friction=None) for leg in ("left", "right")]

    def land(state: rbd.State, t: float) -> Switch | None:
        return Switch(on="right", off="left") if state.frame("right_foot").X_WF.translation[0] > 0.1 else None

    strike = StateEvent(lambda state: state.frame("right_foot").X_WF.translation[2], "right foot", terminal=3, then=land)
    return rbd.simulate(start, feet, inactive="right", events=[strike], duration=9.0, step=0.05, integrator=EXACT)


def off(turned: rbd.Trajectory) -> float:
    """Largest difference of the squeezer's angles from the reference [rad]."""
    end = turned[-1].state
    return max(abs(float(end.q[end.robot.joints[name].q.start]) - angle) for name, angle in REFERENCE.items())


def again(stepped: rbd.Trajectory) -> np.ndarray:
    """How the walker's end, legs swapped, differs from its beginning: angle, rate, rate of the hip [rad, rad/s]."""
    q, v = stepped[-1].state.q, stepped[-1].state.v
    return np.array([np.arctan2(q[3], q[2]) + q[4], v[2] + v[3], v[3]]) - CYCLE


def plot(axes, result: dict[str, rbd.Trajectory]) -> None:
    """Bars of the three models at five times, the last ones black [m]."""
    shown = (result["squeezer"], [0, 1], "30 ms"), (result["bricard"], [0, 1, 2], "2 s"), (result["walker"], [0, 2], "one step")
    for ax, (motion, plane, time) in zip(axes, shown, strict=True):
        for i in np.linspace(0, len(motion) - 1, 5).astype(int):
            state, shade = motion[int(i)].state, str(0.85 * (1.0 - i / (len(motion) - 1)))
            for bar in (shape for shape in state.robot.visual_model.geometryObjects if hasattr(shape.geometry, "halfLength")):
                frame = state.robot.model.frames[bar.parentFrame]
                X = state.frame(frame.name).X_WF * frame.placement.inverse() * bar.placement
                ends = np.array([X.act(np.array([0, 0, z * bar.geometry.halfLength])) for z in (-1, 1)])
                ax.plot(*ends[:, plane].T, color=shade, marker="o", ms=2)
        ax.set_aspect("equal")
        ax.set_title(f"{motion.robot.name}, {time} [m]", fontsize="medium")
        ax.locator_params(nbins=4)


def check(result: dict[str, rbd.Trajectory]) -> None:
    """The squeezer as published, the hexagon's one freedom and its energy, the walker's cycle as its feet are light."""
    assert off(result["squeezer"]) < 1e-8 and rbd.mechanism.mobility(result["bricard"][0].state).finite == 1
    assert np.ptp(result["bricard"].energy) < 1e-10 * result["bricard"].kinetic.max()
    assert np.abs(again(result["walker"])).max() < 5 * FOOT


if __name__ == "__main__":
    check(main())
