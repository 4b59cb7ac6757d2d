"""A policy that the tests evaluate, in this process and in one of its own."""

import numpy as np


class Swaying:
    """Moves every joint a little, and stops after two seconds."""

    name = "Swaying"

    def spec(self):
        action = {"space": "joint_delta", "gripper": {"encoding": "width_m"}}
        return {"rate_hz": 15, "action": action, "execute_steps": 5}

    def reset(self, start):
        assert start["instruction"] and start["seed"]
        self.turns = 0

    def act(self, observation):
        self.turns += 1
        move = 0.02 * np.sin(self.turns + np.arange(7))
        return np.tile(np.append(move, observation["state"][7]), (5, 1)), self.turns == 6
