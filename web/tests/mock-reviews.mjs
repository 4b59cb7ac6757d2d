// Reviews of the stand-in server: independence, standing, certificates, balance, as the real one answers.

/** Answers a request about reviews; null if it is about something else. */
export class MockReviews {
  said = new Map();
  tried = new Set();

  constructor(documents) {
    this.documents = documents;
  }

  answer(what, rest, method, query, body) {
    if (what === "agreement") return [200, { decision: { items: 1, raw: 1, kappa: null, ac1: 1 }, criteria: {}, planted: { ada: { planted: 4, detected: 3, sound: 10, false_alarms: 1 } } }];
    if (what === "balance") return [200, this.balance(body?.targets)];
    if (what === "suites" && method === "GET") return [200, { suites: [{ name: "earlier", scenarios: ["one", "two"] }] }];
    if (what === "suites") return [200, { folder: `studio/${body.name}`, scenarios: this.approved().length, choice: {} }];
    if (what !== "reviews") return null;
    const reviewer = query.get("reviewer") ?? body.reviewer?.name ?? "";
    if (rest.length === 0) {
      const scenarios = [...this.documents.values()].map((document) => this.row(document, reviewer));
      return [200, { scenarios, next: scenarios.find((row) => row.work)?.key ?? null }];
    }
    const document = this.documents.get(decodeURIComponent(rest[0]));
    if (!document) return [404, { error: { message: "no scenario", hint: "" } }];
    if (rest[1] === "certificate") {
      this.tried.add(this.content(document));
      return [200, this.state(document, body.reviewer)];
    }
    if (method === "GET") return [200, this.state(document, reviewer)];
    if (body.content_sha256 !== this.content(document)) return [409, { conflict: { field: "content_sha256" } }];
    const own = this.reviews(document);
    if (body.decision.verdict === "take_back") own.delete(body.reviewer.name);
    else own.set(body.reviewer.name, body);
    return [200, this.state(document, body.reviewer.name)];
  }

  content(document) {
    return `${document.key} ${document.revision}`;
  }

  reviews(document) {
    const content = this.content(document);
    if (!this.said.has(content)) this.said.set(content, new Map());
    return this.said.get(content);
  }

  standing(document) {
    const all = [...this.reviews(document).values()];
    const independent = all.filter((review) => !review.adjudicates);
    if (all.some((review) => review.decision.verdict === "send_back")) return { standing: "sent_back" };
    if (independent.length < 2) return { standing: "open", missing: 2 - independent.length };
    const approvals = new Set(independent.map((review) => review.decision.verdict));
    const decided = approvals.size === 1 ? [...approvals][0] : all.find((review) => review.adjudicates)?.decision.verdict;
    if (!decided) return { standing: "adjudication" };
    if (decided !== "approve") return { standing: "rejected" };
    return { standing: this.tried.has(this.content(document)) ? "approved" : "uncertified" };
  }

  row(document, reviewer) {
    const { key, id, kind, instruction } = document.row();
    const standing = this.standing(document);
    const hasSaid = this.reviews(document).has(reviewer);
    const work = hasSaid ? null : { open: standing.missing === 1 ? "second" : "first", adjudication: "adjudicate" }[standing.standing] ?? null;
    const group = [...this.documents.keys()].indexOf(key) < 2 ? 0 : null;
    const camera = document.scenario.world.cameras[0].name;
    return { key, id, kind, source: "mock", instruction, camera, ...standing, work, has_said: hasSaid, is_certified: this.tried.has(this.content(document)), group };
  }

  state(document, reviewer) {
    const own = this.reviews(document);
    const isVisible = own.has(reviewer) || this.standing(document).standing !== "open";
    const content = this.content(document);
    const trials = this.tried.has(content) ? { episodes: 5, verified: 5 } : null;
    return { ...this.row(document, reviewer), content_sha256: content, reviews: isVisible ? [...own.values()] : [], trials };
  }

  approved() {
    return [...this.documents.values()].filter((document) => this.standing(document).standing === "approved");
  }

  balance(targets) {
    const rows = [...this.documents.values()];
    const kinds = [...new Set(rows.map((document) => document.row().kind))];
    const approved = this.approved();
    const count = (kind) => approved.filter((document) => document.row().kind === kind).length;
    const values = kinds.map((value) => ({ value, count: count(value), share: count(value) / Math.max(1, approved.length), wanted: targets?.kind?.[value] ?? 1 / kinds.length }));
    const distance = values.reduce((sum, value) => sum + Math.abs(value.share - value.wanted), 0) / 2;
    const other = rows.find((document) => !approved.includes(document));
    return {
      balance: {
        scenarios: approved.length,
        axes: [{ axis: "kind", total_variation: distance, values }],
        pairs: [{ axes: ["goal", "kind"], total_variation: 0.4, rarest: ["single", "spatial"] }],
      },
      worst: distance,
      helpful: [{ key: other.key, id: other.scenario.id, gain: 1, reason: `kind ${other.row().kind}: 0 %, wanted 25 %` }],
      standings: { approved: approved.length, open: rows.length - approved.length },
      policies: [{ policy: "expert", scenarios: 1, episodes: 5, successes: 5 }, { policy: "weak", scenarios: 1, episodes: 5, successes: 1 }],
      measured: [{ key: other.key, id: other.scenario.id, difficulty: "medium", mean_success: 0.6, policies: { expert: [5, 5], weak: [1, 5] } }],
      left_out: [{ episodes: 3, reason: "since the scenario was different when they were run" }],
    };
  }
}
