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


def many(suite, repeats=5):
    """Time per step of one environment, and of eight on two threads, in turn: how much more eight do by the clock,
    which needs two cores at rest, and by processor time, where the busier thread says what two free cores would do."""
    for observation in ("state", "rgb"):
        given = {"suite": suite, "index": 0, "observation": observation, "size": (64, 64), "normalized": False}
        kinds = []
        for count, steps in ((1, 160), (8, 40)):
            env = gymnasium.make_vec("GenManip-v0", num_envs=count, threads=min(count, 2), **given)
            actions = env.reset(seed=1)[0]["agent_pos"]
            env.step(actions)
            kinds.append((env, actions, count, steps))
        ratios = []
        for _ in range(repeats):
            costs = []
            for env, actions, count, steps in kinds:
                clock, begun, own = time.perf_counter(), time.process_time(), time.thread_time()
                for _ in range(steps):
                    env.step(actions)
                clock = time.perf_counter() - clock
                whole, own = time.process_time() - begun, time.thread_time() - own
                costs.append(np.array([clock, max(own, whole - own)]) / (count * steps) * 1e3)
            ratios.append(costs[0] / costs[1])
        clock, busier = np.median(ratios, axis=0)
        print(
            f"{observation}: one {costs[0][0]:.2f} ms, eight {costs[1][0]:.2f} ms per step; medians of {repeats}: "
            f"x {clock:.2f} by the clock, x {busier:.2f} by processor time of the busier of two threads"
        )


scenarios, *rest = sys.argv[1:]
overhead(scenarios)
many(scenarios)
resets(scenarios, int(rest[0]) if rest else 10_000)
