"""From the world to pixels and back."""

from __future__ import annotations

from typing import Any, Mapping, Sequence

import numpy as np

from . import _genmanip


class Projection:
    """A camera at its place: which pixel shows a point, and which points a pixel shows; with its lens, if it has one.

    Pixels are (u to the right, v down), their centres whole numbers. The camera's frame has x right, y down, z ahead.
    Depth is along z, metres. Rows of points that are not shown are not a number.

        camera = genmanip.Projection.of(env.observe()["images"]["static"])
        pixels, depth_m = camera.pixels([[0.5, 0.1, 0.02]])
        camera.points(pixels, depth_m)  # the same point
    """

    def __init__(
        self,
        K: Any,
        size: Sequence[int],
        world_from_camera: Any,
        distortion: Sequence[float] | None = None,
    ) -> None:
        """K (3x3, pixels), size (width, height), pose of the optical frame (4x4), k1, k2, p1, p2, k3 of the lens."""
        k, pose = np.asarray(K, float).reshape(3, 3), np.asarray(world_from_camera, float).reshape(4, 4)
        lens = None if distortion is None else [*map(float, distortion), 0.0][:5]
        self._native = _genmanip.Projection(k.tolist(), list(map(int, size)), pose.tolist(), lens)

    @classmethod
    def of(cls, picture: Mapping[str, Any]) -> "Projection":
        """Of a picture of an observation."""
        return cls(picture["K"], picture["size"], picture["world_from_camera"], picture.get("distortion"))

    def pixels(self, points: Any) -> tuple[np.ndarray, np.ndarray]:
        """Pixels (n, 2) that show points of the world (n, 3), and their depths (n,)."""
        rows = self._native.pixels(_rows(points, 3))
        return rows[:, :2], rows[:, 2]

    def points(self, pixels: Any, depth_m: Any) -> np.ndarray:
        """Points of the world (n, 3) that pixels (n, 2) show at depths (n,)."""
        at = np.asarray(pixels, float).reshape(-1, 2)
        depth = np.broadcast_to(np.asarray(depth_m, float), (len(at),))
        return self._native.points(np.column_stack([at, depth]).tolist())

    def rays(self, pixels: Any) -> np.ndarray:
        """Directions (n, 3) that pixels (n, 2) look in, camera frame, z = 1."""
        return self._native.rays(_rows(pixels, 2))

    def to_camera(self, points: Any) -> np.ndarray:
        """Points of the world (n, 3) in the camera's frame."""
        return self._native.to_camera(_rows(points, 3))

    def to_world(self, points: Any) -> np.ndarray:
        """Points of the camera's frame (n, 3) in the world."""
        return self._native.to_world(_rows(points, 3))


def _rows(values: Any, columns: int) -> list[list[float]]:
    return np.asarray(values, float).reshape(-1, columns).tolist()
