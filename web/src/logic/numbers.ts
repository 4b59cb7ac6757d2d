// Numbers as people type them.

/** Units that a field accepts, as factors to the field's own unit. */
const UNITS: Record<"m" | "deg" | "px" | "", Record<string, number>> = {
  m: { m: 1, cm: 0.01, mm: 0.001 },
  deg: { deg: 1, "°": 1, rad: 180 / Math.PI },
  px: { px: 1 },
  "": {},
};

export type Unit = keyof typeof UNITS;

/** Value of a typed number such as `0.35`, `,35`, `35 cm`; relative to `current` after `+=`, `-=` or `*=` (`+=2cm`);
 * null when it is none. */
export function parseNumber(text: string, unit: Unit, current: number): number | null {
  const match = /^\s*(\+=|-=|\*=)?\s*([+-]?(?:\d+(?:[.,]\d*)?|[.,]\d+)(?:e[+-]?\d+)?)\s*([a-z°]*)\s*$/i.exec(text.replace("−", "-"));
  if (!match) return null;
  const [, relative, digits, typed] = match;
  const number = Number(digits!.replace(",", "."));
  const factor = typed === "" ? 1 : Object.entries(UNITS[unit]).find(([name]) => name === typed!.toLowerCase())?.[1];
  if (!Number.isFinite(number) || factor === undefined) return null;
  switch (relative) {
    case "+=":
      return current + number * factor;
    case "-=":
      return current - number * factor;
    case "*=":
      return current * number;
    default:
      return number * factor;
  }
}

/** Text of a value with `digits` decimals, without `-0`. */
export function formatNumber(value: number, digits: number): string {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? (0).toFixed(digits) : text;
}
