// Questions of the stand-in server: one with marks, one with a list, one without a schema.

const IMAGE = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 640 360" width="640" height="360"><rect width="640" height="360" fill="#d8d0c2"/><circle cx="220" cy="180" r="40" fill="#a33"/><circle cx="430" cy="190" r="40" fill="#36a"/><g font-size="26" fill="#fff" text-anchor="middle"><text x="220" y="188">1</text><text x="430" y="198">2</text></g></svg>';
const object = (properties) => ({ type: "object", properties, required: Object.keys(properties), additionalProperties: false });
const text = { type: "string" };
const asked = (words, name, schema) => ({
  id: name,
  how_to_answer: "",
  messages: [{ role: "user", parts: [{ text: words }, { image: "picture_1.png" }] }],
  ...(schema ? { reply_schema: { name, schema } } : {}),
});

export class MockQuestions {
  questions = new Map([
    ["001", asked(["Which number marks the red ball?"], "object", object({ number: { type: "integer", enum: [-1, 1, 2] }, object_name: text, color: text }))],
    ["002", asked(["Split the task into sub-tasks."], "decompose", object({ subtasks: { type: "array", items: text } }))],
    ["003", asked(["Where shall it go?"], "point_to_point", object({ selected_point: object({ type: { type: "string", enum: ["grid"] }, label: text }), turn_deg: { type: "number" } }))],
  ]);
  answers = new Map();

  answer([name, what], body) {
    if (name === undefined) {
      const row = (name) => ({ name, is_answered: this.answers.has(name), duration_s: this.answers.get(name)?.duration_s ?? null });
      return [200, { folder: "questions", questions: [...this.questions.keys()].map(row) }];
    }
    if (what === "images") return [200, Buffer.from(IMAGE), { "content-type": "image/svg+xml" }];
    if (what !== "answer") return [200, { name, question: this.questions.get(name), answer: null }];
    if (this.answers.has(name)) return [409, { conflict: { field: "answer", name } }];
    this.answers.set(name, body);
    return [200, { name }];
  }
}
