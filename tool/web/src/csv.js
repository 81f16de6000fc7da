// What is shown, as a table.
import { indexAt, valueAt } from "./channels.js";
import { channelName } from "./words.js";

/**
 * The moments at which one of these curves has a point, in their order.
 * @param {import("./types").Curve[]} curves
 * @param {import("./types").Range} range
 */
export function moments(curves, range) {
  /** @type {Set<number>} */
  const found = new Set();
  for (const curve of curves) {
    const last = indexAt(curve, range.to);
    for (let i = indexAt(curve, range.from - 1e-9) + 1; i <= last; i++) {
      if (!Number.isNaN(curve.values[i])) found.add(curve.times[i]);
    }
  }
  return Array.from(found).sort((a, b) => a - b);
}

/**
 * A row for each moment at which a curve has a point, with the values of all at that time.
 * @param {import("./types").Curve[]} curves
 * @param {import("./types").Range} range
 * @param {import("./types").SlaveInfo[]} slaves
 */
export function csv(curves, range, slaves) {
  const title = (/** @type {import("./types").Curve} */ { channel }) => {
    const name = channelName(channel, slaves);
    return quoted(channel.unit ? `${name} (${channel.unit})` : name);
  };
  const cell = (/** @type {number} */ value) => (Number.isNaN(value) ? "" : String(Number(value.toPrecision(12))));
  const rows = moments(curves, range).map((at) =>
    [at.toFixed(9), ...curves.map((curve) => cell(valueAt(curve, at)))].join(","));
  return [["time (s)", ...curves.map(title)].join(","), ...rows, ""].join("\r\n");
}

/** @param {string} text */
function quoted(text) {
  // A spreadsheet takes a text that begins like a formula for one.
  const safe = /^[=+\-@]/.test(text) ? `'${text}` : text;
  return /[",\r\n]/.test(safe) ? `"${safe.replaceAll('"', '""')}"` : safe;
}
