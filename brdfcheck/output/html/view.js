// --- drawing and the page ---

const SPHERE = 224;
const PAPER = 660; // the width of a sheet of A4 or letter
const KEY = 80; // the width of what stands to the right of a map: its colours and their numbers
const still = (canvas, width, height) => {
  // Sharp on fine screens; the context then counts in CSS pixels.
  const ratio = Math.min(window.devicePixelRatio || 1, 3);
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(height * ratio);
  canvas.style.width = `${width}px`;
  canvas.style.height = `${height}px`;
  const context = canvas.getContext("2d");
  context.scale(ratio, ratio);
  return context;
};

function make(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name === "class") node.className = value;
    else node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

function theme() {
  const style = getComputedStyle(document.documentElement);
  const read = (name) => style.getPropertyValue(name).trim() || "#888";
  return { ink: read("--ink"), faint: read("--faint"), line: read("--rule"), accent: read("--accent"), bad: read("--bad"), paper: read("--card") };
}

class Explorer {
  constructor(box, entry) {
    this.entry = entry;
    this.box = box;
    this.tables = {};
    this.indices = entry.others.map((axis) => axis.at);
    this.channel = -1; // the largest of all
    this.marked = true;
    this.waiting = false;
    this.build();
    this.toWorst();
  }

  get rows() {
    return this.entry.rows;
  }

  // What is looked at: the channels of the slice, the table that is drawn, and the scale of its colours.
  refresh() {
    const { entry } = this;
    const key = this.indices.join(",");
    if (!(key in this.tables)) this.tables[key] = entry.tables[key].map((text) => decode(text, entry.low, entry.high));
    this.channels = this.tables[key];
    this.table = this.channel < 0 ? largest(this.channels) : this.channels[this.channel];
    const found = extent(this.table);
    const low = Math.max(0, Math.min(found.least, 0.999));
    this.scale = { ...found, low, limit: 1 + Math.max(entry.margin, entry.errors[key]) };
    this.heat = null;
  }

  toWorst() {
    this.indices = this.entry.others.map((axis) => axis.at);
    this.row = this.rows === null ? 0 : this.rows.position[this.rows.at];
    this.angle = this.entry.angles.position[this.entry.angles.at];
    this.refresh();
    this.changed();
  }

  move(row, angle) {
    this.row = Math.min(Math.max(row, 0), 1);
    this.angle = Math.min(Math.max(angle, 0), 1);
    this.changed();
  }

  changed() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  // --- what it consists of ---

  build() {
    const { entry } = this;
    const canvas = (name, text) => make("canvas", { class: name, role: "img", "aria-label": text });
    this.sphere = canvas("sphere", "A sphere in a white furnace, shaded from the table");
    this.angleCut = canvas("cut", "Albedo against the angle of incidence");
    this.readout = make("p", { class: "readout", role: "status" });
    const furnace = make("figure", {}, this.sphere, make("figcaption", { class: "small" }, "In a white furnace"));
    const plots = make("div", { class: "plots" });
    if (this.rows !== null) {
      this.map = canvas("map", `Heat map of the albedo over ${this.rows.name} and the angle of incidence. Arrow keys move the cut.`);
      this.map.setAttribute("tabindex", "0");
      this.rowCut = canvas("cut", `Albedo against ${this.rows.name}`);
      plots.append(this.map, this.rowCut, this.angleCut, furnace);
      this.follow(this.map, true, true);
      this.follow(this.rowCut, true, false);
    } else {
      plots.append(this.angleCut, furnace);
    }
    this.follow(this.angleCut, false, true);
    this.controls = make("div", { class: "controls" });
    this.sliders = [];
    if (this.rows !== null) this.slider(this.rows, 0.002, () => this.row, (value) => this.move(value, this.angle), (axis, value) => valueAt(axis, value));
    this.slider(entry.angles, 0.002, () => this.angle, (value) => this.move(this.row, value), (axis, value) => valueAt(axis, value));
    entry.others.forEach((axis, k) => {
      this.slider(axis, null, () => this.indices[k], (value) => {
        const wanted = this.indices.map((index, i) => (i === k ? Math.round(value) : index));
        this.indices = sliceFor(entry, wanted, k)[1];
        this.refresh();
        this.changed();
      }, (_, value) => axis.values[Math.round(value)]);
    });
    const choices = make("div", { class: "choices" });
    if (entry.channels.length > 1) {
      const select = make("select", { "aria-label": "Channel" });
      ["largest of the channels", ...entry.channels].forEach((name, k) => select.append(make("option", { value: String(k - 1) }, name)));
      select.addEventListener("change", () => {
        this.channel = Number(select.value);
        this.refresh();
        this.changed();
      });
      choices.append(make("label", {}, "Channel ", select));
    }
    const mark = make("input", { type: "checkbox" });
    mark.checked = true;
    mark.addEventListener("change", () => {
      this.marked = mark.checked;
      this.changed();
    });
    const back = make("button", { type: "button" }, "Go to the largest albedo");
    back.addEventListener("click", () => this.toWorst());
    choices.append(make("label", {}, mark, " mark E > 1 on the sphere"), back);
    this.controls.append(choices);
    this.note = make("p", { class: "small" });
    this.box.append(this.readout, plots, this.controls, this.note);
  }

  slider(axis, step, get, set, value) {
    const range = { type: "range", min: "0", max: step === null ? String(axis.values.length - 1) : "1", step: String(step ?? 1), "aria-label": axis.name };
    const input = make("input", range);
    const output = make("output", {});
    input.addEventListener("input", () => set(Number(input.value)));
    this.controls.append(make("label", { class: "slider" }, make("span", {}, axis.name), input, output));
    this.sliders.push(() => {
      input.value = String(get());
      const text = `${shown(value(axis, get()))}${unitOf(axis.name)}`;
      output.textContent = text;
      input.setAttribute("aria-valuetext", text);
    });
  }

  follow(canvas, rows, angles) {
    const moved = (event) => {
      const box = canvas.getBoundingClientRect();
      const { left, top, width, height } = canvas.frame;
      const x = (event.clientX - box.left - left) / width;
      const y = 1 - (event.clientY - box.top - top) / height;
      this.move(rows ? y : this.row, angles ? x : this.angle);
    };
    canvas.addEventListener("pointermove", moved);
    canvas.addEventListener("pointerdown", moved);
    canvas.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 0.1 : 0.01;
      const way = { ArrowLeft: [0, -step], ArrowRight: [0, step], ArrowUp: [step, 0], ArrowDown: [-step, 0] }[event.key];
      if (way) this.move(this.row + way[0], this.angle + way[1]);
      else if (event.key === "Home") this.toWorst();
      else return;
      event.preventDefault();
    });
  }

  // --- drawing ---

  draw() {
    const printing = document.documentElement.classList.contains("printing");
    const room = printing ? PAPER : Math.max(260, Math.min(this.box.clientWidth || 900, 1120));
    this.narrow = room < 620;
    const wide = this.narrow ? room : room - SPHERE - 18;
    this.ink = theme();
    if (this.rows !== null) {
      this.drawMap(wide, Math.round(Math.min(360, wide * 0.62)));
      this.drawCut(this.rowCut, this.narrow ? room : SPHERE, this.narrow ? 170 : Math.round(Math.min(360, wide * 0.62)), !this.narrow);
    }
    this.drawCut(this.angleCut, wide, this.rows === null ? 300 : SPHERE, null);
    this.drawSphere();
    this.sliders.forEach((update) => update());
    const cut = cutOverAngles(this.table, this.rows, this.entry.angles.values.length, this.row);
    const value = look(this.entry.angles.position, cut, this.angle);
    const parts = this.rows === null ? [] : [`${this.rows.name} = ${shown(valueAt(this.rows, this.row))}${unitOf(this.rows.name)}`];
    this.entry.others.forEach((axis, k) => parts.push(`${axis.name} = ${shown(axis.values[this.indices[k]])}${unitOf(axis.name)}`));
    parts.push(`angle ${valueAt(this.entry.angles, this.angle).toFixed(1)}\u00b0`);
    this.readout.textContent = `${parts.join(", ")}: E = ${albedoText(value)}`;
    this.readout.className = value > this.scale.limit ? "readout over" : "readout";
    const { entry } = this;
    this.note.textContent = `Table: ${this.rows === null ? 1 : this.rows.values.length} \u00d7 ${this.entry.angles.values.length} nodes, linear between them, off by about ${shown(entry.errors[this.indices.join(",")] + entry.rounding, 2)} at most.${entry.judged ? " The verdict is computed apart from it." : ""}`;
  }

  frame(canvas, width, height, left, right) {
    const context = still(canvas, width, height);
    canvas.frame = { left, top: 10, width: width - left - right, height: height - 44 };
    context.clearRect(0, 0, width, height);
    context.font = "12px system-ui, sans-serif";
    context.textBaseline = "middle";
    return context;
  }

  label(context, text, x, y, align) {
    context.textAlign = align;
    context.fillStyle = this.ink.faint;
    context.fillText(text, x, y);
  }

  stroke(context, colourOf, width, points, dashes = []) {
    context.strokeStyle = colourOf;
    context.lineWidth = width;
    context.setLineDash(dashes);
    context.beginPath();
    let pen = false;
    for (const [x, y] of points) {
      if (!Number.isFinite(x) || !Number.isFinite(y)) pen = false;
      else if (pen) context.lineTo(x, y);
      else {
        context.moveTo(x, y);
        pen = true;
      }
    }
    context.stroke();
    context.setLineDash([]);
  }

  // The heat map itself, one picture for each slice; kept while the pointer moves.
  heatOf(width, height) {
    if (this.heat !== null && this.heat.width === width && this.heat.height === height) return this.heat;
    const { angles } = this.entry;
    const picture = make("canvas", { width: String(width), height: String(height) });
    const context = picture.getContext("2d");
    const image = context.createImageData(width, height);
    image.data.set(heatPixels(this.table, this.rows, angles, this.scale, width, height));
    context.putImageData(image, 0, 0);
    this.heat = picture;
    return picture;
  }

  drawMap(width, height) {
    const { angles } = this.entry;
    const context = this.frame(this.map, width, height, 62, KEY);
    const frame = this.map.frame;
    const x = (position) => frame.left + position * frame.width;
    const y = (position) => frame.top + (1 - position) * frame.height;
    context.drawImage(this.heatOf(Math.round(frame.width), Math.round(frame.height)), frame.left, frame.top, frame.width, frame.height);
    const at = (axis, node) => look(Array.from(axis.position, (_, k) => k), axis.position, node);
    const line = contour(this.table, angles.values.length, this.scale.limit).flatMap(([x0, y0, x1, y1]) => [
      [x(at(angles, x0)), y(at(this.rows, y0))], [x(at(angles, x1)), y(at(this.rows, y1))], [NaN, NaN]]);
    this.stroke(context, "#ffffff", 4, line);
    this.stroke(context, "#1a1a1a", 1.6, line);
    for (const value of axisTicks(angles, 6)) this.label(context, `${shown(value)}\u00b0`, x(positionOf(angles, value)), height - 24, "center");
    for (const value of axisTicks(this.rows, 6)) this.label(context, shown(value), frame.left - 8, y(positionOf(this.rows, value)), "right");
    this.label(context, "angle of incidence", frame.left + frame.width / 2, height - 8, "center");
    this.drawKey(context, frame);
    context.save();
    context.translate(10, frame.top + frame.height / 2);
    context.rotate(-Math.PI / 2);
    this.label(context, this.rows.name, 0, 0, "center");
    context.restore();
    for (const [colourOf, lineWidth] of [["rgba(0,0,0,0.55)", 3], ["#ffffff", 1.2]]) {
      this.stroke(context, colourOf, lineWidth, [[x(0), y(this.row)], [x(1), y(this.row)]]);
      this.stroke(context, colourOf, lineWidth, [[x(this.angle), y(0)], [x(this.angle), y(1)]]);
    }
  }

  // The colours and their numbers; the step between cold and warm is at 1.
  drawKey(context, { left, top, width, height }) {
    const { low, high, limit } = this.scale;
    const x = left + width + 12;
    const gain = high > limit;
    const step = gain ? 0.5 : 1; // the part of the strip that is cold
    const count = Math.round(height);
    for (let k = 0; k < count; k++) {
      const part = k / (count - 1);
      const value = part <= step ? low + (part / step) * (1 - low) : limit + ((part - step) / (1 - step)) * (high - limit);
      context.fillStyle = `rgb(${colour(value, this.scale).map(Math.round).join(",")})`;
      context.fillRect(x, top + height - k - 1, 10, 1.5);
    }
    const marks = [[0, low < 0.005 ? "0" : shown(low, 2)], [step, "1"], ...(gain ? [[1, high < 1.01 ? `1+${(high - 1).toExponential(0)}` : `${this.scale.cut ? "\u2265 " : ""}${shown(high, 3)}`]] : [])];
    for (const [part, text] of marks) this.label(context, text, x + 15, top + (1 - part) * height + (part === 0 ? -5 : part === 1 ? 5 : 0), "left");
  }

  // A cut: over the angles (`upright` null), or over the rows, upright beside the map or lying.
  drawCut(canvas, width, height, upright) {
    const overRows = upright !== null;
    const axis = overRows ? this.rows : this.entry.angles;
    const cuts = this.channels.map((table) =>
      overRows ? cutOverRows(table, this.rows, this.entry.angles, this.angle) : cutOverAngles(table, this.rows, axis.values.length, this.row));
    const context = this.frame(canvas, width, height, upright ? 12 : 62, upright === null && this.rows !== null ? KEY : 14);
    const { left, top, width: w, height: h } = canvas.frame;
    const low = Math.min(0, this.scale.least);
    const high = Math.max(1.1, 1.06 * this.scale.high);
    const place = (position, value) => {
      const part = (value - low) / (high - low);
      return upright ? [left + part * w, top + (1 - position) * h] : [left + position * w, top + (1 - part) * h];
    };
    for (const value of ticks(low, high, upright ? 3 : 4)) {
      this.stroke(context, this.ink.line, 1, [place(0, value), place(1, value)]);
      const [x, y] = place(0, value);
      if (upright) this.label(context, shown(value), x, height - 24, "center");
      else this.label(context, shown(value), left - 8, y, "right");
    }
    let free = -Infinity; // to the right of the last label: on a phone not all have room
    for (const value of upright ? [] : axisTicks(axis, 6)) {
      const text = `${shown(value)}${unitOf(axis.name)}`;
      const x = left + positionOf(axis, value) * w;
      if (x - 4 * text.length < free) continue;
      this.label(context, text, x, height - 24, "center");
      free = x + 4 * text.length;
    }
    this.label(context, upright ? "E" : axis.name === "angle" ? "angle of incidence" : axis.name, left + w / 2, height - 8, "center");
    this.stroke(context, this.ink.bad, 1.5, [place(0, 1), place(1, 1)], [5, 4]);
    context.save();
    context.beginPath();
    context.rect(left, top, w, h);
    context.clip();
    const colours = cuts.length === 3 ? ["#d6453d", "#2f9e57", "#3b7ddd"] : cuts.map(() => this.ink.accent);
    cuts.forEach((cut, k) => {
      const chosen = this.channel < 0 || this.channel === k;
      this.stroke(context, colours[k], chosen ? 2.2 : 0.8, Array.from(cut, (value, i) => place(axis.position[i], value)));
    });
    context.restore();
    const here = overRows ? this.row : this.angle;
    this.stroke(context, this.ink.faint, 1, [place(here, low), place(here, high)], [2, 3]);
    const shownCut = this.channel < 0 ? largest(cuts) : cuts[this.channel];
    const value = look(axis.position, shownCut, here);
    if (Number.isFinite(value) && value <= high) {
      context.fillStyle = value > this.scale.limit ? this.ink.bad : this.ink.ink;
      context.beginPath();
      context.arc(...place(here, value), 4, 0, 2 * Math.PI);
      context.fill();
    }
  }

  drawSphere() {
    const columns = this.entry.angles.values.length;
    const tables = this.channel < 0 && this.channels.length === 3 ? this.channels : [this.table];
    const cuts = tables.map((table) => cutOverAngles(table, this.rows, columns, this.row));
    const size = Math.round(SPHERE * Math.min(window.devicePixelRatio || 1, 2));
    this.sphere.width = size;
    this.sphere.height = size;
    this.sphere.style.width = this.sphere.style.height = `${SPHERE}px`;
    const context = this.sphere.getContext("2d");
    const image = context.createImageData(size, size);
    image.data.set(spherePixels(size, this.entry.angles, cuts, this.scale.limit, this.marked));
    context.putImageData(image, 0, 0);
  }
}

// --- the page ---

function sortable(table) {
  const heads = Array.from(table.querySelectorAll("thead th"));
  heads.forEach((head, column) => {
    const button = head.querySelector("button");
    if (!button) return;
    button.addEventListener("click", () => {
      const falling = head.getAttribute("aria-sort") === "ascending";
      heads.forEach((other) => other.removeAttribute("aria-sort"));
      head.setAttribute("aria-sort", falling ? "descending" : "ascending");
      const body = table.querySelector("tbody");
      const rows = Array.from(body.children);
      const keys = rows.map((row) => row.children[column].getAttribute("data-key") ?? row.children[column].textContent);
      body.append(...sortedOrder(keys, falling).map((index) => rows[index]));
    });
  });
}

function start() {
  const entries = JSON.parse(document.getElementById("data").textContent);
  const articles = Array.from(document.querySelectorAll("article"));
  const explorers = new Map();
  const explore = (article) => {
    const entry = entries[Number(article.getAttribute("data-index"))];
    const box = article.querySelector(".explorer");
    if (entry && box && !explorers.has(article)) explorers.set(article, new Explorer(box, entry));
    return explorers.get(article);
  };
  const open = () => {
    const wanted = decodeURIComponent(location.hash.slice(1));
    const chosen = articles.find((article) => article.id === wanted) ?? articles.find((article) => article.className.includes("bad")) ?? articles[0];
    for (const article of articles) article.classList.toggle("open", article === chosen);
    for (const link of document.querySelectorAll("tbody a")) {
      link.setAttribute("aria-current", String(chosen !== undefined && link.getAttribute("href") === `#${chosen.id}`));
    }
    if (chosen) explore(chosen)?.draw();
  };
  document.querySelectorAll("table.verdicts").forEach(sortable);
  document.body.classList.add("ready");
  window.addEventListener("hashchange", open);
  const redraw = () => explorers.forEach((explorer) => explorer.changed());
  window.addEventListener("resize", redraw);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);
  window.addEventListener("beforeprint", () => {
    document.documentElement.classList.add("printing");
    articles.forEach((article) => explore(article)?.draw());
  });
  window.addEventListener("afterprint", () => {
    document.documentElement.classList.remove("printing");
    redraw();
  });
  open();
}

start();
