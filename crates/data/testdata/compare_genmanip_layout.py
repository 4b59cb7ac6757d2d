"""Reads an export in the paper's layout with numpy and PyAV, and compares it with the LeRobot v3.0 export of the same run.

Usage: compare_paper.py V30 PAPER
"""

import json
import pathlib
import sys

import av
import numpy as np
import pyarrow.parquet as pq


def picture(path):
    with av.open(str(path)) as container:
        return next(container.decode(video=0))


def main(v30, paper):
    episodes = pq.read_table(v30 / "meta/episodes").to_pylist()
    rows = pq.read_table(v30 / "data").to_pylist()
    depths = pq.read_table(v30.with_name(v30.name + "-depth") / "data").to_pylist()
    videos = {}
    for camera in ["static", "wrist"]:
        frames = []
        for path in sorted((v30 / f"videos/observation.images.{camera}").rglob("*.mp4")):
            with av.open(str(path)) as container:
                frames += [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
        videos[camera] = frames
    assert sorted(path.name for path in paper.iterdir()) == sorted(episode["store_id"] for episode in episodes)
    worst, pictures = 0.0, 0
    for episode in episodes:
        folder = paper / episode["store_id"]
        about = json.loads((folder / "meta_info.json").read_text())
        assert about["language_instruction"] == episode["tasks"][0]
        assert (about["num_steps"], about["seed"], about["success"]) == (
            episode["length"],
            episode["seed"],
            episode["success"],
        )
        own = rows[episode["dataset_from_index"] : episode["dataset_to_index"]]
        load = lambda name: np.load(folder / f"{name}.npy", allow_pickle=False)
        state = np.array([row["observation.state"] for row in own])
        action = np.array([row["action"] for row in own])
        qpos, arm, gripper = load("observation/robot/qpos"), load("arm_action"), load("gripper_action")
        assert np.array_equal(qpos[:, :7].astype(np.float32), state[:, :7].astype(np.float32))
        assert np.allclose(qpos[:, 7:].sum(1), state[:, 7], atol=1e-7)
        assert np.array_equal(arm.astype(np.float32), action[:, :7].astype(np.float32))
        assert np.allclose(gripper.sum(1), action[:, 7], atol=1e-7)
        assert np.array_equal(load("gripper_close"), np.where(action[:, 7] < 0.04, 1.0, -1.0))
        assert np.allclose(load("ee_pose_action")[:, :3], np.array([row["ee.action"] for row in own])[:, :3], atol=1e-6)
        assert np.allclose(load("observation/robot/ee_pose_state")[:, :3], np.array([r["ee.state"] for r in own])[:, :3])
        assert np.allclose(np.diff(arm, axis=0), load("delta_arm_action")[1:], atol=1e-12)
        scenario = json.loads(episode["scenario_json"])
        for thing in scenario["objects"]:
            position = load(f"observation/obj_pose/{thing['id']}/position")
            orientation = load(f"observation/obj_pose/{thing['id']}/orientation")
            assert position.shape == (len(own), 3)
            assert np.allclose(np.linalg.norm(orientation, axis=1), 1.0)
        for camera in ["static", "wrist"]:
            poses = load(f"observation/{camera}/camera2env_pose")
            told = np.array([row[f"camera.{camera}.world_from_camera"] for row in own])
            assert np.array_equal(poses[:, :3, 3], told[:, :3])
            assert np.allclose(poses[:, :3, :3] @ poses[:, :3, :3].transpose(0, 2, 1), np.eye(3))
            colors = sorted((folder / f"observation/{camera}/color_image").iterdir())
            files = sorted((folder / f"observation/{camera}/depth_image").iterdir())
            assert [path.name for path in colors] == [f"{row:04}.jpg" for row in range(len(own))]
            assert len(files) == len(own)
            for row, (color, depth) in enumerate(zip(colors, files)):
                index = episode["dataset_from_index"] + row
                shown = picture(color).to_ndarray(format="rgb24").astype(float)
                worst = max(worst, np.abs(shown - videos[camera][index]).mean())
                # Sixteen bits, as they are in the depth data set.
                assert depth.read_bytes() == depths[index][f"observation.images.{camera}_depth"]["bytes"]
                assert picture(depth).format.name == "gray16be"
                pictures += 1
    print(json.dumps({"episodes": len(episodes), "pictures": pictures, "worst_color": worst}))


main(*map(pathlib.Path, sys.argv[1:3]))
