"use strict";
// A render that goes on: asks the server of the page for news and for the layer that is looked at, until the render is over; then
// takes all layers once, so that the page needs the server no more.
(() => {
  const get = (id) => document.getElementById(id);
  const view = get("view"), canvas = view.querySelector("canvas"), mark = get("pixel"), context = canvas.getContext("2d");
  const id = `${Math.random()}`.slice(2), name = document.querySelector("h1").textContent;
  const frames = {};                       // by layer: number, passes, white, image, values, channels
  const LARGEST = 4e8;                     // bytes of values that a page keeps
  const EARLIER = 400;                     // points of the course of the noise
  let state = { version: -1, phase: "connecting", layers: [] }, chosen = "picture", clock = null, course = [], busy = false, kept = false, empty = true;
  let scale = 1, left = 0, top = 0, fitted = true, pointer = null;

  // ---- words

  const percent = (share) => share == null ? "–" : `${Number((100 * share).toPrecision(2))} %`;
  const digits = (value) => !Number.isFinite(value) ? "–" : value === 0 ? "0" : value.toPrecision(3);

  function time(seconds) {
    if (seconds == null) return "–";
    const whole = Math.round(seconds), minutes = Math.floor(whole / 60), hours = Math.floor(minutes / 60);
    return hours ? `${hours} h ${minutes % 60} min` : minutes ? `${minutes} min ${whole % 60} s` : `${whole} s`;
  }

  function label(layer) {
    if (layer === "orders") return "orders 3+";
    if (/^order\d/.test(layer)) return `order ${layer.slice(5)}`;
    if (layer.startsWith("light.")) return `light ${layer.slice(6)}`;
    const first = /^first(\d+)$/.exec(layer);
    return first ? `materials ${3 * first[1]} – ${3 * first[1] + 2}` : layer;
  }

  const ENDS = { noise: "the noise is reached", time: "the time is over", samples: "the samples are done", request: "stopped" };

  const PARTS = { scene: "Preparing the scene", choice: "Choosing the method", preparation: "Preparing the method" };

  function phase() {
    if (state.phase === "over") return `Done: ${ENDS[state.report.stopped_by] || state.report.stopped_by}`;
    if (state.stopping) return state.samples ? "Stopping after this pass" : "Stopping after the first pass";
    return { connecting: "Connecting", preparing: PARTS[state.part], passes: "Rendering", writing: "Writing the picture",
             failed: "Ended", lost: "No connection" }[state.phase];
  }

  // ---- figures

  function tick() {
    const since = clock && state.phase === "passes" ? (performance.now() - clock) / 1000 : 0;
    const spent = state.seconds == null ? null : state.seconds + since;
    const remaining = state.seconds_left == null ? null : Math.max(0, state.seconds_left - since);
    get("spent").textContent = time(spent);
    get("remaining").textContent = ["over", "failed", "lost"].includes(state.phase) ? "–"
      : remaining === 0 ? "after this pass" : time(remaining);
    const share = state.phase === "over" ? 1 : remaining == null || !spent ? 0 : Math.min(0.99, spent / (spent + remaining));
    const done = document.querySelector(".done");
    done.firstElementChild.style.width = `${100 * share}%`;
    done.setAttribute("aria-valuenow", Math.round(100 * share));
    const going = ["passes", "preparing", "writing"].includes(state.phase);
    document.title = going ? `${Math.round(100 * share)} % – ${name}` : `${phase()} – ${name}`;
  }

  function small(element, text, below) {
    element.textContent = text;
    if (!below) return;
    const line = document.createElement("small");
    line.textContent = below;
    element.append(line);
  }

  function items(list, lines) {
    list.replaceChildren(...lines.map((line) => {
      const item = document.createElement("li");
      item.textContent = line;
      return item;
    }));
  }

  function figures() {
    get("phase").textContent = phase();
    const wanted = state.wanted == null ? "" : ` of ${percent(state.wanted)}`;
    const parts = state.figures || {};
    const below = parts.noise == null ? ""
      : [["pixels", "noise"], ["regions", "noise_region"], ["the mean", "noise_mean"]]
        .map(([words, key]) => `of ${words} ${percent(parts[key])}`.replaceAll(" ", "\u00a0")).join(", ");
    small(get("noise"), state.noise == null ? "not known yet" : `${percent(state.noise)}${wanted}`, below);
    small(get("samples"), state.samples == null ? "–" : `${state.samples}`,
          state.most_samples ? `of ${state.most_samples} at most` : "");
    get("method").textContent = state.method || "–";
    get("size").textContent = state.size ? `${state.size[0]} × ${state.size[1]}` : "–";
    const stop = get("stop");
    stop.disabled = !["passes", "preparing"].includes(state.phase) || state.stopping;
    stop.hidden = ["over", "failed", "lost"].includes(state.phase);
    const said = state.phase === "over" ? `${state.report.files.join(", ")}: written.` : state.text || "";
    get("text").textContent = said;
    get("text").hidden = !said;
    const missed = state.phase === "over" ? state.report.missed : [];
    items(get("missed"), missed);
    get("missed").hidden = !missed.length;
    const reasons = (state.report || state).reasons || [];
    items(get("reasons"), reasons);
    get("why").hidden = !reasons.length;
    tick();
  }

  function draw_course() {
    get("course").toggleAttribute("hidden", course.length < 3);
    if (course.length < 3) return;
    const seconds = course.map((point) => Math.log(point[0])), noises = course.map((point) => Math.log(point[1]));
    const goal = state.wanted > 0 ? [Math.log(state.wanted)] : [];
    const [begin, end] = [seconds[0], seconds.at(-1)];
    const low = Math.min(...noises, ...goal), high = Math.max(...noises, ...goal, low + 0.1);
    const x = (value) => 300 * (value - begin) / (end - begin), y = (value) => 100 - 88 * (value - low) / (high - low);
    const path = seconds.map((value, i) => `${i ? "L" : "M"}${x(value).toFixed(1)} ${y(noises[i]).toFixed(1)}`).join("");
    const make = (kind, values, text = "") => {
      const element = document.createElementNS("http://www.w3.org/2000/svg", kind);
      for (const [key, value] of Object.entries(values)) element.setAttribute(key, value);
      element.textContent = text;
      return element;
    };
    const level = goal.map((value) => make("line", { x1: 0, x2: 300, y1: y(value), y2: y(value) }));
    const asked = goal.map((value) => make("text", { x: 0, y: y(value) - 4 }, `wanted: ${percent(state.wanted)}`));
    get("course").replaceChildren(...level, ...asked, make("path", { d: path }),
      make("text", { x: 300, y: 10, "text-anchor": "end" }, "noise over time, both logarithmic"),
      make("text", { x: 0, y: 116 }, time(Math.exp(begin))), make("text", { x: 300, y: 116, "text-anchor": "end" },
                                                                   time(Math.exp(end))));
  }

  // ---- layers

  function layers() {
    const names = state.layers.map((layer) => layer.name), box = get("layers");
    if (box.dataset.names === names.join()) return;
    box.dataset.names = names.join();
    if (names.length && !names.includes(chosen)) chosen = names[0];
    box.replaceChildren(...state.layers.map((layer) => {
      const input = document.createElement("input"), element = document.createElement("label");
      Object.assign(input, { type: "radio", name: "layer", value: layer.name, checked: layer.name === chosen });
      input.addEventListener("change", () => { chosen = layer.name; show(); refresh(); });
      element.title = layer.words;
      element.append(input, label(layer.name));
      return element;
    }));
  }

  function show() {
    const frame = frames[chosen];
    get("empty").hidden = Boolean(frame);
    if (!frame) {
      get("empty").textContent = state.samples ? "This layer is drawn." : state.phase === "passes" ? "The first pass" : phase();
      context.clearRect(0, 0, canvas.width, canvas.height);
    } else {
      const [width, height] = [frame.image.width, frame.image.height];
      const other = canvas.width !== width || canvas.height !== height;
      if (other) [canvas.width, canvas.height, empty] = [width, height, false];
      context.drawImage(frame.image, 0, 0);
      if (other) fit();
    }
    const layer = state.layers.find((one) => one.name === chosen);
    const words = !layer ? "" : chosen === "noise"
      ? `standard error of a pixel's luminance over the larger of it and the picture's mean: black 0, bright ${
        frame ? percent(frame.white) : "…"}` : layer.words;
    get("words").textContent = words && `${label(chosen)}: ${words}`;
    read();
  }

  async function take(layer, all) {
    const before = frames[layer];
    const answer = await fetch(`layer/${encodeURIComponent(layer)}.png?have=${before ? before.number : 0}`);
    if (!answer.ok) throw new Error(`no layer ${layer}`);
    if (answer.status === 204) return;
    const frame = { number: Number(answer.headers.get("X-Frame")), passes: Number(answer.headers.get("X-Passes")),
                    white: Number(answer.headers.get("X-White")), image: await createImageBitmap(await answer.blob()) };
    const pixels = frame.image.width * frame.image.height;
    const held = Object.values(frames).reduce((sum, one) => sum + (one.values ? one.values.byteLength : 0), 0);
    if (!all || held + 24 * pixels < LARGEST) {
      const numbers = await fetch(`layer/${encodeURIComponent(layer)}.values`);
      if (numbers.status === 200) frame.values = new Float32Array(await numbers.arrayBuffer());
    }
    frame.channels = frame.values ? frame.values.length / pixels : 0;
    if (before) before.image.close();
    frames[layer] = frame;
    if (layer === chosen) show();
  }

  async function refresh() {
    if (busy || kept || !state.layers.length || document.hidden && state.phase === "passes") return;
    busy = true;
    const layer = chosen;
    try {
      await take(layer, false);
    } catch (fault) { /* the next news tell whether the server is there */ }
    busy = false;
    if (layer !== chosen) refresh();
  }

  async function keep() {
    while (busy) await sleep(50);
    busy = true;
    const names = state.layers.map((layer) => layer.name);
    for (const layer of [chosen, ...names.filter((one) => one !== chosen)]) await take(layer, true).catch(() => {});
    busy = false;
    await fetch(`kept?page=${id}`, { method: "POST" }).catch(() => {});
  }

  // ---- what goes on

  const sleep = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));

  function news(next) {
    if (next.seconds !== state.seconds || next.phase !== state.phase) {
      clock = performance.now();
      if (next.noise > 0 && next.seconds > (course.at(-1) || [0])[0]) course.push([next.seconds, next.noise]);
      if (course.length > EARLIER) course = course.filter((_, i) => i % 2 === 0 || i > EARLIER - 20);
    }
    state = next;
    layers();
    figures();
    draw_course();
    if (!frames[chosen]) show();
    refresh();
  }

  async function follow() {
    for (let failures = 0; failures < 4;) {
      try {
        const answer = await fetch(`state?seen=${state.version}&page=${id}`);
        if (!answer.ok) throw new Error(answer.status);
        news(await answer.json());
        failures = 0;
      } catch (fault) {
        failures += 1;
        await sleep(400);
      }
      if (["over", "failed"].includes(state.phase)) {
        await keep();
        show();
        kept = true;
        document.body.dataset.kept = "yes";
        return;
      }
    }
    state = { ...state, phase: "lost", stopping: false,
              text: "The render's process does not answer any more. This is the last picture that came." };
    figures();
  }

  get("stop").addEventListener("click", () => {
    state.stopping = true;
    figures();
    fetch("stop", { method: "POST" }).catch(() => {});
  });
  document.addEventListener("visibilitychange", refresh);
  setInterval(tick, 500);

  // ---- the picture: size, place, pixels

  function place() {
    const { clientWidth: width, clientHeight: height } = view;
    const along = (at, length, room) => length <= room ? (room - length) / 2 : Math.min(0, Math.max(room - length, at));
    left = along(left, scale * canvas.width, width);
    top = along(top, scale * canvas.height, height);
    canvas.style.transform = `translate(${left}px, ${top}px) scale(${scale})`;
    view.classList.toggle("large", scale * devicePixelRatio >= 1);
    get("scale").textContent = empty ? "" : `${Number((100 * scale * devicePixelRatio).toPrecision(3))} %`;
    read();
  }

  function fit() {
    fitted = true;
    scale = Math.min(view.clientWidth / canvas.width, view.clientHeight / canvas.height);
    place();
  }

  function zoom(factor, x = view.clientWidth / 2, y = view.clientHeight / 2) {
    const least = Math.min(1, view.clientWidth / canvas.width, view.clientHeight / canvas.height) / 2;
    const next = Math.min(64, Math.max(least, scale * factor));
    [left, top] = [x - (x - left) * next / scale, y - (y - top) * next / scale];
    [scale, fitted] = [next, false];
    place();
  }

  function read() {
    const frame = frames[chosen];
    const [x, y] = pointer ? [Math.floor((pointer[0] - left) / scale), Math.floor((pointer[1] - top) / scale)] : [-1, -1];
    const inside = Boolean(frame) && x >= 0 && y >= 0 && x < canvas.width && y < canvas.height;
    mark.hidden = !inside || scale < 6;
    if (!inside) {
      get("readout").textContent = "Point at a pixel to read its values.";
      return;
    }
    Object.assign(mark.style, { width: `${scale}px`, height: `${scale}px`,
                                transform: `translate(${left + scale * x}px, ${top + scale * y}px)` });
    get("readout").textContent = [`pixel ${x}, ${y}`, values(chosen, x, y),
      chosen !== "picture" && frames.picture ? `picture: ${values("picture", x, y)}` : ""].filter(Boolean).join("\n");
  }

  function values(layer, x, y) {
    const frame = frames[layer];
    if (!frame.values) return "the values of this layer were not kept";
    const at = frame.channels * (y * frame.image.width + x), pixel = frame.values.subarray(at, at + frame.channels);
    const words = ["R", "G", "B"].map((colour, i) => `${colour} ${digits(pixel[i])}${
      frame.channels === 6 ? ` ± ${digits(pixel[i + 3])}` : ""}`).join("   ");
    return layer.startsWith("first") ? words : `${layer === "noise" ? "standard errors" : "linear"} ${words}`;
  }

  const at = (event) => {
    const box = view.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  view.addEventListener("wheel", (event) => {
    event.preventDefault();
    zoom(1.0015 ** -Math.max(-300, Math.min(300, event.deltaY * (event.deltaMode ? 30 : 1))), ...at(event));
  }, { passive: false });
  view.addEventListener("pointerdown", (event) => {
    view.setPointerCapture(event.pointerId);
    view.classList.add("held");
    pointer = at(event);
  });
  view.addEventListener("pointermove", (event) => {
    const next = at(event);
    if (view.classList.contains("held") && pointer) {
      [left, top] = [left + next[0] - pointer[0], top + next[1] - pointer[1]];
      place();
    }
    pointer = next;
    read();
  });
  for (const kind of ["pointerup", "pointercancel"]) view.addEventListener(kind, () => view.classList.remove("held"));
  view.addEventListener("pointerleave", () => { pointer = null; read(); });
  const BUTTONS = { in: () => zoom(1.5), out: () => zoom(1 / 1.5), fit, pixels: () => zoom(1 / devicePixelRatio / scale) };
  const KEYS = { "+": "in", "=": "in", "-": "out", "0": "fit", "1": "pixels" };
  const ARROWS = { ArrowLeft: [40, 0], ArrowRight: [-40, 0], ArrowUp: [0, 40], ArrowDown: [0, -40] };
  view.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (KEYS[event.key]) BUTTONS[KEYS[event.key]]();
    else if (ARROWS[event.key]) {
      [left, top] = [left + ARROWS[event.key][0], top + ARROWS[event.key][1]];
      place();
    } else return;
    event.preventDefault();
  });
  for (const button of document.querySelectorAll("[data-zoom]")) button.addEventListener("click", () => BUTTONS[button.dataset.zoom]());
  new ResizeObserver(() => fitted ? fit() : place()).observe(view);
  show();
  follow();
})();
