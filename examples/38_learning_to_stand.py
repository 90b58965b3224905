"""Can Solo12 learn within minutes to stay on its feet under pushes that knock it over?

Servos that hold the standing posture do not withstand pushes that change the robot's speed by 1 to 2 m/s. A policy moves
their targets by tanh(W s), with s what the robot senses and W of 12 x 35 numbers. An evolution strategy finds W: 1,024 worlds
each try W with noise, half of them with the opposite of the others' noise, and W moves along the noise that earned most, by
ranks, in steps of Adam [Salimans2017]. It needs no gradient of the motion, and no library but NumPy.
"""

from dataclasses import dataclass, field
from pathlib import Path

import gymnasium
import numpy as np

import rbd
import rbd.envs

NOISE, RATE = 0.05, 0.03  # standard deviation of the noise on W, length of a step of Adam
PUSHES = rbd.envs.RandomPushes((1.0, 2.0), pause=(0.3, 1.0), duration=0.1)
VARIED = {"friction": (0.5, 1.0), "mass": (0.9, 1.1)}
SCALE = np.repeat([10.0, 5.0, 2.0, 0.5, 3.0, 0.2], [1, 3, 3, 3, 12, 12])  # of height, gravity, velocities, joints


def environments(worlds: int, threads: int = 2, **more: object) -> rbd.envs.RobotVectorEnv:
    """Solo12 with its motors' 2.7 N m, on floors and with masses that differ, under pushes; 50 actions a second."""
    solo = rbd.load_robot("solo12")
    solo = solo.with_motors({joint: rbd.Motor(limit=2.7) for joint in solo.actuated_names})
    more = {"pushes": PUSHES, "max_episode_steps": None, "threads": threads, **VARIED, **more}
    return gymnasium.make_vec("rbd/PushRecovery-v0", num_envs=worlds, robot=solo, **more)


def actions(W: np.ndarray, observed: np.ndarray, envs: rbd.envs.RobotVectorEnv) -> np.ndarray:
    """Of policies W, shape (n, 12, 35), or one for all."""
    at_rest = np.zeros(34)
    at_rest[[0, 3]] = envs.reference.height, -1.0
    sensed = np.concatenate([(observed[:, :34] - at_rest) * SCALE, np.ones((len(observed), 1))], axis=1)
    return np.tanh(np.einsum("nij,nj->ni", np.broadcast_to(W, (len(observed), *W.shape[-2:])), sensed))


@dataclass
class Episode:
    """What n worlds did: returns, who still stands, the largest residual; of one world its motion and pushes."""

    returns: np.ndarray
    stands: np.ndarray
    residual: float = 0.0
    q: list[np.ndarray] = field(default_factory=list)
    v: list[np.ndarray] = field(default_factory=list)
    pushes: list[np.ndarray] = field(default_factory=list)

    def push(self, state: rbd.State, t: float) -> list[rbd.ExternalForce]:
        """On the base at a time, of one world."""
        return [rbd.ExternalForce("base_link", self.pushes[min(round(t / 0.02), len(self.pushes) - 1)])]


def episode(envs: rbd.envs.RobotVectorEnv, W: np.ndarray, steps: int, seed: int) -> Episode:
    """A world that falls earns nothing more."""
    observed, _ = envs.reset(seed=seed)
    run = Episode(np.zeros(envs.num_envs), np.ones(envs.num_envs, bool))
    for _ in range(steps):
        if envs.num_envs == 1 and run.stands[0]:
            start, end = envs.times[0]
            run.q.append(envs.worlds.q[0]), run.v.append(envs.worlds.v[0])
            run.pushes.append(envs.forces[0] * (start <= envs.worlds.t < end))
        observed, reward, fell, _, info = envs.step(actions(W, observed, envs))
        run.stands &= ~fell
        run.returns += run.stands * reward / steps
        run.residual = max(run.residual, float(info["residual"].max()))
    return run


def learn(envs: rbd.envs.RobotVectorEnv, updates: int, steps: int) -> tuple[np.ndarray, list[Episode]]:
    """The policy, and the episodes of its updates."""
    draw, half, W = np.random.default_rng(0), envs.num_envs // 2, np.zeros((12, 35))
    mean, square, runs = np.zeros_like(W), np.zeros_like(W), []
    for i in range(1, updates + 1):
        noise = draw.standard_normal((half, *W.shape))
        runs.append(run := episode(envs, np.concatenate([W + NOISE * noise, W - NOISE * noise]), steps, seed=i))
        rank = np.argsort(np.argsort(run.returns, kind="stable")) / (2 * half - 1) - 0.5
        slope = np.einsum("n,nij->ij", rank[:half] - rank[half:], noise) / half
        mean, square = 0.9 * mean + 0.1 * slope, 0.99 * square + 0.01 * slope**2
        W = W + RATE * (mean / (1 - 0.9**i)) / (np.sqrt(square / (1 - 0.99**i)) + 1e-8)
    return W, runs


def main(show: bool = True) -> tuple[list[Episode], list[Episode]]:
    worlds, updates, steps = (1024, 60, 100) if show else (64, 2, 50)
    envs = environments(worlds)
    W, runs = learn(envs, updates, steps)
    print(f"{worlds} worlds of Solo12 try policies for {steps / 50:g} s each: mean return, share that still stands")
    for i in range(0, updates, max(1, updates // 12)):
        print(f"  update {i + 1:2d}   {runs[i].returns.mean():.2f}   {100 * runs[i].stands.mean():3.0f} %")
    before, after = (episode(envs, policy, 2 * steps, seed=1000) for policy in (0.0 * W, W))
    print(f"After {steps / 25:g} s under other pushes {100 * before.stands.mean():.0f} % stand by their servos alone", end="")
    print(f", {100 * after.stands.mean():.0f} % by the policy.")
    if show:
        draw_curve(runs, before, after)
        print(f"See out/38_learning.png and {page(W)}.")
    return runs, [before, after]


def draw_curve(runs: list[Episode], before: Episode, after: Episode) -> None:
    """Who still stands, over the updates."""
    from matplotlib.figure import Figure  # in the extra `plot`

    ax = (figure := Figure(figsize=(7.0, 3.6), layout="constrained")).subplots()
    ax.plot(np.arange(1, len(runs) + 1), [100 * run.stands.mean() for run in runs], label="as it learns: 2 s, noise on W")
    for run, style, name in ((before, "--", "servos alone, 4 s"), (after, "-.", "the policy, 4 s")):
        ax.axhline(100 * run.stands.mean(), color="0.4", linestyle=style, label=name)
    ax.set(xlabel="update", ylabel="robots that still stand [%]", ylim=(0, 102), title="Solo12 learns to stand under pushes")
    ax.legend(frameon=False)
    Path("out").mkdir(exist_ok=True)
    figure.savefig("out/38_learning.png", dpi=150)


def page(W: np.ndarray) -> Path:
    """The policy under pushes, and the servos alone beside it until they fall, under the same ones."""
    envs = environments(1, threads=1)
    runs = [episode(envs, policy, 200, seed=7) for policy in (W, 0.0 * W)]
    motion, beside = (rbd.Motion.of_arrays(envs.robot, 0.02 * np.arange(len(r.q)), r.q, r.v, trust=True) for r in runs)
    given = {"external": runs[0].push, "beside": beside, "beside_external": runs[1].push, "title": "Solo12 under pushes"}
    return rbd.visual.export_motion(motion, "out/38_learning.html", **given)


def check(result: tuple[list[Episode], list[Episode]]) -> None:
    """Returns are shares, steps are accurate, the same seed gives the same bits; a policy that learned long stands."""
    runs, (before, after) = result
    for run in (*runs, before, after):
        assert np.isfinite(run.returns).all() and (0.0 <= run.returns).all() and (run.returns <= 1.0).all()
        assert run.residual < 1e-8
    if len(runs) > 10:
        assert after.stands.mean() > 0.9 > 0.2 > before.stands.mean()
    else:
        again = learn(environments(64, threads=1), 1, 50)[1][0]
        assert (again.returns == runs[0].returns).all()


if __name__ == "__main__":
    check(main())
