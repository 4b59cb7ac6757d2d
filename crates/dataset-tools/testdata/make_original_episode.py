"""Writes testdata/original: an episode as the original GenManip 0.9 records it, small, with its own libraries.

    python3 -m venv v && v/bin/pip install numpy lmdb opencv-python-headless
    v/bin/python make_original_episode.py original

Keys, types and encodings follow `Logger.save` of genmanip/demogen/recoder/render_recorder.py of that release.
"""

import pickle
import shutil
import sys
from pathlib import Path

import cv2
import lmdb
import numpy as np

STEPS, WIDTH, HEIGHT = 5, 32, 24
target = Path(sys.argv[1])
shutil.rmtree(target, ignore_errors=True)
(target / "lmdb").mkdir(parents=True)


def joints(step):
    return np.arange(9, dtype=np.float32) / 8 + step / 16


def pose(step, dtype=np.float64):
    return np.array([step / 4, -0.5, 0.25], dtype), np.array([0.0, 1.0, 0.0, 0.0], dtype)


def color(step, camera):
    image = np.full((HEIGHT, WIDTH, 3), (40 + 30 * step, 90, 200 - 60 * camera), np.uint8)
    return pickle.dumps(cv2.imencode(".jpg", image)[1])


def depth(step, camera):
    tenths = np.arange(HEIGHT * WIDTH, dtype=np.uint16).reshape(HEIGHT, WIDTH) * 7 + 10000 + 1000 * step
    tenths[0, :] = (0, 1, 4, 5, 6, 9, 10, 14, 15, 65535) + (0,) * (WIDTH - 10)
    if camera == 0:  # does not compress, and so lies on pages of its own
        tenths[1:] = np.random.default_rng(step).integers(0, 65536, (HEIGHT - 1, WIDTH), dtype=np.uint16)
    return pickle.dumps(cv2.imencode(".png", tenths)[1])


names = ["0/pre_grasp", "0/pre_grasp", "0/grasp", "0/grasp", "0/post_grasp"]
scalars = {
    "tcp_3d_trace": [[np.zeros(3)] * 4] * STEPS,
    "ee_pose_action": [pose(step + 1) for step in range(STEPS)],
    "arm_action": [joints(step + 1)[:7].tolist() for step in range(STEPS)],
    "gripper_action": [[0.04, 0.04] if step < 2 else [0.0, 0.0] for step in range(STEPS)],
    "gripper_close": [-1 if step < 2 else 1 for step in range(STEPS)],
    "name": names,
    "observation/robot/qpos": [joints(step) for step in range(STEPS)],
    "observation/robot/qvel": [np.full(9, step, np.float32) for step in range(STEPS)],
    "observation/robot/ee_pose_state": [pose(step) for step in range(STEPS)],
    "observation/robot/robot2env_pose": [np.eye(4) for _ in range(STEPS)],
    "observation/robot/joint_world_pose": [{"joint1": pose(step)} for step in range(STEPS)],
    "observation/obs_camera/bbox2d_tight": [
        np.zeros(1, dtype=[("semanticId", "<u4"), ("x_min", "<i4"), ("occlusionRatio", "<f4")]) for _ in range(STEPS)
    ],
}
for key, shift in (("mug_7", 0.5), ("table", 0.0)):
    scalars[f"observation/obj_pose/{key}/position"] = [pose(step)[0] + shift for step in range(STEPS)]
    scalars[f"observation/obj_pose/{key}/orientation"] = [pose(step)[1] for step in range(STEPS)]
    scalars[f"observation/obj_pose/{key}/scale"] = [np.ones(3)] * STEPS
for camera in ("obs_camera", "realsense"):
    scalars[f"observation/{camera}/camera2env_pose"] = [np.arange(16.0).reshape(4, 4) + step for step in range(STEPS)]

meta = {
    "max_size": 1024**4,
    "num_steps": STEPS,
    "language_instruction": "Put the mug on the plate.",
    "task_data": {
        "goal": [[{"obj1_uid": "mug_7", "obj2_uid": "plate", "position": "on"}]],
        "initial_layout": {"mug_7": {"position": np.float32(0.5), "orientation": pose(0)[1], "path": ""}},
        "frame_status": {"0/pre_grasp": 0, "0/grasp": 2, "0/post_grasp": 4},
    },
    "keys": {"json_data": [b"json_data"], "scalar_data": [key.encode() for key in scalars]},
    "task_name": "",
    "episode_name": "2025-06-05_10_00_00_000001",
}
env = lmdb.open(str(target / "lmdb"), map_size=1 << 24)
with env.begin(write=True) as txn:
    txn.put(b"json_data", pickle.dumps({"observation/tcp_config": None}))
    for key, value in scalars.items():
        txn.put(key.encode(), pickle.dumps(value))
    for number, camera in enumerate(("obs_camera", "realsense")):
        for step in range(STEPS):
            txn.put(f"observation/{camera}/color_image/{step:04d}".encode(), color(step, number))
            txn.put(f"observation/{camera}/depth_image/{step:04d}".encode(), depth(step, number))
env.close()
(target / "lmdb" / "lock.mdb").unlink()
(target / "meta_info.pkl").write_bytes(pickle.dumps(meta))
