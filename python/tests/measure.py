"""Measures what Python costs: memory over many resets, step overhead, and many environments at once.

Usage: measure.py SCENARIOS [RESETS], in an environment with genmanip, gymnasium and numpy. Times are processor times,
which mean more than the clock on a busy machine; many environments at once want a machine at rest.
"""

import pathlib
import sys
import threading
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
        "observation": lambda: env.setup.spaces.seen(seen, env._goal),
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


def seconds(call):
    begun = time.perf_counter()
    call()
    return time.perf_counter() - begun


def many(suite, repeats=20):
    """Steps per second of eight environments on two threads and of two that know nothing of each other, over those of
    one, in turn: what the pool makes of two cores, and what two cores at rest give at all. By the clock."""
    for observation in ("state", "rgb"):
        given = {"suite": suite, "index": 0, "observation": observation, "size": (64, 64), "normalized": False}

        def stepping(count, steps, seed=1):
            env = gymnasium.make_vec("GenManip-v0", num_envs=count, threads=min(count, 2), **given)
            actions = env.reset(seed=seed)[0]["agent_pos"]
            env.step(actions)
            return lambda: [env.step(actions) for _ in range(steps)]

        one, eight, free = stepping(1, 120), stepping(8, 20), [stepping(1, 80, seed) for seed in (1, 2)]
        ratios = []
        for _ in range(repeats):
            alone, pooled, rates = 120 / seconds(one), 160 / seconds(eight), []
            threads = [threading.Thread(target=lambda call=call: rates.append(80 / seconds(call))) for call in free]
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
            ratios.append((pooled / alone, sum(rates) / alone))
        pooled, both = np.median(ratios, axis=0)
        print(f"{observation}: {1e3 / alone:.2f} ms per step; eight x {pooled:.2f}, two without each other x {both:.2f}")


scenarios, *rest = sys.argv[1:]
# First, since the environments of the other measurements stay in memory.
resets(scenarios, int(rest[0]) if rest else 10_000)
overhead(scenarios)
many(scenarios)
