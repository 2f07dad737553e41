// A picture to paint holes on. The strokes, discs [x, y, radius] in pixels of the frame, stay in the
// root's dataset until the page sends them.
const make = (tag, attributes = {}, ...children) => {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.append(...children);
  return node;
};

const draw = () => {
  const root = element.querySelector(".hole");
  const view = props.value;
  const strokes = []; // each a list of discs
  root.replaceChildren();
  root.dataset.strokes = "[]";
  if (!view || !view.src) {
    root.append(make("p", { class: "empty" }, "Choose a frame first."));
    return;
  }
  const canvas = make("canvas", {
    width: view.width,
    height: view.height,
    tabindex: "0",
    "aria-label": "Paint with the mouse; or move with the arrow keys and paint with the space bar",
  });
  const image = make("img", { src: view.src, alt: "The image, coloured where depth was measured" });
  const size = make("input", { type: "range", min: "4", max: "120", value: "36" });
  const undo = make("button", { type: "button" }, "Undo");
  const clear = make("button", { type: "button" }, "Clear");
  const tools = make("div", { class: "tools" }, make("label", {}, "Brush ", size), undo, clear);
  root.append(tools, make("div", { class: "sheet" }, image, canvas));

  const context = canvas.getContext("2d");
  const state = { painting: false, x: view.width / 2, y: view.height / 2, shown: false };
  const radius = () => (Number(size.value) / 2) * (view.width / 640);
  const paint = () => {
    context.clearRect(0, 0, view.width, view.height);
    context.fillStyle = "rgb(255 45 149)";
    for (const [x, y, r] of strokes.flat()) {
      context.beginPath();
      context.arc(x, y, r, 0, 2 * Math.PI);
      context.fill();
    }
    if (state.shown) {
      context.lineWidth = view.width / 320;
      context.strokeStyle = "white";
      context.beginPath();
      context.arc(state.x, state.y, radius(), 0, 2 * Math.PI);
      context.stroke();
    }
    const whole = strokes.flat().map((disc) => disc.map((v) => Math.round(v * view.step)));
    root.dataset.strokes = JSON.stringify(whole);
  };
  const dab = (x, y) => {
    const stroke = strokes[strokes.length - 1];
    const [fromX, fromY] = stroke.length ? stroke[stroke.length - 1] : [x, y];
    const r = radius();
    const count = Math.max(1, Math.ceil(Math.hypot(x - fromX, y - fromY) / (r / 2)));
    for (let i = 1; i <= count; i += 1) {
      stroke.push([fromX + ((x - fromX) * i) / count, fromY + ((y - fromY) * i) / count, r]);
    }
  };
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    state.x = ((event.clientX - box.left) / box.width) * view.width;
    state.y = ((event.clientY - box.top) / box.height) * view.height;
    state.shown = true;
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    place(event);
    state.painting = true;
    strokes.push([]);
    dab(state.x, state.y);
    paint();
  });
  canvas.addEventListener("pointermove", (event) => {
    place(event);
    if (state.painting) dab(state.x, state.y);
    paint();
  });
  canvas.addEventListener("pointerup", () => (state.painting = false));
  canvas.addEventListener("pointerleave", () => {
    state.shown = state.painting;
    paint();
  });
  canvas.addEventListener("keydown", (event) => {
    const step = view.width / 64;
    const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const move = by[event.key];
    if (!move && event.key !== " ") return;
    event.preventDefault();
    if (move) {
      state.x = Math.min(view.width, Math.max(0, state.x + step * move[0]));
      state.y = Math.min(view.height, Math.max(0, state.y + step * move[1]));
    } else {
      strokes.push([]);
      dab(state.x, state.y);
    }
    state.shown = true;
    paint();
  });
  undo.addEventListener("click", () => (strokes.pop(), paint()));
  clear.addEventListener("click", () => ((strokes.length = 0), paint()));
};

watch("value", draw);
draw();
