"""Runs a policy of a Python module for GenManip over pipes: `python policy_process.py module:Class`.

The class has spec(), reset(start) and act(observation), see docs/guides/evaluate.md. A message is the length of its
header (4 bytes, little-endian), the header as JSON, and the bytes of the arrays listed in the header. The policy's
standard output is redirected to standard error.
"""

import importlib
import json
import os
import struct
import sys
import traceback

import numpy as np

INPUT, OUTPUT = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)


def receive():
    length = INPUT.read(4)
    if len(length) < 4:
        sys.exit(0)
    head = json.loads(INPUT.read(struct.unpack("<I", length)[0]))
    arrays = []
    for entry in head["arrays"]:
        dtype = np.dtype(entry["dtype"])
        data = INPUT.read(dtype.itemsize * int(np.prod(entry["shape"], dtype=np.int64)))
        arrays.append(np.frombuffer(bytearray(data), dtype).reshape(entry["shape"]))
    return head, arrays


def send(head, array=None):
    given = [] if array is None else [np.ascontiguousarray(array, dtype="<f4")]
    head["arrays"] = [{"dtype": "<f4", "shape": list(one.shape)} for one in given]
    text = json.dumps(head).encode()
    OUTPUT.write(struct.pack("<I", len(text)) + text + b"".join(one.tobytes() for one in given))
    OUTPUT.flush()


def with_arrays(value, arrays):
    """Replaces each {"array": number} by the array."""
    if isinstance(value, dict):
        if set(value) == {"array"}:
            return arrays[value["array"]]
        return {name: with_arrays(one, arrays) for name, one in value.items()}
    return value


def answer(made, policy, head, arrays):
    if head["ask"] == "make":
        policy = made()
        send({"spec": policy.spec()})
    elif head["ask"] == "reset":
        policy.reset(head["start"])
        send({})
    else:
        given = policy.act(with_arrays(head["observation"], arrays))
        actions, finished = given if isinstance(given, tuple) else (given, False)
        send({"finished": bool(finished)}, np.atleast_2d(np.asarray(actions, dtype=np.float32)))
    return policy


def main():
    module, _, name = sys.argv[1].partition(":")
    made, policy = None, None
    while True:
        head, arrays = receive()
        try:
            if made is None:
                made = getattr(importlib.import_module(module), name)
            policy = answer(made, policy, head, arrays)
        except Exception:
            send({"error": traceback.format_exc()})


main()
