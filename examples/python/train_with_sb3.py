"""Trains a built-in task with SAC of Stable-Baselines3 and evaluates it on starts that it has not seen.

    pip install -r examples/python/train-requirements.txt
    python examples/python/train_with_sb3.py reach --cpu-minutes 20 --out out/reach
    python examples/python/train_with_sb3.py reach --evaluate --out out/reach

Writes the learning curve to OUT/curve.csv, model and observation scales beside it, and prints the share of 200 fresh
starts that succeed; `--evaluate` does only that, with what OUT holds. The time is that of the processor, of all threads
together, so that it means the same on a busy machine.
"""

import argparse
import csv
import pathlib
import time

import gymnasium
import numpy as np
import torch
from gymnasium.wrappers import TransformAction, TransformObservation
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import genmanip.gym  # makes GenManip-v0 known

#: Layouts of training; those of the test have larger numbers.
TRAINED, TESTED = 50, 1000
DISCOUNT = 0.95
#: Shares of the largest changes of position, rotation and opening: turning little keeps the hand upright.
SCALE = np.array([1, 1, 1, 0.1, 0.1, 0.1, 1], np.float32)


def make(task):
    given = {"observation": "flat", "action": "ee_delta", "rate_hz": 10, "reward": "dense", "discount": DISCOUNT}
    env = gymnasium.make("GenManip-v0", tasks=task, layouts=TRAINED, scenes_kept=TRAINED, horizon_s=5.0, **given)

    def scaled(action):
        action = SCALE * action
        if task == "reach":
            action[-1] = 1  # the hand stays open: closed, its fingers would stand on the cube
        return action

    env.reset(options={"layout": 0})
    names = env.unwrapped.state_names()
    tool, cube = ([names.index(f"{name}.{axis}") for axis in "xyz"] for name in ("tool", "046"))
    wider = gymnasium.spaces.Box(-np.inf, np.inf, (len(names) + 3,), np.float32)
    # The way from the tool to the cube, which a network would have to learn to subtract.
    env = TransformObservation(env, lambda seen: np.append(seen, seen[cube] - seen[tool]).astype(np.float32), wider)
    return TransformAction(env, scaled, env.action_space)


class Curve(BaseCallback):
    """Success of the last hundred episodes over time; ends the training when the time is over."""

    def __init__(self, cpu_minutes, file):
        super().__init__()
        self.until, self.begun, self.file = 60 * cpu_minutes, time.process_time(), file
        self.rows = csv.writer(file)
        self.rows.writerow(["cpu_seconds", "steps", "success", "return"])

    def _on_step(self):
        ended = list(self.model.ep_info_buffer)
        if self.n_calls % 500 == 0 and ended:
            success = np.mean(self.model.ep_success_buffer) if self.model.ep_success_buffer else 0.0
            passed = time.process_time() - self.begun
            self.rows.writerow([round(passed), self.num_timesteps, success, np.mean([one["r"] for one in ended])])
            self.file.flush()
        return time.process_time() - self.begun < self.until


def train(task, cpu_minutes, out):
    # Numbers in metres and small rewards: both are scaled by what was seen so far.
    envs = VecNormalize(make_vec_env(lambda: make(task), seed=1), gamma=DISCOUNT)
    # The default weight of entropy, 1, outweighs these rewards for the first ten thousand updates.
    sac = {"gamma": DISCOUNT, "ent_coef": "auto_0.02", "learning_rate": 1e-3, "learning_starts": 1000, "seed": 1}
    model = SAC("MlpPolicy", envs, policy_kwargs={"net_arch": [128, 128]}, **sac)
    with open(out / "curve.csv", "w", newline="") as file:
        model.learn(10_000_000, callback=Curve(cpu_minutes, file))
    model.save(out / "model")
    envs.save(str(out / "scales"))
    print(f"{model.num_timesteps} steps")


def evaluate(task, tests, out):
    env = make(task)
    model = SAC.load(out / "model")
    scales = VecNormalize.load(str(out / "scales"), DummyVecEnv([lambda: env]))

    def act(seen):
        return model.predict(scales.normalize_obs(seen), deterministic=True)[0]

    print(genmanip.gym.evaluate(env, act, range(TESTED, TESTED + tests), name=task))


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("task", choices=["reach", "lift", "place"])
    arguments.add_argument("--cpu-minutes", type=float, default=20)
    arguments.add_argument("--evaluate", action="store_true", help="do not train, load the model of --out")
    arguments.add_argument("--tests", type=int, default=200, help="fresh starts")
    arguments.add_argument("--threads", type=int, default=1, help="of PyTorch")
    arguments.add_argument("--out", type=pathlib.Path, required=True)
    given = arguments.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(given.threads)
    if not given.evaluate:
        train(given.task, given.cpu_minutes, given.out)
    evaluate(given.task, given.tests, given.out)


main()
