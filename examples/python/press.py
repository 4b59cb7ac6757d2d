"""A policy for `genmanip evaluate --policy python:press:Press`: it lowers the open hand and waits a second."""

import numpy as np


class Press:
    def spec(self):
        action = {"space": "ee_delta", "rotation": "axis_angle", "gripper": {"encoding": "width_m"}}
        return {"rate_hz": 15, "action": action, "cameras": [{"name": "static"}]}

    def reset(self, start):
        self.instruction = start["instruction"]

    def act(self, observation):
        print(self.instruction, observation["images"]["static"]["rgb"].shape)
        down, stay = [0, 0, -0.01, 0, 0, 0, 0.08], [0, 0, 0, 0, 0, 0, 0.08]
        return np.array([down] * 10 + [stay] * 15), True
