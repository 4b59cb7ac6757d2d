"""Checks a LeRobotDataset v3.0 (and its `-depth` sibling) with pyarrow, PyAV and numpy only.

It shares no code with the writer: it follows the format's description and decodes everything.

    python read_lerobot.py DATASET [--expected FILE]

Prints a summary as JSON and exits with 0, or says what is wrong and exits with 1.
`--expected` names a JSON file with frames and pictures to compare with; the tests of the writer use it.
"""

import argparse
import io
import json
import pathlib
import sys

import av
import numpy as np
import pyarrow.parquet as pq

QUANTILES = {"q01": 0.01, "q10": 0.10, "q50": 0.50, "q90": 0.90, "q99": 0.99}
INDICES = ["timestamp", "frame_index", "episode_index", "index", "task_index"]
ARROW_TYPES = {"float32": "float", "float64": "double", "int64": "int64", "bool": "bool"}


def require(condition, message):
    if not condition:
        raise SystemExit(f"wrong: {message}")


def read_tables(root, pattern):
    """All tables under a folder in the order of their names, by (chunk, file)."""
    tables = {}
    for path in sorted(root.glob(pattern)):
        place = (int(path.parent.name.removeprefix("chunk-")), int(path.stem.removeprefix("file-")))
        tables[place] = pq.ParquetFile(path)
    require(tables, f"no files {pattern} in {root}")
    return tables


def read_sentences(root, name):
    """Sentences by index; the sentence must be the index of the pandas frame."""
    table = pq.read_table(root / f"meta/{name}s.parquet")
    pandas = json.loads((table.schema.metadata or {}).get(b"pandas", b"{}"))
    require(pandas.get("index_columns") == [name], f"{name}s.parquet: index columns {pandas.get('index_columns')}")
    indices = table[f"{name}_index"].to_pylist()
    require(indices == list(range(table.num_rows)), f"{name} indices {indices}")
    return table[name].to_pylist()


def check_steps(rows, episode, subtasks):
    """Each row is in a step of its episode, and the steps come in their order."""
    said = [subtasks[index] for index in rows["subtask_index"].to_pylist()]
    turns = [text for place, text in enumerate(said) if place == 0 or text != said[place - 1]]
    listed = iter(episode["subtasks"])
    in_order = all(any(text == known for known in listed) for text in turns)
    require(in_order, f"episode {episode['episode_index']}: steps {turns}, listed {episode['subtasks']}")


def check_info(info):
    require(info["codebase_version"] == "v3.0", f"version {info['codebase_version']}")
    require(info["splits"] == {"train": f"0:{info['total_episodes']}"}, f"splits {info['splits']}")
    for key, feature in info["features"].items():
        require("/" not in key, f"feature name {key}")
        require(set(feature) >= {"dtype", "shape", "names"}, f"feature {key}: {feature}")
        if feature["dtype"] == "video":
            height, width, channels = feature["shape"]
            described = feature["info"]
            require(channels == 3 and described["video.fps"] == info["fps"], f"feature {key}: {feature}")
            require((described["video.height"], described["video.width"]) == (height, width), f"feature {key}")
    for key in INDICES:
        require(info["features"][key]["shape"] == [1], f"feature {key}")


def check_data_schema(schema, features):
    columns = {key: feature for key, feature in features.items() if feature["dtype"] != "video"}
    require(set(schema.names) == set(columns), f"data columns {schema.names}, features {sorted(columns)}")
    for key, feature in columns.items():
        arrow = str(schema.field(key).type)
        if feature["dtype"] == "image":
            require(arrow == "struct<bytes: binary, path: string>", f"column {key}: {arrow}")
            continue
        scalar = ARROW_TYPES[feature["dtype"]]
        length = feature["shape"][0]
        if length == 1:
            require(arrow == scalar, f"column {key}: {arrow}, expected {scalar}")
        else:
            field = schema.field(key).type
            good = field.list_size == length and str(field.value_type) == scalar
            require(good, f"column {key}: {arrow}, expected {length} × {scalar}")


def matrix(column, length):
    """A column as an array of shape (rows, length)."""
    column = column.combine_chunks()
    if length > 1:
        column = column.flatten()
    return column.to_numpy(zero_copy_only=False).reshape(-1, length)


def check_rows(rows, episode, fps, tasks):
    """Indices and times of one episode's row group."""
    length, first = episode["length"], episode["dataset_from_index"]
    number = episode["episode_index"]
    require(rows.num_rows == length, f"episode {number}: row group of {rows.num_rows} rows, length {length}")
    require(episode["dataset_to_index"] == first + length, f"episode {number}: dataset_to_index")
    require(rows["index"].to_pylist() == list(range(first, first + length)), f"episode {number}: index")
    require(rows["frame_index"].to_pylist() == list(range(length)), f"episode {number}: frame_index")
    require(set(rows["episode_index"].to_pylist()) == {number}, f"episode {number}: episode_index")
    times = rows["timestamp"].to_numpy()
    require(np.array_equal(times, (np.arange(length) / fps).astype(np.float32)), f"episode {number}: timestamps")
    sentences = {tasks[index] for index in rows["task_index"].to_pylist()}
    require(sentences == set(episode["tasks"]), f"episode {number}: tasks {sentences} and {episode['tasks']}")
    if "next.done" in rows.column_names:
        done = rows["next.done"].to_pylist()
        require(done == [False] * (length - 1) + [True], f"episode {number}: next.done {done}")


def statistics(values):
    found = {"min": values.min(0), "max": values.max(0), "mean": values.mean(0), "std": values.std(0)}
    found.update({name: np.quantile(values, q, axis=0) for name, q in QUANTILES.items()})
    return found


def check_statistics(stats, values, where):
    require(stats["count"] == [len(values)], f"{where}: count {stats['count']}, expected {len(values)}")
    for name, expected in statistics(values.astype(np.float64)).items():
        close = np.allclose(stats[name], expected, rtol=1e-6, atol=1e-9)
        require(close, f"{where}: {name} {stats[name]}, expected {expected}")


def decode(path):
    """All frames of a video as RGB, and their times in seconds."""
    frames, times = [], []
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        require(stream.codec_context.name == "h264", f"{path}: codec {stream.codec_context.name}")
        for frame in container.decode(stream):
            frames.append(frame.to_ndarray(format="rgb24"))
            times.append(float(frame.pts * stream.time_base))
    return np.array(frames), np.array(times)


def check_color_statistics(stats, shape, where):
    for name in ["min", "max", "mean", "std", *QUANTILES]:
        values = np.array(stats[name])
        require(values.shape == (3, 1, 1) and (0 <= values).all() and (values <= 1).all(), f"{where}: {name} {values}")
    require(stats["count"] == [shape], f"{where}: count {stats['count']}, expected {shape}")


class Dataset:
    """Everything in a data set, checked while it is read."""

    def __init__(self, root):
        self.root = root
        self.info = json.loads((root / "meta/info.json").read_text())
        self.features = self.info["features"]
        check_info(self.info)
        self.tasks = read_sentences(root, "task")
        require(len(self.tasks) == self.info["total_tasks"], f"{len(self.tasks)} tasks")
        has_steps = "subtask_index" in self.info["features"]
        self.subtasks = read_sentences(root, "subtask") if has_steps else []
        self.stats = json.loads((root / "meta/stats.json").read_text())
        self.episodes = self._read_episodes()
        self.rows = self._read_rows()

    def keys(self, dtype):
        return [key for key, feature in self.features.items() if feature["dtype"] == dtype]

    def _read_episodes(self):
        episodes = []
        for (chunk, file), table in read_tables(self.root, "meta/episodes/*/*.parquet").items():
            for episode in table.read().to_pylist():
                place = (episode["meta/episodes/chunk_index"], episode["meta/episodes/file_index"])
                require(place == (chunk, file), f"episode {episode['episode_index']}: its row is in {chunk, file}")
                episodes.append(episode)
        numbers = [episode["episode_index"] for episode in episodes]
        require(numbers == list(range(self.info["total_episodes"])), f"episode indices {numbers}")
        firsts = np.cumsum([0] + [episode["length"] for episode in episodes])
        require(firsts[-1] == self.info["total_frames"], f"{firsts[-1]} frames, info says {self.info['total_frames']}")
        for episode, first in zip(episodes, firsts):
            require(episode["dataset_from_index"] == first, f"episode {episode['episode_index']}: dataset_from_index")
        return episodes

    def _read_rows(self):
        tables = read_tables(self.root, "data/*/*.parquet")
        groups = {place: 0 for place in tables}
        rows = []
        for episode in self.episodes:
            place = (episode["data/chunk_index"], episode["data/file_index"])
            check_data_schema(tables[place].schema_arrow, self.features)
            group = tables[place].read_row_group(groups[place])
            groups[place] += 1
            check_rows(group, episode, self.info["fps"], self.tasks)
            if self.subtasks:
                check_steps(group, episode, self.subtasks)
            rows.append(group)
        for place, table in tables.items():
            require(table.num_row_groups == groups[place], f"data file {place}: {table.num_row_groups} row groups")
        return rows

    def check_numbers(self):
        """Statistics of every numeric feature, per episode and of the whole."""
        for key, feature in self.features.items():
            if feature["dtype"] in ("video", "image"):
                continue
            values = [matrix(rows[key], feature["shape"][0]) for rows in self.rows]
            check_statistics(self.stats[key], np.concatenate(values), f"stats.json {key}")
            for episode, numbers in zip(self.episodes, values):
                names = [*QUANTILES, "min", "max", "mean", "std", "count"]
                stats = {name: episode[f"stats/{key}/{name}"] for name in names}
                check_statistics(stats, numbers, f"episode {episode['episode_index']} {key}")

    def check_videos(self):
        """Every frame of every episode; returns the pictures by (key, index in the data set)."""
        pictures = {}
        fps, total = self.info["fps"], self.info["total_frames"]
        for key in self.keys("video"):
            height, width, _ = self.features[key]["shape"]
            check_color_statistics(self.stats[key], total, f"stats.json {key}")
            files = {}
            for episode in self.episodes:
                chunk, file = episode[f"videos/{key}/chunk_index"], episode[f"videos/{key}/file_index"]
                path = self.root / self.info["video_path"].format(video_key=key, chunk_index=chunk, file_index=file)
                frames, times = files.setdefault(path, None) or decode(path)
                files[path] = (frames, times)
                require(frames.shape[1:] == (height, width, 3), f"{path}: frames of {frames.shape}")
                start, end = episode[f"videos/{key}/from_timestamp"], episode[f"videos/{key}/to_timestamp"]
                require(abs((end - start) * fps - episode["length"]) < 1e-6, f"{path}: {start} to {end} s")
                rows = self.rows[episode["episode_index"]]
                for index, time in zip(rows["index"].to_pylist(), rows["timestamp"].to_pylist()):
                    nearest = int(np.argmin(np.abs(times - (start + time))))
                    require(abs(times[nearest] - (start + time)) < 1e-4, f"{path}: no frame at {start + time} s")
                    pictures[key, index] = frames[nearest]
            for path, (frames, _) in files.items():
                used = sum(e["length"] for e in self.episodes if self._video_path(key, e) == path)
                require(len(frames) == used, f"{path}: {len(frames)} frames, episodes have {used}")
        return pictures

    def _video_path(self, key, episode):
        place = {"chunk_index": episode[f"videos/{key}/chunk_index"], "file_index": episode[f"videos/{key}/file_index"]}
        return self.root / self.info["video_path"].format(video_key=key, **place)

    def check_depths(self):
        """Every depth picture in millimetres by (key, index in the data set)."""
        pictures = {}
        for key in self.keys("image"):
            height, width, _ = self.features[key]["shape"]
            require(self.features[key]["info"] == {"is_depth_map": True, "depth_unit": "mm"}, f"feature {key}")
            for rows in self.rows:
                for index, picture in zip(rows["index"].to_pylist(), rows[key].to_pylist()):
                    pictures[key, index] = decode_png(picture["bytes"])
                    require(pictures[key, index].shape == (height, width), f"{key} {index}")
        return pictures


def decode_png(data):
    with av.open(io.BytesIO(data), format="png_pipe") as container:
        frame = next(container.decode(video=0))
        require(frame.format.name == "gray16be", f"depth picture is {frame.format.name}")
        return frame.to_ndarray().astype(np.uint16)


def check_expected(expected, dataset, videos, depths):
    """Chosen frames against what the test wrote; returns the largest mean colour error of a picture."""
    shape = (expected["height"], expected["width"])
    largest = 0.0
    for frame in expected["frames"]:
        index, episode, row = frame["index"], frame["episode"], frame["row"]
        rows, facts = dataset.rows[episode], dataset.episodes[episode]
        for key, name in [("observation.state", "state"), ("action", "action")]:
            found = np.array(rows[key][row].as_py())
            require(np.allclose(found, np.float32(frame[name]), rtol=0, atol=1e-7), f"frame {index}: {key} {found}")
        require(dataset.tasks[rows["task_index"][row].as_py()] == frame["task"], f"frame {index}: task")
        require(facts["seed"] == frame["seed"] and facts["success"], f"episode {episode}: seed or success")
        require(facts["variation_seed"] == frame["variation_seed"], f"episode {episode}: seed of its look")
        require(rows["is_correction"][row].as_py() == frame["is_correction"], f"frame {index}: is_correction")
        corrected = [facts[f"corrected_{what}"] for what in ["policy", "cause", "from_step"]]
        require(corrected == frame["corrected"], f"episode {episode}: corrected {corrected}")
        require(json.loads(facts["scenario_json"]) == frame["scenario"], f"episode {episode}: scenario")
        for camera, files in frame["images"].items():
            written = np.fromfile(files["rgb"], np.uint8).reshape(*shape, 3)
            key = f"observation.images.{camera}"
            largest = max(largest, color_error(written, videos[key, index]))
            others = [other for other in range(index - 1, index + 2) if (key, other) in videos]
            best = min(others, key=lambda other: color_error(written, videos[key, other]))
            require(best == index, f"{key}: frame {index} shows frame {best}")
            if depths:
                millimetres = np.fromfile(files["depth_mm"], "<u2").reshape(shape)
                same = np.array_equal(millimetres, depths[f"{key}_depth", index])
                require(same, f"{key}_depth: frame {index} differs")
    return largest


def color_error(a, b):
    """Mean absolute difference, 0-255."""
    return float(np.mean(np.abs(a.astype(np.int16) - b.astype(np.int16))))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=pathlib.Path)
    parser.add_argument("--expected", type=pathlib.Path)
    arguments = parser.parse_args()

    dataset = Dataset(arguments.dataset)
    dataset.check_numbers()
    videos = dataset.check_videos()
    depths = {}
    depth_root = arguments.dataset.with_name(arguments.dataset.name + "-depth")
    if depth_root.exists():
        depth = Dataset(depth_root)
        for key in ["episode_index", "length", "store_id", "tasks"]:
            same = [episode[key] for episode in depth.episodes] == [episode[key] for episode in dataset.episodes]
            require(same, f"{depth_root.name}: other {key}")
        depths = depth.check_depths()
    summary = {
        "episodes": len(dataset.episodes),
        "frames": dataset.info["total_frames"],
        "video_frames_decoded": len(videos),
        "depth_frames_decoded": len(depths),
    }
    if arguments.expected:
        expected = json.loads(arguments.expected.read_text())
        summary["largest_color_error"] = round(check_expected(expected, dataset, videos, depths), 2)
    json.dump(summary, sys.stdout)
    print()


if __name__ == "__main__":
    main()
