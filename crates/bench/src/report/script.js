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
