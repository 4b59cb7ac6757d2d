"""Trains a built-in task with SAC of Stable-Baselines3 and evaluates it on starts that it has not seen.

    pip install -r examples/python/train-requirements.txt
    python examples/python/train_with_sb3.py reach --cpu-minutes 5 --out out/reach
    python examples/python/train_with_sb3.py reach --evaluate --out out/reach

Writes the learning curve to OUT/curve.csv, the model beside it, and prints the share of 200 fresh
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
from gymnasium.spaces import Box
from gymnasium.wrappers import TransformAction, TransformObservation, TransformReward
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback

import genmanip.gym  # makes GenManip-v0 known

#: Layouts of training; those of the test have larger numbers.
TRAINED, TESTED = 50, 1000
#: Of the learner alone. With the same in the environment, all ways to go on are worth the same until an episode has
#: succeeded once; with 1 there, its default, a gain is worth more the sooner it comes.
DISCOUNT = 0.95
#: Share of the largest step, 5 cm: fingers of 8 cm close around a cube of 4 cm.
STEP = 0.5
#: Rewards of an episode sum to about 1, which the default weight of SAC's entropy would outweigh.
REWARD_SCALE = 10.0


def make(task):
    """The task as arrays of few numbers near 1: the hand points down and moves, as in Gymnasium-Robotics' Fetch."""
    given = {"observation": "flat", "action": "ee_delta", "rate_hz": 10, "reward": "dense"}
    env = gymnasium.make("GenManip-v0", tasks=task, layouts=TRAINED, scenes_kept=TRAINED, horizon_s=5.0, **given)
    env.reset(options={"layout": 0})
    names = env.unwrapped.state_names()
    tool, target, cube = ([names.index(f"{name}.{axis}") for axis in "xyz"] for name in ("tool", "tool_target", "046"))
    hand = [names.index(name) for name in ("agent_pos.opening", "agent_target.opening", "grasped.046")]

    fingers = [1.0]

    def seen(flat):
        fingers[0] = 1.0 if flat[hand[1]] > 0.04 else -1.0
        # The way to the cube, and how far the hand lags behind, which a network would have to learn to subtract.
        ways = [(flat[cube] - flat[tool]) / 0.1, (flat[target] - flat[tool]) / 0.02]
        places = [(flat[tool] - [0.5, 0.0, 0.2]) / 0.2, flat[cube[2:]] / 0.1]
        return np.concatenate([*ways, *places, flat[hand] / [0.04, 0.04, 1.0]]).astype(np.float32)

    def commanded(action):
        # The fingers keep their last command unless the fourth number is decided, since a grasp takes several steps;
        # for reaching they stay open: closed, they would stand on the cube.
        opening = np.sign(action[3]) if task != "reach" and abs(action[3]) > 0.5 else fingers[0]
        return np.array([*(STEP * action[:3]), 0.0, 0.0, 0.0, opening], np.float32)

    env = TransformObservation(env, seen, Box(-np.inf, np.inf, (13,), np.float32))
    env = TransformAction(env, commanded, Box(-1.0, 1.0, (3 if task == "reach" else 4,), np.float32))
    return TransformReward(env, lambda reward: REWARD_SCALE * reward)


class Curve(BaseCallback):
    """Success of the last hundred episodes over time; saves the model, and ends the training when the time is over."""

    def __init__(self, cpu_minutes, out, file):
        super().__init__()
        self.until, self.begun, self.out, self.file = 60 * cpu_minutes, time.process_time(), out, file
        self.rows = csv.writer(file)
        self.rows.writerow(["cpu_seconds", "steps", "success", "return"])

    def _on_step(self):
        ended = list(self.model.ep_info_buffer)
        if self.n_calls % 500 == 0 and ended:
            success = np.mean(self.model.ep_success_buffer) if self.model.ep_success_buffer else 0.0
            passed = time.process_time() - self.begun
            self.rows.writerow([round(passed), self.num_timesteps, success, np.mean([one["r"] for one in ended])])
            self.file.flush()
            self.model.save(self.out / "model")
        return time.process_time() - self.begun < self.until


def train(task, cpu_minutes, out):
    sac = {"gamma": DISCOUNT, "ent_coef": "auto_0.1", "learning_rate": 1e-3, "learning_starts": 500, "seed": 1}
    model = SAC("MlpPolicy", make(task), policy_kwargs={"net_arch": [128, 128]}, **sac)
    with open(out / "curve.csv", "w", newline="") as file:
        model.learn(10_000_000, callback=Curve(cpu_minutes, out, file))
    model.save(out / "model")
    print(f"{model.num_timesteps} steps")


def evaluate(task, tests, out):
    model = SAC.load(out / "model")

    def act(seen):
        return model.predict(seen, deterministic=True)[0]

    print(genmanip.gym.evaluate(make(task), act, range(TESTED, TESTED + tests), name=task))


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
