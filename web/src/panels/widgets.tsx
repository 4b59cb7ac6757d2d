// Parts that several panels use.

import type { ComponentChildren, TargetedKeyboardEvent } from "preact";
import { useLayoutEffect, useRef, useState } from "preact/hooks";
import { formatNumber, parseNumber, type Unit } from "../logic/numbers.ts";
import { keyLabel } from "../logic/keys.ts";

/** Text of a tooltip with the action's keys. */
export function withKeys(words: string, action: string): string {
  const keys = keyLabel(action);
  return keys ? `${words} (${keys})` : words;
}

interface NumberFieldProps {
  label: string;
  name: string;
  value: number;
  digits: number;
  unit: Unit;
  step: number;
  disabled?: boolean;
  onCommit: (value: number) => void;
}

/** Number that is committed on Enter, on leaving, and by the arrow keys; Escape restores it. */
export function NumberField({ label, name, value, digits, unit, step, disabled, onCommit }: NumberFieldProps) {
  const shown = formatNumber(value, digits);
  const [text, setText] = useState<string | null>(null);
  const [isWrong, setWrong] = useState(false);
  // From the field itself: a key may come before what was typed has been rendered.
  const commit = (typed: string) => {
    if (typed === shown) {
      setText(null);
      setWrong(false);
      return;
    }
    const parsed = parseNumber(typed, unit, value);
    setWrong(parsed === null);
    if (parsed === null) return;
    setText(null);
    if (formatNumber(parsed, digits + 2) !== formatNumber(value, digits + 2)) onCommit(parsed);
  };
  const onKeyDown = (event: TargetedKeyboardEvent<HTMLInputElement>) => {
    if (event.key === "Enter") commit(event.currentTarget.value);
    else if (event.key === "Escape") {
      event.currentTarget.value = shown;
      setText(null);
      setWrong(false);
      event.currentTarget.blur();
    } else if (event.key === "ArrowUp" || event.key === "ArrowDown") {
      event.preventDefault();
      const by = step * (event.shiftKey ? 0.1 : 1) * (event.key === "ArrowUp" ? 1 : -1);
      setText(null);
      onCommit(value + by);
    }
  };
  return (
    <label class="number">
      <span>{label}</span>
      <input
        data-field={name}
        inputMode="decimal"
        autocomplete="off"
        spellcheck={false}
        value={text ?? shown}
        disabled={disabled}
        aria-invalid={isWrong}
        onFocus={(event) => event.currentTarget.select()}
        onInput={(event) => setText(event.currentTarget.value)}
        onKeyDown={onKeyDown}
        onBlur={(event) => commit(event.currentTarget.value)}
      />
      {unit && <span class="unit">{unit === "deg" ? "°" : unit}</span>}
    </label>
  );
}

interface DialogProps {
  title: string;
  wide?: boolean;
  /** As large as the window. */
  full?: boolean;
  onClose: () => void;
  children: ComponentChildren;
}

/** Modal dialogue: the browser keeps the focus in it and gives it back. */
export function Dialog({ title, wide, full, onClose, children }: DialogProps) {
  const own = useRef<HTMLDialogElement>(null);
  const isLeaving = useRef(false);
  // Before the next key: an effect after painting would let it reach the page below.
  useLayoutEffect(() => {
    const dialog = own.current!;
    const before = document.activeElement as HTMLElement | null;
    dialog.showModal();
    // The first field, not the button that closes.
    dialog.querySelector<HTMLElement>("input, select, textarea")?.focus();
    return () => {
      isLeaving.current = true;
      dialog.close();
      before?.focus?.({ preventScroll: true });
    };
  }, []);
  return (
    <dialog ref={own} class={full ? "full" : wide ? "wide" : ""} aria-labelledby="dialog-title" onClose={() => isLeaving.current || onClose()}>
      <header>
        <h2 id="dialog-title">{title}</h2>
        <button type="button" class="quiet" aria-label="Close" onClick={onClose}>
          <Icon name="close" />
        </button>
      </header>
      {children}
    </dialog>
  );
}

const ICONS = {
  close: "M4 4l8 8M12 4l-8 8",
  undo: "M6 3 3 6l3 3M3 6h6a4 4 0 0 1 0 8H6",
  redo: "M10 3l3 3-3 3M13 6H7a4 4 0 0 0 0 8h3",
  moon: "M13 9.5A5.5 5.5 0 1 1 6.5 3 4.5 4.5 0 0 0 13 9.5z",
  plus: "M8 3v10M3 8h10",
  lock: "M4.5 7.5h7v5.5h-7zM6 7.5V5.5a2 2 0 0 1 4 0v2",
  edit: "M3 13l.7-2.8L10.5 3.4l2.1 2.1L5.8 12.3z",
} as const;

export function Icon({ name }: { name: keyof typeof ICONS }) {
  return (
    <svg class="icon" viewBox="0 0 16 16" aria-hidden="true">
      <path d={ICONS[name]} />
    </svg>
  );
}
