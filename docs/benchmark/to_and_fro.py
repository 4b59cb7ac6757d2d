"""A policy without inference cost, to time the simulator and two cameras (docs/benchmark.md)."""

import numpy as np


class ToAndFro:
    """Moves every joint back and forth for 20 simulated seconds, with two 256×256 images at 15 Hz."""

    def spec(self):
        return {
            "rate_hz": 15,
            "action": {"space": "joint_delta", "gripper": {"encoding": "width_m"}},
            "cameras": [{"name": name, "size": [256, 256]} for name in ("static", "wrist")],
            "execute_steps": 1,
        }

    def reset(self, start):
        self.turns = 0

    def act(self, observation):
        assert all(observation["images"][name]["rgb"].shape == (256, 256, 3) for name in ("static", "wrist"))
        self.turns += 1
        move = 0.03 * np.sin(self.turns / 8 + np.arange(7))
        return np.append(move, 0.08)[None], self.turns == 300
