"""Runs MPlib and `genmanip-lab motion` on the same problems, one after the other, on one thread each.

    pip install mplib==0.2.1
    python docs/benchmark/against_mplib.py PROBLEMS.json ROBOT_FOLDER --genmanip-lab target/release/genmanip-lab --count 30

ROBOT_FOLDER holds panda.urdf with its meshes and an SRDF.  MPlib plans with OMPL's RRTConnect on convex pieces
(`use_convex`, range 0.1); its own IK and time scaling are not in its time.  Then FCL, through MPlib, tests the paths of
both programs every 0.02 rad: the second opinion that `genmanip-lab motion` alone cannot give.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

import mplib
import numpy as np


def planner_for(folder):
    """MPlib wants paths without `package://`, and fingers fixed: only the arm's joints move."""
    folder = pathlib.Path(folder).resolve()
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        for entry in folder.iterdir():
            (scratch / entry.name).symlink_to(entry)
        urdf = scratch / "robot.urdf"
        urdf.write_text((folder / f"{folder.name}.urdf").read_text().replace("package://", ""))
        rules = min(folder.glob("*.srdf"), key=lambda file: file.read_text().count("<disable_collisions"))
        return mplib.Planner(urdf=str(urdf), srdf=str(rules), move_group="panda_hand", use_convex=True, verbose=False)


def set_world(planner, obstacles):
    for name in list(planner.planning_world.get_object_names()):
        planner.planning_world.remove_object(name)
    for index, obstacle in enumerate(obstacles):
        if obstacle["type"] == "box":
            shape = mplib.collision_detection.fcl.Box(obstacle["size"])
        else:
            shape = mplib.collision_detection.fcl.Cylinder(obstacle["radius"], obstacle["length"])
        half = obstacle.get("yaw", 0.0) / 2.0
        pose = mplib.Pose(obstacle["pos"], [np.cos(half), 0.0, 0.0, np.sin(half)])
        item = mplib.collision_detection.fcl.CollisionObject(shape, pose)
        name = f"obstacle {index}"
        planner.planning_world.add_object(mplib.collision_detection.fcl.FCLObject(name, pose, [item], [mplib.Pose()]))


def touches(planner, states):
    def bad(state):
        return planner.check_for_self_collision(state) or planner.check_for_env_collision(state)

    for before, after in zip(states, states[1:]):
        steps = max(1, int(np.ceil(np.abs(after - before).max() / 0.02)))
        if any(bad(before + (after - before) * k / steps) for k in range(1, steps + 1)):
            return True
    return False


def length(states):
    return float(sum(np.linalg.norm(b - a) for a, b in zip(states, states[1:])))


def row(name, times, lengths, invalid):
    times = sorted(times)
    p95 = times[round(0.95 * (len(times) - 1))]
    print(f"{name:9} solved {len(lengths)}  invalid by FCL {invalid}  cpu ms median {statistics.median(times):.3f}"
          f"  p95 {p95:.3f}  length median {statistics.median(lengths):.3f} rad")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problems")
    parser.add_argument("robot")
    parser.add_argument("--genmanip-lab", dest="program", default="genmanip-lab")
    parser.add_argument("--count", type=int, default=30, help="problems taken from the front of the file")
    options = parser.parse_args()
    problems = json.loads(pathlib.Path(options.problems).read_text())["problems"][: options.count]

    with tempfile.TemporaryDirectory() as scratch:
        file, paths = pathlib.Path(scratch, "problems.json"), pathlib.Path(scratch, "paths.json")
        file.write_text(json.dumps({"problems": problems}))
        command = [options.program, "motion", "--problems", file, "--robot", options.robot, "--paths", paths]
        ours = json.loads(subprocess.run([*command, "--json", "--quiet"], check=True, capture_output=True).stdout)
        our_paths = json.loads(paths.read_text())

    planner = planner_for(options.robot)
    times, lengths, invalid, our_invalid = [], [], 0, 0
    for problem, path in zip(problems, our_paths):
        set_world(planner, problem["obstacles"])
        our_invalid += path is not None and touches(planner, np.array(path))
        start, goal = np.array(problem["start"]), np.array(problem["goal"])
        planner.robot.set_qpos(start, True)
        begin = time.thread_time()
        status, states = planner.planner.plan(start, [goal], range=0.1, time=10.0, simplify=True, verbose=False)
        times.append((time.thread_time() - begin) * 1e3)
        if status == "Exact solution":
            states = np.asarray(states)
            lengths.append(length(states))
            invalid += touches(planner, states)
    row("MPlib", times, lengths, invalid)
    print(f"genmanip  solved {ours['solved']}  invalid by FCL {our_invalid}  cpu ms median "
          f"{ours['cpu_ms']['median']:.3f}  p95 {ours['cpu_ms']['p95']:.3f}  length median "
          f"{ours['path_length_rad']['median']:.3f} rad")
    print(f"ratio of medians {statistics.median(times) / ours['cpu_ms']['median']:.0f}")


if __name__ == "__main__":
    main()
