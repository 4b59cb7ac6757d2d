"""Writes small demonstrations as robomimic and LIBERO lay them out: `make_robomimic.py FOLDER`; needs h5py."""

import json
import sys
from pathlib import Path

import h5py
import numpy as np


def environment(name: str) -> str:
    arguments = {"robots": ["Panda"], "control_freq": 20}
    return json.dumps({"env_name": name, "type": 1, "env_kwargs": arguments})


def main() -> None:
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    with h5py.File(folder / "libero.hdf5", "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = environment("Libero_Floor_Manipulation")
        data.attrs["problem_info"] = json.dumps({"language_instruction": ["put the bowl on the plate"]})
        for number, frames in ((0, 5), (10, 4), (2, 6)):
            demo = data.create_group(f"demo_{number}")
            row = np.arange(frames)[:, None] + 100 * number
            demo.create_dataset("actions", data=row + 0.125 * np.arange(7)[None])
            demo.create_dataset("rewards", data=(np.arange(frames) == frames - 1).astype(np.uint8))
            demo.create_dataset("dones", data=(np.arange(frames) == frames - 1).astype(np.uint8))
            obs = demo.create_group("obs")
            obs.create_dataset("ee_pos", data=row * 0.001 + np.arange(3))
            obs.create_dataset("ee_ori", data=row * 0.001 + np.arange(3) + 3)
            obs.create_dataset("gripper_states", data=row * 0.001 + np.arange(2) + 6)
            picture = np.zeros((frames, 32, 48, 3), np.uint8)
            picture[:, :16] = (200, 30, 30)
            picture[:, 16:] = (30, 30, 200)
            obs.create_dataset("agentview_rgb", data=picture, chunks=(1, 32, 48, 3), compression="gzip")
            demo.create_dataset("states", data=np.zeros((frames, 4)))
    with h5py.File(folder / "lift.hdf5", "w") as file:
        data = file.create_group("data")
        data.attrs["env_args"] = environment("PickPlaceCan")
        demo = data.create_group("demo_1")
        demo.attrs["num_samples"] = 3
        demo.create_dataset("actions", data=np.arange(21, dtype=np.float32).reshape(3, 7))
        obs = demo.create_group("obs")
        obs.create_dataset("robot0_eef_pos", data=np.ones((3, 3)))
        obs.create_dataset("robot0_eef_quat", data=np.ones((3, 4)))
        obs.create_dataset("robot0_gripper_qpos", data=np.ones((3, 2)))
        obs.create_dataset("object", data=np.arange(30).reshape(3, 10) / 10)
    # Integers that no double holds, of several widths; and, in a folder of their own, numbers that nothing in a
    # LeRobotDataset holds.
    stamps = np.array([2**53 + 1, -(2**62) - 1, 2**63 - 1])
    observed = {
        "integers": {
            "stamp": stamps,
            "unsigned": stamps.astype(np.uint64) % 2**63,
            "big_endian": stamps.astype(">i8"),
            "short": np.array([-300, 0, 300], np.int16),
            "byte": np.array([0, 127, 255], np.uint8),
        },
        "../robomimic_refused/unsigned": {"stamp": np.array([[0, 1], [2, 2**63], [3, 4]], np.uint64)},
        "../robomimic_refused/double": {"force": np.array([0.0, -1e39, 1.0])},
    }
    (folder / "../robomimic_refused").mkdir(exist_ok=True)
    for name, columns in observed.items():
        with h5py.File(folder / f"{name}.hdf5", "w") as file:
            demo = file.create_group("data/demo_0")
            demo.create_dataset("actions", data=np.arange(3, dtype=np.float32)[:, None])
            for key, values in columns.items():
                demo.create_dataset(f"obs/{key}", data=values)
    # A group among the observations.
    with h5py.File(folder / "nested.hdf5", "w") as file:
        demo = file.create_group("data/demo_0")
        demo.create_dataset("actions", data=np.arange(3, dtype=np.float32)[:, None])
        demo.create_dataset("obs/camera/depth", data=np.ones((3, 4), np.float32))
    # Links that lead nowhere or into another file, in groups of the old format, of the present one, and of one with more
    # links than a header holds; a named type.
    for name, version, links in (("links_old", "earliest", 1), ("links_new", "latest", 1), ("links_many", "latest", 20)):
        with h5py.File(folder / f"{name}.hdf5", "w", libver=version) as file:
            data = file.create_group("data")
            data["demo_1"] = h5py.ExternalLink("elsewhere.hdf5", "/data/demo_0")
            demo = data.create_group("demo_0")
            demo.create_dataset("actions", data=np.arange(3, dtype=np.float32)[:, None])
            demo["rewards"] = h5py.SoftLink("/rewards/gone")
            demo.create_dataset("obs/joint_states", data=np.ones((3, 7)))
            demo["obs/alias"] = h5py.SoftLink("joint_states")
            demo["obs/kind"] = np.dtype("f8")
            for number in range(links):
                demo[f"obs/gone_{number}"] = h5py.SoftLink("/nowhere")
    with h5py.File(folder / "../robomimic_refused/linked.hdf5", "w") as file:
        file.create_group("data")["demo_0"] = h5py.ExternalLink("elsewhere.hdf5", "/data/demo_0")


main()
