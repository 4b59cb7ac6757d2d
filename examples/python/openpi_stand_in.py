"""A policy server that speaks openpi's protocol and answers with a motion of one's own: to try a connection without a GPU.

    pip install openpi-client websockets
    python examples/python/openpi_stand_in.py libero 8000

Each message is packed by openpi-client (MessagePack with numpy arrays). The server first sends its metadata; then
each request is an observation, and the answer is {"actions": array of n x 7} (libero) or n x 8 (droid). This one lowers
the tool slowly (libero), or turns the first joint (droid), and prints the keys of the first observation.
"""

import sys

import numpy as np
from openpi_client import msgpack_numpy
from websockets.exceptions import ConnectionClosed
from websockets.sync.server import serve

# Per action: libero changes x, y, z, three rotations and the gripper; droid moves seven joints and the gripper.
ACTIONS = {
    "libero": np.tile([0.0, 0.0, -0.1, 0.0, 0.0, 0.0, -1.0], (10, 1)),
    "droid": np.tile([0.1, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], (10, 1)),
}


def main(preset: str, port: int) -> None:
    packer = msgpack_numpy.Packer()
    told = []

    def answer(connection):
        connection.send(packer.pack({"stand_in": preset}))
        try:
            for message in connection:
                observation = msgpack_numpy.unpackb(message)
                if not told:
                    told.append(True)
                    for key, value in sorted(observation.items()):
                        print(key, value if isinstance(value, str) else f"{value.dtype}{list(value.shape)}", flush=True)
                connection.send(packer.pack({"actions": ACTIONS[preset]}))
        except ConnectionClosed:  # the end of an episode
            pass

    with serve(answer, "127.0.0.1", port, compression=None, max_size=None) as server:
        print(f"{preset} on ws://127.0.0.1:{port}; Ctrl-C ends it", flush=True)
        server.serve_forever()


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "libero", int(sys.argv[2]) if len(sys.argv) > 2 else 8000)
