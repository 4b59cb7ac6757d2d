"""Policies with one planted mistake each, and words that must name it: its place, and its remedy."""

import os
import sys
import time

import numpy as np


class Sound:
    """A policy without a mistake, of which the others differ in one respect."""

    answer = None

    def spec(self):
        return {"rate_hz": 15, "action": "joint", "cameras": []}

    def reset(self, start):
        assert isinstance(start["seed"], int)
        print("printing is no mistake")

    def act(self, observation):
        return (observation["state"][np.newaxis] if self.answer is None else self.answer), True


def answering(answer):
    return type("Answering", (Sound,), {"answer": answer})


def specified(spec):
    return type("Specified", (Sound,), {"spec": lambda self: spec})


class RaisesInMaking(Sound):
    def __init__(self):
        raise FileNotFoundError("weights.pt")


class RaisesInMakingTheSecond(Sound):
    made = 0

    def __init__(self):
        RaisesInMakingTheSecond.made += 1
        if self.made == 2:
            raise FileNotFoundError("weights.pt")


class RaisesInReset(Sound):
    def reset(self, start):
        raise RuntimeError("no weights")


class RaisesInAct(Sound):
    def act(self, observation):
        return observation["images"]["overview"]["rgb"]


class NoAct:
    spec, reset = Sound.spec, Sound.reset


class WrongSignature(Sound):
    def act(self):
        return None


class ReadsInput(Sound):
    def act(self, observation):
        return input()


class Exits(Sound):
    def act(self, observation):
        sys.exit(3)


class Dies(Sound):
    def act(self, observation):
        os._exit(3)


class Late(Sound):
    def act(self, observation):
        time.sleep(60)


Nothing = type("Nothing", (Sound,), {"act": lambda self, observation: None})
Text = answering("left")
Short = answering([[0.0] * 7])
NotANumber = answering([[0.0, float("nan"), 0, 0, 0, 0, 0, 0]])
Infinite = answering([[0.0, 1e39, 0, 0, 0, 0, 0, 0]])
Ragged = answering([[0.0] * 8, [0.0] * 7])
Deep = answering(np.zeros((1, 2, 8)))
Objects = answering(np.array([[None] * 8]))
Empty = type("Empty", (Sound,), {"act": lambda self, observation: np.zeros((0, 8))})
Triple = type("Triple", (Sound,), {"act": lambda self, observation: ([[0.0] * 8], True, {})})
NoDictionary = specified(["rate_hz", 15])
Misspelt = specified({"rate": 15})
NoDivisor = specified({"rate_hz": 50})
NoGripper = specified({"action": {"space": "ee_delta"}})
NoList = specified({"cameras": "wrist"})
NoCamera = specified({"cameras": [{"name": "ceiling"}]})

#: Class, words of its place, words of its remedy.
PLANTED = [
    ("RaisesInMaking", "RaisesInMaking() raised FileNotFoundError: weights.pt, .*planted.py:", "correct it there"),
    ("RaisesInReset", "reset() raised RuntimeError: no weights, .*planted.py:", "correct it there"),
    ("RaisesInAct", "act() raised KeyError: 'overview', .*planted.py:", "images need cameras in the spec"),
    ("NoAct", "NoAct has no method act", "a policy has spec(self), reset(self, start), act(self, observation)"),
    ("WrongSignature", "act() raised TypeError", "a policy has spec(self)"),
    ("ReadsInput", "act() raised EOFError", "a policy has no standard input"),
    ("Exits", "act() raised SystemExit: 3, .*planted.py:", "return (actions, True) to finish"),
    ("Dies", "its Python process ended during act() (exit status: 3)", "a policy returns or raises"),
    ("Late", "act() gave no answer within 5 s", "timeout_s=… waits longer"),
    ("Nothing", "act() returned None", "return the next actions, one per row"),
    ("Text", "act() returned str", "return the next actions, one per row"),
    ("Short", "action for control step 0", "expected 8 numbers (joint_position, gripper width_m), got 7"),
    ("NotANumber", "act() returned nan as number 1 of action 0", "expected finite numbers"),
    ("Infinite", "act() returned inf as number 1 of action 0", "expected finite numbers"),
    ("Ragged", "act() returned list, which is no array", "every row has the same length"),
    ("Deep", "act() returned an array of shape 1 x 2 x 8", "expected (actions, numbers per action)"),
    ("Objects", "act() returned an array of object", "every row has the same length"),
    ("Empty", "act() returned no action", "return the next actions"),
    ("Triple", "act() returned a tuple of list, bool, dict", "or (actions, True)"),
    ("NoDictionary", "spec() returned list", "expected a dictionary such as"),
    ("Misspelt", "`spec` has no key `rate`", "did you mean `rate_hz`"),
    ("NoDivisor", "`rate_hz`: expected actions per second that divide", "such as 10, 15, 20, 30 or 60; got 50"),
    ("NoGripper", "`action.gripper` is missing", 'expected e.g. {"encoding": "width_m"}'),
    ("NoList", "`cameras`: expected a list such as", 'got "wrist"'),
    ("NoCamera", "camera `ceiling`", "static"),
    ("Missing", "planted has no class Missing", "classes of .*planted.py: .*Sound"),
]
