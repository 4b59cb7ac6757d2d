"""The installed wheel: environments, Gymnasium, evaluation. Run by `cargo xtask test python`."""

import importlib.util
import json
import os
import pathlib
import subprocess
import sys
import tempfile
import unittest
import warnings

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env

import genmanip
from genmanip import _library
from swaying import Swaying

ROOT = pathlib.Path(__file__).resolve().parents[2]
TASKS = [ROOT / "examples/tasks/021_spatial.json", ROOT / "examples/tasks/012_pick_and_place.json"]


def setUpModule():
    global FOLDER, SCENARIOS
    FOLDER = tempfile.TemporaryDirectory()
    SCENARIOS = pathlib.Path(FOLDER.name) / "scenarios"
    rows = genmanip.layout(TASKS, SCENARIOS, seed=3)
    assert all(row["scenario"] for row in rows), rows


def tearDownModule():
    FOLDER.cleanup()


class Projections(unittest.TestCase):
    def test_pixels_lead_to_the_points_that_the_picture_shows_and_back(self):
        channels = {"depth": True, "points": True}
        env = genmanip.Env(SCENARIOS, cameras=[{"name": "static", "size": [64, 48], "channels": channels}])
        picture = env.reset()["images"]["static"]
        camera = genmanip.Projection.of(picture)
        rows, columns = np.nonzero(picture["depth_m"] > 0)
        pixels, depth = np.column_stack([columns, rows]), picture["depth_m"][rows, columns]
        points = camera.points(pixels, depth)
        np.testing.assert_allclose(points, picture["points_m"][rows, columns], atol=1e-5)
        lens = genmanip.Projection(picture["K"], (64, 48), picture["world_from_camera"], [-0.1, 0.01, 0.001, 0.0])
        for one in (camera, lens):
            back, depth_back = one.pixels(one.points(pixels, depth))
            np.testing.assert_allclose(back, pixels, atol=1e-7)
            np.testing.assert_allclose(depth_back, depth, atol=1e-12)
            np.testing.assert_allclose(one.to_world(one.to_camera(points)), points, atol=1e-12)
        self.assertGreater(np.abs(lens.rays(pixels) - camera.rays(pixels)).max(), 1e-3)
        self.assertTrue(np.isnan(camera.pixels(camera.to_world([[0, 0, -1]]))[0]).all())
        with self.assertRaisesRegex(genmanip.Error, "pinhole"):
            genmanip.Projection(np.ones((3, 3)), (64, 48), np.eye(4))


class Environments(unittest.TestCase):
    def test_same_actions_lead_to_same_bytes_also_from_a_saved_moment(self):
        env = genmanip.Env(SCENARIOS, cameras=[{"name": "static", "size": [64, 48]}], privileged=True)
        self.assertEqual(len(env.scenes), 2)

        def drive():
            for turn in range(8):
                env.step(home + 0.05 * np.sin(turn))
            seen = env.observe()
            return [seen["state"].tobytes(), seen["objects"].tobytes(), seen["images"]["static"]["rgb"].tobytes()]

        home = env.reset(1, seed=780001)["state"]
        self.assertIn(env.name, env.scenes.ids())
        self.assertTrue(env.instruction)
        saved = env.save()
        first = drive()
        env.restore(saved)
        self.assertEqual(drive(), first)
        env.reset(1, seed=780001)
        self.assertEqual(drive(), first)
        row = env.finish("swaying")
        self.assertTrue(row["oracle"])
        self.assertEqual(row["policy"], "swaying")
        with self.assertRaisesRegex(genmanip.Error, "no episode"):
            env.observe()

    def test_what_is_wrong_is_said(self):
        env = genmanip.Env(SCENARIOS)
        env.reset()
        cases = [
            (lambda: env.step([0.0] * 7), "expected 8 numbers"),
            (lambda: env.step([float("nan")] * 8), "expected a finite one"),
            (lambda: env.reset(9), "there is no scene 9"),
            (lambda: env.picture("none"), "no camera `none`"),
            (lambda: genmanip.Env(SCENARIOS, action="wheels"), "action spaces are joint, joint_delta"),
            (lambda: genmanip.Env(SCENARIOS, rate_hz=7).reset(), "does not divide the control rate"),
            (lambda: genmanip.Env(pathlib.Path(FOLDER.name) / "none"), "no run at"),
            (lambda: genmanip.evaluate(SCENARIOS, "expret"), "did you mean `expert`"),
            (lambda: gymnasium.make("GenManip-v0"), "expected suite=… or tasks=…"),
        ]
        for call, words in cases:
            with self.subTest(words), self.assertRaisesRegex(genmanip.Error, words):
                call()

    def test_another_simulator_is_refused(self):
        self.assertIn(_library.MUJOCO, genmanip.engine())
        with tempfile.TemporaryDirectory() as folder:
            package = pathlib.Path(folder) / "mujoco"
            package.mkdir()
            (package / "__init__.py").touch()
            (package / "libmujoco.so.4.0.0").touch()
            run = [sys.executable, "-c", f"import sys; sys.path.insert(0, {folder!r}); import genmanip"]
            said = subprocess.run(run, capture_output=True, text=True).stderr
        self.assertIn("needs MuJoCo 3.17.0, found libmujoco.so.4.0.0", said)
        self.assertIn("pip install mujoco==3.17.0", said)


class Gymnasium(unittest.TestCase):
    def test_the_checker_finds_nothing(self):
        choices = [
            {"observation": "state", "action": "joint"},
            {"observation": "rgb", "action": "joint_delta", "reward": "sparse"},
            {"observation": "rgbd", "action": "joint_velocity", "cameras": ["wrist"]},
            {"observation": "points", "action": "ee", "cameras": ["static"]},
            {"observation": "state", "action": "ee_delta", "index": 1, "rate_hz": 20},
        ]
        for choice in choices:
            with self.subTest(choice), warnings.catch_warnings():
                warnings.simplefilter("error")
                given = {"size": (48, 32), "horizon_s": 2.0, "render_mode": "rgb_array", **choice}
                env = gymnasium.make("GenManip-v0", suite=SCENARIOS, **given)
                check_env(env.unwrapped, skip_render_check=False)
                env.close()

    def test_an_episode_ends_with_its_verdict(self):
        env = gymnasium.make("GenManip-v0", suite=SCENARIOS, index=0, action="ee", normalized=False, horizon_s=1.0)
        _, info = env.reset(seed=780002)
        self.assertFalse(info["is_success"])
        self.assertTrue(info["instruction"])
        far = np.array([1.0, 1.0, 1.0, 0, 0, 0, 0.08], np.float32)
        for _ in range(15):
            _, _, terminated, truncated, info = env.step(far)
        self.assertIn("no configuration of the arm", info["refused"])
        self.assertEqual((terminated, truncated, info["is_success"]), (False, True, False))
        with self.assertRaisesRegex(genmanip.Error, "the episode is over"):
            env.step(far)
        self.assertEqual(json.loads(env.unwrapped.finish("still"))["ending"], "horizon")

    def test_the_vector_environment_does_what_single_ones_do(self):
        given = {"suite": SCENARIOS, "observation": "rgb", "size": (32, 24), "action": "joint_delta", "horizon_s": 0.5}
        given["normalized"] = False
        many = gymnasium.make_vec("GenManip-v0", num_envs=3, threads=2, **given)
        singles = [gymnasium.make("GenManip-v0", **given) for _ in range(3)]
        many.reset(seed=780010)
        chance = np.random.default_rng(1)
        started = [one.reset(seed=780010 + at) for at, one in enumerate(singles)]
        self.assertEqual(many.unwrapped.instructions, [info["instruction"] for _, info in started])
        for turn in range(9):
            actions = chance.uniform(-0.05, 0.05, (3, 8)).astype(np.float32)
            seen, rewards, _, truncated, infos = many.step(actions)
            if turn < 8:
                ones = [one.step(action) for one, action in zip(singles, actions)]
                for at, one in enumerate(ones):
                    np.testing.assert_array_equal(seen["pixels"]["static"][at], one[0]["pixels"]["static"])
                    np.testing.assert_array_equal(seen["agent_pos"][at], one[0]["agent_pos"])
                    self.assertEqual((rewards[at], truncated[at]), (one[1], one[3]))
            self.assertEqual(truncated.all(), turn == 7)
        self.assertEqual(infos["is_success"].shape, (3,))


class Evaluation(unittest.TestCase):
    def test_results_are_those_of_the_program_byte_for_byte(self):
        program = os.environ.get("GENMANIP_PROGRAM")
        if program is None:
            self.skipTest("GENMANIP_PROGRAM is not set")
        ours, theirs = (pathlib.Path(FOLDER.name) / name for name in ("ours", "theirs"))
        reports = genmanip.evaluate(SCENARIOS, ["do_nothing", Swaying], out=ours)
        swaying = f"python:swaying:Swaying,python={sys.executable}"
        told = ["--quiet", "evaluate", SCENARIOS, "--policy", "do_nothing", "--policy", swaying, "--out", theirs]
        subprocess.run([program, *told], check=True, cwd=pathlib.Path(__file__).parent)
        theirs_of_it = next((theirs / "evaluation").glob("python*.json"))
        for mine, its in [("do_nothing", theirs / "evaluation/do_nothing.json"), ("Swaying", theirs_of_it)]:
            got, expected = ((file.read_text()) for file in (ours / "evaluation" / f"{mine}.json", its))
            # The label says how the policy was named.
            self.assertEqual(got.replace(f'"{mine}"', '"?"'), expected.replace(f'"{its.stem}"', '"?"').replace(f'"{mine}"', '"?"'))

        # The same actions through the environment, at their own rate.
        env = genmanip.Env(SCENARIOS, action="joint_delta")
        for index, row in enumerate(reports[1]["results"]):
            policy, seen, finished = Swaying(), env.reset(index), False
            policy.reset({"instruction": env.instruction, "seed": "0"})
            while not finished:
                actions, finished = policy.act(seen)
                for action in actions:
                    env.step(action)
                seen = env.observe()
            self.assertEqual(env.finish("Swaying"), row)

    def test_an_exception_is_the_failure_of_its_policy(self):
        class Broken(Swaying):
            def act(self, observation):
                raise RuntimeError("no weights")

        (report,) = genmanip.evaluate(SCENARIOS, Broken)
        causes = [failure["evidence"] for row in report["results"] for failure in row["failures"]]
        self.assertTrue(any("no weights" in cause and "test_wheel.py" in cause for cause in causes), causes)


class Examples(unittest.TestCase):
    def test_they_run(self):
        run = [sys.executable, "examples/python/quickstart.py"]
        said = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=True).stdout
        self.assertIn("picture (256, 256, 3)", said)

    def test_another_process_drives_an_environment_that_is_served(self):
        program = os.environ.get("GENMANIP_PROGRAM")
        if program is None:
            self.skipTest("GENMANIP_PROGRAM is not set")
        serve = [program, "serve", "env", SCENARIOS, "--address", "127.0.0.1:0"]
        with subprocess.Popen(serve, stderr=subprocess.PIPE, text=True) as serving:
            try:
                address = serving.stderr.readline().split("http://")[1].split("/")[0]
                run = [sys.executable, "examples/python/env_client.py", address]
                said = subprocess.run(run, cwd=ROOT, capture_output=True, text=True, check=True).stdout
            finally:
                serving.kill()
        self.assertIn("picture (256, 256, 3)", said)
        self.assertIn("result finished 120 frames", said)

    def test_lerobot_finds_its_environments(self):
        spec = importlib.util.spec_from_file_location("env", ROOT / "examples/python/envhub/env.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        made = module.make_env(n_envs=2, cfg={"suite": str(SCENARIOS), "size": (32, 32), "horizon_s": 0.2})
        self.assertEqual(list(made["scenarios"]), [0, 1])
        env = made["scenarios"][1]
        seen, _ = env.reset(seed=[1, 2])
        self.assertTrue(all(env.call("task_description")) and env.call("_max_episode_steps") == (3, 3))
        for _ in range(3):
            # As a dataset has them: joint targets in rad and the opening in m.
            seen, _, _, truncated, info = env.step(seen["agent_pos"])
        self.assertTrue(truncated.all() and info["final_info"]["is_success"].shape == (2,))
        self.assertEqual(seen["pixels"]["wrist"].shape, (2, 32, 32, 3))


if __name__ == "__main__":
    unittest.main()
