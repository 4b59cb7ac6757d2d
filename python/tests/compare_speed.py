"""Compares state steps per CPU second with FetchPickAndPlace-v4 of Gymnasium-Robotics at the same control rate, in turn.

Usage: compare_speed.py [SCENARIOS], in an environment with genmanip, gymnasium-robotics 1.4.2 and mujoco 3.3.7.
Without scenarios, the built-in task `place`: a cube and a plate, where Fetch has a cube.
"""

import sys
import time

import gymnasium
import gymnasium_robotics
import numpy as np

import genmanip  # makes GenManip-v0 known

RATE_HZ = 20
gymnasium.register_envs(gymnasium_robotics)


def rate(env, steps=400):
    """Steps per CPU second with random actions."""
    env.reset(seed=1)
    env.action_space.seed(1)
    begun = time.process_time()
    for _ in range(steps):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        if terminated or truncated:
            env.reset(seed=1)
    return steps / (time.process_time() - begun)


fetch = gymnasium.make("FetchPickAndPlace-v4", max_episode_steps=10_000)
fetch.unwrapped.n_substeps = int(round(1 / (RATE_HZ * fetch.unwrapped.model.opt.timestep)))
scene = {"suite": sys.argv[1], "index": 0} if len(sys.argv) > 1 else {"tasks": "place"}
ours = {
    action: gymnasium.make("GenManip-v0", **scene, action=action, rate_hz=RATE_HZ)
    for action in ("joint_delta", "ee_delta")
}
rounds = [{"fetch": rate(fetch), **{name: rate(env) for name, env in ours.items()}} for _ in range(7)]
for name in rounds[0]:
    values = [one[name] for one in rounds]
    ratio = np.median([one[name] / one["fetch"] for one in rounds])
    print(f"{name}: {np.median(values):.0f} steps per CPU second, {ratio:.2f} x Fetch")
