"""A policy server made of the published openpi-client package: its packer, its picture resizing, its wire.

Usage: openpi_server.py PORT-FILE. Writes its port into the file, answers eight actions of joint speed zero, and ends with
the process that started it. Its inputs are printed as one line of JSON per question.
"""

import asyncio
import json
import sys

import numpy as np
from openpi_client import image_tools, msgpack_numpy
import websockets.asyncio.server as websockets
from websockets.exceptions import ConnectionClosed


def told(value):
    """Shape, type and mean of an array; anything else as it is."""
    if isinstance(value, np.ndarray):
        return {"shape": list(value.shape), "dtype": value.dtype.str, "mean": float(value.mean())}
    return value


async def serve(socket):
    packer = msgpack_numpy.Packer()
    await socket.send(packer.pack({"model_name": "openpi-client"}))
    while True:
        try:
            observation = msgpack_numpy.unpackb(await socket.recv())
        except ConnectionClosed:
            return
        print(json.dumps({key: told(value) for key, value in observation.items()}), flush=True)
        for key, value in observation.items():
            if "image" in key:
                # What the real client would send of this picture is the picture itself.
                assert np.array_equal(image_tools.resize_with_pad(value, 224, 224), value), key
        actions = np.zeros((10, 8), dtype=np.float32)
        await socket.send(packer.pack({"actions": actions, "server_timing": {"infer_ms": np.float64(1.0)}}))


async def main():
    async with websockets.serve(serve, "127.0.0.1", 0, compression=None, max_size=None) as server:
        port = server.sockets[0].getsockname()[1]
        with open(sys.argv[1], "w") as file:
            file.write(str(port))
        await server.serve_forever()


asyncio.run(main())
