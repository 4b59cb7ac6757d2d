// Keyboard: one table for the listener, the tooltips and the page's help.

export interface Binding {
  action: string;
  /** As `describe` writes keys: `Shift+ArrowUp`. Several are alternatives. */
  keys: string[];
  group: "Scenario" | "Object" | "Edit" | "View" | "Verdict" | "Episode" | "Review";
  words: string;
}

export const BINDINGS: Binding[] = [
  { group: "Scenario", action: "help", keys: ["?"], words: "keys" },
  { group: "Scenario", action: "filter", keys: ["/"], words: "filter scenarios" },
  { group: "Scenario", action: "scenario.next", keys: ["j"], words: "next scenario" },
  { group: "Scenario", action: "scenario.previous", keys: ["k"], words: "previous scenario" },
  { group: "Scenario", action: "instruction", keys: ["i"], words: "edit the instruction" },
  { group: "Scenario", action: "goal", keys: ["o"], words: "edit the goal" },
  { group: "Scenario", action: "edges", keys: ["u"], words: "edit the scene graph" },
  { group: "Scenario", action: "new", keys: ["Shift+a"], words: "new scenario from a sentence" },
  { group: "Scenario", action: "difference", keys: ["Shift+c"], words: "what differs from an earlier revision" },
  { group: "Scenario", action: "questions", keys: ["Shift+q"], words: "answer the questions of an agent" },
  { group: "Scenario", action: "snapshot", keys: ["Ctrl+s"], words: "name this revision" },
  { group: "Object", action: "object.next", keys: ["n"], words: "select the next object" },
  { group: "Object", action: "object.previous", keys: ["Shift+n"], words: "select the previous object" },
  { group: "Object", action: "escape", keys: ["Escape"], words: "cancel a drag, leave a camera or an episode, deselect" },
  { group: "Object", action: "numbers", keys: ["Enter"], words: "type position and rotation" },
  { group: "Object", action: "move.left", keys: ["ArrowLeft"], words: "move 1 cm to the left of the view" },
  { group: "Object", action: "move.right", keys: ["ArrowRight"], words: "move 1 cm to the right" },
  { group: "Object", action: "move.far", keys: ["ArrowUp"], words: "move 1 cm away" },
  { group: "Object", action: "move.near", keys: ["ArrowDown"], words: "move 1 cm nearer" },
  { group: "Object", action: "move.up", keys: ["PageUp"], words: "move 1 cm up" },
  { group: "Object", action: "move.down", keys: ["PageDown"], words: "move 1 cm down" },
  { group: "Object", action: "turn.left", keys: ["["], words: "turn 15° to the left" },
  { group: "Object", action: "turn.right", keys: ["]"], words: "turn 15° to the right" },
  { group: "Object", action: "drop", keys: ["e"], words: "drop with physics" },
  { group: "Object", action: "lock", keys: ["Shift+l"], words: "lock or unlock" },
  { group: "Object", action: "hide", keys: ["Shift+h"], words: "hide or show" },
  { group: "Edit", action: "undo", keys: ["Ctrl+z"], words: "undo your last change" },
  { group: "Edit", action: "redo", keys: ["Ctrl+Shift+z", "Ctrl+y"], words: "redo" },
  { group: "Edit", action: "add", keys: ["a"], words: "add an object" },
  { group: "Edit", action: "swap", keys: ["w"], words: "swap the object" },
  { group: "Edit", action: "duplicate", keys: ["d"], words: "duplicate the object" },
  { group: "Edit", action: "remove", keys: ["Delete", "Backspace"], words: "remove the object" },
  { group: "View", action: "gizmo.move", keys: ["g"], words: "arrows that move" },
  { group: "View", action: "gizmo.turn", keys: ["r"], words: "rings that turn" },
  { group: "View", action: "snap", keys: ["x"], words: "snapping on or off (Alt while dragging)" },
  { group: "View", action: "frame", keys: ["f"], words: "look at the selected object" },
  { group: "View", action: "view.home", keys: ["h", "Home"], words: "whole table" },
  { group: "View", action: "view.top", keys: ["t"], words: "from above" },
  { group: "View", action: "view.side", keys: ["y"], words: "from the robot's left" },
  { group: "View", action: "view.robot", keys: ["b"], words: "from behind the robot" },
  { group: "View", action: "orbit.left", keys: [","], words: "orbit to the left" },
  { group: "View", action: "orbit.right", keys: ["."], words: "orbit to the right" },
  { group: "View", action: "zoom.in", keys: ["+", "="], words: "nearer" },
  { group: "View", action: "zoom.out", keys: ["-"], words: "farther" },
  { group: "View", action: "camera.next", keys: ["c"], words: "next camera's image" },
  { group: "View", action: "camera.look", keys: ["l"], words: "look through the camera" },
  { group: "View", action: "theme", keys: ["Shift+d"], words: "light or dark" },
  { group: "Verdict", action: "problem.next", keys: ["v"], words: "next problem" },
  { group: "Verdict", action: "repair", keys: ["m"], words: "first repair of this problem" },
  { group: "Verdict", action: "repair.all", keys: ["Shift+m"], words: "repair all I can" },
  { group: "Episode", action: "run", keys: ["Shift+p"], words: "run the chosen policy" },
  { group: "Episode", action: "teleop", keys: ["Shift+e"], words: "teleoperate the robot" },
  { group: "Episode", action: "play", keys: ["p"], words: "play or pause; without an episode, list them" },
  { group: "Episode", action: "moment.next", keys: ["s"], words: "next moment" },
  { group: "Episode", action: "moment.previous", keys: ["Shift+s"], words: "previous moment" },
  { group: "Review", action: "review.next", keys: ["q"], words: "next scenario to review" },
  { group: "Review", action: "review.mark", keys: ["1", "2", "3", "4", "5", "6", "7", "8"], words: "mark what is wrong" },
  { group: "Review", action: "review.approve", keys: ["Shift+y"], words: "approve" },
  { group: "Review", action: "review.reject", keys: ["Shift+r"], words: "reject" },
  { group: "Review", action: "review.send_back", keys: ["Shift+b"], words: "send back with the note" },
  { group: "Review", action: "review.take_back", keys: ["Shift+t"], words: "take your review back" },
  { group: "Review", action: "sheet", keys: ["Shift+z"], words: "contact sheet" },
  { group: "Review", action: "balance", keys: ["z"], words: "balance of the approved" },
];

/** Actions that Shift makes fine (1 mm, 1°). */
const FINE = /^(move|turn)\./;

interface KeyLike {
  key: string;
  ctrlKey: boolean;
  metaKey: boolean;
  altKey: boolean;
  shiftKey: boolean;
}

/** Key press as in the table. Symbols carry no Shift, since keyboards differ in where they need it. */
export function describe(event: KeyLike): string {
  const isLetter = /^[a-z]$/i.test(event.key);
  const isNamed = event.key.length > 1;
  const key = isLetter ? event.key.toLowerCase() : event.key;
  const shift = event.shiftKey && (isLetter || isNamed) ? "Shift+" : "";
  return `${event.ctrlKey || event.metaKey ? "Ctrl+" : ""}${event.altKey ? "Alt+" : ""}${shift}${key}`;
}

/** Action of a key press, if it has one; `fine` for the small step. */
export function actionOf(event: KeyLike): { action: string; fine: boolean } | null {
  const text = describe(event);
  const exact = BINDINGS.find((binding) => binding.keys.includes(text));
  if (exact) return { action: exact.action, fine: false };
  // Shift with a bracket is a brace on many keyboards.
  const plain = { "{": "[", "}": "]" }[text] ?? text.replace("Shift+", "");
  const fine = BINDINGS.find((binding) => FINE.test(binding.action) && binding.keys.includes(plain));
  return fine && (event.shiftKey || plain !== text) ? { action: fine.action, fine: true } : null;
}

/** True where typing belongs to a control: a shortcut must not fire there. */
export function isTyping(target: { tagName?: string; type?: string; isContentEditable?: boolean } | null, key: string): boolean {
  if (!target) return false;
  const tag = target.tagName?.toLowerCase();
  if (tag === "textarea" || tag === "select" || target.isContentEditable) return true;
  if (tag === "input") return !["checkbox", "radio", "button", "range"].includes(target.type ?? "text") || key === " ";
  // Enter and Space press what has the focus.
  return (tag === "button" || tag === "a" || tag === "summary") && (key === "Enter" || key === " ");
}

const SHOWN: Record<string, string> = {
  ArrowLeft: "←",
  ArrowRight: "→",
  ArrowUp: "↑",
  ArrowDown: "↓",
  PageUp: "Page ↑",
  PageDown: "Page ↓",
  Escape: "Esc",
  Delete: "Del",
  Backspace: "⌫",
};

/** Keys of an action as printed on keyboards. */
export function keyLabel(action: string): string {
  const keys = BINDINGS.find((binding) => binding.action === action)?.keys ?? [];
  return keys.map(printed).join(" or ");
}

export function printed(key: string): string {
  const parts = key === "+" ? ["+"] : key.split("+");
  return parts.map((part) => SHOWN[part] ?? (/^[a-z]$/.test(part) ? part.toUpperCase() : part)).join(" ");
}
