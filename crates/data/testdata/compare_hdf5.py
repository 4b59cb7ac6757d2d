"""Reads an export in LeRobot v3.0 and one in HDF5 (robomimic's layout) and compares them.

It shares no code with the writers: pyarrow, PyAV, h5py and numpy only.

    python compare_hdf5.py V30 HDF5

Prints what was compared as JSON and exits with 0, or says what differs and exits with 1.
"""

import json
import pathlib
import sys

import av
import h5py
import numpy as np
import pyarrow.parquet as pq


def require(condition, message):
    if not condition:
        raise SystemExit(f"wrong: {message}")


def text(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def texts(dataset):
    return [text(value) for value in dataset[()]]


def matrix(column):
    column = column.combine_chunks()
    length = getattr(column.type, "list_size", 1)
    values = column.flatten() if length > 1 else column
    return values.to_numpy(zero_copy_only=False).reshape(-1, length)


def decode(path):
    with av.open(str(path)) as container:
        return np.array([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])


def main():
    v30, demos = map(pathlib.Path, sys.argv[1:3])
    info = json.loads((v30 / "meta/info.json").read_text())
    contract = json.loads((v30 / "meta/action_contract.json").read_text())
    episodes = pq.read_table(v30 / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    table = pq.read_table(v30 / "data/chunk-000/file-000.parquet")
    subtasks = pq.read_table(v30 / "meta/subtasks.parquet")["subtask"].to_pylist()
    videos = {
        key: decode(v30 / info["video_path"].format(video_key=key, chunk_index=0, file_index=0))
        for key, feature in info["features"].items()
        if feature["dtype"] == "video"
    }
    compared = {"episodes": 0, "columns": 0, "pictures": 0}
    require(len(list(demos.glob("*.hdf5"))) == len(episodes), "number of files")
    for episode in episodes:
        first, length = episode["dataset_from_index"], episode["length"]
        rows = table.slice(first, length)
        with h5py.File(demos / f"{episode['store_id']}.hdf5") as file:
            about = json.loads(text(file["data"].attrs["env_args"]))
            named = {key: contract[key] for key in ("action", "rate_hz", "names")}
            require({key: about["action_contract"][key] for key in named} == named, about)
            require(file["data"].attrs["total"] == length and list(file["data"]) == ["demo_0"], "demonstrations")
            demo = file["data/demo_0"]
            require(demo.attrs["num_samples"] == length and demo.attrs["seed"] == episode["seed"], "num_samples, seed")
            require(text(demo.attrs["instruction"]) == episode["tasks"][0], "instruction")
            require(bool(demo.attrs["success"]) == episode["success"], "success")
            done = rows["next.done"].to_numpy(zero_copy_only=False)
            require(np.array_equal(demo["dones"][()].astype(bool), done), "dones")
            require(demo["rewards"][()].sum() == episode["success"], "rewards")
            said = [texts(demo["subtasks"])[step] for step in demo["subtask"][()]]
            require(said == [subtasks[step] for step in rows["subtask_index"].to_pylist()], f"steps {said}")
            require(texts(demo["paraphrases"]) == episode["paraphrases"], "paraphrases")
            require(json.loads(texts(demo["scenario_json"])[0]) == json.loads(episode["scenario_json"]), "scenario")
            for key in demo["columns"]:
                values = matrix(rows[key])
                found = demo[f"columns/{key}"][()].reshape(values.shape)
                require(np.array_equal(found.astype(values.dtype), values), f"{key} of {episode['store_id']}")
                compared["columns"] += 1
            require(np.array_equal(demo["actions"][()], matrix(rows["action"])), "actions")
            state = matrix(rows["observation.state"])
            obs = demo["obs"]
            require(np.array_equal(obs["robot0_joint_pos"][()].astype(np.float32), state[:, :-1]), "joint positions")
            require(np.allclose(obs["robot0_gripper_qpos"][()].sum(1), state[:, -1], atol=1e-7), "fingers")
            tool = matrix(rows["ee.state"])
            require(np.array_equal(obs["robot0_eef_pos"][()].astype(np.float32), tool[:, :3]), "position of the tool")
            ours, theirs = obs["robot0_eef_quat"][()][:, [3, 0, 1, 2]], matrix(rows["ee.quaternion"])
            require(np.allclose(np.abs((ours * theirs).sum(1)), 1, atol=1e-6), "rotation of the tool")
            for key, frames in videos.items():
                pictures = obs[f"{key.removeprefix('observation.images.')}_image"][()]
                require(pictures.dtype == np.uint8 and pictures.shape == (length, *frames.shape[1:]), pictures.shape)
                span = round(episode[f"videos/{key}/from_timestamp"] * info["fps"])
                for row, picture in enumerate(pictures):
                    # Two decoders interpolate chroma differently, so single pixels differ, and pictures hardly.
                    far = np.abs(picture.astype(int) - frames[span + row].astype(int)).mean()
                    require(far < 3.0, f"{key} of {episode['store_id']}, row {row}: {far}")
                    compared["pictures"] += 1
        compared["episodes"] += 1
    print(json.dumps(compared))


main()
