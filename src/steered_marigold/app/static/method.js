// The method step by step: answers side by side, where steering points, films of the predictions.
const make = (tag, attributes = {}, ...children) => {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
};
const picture = (title, src) =>
  make("figure", {}, make("img", { src, alt: title }), make("figcaption", {}, title));

const draw = () => {
  const root = element.querySelector(".method");
  const view = props.value;
  root.replaceChildren();
  if (!view || !view.answers) return;
  const [{ bar }] = view.answers;
  const section = (title, text, ...children) =>
    root.append(make("h3", {}, title), make("p", {}, text), ...children);

  section(
    "Three answers",
    "The paper's run, the same run without steering, and interpolation between the measurements; " +
      `one colour scale, ${bar.low.toFixed(1)} to ${bar.high.toFixed(1)} m.`,
    make("div", { class: "row three" }, ...view.answers.map((a) => picture(a.title, a.src))),
    make("div", { class: "colours", style: `background: linear-gradient(to right, ${bar.stops})` }),
    make(
      "div", { class: "ticks" },
      make("span", {}, `${bar.low.toFixed(1)} m`), make("span", {}, `${bar.high.toFixed(1)} m`),
    ),
  );
  section(
    "Where steering points",
    "Early the whole scene is moved into place; late only what still disagrees. Blue: farther, " +
      "red: nearer, both rows on one scale.",
    ...view.directions.map((d) =>
      make(
        "div", { class: "row three" },
        picture(`${d.title}: predicted`, d.predicted),
        picture("steered towards", d.target),
        picture("difference", d.difference),
      ),
    ),
  );
  section(
    "Step by step",
    `What each of the ${view.steps} steps takes the clean depth to be, from noise (left) to the end.`,
    ...view.films.map((film) =>
      make(
        "div", { class: "film" },
        make("h4", {}, film.title),
        make("div", { class: "strip", tabindex: "0", role: "group", "aria-label": film.title },
          ...film.frames.map((f) => picture(`t = ${f.t}`, f.src))),
      ),
    ),
  );
};
watch("value", draw);
draw();
