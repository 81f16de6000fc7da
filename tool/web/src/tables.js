// The slaves, the events and the readings of cursors as tables.
import { boardState, channelName, hex, number, resolutionOf, slaveName, statuswordInWords, time } from "./words.js";

/** The most events that are listed; the newest, as a page with more is slow. */
const LISTED_MAX = 1000;

/**
 * A row of a table.
 * @param {"td" | "th"} kind
 * @param {string[]} cells
 * @param {string} [className]
 */
function row(kind, cells, className = "") {
  const line = document.createElement("tr");
  line.className = className;
  for (const text of cells) {
    const cell = document.createElement(kind);
    cell.textContent = text;
    if (kind === "td" && /^[-+0-9]/.test(text)) cell.className = "number";
    line.append(cell);
  }
  return line;
}

/**
 * The slaves with a state or a position, each as texts: number, name, state, alarm, position, velocity, torque, IO, statusword.
 * @param {import("./channels.js").Store} store
 * @param {import("./types").SlaveInfo[]} slaves
 * @param {import("./types").Words} words
 * @param {Map<string, string>} alarms texts by slave and code, `1:0x7305`
 * @param {number} at
 */
export function slaveRows(store, slaves, words, alarms, at) {
  const numbers = new Set(slaves.map((slave) => slave.number));
  store.curves.forEach(({ channel }) => channel.slave > 0 && numbers.add(channel.slave));
  return Array.from(numbers).sort((a, b) => a - b).map((slave) => {
    const quantity = (/** @type {string} */ name) => {
      const curve = store.find(slave, name);
      const value = store.value(slave, name, at);
      if (!curve || Number.isNaN(value)) return "";
      return `${number(value, resolutionOf(curve.channel.factor))} ${curve.channel.unit}`.trim();
    };
    const { statusword, state, alarm, look } = axisState(store, words, alarms, slave, at);
    const known = slaves.find((one) => one.number === slave);
    const lines = ["input", "output"].map((way) => {
      const bits = store.curves.filter(({ channel }) => channel.slave === slave && channel.quantity === way);
      const high = bits.filter(({ channel }) => storeBit(store, slave, way, channel.bit, at));
      return high.map(({ channel }) => channel.name ?? channelName(channel, slaves)).join(", ");
    });
    return {
      cells: [
        String(slave), known?.name ?? known?.kind ?? "", state, alarm,
        quantity("position"), quantity("velocity"), quantity("torque"), lines.filter(Boolean).join("; "),
        Number.isNaN(statusword) ? "" : hex(statusword, 4),
      ],
      look,
    };
  });
}

/**
 * The state and the alarm of a slave in words, and the class of what shows it: `alarm`, `on` for an enabled axis, or none.
 * @param {import("./channels.js").Store} store
 * @param {import("./types").Words} words
 * @param {Map<string, string>} alarms
 * @param {number} slave
 * @param {number} at
 */
export function axisState(store, words, alarms, slave, at) {
  const statusword = store.value(slave, "statusword", at);
  const code = store.value(slave, "error_code", at);
  const state = Number.isNaN(statusword) ? "" : statuswordInWords(words, statusword);
  const alarm = code > 0 ? (alarms.get(`${slave}:${code}`) ?? `alarm ${hex(code, 4)}`) : "";
  const look = alarm || state.startsWith("Fault") ? "alarm" : state.startsWith("Operation enabled") ? "on" : "";
  return { statusword, state, alarm, look };
}

/**
 * @param {import("./channels.js").Store} store
 * @param {number} slave
 * @param {string} way
 * @param {number} bit
 * @param {number} at
 */
function storeBit(store, slave, way, bit, at) {
  const curve = store.find(slave, way, bit);
  if (!curve) return false;
  let last = curve.length - 1;
  while (last >= 0 && curve.times[last] > at) last -= 1;
  return last >= 0 && curve.values[last] === 1;
}

/**
 * @param {HTMLElement} table
 * @param {{cells: string[], look: string}[]} rows
 */
export function showSlaves(table, rows) {
  const head = row("th", ["slave", "name", "state", "alarm", "position", "velocity", "torque", "IO", "statusword"]);
  table.replaceChildren(head, ...rows.map(({ cells, look }) => row("td", cells, look)));
}

/**
 * @param {import("./channels.js").Store} store
 * @param {import("./types").Words} words
 * @param {number} at
 */
export function boardLine(store, words, at) {
  const state = store.value(0, "al_state", at);
  if (Number.isNaN(state)) return "no report yet";
  const fifo = store.value(0, "fifo_free", at);
  const full = store.value(0, "full_count", at);
  const parts = [`network: ${boardState(words, state)}`];
  if (!Number.isNaN(fifo)) parts.push(`FIFO: ${Math.round(fifo)} of 160 free`);
  if (!Number.isNaN(full)) parts.push(`full count ${full}`);
  if (!store.curves.some(({ channel }) => channel.quantity === "position")) parts.push("positions appear in OP");
  return parts.join(" - ");
}

/**
 * @param {HTMLElement} list
 * @param {import("./types").Happening[]} events
 * @param {import("./types").SlaveInfo[]} slaves
 * @param {(event: import("./types").Happening) => void} jump
 */
export function showEvents(list, events, slaves, jump) {
  const items = events.slice(-LISTED_MAX).map((event) => {
    const item = document.createElement("li");
    const button = document.createElement("button");
    button.className = event.kind;
    const moment = document.createElement("time");
    moment.textContent = time(event.at_ns / 1e9);
    button.append(moment, ` ${slaveName(slaves, event.slave)}: ${event.text}`);
    button.addEventListener("click", () => {
      list.querySelector("[aria-current]")?.removeAttribute("aria-current");
      button.setAttribute("aria-current", "true");
      jump(event);
    });
    item.append(button);
    return item;
  });
  list.replaceChildren(...items);
}

/**
 * @param {HTMLElement} table
 * @param {import("./readings.js").Reading[]} readings
 * @param {{a?: number, b?: number}} cursors
 * @param {import("./types").SlaveInfo[]} slaves
 */
export function showReadings(table, readings, { a, b }, slaves) {
  const at = (/** @type {number | undefined} */ moment) => (moment === undefined ? "" : number(moment, 1e-6));
  const apart = a !== undefined && b !== undefined ? b - a : NaN;
  const rate = apart !== 0 && !Number.isNaN(apart) ? ` (${number(1 / Math.abs(apart), 1e-3)} Hz)` : "";
  const rows = readings.map(({ curve, a, b, difference, least, greatest }) => {
    const text = (/** @type {number} */ value) => number(value, resolutionOf(curve.channel.factor / 10));
    return row("td", [channelName(curve.channel, slaves), text(a), text(b), text(difference), text(least), text(greatest)]);
  });
  table.replaceChildren(
    row("th", ["value", "A", "B", "B - A", "least", "greatest"]),
    row("td", ["time (s)", at(a), at(b), number(apart, 1e-6) + rate, "", ""]),
    ...rows,
  );
}

/**
 * @param {HTMLElement} table
 * @param {import("./types").Status} status
 * @param {number} dropped
 */
export function showCounters(table, status, dropped) {
  const entries = [
    ["reports", status.reports],
    ["reports per second", Math.round(status.reports_per_s ?? 0)],
    ["reports lost", status.reports_lost],
    ["reports with a wrong CRC", status.reports_bad_crc],
    ["blocks that this page was too slow for", dropped],
    ...Object.entries(status.counters ?? {}).map(([name, value]) => [name.replaceAll("_", " "), value]),
  ];
  table.replaceChildren(...entries.map(([name, value]) => row("td", [String(name), String(value)])));
}
