"""Trains a built-in task with SAC of Stable-Baselines3 and evaluates it on starts that it has not seen.

    pip install -r examples/python/train-requirements.txt
    python examples/python/train_with_sb3.py reach --cpu-minutes 20 --out out/reach

Writes the learning curve to OUT/curve.csv and prints the share of 200 fresh starts that succeed. The time is that of the
processor, of all threads together, so that it means the same on a busy machine.
"""

import argparse
import csv
import pathlib
import time

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.monitor import Monitor

import genmanip  # makes GenManip-v0 known

#: Layouts of training; those of the test have larger numbers.
TRAINED, TESTED = 50, range(1000, 1200)


def make(task):
    given = {"observation": "flat", "action": "ee_delta", "rate_hz": 10, "reward": "dense", "discount": 0.98}
    return gymnasium.make("GenManip-v0", tasks=task, layouts=TRAINED, scenes_kept=TRAINED, horizon_s=5.0, **given)


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


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("task", choices=["reach", "lift", "place"])
    arguments.add_argument("--cpu-minutes", type=float, default=20)
    arguments.add_argument("--threads", type=int, default=1, help="of PyTorch")
    arguments.add_argument("--out", type=pathlib.Path, required=True)
    given = arguments.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    torch.set_num_threads(given.threads)
    env = Monitor(make(given.task))
    model = SAC("MlpPolicy", env, gamma=0.98, learning_starts=1000, train_freq=4, gradient_steps=4, seed=1)
    with open(given.out / "curve.csv", "w", newline="") as file:
        model.learn(10_000_000, callback=Curve(given.cpu_minutes, file))
    model.save(given.out / "model")
    reached = []
    for layout in TESTED:
        seen, info = env.reset(options={"layout": layout})
        over = False
        while not over:
            seen, _, terminated, truncated, info = env.step(model.predict(seen, deterministic=True)[0])
            over = terminated or truncated
        reached.append(info["is_success"])
    print(f"{given.task}: {100 * np.mean(reached):.1f} % of {len(reached)} fresh starts, {model.num_timesteps} steps")


main()
