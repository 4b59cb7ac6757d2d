"""Compares calibrations with OpenCV's on the same views: detector of boards, and hand-eye solvers.

    python interop_opencv.py GENMANIP SETS

GENMANIP is the program, SETS a folder of `genmanip-lab calibrate --rendered N --out SETS`. On sets of noisy corners and
robot poses, the median error of points on the table must be below that of every solver of OpenCV; in rendered images,
OpenCV must read the same corners under the same ids. Exits with 0, or says what differs.
"""

import json
import pathlib
import subprocess
import sys

import cv2
import numpy as np

SOLVERS = ["TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS"]
# Where both find a corner, px: median and largest distance.
SAME_PX = [0.1, 0.6]


def matrix(pose):
    w, x, y, z = np.array(pose["orientation_wxyz"]) / np.linalg.norm(pose["orientation_wxyz"])
    result = np.eye(4)
    result[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    result[:3, 3] = pose["position_m"]
    return result


class Set:
    """Views of one folder, with their truth."""

    def __init__(self, folder):
        self.folder = folder
        self.views = json.loads((folder / "views.json").read_text())
        truth = json.loads((folder / "truth.json").read_text())
        self.truth = matrix(truth["mount_from_camera"])
        self.hands = [matrix(hand) for hand in truth["base_from_hand"]]
        self.in_hand = self.views["mounting"] == "eye_in_hand"
        camera = self.views["camera"]
        inner = camera["intrinsics"]
        self.size = [inner["width"], inner["height"]]
        self.k = np.array([[inner["fx"], 0, inner["cx"]], [0, inner["fy"], inner["cy"]], [0, 0, 1]])
        lens = camera.get("distortion") or {}
        self.lens = np.array([lens.get(name, 0.0) for name in ["k1", "k2", "p1", "p2", "k3"]])

    def ours(self, genmanip):
        command = [genmanip, "calibrate", str(self.folder), "--json"]
        found = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
        return matrix(found["camera"]["mount_from_camera"])

    def pairs(self):
        """Robot poses, and poses of the board in the camera from the given corners."""
        grid = self.views["board"]["grid"]
        robot, board = [], []
        for id, corners in self.views["detections"].items():
            if len(corners) < 6:
                continue
            points = [[number % grid["columns"], number // grid["columns"], 0] for number, _, _ in corners]
            points = np.array(points, float) * grid["spacing_m"]
            pixels = np.array([[u, v] for _, u, v in corners])
            _, turn, shift = cv2.solvePnP(points, pixels, self.k, self.lens, flags=cv2.SOLVEPNP_IPPE)
            turn, shift = cv2.solvePnPRefineLM(points, pixels, self.k, self.lens, turn, shift)
            hand = matrix(self.views["robot"][id]["base_from_hand"])
            robot.append(hand if self.in_hand else np.linalg.inv(hand))
            board.append((cv2.Rodrigues(turn)[0], shift))
        return robot, board

    def opencv(self, solver):
        robot, board = self.pairs()
        turn, shift = cv2.calibrateHandEye(
            [pose[:3, :3] for pose in robot],
            [pose[:3, 3] for pose in robot],
            [turn for turn, _ in board],
            [shift for _, shift in board],
            method=getattr(cv2, f"CALIB_HAND_EYE_{solver}"),
        )
        found = np.eye(4)
        found[:3, :3], found[:3, 3] = turn, shift[:, 0]
        return found

    def table_errors(self, found):
        """Errors of points on the table, seen by the true camera and placed by the found one, m."""
        table = np.array([[0.3 + 0.1 * x, -0.2 + 0.1 * y, 0, 1] for y in range(5) for x in range(5)]).T
        errors = []
        for hand in self.hands if self.in_hand else [np.eye(4)]:
            seen = np.linalg.inv(hand @ self.truth) @ table
            pixels = self.k @ seen[:3]
            pixels = pixels[:2] / pixels[2]
            shown = (seen[2] > 0) & (pixels >= 0).all(0) & (pixels.T < self.size).all(1)
            placed = hand @ found @ seen
            errors += list(np.linalg.norm(placed - table, axis=0)[shown])
        return errors


def solvers(genmanip, folder):
    for mounting in ["eye_in_hand", "eye_to_hand"]:
        sets = [Set(path) for path in sorted(folder.glob(f"{mounting}_noisy_*"))]
        errors = {"GenManip": [error for it in sets for error in it.table_errors(it.ours(genmanip))]}
        for solver in SOLVERS:
            errors[solver] = [error for it in sets for error in it.table_errors(it.opencv(solver))]
        medians = {name: 1e3 * float(np.median(values)) for name, values in errors.items()}
        print(f"{mounting}, {len(sets)} sets, mm:", {name: round(mm, 3) for name, mm in medians.items()})
        ours = medians.pop("GenManip")
        assert ours < min(medians.values()), f"{mounting}: {ours} mm, expected less than {medians}"


def detector(genmanip, folder):
    family = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    distances, images, found = [], 0, 0
    for it in [Set(path) for path in sorted(folder.glob("rendered_*"))]:
        board = it.views["board"]["charuco"]
        size = (board["columns"], board["rows"])
        theirs = cv2.aruco.CharucoDetector(cv2.aruco.CharucoBoard(size, board["square_m"], board["tag_m"], family))
        corners = json.loads((it.folder / "corners.json").read_text())
        for id, ours in corners.items():
            pixels, ids, _, _ = theirs.detectBoard(cv2.imread(str(it.folder / f"{id}.png"), cv2.IMREAD_GRAYSCALE))
            images += 1
            found += ids is not None
            if ids is not None:
                theirs_by_id = dict(zip(ids.ravel().tolist(), pixels.reshape(-1, 2)))
                distances += [np.hypot(*(theirs_by_id[n] - [u, v])) for n, u, v in ours if n in theirs_by_id]
    median, most = float(np.median(distances)), float(np.max(distances))
    print(f"boards read by OpenCV: {found} of {images}; corners apart by {median:.3f} px, at most {most:.3f}")
    assert found == images and median < SAME_PX[0] and most < SAME_PX[1]


if __name__ == "__main__":
    program, sets = sys.argv[1], pathlib.Path(sys.argv[2])
    solvers(program, sets)
    detector(program, sets)
