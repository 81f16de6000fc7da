// What stops the scope.
import { indexAt, valueAt } from "./channels.js";

/** What a trigger waits for, in words. */
export const TRIGGERS = new Map([
  ["rising", "a rising edge"],
  ["falling", "a falling edge"],
  ["above", "a value above"],
  ["below", "a value below"],
  ["alarm", "an alarm"],
  ["gap", "lost command frames"],
  ["lost", "a lost slave"],
  ["found", "the condition of --find"],
]);

/** The kinds of events of each trigger that is none of a curve. */
const EVENTS = new Map([
  ["alarm", ["alarm"]],
  ["gap", ["gap", "fifo"]],
  ["lost", ["lost"]],
  ["found", ["found"]],
]);

/** @param {string} kind */
export function isOfCurve(kind) {
  return !EVENTS.has(kind);
}

/**
 * The first moment after `from` at which the trigger fires.
 * @param {{kind: string, level: number}} trigger
 * @param {import("./types").Curve | undefined} curve
 * @param {import("./types").Happening[]} events
 * @param {number} from seconds
 * @returns {number | undefined}
 */
export function fires({ kind, level }, curve, events, from) {
  const kinds = EVENTS.get(kind);
  if (kinds) {
    const found = events.find((event) => event.at_ns / 1e9 > from && kinds.includes(event.kind));
    return found && found.at_ns / 1e9;
  }
  if (!curve) return undefined;
  const isReached = (/** @type {number} */ now) => (kind === "above" && now > level) || (kind === "below" && now < level);
  // The last point of a value that holds goes on with the time.
  if (curve.channel.held && isReached(valueAt(curve, from))) return from;
  for (let i = indexAt(curve, from) + 1; i < curve.length; i++) {
    const [before, now] = [curve.values[i - 1], curve.values[i]];
    const isIt =
      (kind === "rising" && before <= level && now > level) ||
      (kind === "falling" && before >= level && now < level) ||
      isReached(now);
    if (isIt) return curve.times[i];
  }
  return undefined;
}
