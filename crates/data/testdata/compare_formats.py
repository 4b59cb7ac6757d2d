"""Reads one export in LeRobot v3.0, LeRobot v2.1 and zarr, each by its own description, and compares them.

It shares no code with the writers: pyarrow, PyAV and numpy only.

    python compare_formats.py V30 V21 ZARR

Prints what was compared as JSON and exits with 0, or says what differs and exits with 1.
"""

import io
import json
import pathlib
import sys
import zlib

import av
import numpy as np
import pyarrow.parquet as pq


def require(condition, message):
    if not condition:
        raise SystemExit(f"wrong: {message}")


def lines(path):
    return [json.loads(line) for line in path.read_text().splitlines()]


def columns(table, keys):
    """Columns as arrays of shape (rows, length)."""
    found = {}
    for key in keys:
        column = table[key].combine_chunks()
        length = getattr(column.type, "list_size", 1)
        values = column.flatten() if length > 1 else column
        found[key] = values.to_numpy(zero_copy_only=False).reshape(-1, length)
    return found


def decode(path):
    with av.open(str(path)) as container:
        return np.array([frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)])


def numbers(features):
    return [key for key, feature in features.items() if feature["dtype"] not in ("video", "image")]


def videos(features):
    return [key for key, feature in features.items() if feature["dtype"] == "video"]


def row_of(table, index):
    """Where a frame lies in the file of its episode."""
    return table["index"].to_pylist().index(index)


def read_v30(root):
    info = json.loads((root / "meta/info.json").read_text())
    require(info["codebase_version"] == "v3.0", info["codebase_version"])
    episodes = []
    for path in sorted((root / "meta/episodes").glob("*/*.parquet")):
        episodes += pq.read_table(path).to_pylist()
    tasks = pq.read_table(root / "meta/tasks.parquet")
    found = []
    for episode in episodes:
        place = {"chunk_index": episode["data/chunk_index"], "file_index": episode["data/file_index"]}
        table = pq.read_table(root / info["data_path"].format(**place))
        rows = table.slice(row_of(table, episode["dataset_from_index"]), episode["length"])
        pictures = {}
        for key in videos(info["features"]):
            place = {name: episode[f"videos/{key}/{name}"] for name in ("chunk_index", "file_index")}
            frames = decode(root / info["video_path"].format(video_key=key, **place))
            first = round(episode[f"videos/{key}/from_timestamp"] * info["fps"])
            pictures[key] = frames[first : first + episode["length"]]
        found.append(
            {
                "rows": columns(rows, numbers(info["features"])),
                "pictures": pictures,
                "task": episode["tasks"][0],
                "subtasks": episode["subtasks"],
                "paraphrases": episode["paraphrases"],
                "success": episode["success"],
                "seed": episode["seed"],
            }
        )
    require(len(tasks) == info["total_tasks"], "tasks")
    return info, found


def read_v21(root):
    info = json.loads((root / "meta/info.json").read_text())
    require(info["codebase_version"] == "v2.1", info["codebase_version"])
    tasks = {task["task_index"]: task["task"] for task in lines(root / "meta/tasks.jsonl")}
    require(len(tasks) == info["total_tasks"], "tasks.jsonl")
    statistics = lines(root / "meta/episodes_stats.jsonl")
    found = []
    for episode in lines(root / "meta/episodes.jsonl"):
        index = episode["episode_index"]
        place = {"episode_index": index, "episode_chunk": index // info["chunks_size"]}
        table = pq.read_table(root / info["data_path"].format(**place))
        rows = columns(table, numbers(info["features"]))
        require(table.num_rows == episode["length"], f"length of episode {index}")
        sentences = {tasks[int(task)] for task in rows["task_index"][:, 0]}
        require(sentences == set(episode["tasks"]), f"tasks of episode {index}")
        require(statistics[index]["episode_index"] == index, f"statistics of episode {index}")
        for key in info["features"]:
            own = statistics[index]["stats"][key]
            require(set(own) == {"min", "max", "mean", "std", "count"}, f"statistics of {key}: {sorted(own)}")
            if key in rows:
                close = np.allclose(own["mean"], rows[key].astype(np.float64).mean(0), rtol=1e-6, atol=1e-9)
                require(close and own["count"] == [table.num_rows], f"statistics of {key} in episode {index}")
            else:
                require(np.array(own["mean"]).shape == (3, 1, 1), f"statistics of {key}")
        paths = {key: root / info["video_path"].format(video_key=key, **place) for key in videos(info["features"])}
        pictures = {key: decode(path) for key, path in paths.items()}
        found.append(
            {
                "rows": rows,
                "pictures": pictures,
                "task": episode["tasks"][0],
                "subtasks": episode["subtasks"],
                "paraphrases": episode["paraphrases"],
                "success": episode["success"],
                "seed": episode["seed"],
            }
        )
    require(info["total_episodes"] == len(found), "total_episodes")
    require(info["total_videos"] == len(found) * len(videos(info["features"])), "total_videos")
    check_modality(json.loads((root / "meta/modality.json").read_text()), info)
    check_norm_stats(json.loads((root / "norm_stats.json").read_text())["norm_stats"], found)
    return info, found


def check_modality(modality, info):
    """The slices of state and action cover their columns without gaps; videos and annotations name columns."""
    for kind, key in (("state", "observation.state"), ("action", "action")):
        end = 0
        for part in modality[kind].values():
            require(part["start"] == end < part["end"], f"modality of {kind}: {modality[kind]}")
            end = part["end"]
        require(end == info["features"][key]["shape"][0], f"modality of {kind} ends at {end}")
    originals = {part["original_key"] for part in modality["video"].values()}
    require(originals == set(videos(info["features"])), f"modality of videos: {originals}")
    require(all(part["original_key"] in info["features"] for part in modality["annotation"].values()), "annotations")


def check_norm_stats(stats, episodes):
    for name, key in (("state", "observation.state"), ("actions", "action")):
        values = np.concatenate([episode["rows"][key] for episode in episodes]).astype(np.float64)
        expected = {"mean": values.mean(0), "std": values.std(0)}
        expected |= {"q01": np.quantile(values, 0.01, axis=0), "q99": np.quantile(values, 0.99, axis=0)}
        for which, wanted in expected.items():
            require(np.allclose(stats[name][which], wanted, rtol=1e-6, atol=1e-9), f"norm_stats of {name}: {which}")


def read_array(folder):
    about = json.loads((folder / ".zarray").read_text())
    require(about["zarr_format"] == 2 and about["order"] == "C" and about["filters"] is None, f"{folder}: {about}")
    shape, chunk = about["shape"], about["chunks"]
    require(shape[1:] == chunk[1:], f"{folder}: chunks {chunk} of {shape}")
    parts = []
    for number in range(-(-shape[0] // chunk[0])):
        packed = (folder / ".".join([str(number)] + ["0"] * (len(shape) - 1))).read_bytes()
        parts.append(np.frombuffer(zlib.decompress(packed), about["dtype"]).reshape(chunk))
    return np.concatenate(parts)[: shape[0]] if parts else np.zeros(shape, about["dtype"])


def read_zarr(root):
    for folder in (root, root / "data", root / "meta"):
        require(json.loads((folder / ".zgroup").read_text()) == {"zarr_format": 2}, f"{folder}/.zgroup")
    about = json.loads((root / ".zattrs").read_text())
    arrays = {path.parent.name: read_array(path.parent) for path in sorted((root / "data").glob("*/.zarray"))}
    ends = read_array(root / "meta/episode_ends")
    require(all(len(array) == ends[-1] for array in arrays.values()), "lengths of the arrays")
    starts = [0, *ends[:-1]]
    cut = [{key: array[start:end] for key, array in arrays.items()} for start, end in zip(starts, ends)]
    return about, cut


def check_colors(ours, theirs, where):
    """Two decoders interpolate chroma differently, so single pixels at edges differ, and pictures hardly."""
    require(ours.shape == theirs.shape, f"{where}: {ours.shape} and {theirs.shape}")
    for index, picture in enumerate(ours):
        far = [np.abs(picture.astype(int) - other.astype(int)).mean() for other in theirs]
        require(int(np.argmin(far)) == index and far[index] < 3.0, f"{where}: frame {index} is {far}")


def main():
    v30, v21, zarr = map(pathlib.Path, sys.argv[1:4])
    info30, episodes30 = read_v30(v30)
    info21, episodes21 = read_v21(v21)
    about, cut = read_zarr(zarr)
    subtasks30 = pq.read_table(v30 / "meta/subtasks.parquet")["subtask"].to_pylist()
    subtasks21 = [line["subtask"] for line in lines(v21 / "meta/subtasks.jsonl")]
    require(info30["features"] == info21["features"] and info30["fps"] == info21["fps"] == about["rate_hz"], "features")
    require(len(episodes30) == len(episodes21) == len(cut) == len(about["episodes"]), "numbers of episodes")
    compared = {"episodes": len(cut), "columns": 0, "pictures": 0, "depth": 0}
    for index, (a, b, c, entry) in enumerate(zip(episodes30, episodes21, cut, about["episodes"])):
        for key in ("task", "success", "seed", "subtasks", "paraphrases"):
            name = {"task": "instruction"}.get(key, key)
            require(a[key] == b[key] == entry[name], f"{key} of episode {index}: {a[key]}, {b[key]}, {entry[name]}")
        for key, values in a["rows"].items():
            require(np.array_equal(values, b["rows"][key]), f"{key} of episode {index} in v2.1")
            if key in c:
                require(np.array_equal(values, c[key].reshape(values.shape)), f"{key} of episode {index} in zarr")
                compared["columns"] += 1
        steps = [entry["subtasks"][step] for step in c["subtask"]]
        for which, rows, subtasks in (("v3.0", a, subtasks30), ("v2.1", b, subtasks21)):
            said = [subtasks[int(step)] for step in rows["rows"]["subtask_index"][:, 0]]
            require(said == steps, f"steps of episode {index} in {which}: {said}, in zarr {steps}")
        require({"action", "observation.state"} <= set(c), f"zarr has {sorted(c)}")
        for key, frames in a["pictures"].items():
            require(len(frames) == len(a["rows"]["action"]), f"{key} of episode {index}")
            require(np.array_equal(frames, b["pictures"][key]), f"{key} of episode {index} in v2.1")
            check_colors(frames, c[key], f"{key} of episode {index}")
            compared["pictures"] += len(frames)
        compared["depth"] += sum(len(array) for key, array in c.items() if key.endswith("_depth"))
    depth = pathlib.Path(f"{v30}-depth")
    if depth.exists():
        check_depth(depth, cut)
    print(json.dumps(compared))


def check_depth(root, cut):
    """Depth pictures of the sibling data set, bit for bit."""
    row = 0
    arrays = {key: np.concatenate([part[key] for part in cut]) for key in cut[0] if key.endswith("_depth")}
    for path in sorted((root / "data").glob("*/*.parquet")):
        table = pq.read_table(path)
        for entry in table.to_pylist():
            for key, array in arrays.items():
                with av.open(io.BytesIO(entry[key]["bytes"]), format="png_pipe") as container:
                    picture = next(container.decode(video=0)).to_ndarray()
                require(np.array_equal(picture, array[row]), f"{key}: picture {row}")
            row += 1


main()
