// Pictures of one frame that share a cursor, a colour bar under each, and a slider between two.
// Gradio calls this once with `element`, `props` and `watch`; `props.value` is what views.py makes.
let mode = "side by side";

const make = (tag, attributes = {}, ...children) => {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
};

const unpack = async ({ data, scale }) => {
  const bytes = Uint8Array.from(atob(data), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const codes = new Uint16Array(await new Response(stream).arrayBuffer());
  return (index) => (codes[index] ? codes[index] * scale : null);
};

const digits = (value) => value.toFixed(Math.abs(value) < 10 ? 2 : 1);

const bar = ({ stops, low, high, quantity, unit }) => {
  const ticks = [0, 0.25, 0.5, 0.75, 1].map((share) => low + share * (high - low));
  const short = high - low < 0.5 ? 3 : high - low < 5 ? 2 : 1;
  const label = unit === "m" ? `${quantity} in metres` : `${unit} ${quantity}`;
  return make(
    "div",
    { class: "bar", role: "img", "aria-label": `${label}, ${digits(low)} to ${digits(high)}` },
    make("div", { class: "colours", style: `background: linear-gradient(to right, ${stops})` }),
    make("div", { class: "ticks" }, ...ticks.map((t) => make("span", {}, t.toFixed(short)))),
    make("div", { class: "quantity" }, label),
  );
};

const draw = async () => {
  const root = element.querySelector(".viewer");
  const view = props.value;
  root.replaceChildren();
  if (!view || !view.pictures) {
    root.append(make("p", { class: "empty" }, (view && view.empty) || "Choose a frame."));
    return;
  }
  const named = Object.fromEntries(view.pictures.map((p) => [p.title.split(",")[0], p]));
  const readout = make("output", { class: "readout", "aria-live": "polite" });
  const hint = "Point at a picture, or move with the arrow keys, to read its depth.";
  readout.textContent = hint;
  const stages = [];

  const maps = {};
  const loading = Object.entries(view.maps).map(async ([name, packed]) => {
    maps[name] = await unpack(packed);
  });

  let cursor = null;
  const unit = view.unit === "m" ? " m" : "";
  const point = (x, y) => {
    cursor = [
      Math.min(view.width - 1, Math.max(0, x)),
      Math.min(view.height - 1, Math.max(0, y)),
    ];
    const index = cursor[1] * view.width + cursor[0];
    const at = (name) => (maps[name] ? maps[name](index) : null);
    const parts = [`x ${cursor[0] * view.step}, y ${cursor[1] * view.step}`];
    const measured = at("measured");
    parts.push(measured === null ? "not measured" : `measured ${digits(measured)} m`);
    const depth = at("depth");
    if (depth !== null) {
      const sigma = at("sigma");
      const give = sigma === null ? "" : ` ± ${sigma.toFixed(sigma < 0.1 ? 3 : 2)}${unit}`;
      parts.push(`result ${digits(depth)}${unit}${give}`);
      const was = at("was");
      if (was !== null) {
        parts.push(`erased: was ${digits(was)} m, off by ${Math.abs(depth - was).toFixed(3)} m`);
      }
    }
    readout.textContent = parts.join("  ·  ");
    for (const stage of stages) {
      stage.style.setProperty("--x", `${((cursor[0] + 0.5) / view.width) * 100}%`);
      stage.style.setProperty("--y", `${((cursor[1] + 0.5) / view.height) * 100}%`);
      stage.classList.add("pointed");
    }
  };

  const stage = (label, ...children) => {
    const node = make(
      "div",
      {
        class: "stage",
        tabindex: "0",
        role: "img",
        "aria-label": `${label}; arrow keys read its depth`,
        style: `aspect-ratio: ${view.width} / ${view.height}`,
      },
      ...children,
      make("span", { class: "cross" }),
    );
    node.addEventListener("pointermove", (event) => {
      const box = node.getBoundingClientRect();
      point(
        Math.floor(((event.clientX - box.left) / box.width) * view.width),
        Math.floor(((event.clientY - box.top) / box.height) * view.height),
      );
    });
    node.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
      const move = by[event.key];
      if (!move || event.target !== node) return;
      event.preventDefault();
      const far = event.shiftKey ? 20 : 4;
      const [x, y] = cursor || [view.width >> 1, view.height >> 1];
      point(x + far * move[0], y + far * move[1]);
    });
    stages.push(node);
    return node;
  };

  const panel = (picture) => {
    const image = make("img", { src: picture.src, alt: "", draggable: "false" });
    const caption = make("figcaption", {}, picture.title);
    const figure = make("figure", {}, caption, stage(picture.title, image));
    if (picture.bar) figure.append(bar(picture.bar));
    return figure;
  };

  const compare = () => {
    const back = make("img", { src: named.Result.src, alt: "", draggable: "false" });
    const front = make("img", { src: named.Input.src, alt: "", draggable: "false", class: "front" });
    const slider = make("input", {
      type: "range", min: "0", max: "100", value: "50", "aria-label": "Between input and result",
    });
    const both = stage("Input and result", back, front, make("span", { class: "edge" }), slider);
    const move = () => both.style.setProperty("--cut", `${slider.value}%`);
    slider.addEventListener("input", move);
    move();
    const caption = make(
      "figcaption", { class: "ends" }, make("span", {}, named.Input.title), make("span", {}, "Result"),
    );
    return make("figure", { class: "compare" }, caption, both, bar(named.Result.bar));
  };

  const body = make("div", { class: "panels" });
  const choices = named.Result ? ["side by side", "compare"] : [];
  const buttons = choices.map((name) => {
    const button = make("button", { type: "button" }, name === "compare" ? "Slider" : "Side by side");
    button.addEventListener("click", () => {
      mode = name;
      fill();
    });
    return button;
  });
  const fill = () => {
    const comparing = mode === "compare" && named.Result;
    stages.length = 0;
    body.classList.toggle("one", Boolean(comparing));
    body.replaceChildren(...(comparing ? [compare()] : view.pictures.map(panel)));
    buttons.forEach((b, i) => b.setAttribute("aria-pressed", String(choices[i] === mode)));
  };
  fill();
  root.append(make("div", { class: "top" }, readout, make("div", { class: "modes" }, ...buttons)));
  root.append(body);
  await Promise.all(loading);
  root.dataset.ready = "yes";
};

watch("value", draw);
draw();
