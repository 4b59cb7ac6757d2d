"""Ten lines of Gymnasium: lay a task out, move the arm at random for a second, and look. Needs genmanip[gym]."""

import gymnasium

import genmanip  # makes GenManip-v0 known

env = gymnasium.make("GenManip-v0", tasks="examples/tasks/012_pick_and_place.json", observation="rgb", action="ee_delta")
seen, info = env.reset(seed=1)
print(info["instruction"])
env.action_space.seed(1)
for _ in range(15):
    seen, reward, terminated, truncated, info = env.step(env.action_space.sample())
print("picture", seen["pixels"]["static"].shape, "reward", reward, "success", info["is_success"])
