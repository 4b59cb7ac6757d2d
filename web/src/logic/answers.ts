// Answers to a model's questions, as the JSON schema of the reply asks for them.

/** The part of JSON Schema that questions use. */
export interface Schema {
  type?: "object" | "array" | "string" | "integer" | "number" | "boolean";
  enum?: (string | number)[];
  properties?: Record<string, Schema>;
  items?: Schema;
}

export type Json = null | boolean | number | string | Json[] | { [key: string]: Json };

/** Texts that may stay empty: no decision depends on them. */
const REMARKS = new Set(["reasoning", "reason", "color", "scene_description"]);

/** The only value that a schema allows; undefined if there are several. */
function only(schema: Schema): string | number | undefined {
  return schema.enum?.length === 1 ? schema.enum[0] : undefined;
}

/** Fields of an object that a person fills in: those with a choice. */
export function fields(schema: Schema): [string, Schema][] {
  return Object.entries(schema.properties ?? {}).filter(([, own]) => only(own) === undefined);
}

/** An answer without any decision: null where one is needed. */
export function blank(schema: Schema): Json {
  const given = only(schema);
  if (given !== undefined) return given;
  switch (schema.type) {
    case "object":
      return Object.fromEntries(Object.entries(schema.properties ?? {}).map(([key, own]) => [key, blank(own)]));
    case "array":
      return [];
    case "string":
      return schema.enum ? null : "";
    case "number":
      return 0;
    default:
      return null;
  }
}

/** Name of the first field that still needs a value; null when the answer is whole. */
export function missing(schema: Schema, value: Json, name = "answer"): string | null {
  if (schema.type === "object") {
    const own = value as { [key: string]: Json };
    for (const [key, part] of fields(schema)) {
      const found = missing(part, own[key] ?? null, key);
      if (found) return found;
    }
    return null;
  }
  if (schema.type === "array") {
    return (value as Json[]).map((item) => missing(schema.items ?? {}, item, name)).find((found) => found !== null) ?? null;
  }
  if (value === null) return name;
  return value === "" && !REMARKS.has(name) ? name : null;
}

/** Name of a field in words. */
export const fieldName = (key: string) => key.replaceAll("_", " ").replace(/^./, (letter) => letter.toUpperCase());

/** Median of the times; null without one. */
export function median(times: number[]): number | null {
  const sorted = [...times].sort((a, b) => a - b);
  const middle = sorted.length >> 1;
  if (sorted.length === 0) return null;
  return sorted.length % 2 ? sorted[middle]! : (sorted[middle - 1]! + sorted[middle]!) / 2;
}
