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
        self.assertEqual(genmanip.Scenes.tasks("reach").ids(), genmanip.Scenes.tasks(["reach"]).ids())

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

        def make(**given):
            return gymnasium.make("GenManip-v0", suite=SCENARIOS, **given).unwrapped

        reset_env = make(index=0)
        reset_env.reset()
        cases = [
            (lambda: env.step([0.0] * 7), "expected 8 numbers"),
            (lambda: env.step([float("nan")] * 8), "expected a finite one"),
            (lambda: env.reset(9), "index=9 is not possible"),
            (lambda: env.reset(seed=1.5), "seed=1.5 is not possible"),
            (lambda: env.picture("none"), "no camera `none`"),
            (lambda: genmanip.Env(SCENARIOS, action="wheels"), "expected joint, joint_delta"),
            (lambda: genmanip.Env(SCENARIOS, rate_hz=7), "divide the control rate of 60 Hz, .*got 7"),
            (lambda: genmanip.Env(SCENARIOS, cameras="wrist"), "`cameras`: expected a list"),
            (lambda: genmanip.Env(SCENARIOS, cameras=["ceiling"]), "unknown camera `ceiling`"),
            (lambda: genmanip.Env(SCENARIOS, horizon_s=-1), "horizon_s=-1 is not possible"),
            (lambda: make(horizon_s=0), "expected seconds above 0"),
            (lambda: make(size=128), "expected .width, height."),
            (lambda: make(cameras="wrist", observation="rgb"), "expected a list of texts"),
            (lambda: make(cameras=["ceiling"], observation="rgb"), "unknown camera `ceiling`"),
            (lambda: make(observation="rbg"), "did you mean 'rgb'"),
            (lambda: make(rate_hz=50), "got 50"),
            (lambda: make(index=7), "index=7 is not possible"),
            (lambda: make().reset(options={"layot": 5}), "unknown option of reset 'layot'"),
            (lambda: reset_env.step(np.zeros(7)), "expected an action of shape 8, got 7"),
            (lambda: reset_env.step(0.0), "got a single number"),
            (lambda: genmanip.design(FOLDER.name, count=1, kinds="spatial"), "expected a list of texts"),
            (lambda: genmanip.layout(3, FOLDER.name), "expected a path, or a list of paths"),
            (lambda: genmanip.layout(TASKS, FOLDER.name, count=0), "count=0 is not possible"),
            (lambda: genmanip.collect(TASKS, FOLDER.name, episodes=1.5), "episodes=1.5 is not possible"),
            (lambda: genmanip.evaluate(SCENARIOS, "expert", workers=-1), "workers=-1 is not possible"),
            (lambda: genmanip.evaluate(SCENARIOS, "expert", horizon_s=-1), "horizon_s=-1 is not possible"),
            (lambda: genmanip.Env(pathlib.Path(FOLDER.name) / "none"), "no run at"),
            (lambda: genmanip.evaluate(SCENARIOS, "expret"), "did you mean `expert`"),
            (lambda: env.step("left"), "no array of numbers"),
            (lambda: genmanip.Env(SCENARIOS, stop_on_success="no"), "expected True or False"),
            (lambda: make(rate_hz="15"), "rate_hz='15' is not possible"),
            (lambda: make(action=3), "unknown action 3"),
            (lambda: make(horizn_s=3.0), "did you mean 'horizon_s'"),
            (lambda: make(discount="high"), "discount='high' is not possible"),
            (lambda: reset_env.step(["left"] * 8), "no array of numbers"),
            (lambda: gymnasium.make("GenManip-v0", tasks="rech"), "did you mean 'reach'"),
            (lambda: gymnasium.make_vec("GenManip-v0", num_envs=0, tasks="reach"), "num_envs=0 is not possible"),
            (lambda: genmanip.evaluate(SCENARIOS, []), "policy is empty"),
            (lambda: genmanip.evaluate(SCENARIOS, "expert", progress=3), "progress=3 is not possible"),
            (lambda: genmanip.plan(position=[0.5, 0.0]), "expected x, y, z"),
            (lambda: gymnasium.make("GenManip-v0"), "expected suite=… or tasks=…"),
        ]
        for call, words in cases:
            with self.subTest(words), self.assertRaisesRegex(genmanip.Error, words):
                call()

    def test_another_mujoco_works_in_the_same_process(self):
        self.assertIn("3.17.0", genmanip.engine())
        first, then = "import genmanip", "import mujoco"
        model = "<mujoco><worldbody><body><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
        step = f"""
model = mujoco.MjModel.from_xml_string({model!r})
data = mujoco.MjData(model)
env = genmanip.Env({str(SCENARIOS)!r}, action="joint_delta")
env.reset()
for _ in range(3):
    mujoco.mj_step(model, data)
    env.step([0.0] * 7 + [0.08])
print("both stepped", data.time > 0, env.observe()["time_s"])"""
        for order in ((first, then), (then, first)):
            run = [sys.executable, "-c", "\n".join([*order, step])]
            said = subprocess.run(run, capture_output=True, text=True)
            self.assertIn("both stepped True 0.2", said.stdout, said.stderr)


class Gymnasium(unittest.TestCase):
    def test_the_checker_finds_nothing(self):
        choices = [
            {"observation": "state", "action": "joint"},
            {"observation": "rgb", "action": "joint_delta", "reward": "sparse"},
            {"observation": "rgbd", "action": "joint_velocity", "cameras": ["wrist"]},
            {"observation": "points", "action": "ee", "cameras": ["static"]},
            {"observation": "state", "action": "ee_delta", "index": 1, "rate_hz": 20},
            {"observation": "flat", "action": "ee_delta", "reward": "dense", "discount": 0.98},
            {"observation": "flat_rgb", "action": "joint"},
        ]
        for choice in choices:
            with self.subTest(choice), warnings.catch_warnings():
                warnings.simplefilter("error")
                given = {"size": (48, 32), "horizon_s": 2.0, "render_mode": "rgb_array", **choice}
                env = gymnasium.make("GenManip-v0", suite=SCENARIOS, **given)
                check_env(env.unwrapped, skip_render_check=False)
                env.close()

    def test_deltas_into_the_table_do_not_wind_up(self):
        env = gymnasium.make("GenManip-v0", suite=SCENARIOS, index=0, action="ee_delta", normalized=False)
        seen, _ = env.reset(seed=1)
        heights = []
        for turn in range(18):
            # From 0.40 m, eight steps to the table and eight into it, then up.
            seen, *_ = env.step(np.array([0, 0, -0.05 if turn < 16 else 0.05, 0, 0, 0, 0.08], np.float32))
            heights.append(seen["tool"][2])
            self.assertLess(abs(seen["tool"][2] - seen["tool_target"][2]), 0.08)
        self.assertLess(heights[15], 0.03)
        self.assertGreater(heights[17], heights[15] + 0.02, heights)

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

    def test_a_small_task_has_a_dense_reward_and_named_numbers(self):
        given = {"observation": "flat", "action": "ee_delta", "reward": "dense", "normalized": False, "horizon_s": 8.0}
        env = gymnasium.make("GenManip-v0", tasks="reach", layouts=3, **given)
        seen, info = env.reset(options={"layout": 2})
        names = env.unwrapped.state_names()
        self.assertEqual((len(names), info["objects"]), (seen.size, ["046", "008"]))
        self.assertEqual(info["goal"], [["046 top 008"]])
        self.assertEqual(seen[names.index("goal_0.top")], 1.0)
        self.assertEqual(seen[names.index("goal_0.subject.046")], 1.0)
        tool, cube = ([names.index(f"{name}.{axis}") for axis in "xyz"] for name in ("tool", "046"))
        total, over = 0.0, False
        while not over:
            # The origin of an object is at its base; half a cube is 2 cm.
            way = np.clip(seen[cube] + [0, 0, 0.02] - seen[tool], -0.03, 0.03)
            seen, reward, terminated, truncated, info = env.step(np.array([*way, 0, 0, 0, 0.08], np.float32))
            total, over = total + reward, terminated or truncated
        self.assertTrue(terminated and info["is_success"])
        # The score rises to 1, the potential from near 0 to near 1.
        self.assertTrue(1.5 < total < 2.0, total)

    def test_the_goal_and_the_joints_of_objects_are_seen(self):
        env = gymnasium.make("GenManip-v0", suite=SCENARIOS, index=0)
        seen, info = env.reset(seed=1)
        self.assertEqual(seen["goal"].reshape(4, -1)[0].sum(), 3.0, info["goal"])
        self.assertEqual(seen["grasped"].sum(), 0.0)
        self.assertEqual(seen["environment_state"].size, 7 * seen["grasped"].size)

    def test_different_goals_are_different_numbers(self):
        spaces = gymnasium.make("GenManip-v0", suite=SCENARIOS, index=0).unwrapped.setup.spaces
        known = [{"id": name} for name in "ABC"[: spaces.most_objects]]
        atoms = [
            {"object": "A", "state": "open"},
            {"object": "A", "state": "closed"},
            {"object": "A", "state": "of an imported object"},
            {"object": "B", "state": "open"},
            {"subject": "A", "relation": "on", "reference": "B"},
            {"subject": "B", "relation": "on", "reference": "A"},
            {"subject": "A", "relation": "between", "reference": "B", "second_reference": "C"},
            {"subject": "A", "relation": "between", "reference": "B"},
            {"subject": "A", "relation": "near", "reference": "table"},
        ]
        rows = {spaces.goal({"objects": known, "task": {"goal": [[atom]]}}).tobytes() for atom in atoms}
        self.assertEqual(len(rows), len(atoms))
        cards = json.loads((ROOT / "crates/assets/data/catalog.json").read_text())
        states = {state for card in cards for state in card["states"]}
        self.assertLessEqual(states, set(genmanip._spaces.STATES))

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
        self.assertEqual(infos["command"].shape, (3, 8))
        self.assertEqual(many.unwrapped.call("instructions"), tuple(many.unwrapped.instructions))


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
            policy.reset({"instruction": env.instruction, "seed": 1})
            while not finished:
                actions, finished = policy.act(seen)
                for action in actions:
                    env.step(action)
                seen = env.observe()
            self.assertEqual(env.finish("Swaying"), row)


class Stages(unittest.TestCase):
    def test_results_print_as_tables_and_turn_into_pandas(self):
        seen = []
        folder = pathlib.Path(FOLDER.name)
        designed = genmanip.design(folder / "designed", count=2, kinds=["spatial"], seed=3)
        self.assertTrue(all(pathlib.Path(row.file).is_file() for row in designed), designed)
        rows = genmanip.layout(TASKS[0], folder / "rows", progress=lambda *told: seen.append(told))
        self.assertIn("scenario", str(rows).splitlines()[0])
        self.assertEqual(list(rows.pandas()["task"]), [rows[0].task])
        self.assertEqual(seen[-1][1:], (1, 1))
        results = genmanip.evaluate(rows[0].scenario, ["do_nothing:seconds=0.1"])
        self.assertEqual((results[0].success, results[0].episodes), (0.0, 1))
        self.assertEqual(list(results.pandas()["episodes"]), [1])
        self.assertEqual(list(results[0].pandas()["success"]), [False])
        self.assertIn("0.0 %", str(results))
        motion = genmanip.plan(rows[0].scenario, position=[0.5, 0.0, 0.3])
        self.assertTrue(motion.solved and len(motion.trajectory) > 10, motion)
        rendered = genmanip.render(rows[0].scenario, folder / "images", cameras=["static"], size=(64, 48))
        self.assertEqual(rendered[0].frames, 1)
        for call, words in [
            (lambda: genmanip.export(folder, format="lerobto"), "did you mean `lerobot`"),
            (lambda: genmanip.export(folder, rate=7), "rates are 10, 15"),
            (lambda: genmanip.plan(position=[0, 0, 0], joints=[0] * 7), "a motion has one target"),
        ]:
            with self.subTest(words), self.assertRaisesRegex(genmanip.Error, words):
                call()


    def test_a_policy_is_trained_and_evaluated(self):
        folder = pathlib.Path(FOLDER.name)
        run, out, seen = folder / "demonstrations", folder / "trained", []
        collected = genmanip.collect(TASKS[0], run, episodes=1, seed=3, dataset=False)
        self.assertEqual([row.verified for row in collected], [1])
        trained = genmanip.train(run, out, preset="state", steps=2, progress=lambda *told: seen.append(told))
        self.assertEqual((trained.steps, trained.demonstrations, trained.privileged), (2, 1, True))
        self.assertEqual(seen[-1][1:], (2, 2))
        [result] = genmanip.evaluate(SCENARIOS, f"learned:{out}", horizon_s=1.0)
        self.assertEqual((result.episodes, result.oracle), (2, True))
        for call, words in [
            (lambda: genmanip.train(run, out, preset="stat", steps=2), "did you mean `state`"),
            (lambda: genmanip.train(run, out, preset="state", head="flows", steps=2), "did you mean `flow`"),
            (lambda: genmanip.train(run, out, preset="state"), "a training has one length"),
            (lambda: genmanip.train(run, out, preset="state", steps=-2), "steps=-2 is not possible"),
            (lambda: genmanip.train(folder / "none", out, preset="state", steps=2), "none"),
        ]:
            with self.subTest(words), self.assertRaisesRegex(genmanip.Error, words):
                call()


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
