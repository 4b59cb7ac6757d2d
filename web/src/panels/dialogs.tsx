// Small dialogues: keys, instruction, snapshot, author.

import { signal, useSignal } from "@preact/signals";
import { BINDINGS, printed } from "../logic/keys.ts";
import { rename } from "../state/connection.ts";
import { apply } from "../state/edits.ts";
import { snapshot } from "../state/requests.ts";
import * as store from "../state/store.ts";
import { Dialog } from "./widgets.tsx";

interface Props {
  onClose: () => void;
}

/** Number of snapshots made by this page: the history is read again when it changes. */
export const snapshots = signal(0);

export function HelpDialog({ onClose }: Props) {
  const groups = [...new Set(BINDINGS.map((binding) => binding.group))];
  return (
    <Dialog title="Keys" wide onClose={onClose}>
      <div class="keys">
        {groups.map((group) => (
          <section key={group}>
            <h3>{group}</h3>
            <dl>
              {BINDINGS.filter((binding) => binding.group === group).map((binding) => (
                <div key={binding.action}>
                  <dt>
                    {binding.keys.map((key, index) => (
                      <span key={key}>
                        {index > 0 && <span class="muted"> or </span>}
                        <kbd>{printed(key)}</kbd>
                      </span>
                    ))}
                  </dt>
                  <dd>{binding.words}</dd>
                </div>
              ))}
            </dl>
          </section>
        ))}
      </div>
      <p class="muted">
        Shift with a move or turn: 1 mm, 1°. Arrow keys follow the view: each goes along the axis of the table that is nearest to that direction. Number fields take
        units and changes: 35 cm, +=2cm.
      </p>
    </Dialog>
  );
}

/** Most words of an instruction. */
const MOST_WORDS = 30;

export function InstructionDialog({ onClose }: Props) {
  const text = useSignal(store.current.peek()?.instruction ?? "");
  const words = text.value.trim().split(/\s+/).filter(Boolean).length;
  const isRight = words > 0 && words <= MOST_WORDS;
  const save = () => {
    if (!isRight) return;
    const now = text.value.trim();
    if (now !== store.current.peek()?.instruction) apply({ op: "instruction", args: { text: now } });
    onClose();
  };
  return (
    <Dialog title="Instruction" onClose={onClose}>
      <form onSubmit={(event) => (event.preventDefault(), save())}>
        <label class="field">
          <span>What the robot is asked to do</span>
          <textarea
            rows={4}
           
            value={text.value}
            onInput={(event) => (text.value = event.currentTarget.value)}
            onKeyDown={(event) => event.key === "Enter" && (event.ctrlKey || event.metaKey) && save()}
          />
        </label>
        <p class={isRight ? "muted" : "wrong"}>
          {words} of at most {MOST_WORDS} words
        </p>
        <FormButtons onClose={onClose} isRight={isRight} />
      </form>
    </Dialog>
  );
}

export function SnapshotDialog({ onClose }: Props) {
  const name = useSignal("");
  const save = async () => {
    const key = store.openKey.peek();
    const wanted = name.value.trim();
    if (!key || !wanted) return;
    try {
      await snapshot(key, wanted, store.author.peek(), new Date().toISOString());
      snapshots.value += 1;
      store.status.value = `Revision ${store.confirmed.peek()?.revision} is now called ${wanted}.`;
      onClose();
    } catch (error) {
      store.notify("The revision was not named.", { hint: (error as Error).message, isError: true });
    }
  };
  return (
    <Dialog title={`Name revision ${store.confirmed.value?.revision ?? ""}`} onClose={onClose}>
      <form onSubmit={(event) => (event.preventDefault(), void save())}>
        <label class="field">
          <span>Name</span>
          <input value={name.value} onInput={(event) => (name.value = event.currentTarget.value)} />
        </label>
        <FormButtons onClose={onClose} isRight={name.value.trim() !== ""} />
      </form>
    </Dialog>
  );
}

export function AuthorDialog({ onClose }: Props) {
  const name = useSignal(store.author.peek());
  const save = () => {
    const wanted = name.value.trim();
    if (wanted) rename(wanted);
    onClose();
  };
  return (
    <Dialog title="Your name" onClose={onClose}>
      <form onSubmit={(event) => (event.preventDefault(), save())}>
        <label class="field">
          <span>Name in the history; undo takes back what was done under it</span>
          <input autocomplete="nickname" value={name.value} onInput={(event) => (name.value = event.currentTarget.value)} />
        </label>
        <FormButtons onClose={onClose} isRight={name.value.trim() !== ""} />
      </form>
    </Dialog>
  );
}

export function FormButtons({ onClose, isRight }: Props & { isRight: boolean }) {
  return (
    <div class="actions end">
      <button type="button" onClick={onClose}>
        Cancel
      </button>
      <button type="submit" class="primary" disabled={!isRight}>
        Save
      </button>
    </div>
  );
}
