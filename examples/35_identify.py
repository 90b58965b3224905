"""A G1 carries a pack and two tools: what do its motions say of its inertias, and how well are its torques predicted?"""

import copy
import warnings
from pathlib import Path

import numpy as np
import pinocchio as pin

import rbd
from rbd.motion.identification import Identification, MeasuredMotion

SHOWN = ("waist_pitch_joint", "left_shoulder_pitch_joint", "right_elbow_joint")
FORCE_NOISE = np.array([2.0, 2.0, 4.0, 0.3, 0.3, 0.1])  # of a sole [N, N m]
TORQUE_NOISE = 0.1  # [N m]


def loaded(model: rbd.Robot) -> rbd.Robot:
    """The robot itself: its model with 3 kg on its back and half a kilogram in each hand."""
    robot = copy.deepcopy(model)
    pack = pin.Inertia(3.0, np.array([-0.12, 0.02, 0.2]), np.diag([0.02, 0.015, 0.02]))
    tool = pin.Inertia(0.5, np.array([0.1, 0.0, 0.0]), np.diag([5e-4, 2e-3, 2e-3]))
    for link, load in (("torso_link", pack), ("left_wrist_yaw_link", tool), ("right_wrist_yaw_link", tool)):
        joint = robot.frame(link).parentJoint
        robot.model.inertias[joint] = robot.model.inertias[joint] + load
    return robot


def measured(robot: rbd.Robot, model: rbd.Robot, seed: int, duration: float) -> MeasuredMotion:
    """It crouches, and waves arms and waist; a simulation takes the place of robot, force plates and torque sensors."""
    rng, start, names = np.random.default_rng(seed), robot.standing(), robot.actuated_names
    n, legs = robot.nu, {"hip_pitch": -0.25, "knee": 0.5, "ankle_pitch": -0.25}
    w, phase, size = rng.uniform(2.0, 9.0, (2, n)), rng.uniform(0.0, 6.3, (2, n)), np.full(n, 0.3)
    size[:12], size[12:15] = 0.0, 0.1  # of the legs, and of the waist
    down = np.array([sum(bend for joint, bend in legs.items() if joint in name) for name in names])
    hold = rbd.hold(start, robot.soles()).tau

    def control(state: rbd.State, t: float) -> np.ndarray:
        wanted = start.q[7:] + size * (np.sin(w * t + phase) - np.sin(phase)).sum(axis=0) + down * (1.0 - np.cos(5.0 * t))
        reach = np.linalg.inv(np.linalg.inv(state.M)[6:, 6:])  # what the joints feel of the inertia
        return hold + reach @ (400.0 * (wanted - state.q[7:]) - 40.0 * state.v[6:])

    held = robot.soles(friction=None)
    how = {"integrator": rbd.RungeKutta4(), "controller": control, "record_every": 2, "progress": False}
    x = rbd.simulate(start, held, duration=duration, step=4e-3, **how)
    motion = rbd.Motion.of_arrays(model, x.t, x.q, x.v, x.a)  # what is known of the robot is its model
    forces = {name: f + FORCE_NOISE * rng.normal(size=f.shape) for name, f in x.forces.items()}
    return MeasuredMotion(motion, x.tau + TORQUE_NOISE * rng.normal(size=x.tau.shape), held, forces=forces)


def main(show: bool = True) -> tuple[Identification, rbd.Robot, MeasuredMotion]:
    model = rbd.load_robot("g1")
    robot = loaded(model)
    data = [measured(robot, model, seed, 1.2) for seed in (1, 2)]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", rbd.errors.PoorExcitationWarning)  # feet that rest tell nothing of themselves
        found = rbd.identify(data)
    print(f"{found.base.rank} base parameters; its resting feet leave {found.base.rank - found.certificate.rank} untold")
    print(f"total mass {found.mass:.2f} +- {found.mass_deviation:.2f} kg; model {model.mass:.2f} kg, truth {robot.mass:.2f} kg")
    for body in ("torso_link", "right_wrist_yaw_link"):
        low, high = found.mass_range(body)
        true = robot.model.inertias[robot.frame(body).parentJoint].mass
        told = f"by itself it may be {low:.1f} to {high:.1f} kg"
        print(f"{body}: {found.bodies[body].mass:.2f} kg, truth {true:.2f} kg; {told}")
    unseen = measured(robot, model, 7, 0.8)
    new, old = found.residuals(unseen)
    upper = [robot.joints[name].v.start for name in SHOWN]
    print("torques of a motion it has not seen, off by (root mean square):")
    for name, i in zip(SHOWN, upper, strict=True):
        print(f"  {name:<26}{new[i]:.2f} N m, by the model {old[i]:.2f} N m; noise {TORQUE_NOISE:.2f} N m")
    if show:
        draw(found, unseen, model)
    return found, robot, unseen


def draw(found: Identification, unseen: MeasuredMotion, model: rbd.Robot) -> None:
    """Torques measured and predicted, with and without identification."""
    from matplotlib.figure import Figure  # in the extra `plot`

    figure, motion = Figure(figsize=(7.0, 5.6), layout="constrained"), unseen.motion
    each, predicted = list(zip(motion.q, motion.v, motion.a, strict=True)), found.predicted(unseen)
    new, old = (
        np.array([rbd.dynamics.inverse_dynamics(rbd.State(robot, q, v), a) for q, v, a in each])
        for robot in (found.robot(), model)
    )
    for ax, name in zip(figure.subplots(3, sharex=True), SHOWN, strict=True):
        i = model.joints[name].v.start
        ax.plot(motion.t, unseen.tau[:, model.actuated_names.index(name)], ".", color="0.6", markersize=4, label="measured")
        ax.plot(motion.t, (predicted - new + old)[:, i], "--", color="tab:red", label="by the model")
        ax.plot(motion.t, predicted[:, i], color="tab:blue", label="identified")
        ax.set(ylabel="torque [N m]", title=name.replace("_", " "))
    ax.set(xlabel="time [s]")
    figure.legend(*ax.get_legend_handles_labels(), frameon=False, ncols=3, loc="outside upper center")
    Path("out").mkdir(exist_ok=True)
    figure.savefig("out/35_identify.png", dpi=150)


def check(result: tuple[Identification, rbd.Robot, MeasuredMotion]) -> None:
    """The mass is within four deviations of the truth, the torques are predicted to the noise, every body is possible."""
    found, robot, unseen = result
    assert abs(found.mass - robot.mass) < 4.0 * found.mass_deviation
    new, old = found.residuals(unseen)
    arms = [robot.joints[name].v.start for name in SHOWN[1:]]
    assert (new[arms] < 1.3 * TORQUE_NOISE).all() and (old[arms] > 2.0 * new[arms]).all()
    assert found.certificate.least_eigenvalue > 0.0 and found.certificate.decrement < 1e-6


if __name__ == "__main__":
    check(main())
