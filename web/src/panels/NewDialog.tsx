// A new scenario from one sentence; what its words may mean is asked back.

import { useSignal } from "@preact/signals";
import type { PhraseChoice } from "../contract.ts";
import { loadScenarios, open } from "../state/connection.ts";
import * as requests from "../state/requests.ts";
import * as store from "../state/store.ts";
import { Dialog } from "./widgets.tsx";

export function NewDialog({ onClose }: { onClose: () => void }) {
  const text = useSignal("");
  const phrases = useSignal<PhraseChoice[] | null>(null);
  const choices = useSignal<Record<string, string>>({});
  const busy = useSignal("");
  const failure = useSignal<string | null>(null);
  const isAsking = phrases.value !== null;
  const change = (words: string) => {
    text.value = words;
    phrases.value = null;
    choices.value = {};
    failure.value = null;
  };
  const submit = async () => {
    const wanted = text.peek().trim();
    if (!wanted || busy.peek()) return;
    failure.value = null;
    try {
      if (!isAsking) {
        busy.value = "Reading the sentence…";
        const found = await requests.phrases(wanted);
        const isClear = found.every((one) => one.is_known && one.candidates.length === 1);
        if (!isClear) {
          phrases.value = found;
          return;
        }
      }
      busy.value = "Composing the scene and laying it out…";
      const key = await requests.create(wanted, choices.peek());
      await loadScenarios();
      open(key);
      onClose();
    } catch (error) {
      failure.value = (error as Error).message;
    } finally {
      busy.value = "";
    }
  };
  const unknown = phrases.value?.some((one) => !one.is_known) ?? false;
  return (
    <Dialog title="New scenario" onClose={onClose}>
      <form onSubmit={(event) => (event.preventDefault(), void submit())}>
        <label class="field">
          <span>What the robot is asked to do</span>
          <input id="sentence" autocomplete="off" placeholder="Put the red mug to the left of the bowl." value={text.value} onInput={(event) => change(event.currentTarget.value)} />
        </label>
        {phrases.value?.map((one) =>
          one.is_known ? (
            one.candidates.length > 1 && (
              <label key={one.phrase} class="field">
                <span>“{one.phrase}” may be</span>
                <select value={choices.value[one.phrase] ?? ""} onChange={(event) => (choices.value = chosen(choices.value, one.phrase, event.currentTarget.value))}>
                  <option value="">any of these</option>
                  {one.candidates.map(({ uid, name }) => (
                    <option key={uid} value={uid}>
                      {name} ({uid})
                    </option>
                  ))}
                </select>
              </label>
            )
          ) : (
            <div key={one.phrase} class="field">
              <span class="wrong">
                No object is called “{one.phrase}”{one.candidates.length > 0 ? ". Say instead:" : ". Name another one."}
              </span>
              <div class="actions">
                {one.candidates.slice(0, 8).map(({ uid, name }) => (
                  <button key={uid} type="button" onClick={() => change(text.peek().replace(one.phrase, name.toLowerCase()))}>
                    {name}
                  </button>
                ))}
              </div>
            </div>
          ),
        )}
        {failure.value && (
          <p class="wrong" role="alert">
            {failure.value}
          </p>
        )}
        <p class="muted" role="status">
          {busy.value || (isAsking && !unknown ? "Choose what is meant, or leave it open." : "One sentence; directions are the robot's.")}
        </p>
        <div class="actions end">
          <button type="button" onClick={onClose}>
            Cancel
          </button>
          <button type="submit" class="primary" disabled={!text.value.trim() || busy.value !== "" || unknown || !store.isOnline.value}>
            {isAsking ? "Create" : "Next"}
          </button>
        </div>
      </form>
    </Dialog>
  );
}

function chosen(choices: Record<string, string>, phrase: string, uid: string): Record<string, string> {
  const { [phrase]: _, ...others } = choices;
  return uid ? { ...others, [phrase]: uid } : others;
}
