// What two cursors read.
import { indexAt, valueAt } from "./channels.js";

/**
 * @typedef {object} Reading
 * @property {import("./types").Curve} curve
 * @property {number} a the value at cursor A
 * @property {number} b the value at cursor B
 * @property {number} difference b - a
 * @property {number} least the least value from A to B
 * @property {number} greatest the greatest one
 */

/**
 * @param {import("./types").Curve[]} curves
 * @param {number | undefined} a the time of cursor A, seconds
 * @param {number | undefined} b that of B
 * @returns {Reading[]}
 */
export function readings(curves, a, b) {
  const at = (/** @type {import("./types").Curve} */ curve, /** @type {number | undefined} */ time) =>
    time === undefined ? NaN : valueAt(curve, time);
  return curves.map((curve) => {
    const [atA, atB] = [at(curve, a), at(curve, b)];
    let [least, greatest] = [Math.min(atA, atB), Math.max(atA, atB)];
    if (a !== undefined && b !== undefined) {
      const last = indexAt(curve, Math.max(a, b));
      for (let i = indexAt(curve, Math.min(a, b)) + 1; i <= last; i++) {
        if (curve.values[i] < least) least = curve.values[i];
        if (curve.values[i] > greatest) greatest = curve.values[i];
      }
    }
    return { curve, a: atA, b: atB, difference: atB - atA, least, greatest };
  });
}
