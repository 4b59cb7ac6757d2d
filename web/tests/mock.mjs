// A small server with the interface of `genmanip studio`, for the browser tests: real scenarios of a suite, stand-in
// meshes, a simple verdict. `node tests/mock.mjs [PORT]` runs it by hand.

import { createHash } from "node:crypto";
import { existsSync, readFileSync, readdirSync } from "node:fs";
import { createServer } from "node:http";
import path from "node:path";
import { fileURLToPath } from "node:url";
import { WebSocketServer } from "ws";
import { standIn } from "./glb.mjs";
import { MockReviews } from "./mock-reviews.mjs";
import { at, CAMERAS, difference, phrasesOf } from "./mock_making.mjs";
import { MockQuestions } from "./mock_questions.mjs";
import { answerRuns, POLICIES } from "./mock_runs.mjs";
import { teleoperate } from "./mock_teleop.mjs";

const HERE = path.dirname(fileURLToPath(import.meta.url));
const DIST = path.join(HERE, "../dist");
const SUITE = path.join(HERE, "../../suites/genmanip-200-rc/scenarios");

const COLOURS = {
  red: [0.6, 0.05, 0.05],
  orange: [0.85, 0.3, 0.03],
  yellow: [0.85, 0.6, 0.05],
  green: [0.1, 0.4, 0.1],
  blue: [0.05, 0.2, 0.6],
  brown: [0.25, 0.12, 0.06],
  black: [0.02, 0.02, 0.02],
  white: [0.8, 0.8, 0.78],
  pink: [0.8, 0.3, 0.4],
  purple: [0.3, 0.1, 0.4],
  silver: [0.5, 0.5, 0.52],
  gray: [0.3, 0.3, 0.32],
};
const TYPES = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css" };
const ROUND = /sphere|cylind|round|ellips|disc|bowl/i;

/** Starts the server on a free port; `close` stops it. */
export async function startMock({ port = 0, scenarios = 200, extraObjects = 0 } = {}) {
  const studio = new Studio(scenarios, extraObjects);
  const server = createServer((request, response) => void studio.answer(request, response));
  const sockets = new WebSocketServer({ noServer: true });
  server.on("upgrade", (request, socket, head) => {
    if (studio.isCut) socket.destroy();
    else sockets.handleUpgrade(request, socket, head, (tab) => (request.url.startsWith("/api/teleop") ? teleoperate(studio, tab) : studio.welcome(tab)));
  });
  await new Promise((resolve) => server.listen(port, "127.0.0.1", resolve));
  const url = `http://127.0.0.1:${server.address().port}/`;
  const close = () => {
    for (const tab of sockets.clients) tab.terminate();
    server.closeAllConnections();
    return new Promise((resolve) => server.close(resolve));
  };
  return { url, studio, close };
}

class Studio {
  isCut = false;
  meshes = new Map();
  tabs = new Map();
  documents = new Map();
  /** Commands that arrived, for tests: each id as often as it came. */
  arrived = [];

  constructor(count, extraObjects) {
    const files = readdirSync(SUITE).sort().slice(0, count);
    this.cards = new Map();
    for (const file of files) {
      const scenario = JSON.parse(readFileSync(path.join(SUITE, file), "utf8"));
      scenario.task.objects.forEach((card) => this.cards.set(card.uid, card));
      this.documents.set(scenario.id, new MockDocument(this, scenario, extraObjects));
    }
    this.reviews = new MockReviews(this.documents);
    this.questions = new MockQuestions();
  }

  /** Path of a stand-in mesh, made once. */
  mesh(shape, size, colour) {
    const bytes = standIn(shape, size, colour);
    const hash = createHash("sha256").update(bytes).digest("hex").slice(0, 16);
    this.meshes.set(hash, bytes);
    return `/meshes/${hash}.glb`;
  }

  cardMesh(card) {
    const colour = COLOURS[card.colors?.[0]] ?? [0.4, 0.4, 0.4];
    return this.mesh(ROUND.test(card.shape ?? "") ? "cylinder" : "box", card.size_m, colour);
  }

  /** Breaks all connections and refuses new ones, or accepts them again. */
  cut(isCut) {
    this.isCut = isCut;
    if (isCut) for (const tab of this.tabs.keys()) tab.terminate();
  }

  welcome(tab) {
    this.tabs.set(tab, { key: null, author: "" });
    tab.on("close", () => {
      const own = this.tabs.get(tab);
      this.tabs.delete(tab);
      if (own?.key) this.tellPresence(own.key);
    });
    tab.on("message", (text) => {
      const message = JSON.parse(text);
      const own = this.tabs.get(tab);
      if (message.type === "open") {
        own.key = message.scenario;
        own.author = message.author;
        const document = this.documents.get(own.key);
        if (!document) return;
        tab.send(JSON.stringify({ type: "scene", ...document.scene() }));
        this.tellPresence(own.key);
        this.tellVerdict(document, tab);
      } else if (message.type === "preview") {
        const document = this.documents.get(own.key);
        const preview = document?.with(message.objects);
        for (const stage of ["relations", "collision"]) {
          const problems = document.problems(preview).filter((problem) => problem.stage === stage);
          tab.send(JSON.stringify({ type: "verdict", revision: document.revision, stage, problems, done: stage === "collision", preview: true }));
        }
      }
    });
  }

  tell(key, message) {
    for (const [tab, own] of this.tabs) if (own.key === key) tab.send(JSON.stringify(message));
  }

  tellPresence(key) {
    this.tell(key, { type: "presence", authors: [...this.tabs.values()].filter((own) => own.key === key).map((own) => own.author) });
  }

  tellVerdict(document, only) {
    const problems = document.problems();
    const stages = ["wording", "relations", "collision", "reach", "visibility", "stability", "goal"];
    const revision = document.revision;
    stages.forEach((stage, index) => {
      setTimeout(() => {
        if (document.revision !== revision) return;
        const message = { type: "verdict", revision, stage, problems: problems.filter((problem) => problem.stage === stage), done: index === stages.length - 1, preview: false };
        if (only) only.send(JSON.stringify(message));
        else this.tell(document.key, message);
      }, 5 + index * 15);
    });
  }

  async answer(request, response) {
    const send = (status, body, headers = {}) => {
      const isBytes = Buffer.isBuffer(body);
      response.writeHead(status, { "content-type": isBytes ? "application/octet-stream" : "application/json", ...headers });
      response.end(isBytes ? body : JSON.stringify(body));
    };
    if (this.isCut) return request.socket.destroy();
    const url = new URL(request.url, "http://localhost");
    const [, area, what, ...rest] = url.pathname.split("/");
    let text = "";
    for await (const part of request) text += part;
    const body = text ? JSON.parse(text) : {};
    if (area === "meshes") {
      const bytes = this.meshes.get(what.replace(".glb", ""));
      return bytes ? send(200, bytes, { "cache-control": "max-age=31536000, immutable", "content-type": "model/gltf-binary" }) : send(404, { error: "no such mesh" });
    }
    if (area !== "api") return this.file(url.pathname, send);
    if (what === "cameras") return send(200, CAMERAS);
    if (what === "sentences") return phrasesOf(this, body.text, send);
    if (what === "scenarios" && rest.length === 0 && request.method === "POST") return this.create(body, send);
    if (what === "policies") return send(200, POLICIES);
    if (what === "session") return send(200, { version: "mock", author: "ada", needs_token: false, asks: true });
    if (what === "questions") return send(...this.questions.answer(rest, body));
    if (what === "catalogue") return rest[1] === "thumbnail" ? this.thumbnail(rest[0], send) : send(200, this.search(url.searchParams));
    if (what === "scenarios" && rest.length === 0) return send(200, [...this.documents.values()].map((document) => document.row()));
    const reviewed = this.reviews.answer(what, rest, request.method, url.searchParams, body);
    if (reviewed) return send(...reviewed);
    const document = this.documents.get(decodeURIComponent(rest[0]));
    if (!document) return send(404, { error: { message: "there is no such scenario", hint: "the list of scenarios names all" } });
    switch (rest[1]) {
      case undefined:
        return send(200, document.scene(url.searchParams.has("revision") ? at(document, Number(url.searchParams.get("revision"))).objects : undefined));
      case "verdict":
        return send(200, { revision: document.revision, problems: document.problems() });
      case "world":
        return send(200, document.scenario.world);
      case "difference":
        return send(200, difference(document, Number(url.searchParams.get("from"))));
      case "run":
      case "episodes":
        return answerRuns(this, document, rest.slice(1), request.method, url.searchParams, body, send);
      case "history":
        return send(200, document.log.map(({ scenario: _, ...line }) => line));
      case "snapshots":
        document.log.push({ snapshot: body.name, revision: document.revision, author: body.author, at: body.at });
        return send(200, {});
      case "settle":
        return send(200, document.settled(body.objects));
      case "repairs":
        return send(200, { repairs: document.problems().find((problem) => problem.code === body.code && problem.object === body.object)?.later ?? [] });
      case "images":
        return send(200, document.image(), { "content-type": "image/svg+xml", "x-visible-shares": JSON.stringify(document.shares()) });
      case "revert": {
        // Poses alone: enough for the page.
        const line = document.log.find((one) => one.revision === body.revision && one.op === "place");
        const objects = (line?.args.objects ?? []).map(({ id }) => ({ id, pose: line.scenario.objects.find((one) => one.id === id).pose }));
        return this.command(document, "commands", { ...body, op: "place", args: { objects }, base_revision: document.revision }, send);
      }
      case "commands":
      case "undo":
      case "redo":
        this.arrived.push(body.client_operation_id);
        return this.command(document, rest[1], body, send);
      default:
        return send(404, { error: { message: "no such page" } });
    }
  }

  command(document, what, body, send) {
    const target = document.read_only ? this.copyOf(document) : document;
    const { status, ...answer } = what === "commands" ? target.apply(body) : target.step(what, body);
    send(status, status === 200 ? target.state() : answer);
    if (status !== 200) return;
    this.tell(target.key, { type: "applied", client_operation_id: body.client_operation_id, author: body.author, state: target.state() });
    this.tellVerdict(target);
  }

  create({ text, choices }, send) {
    const scenario = structuredClone(this.documents.values().next().value.scenario);
    const key = `new-${this.documents.size}`;
    scenario.id = key;
    scenario.task.instruction = text;
    this.documents.set(key, new MockDocument(this, scenario, 0, key));
    this.created = { text, choices };
    send(200, { key });
  }

  copyOf(document) {
    const key = `${document.key}-copy`;
    if (!this.documents.has(key)) {
      const copy = new MockDocument(this, structuredClone(document.scenario), 0, key);
      copy.parent = document.key;
      this.documents.set(key, copy);
    }
    return this.documents.get(key);
  }

  file(name, send) {
    const file = path.join(DIST, name === "/" ? "index.html" : path.normalize(name));
    if (!file.startsWith(DIST) || !existsSync(file)) return send(404, { error: "no such file" });
    return send(200, readFileSync(file), { "content-type": TYPES[path.extname(file)] ?? "application/octet-stream" });
  }

  search(query) {
    const words = (query.get("query") ?? "").toLowerCase().split(/\s+/).filter(Boolean);
    return [...this.cards.values()]
      .filter((card) => words.every((word) => `${card.name} ${card.description} ${card.category}`.toLowerCase().includes(word)))
      .filter((card) => query.get("graspable") !== "true" || card.can_grasp)
      .slice(0, Number(query.get("limit") ?? 40))
      .map((card) => ({ uid: card.uid, name: card.name, description: card.description, category: card.category, size_m: card.size_m, thumbnail: `/api/catalogue/${card.uid}/thumbnail` }));
  }

  thumbnail(uid, send) {
    const [r, g, b] = (COLOURS[this.cards.get(uid)?.colors?.[0]] ?? [0.5, 0.5, 0.5]).map((value) => Math.round(255 * value ** 0.45));
    const svg = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 112 84"><rect x="32" y="18" width="48" height="48" rx="8" fill="rgb(${r},${g},${b})"/></svg>`;
    return send(200, Buffer.from(svg), { "content-type": "image/svg+xml" });
  }
}

/** A scenario with its edits. */
class MockDocument {
  revision = 0;
  log = [];
  seen = new Map();
  parent = null;
  /** Per author: revisions to undo and to redo, newest last. */
  done = new Map();
  undone = new Map();

  constructor(studio, scenario, extraObjects, key = scenario.id) {
    this.studio = studio;
    this.scenario = scenario;
    this.key = key;
    this.read_only = false;
    for (let index = 0; index < extraObjects; index++) {
      const [x, y] = [0.22 + 0.085 * (index % 8), -0.46 + 0.1 * Math.floor(index / 8)];
      this.insert(scenario.task.objects[0], { position_m: [x, y, 0], orientation_wxyz: [1, 0, 0, 0] });
    }
  }

  insert(card, pose, id = this.freeId(card.uid)) {
    this.scenario.task.objects.push(card);
    this.scenario.task.scene_graph.nodes.push({ id, asset: card.asset });
    this.scenario.objects.push({ id, asset: card.asset, pose });
  }

  freeId(uid) {
    const taken = new Set(this.scenario.objects.map((object) => object.id));
    for (let copy = 1; ; copy++) {
      const id = copy === 1 ? uid : `${uid}#${copy}`;
      if (!taken.has(id)) return id;
    }
  }

  row() {
    const { task, objects } = this.scenario;
    return { key: this.key, id: this.scenario.id, kind: task.kind, instruction: task.instruction, source: this.parent ? "copies" : "suite genmanip-200-rc", read_only: this.read_only, revision: this.revision, objects: objects.length };
  }

  card(id) {
    const { nodes } = this.scenario.task.scene_graph;
    return this.scenario.task.objects[nodes.findIndex((node) => node.id === id)];
  }

  state(objects = this.scenario.objects) {
    const { task, world } = this.scenario;
    const atoms = task.goal.flat();
    const roleOf = (id) => {
      if (atoms.some((atom) => (atom.subject ?? atom.object) === id)) return "moved";
      if (atoms.some((atom) => atom.reference === id || atom.second_reference === id)) return "reference";
      return task.scene_graph.edges.some((edge) => [edge.subject, edge.reference].includes(id)) ? "other" : "distractor";
    };
    const name = (id) => this.card(id)?.name ?? id;
    return {
      key: this.key,
      revision: this.revision,
      kind: task.kind,
      instruction: task.instruction,
      paraphrases: [],
      goal: task.goal,
      goal_sentences: task.goal.map((one) => one.map((atom) => `the ${name(atom.subject)} is ${atom.relation} the ${name(atom.reference)}`).join(" and ")),
      description: task.scene_graph.description,
      edges: task.scene_graph.edges,
      objects: objects.map((object) => {
        const card = this.card(object.id);
        const isBox = object.id.startsWith("articulated");
        return {
          id: object.id,
          uid: card.uid,
          name: card.name,
          description: card.description,
          role: roleOf(object.id),
          graspable: card.can_grasp,
          pose: object.pose,
          joint_positions: object.joint_positions ?? (card.states.length ? [0] : []),
          states: card.states.length ? card.states : isBox ? ["open", "closed"] : [],
          state: card.states.length ? (object.joint_positions?.[0] > 0.1 ? card.states[0] : card.states[1]) : null,
          ...(card.states.length
            ? { joints: [{ name: "lid", kind: "hinge", lower: 0, upper: 1.5 }] }
            : {}),
          bounds_m: boundsOf(card, object.pose),
          links: [{ name: "body", mesh: this.studio.cardMesh(card), world_from_link: object.pose }],
        };
      }),
      cameras: world.cameras.map((camera) => ({
        ...camera,
        world_from_camera: camera.mount === "world" ? camera.mount_from_camera : { position_m: [0.35, 0, 0.5], orientation_wxyz: [0, 1, 0, 0] },
      })),
      can_undo: [...this.done.values()].some((list) => list.length > 0),
      can_redo: [...this.undone.values()].some((list) => list.length > 0),
    };
  }

  scene(objects) {
    const { world, id } = this.scenario;
    const link = (name, size, at, colour) => ({ name, mesh: this.studio.mesh("box", size, colour), world_from_link: { position_m: at, orientation_wxyz: [1, 0, 0, 0] } });
    const grey = [0.55, 0.56, 0.58];
    return {
      key: this.key,
      id,
      read_only: this.read_only,
      source: this.parent ? "copies" : "suite genmanip-200-rc",
      parent: this.parent,
      revision: this.revision,
      state: this.state(objects),
      surfaces: world.surfaces.map((surface) => ({ id: surface.id, name: surface.name, center_m: surface.top_center_m, size_m: surface.size_m, yaw_rad: surface.yaw_rad })),
      workspace: world.workspace,
      robot: { name: "panda", links: [link("base", [0.16, 0.16, 0.33], [0, 0, 0], grey), link("arm", [0.12, 0.12, 0.35], [0, 0, 0.33], [0.85, 0.85, 0.84]), link("hand", [0.42, 0.1, 0.1], [0.2, 0, 0.62], grey)] },
    };
  }

  /** Objects with some placed elsewhere. */
  with(placements) {
    return this.scenario.objects.map((object) => {
      const placed = placements.find((one) => one.id === object.id);
      return placed ? { ...object, ...placed } : object;
    });
  }

  apply(command) {
    const known = this.seen.get(command.client_operation_id);
    if (known) return { status: 200 };
    const fields = fieldsOf(command);
    const later = this.log.filter((line) => line.op && line.revision > command.base_revision);
    const clash = later.flatMap((line) => fieldsOf(line)).find((field) => fields.some((own) => own === field || own.startsWith(`${field}/`) || field.startsWith(`${own}/`)));
    if (clash) return { status: 409, conflict: { field: clash, mine: this.valueOf(command), theirs: this.valueNow(clash), revision: this.revision } };
    const before = structuredClone(this.scenario);
    const error = this.change(command);
    if (error) {
      this.scenario = before;
      return { status: 422, error };
    }
    this.record(command, before);
    this.push(this.done, command.author, { before });
    this.undone.set(command.author, []);
    return { status: 200 };
  }

  record(command, before, more = {}) {
    this.revision += 1;
    const { op, args, author, at, client_operation_id } = command;
    this.log.push({ revision: this.revision, op, args, author, at, client_operation_id, scenario: before, ...more });
    this.seen.set(client_operation_id, this.revision);
  }

  push(map, author, value) {
    map.set(author, [...(map.get(author) ?? []), value]);
  }

  /** Undo and redo by whole scenarios: enough for one author at a time. */
  step(what, body) {
    if (this.seen.has(body.client_operation_id)) return { status: 200 };
    const [from, to] = what === "undo" ? [this.done, this.undone] : [this.undone, this.done];
    const last = from.get(body.author)?.pop();
    if (!last) return { status: 422, error: { message: `there is nothing to ${what}`, hint: "somebody else's changes are theirs to undo" } };
    const before = this.scenario;
    this.scenario = last.before;
    this.record({ ...body, op: what, args: {} }, before, what === "undo" ? { undoes: this.revision } : { redoes: this.revision });
    this.push(to, body.author, { before });
    return { status: 200 };
  }

  change({ op, args }) {
    const { task, world } = this.scenario;
    const object = this.scenario.objects.find((one) => one.id === args.object);
    switch (op) {
      case "place":
        for (const { id, pose, joint_positions } of args.objects) {
          const own = this.scenario.objects.find((one) => one.id === id);
          if (!own) return { message: `there is no object ${id}`, hint: "it was removed" };
          own.pose = pose;
          if (joint_positions) own.joint_positions = joint_positions;
        }
        return null;
      case "state": {
        const positions = this.card(args.object).states.indexOf(args.state) === 0 ? [1.2] : [0];
        object.joint_positions = args.joint_positions ?? positions;
        return null;
      }
      case "add":
        this.insert(this.studio.cards.get(args.asset), args.pose);
        return null;
      case "duplicate":
        this.insert(this.card(args.object), args.pose);
        return null;
      case "remove": {
        if (task.goal.flat().some((atom) => [atom.subject, atom.reference].includes(args.object))) {
          return { message: `the goal needs the ${this.card(args.object).name}`, hint: "change the goal first" };
        }
        const index = task.scene_graph.nodes.findIndex((node) => node.id === args.object);
        task.objects.splice(index, 1);
        task.scene_graph.nodes.splice(index, 1);
        task.scene_graph.edges = task.scene_graph.edges.filter((edge) => ![edge.subject, edge.reference, edge.second_reference].includes(args.object));
        this.scenario.objects = this.scenario.objects.filter((one) => one !== object);
        return null;
      }
      case "swap": {
        const index = task.scene_graph.nodes.findIndex((node) => node.id === args.object);
        task.objects[index] = this.studio.cards.get(args.uid);
        return null;
      }
      case "instruction":
        task.instruction = args.text;
        return null;
      case "goal":
        task.goal = args.goal;
        return null;
      case "edges":
        task.scene_graph.edges = args.edges;
        task.scene_graph.description = args.description ?? task.scene_graph.description;
        return null;
      case "kind":
        task.kind = args.kind;
        return null;
      case "camera": {
        const index = world.cameras.findIndex((camera) => camera.name === args.camera.name);
        if (index >= 0) world.cameras[index] = args.camera;
        else world.cameras.push(args.camera);
        return null;
      }
      case "remove_camera":
        world.cameras = world.cameras.filter((camera) => camera.name !== args.name);
        return null;
      default:
        return { message: `there is no operation ${op}`, hint: "" };
    }
  }

  valueOf({ op, args }) {
    return op === "place" ? args.objects[0].pose : (Object.values(args)[0] ?? null);
  }

  valueNow(field) {
    const [what, id] = field.split("/");
    if (what === "objects") return this.scenario.objects.find((object) => object.id === id)?.pose ?? null;
    return { instruction: this.scenario.task.instruction, goal: this.scenario.task.goal, kind: this.scenario.task.kind }[what] ?? null;
  }

  problems(objects = this.scenario.objects) {
    const found = [];
    const boxes = objects.map((object) => ({ id: object.id, pose: object.pose, name: this.card(object.id).name, box: boundsOf(this.card(object.id), object.pose) }));
    const { x, y } = this.scenario.world.workspace;
    const lift = (one, by) => [{ label: `set it on the table, ${(by * 1000).toFixed(0)} mm lower`, op: "place", args: { objects: [{ id: one.id, pose: { ...one.pose, position_m: [one.pose.position_m[0], one.pose.position_m[1], one.pose.position_m[2] - by] } }] } }];
    const supported = new Set(this.scenario.task.scene_graph.edges.filter((edge) => ["on", "in", "top"].includes(edge.relation)).map((edge) => edge.subject));
    for (const one of boxes) {
      const bottom = one.box[0][2];
      if (bottom > 0.002 && !supported.has(one.id)) {
        found.push({ stage: "collision", code: "floating", object: one.id, message: `the ${one.name} floats ${(bottom * 1000).toFixed(1)} mm above the table (at most 2.0 mm)`, value: bottom * 1000, limit: 2, unit: "mm", blocking: true, repairs: lift(one, bottom) });
      }
      if (one.pose.position_m[0] < x[0] || one.pose.position_m[0] > x[1] || Math.abs(one.pose.position_m[1]) > y[1]) {
        found.push({ stage: "reach", code: "outside", object: one.id, message: `the ${one.name} is outside of the working area`, blocking: true, repairs: [], later: [{ label: "move it to the middle of the table", op: "place", args: { objects: [{ id: one.id, pose: { ...one.pose, position_m: [0.55, 0, one.pose.position_m[2]] } }] } }] });
      }
    }
    for (const [index, one] of boxes.entries()) {
      for (const other of boxes.slice(index + 1)) {
        if (supported.has(one.id) || supported.has(other.id)) continue;
        const depth = Math.min(...[0, 1, 2].map((axis) => Math.min(one.box[1][axis], other.box[1][axis]) - Math.max(one.box[0][axis], other.box[0][axis])));
        if (depth < 0.004) continue;
        found.push({ stage: "collision", code: "overlap", object: one.id, other: other.id, message: `the ${one.name} overlaps the ${other.name} by ${(depth * 1000).toFixed(1)} mm (at most 4.0 mm)`, value: depth * 1000, limit: 4, unit: "mm", blocking: depth > 0.01, repairs: [] });
      }
    }
    return found;
  }

  settled(ids) {
    const objects = this.scenario.objects
      .filter((object) => ids.includes(object.id))
      .map((object) => ({ id: object.id, pose: { ...object.pose, position_m: [object.pose.position_m[0], object.pose.position_m[1], 0] } }));
    return { op: "place", args: { objects } };
  }

  shares() {
    return Object.fromEntries(this.scenario.objects.map((object, index) => [object.id, Math.max(0.35, 1 - index * 0.08)]));
  }

  image() {
    const shapes = this.scenario.objects.map((object) => {
      const [r, g, b] = (COLOURS[this.card(object.id).colors?.[0]] ?? [0.4, 0.4, 0.4]).map((value) => Math.round(255 * value ** 0.45));
      const [x, y] = object.pose.position_m;
      return `<circle cx="${256 + y * 380}" cy="${60 + (x - 0.1) * 260}" r="16" fill="rgb(${r},${g},${b})"/>`;
    });
    return Buffer.from(`<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 512 288" width="512" height="288"><rect width="512" height="288" fill="#fff"/><rect x="40" y="40" width="432" height="228" fill="#d8d0c2"/>${shapes.join("")}</svg>`);
  }
}

function fieldsOf({ op, args }) {
  switch (op) {
    case "place":
      return args.objects.map((placement) => `objects/${placement.id}/pose`);
    case "remove":
    case "swap":
      return [`objects/${args.object}`];
    case "add":
    case "duplicate":
    case "undo":
    case "redo":
      return [];
    case "camera":
      return [`cameras/${args.camera.name}`];
    case "remove_camera":
      return [`cameras/${args.name}`];
    default:
      return [op];
  }
}

function boundsOf(card, pose) {
  const [w, , , z] = pose.orientation_wxyz;
  const yaw = 2 * Math.atan2(z, w);
  const [sx, sy, sz] = card.size_m;
  const half = [(Math.abs(Math.cos(yaw)) * sx + Math.abs(Math.sin(yaw)) * sy) / 2, (Math.abs(Math.sin(yaw)) * sx + Math.abs(Math.cos(yaw)) * sy) / 2];
  const [x, y, bottom] = pose.position_m;
  return [[x - half[0], y - half[1], bottom], [x + half[0], y + half[1], bottom + sz]];
}

if (process.argv[1] === fileURLToPath(import.meta.url)) {
  const { url, studio } = await startMock({ port: Number(process.argv[2] ?? 8123) });
  const [first] = studio.documents.values();
  first.read_only = true;
  console.log(url);
}
