"""Runs a policy of a Python module for GenManip over pipes: the program is this text after that of _policy.py.

The class has spec(), reset(start) and act(observation), see docs/guides/evaluate.md. A message is the length of its
header (4 bytes, little-endian), the header as JSON, and the bytes of the arrays listed in the header. The policy's
standard output is redirected to standard error, and its standard input is empty.
"""

import importlib
import struct
import sys

INPUT, OUTPUT = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
os.dup2(2, 1)
os.dup2(os.open(os.devnull, os.O_RDONLY), 0)


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
    given = [] if array is None else [array.astype("<f4")]
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


def found(module, name):
    """The class."""
    try:
        loaded = importlib.import_module(module)
    except (KeyboardInterrupt, GeneratorExit):
        raise
    except BaseException as error:
        if isinstance(error, ModuleNotFoundError) and error.name == module.partition(".")[0]:
            hint = f"modules are found in the current folder, {os.getcwd()}, and on PYTHONPATH"
            raise Mistake(f"there is no module {module} for {sys.executable}\nhint: {hint}") from error
        raise Mistake(described(f"import {module}", error)) from error
    if not hasattr(loaded, name):
        classes = ", ".join(key for key, value in vars(loaded).items() if isinstance(value, type)) or "none"
        raise Mistake(f"{module} has no class {name}\nhint: classes of {loaded.__file__}: {classes}")
    return getattr(loaded, name)


def answered(policy, head, arrays):
    if head["ask"] == "make":
        policy = made(found(*sys.argv[1].split(":", 1)))
        send({"spec": json.loads(spec_of(policy))})
    elif head["ask"] == "reset":
        reset(policy, head["start"])
        send({})
    else:
        rows, finished = actions_of(policy, with_arrays(head["observation"], arrays))
        send({"finished": finished}, rows)
    return policy


def main():
    policy = None
    while True:
        head, arrays = receive()
        try:
            policy = answered(policy, head, arrays)
        except Mistake as mistake:
            send({"error": str(mistake)})


main()
