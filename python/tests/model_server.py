"""A llama.cpp server on loopback: model_server.py MODEL.gguf CONTEXT [THREADS] [SLOTS]

Prints its address, and ends when its standard input does, so that it never outlives who started it. The slots share
CONTEXT tokens; requests beyond their number wait.
"""

import os
import sys

import xllamacpp


def main(model: str, context: int, threads: int = 1, slots: int = 1) -> None:
    parameters = xllamacpp.CommonParams()
    parameters.model.path = model
    parameters.hostnames = ["127.0.0.1"] if isinstance(parameters.hostnames, list) else "127.0.0.1"
    parameters.port = 0
    parameters.n_ctx = context
    parameters.n_parallel = slots
    parameters.cpuparams.n_threads = threads
    parameters.cpuparams_batch.n_threads = threads
    parameters.use_jinja = True
    server = xllamacpp.Server(parameters)
    print(server.listening_address, flush=True)
    sys.stdin.read()
    # The server's own end waits for answers that nobody reads any more.
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
