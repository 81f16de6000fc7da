// The machine in motion: each axis as a carriage on a rail or as a pointer on a dial, tables and gantries.
import { angle, both, figures, marks, place, reach, sector, table } from "./geometry.js";
import { colourOf } from "./panels.js";
import { axisState } from "./tables.js";
import { number, resolutionOf, short, slaveName, steps } from "./words.js";

/**
 * An axis as it is drawn: what changes here makes its figure anew.
 * @typedef {{slave: number, name: string, unit: string, resolution: number, colour: string, turn?: number, reach: import("./geometry.js").Reach}} Axis
 */
/**
 * An axis at a moment: values are not numbers where they are not known.
 * @typedef {{position: number, target: number, look: string, alarm: string}} Now
 */
/** @typedef {{svg: Element, move: (nows: Now[]) => void}} Drawing */

/** The ends of a rail in its drawing. */
const RAIL = { begin: 24, end: 296 };
/** The room for a table in its drawing, and where it begins. */
const TABLE = { width: 240, height: 150, left: 56, top: 16 };

/** The axes of a machine, as they are at a moment. */
export class Machine {
  /**
   * @param {HTMLElement} root
   * @param {import("./channels.js").Store} store
   * @param {{slaves: import("./types").SlaveInfo[]}} known
   */
  constructor(root, store, known) {
    this.root = root;
    this.store = store;
    this.known = known;
    /** @type {import("./types").Picture | undefined} */
    this.picture = undefined;
    /** @type {Map<string, {box: HTMLElement, axes: Axis[], move: (nows: Now[]) => void}>} */
    this.shown = new Map();
  }

  /**
   * Shows all axes with a position; returns whether there is one.
   * @param {import("./types").Words} words
   * @param {Map<string, string>} alarms
   * @param {"light" | "dark"} theme
   * @param {number} at seconds
   */
  show(words, alarms, theme, at) {
    const moved = this.store.curves.filter(({ channel, length }) => channel.quantity === "position" && length > 0);
    const slaves = moved.map(({ channel }) => channel.slave).sort((a, b) => a - b);
    const before = Array.from(this.shown.keys()).join();
    this.shown = new Map(figures(slaves, this.known.slaves, this.picture).map(({ kind, slaves }) => {
      const axes = slaves.map((slave) => this.axis(slave, theme));
      const key = JSON.stringify([kind, axes]);
      return [key, this.shown.get(key) ?? { axes, ...built(kind, axes) }];
    }));
    const all = Array.from(this.shown.values());
    if (Array.from(this.shown.keys()).join() !== before) this.root.replaceChildren(...all.map(({ box }) => box));
    for (const { axes, move } of all) {
      move(axes.map(({ slave }) => {
        const { look, alarm } = axisState(this.store, words, alarms, slave, at);
        const [position, target] = ["position", "target"].map((quantity) => this.store.value(slave, quantity, at));
        return { position, target, look, alarm };
      }));
    }
    return all.length > 0;
  }

  /**
   * @param {number} slave
   * @param {"light" | "dark"} theme
   * @returns {Axis}
   */
  axis(slave, theme) {
    const [position, target] = ["position", "target"].map((quantity) => this.store.find(slave, quantity));
    const least = Math.min(position?.least ?? Infinity, target?.least ?? Infinity);
    const greatest = Math.max(position?.greatest ?? -Infinity, target?.greatest ?? -Infinity);
    const { min, max, turn } = this.known.slaves.find((one) => one.number === slave) ?? {};
    const { unit = "", factor = 1 } = position?.channel ?? {};
    // A dial has no scale that grows.
    const range = turn ? { from: 0, to: turn, min, max } : reach({ min, max }, least, greatest);
    return { slave, name: slaveName(this.known.slaves, slave), unit, resolution: resolutionOf(factor), colour: colourOf(slave, theme), turn, reach: range };
  }
}

/**
 * Draws a figure, and returns what moves it.
 * @param {import("./geometry.js").Figure["kind"]} kind
 * @param {Axis[]} axes
 */
function built(kind, axes) {
  const box = document.createElement("figure");
  box.className = kind;
  const drawing = kind === "rotary" ? dial(axes[0]) : kind === "linear" ? rail(axes[0]) : plane(kind, axes);
  const caption = document.createElement("figcaption");
  const lines = axes.map(() => caption.appendChild(document.createElement("div")));
  box.append(drawing.svg, caption);
  const move = (/** @type {Now[]} */ nows) => {
    drawing.move(nows);
    const texts = axes.map((axis, i) => inWords(axis, nows[i]));
    texts.forEach((text, i) => {
      lines[i].className = nows[i].look;
      if (lines[i].textContent !== text) lines[i].textContent = text;
    });
    if (kind === "gantry") texts.push(skew(axes, nows));
    drawing.svg.setAttribute("aria-label", [...texts, ...axes.map(limits)].filter(Boolean).join("; "));
  };
  return { box, move };
}

/**
 * @param {Axis} axis
 * @param {Now} now
 */
export function inWords({ name, unit, resolution }, { position, target, alarm, look }) {
  const value = (/** @type {number} */ at) => `${number(at, resolution)} ${unit}`;
  const parts = [Number.isNaN(position) ? `${name}: no position` : `${name}: ${value(position)}`];
  if (!Number.isNaN(target)) parts.push(`target ${value(target)}`);
  if (look === "alarm") parts.push(alarm || "fault");
  return parts.join(", ");
}

/** @param {Axis} axis */
export function limits({ name, unit, reach: { min, max } }) {
  const ends = [["from", min], ["to", max]].filter(([, end]) => typeof end === "number");
  const words = ends.map(([word, end]) => `${word} ${short(Number(end))}`);
  return words.length > 0 ? `limits of ${name} ${words.join(" ")} ${unit}` : "";
}

/**
 * How far apart the ends of a bridge are.
 * @param {Axis[]} axes
 * @param {Now[]} nows
 */
export function skew([one, other], [first, second]) {
  const apart = first.position - second.position;
  return Number.isNaN(apart) ? "" : `${one.name} - ${other.name}: ${number(apart, one.resolution)} ${one.unit}`;
}

/**
 * @param {Axis} axis
 * @returns {Drawing}
 */
function rail(axis) {
  const x = (/** @type {number} */ at) => place(at, axis.reach, RAIL.begin, RAIL.end);
  const shape = { x: -9, y: 14, width: 18, height: 16, rx: 2 };
  const target = svg("rect", { class: "moves target", ...shape });
  const carriage = svg("g", { class: "moves carriage" },
    svg("rect", shape), svg("path", { class: "hair", d: "M0 14V38" }), svg("text", { class: "mark", y: 27 }, "!"));
  coloured(axis, target, carriage);
  const { min, max } = axis.reach;
  const named = (/** @type {number | undefined} */ end, /** @type {string} */ side) =>
    end === undefined ? [] : [svg("text", { class: side, x: x(end), y: 10 }, short(end))];
  const ends = [...named(min, "right"), ...named(max, "left")];
  return {
    svg: svg("svg", { viewBox: "0 0 320 54", role: "img" },
      line("rail", RAIL.begin - 16, 32, RAIL.end + 16, 32), ...scale(axis.reach, x, 32),
      ...stops(axis, x, 32), ...ends, target, carriage),
    move: ([now]) => {
      move(target, `translate(${px(x(now.target))}, 0px)`);
      move(carriage, `translate(${px(x(now.position))}, 0px)`);
      look(carriage, now);
    },
  };
}

/**
 * @param {Axis} axis
 * @returns {Drawing}
 */
function dial(axis) {
  const turn = axis.turn ?? 1;
  const quarters = [0, 0.25, 0.5, 0.75].map((part) => part * turn);
  const labels = steps(quarters).map((text, i) => {
    const [x, y] = around(i % 2 === 0 ? 58 : 70, i * 90);
    return svg("text", { x, y: y + 4 }, text);
  });
  const ticks = Array.from({ length: 12 }, (_, i) => line("tick", ...around(44, i * 30), ...around(48, i * 30)));
  const open = sector(axis.reach, turn);
  const ends = (open ?? []).map((end) => line("limit", ...around(40, end), ...around(52, end)));
  const range = open ? [svg("path", { class: "range", d: arc(48, open) }), ...ends] : [];
  const target = svg("path", { class: "moves target", d: "M0 -40L5 0L-5 0Z" });
  const pointer = svg("g", { class: "moves carriage" }, svg("path", { d: "M0 -42L6 0L-6 0Z" }), svg("circle", { r: 7 }));
  const mark = svg("text", { class: "mark", y: 4 }, "!");
  const hub = svg("g", { class: "carriage hub" }, mark);
  coloured(axis, target, pointer);
  return {
    svg: svg("svg", { viewBox: "-90 -70 180 140", role: "img" },
      svg("circle", { class: "face", r: 48 }), ...ticks, ...labels, ...range, target, pointer, hub),
    move: ([now]) => {
      move(target, `rotate(${angle(now.target, turn).toFixed(2)}deg)`);
      move(pointer, `rotate(${angle(now.position, turn).toFixed(2)}deg)`);
      look(pointer, now);
      look(hub, now);
    },
  };
}

/**
 * A table, whose bridge one axis moves, or a gantry, at whose bridge two do. Along the bridge a carriage moves.
 * @param {"xy" | "gantry"} kind
 * @param {Axis[]} axes
 * @returns {Drawing}
 */
function plane(kind, axes) {
  const sides = kind === "xy" ? [axes[0], axes[0]] : axes.slice(0, 2);
  const along = kind === "xy" ? axes[1] : axes.at(2);
  const across = both(sides[0].reach, sides[1].reach);
  const { width, height } = table(across, along?.reach, TABLE);
  const [left, top, bottom] = [TABLE.left, TABLE.top, TABLE.top + height];
  const x = (/** @type {number} */ at) => place(at, across, left, left + width);
  const y = (/** @type {number} */ at) => (along ? place(at, along.reach, 0, -height) : -height / 2);
  const upright = along ? upScale(along, (at) => bottom + y(at), left) : [];
  const rails = [bottom, top].map((y) => line("rail", left - 12, y, left + width + 12, y));
  const one = (/** @type {boolean} */ isTarget) => {
    const part = isTarget ? "target" : "carriage";
    const shape = isTarget ? svg("circle", { r: 8 }) : svg("rect", { x: -8, y: -8, width: 16, height: 16, rx: 2 });
    const tool = svg("g", { class: `moves ${part} tool` }, shape, svg("text", { class: "mark", y: 4 }, "!"));
    const foot = (/** @type {number} */ end) => svg("rect", { x: -7, y: end - 5, width: 14, height: 10, rx: 2 });
    const ends = [0, -height].map((end) => svg("g", { class: part }, foot(end)));
    const bridge = svg("g", { class: "moves" }, svg("g", { class: part }, line("beam", 0, 0, 0, -height)), ...ends, tool);
    coloured(sides[0], bridge);
    coloured(sides[1], ends[1]);
    coloured(along ?? sides[0], tool);
    if (!along) tool.setAttribute("visibility", "hidden");
    const set = (/** @type {Now[]} */ nows, /** @type {number[]} */ values) => {
      const [begin, end] = [values[0], values[kind === "xy" ? 0 : 1]].map((at) => x(at));
      // The upper end of the bridge is moved by a skew of the whole bridge.
      move(bridge, `translate(${px(begin)}, ${px(bottom)}) matrix(1, 0, ${((begin - end) / height).toFixed(5)}, 1, 0, 0)`);
      move(tool, `translate(0px, ${px(y(values[axes.length - 1]))})`);
      if (isTarget) return;
      look(ends[0], nows[0]);
      look(ends[1], nows[kind === "xy" ? 0 : 1]);
      look(tool, nows[axes.length - 1]);
    };
    return { bridge, set };
  };
  const [target, actual] = [one(true), one(false)];
  return {
    svg: svg("svg", { viewBox: `0 0 320 ${Math.ceil(bottom + 24)}`, role: "img" },
      svg("rect", { class: "face", x: left, y: top, width, height }), ...rails, ...scale(across, x, bottom), ...upright,
      ...stops(sides[0], x, bottom), ...(kind === "xy" ? [] : stops(sides[1], x, top)), target.bridge, actual.bridge),
    move: (nows) => {
      target.set(nows, nows.map((now) => now.target));
      actual.set(nows, nows.map((now) => now.position));
    },
  };
}

/**
 * The marks of a scale below a rail.
 * @param {import("./geometry.js").Reach} reach
 * @param {(at: number) => number} x
 * @param {number} y
 */
function scale(reach, x, y) {
  const at = marks(reach, 5);
  const texts = steps(at);
  return at.flatMap((mark, i) => [line("tick", x(mark), y + 2, x(mark), y + 7), svg("text", { x: x(mark), y: y + 19 }, texts[i])]);
}

/**
 * The marks of a scale at the left of a table, and the limits of its axis.
 * @param {Axis} axis
 * @param {(at: number) => number} y
 * @param {number} x
 */
function upScale({ reach }, y, x) {
  const at = marks(reach, 4);
  const texts = steps(at);
  const ends = [reach.min, reach.max].filter((end) => end !== undefined);
  return [
    ...at.flatMap((mark, i) => [
      line("tick", x - 20, y(mark), x - 15, y(mark)), svg("text", { class: "left", x: x - 23, y: y(mark) + 4 }, texts[i]),
    ]),
    ...ends.map((end) => line("limit", x - 14, y(end), x - 4, y(end))),
  ];
}

/**
 * The soft limits of an axis at its rail.
 * @param {Axis} axis
 * @param {(at: number) => number} x
 * @param {number} y
 */
function stops({ reach: { min, max } }, x, y) {
  const ends = [min, max].filter((end) => end !== undefined);
  return ends.map((end) => line("limit", x(end), y - 12, x(end), y + 6));
}

/**
 * A point around a dial.
 * @param {number} radius
 * @param {number} degrees clockwise from the top
 * @returns {[number, number]}
 */
function around(radius, degrees) {
  const angle = (degrees * Math.PI) / 180;
  return [radius * Math.sin(angle), -radius * Math.cos(angle)];
}

/**
 * @param {number} radius
 * @param {[number, number]} ends
 */
function arc(radius, [from, to]) {
  const [begin, end] = [around(radius, from), around(radius, to)].map((point) => point.map((at) => at.toFixed(2)).join(" "));
  return `M${begin}A${radius} ${radius} 0 ${to - from > 180 ? 1 : 0} 1 ${end}`;
}

/** @param {number} at */
function px(at) {
  return `${at.toFixed(2)}px`;
}

/**
 * Moves a part; one whose place is not known is not shown.
 * @param {SVGElement} part
 * @param {string} transform
 */
function move(part, transform) {
  const isKnown = !transform.includes("NaN");
  part.classList.toggle("unknown", !isKnown);
  if (isKnown && part.style.transform !== transform) part.style.transform = transform;
}

/**
 * @param {SVGElement} part
 * @param {Now} now
 */
function look(part, now) {
  part.classList.toggle("alarm", now.look === "alarm");
  part.classList.toggle("off", now.look === "");
}

/**
 * @param {Axis} axis
 * @param {SVGElement[]} parts
 */
function coloured({ slave, colour }, ...parts) {
  for (const part of parts) {
    part.style.setProperty("--axis", colour);
    part.dataset.slave = String(slave);
  }
}

/**
 * @param {string} className
 * @param {number} x1
 * @param {number} y1
 * @param {number} x2
 * @param {number} y2
 */
function line(className, x1, y1, x2, y2) {
  return svg("line", { class: className, x1, y1, x2, y2 });
}

/**
 * An element of a drawing.
 * @param {string} name
 * @param {{[attribute: string]: string | number}} attributes
 * @param {(Node | string)[]} inner
 */
function svg(name, attributes, ...inner) {
  const made = /** @type {SVGElement} */ (document.createElementNS("http://www.w3.org/2000/svg", name));
  for (const [attribute, value] of Object.entries(attributes)) made.setAttribute(attribute, String(value));
  made.append(...inner);
  return made;
}
