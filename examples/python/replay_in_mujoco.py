"""Replays an episode of a dataset in stock MuJoCo and compares the final state byte for byte.

    pip install mujoco==3.17.0 pyarrow
    genmanip export DATASET/extras/record/EPISODE/scenario.json --mjcf --out scene.xml
    python replay_in_mujoco.py DATASET/extras/record/EPISODE scene.xml

Exits with 0 when the final state is the recorded one to the last bit.
"""

import pathlib
import sys

import mujoco
import numpy as np
import pyarrow.parquet as pq

RATE_HZ, ARM = 60, 7
# The Panda's hand: each finger moves at 0.05 m/s, and closes 10 mm beyond what is asked for, so that it presses.
FINGERS_M_PER_S, OVERCLOSE_M = 2 * 0.05, 0.01


def gripper_setpoint(width, before):
    """Set point of the width drive at the end of an interval."""
    wanted = width if width >= OVERCLOSE_M else 2 * width - OVERCLOSE_M
    reach = FINGERS_M_PER_S * (1 / RATE_HZ)
    return min(max(wanted, before - reach), before + reach)


def main(episode, scene):
    episode = pathlib.Path(episode)
    model = mujoco.MjModel.from_xml_path(str(scene))
    data = mujoco.MjData(model)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    mujoco.mj_setState(model, data, np.fromfile(episode / "initial_state.f64le", "<f8"), kind)
    steps = round(1 / RATE_HZ / model.opt.timestep)
    for command in pq.read_table(episode / "frames.parquet", columns=["command"])["command"]:
        command = np.array(command.as_py(), np.float32).astype(float)
        start, target = data.ctrl.copy(), command[:ARM]
        grip = gripper_setpoint(command[ARM], start[-1])
        for step in range(1, steps + 1):
            share = step / steps
            last = step == steps
            data.ctrl[:ARM] = target if last else start[:ARM] + (target - start[:ARM]) * share
            data.ctrl[ARM : 2 * ARM] = (target - start[:ARM]) / (1 / RATE_HZ)
            data.ctrl[-1] = grip if last else start[-1] + (grip - start[-1]) * share
            mujoco.mj_step(model, data)
    state = np.empty(mujoco.mj_stateSize(model, kind))
    mujoco.mj_getState(model, data, state, kind)
    recorded = np.fromfile(episode / "final_state.f64le", "<f8")
    same = state.tobytes() == recorded.tobytes()
    print("identical" if same else f"differs by up to {np.abs(state - recorded).max():.3g}")
    return 0 if same else 1


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:3]))
