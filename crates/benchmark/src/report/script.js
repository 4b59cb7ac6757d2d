// The page is complete without this: it lets the picture of the end play the film strip below it.
for (const film of document.querySelectorAll(".film")) {
  const figure = film.parentElement.querySelector(".stills .end");
  if (figure === null) continue;
  const picture = figure.querySelector("img");
  const caption = figure.querySelector("figcaption");
  const frames = Array.from(film.children);
  const end = { src: picture.src, text: caption.textContent };
  let timer = null;
  const show = (frame) => {
    frames.forEach((other) => other.classList.toggle("now", other === frame));
    picture.src = frame === null ? end.src : frame.querySelector("img").src;
    label.textContent = frame === null ? end.text : frame.querySelector("span").textContent;
  };
  const stop = () => {
    clearInterval(timer);
    timer = null;
    button.textContent = "Play";
    show(null);
  };
  const label = document.createElement("span");
  const button = document.createElement("button");
  label.textContent = end.text;
  button.type = "button";
  button.className = "play";
  button.textContent = "Play";
  caption.replaceChildren(label, button);
  button.addEventListener("click", () => {
    if (timer !== null) return stop();
    let at = 0;
    button.textContent = "Stop";
    timer = setInterval(() => (at === frames.length ? stop() : show(frames[at++])), 160);
  });
  for (const frame of frames) {
    frame.addEventListener("pointerenter", () => timer === null ? show(frame) : null);
    frame.addEventListener("pointerleave", () => timer === null ? show(null) : null);
  }
}
// The table of all episodes: words to look for, choices, sorting by a click on a heading. Only the first rows that
// match are in the page, so that it stays quick with any number.
const table = document.querySelector("#episodes table");
if (table !== null) {
  const first = 100;
  const body = table.tBodies[0];
  const collator = new Intl.Collator("en", { numeric: true });
  const rows = Array.from(body.rows, (row) => {
    const cells = Array.from(row.cells, (cell) => cell.textContent);
    return { row, cells, text: cells.join(" ").toLowerCase() };
  });
  let sorted = rows;
  let limit = first;
  const bar = document.createElement("div");
  const count = document.createElement("span");
  const more = document.createElement("button");
  const words = document.createElement("input");
  const heads = Array.from(table.tHead.rows[0].cells);
  bar.className = "filters";
  count.className = "muted";
  more.type = "button";
  more.className = "play";
  words.type = "search";
  words.placeholder = "Filter: words in any column";
  words.setAttribute("aria-label", words.placeholder);
  const choices = [1, 2, 3].map((column) => {
    const choice = document.createElement("select");
    choice.setAttribute("aria-label", heads[column].textContent);
    const values = new Map();
    for (const row of rows) values.set(row.cells[column], 1 + (values.get(row.cells[column]) ?? 0));
    choice.add(new Option(`${heads[column].textContent}: all`, ""));
    for (const [value, number] of [...values].sort((a, b) => b[1] - a[1])) choice.add(new Option(`${value} (${number})`, value));
    choice.addEventListener("change", () => show(first));
    return { column, choice };
  });
  const show = (upTo) => {
    limit = upTo;
    const wanted = words.value.toLowerCase().split(/\s+/).filter((word) => word !== "");
    const chosen = choices.filter(({ choice }) => choice.value !== "");
    const found = sorted.filter((row) =>
      chosen.every(({ column, choice }) => row.cells[column] === choice.value)
      ? wanted.every((word) => row.text.includes(word)) : false);
    const shown = found.slice(0, limit);
    body.replaceChildren(...shown.map(({ row }) => row));
    count.textContent = `${found.length} of ${rows.length} episodes` + (found.length > shown.length ? `, the first ${shown.length} shown` : "");
    more.hidden = found.length === shown.length;
    more.textContent = `Show ${Math.min(1000, found.length - shown.length)} more`;
  };
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.textContent = head.textContent;
    head.replaceChildren(button);
    button.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const sign = down ? -1 : 1;
      const order = column > 4
        ? (a, b) => Number(a.cells[column]) - Number(b.cells[column])
        : (a, b) => collator.compare(a.cells[column], b.cells[column]);
      sorted = [...rows].sort((a, b) => sign * order(a, b));
      show(first);
    });
  });
  // A cause of failure elsewhere in the page leads to its rows.
  for (const link of document.querySelectorAll("a[data-outcome]")) {
    link.addEventListener("click", () => {
      words.value = "";
      for (const { column, choice } of choices) choice.value = column === 3 ? link.dataset.outcome : "";
      show(first);
    });
  }
  words.addEventListener("input", () => show(first));
  more.addEventListener("click", () => show(limit + 1000));
  bar.append(words, ...choices.map(({ choice }) => choice), count);
  table.parentElement.before(bar);
  table.parentElement.after(more);
  show(first);
}
