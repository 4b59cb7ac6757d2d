"""Measures what Python costs: step overhead, memory over many resets, and many environments at once.

Usage: measure.py SCENARIOS [RESETS], in an environment with genmanip, gymnasium and numpy. Times are processor times:
on a busy machine they mean more than the clock.
"""

import pathlib
import sys
import time
import timeit

import gymnasium
import numpy as np

import genmanip


def microseconds(call, count=2000, repeats=10):
    """The best of several means."""
    return min(timeit.repeat(call, number=count, repeat=repeats, timer=time.process_time)) / count * 1e6


def overhead(suite):
    """What a step of the environment takes beside the control steps themselves, us: both conversions, both calls, the
    observation of joints and true poses."""
    env = gymnasium.make("GenManip-v0", suite=suite, index=0, rate_hz=60).unwrapped
    env.reset(seed=1)
    action, told = np.zeros(8, np.float32), (0.0, 0.0, False, False, False, None)
    seen = env.native.glance()

    def refused():
        # A call that ends where the action is looked at.
        try:
            env.native.step([0.0] * 7)
        except genmanip.Error:
            pass

    parts = {
        "action": lambda: env.setup.spaces.commanded(action),
        "call": refused,
        "told": lambda: env.setup.told(told),
        "look": env.native.glance,
        "observation": lambda: env.setup.spaces.seen(seen),
    }
    times = {name: microseconds(part) for name, part in parts.items()}
    print("step overhead:", ", ".join(f"{name} {time:.1f}" for name, time in times.items()), f"= {sum(times.values()):.1f} us")


def resets(suite, count):
    """Memory while an environment is reset again and again, with an action each."""
    env = gymnasium.make("GenManip-v0", suite=suite).unwrapped
    action = np.zeros(8, np.float32)
    for turn in range(1, count + 1):
        env.reset(seed=turn)
        env.step(action)
        if turn in (100, count // 10, count // 2, count):
            pages = int(pathlib.Path("/proc/self/statm").read_text().split()[1])
            print(f"after {turn} resets: {pages * 4096 / 1e6:.1f} MB")


def many(suite):
    """Processor time per step of one environment, and of eight on two threads; the busier thread says how much faster
    two free cores would make it."""
    for observation in ("state", "rgb"):
        costs = []
        for count, steps in ((1, 80), (8, 20)):
            given = {"suite": suite, "index": 0, "observation": observation, "size": (64, 64), "normalized": False}
            env = gymnasium.make_vec("GenManip-v0", num_envs=count, threads=min(count, 2), **given)
            actions = env.reset(seed=1)[0]["agent_pos"]
            env.step(actions)
            begun, own = time.process_time(), time.thread_time()
            for _ in range(steps):
                env.step(actions)
            whole, own = time.process_time() - begun, time.thread_time() - own
            costs.append(max(own, whole - own) / (count * steps) * 1e3)
        print(f"{observation}: one {costs[0]:.2f} ms, eight {costs[1]:.2f} ms on the busier of two threads, x {costs[0] / costs[1]:.2f}")


scenarios, *rest = sys.argv[1:]
overhead(scenarios)
many(scenarios)
resets(scenarios, int(rest[0]) if rest else 10_000)
