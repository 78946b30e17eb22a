// Runs the script of a page (its path is the first argument) without a browser: as much of a document as the script asks for.
// Prints JSON: what the script's functions give, and what happens when somebody uses the page.
"use strict";
const fs = require("fs");
const vm = require("vm");

const html = fs.readFileSync(process.argv[2], "utf-8");
const [data, script] = [...html.matchAll(/<script[^>]*>([^]*?)<\/script>/g)].map((found) => found[1]);
const frames = [];

class Context {
  constructor(canvas) {
    this.canvas = canvas;
    return new Proxy(this, {
      get: (self, name) => (name in self ? self[name] : () => undefined), // whatever else is drawn leaves no trace
      set: (self, name, value) => Reflect.set(self, name, value),
    });
  }
  createImageData(width, height) {
    return { data: new Uint8ClampedArray(4 * width * height), width, height };
  }
  putImageData(image) {
    this.canvas.pixels = image.data;
  }
  fillText(text) {
    this.canvas.texts.push(text);
  }
  clearRect() {
    this.canvas.texts = [];
  }
}

class Node {
  constructor(tag, attributes = {}, children = []) {
    Object.assign(this, { tag, attributes, children, style: {}, listeners: {}, own: "", className: attributes.class ?? "", texts: [] });
  }
  get classList() {
    const names = () => new Set(this.className.split(" ").filter(Boolean));
    const write = (set) => (this.className = [...set].join(" "));
    return {
      add: (name) => write(names().add(name)),
      remove: (name) => write(new Set([...names()].filter((other) => other !== name))),
      contains: (name) => names().has(name),
      toggle: (name, on) => (on ? this.classList.add(name) : this.classList.remove(name)),
    };
  }
  get id() {
    return this.attributes.id;
  }
  get textContent() {
    return this.own + this.children.map((child) => child.textContent ?? child).join("");
  }
  set textContent(text) {
    this.own = text;
    this.children = [];
  }
  get clientWidth() {
    return 1000;
  }
  append(...nodes) {
    this.children = this.children.filter((child) => !nodes.includes(child)).concat(nodes);
  }
  setAttribute(name, value) {
    this.attributes[name] = String(value);
  }
  getAttribute(name) {
    return this.attributes[name] ?? null;
  }
  removeAttribute(name) {
    delete this.attributes[name];
  }
  addEventListener(name, listener) {
    this.listeners[name] = listener;
  }
  getContext() {
    return (this.context ??= new Context(this));
  }
  getBoundingClientRect() {
    return { left: 0, top: 0 };
  }
  *all() {
    for (const child of this.children.filter((child) => child instanceof Node)) {
      yield child;
      yield* child.all();
    }
  }
  querySelectorAll(selector) {
    const [tag, name] = selector.split(" ").pop().split(".");
    return [...this.all()].filter((node) => (!tag || node.tag === tag) && (!name || node.className.split(" ").includes(name)));
  }
  querySelector(selector) {
    return this.querySelectorAll(selector)[0] ?? null;
  }
}

// The table of verdicts and the articles, as far as the script looks at them.
const articles = [...html.matchAll(/<article class="([^"]*)" id="([^"]*)" data-index="(\d+)">/g)].map(([, kind, id, index]) =>
  new Node("article", { class: kind, id, "data-index": index }, [new Node("div", { class: "explorer" })]));
const cells = [...html.matchAll(/<tr><th scope="row"><a href="([^"]*)">([^<]*)<\/a><\/th>(.*)<\/tr>/g)].map(([, href, name, rest]) =>
  new Node("tr", {}, [
    new Node("th", {}, [new Node("a", { href }, [name])]),
    ...[...rest.matchAll(/<td([^>]*)>(.*?)<\/td>/g)].map(([, attributes, text]) => {
      const key = attributes.match(/data-key="([^"]*)"/);
      return new Node("td", key ? { "data-key": key[1] } : {}, [text]);
    }),
  ]));
const heads = [...html.matchAll(/<th scope="col"><button type="button">([^<]*)/g)].map(([, text]) => new Node("th", {}, [new Node("button", {}, [text])]));
const body = new Node("tbody", {}, cells);
const table = new Node("table", { class: "verdicts" }, [new Node("thead", {}, heads), body]);
const page = new Node("body", {}, [table, ...articles, new Node("script", { id: "data" }, [data])]);
const windowListeners = {};

const world = {
  document: {
    body: page,
    documentElement: new Node("html"),
    createElement: (tag) => new Node(tag),
    getElementById: (id) => [...page.all()].find((node) => node.id === id),
    querySelectorAll: (selector) => page.querySelectorAll(selector),
  },
  location: { hash: "" },
  getComputedStyle: () => ({ getPropertyValue: () => "#123456" }),
  requestAnimationFrame: (call) => frames.push(call),
  atob: (text) => Buffer.from(text, "base64").toString("latin1"),
  console,
};
world.window = {
  devicePixelRatio: 1,
  addEventListener: (name, listener) => (windowListeners[name] = listener),
  matchMedia: () => ({ addEventListener: () => undefined }),
};
const settle = () => {
  while (frames.length) frames.shift()();
};
const context = vm.createContext(world);
const run = (code) => vm.runInContext(code, context);
run(script);
settle();

const shown = articles.find((article) => article.className.includes("open"));
const find = (selector) => shown.querySelector(selector);
const sphere = () => Buffer.from(find("canvas.sphere").pixels).toString("base64");
const before = { readout: find(".readout").textContent, sphere: sphere() };
const sliders = shown.querySelectorAll("input").filter((input) => input.attributes.type === "range");
const steps = sliders.map((input) => {
  const old = input.value;
  input.value = Number(old) > 0.5 ? "0" : input.attributes.max;
  input.listeners.input();
  settle();
  const found = { name: input.attributes["aria-label"], readout: find(".readout").textContent, sphere: sphere() !== before.sphere };
  input.value = old;
  input.listeners.input();
  settle();
  return { ...found, back: find(".readout").textContent === before.readout };
});
const map = find("canvas.map");
let pointer = null;
let keyboard = null;
if (map) {
  map.listeners.pointermove({ clientX: map.frame.left + map.frame.width, clientY: map.frame.top });
  settle();
  pointer = find(".readout").textContent;
  map.listeners.keydown({ key: "ArrowLeft", shiftKey: true, preventDefault: () => undefined });
  settle();
  keyboard = find(".readout").textContent;
  map.listeners.keydown({ key: "Home", preventDefault: () => undefined });
  settle();
}
const order = () => body.children.map((row) => row.children[0].textContent);
const sorted = heads.map((head) => {
  const button = head.querySelector("button");
  button.listeners.click();
  const rising = order();
  button.listeners.click();
  return { head: button.textContent, rising, falling: order(), aria: head.attributes["aria-sort"] };
});
windowListeners.beforeprint();
settle();
const drawn = articles.filter((article) => article.querySelector("canvas.sphere")).length;
windowListeners.afterprint();
const asked = JSON.parse(fs.readFileSync(0, "utf-8"));
const answers = asked.map((code) => run(`JSON.parse(JSON.stringify(${code}, (_, value) => Number.isNaN(value) ? "NaN" : ArrayBuffer.isView(value) ? Array.from(value, (x) => Number.isNaN(x) ? "NaN" : x) : value))`));
console.log(JSON.stringify({
  ready: page.className, open: shown.id, readout: before.readout, home: find(".readout").textContent, steps, pointer, keyboard, sorted, drawn,
  texts: map ? map.texts : [], options: shown.querySelectorAll("option").map((option) => option.textContent), answers,
}));
