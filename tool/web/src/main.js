// The page: puts its parts together.
import { fromBase64 } from "./codec.js";
import { Store } from "./channels.js";
import { csv } from "./csv.js";
import { mcap } from "./mcap.js";
import { Control } from "./control.js";
import { connect } from "./live.js";
import { Machine } from "./machine.js";
import { colourOf, Scope } from "./panels.js";
import { drawPlane, way } from "./plane.js";
import { readings } from "./readings.js";
import { boardLine, showCounters, showEvents, showReadings, showSlaves, slaveRows } from "./tables.js";
import { fires, isOfCurve, TRIGGERS } from "./trigger.js";
import { channelName, hex, time } from "./words.js";

/** How long points of a board stay in the page. */
const KEPT_S = 600;
/** How many events stay in the page, as in the server. [OURS] */
const EVENTS_MAX = 5000;
/** How much of it is shown. */
const SPANS_S = [1, 2, 5, 10, 30, 60, 300];
/** How often a live page is drawn. */
const DRAWN_MS = 100;
/** How often the machine is drawn of a board for who has asked the system for less motion. */
const CALM_MS = 1000;
/** How often cursor A is moved while a recording is played. */
const PLAYED_MS = 40;
/** The part of what is shown that is before a trigger. */
const BEFORE_TRIGGER = 0.5;

/** @type {[string, string][]} */
const KEYS = [
  ["left, right", "move"], ["+, -", "zoom"], ["f", "show all"],
  ["space", "pause, go on; play a recording"], ["m", "machine"],
  ["a, b", "cursor A, B at the pointer"], ["Escape", "no cursors; stop if this page has control"],
  ["hold space on \u2212, +", "jog, with --control"], ["n, shift n", "next, last event"],
  ["x", "XY"], ["c", "CSV"], ["l", "MCAP"], ["p", "PNG"], ["t", "light, dark"], ["?", "these keys"],
  ["wheel, drag, pinch", "zoom, move, zoom"], ["shift click, alt click", "cursor A, B"], ["double click", "show all"],
];

/**
 * @template {HTMLElement} T
 * @param {string} id
 * @param {new () => T} kind
 * @returns {T}
 */
function element(id, kind) {
  const found = document.getElementById(id);
  if (!(found instanceof kind)) throw new TypeError(`the page has no ${id}`);
  return found;
}

class Page {
  /** @param {import("./types").Hello | null} hello what a recording shows; `null` for a page that connects */
  constructor(hello) {
    this.isLive = hello === null;
    this.store = new Store(this.isLive ? KEPT_S : Infinity);
    /** @type {{spans: import("./types").Span[], slaves: import("./types").SlaveInfo[]}} */
    this.known = { spans: [], slaves: [] };
    /** @type {import("./types").Words} */
    this.words = { drive_states: [], al_states: {} };
    /** @type {import("./types").Happening[]} */
    this.events = [];
    /** @type {Map<string, string>} */
    this.alarms = new Map();
    this.paused = false;
    this.span = 10;
    /** @type {number | undefined} */
    this.armed = undefined;
    this.dirty = false;
    /** @type {number | undefined} */
    this.playing = undefined;
    this.calm = matchMedia("(prefers-reduced-motion: reduce)");
    this.drawnMachine = -Infinity;
    this.machine = new Machine(element("axes", HTMLElement), this.store, this.known);
    this.control = new Control(element("control", HTMLElement));
    this.scope = new Scope(element("scope", HTMLElement), this.store, this.known, () => this.showMoment());
    this.buttons();
    this.setTheme(matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
    addEventListener("resize", () => this.scope.resize());
    addEventListener("keydown", (event) => this.key(event));
    if (hello) this.recording(hello);
    else this.live();
  }

  /** @param {import("./types").Hello} hello */
  recording(hello) {
    element("play", HTMLElement).hidden = false;
    this.greet(hello);
    if (hello.block) this.store.addBlock(fromBase64(hello.block));
    this.scope.fit();
    this.listEvents();
    this.fillPlane(hello.plane);
    document.documentElement.dataset.ready = "yes";
  }

  live() {
    element("pause", HTMLElement).hidden = false;
    element("spanned", HTMLElement).hidden = false;
    element("counted", HTMLElement).hidden = false;
    element("trigger", HTMLElement).hidden = false;
    connect(new URL(location.href), {
      message: (message) => this.message(message),
      block: (bytes) => {
        this.store.addBlock(bytes);
        this.dirty = true;
      },
      state: (words) => {
        element("notes", HTMLElement).textContent = words;
        if (words) this.store.interrupt();
      },
      sender: (send) => {
        if (send) this.control.send = send;
        else this.control.lost();
      },
    });
    this.drawOn();
  }

  /** @param {import("./types").Hello} hello */
  greet(hello) {
    this.known.slaves = hello.slaves;
    this.known.spans = hello.spans;
    this.words = hello.words;
    this.machine.picture = hello.picture;
    element("control", HTMLElement).hidden = !hello.control;
    this.events = [];
    this.addEvents(hello.events);
    this.store.setChannels(hello.channels);
    this.control.list(hello.slaves, hello.channels);
    this.offerFind(hello.find);
    element("name", HTMLElement).textContent = hello.name;
    element("notes", HTMLElement).textContent = hello.notes.join("; ");
  }

  /** @param {import("./types").Message} message */
  message(message) {
    switch (message.type) {
      case "hello":
        // A server that began anew counts its times and channels anew.
        [this.store.curves, this.store.from, this.store.to] = [[], Infinity, -Infinity];
        this.scope.built = -1;
        this.greet(message);
        this.listEvents();
        this.fillPlane();
        this.fillChannels();
        this.dirty = true;
        break;
      case "channels":
        this.known.slaves = message.slaves;
        this.store.setChannels(message.channels);
        this.control.list(message.slaves, message.channels);
        this.fillPlane();
        this.fillChannels();
        break;
      case "ask":
        this.control.answer(message.n);
        break;
      case "control":
        this.control.show(message);
        break;
      case "said":
        this.control.said(message);
        break;
      case "events":
        this.addEvents(message.events);
        this.listEvents();
        break;
      case "status":
        showCounters(element("counters", HTMLElement), message.status, message.dropped);
        element("notes", HTMLElement).textContent = message.status.trouble ?? "";
        break;
    }
  }

  /** @param {import("./types").Happening[]} events */
  addEvents(events) {
    this.events.push(...events);
    this.events.splice(0, this.events.length - EVENTS_MAX);
    for (const { slave, code, text } of events) {
      if (code !== undefined) this.alarms.set(`${slave}:${code}`, text);
    }
  }

  listEvents() {
    showEvents(element("events", HTMLElement), this.events, this.known.slaves, (event) => this.jump(event));
  }

  /** @param {import("./types").Happening} event */
  jump(event) {
    const at = event.at_ns / 1e9;
    const half = (this.scope.range.to - this.scope.range.from) / 2;
    this.pause(true);
    this.scope.marked = at;
    this.scope.show({ from: at - half, to: at + half });
  }

  /**
   * The next event after the one that was chosen, or the last one before it.
   * @param {1 | -1} way
   */
  step(way) {
    const from = this.scope.marked ?? (way > 0 ? -Infinity : Infinity);
    const later = this.events.filter((event) => (event.at_ns / 1e9 - from) * way > 0);
    const next = way > 0 ? later[0] : later[later.length - 1];
    if (next) this.jump(next);
  }

  /** Draws again and again, but for no more than half of the time: then there is time for the hand of a person. */
  drawOn() {
    const begin = performance.now();
    this.draw();
    // The second frame comes when the picture of the first one is there.
    requestAnimationFrame(() => requestAnimationFrame(() => {
      const took = performance.now() - begin;
      setTimeout(() => this.drawOn(), Math.max(DRAWN_MS - took, took));
    }));
  }

  draw() {
    if (!this.dirty || document.hidden) return;
    this.dirty = false;
    this.watch();
    const { to } = this.store;
    if (!this.paused && Number.isFinite(to)) {
      this.scope.show({ from: to - this.span, to });
    }
    this.showMoment();
    document.documentElement.dataset.ready = "yes";
  }

  /** Stops when the trigger fires, as soon as what follows it is there. */
  watch() {
    if (this.armed === undefined) return;
    const kind = element("trigger-kind", HTMLSelectElement).value;
    const level = Number(element("trigger-level", HTMLInputElement).value);
    const curve = this.scope.named(element("trigger-channel", HTMLSelectElement).value);
    const at = fires({ kind, level }, curve, this.events, this.armed);
    if (at === undefined || this.store.to < at + this.span * (1 - BEFORE_TRIGGER)) return;
    this.armed = undefined;
    this.pause(true);
    this.scope.marked = at;
    element("trigger-state", HTMLElement).textContent = `fired at ${time(at)}`;
    this.scope.show({ from: at - this.span * BEFORE_TRIGGER, to: at + this.span * (1 - BEFORE_TRIGGER) });
  }

  /** The moment whose values the tables have: that of cursor A, else the end of what is shown. */
  get moment() {
    if (this.scope.cursors.a !== undefined) return this.scope.cursors.a;
    if (this.isLive && !this.paused) return this.store.to;
    return this.scope.marked ?? Math.min(this.scope.range.to, this.store.ownTo);
  }

  showMoment() {
    const at = this.moment;
    element("moment", HTMLElement).textContent = Number.isFinite(at) ? `at ${time(at)}` : "";
    element("board", HTMLElement).textContent = boardLine(this.store, this.words, at);
    const rowsAt = (/** @type {number} */ moment) =>
      slaveRows(this.store, this.known.slaves, this.words, this.alarms, moment);
    const rows = rowsAt(at);
    showSlaves(element("slaves", HTMLElement), rows);
    // Beside the buttons stands what is now, also while the page shows another moment.
    if (this.control.holder === "you") {
      this.control.readings(at === this.store.to ? rows : rowsAt(this.store.to));
    }
    const { a, b } = this.scope.cursors;
    const isRead = a !== undefined || b !== undefined;
    element("cursors", HTMLElement).hidden = !isRead;
    if (isRead) {
      showReadings(element("readings", HTMLElement), readings(this.scope.shown, a, b), { a, b }, this.known.slaves);
    }
    this.drawPlane();
    const isCalm = this.calm.matches && this.isLive && !this.paused;
    if (!isCalm || performance.now() - this.drawnMachine >= CALM_MS) this.drawMachine();
  }

  drawMachine() {
    this.drawnMachine = performance.now();
    const isWanted = element("machine-shown", HTMLElement).getAttribute("aria-pressed") === "true";
    const isThere = isWanted && this.machine.show(this.words, this.alarms, this.scope.theme, this.moment);
    element("machine", HTMLElement).hidden = !isThere;
  }

  showsMachine() {
    const button = element("machine-shown", HTMLElement);
    button.setAttribute("aria-pressed", String(button.getAttribute("aria-pressed") !== "true"));
    this.drawMachine();
    this.scope.resize();
  }

  /** Moves cursor A as time passes, from where it is to the end of what is shown; or stops it. */
  play() {
    const button = element("play", HTMLElement);
    const isPlaying = this.playing !== undefined;
    clearInterval(this.playing);
    this.playing = undefined;
    button.textContent = isPlaying ? "Play" : "Stop";
    if (isPlaying) return;
    const { cursors: { a }, range } = this.scope;
    const from = a !== undefined && a >= range.from && a < range.to ? a : Math.max(range.from, this.store.from);
    const begin = performance.now();
    this.playing = setInterval(() => {
      const at = from + (performance.now() - begin) / 1000;
      const end = Math.min(this.scope.range.to, this.store.to);
      if (at >= end) this.play();
      this.scope.setCursor("a", Math.min(at, end));
    }, PLAYED_MS);
  }

  /** Removes both cursors, also one that runs. */
  clear() {
    if (this.playing !== undefined) this.play();
    this.scope.clearCursors();
  }

  /** @param {[number, number]} [first] the axes that are shown first */
  fillPlane(first) {
    const choice = element("plane", HTMLSelectElement);
    const chosen = first ? first.join() : choice.value;
    const axes = this.scope.axes();
    const pairs = axes.flatMap((x) => axes.filter((y) => y.slave > x.slave).map((y) => [x, y]));
    choice.replaceChildren(new Option("off", ""),
      ...pairs.map(([x, y]) => new Option(`${x.name}, ${y.name}`, `${x.slave},${y.slave}`)));
    choice.value = chosen;
    this.drawPlane();
  }

  fillChannels() {
    const choice = element("trigger-channel", HTMLSelectElement);
    const chosen = choice.value;
    const names = this.store.curves.map((curve) => channelName(curve.channel, this.known.slaves));
    choice.replaceChildren(...names.map((name) => new Option(name)));
    if (names.includes(chosen)) choice.value = chosen;
  }

  drawPlane() {
    const chosen = element("plane", HTMLSelectElement).value;
    element("xy", HTMLElement).hidden = !chosen;
    if (!chosen) return;
    const [x, y] = chosen.split(",").map(Number);
    const of = (/** @type {string} */ quantity) =>
      way(this.store.find(x, quantity), this.store.find(y, quantity), this.scope.range);
    drawPlane(element("xy-canvas", HTMLCanvasElement), [
      { points: of("target"), colour: colourOf(y, this.scope.theme), dashed: true },
      { points: of("position"), colour: colourOf(x, this.scope.theme), dashed: false },
    ]);
  }

  /** @param {boolean} paused */
  pause(paused) {
    this.paused = paused && this.isLive;
    element("pause", HTMLElement).textContent = this.paused ? "Go on" : "Pause";
    if (!paused) [this.scope.marked, this.dirty] = [undefined, true];
  }

  /** @param {"light" | "dark"} theme */
  setTheme(theme) {
    document.documentElement.dataset.theme = theme;
    this.scope.setTheme(theme);
  }

  otherTheme() {
    this.setTheme(this.scope.theme === "light" ? "dark" : "light");
    this.drawPlane();
    this.drawMachine();
  }

  /** Steps to the next pair of axes. */
  nextPlane() {
    const choice = element("plane", HTMLSelectElement);
    choice.selectedIndex = (choice.selectedIndex + 1) % choice.options.length;
    this.drawPlane();
  }

  saveCsv() {
    const text = csv(this.scope.shown, this.scope.range, this.known.slaves);
    save(new Blob([text], { type: "text/csv" }), "curves.csv");
  }

  async saveMcap() {
    const file = await mcap(this.scope.shown, { ...this.scope.range }, this.known.slaves);
    save(new Blob([/** @type {Uint8Array<ArrayBuffer>} */ (file)], { type: "application/octet-stream" }), "curves.mcap");
  }

  savePng() {
    const canvases = this.scope.panels.map(({ plot }) => plot.ctx.canvas);
    const sheet = document.createElement("canvas");
    sheet.width = Math.max(1, ...canvases.map((canvas) => canvas.width));
    sheet.height = Math.max(1, canvases.reduce((sum, canvas) => sum + canvas.height, 0));
    const context = sheet.getContext("2d");
    if (!context) return;
    context.fillStyle = getComputedStyle(document.body).backgroundColor;
    context.fillRect(0, 0, sheet.width, sheet.height);
    let top = 0;
    for (const canvas of canvases) {
      context.drawImage(canvas, 0, top);
      top += canvas.height;
    }
    sheet.toBlob((blob) => blob && save(blob, "curves.png"));
  }

  buttons() {
    const on = (/** @type {string} */ id, /** @type {() => void} */ act) =>
      element(id, HTMLElement).addEventListener("click", act);
    on("pause", () => this.pause(!this.paused));
    on("play", () => this.play());
    on("machine-shown", () => this.showsMachine());
    on("fit", () => this.fit());
    on("closer", () => this.scope.zoom(0.5));
    on("wider", () => this.scope.zoom(2));
    on("clear", () => this.clear());
    on("csv", () => this.saveCsv());
    on("mcap", () => this.saveMcap());
    on("png", () => this.savePng());
    on("theme", () => this.otherTheme());
    on("keys", () => element("help", HTMLDialogElement).showModal());
    on("arm", () => {
      this.armed = this.store.to;
      this.pause(false);
      element("trigger-state", HTMLElement).textContent = "armed";
    });
    const list = element("key-list", HTMLElement);
    for (const [keys, what] of KEYS) {
      const line = document.createElement("tr");
      for (const text of [keys, what]) line.insertCell().textContent = text;
      list.append(line);
    }
    const spans = element("span", HTMLSelectElement);
    spans.replaceChildren(...SPANS_S.map((span) => new Option(`${span} s`, String(span))));
    spans.value = String(this.span);
    spans.addEventListener("change", () => {
      this.span = Number(spans.value);
      this.dirty = true;
    });
    const kinds = element("trigger-kind", HTMLSelectElement);
    kinds.replaceChildren(...Array.from(TRIGGERS, ([kind, words]) => new Option(words, kind)));
    this.offerFind(undefined);
    kinds.addEventListener("change", () => {
      const needsCurve = isOfCurve(kinds.value);
      element("trigger-channel", HTMLSelectElement).disabled = !needsCurve;
      element("trigger-level", HTMLInputElement).disabled = !needsCurve;
    });
    element("plane", HTMLSelectElement).addEventListener("change", () => this.drawPlane());
  }

  /**
   * Offers the condition of `--find` as a trigger, if there is one.
   * @param {string | undefined} expression
   */
  offerFind(expression) {
    const option = element("trigger-kind", HTMLSelectElement).querySelector("option[value=found]");
    if (!(option instanceof HTMLOptionElement)) return;
    [option.hidden, option.disabled] = [!expression, !expression];
    option.textContent = expression ?? "";
  }

  fit() {
    this.pause(true);
    this.scope.fit();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    // Before all else: also in a field, and while the list of keys is open.
    if (event.key === "Escape" && (event.repeat || this.control.stopOwn())) return;
    const at = event.target;
    const writes = at instanceof HTMLInputElement || at instanceof HTMLSelectElement;
    const scrolls = event.key.startsWith("Arrow") && at instanceof Element && at.closest(".wide") !== null;
    if (writes || scrolls || event.ctrlKey || event.metaKey || event.altKey) return;
    /** @type {{[key: string]: () => void}} */
    const acts = {
      ArrowLeft: () => this.scope.pan(-0.1),
      ArrowRight: () => this.scope.pan(0.1),
      "+": () => this.scope.zoom(0.8),
      "-": () => this.scope.zoom(1.25),
      f: () => this.fit(),
      " ": () => (this.isLive ? this.pause(!this.paused) : this.play()),
      m: () => this.showsMachine(),
      a: () => this.scope.setCursor("a"),
      b: () => this.scope.setCursor("b"),
      Escape: () => this.clear(),
      n: () => this.step(1),
      N: () => this.step(-1),
      x: () => this.nextPlane(),
      c: () => this.saveCsv(),
      l: () => this.saveMcap(),
      p: () => this.savePng(),
      t: () => this.otherTheme(),
      "?": () => element("help", HTMLDialogElement).showModal(),
    };
    const act = acts[event.key];
    // A button takes the space itself.
    if (!act || (event.key === " " && at instanceof HTMLButtonElement)) return;
    event.preventDefault();
    if (this.isLive && event.key.startsWith("Arrow")) this.pause(true);
    act();
  }
}

/**
 * @param {Blob} blob
 * @param {string} name
 */
function save(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const data = JSON.parse(element("data", HTMLElement).textContent ?? "null");
// For a person at the console, and for tests.
Object.assign(globalThis, { page: new Page(data), hex });
