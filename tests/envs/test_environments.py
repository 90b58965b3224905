"""Robots on their feet as environments of Gymnasium: spaces, ends and new beginnings of episodes, seeds, residuals."""

from __future__ import annotations

import importlib
import sys

import gymnasium
import numpy as np
import pinocchio as pin
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import rbd
import rbd.envs

SOLO = rbd.load_robot("solo12")
HARD = rbd.envs.RandomPushes((3.0, 4.0), pause=(0.1, 0.3))
"""After which Solo12 falls."""


def make(n=9, **options):
    return rbd.envs.RobotVectorEnv(SOLO, n, **options)


def played(envs, steps, seed=3, act=0.3):
    """What all calls of an episode return, one array each."""
    draw, out = np.random.default_rng(seed), [envs.reset(seed=seed)[0]]
    for _ in range(steps):
        obs, reward, terminated, truncated, info = envs.step(draw.uniform(-act, act, envs.action_space.shape))
        out += [obs, reward, terminated, truncated, info["residual"]]
    return out


@pytest.mark.parametrize("name", ["Stand", "PushRecovery"])
def test_one_world_passes_gymnasiums_checker(name):
    """Spaces, types, seeds, determinism of reset and step, as `check_env` wants them; warnings are errors."""
    check_env(gymnasium.make(f"rbd/{name}-v0", robot=SOLO).unwrapped)


def test_make_vec_gives_the_vector_environment():
    """The id's arguments and the time limit arrive; observations and actions are in their spaces; others are told so."""
    envs = gymnasium.make_vec("rbd/PushRecovery-v0", num_envs=5, robot="solo12", max_episode_steps=7, torque=0.5)
    assert isinstance(envs, rbd.envs.RobotVectorEnv) and envs.limit == 7 and envs.num_envs == 5
    assert envs.pushes.speed == (0.0, 0.5) and envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert envs.action_space.shape == (5, 24) and envs.single_observation_space.shape == (10 + 24 + 24,)
    obs, info = envs.reset(seed=0)
    assert obs in envs.observation_space and obs.dtype == np.float32
    obs, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
    assert obs in envs.observation_space and reward.shape == terminated.shape == truncated.shape == (5,)
    assert info["_residual"].all() and info["residual"].shape == (5,) and 0.0 < info["residual"].max() < 1e-8


def test_what_is_observed_is_the_state():
    """Height, gravity in the base, velocities in its axes, joints off the posture, the last action; by Pinocchio."""
    envs = make(3, speed=0.5)
    envs.reset(seed=2)
    action = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 12))
    for _ in range(4):
        obs = envs.step(action)[0]
    for i in range(3):
        state = rbd.State(SOLO, envs.worlds.q[i], envs.worlds.v[i])
        down = pin.Quaternion(state.q[3:7]).toRotationMatrix().T @ [0.0, 0.0, -1.0]
        expected = np.r_[state.q[2], down, state.v[:6], state.q[7:] - SOLO.standing().q[7:], state.v[6:], action[i]]
        assert np.abs(obs[i] - expected).max() < 1e-5


def test_standing_earns_nearly_all_and_a_fall_ends_the_episode():
    """At rest each term is 1; pushed hard, the robot falls, earns nothing, and its observation is that of the fall."""
    envs = make(speed=0.0)
    envs.reset(seed=1)
    reward = envs.step(np.zeros((9, 12)))[1]
    assert reward == pytest.approx(1.0, abs=1e-4)
    envs = make(pushes=HARD)
    obs, _ = envs.reset(seed=1)
    for _ in range(60):
        obs, reward, terminated, truncated, info = envs.step(np.zeros((9, 12)))
        if terminated.any():
            break
    assert terminated.any() and not truncated.any() and (reward[terminated] == 0.0).all()
    low, leans = obs[:, 0] < 0.6 * SOLO.standing().q[2], obs[:, 3] > -np.cos(1.0)
    assert ((low | leans) == terminated).all()


@pytest.mark.parametrize("name", ["g1", "talos"])
def test_humanoids_stand_by_the_action_zero(name):
    """Also where motors reach their limits: strong damping at a light wrist would shake it, and the robot over."""
    envs = rbd.envs.RobotVectorEnv(name, 8, speed=0.2)
    envs.reset(seed=1)
    for _ in range(60):
        reward, terminated = envs.step(np.zeros(envs.action_space.shape))[1:3]
        assert not terminated.any()
    assert reward.min() > 0.9


@pytest.mark.parametrize("mode", AutoresetMode)
def test_episodes_begin_anew(mode):
    """After the time limit: in the next step without reward, in the same step with `final_obs`, or by the mask alone."""
    envs = make(max_episode_steps=3, autoreset_mode=mode)
    first, _ = envs.reset(seed=4)
    zero = np.zeros((9, 12))
    steps = [envs.step(zero) for _ in range(3)]
    assert not steps[1][3].any() and steps[2][3].all() and not steps[2][2].any()
    obs, *_, info = steps[2]
    if mode is AutoresetMode.SAME_STEP:
        assert info["_final_obs"].all() and info["final_info"]["residual"].max() > 0.0
        ended = np.stack(info["final_obs"])
        assert np.abs(ended[:, 22:34]).max() > 0.0 and np.abs(obs[:, 22:34]).max() <= np.float32(0.1)
        assert not envs.step(zero)[3].any()
    elif mode is AutoresetMode.NEXT_STEP:
        obs, reward, terminated, truncated, info = envs.step(10.0 + zero)
        assert (reward == 0.0).all() and not terminated.any() and not truncated.any() and (info["residual"] == 0.0).all()
        assert not any(term.any() for term in info["reward"].values() if term.dtype == float)
        assert np.abs(obs[:, 34:]).max() == 0.0 and (obs != first).any()  # the action is ignored, the start is another
        assert envs.step(zero)[1].min() > 0.9
    else:
        with pytest.raises(rbd.InputError, match="world 0 is over; call reset first"):
            envs.step(zero)
        mask = np.arange(9) < 9
        mask[4] = False
        obs, _ = envs.reset(options={"reset_mask": mask})
        assert (obs[4] == steps[2][0][4]).all()
        with pytest.raises(rbd.InputError, match="world 4 is over"):
            envs.step(zero)


@pytest.mark.parametrize("mode", AutoresetMode)
def test_gymnasiums_wrappers_take_it(mode):
    """Returns and lengths of episodes are counted, and info becomes a list, in each mode."""
    envs = make(3, max_episode_steps=5, autoreset_mode=mode)
    wrapped = gymnasium.wrappers.vector.DictInfoToList(gymnasium.wrappers.vector.RecordEpisodeStatistics(envs))
    wrapped.reset(seed=1)
    for _ in range(5):
        info = wrapped.step(np.zeros((3, 12)))[-1]
    assert [each["episode"]["l"] for each in info] == [5, 5, 5]
    assert all(4.5 < each["episode"]["r"] <= 5.0 and each["residual"] < 1e-8 for each in info)


def test_the_same_seed_gives_the_same_bits():
    """Twice in one environment, in another one, and on two threads; another seed gives others."""
    options = dict(pushes=HARD, friction=(0.4, 1.0), mass=(0.8, 1.2), max_episode_steps=15)
    envs = make(**options)
    first = played(envs, 40)
    for other in (played(envs, 40), played(make(threads=2, **options), 40)):
        assert all((a == b).all() for a, b in zip(first, other, strict=True))
    assert (played(envs, 1, seed=4)[0] != first[0]).any()


def test_friction_and_mass_are_drawn_and_act():
    """Each world has its own; half the mass on the same feet presses half as much."""
    envs = make(mass=(0.5, 1.5), friction=(0.2, 0.9), speed=0.0)
    envs.reset(seed=5)
    drawn = np.random.default_rng()
    drawn.bit_generator.state = np.random.PCG64(np.random.SeedSequence(5)).state
    mass, friction = drawn.uniform(0.5, 1.5, 9), drawn.uniform(0.2, 0.9, 9)
    for _ in range(50):
        info = envs.step(np.zeros((9, 12)))[-1]
    forces = envs.worlds.forces
    load = sum(force[:, 2] for force in forces.values())
    assert load == pytest.approx(mass * SOLO.mass * 9.81, rel=1e-3)
    for force in forces.values():
        assert (np.linalg.norm(force[:, :2], axis=1) <= friction * force[:, 2] * (1.0 + 1e-6)).all()
    assert info["residual"].max() < 1e-8  # of equations with these masses


def test_a_world_that_stops_is_said_and_begins_anew():
    """Numbers that are not finite end the episode, by name, and no NaN comes out."""
    envs = make()
    envs.reset(seed=1)
    q, v = envs.worlds.q, envs.worlds.v
    v[3] = np.nan
    envs.worlds.set(q, v)
    obs, reward, terminated, truncated, info = envs.step(np.zeros((9, 12)))
    assert list(np.flatnonzero(info["stopped"])) == list(np.flatnonzero(terminated)) == [3] and reward[3] == 0.0
    assert obs in envs.observation_space and np.isfinite(reward).all()
    obs, reward, terminated, _, info = envs.step(np.zeros((9, 12)))
    assert not terminated.any() and not info["stopped"].any()
    assert envs.step(np.zeros((9, 12)))[1].min() > 0.9


def test_a_motion_is_followed():
    """Where it begins is drawn; targets on the motion earn more than those that stand still; the episode ends with it."""
    t, q = np.linspace(0.0, 1.0, 51), np.tile(SOLO.standing().q, (51, 1))
    bend = 0.3 * np.sin(np.pi * t) ** 2
    for hip, knee in ((8, 9), (11, 12), (14, 15), (17, 18)):
        way = np.sign(q[0, knee])
        q[:, hip], q[:, knee] = q[:, hip] - way * bend, q[:, knee] + 2.0 * way * bend
    q = np.array([rbd.robots.place_on_ground(rbd.State(SOLO, x), SOLO.feet(friction=None)).q for x in q])
    assert np.ptp(q[:, 2]) > 0.03
    motion = rbd.Motion.of_arrays(SOLO, t, q)
    envs = gymnasium.make_vec("rbd/Track-v0", num_envs=16, robot=SOLO, motion=motion)
    earned = {}
    for follows in (True, False):
        obs, _ = envs.reset(seed=1)
        assert obs in envs.observation_space and obs.shape == (16, 46 + 24)
        angles, begun, ended, rewards = envs.reference.angles, envs._at.copy(), np.full(16, -1), []
        assert len(set(begun)) > 8
        for i in range(50):
            still = (envs.reference.posture - angles[np.minimum(envs._at + 1, 50)]) / envs.reach
            obs, reward, terminated, truncated, info = envs.step(np.zeros((16, 12)) if follows else still)
            rewards.append(reward[ended < 0])
            ended[truncated & (ended < 0)] = i + 1
        assert (ended == 50 - begun).all()
        earned[follows] = np.concatenate(rewards).mean()
    assert earned[True] > 0.97 > 0.9 > earned[False]
    assert {"place", "heading", "motors", "touches", "loads"} < set(info["reward"])


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (dict(robot=rbd.load_robot("solo12", root="fixed")), "fixed base"),
        (dict(robot=3), "robot is 3"),
        (dict(num_envs=0), "num_envs is 0"),
        (dict(every=1.5), "every is 1.5"),
        (dict(step=-1.0), "step is -1"),
        (dict(reach=0.0), "reach is 0"),
        (dict(torque=-1.0), "torque is -1"),
        (dict(friction=(1.0, 0.5)), "friction is"),
        (dict(mass=(0.0, 1.0)), "mass is"),
        (dict(speed=np.nan), "speed is nan"),
        (dict(lowest=2.0), "lowest is 2"),
        (dict(lean=0.0), "lean is 0"),
        (dict(pushes=3.0), "pushes is 3"),
        (dict(motion="walk.csv"), "motion is 'walk.csv'"),
        (dict(autoreset_mode="never"), "autoreset_mode is 'never'"),
        (dict(render_mode="human"), "render_mode is 'human'"),
        (dict(max_episode_steps=0), "max_episode_steps is 0"),
        (dict(stiffness=1e6), "too long for the stiffness"),
    ],
)
def test_bad_arguments_are_named(options, words):
    """What came, and what was expected."""
    with pytest.raises(rbd.InputError, match=words):
        rbd.envs.RobotVectorEnv(**{"robot": SOLO, "num_envs": 2, **options})


def test_without_gymnasium_the_extra_is_named(monkeypatch):
    """The error says what to install."""
    monkeypatch.setitem(sys.modules, "gymnasium", None)
    monkeypatch.delitem(sys.modules, "rbd.envs.environments")
    with pytest.raises(rbd.InputError, match=r"rbd-contact\[envs\]"):
        importlib.import_module("rbd.envs.environments")


def test_bad_calls_are_named():
    """Steps before a reset, actions of another shape or not finite, seeds and options that are none."""
    envs = make(2)
    for call, words in (
        (lambda: envs.step(np.zeros((2, 12))), "no episode has begun"),
        (lambda: envs.step(np.zeros(12)), "actions"),
        (lambda: envs.step(np.full((2, 12), np.nan)), "actions"),
        (lambda: envs.reset(seed=-1), "seed is -1"),
        (lambda: envs.reset(options={"mask": 1}), "mask"),
        (lambda: envs.reset(options=3), "options is 3"),
        (lambda: envs.reset(options={"reset_mask": [[1], [2, 3]]}), "reset_mask is"),
        (lambda: envs.reset(options={"reset_mask": np.ones(3, bool)}), "reset_mask has shape"),
        (lambda: envs.reset(options={"reset_mask": np.array([True, False])}), "first reset of all"),
        (lambda: rbd.envs.RandomPushes((1.0, 0.5)), "speed is"),
        (lambda: rbd.envs.RandomPushes(duration=0.0), "duration is 0"),
        (lambda: rbd.envs.RandomPushes(frame=3), "frame is 3"),
        (lambda: make(2, pushes=rbd.envs.RandomPushes(frame="trunk")), "trunk"),
        (lambda: make(2, contacts=3), "contacts is 3"),
    ):
        with pytest.raises(rbd.InputError, match=words):
            call()
