// Questions of an agent with their images, and a form for the answer: a person is measured as its model.

import { useEffect, useLayoutEffect, useRef } from "preact/hooks";
import { blank, fieldName, fields, median, missing, type Json, type Schema } from "../logic/answers.ts";
import * as questions from "../state/questions.ts";
import { address } from "../state/requests.ts";
import { Dialog, Icon } from "./widgets.tsx";

export function QuestionsDialog({ onClose }: { onClose: () => void }) {
  useEffect(() => {
    questions.resume();
    void questions.load();
    return questions.pause;
  }, []);
  const question = questions.shown.value;
  return (
    <Dialog title="Questions of the agent" full onClose={onClose}>
      <p class="muted" role="status">
        {progress()}
      </p>
      {question && <Shown key={question.name} question={question} />}
    </Dialog>
  );
}

function progress(): string {
  const rows = questions.rows.value;
  const answered = rows.filter((row) => row.is_answered);
  const time = median(answered.flatMap((row) => row.duration_s ?? []));
  const done = `${answered.length} answered${time === null ? "" : `, ${time.toFixed(0)} s each (median)`}`;
  return questions.open.value.length === 0 ? `${done}. No question waits; new ones appear here.` : `${done}; ${questions.open.value.length} waiting.`;
}

function Shown({ question }: { question: questions.Question }) {
  const { messages, reply_schema } = question.question;
  const parts = messages.flatMap((message) => message.parts.map((part) => ({ role: message.role, part })));
  const schema = reply_schema?.schema ?? ({ type: "string" } as Schema);
  const lacks = missing(schema, questions.answer.value);
  const form = useRef<HTMLFormElement>(null);
  useLayoutEffect(() => form.current?.querySelector<HTMLElement>("input, form button")?.focus(), []);
  const images = parts.flatMap(({ part }) => ("image" in part ? [part.image] : []));
  return (
    <div class="question">
      <div class="pictures">
        {images.map((image) => {
          const source = address(`/api/questions/${question.name}/images/${image}`);
          return (
            <a key={image} href={source} target="_blank" rel="noreferrer" title="Open in a tab of its own">
              <img src={source} alt={`Image of question ${question.name}`} />
            </a>
          );
        })}
      </div>
      <form ref={form} onSubmit={(event) => (event.preventDefault(), missing(schema, questions.answer.peek()) === null && void questions.send())}>
        <h3>
          Question {question.name}
          {reply_schema ? `: ${fieldName(reply_schema.name).toLowerCase()}` : ""}
        </h3>
        {parts.map(({ role, part }, index) => "text" in part && <p key={index} class={`text ${role}`}>{[part.text].flat().join("\n")}</p>)}
        <Field name="answer" schema={schema} value={questions.answer.value} onChange={(value) => (questions.answer.value = value)} />
        <div class="actions end">
          <span class="muted grow">{lacks === null ? "Enter sends the answer." : `${fieldName(lacks)} is missing.`}</span>
          <button type="submit" class="primary" disabled={questions.isSending.value}>
            Answer
          </button>
        </div>
      </form>
    </div>
  );
}

interface FieldProps {
  name: string;
  schema: Schema;
  value: Json;
  onChange: (value: Json) => void;
}

function Field({ name, schema, value, onChange }: FieldProps) {
  if (schema.type === "object") {
    const own = (value ?? {}) as { [key: string]: Json };
    return (
      <>
        {fields(schema).map(([key, part]) => (
          <Field key={key} name={key} schema={part} value={own[key] ?? null} onChange={(now) => onChange({ ...own, [key]: now })} />
        ))}
      </>
    );
  }
  if (schema.type === "array") return <List name={name} schema={schema.items ?? {}} value={(value ?? []) as Json[]} onChange={onChange} />;
  const options: (string | number | boolean)[] | undefined = schema.type === "boolean" ? [true, false] : schema.enum;
  if (options) {
    return (
      <fieldset class="marks">
        <legend>{fieldName(name)}</legend>
        {options.map((option) => (
          <label key={String(option)} class="check">
            <input type="radio" name={name} checked={value === option} onChange={() => onChange(option)} />
            {option === -1 ? "none" : option === true ? "yes" : option === false ? "no" : option}
          </label>
        ))}
      </fieldset>
    );
  }
  const isNumber = schema.type === "number" || schema.type === "integer";
  const read = (text: string): Json => (isNumber ? (text.trim() === "" || Number.isNaN(Number(text)) ? null : Number(text)) : text);
  return (
    <label class="field">
      <span>{fieldName(name)}</span>
      <input autocomplete="off" inputMode={isNumber ? "decimal" : "text"} defaultValue={value === null ? "" : String(value)} onInput={(event) => onChange(read(event.currentTarget.value))} />
    </label>
  );
}

function List({ name, schema, value, onChange }: { name: string; schema: Schema; value: Json[]; onChange: (value: Json) => void }) {
  return (
    <fieldset class="list">
      <legend>{fieldName(name)}</legend>
      {value.map((item, index) => (
        <div key={index} class="row">
          <div class="grow">
            <Field name={`${name.replace(/s$/, "")} ${index + 1}`} schema={schema} value={item} onChange={(now) => onChange(value.map((own, at) => (at === index ? now : own)))} />
          </div>
          {index + 1 === value.length && (
            <button type="button" class="quiet" aria-label={`Remove ${name} ${index + 1}`} onClick={() => onChange(value.slice(0, -1))}>
              <Icon name="close" />
            </button>
          )}
        </div>
      ))}
      <button type="button" class="quiet" onClick={() => onChange([...value, blank(schema)])}>
        <Icon name="plus" /> Add
      </button>
    </fieldset>
  );
}
