"""Records a conversation of the published openpi-client with a server that packs as openpi's does.

Usage: record_conversation.py FILE. The client is asked what `examples/droid/main.py` of openpi asks, of a flat picture of
each camera; FILE gets metadata, question and answer, each as it went over the wire: a length of four bytes, the lowest
first, and the bytes, all of it compressed (zlib). `cargo xtask test --interop` compares it with the committed file.
"""

import asyncio
import struct
import sys
import threading
import zlib

import numpy as np
import websockets.asyncio.server as websockets
from openpi_client import image_tools, msgpack_numpy, websocket_client_policy

frames = []
ports = []
ready = threading.Event()


async def serve(socket):
    packer = msgpack_numpy.Packer()
    frames.append(packer.pack({"model_name": "recorded"}))
    await socket.send(frames[0])
    frames.append(await socket.recv())
    actions = (np.arange(80, dtype=np.float32) / np.float32(100.0) - np.float32(0.4)).reshape(10, 8)
    frames.append(packer.pack({"actions": actions, "server_timing": {"infer_ms": 12.5}}))
    await socket.send(frames[2])


async def listen():
    async with websockets.serve(serve, "127.0.0.1", 0, compression=None, max_size=None) as server:
        ports.append(server.sockets[0].getsockname()[1])
        ready.set()
        await server.serve_forever()


threading.Thread(target=lambda: asyncio.run(listen()), daemon=True).start()
ready.wait()


def picture(level):
    return image_tools.resize_with_pad(np.full((18, 32, 3), level, dtype=np.uint8), 224, 224)


client = websocket_client_policy.WebsocketClientPolicy("127.0.0.1", ports[0])
answer = client.infer(
    {
        "observation/exterior_image_1_left": picture(200),
        "observation/wrist_image_left": picture(100),
        "observation/joint_position": np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7]),
        "observation/gripper_position": np.array([1.0 - 0.02 / 0.08]),
        "prompt": "put it there",
    }
)
assert answer["actions"].shape == (10, 8)
told = b"".join(struct.pack("<I", len(frame)) + frame for frame in frames)
with open(sys.argv[1], "wb") as file:
    file.write(zlib.compress(told, 9))
