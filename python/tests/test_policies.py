"""Mistakes of policies are named with place and remedy, in process, on the command line and by check_policy."""

import concurrent.futures
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import genmanip
import planted

ROOT = pathlib.Path(__file__).resolve().parents[2]


def setUpModule():
    global FOLDER, SCENARIO
    FOLDER = tempfile.TemporaryDirectory()
    SCENARIO = pathlib.Path(FOLDER.name) / "scenario"
    rows = genmanip.layout(ROOT / "examples/tasks/012_pick_and_place.json", SCENARIO, seed=3)
    assert all(row["scenario"] for row in rows), rows


def tearDownModule():
    FOLDER.cleanup()


class Mistakes(unittest.TestCase):
    def named(self, text, name, place, remedy):
        for words in (place, remedy):
            pattern = ".*".join(map(re.escape, words.split(".*")))
            self.assertRegex(text, re.compile(pattern, re.DOTALL), name)

    def test_in_process_and_by_the_check(self):
        self.assertGreaterEqual(len(planted.PLANTED), 20)
        self.assertTrue(genmanip.check_policy(planted.Sound, SCENARIO).ok)
        for name, place, remedy in planted.PLANTED:
            if name in ("Dies", "Late", "ReadsInput", "Missing"):
                continue  # a process of its own is what sees them
            with self.subTest(name):
                policy = getattr(planted, name)
                check = genmanip.check_policy(policy, SCENARIO)
                self.assertFalse(check.ok)
                # The check drives an environment, which does not count control steps for the policy.
                self.named(str(check), name, place if name != "Short" else "expected 8", remedy)
                with self.assertRaises(genmanip.Error) as raised:
                    genmanip.evaluate(SCENARIO, policy)
                self.named(str(raised.exception), name, place, remedy)

    def test_a_mistake_in_making_the_policy_leaves_its_episode_out(self):
        planted.RaisesInMakingTheSecond.made = 0
        found = genmanip.evaluate(SCENARIO, planted.RaisesInMakingTheSecond, episodes_per_scenario=3, workers=1)[0]
        self.assertEqual((len(found.results), len(found.not_run)), (2, 1))
        self.assertIn("weights.pt", found.not_run[0]["reason"])

    def test_every_mistake_of_a_spec_is_named(self):
        check = genmanip.check_policy(planted.specified({"rate_hz": -7, "camera": [], "action": "wheels"}), SCENARIO)
        self.assertEqual(len(check.mistakes), 3, check)

    def test_on_the_command_line(self):
        program = os.environ.get("GENMANIP_PROGRAM")
        if program is None:
            self.skipTest("GENMANIP_PROGRAM is not set")

        def run(name):
            patience = ",timeout_s=5" if name == "Late" else ""
            policy = f"python:planted:{name},python={sys.executable}{patience}"
            told = [program, "--quiet", "evaluate", SCENARIO, "--policy", policy]
            return subprocess.run(told, capture_output=True, text=True, cwd=pathlib.Path(__file__).parent)

        with concurrent.futures.ThreadPoolExecutor(2) as pool:
            ran = list(pool.map(run, [name for name, *_ in planted.PLANTED]))
        for (name, place, remedy), one in zip(planted.PLANTED, ran):
            with self.subTest(name):
                self.assertEqual(one.returncode, 1, one.stderr)
                self.named(one.stderr, name, place, remedy)
                self.assertNotIn(" %", one.stdout)
        sound = run("Sound")
        self.assertEqual(sound.returncode, 0, sound.stderr)
        self.assertIn("printing is no mistake", sound.stderr)

    def test_corrections_go_on_after_a_mistake(self):
        program = os.environ.get("GENMANIP_PROGRAM")
        if program is None:
            self.skipTest("GENMANIP_PROGRAM is not set")
        policy = f"python:planted:RaisesInMakingTheSecond,python={sys.executable}"
        told = [program, "collect", ROOT / "examples/tasks/012_pick_and_place.json", "--out", f"{FOLDER.name}/corrected"]
        told += ["--episodes", "2", "--no-dataset", "--workers", "1", f"--corrections={policy}"]
        first, second = (subprocess.run(told, capture_output=True, text=True, cwd=ROOT / "python/tests") for _ in "ab")
        self.assertEqual(first.returncode, 1, first.stderr)
        self.assertIn("-001 was not run: ", first.stderr)
        self.assertIn("weights.pt", first.stderr)
        # Each call makes the policy anew, and only the attempt that is left.
        self.assertEqual(second.returncode, 0, second.stderr)


if __name__ == "__main__":
    unittest.main()
