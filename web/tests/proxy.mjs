// A proxy between page and server that cuts, delays, loses and repeats.

import { createServer, request as send } from "node:http";
import { connect } from "node:net";

const EDIT = /\/(commands|undo|redo|revert)$/;
const sleep = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

/** Faults of single edits. */
export const EDIT_FAULTS = ["unsent", "unanswered", "late", "twice", "replayed"];

export class FaultyProxy {
  #isCut = false;
  #sockets = new Set();
  /** Faults of the next edits, the first one first. */
  #faults = [];
  #replayed = null;
  #server;
  /** Number of faults that happened to an edit. */
  struck = 0;

  /** Listens on a free port for a server on loopback. */
  static async before(port) {
    const proxy = new FaultyProxy();
    proxy.port = port;
    proxy.#server = createServer((request, response) => void proxy.#answer(request, response));
    proxy.#server.on("upgrade", (request, socket) => proxy.#join(request, socket));
    proxy.#server.on("connection", (socket) => {
      proxy.#sockets.add(socket);
      socket.on("close", () => proxy.#sockets.delete(socket));
      socket.on("error", () => socket.destroy());
    });
    await new Promise((resolve) => proxy.#server.listen(0, "127.0.0.1", resolve));
    proxy.url = `http://127.0.0.1:${proxy.#server.address().port}/`;
    return proxy;
  }

  /** Breaks all connections and refuses new ones, or accepts them again. */
  cut(isCut) {
    this.#isCut = isCut;
    if (isCut) for (const socket of this.#sockets) socket.destroy();
  }

  /** Lets a fault of `EDIT_FAULTS` happen to the next edit that has none yet. */
  spoil(fault) {
    this.#faults.push(fault);
  }

  close() {
    this.cut(true);
    return new Promise((resolve) => this.#server.close(resolve));
  }

  /** Headers as if the page had asked the server itself. */
  #headers(request) {
    const own = `127.0.0.1:${this.port}`;
    const headers = { ...request.headers, host: own };
    if (headers.origin) headers.origin = `http://${own}`;
    return headers;
  }

  async #answer(request, response) {
    if (this.#isCut) return request.socket.destroy();
    const parts = [];
    try {
      for await (const part of request) parts.push(part);
    } catch {
      return;
    }
    const whole = { method: request.method, path: request.url, headers: this.#headers(request), body: Buffer.concat(parts) };
    const isEdit = request.method === "POST" && EDIT.test(request.url.split("?")[0]);
    const fault = isEdit ? this.#faults.shift() : undefined;
    if (fault) this.struck += 1;
    if (fault === "unsent") return request.socket.destroy();
    if (fault === "late") await sleep(400);
    try {
      const earlier = isEdit ? this.#replayed : null;
      if (isEdit) this.#replayed = fault === "replayed" ? whole : null;
      if (fault === "twice") await this.#forward(whole);
      const answer = await this.#forward(whole);
      if (earlier) await this.#forward(earlier);
      if (fault === "unanswered" || this.#isCut) return request.socket.destroy();
      response.writeHead(answer.status, answer.headers);
      response.end(answer.body);
    } catch {
      request.socket.destroy();
    }
  }

  #forward({ method, path, headers, body }) {
    return new Promise((resolve, reject) => {
      const asked = send({ host: "127.0.0.1", port: this.port, method, path, headers }, (answer) => {
        const parts = [];
        answer.on("data", (part) => parts.push(part));
        answer.on("end", () => resolve({ status: answer.statusCode, headers: answer.headers, body: Buffer.concat(parts) }));
        answer.on("error", reject);
      });
      asked.on("error", reject);
      asked.end(body);
    });
  }

  #join(request, socket) {
    if (this.#isCut) return socket.destroy();
    const behind = connect(this.port, "127.0.0.1");
    const close = () => {
      socket.destroy();
      behind.destroy();
    };
    for (const end of [socket, behind]) for (const event of ["error", "close"]) end.on(event, close);
    const fields = Object.entries(this.#headers(request)).map(([name, value]) => `${name}: ${value}\r\n`);
    behind.write(`${request.method} ${request.url} HTTP/1.1\r\n${fields.join("")}\r\n`);
    socket.pipe(behind).pipe(socket);
  }
}
