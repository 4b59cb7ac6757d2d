// New scenarios, cameras to choose from, and differences of the mock server.

const INTRINSICS = { width: 1280, height: 720, fx: 924, fy: 924, cx: 639.5, cy: 359.5 };
export const CAMERAS = {
  presets: [{ name: "d435", about: "RealSense D435, colour", intrinsics: INTRINSICS }],
  sensors: [{ name: "d435", about: "RealSense D435 at 848x480", sensor: { color: { exposure_stops: 0 } } }],
};

/** The last noun is known, the others only if a card has their name. */
export function phrasesOf(studio, text, send) {
  const words = text.toLowerCase().match(/(?:the|a) ([a-z]+(?: (?:mug|bowl|dragon))?)/g)?.map((one) => one.replace(/^(the|a) /, "")) ?? [];
  if (words.length === 0) return send(422, { error: { message: `the sentence is not understood: ${text}`, hint: "say what to move and where" } });
  const phrases = words.map((phrase) => {
    const noun = phrase.split(" ").at(-1);
    const found = [...studio.cards.values()].filter((card) => card.name.toLowerCase().includes(noun));
    const candidates = (found.length > 0 ? found : [...studio.cards.values()].slice(0, 3)).map(({ uid, name }) => ({ uid, name }));
    return { phrase, is_known: found.length > 0, candidates };
  });
  send(200, { phrases });
}

/** Scenario at a revision: what stood before the next command. */
export function at(document, revision) {
  return document.log.find((line) => line.op && line.revision === revision + 1)?.scenario ?? document.scenario;
}

export function difference(document, from) {
  const [before, after] = [at(document, from), document.scenario];
  const moved = after.objects.flatMap((object) => {
    const old = before.objects.find((one) => one.id === object.id);
    if (!old) return [];
    const distance_m = Math.hypot(...object.pose.position_m.map((value, axis) => value - old.pose.position_m[axis]));
    return distance_m > 0 ? [{ id: object.id, distance_m }] : [];
  });
  const ids = (scenario) => scenario.objects.map((object) => object.id);
  const texts = [before.task.instruction, after.task.instruction];
  return {
    moved,
    turned: [],
    articulated: [],
    added: ids(after).filter((id) => !ids(before).includes(id)),
    removed: ids(before).filter((id) => !ids(after).includes(id)),
    ...(texts[0] === texts[1] ? {} : { instruction: texts }),
    edges_added: [],
    edges_removed: [],
    cameras: [],
  };
}
