"""Drives an environment of `genmanip serve env` from another process; needs numpy and msgpack, not genmanip.

    genmanip serve env --tasks examples/tasks/012_pick_and_place.json
    python examples/python/env_client.py 127.0.0.1:8091
"""

import http.client
import json
import sys

import msgpack
import numpy as np


def array(value):
    """An array of an answer; its keys are bytes."""
    if value.get(b"__ndarray__"):
        return np.frombuffer(value[b"data"], value[b"dtype"]).reshape(value[b"shape"])
    return value


class Env:
    """A session; see docs/guides/services.md for what may be asked."""

    def __init__(self, address, **settings):
        self.connection = http.client.HTTPConnection(address)
        self.session = None
        self.session = self.ask("open", settings=settings)["session"]

    def ask(self, what, **given):
        request = {"ask": what, **given} if self.session is None else {"ask": what, "session": self.session, **given}
        self.connection.request("POST", "/env", msgpack.packb(request))
        answer = self.connection.getresponse()
        body = answer.read()
        if answer.status != 200:
            raise RuntimeError(json.loads(body)["error"]["message"])
        return msgpack.unpackb(body, object_hook=array, strict_map_key=False)


if __name__ == "__main__":
    action = {"space": "ee_delta", "rotation": "axis_angle", "gripper": {"encoding": "width_m"}}
    cameras = [{"name": "static", "size": [256, 256]}]
    env = Env(sys.argv[1], action=action, rate_hz=15, cameras=cameras, horizon_s=20)
    start = env.ask("reset", index=0, seed=1)
    print(start["id"], start["instruction"])
    for _ in range(15):
        step = env.ask("step", action=[0, 0, -0.005, 0, 0, 0, 0.08])
    picture = step["observation"]["images"]["static"]["rgb"]
    print("picture", picture.shape, "score", step["score"], "success", step["success"])
    result = env.ask("finish", policy="down")["result"]
    print("result", result["ending"], result["frames"], "frames")
    env.ask("close")
