"""Opens a run's dataset with the published `lerobot` package and trains on it, as the guide's commands say.

    python interop_lerobot.py RUN GUIDE OUT

RUN is a folder of `genmanip collect`, GUIDE the page whose `lerobot-train` commands are carried out, OUT a new folder.
Values are compared with the rows as pyarrow reads them, pictures with those of the run's episodes, decoded one after the
other. Exits with 0, or says what differs.
"""

import io
import json
import pathlib
import random
import re
import shlex
import subprocess
import sys

import av
import numpy as np
import pyarrow.dataset
import torch
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from PIL import Image

CAMERAS = ["static", "wrist"]
CHUNK = 16
SAMPLED = 20


def require(condition, message):
    if not condition:
        raise SystemExit(f"wrong: {message}")


def main():
    run, guide, out = (pathlib.Path(argument) for argument in sys.argv[1:4])
    root = run / "dataset"
    fps = json.loads((root / "meta/info.json").read_text())["fps"]
    deltas = {"action": [step / fps for step in range(CHUNK)]}
    dataset = LeRobotDataset("local/run", root=root, video_backend="pyav", delta_timestamps=deltas)
    depths = LeRobotDataset("local/run-depth", root=run / "dataset-depth")
    episodes = table(root / "meta/episodes")
    require(len(episodes) == dataset.num_episodes > 1, f"{dataset.num_episodes} episodes, {len(episodes)} listed")
    rows = table(root / "data")
    require(len(rows) == len(dataset) == len(depths), f"{len(dataset)} frames, {len(depths)} of depth, {len(rows)} rows")
    seen = [check_episode(run, dataset, depths, rows, episode) for episode in episodes]
    print(f"lerobot: {len(rows)} rows of {len(episodes)} episodes exact, {sum(seen)} pictures with their depth")
    for command in commands(guide):
        train(command, root, out)


def table(folder):
    rows = pyarrow.dataset.dataset(folder).to_table().to_pylist()
    return sorted(rows, key=lambda row: row.get("index", row["episode_index"]))


def check_episode(run, dataset, depths, rows, episode):
    """Values of all rows; pictures of the first, the last and some others. Gives how many pictures it compared."""
    start, end = episode["dataset_from_index"], episode["dataset_to_index"]
    require(end - start == episode["length"], f"episode {episode['episode_index']}: {start} to {end}")
    plain = dataset.hf_dataset
    actions = np.array([row["action"] for row in rows[start:end]], dtype=np.float32)
    for index in range(start, end):
        for key, value in plain[index].items():
            same(value, rows[index][key], f"{key} of row {index}")
    others = random.Random(episode["episode_index"]).sample(range(1, end - start - 1), SAMPLED)
    wanted = [0, end - start - 1, *others]
    tracks = {camera: Track(run / "episodes" / episode["store_id"], camera) for camera in CAMERAS}
    for frame in wanted:
        item = dataset[start + frame]
        require(item["task"] in episode["tasks"], f"task {item['task']!r}, listed {episode['tasks']}")
        steps = frame + np.arange(CHUNK)
        same(item["action"], actions[np.minimum(steps, len(actions) - 1)], f"chunk of row {start + frame}")
        same(item["action_is_pad"], steps >= len(actions), f"padding of row {start + frame}")
        depth = depths[start + frame]
        for camera, track in tracks.items():
            track.check(frame, item[f"observation.images.{camera}"], depth[f"observation.images.{camera}_depth"])
    return len(wanted) * len(tracks)


def same(got, expected, what):
    if isinstance(expected, str):
        require(got == expected, f"{what}: {got!r}, written {expected!r}")
        return
    got = np.asarray(got)
    expected = np.asarray(expected, dtype=got.dtype).reshape(got.shape)
    require(np.array_equal(got, expected), f"{what}: {got}, written {expected}")


class Track:
    """Pictures of one camera in the run's own store."""

    def __init__(self, episode, camera):
        folder = next(episode.glob("images_*hz"))
        self.camera = camera
        with av.open(str(folder / f"{camera}.h264"), format="h264") as film:
            self.pictures = [frame.to_ndarray(format="rgb24").astype(np.int16) for frame in film.decode(video=0)]
        about = json.loads((folder / f"{camera}.json").read_text())
        depth, ends = (folder / f"{camera}.depth").read_bytes(), np.cumsum([0, *about["depth_png_bytes"]])
        self.depth_png = [depth[start:end] for start, end in zip(ends, ends[1:])]

    def check(self, frame, picture, depth):
        got = np.rint(picture.numpy().transpose(1, 2, 0) * 255).astype(np.int16)
        near = range(max(frame - 2, 0), min(frame + 3, len(self.pictures)))
        away = {other: float(np.abs(got - self.pictures[other]).mean()) for other in near}
        require(away[frame] == min(away.values()), f"{self.camera}, frame {frame}: away from its neighbours by {away}")
        require(away[frame] < 1.0, f"{self.camera}, frame {frame}: {away[frame]} of 255 away")
        written = np.asarray(Image.open(io.BytesIO(self.depth_png[frame]))).astype(np.int64)
        same(np.asarray(depth, dtype=np.float64).squeeze(), written, f"depth of {self.camera}, frame {frame}")


def commands(guide):
    """The training commands of the page."""
    text = guide.read_text().replace("\\\n", " ")
    found = [shlex.split(line) for line in text.splitlines() if line.startswith("lerobot-train ")]
    require(len(found) == 2, f"{len(found)} commands `lerobot-train` in the guide, expected ACT's and diffusion's")
    return found


def train(command, root, out):
    policy = next(part.split("=")[1] for part in command if part.startswith("--policy.type="))
    command[0] = str(pathlib.Path(sys.executable).with_name("lerobot-train"))
    command = [re.sub(r"^--dataset\.root=.*", f"--dataset.root={root}", part) for part in command]
    command = [re.sub(r"^--output_dir=.*", f"--output_dir={out / policy}", part) for part in command]
    done = subprocess.run([*command, "--log_freq=5", "--save_checkpoint=false"], capture_output=True, text=True)
    told = done.stdout + done.stderr
    losses = [float(loss) for loss in re.findall(r"\bloss:([0-9.]+)", told)]
    end = "\n".join(told.splitlines()[-12:])
    require(done.returncode == 0 and len(losses) >= 2, f"{policy} did not train:\n{end}")
    require(np.isfinite(losses).all(), f"{policy}: losses {losses}")
    print(f"lerobot: {policy} trained, loss {losses[0]} to {losses[-1]}")


torch.set_num_threads(2)
main()
