// The curves over time, one panel for each kind of quantity, drawn by uPlot.
import { indexAt, thin } from "./channels.js";
import { channelName, slaveName, steps } from "./words.js";

/** @typedef {import("./types").Curve} Curve */
/** @typedef {import("./types").Range} Range */

/** The panels from top to bottom, each with its quantities. */
const PANELS = [
  { title: "Position", quantities: ["position", "target", "beside"], height: 220 },
  { title: "Following error", quantities: ["following_error"], height: 130 },
  { title: "Velocity", quantities: ["velocity", "target_velocity"], height: 150 },
  { title: "Target of CSV", quantities: ["csv"], height: 110 },
  { title: "Torque", quantities: ["torque", "cst"], height: 130 },
  { title: "Free entries of the FIFO", quantities: ["fifo_free"], height: 100 },
  { title: "Inputs and outputs", quantities: ["input", "output"], height: 0 },
];
/** How curves are dashed that are not drawn as a whole line, px. */
const DASHES = new Map([
  ["target", [6, 4]], ["target_velocity", [6, 4]], ["cst", [6, 4]], ["output", [6, 4]], ["beside", [2, 3]],
]);
const LANE_PX = 22;
/** A panel with more curves draws fewer points and thinner lines, or it would take the time of many pictures. [OURS] */
const CROWD = 8;

/**
 * Whether a panel has too many curves to draw each with all its points.
 * @param {{lanes: boolean, curves: Curve[]}} panel
 */
const isCrowded = ({ lanes, curves }) => !lanes && curves.length > CROWD;

/** Colours that people who see no red or no green tell apart, for light and for dark paper (after Okabe and Ito). */
const COLOURS = {
  light: ["#0072b2", "#d55e00", "#007a5a", "#b0428a", "#806000", "#1a7fa8", "#000000", "#6a51a3"],
  dark: ["#56b4e9", "#e69f00", "#2fc79b", "#dd9cc4", "#f0e442", "#8ecbff", "#ffffff", "#b8a6e8"],
};

/**
 * @param {number} slave
 * @param {"light" | "dark"} theme
 */
export function colourOf(slave, theme) {
  const colours = COLOURS[theme];
  return colours[(slave + colours.length - 1) % colours.length];
}

/**
 * The panels that curves need, those of different units apart.
 * @param {Curve[]} curves
 * @returns {{title: string, height: number, lanes: boolean, curves: Curve[]}[]}
 */
export function grouped(curves) {
  return PANELS.flatMap(({ title, quantities, height }) => {
    const own = curves.filter((curve) => quantities.includes(curve.channel.quantity));
    own.sort((a, b) => a.channel.slave - b.channel.slave || a.channel.bit - b.channel.bit);
    const units = Array.from(new Set(own.map((curve) => curve.channel.unit)));
    return units.map((unit) => {
      const shown = own.filter((curve) => curve.channel.unit === unit);
      const lanes = height === 0;
      const pixels = lanes ? shown.length * LANE_PX + 30 : height;
      return { title: unit ? `${title} (${unit})` : title, height: pixels, lanes, curves: shown };
    });
  });
}

/** The panels, the time that they show, and two cursors. */
export class Scope {
  /**
   * @param {HTMLElement} root
   * @param {import("./channels.js").Store} store
   * @param {{spans: import("./types").Span[], slaves: import("./types").SlaveInfo[]}} known
   * @param {() => void} changed called after the range or a cursor has changed
   */
  constructor(root, store, known, changed) {
    this.root = root;
    this.store = store;
    this.known = known;
    this.changed = changed;
    /** @type {Range} */
    this.range = { from: 0, to: 1 };
    /** @type {{a?: number, b?: number}} */
    this.cursors = {};
    /** @type {number | undefined} */
    this.pointer = undefined;
    /** @type {Set<Curve>} */
    this.hidden = new Set();
    /** @type {"light" | "dark"} */
    this.theme = "light";
    /** @type {{plot: uPlot, curves: Curve[], lanes: boolean}[]} */
    this.panels = [];
    /** @type {number | undefined} */
    this.marked = undefined;
    this.built = 0;
  }

  /** The curves that are drawn. */
  get shown() {
    return this.panels.flatMap((panel) => panel.curves).filter((curve) => !this.hidden.has(curve));
  }

  /**
   * @param {Range} range
   */
  show(range) {
    const least = 2e-5;
    const middle = (range.from + range.to) / 2;
    const half = Math.max(least, range.to - range.from) / 2;
    this.range = { from: middle - half, to: middle + half };
    this.refresh();
    this.changed();
  }

  /** Shows all that there is. */
  fit() {
    const { from, to } = this.store;
    if (to > from) this.show({ from, to });
  }

  /**
   * Zooms around a moment; `factor` above 1 shows more.
   * @param {number} factor
   * @param {number} [at]
   */
  zoom(factor, at = (this.range.from + this.range.to) / 2) {
    const { from, to } = this.range;
    this.show({ from: at - (at - from) * factor, to: at + (to - at) * factor });
  }

  /**
   * Moves by a part of what is shown.
   * @param {number} part
   */
  pan(part) {
    const by = (this.range.to - this.range.from) * part;
    this.show({ from: this.range.from + by, to: this.range.to + by });
  }

  /**
   * Sets a cursor, by default where the pointer is, else in the middle.
   * @param {"a" | "b"} which
   * @param {number} [at]
   */
  setCursor(which, at = this.pointer ?? (this.range.from + this.range.to) / 2) {
    this.cursors[which] = at;
    this.panels.forEach(({ plot }) => plot.redraw(false));
    this.changed();
  }

  /** Removes both cursors. */
  clearCursors() {
    this.cursors = {};
    this.panels.forEach(({ plot }) => plot.redraw(false));
    this.changed();
  }

  /** Draws the points anew, and makes the panels anew if there are other channels. */
  refresh() {
    if (this.built !== this.store.curves.length) this.build();
    const width = Math.max(200, this.root.clientWidth);
    for (const panel of this.panels) {
      const { plot, curves, lanes } = panel;
      const crowded = isCrowded(panel);
      const tables = curves.map((curve, lane) =>
        this.points(curve, lanes ? curves.length - 1 - lane : undefined, width, crowded));
      plot.setData(/** @type {uPlot.AlignedData} */ (uPlot.join(tables)), true);
    }
  }

  /**
   * @param {Curve} curve
   * @param {number | undefined} lane where the curve is drawn as a lane
   * @param {number} width
   * @param {boolean} crowded whether the panel has many curves
   * @returns {uPlot.AlignedData}
   */
  points(curve, lane, width, crowded) {
    if (this.hidden.has(curve)) return [[], []];
    // A value that holds does so to the end of what is known.
    const { from, to } = this.range;
    const known = { from, to: Math.max(from + 1e-9, Math.min(to, this.store.to)) };
    const [times, values] = thin(curve, known, crowded ? width / 2 : width, crowded);
    if (lane === undefined) return [times, values];
    return [times, values.map((value) => (value === null ? null : lane + 0.15 + 0.7 * value))];
  }

  /** Makes all panels anew. */
  build() {
    this.panels.forEach(({ plot }) => plot.destroy());
    this.root.replaceChildren();
    this.built = this.store.curves.length;
    this.panels = grouped(this.store.curves).map((group) => {
      const box = document.createElement("div");
      box.className = "panel";
      const title = document.createElement("h2");
      title.textContent = group.title;
      const legend = document.createElement("div");
      legend.className = "legend";
      legend.append(...group.curves.map((curve) => this.legend(curve)));
      box.append(title, legend);
      this.root.append(box);
      const plot = new uPlot(this.options(group), [[], ...group.curves.map(() => [])], box);
      this.handle(plot);
      return { plot, curves: group.curves, lanes: group.lanes };
    });
  }

  /** Fits the panels to the width of the page. */
  resize() {
    const width = this.root.clientWidth;
    this.panels.forEach(({ plot }) => plot.setSize({ width, height: plot.height }));
  }

  /**
   * Draws with the colours of light or dark paper.
   * @param {"light" | "dark"} theme
   */
  setTheme(theme) {
    this.theme = theme;
    this.built = -1;
    this.refresh();
  }

  /** @param {Curve} curve */
  legend(curve) {
    const button = document.createElement("button");
    const line = document.createElement("i");
    line.style.borderColor = colourOf(curve.channel.slave, this.theme);
    const dash = DASHES.get(curve.channel.quantity);
    if (dash) line.className = dash[0] < dash[1] ? "dotted" : "dashed";
    button.append(line, channelName(curve.channel, this.known.slaves));
    const tell = () => button.setAttribute("aria-pressed", String(!this.hidden.has(curve)));
    button.addEventListener("click", () => {
      if (!this.hidden.delete(curve)) this.hidden.add(curve);
      tell();
      this.refresh();
      this.changed();
    });
    tell();
    return button;
  }

  /**
   * @param {{title: string, height: number, lanes: boolean, curves: Curve[]}} group
   * @returns {uPlot.Options}
   */
  options({ height, lanes, curves }) {
    const style = getComputedStyle(document.documentElement);
    const colour = (/** @type {string} */ name) => style.getPropertyValue(name).trim();
    const stepped = uPlot.paths.stepped?.({ align: 1 });
    const series = curves.map((curve) => ({
      label: channelName(curve.channel, this.known.slaves),
      stroke: colourOf(curve.channel.slave, this.theme),
      width: isCrowded({ lanes, curves }) ? 1 : 1.5,
      dash: lanes ? undefined : DASHES.get(curve.channel.quantity),
      points: { show: false },
      paths: curve.channel.held ? stepped : undefined,
    }));
    const axis = { stroke: colour("--soft"), grid: { stroke: colour("--line"), width: 1 }, ticks: { stroke: colour("--line") } };
    const numbers = (/** @type {unknown} */ _, /** @type {number[]} */ splits) => steps(splits);
    const lane = (/** @type {unknown} */ _, /** @type {number[]} */ splits) =>
      splits.map((split) => series[curves.length - 1 - Math.floor(split)]?.label ?? "");
    return {
      width: Math.max(200, this.root.clientWidth),
      height,
      legend: { show: false },
      cursor: { drag: { x: false, y: false }, sync: { key: "scope" }, points: { show: false } },
      scales: {
        x: { time: false, range: () => [this.range.from, this.range.to] },
        y: lanes ? { range: () => [0, curves.length] } : {},
      },
      axes: [
        { ...axis, size: 28, values: numbers },
        lanes
          ? { ...axis, size: 78, values: lane, splits: () => curves.map((_, i) => i + 0.5), grid: { show: false } }
          : { ...axis, size: 78, space: 18, values: numbers },
      ],
      series: [{}, ...series],
      hooks: {
        drawClear: [(plot) => this.shade(plot, curves)],
        draw: [(plot) => this.lines(plot)],
        setCursor: [(plot) => {
          const { left } = plot.cursor;
          this.pointer = left !== undefined && left >= 0 ? plot.posToVal(left, "x") : undefined;
        }],
      },
    };
  }

  /**
   * Shades the states of the slaves of a panel.
   * @param {uPlot} plot
   * @param {Curve[]} curves
   */
  shade(plot, curves) {
    const slaves = new Set(curves.map((curve) => curve.channel.slave));
    const { left, top, width, height } = plot.bbox;
    const style = getComputedStyle(document.documentElement);
    for (const span of this.known.spans) {
      const isBoards = span.slave === 0 && (span.state === "failed" || slaves.has(0));
      if (!isBoards && !slaves.has(span.slave)) continue;
      const [from, to] = [span.from, span.to].map((at) => plot.valToPos(at, "x", true));
      const [begin, end] = [Math.max(from, left), Math.min(Math.max(to, from + 2), left + width)];
      if (end <= begin) continue;
      plot.ctx.fillStyle = style.getPropertyValue(`--shade-${span.state}`);
      plot.ctx.fillRect(begin, top, end - begin, height);
      plot.ctx.fillStyle = style.getPropertyValue("--alarm");
      plot.ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
      [plot.ctx.textBaseline, plot.ctx.textAlign] = ["top", "left"];
      // Where the meaning has no room, the code may have.
      const texts = [span.text, span.text.split(":")[0]];
      const text = texts.find((text) => plot.ctx.measureText(text).width + 6 <= end - begin);
      if (text) plot.ctx.fillText(text, begin + 3, top + 3);
    }
  }

  /**
   * Draws the cursors, and the event that was chosen.
   * @param {uPlot} plot
   */
  lines(plot) {
    const { left, top, width, height } = plot.bbox;
    const style = getComputedStyle(document.documentElement);
    const marks = [["A", this.cursors.a], ["B", this.cursors.b], ["", this.marked]];
    for (const [name, at] of marks) {
      if (typeof at !== "number") continue;
      const x = Math.round(plot.valToPos(at, "x", true));
      if (x < left || x > left + width) continue;
      plot.ctx.fillStyle = style.getPropertyValue(name ? "--ink" : "--alarm");
      plot.ctx.fillRect(x, top, Math.ceil(devicePixelRatio), height);
      plot.ctx.font = `bold ${11 * devicePixelRatio}px system-ui, sans-serif`;
      [plot.ctx.textBaseline, plot.ctx.textAlign] = ["top", "left"];
      plot.ctx.fillText(String(name), x + 3, top + 2);
    }
  }

  /**
   * Wheel, drag, pinch and double click of a panel.
   * @param {uPlot} plot
   */
  handle(plot) {
    const over = plot.over;
    /** @type {Map<number, number>} */
    const fingers = new Map();
    const at = (/** @type {number} */ clientX) => plot.posToVal(clientX - over.getBoundingClientRect().left, "x");
    over.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (event.shiftKey) this.pan(Math.sign(event.deltaY || event.deltaX) * 0.1);
      else this.zoom(event.deltaY > 0 ? 1.25 : 0.8, at(event.clientX));
    }, { passive: false });
    over.addEventListener("dblclick", () => this.fit());
    over.addEventListener("pointerdown", (event) => {
      if (event.shiftKey || event.altKey) this.setCursor(event.shiftKey ? "a" : "b", at(event.clientX));
      fingers.set(event.pointerId, event.clientX);
      over.setPointerCapture(event.pointerId);
    });
    over.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (before === undefined) return;
      if (fingers.size === 1) {
        const by = at(before) - at(event.clientX);
        if (by !== 0) this.show({ from: this.range.from + by, to: this.range.to + by });
      } else {
        const other = Array.from(fingers).find(([id]) => id !== event.pointerId)?.[1] ?? before;
        const apart = Math.abs(event.clientX - other);
        if (apart > 10) this.zoom(Math.abs(before - other) / apart, at(other));
      }
      fingers.set(event.pointerId, event.clientX);
    });
    for (const end of ["pointerup", "pointercancel"]) {
      over.addEventListener(end, (event) => fingers.delete(/** @type {PointerEvent} */ (event).pointerId));
    }
  }

  /**
   * Whether a time is shown.
   * @param {number} at
   */
  isShown(at) {
    return at >= this.range.from && at <= this.range.to;
  }

  /**
   * The curve of that name among those with points now, for a trigger.
   * @param {string} name
   */
  named(name) {
    return this.store.curves.find((curve) => channelName(curve.channel, this.known.slaves) === name && indexAt(curve, Infinity) >= 0);
  }

  /**
   * The axes: slaves with a position.
   * @returns {{slave: number, name: string}[]}
   */
  axes() {
    const axes = this.store.curves.filter((curve) => curve.channel.quantity === "position");
    const slaves = axes.map((curve) => curve.channel.slave).sort((a, b) => a - b);
    return slaves.map((slave) => ({ slave, name: slaveName(this.known.slaves, slave) }));
  }
}
