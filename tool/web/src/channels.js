// The points of all channels, of a recording whole, of a board for some minutes and within some memory.
import { decodeBlock } from "./codec.js";

/** @typedef {import("./types").Channel} Channel */
/** @typedef {import("./types").Curve} Curve */

/** Less than a nanosecond apart no two points of a curve are. */
const STEP_S = 1e-9;
/** For this long after its last point a curve still has that value: velocities end some cycles before positions. */
const RECENT_S = 0.02;
/** The most points of a curve of a board, as many as a curve of a recording has. [OURS] */
const CURVE_MAX = 200_000;
/** The most points of all curves of a board: 128 MB. [OURS] */
const ALL_MAX = 8_000_000;
/** A curve with fewer points does not count for that, as one of a state or an input that seldom changes. */
const MANY = 512;

export class Store {
  /** @param {number} [kept] how many seconds are kept, with a bounded number of points; all without it */
  constructor(kept = Infinity) {
    /** @type {Curve[]} */
    this.curves = [];
    this.kept = kept;
    this.from = Infinity;
    this.to = -Infinity;
  }

  /**
   * Takes the list of channels, of which those known before are a beginning.
   * @param {Channel[]} channels
   */
  setChannels(channels) {
    for (const channel of channels.slice(this.curves.length)) {
      const [times, values] = [new Float64Array(64), new Float64Array(64)];
      this.curves.push({ channel, times, values, length: 0, least: Infinity, greatest: -Infinity });
    }
  }

  /** How many points a curve may have now. */
  get most() {
    if (this.kept === Infinity) return Infinity;
    const many = this.curves.filter((curve) => curve.length >= MANY).length;
    return Math.max(MANY, Math.min(CURVE_MAX, Math.floor(ALL_MAX / many)));
  }

  /** How much memory the points of all curves take, in bytes. */
  get size() {
    return this.curves.reduce((sum, { times, values }) => sum + times.byteLength + values.byteLength, 0);
  }

  /** The end of the points, without those of another recording. */
  get ownTo() {
    const ends = this.curves.filter(({ channel, length }) => channel.quantity !== "beside" && length > 0)
      .map(({ times, length }) => times[length - 1]);
    return ends.length > 0 ? Math.min(this.to, Math.max(...ends)) : this.to;
  }

  /** @param {Uint8Array} bytes */
  addBlock(bytes) {
    const { most } = this;
    for (const { channel, breaks, times, values } of decodeBlock(bytes)) {
      const curve = this.curves[channel];
      if (!curve) continue;
      if (breaks && curve.length > 0) push(curve, curve.times[curve.length - 1] + STEP_S, NaN, most);
      for (let i = 0; i < times.length; i++) push(curve, times[i] / 1e9, values[i] * curve.channel.factor, most);
      if (times.length === 0) continue;
      this.from = Math.min(this.from, times[0] / 1e9);
      this.to = Math.max(this.to, times[times.length - 1] / 1e9);
    }
    if (this.to - this.from > this.kept * 1.1) this.trim(this.to - this.kept);
  }

  /**
   * Forgets the points before a time.
   * @param {number} before
   */
  trim(before) {
    for (const curve of this.curves) {
      const first = Math.max(0, indexAt(curve, before));
      curve.times.copyWithin(0, first, curve.length);
      curve.values.copyWithin(0, first, curve.length);
      curve.length -= first;
    }
    this.from = before;
  }

  /** Interrupts all curves: what was between is not known. */
  interrupt() {
    const { most } = this;
    for (const curve of this.curves) {
      if (curve.length > 0) push(curve, curve.times[curve.length - 1] + STEP_S, NaN, most);
    }
  }

  /**
   * @param {number} slave
   * @param {string} quantity
   * @param {number} [bit]
   * @returns {Curve | undefined}
   */
  find(slave, quantity, bit = 0) {
    const isIt = (/** @type {Channel} */ channel) =>
      channel.slave === slave && channel.quantity === quantity && channel.bit === bit;
    return this.curves.find((curve) => isIt(curve.channel));
  }

  /**
   * The value of a channel at a time.
   * @param {number} slave
   * @param {string} quantity
   * @param {number} at seconds
   * @returns {number} not a number if there is none
   */
  value(slave, quantity, at) {
    const curve = this.find(slave, quantity);
    if (!curve) return NaN;
    const value = valueAt(curve, at);
    const last = curve.length - 1;
    const isRecent = last >= 0 && at > curve.times[last] && at - curve.times[last] <= RECENT_S;
    return Number.isNaN(value) && isRecent ? curve.values[last] : value;
  }
}

/**
 * @param {Curve} curve
 * @param {number} time
 * @param {number} value
 * @param {number} most how many points the curve may have
 */
function push(curve, time, value, most) {
  if (value < curve.least) curve.least = value;
  if (value > curve.greatest) curve.greatest = value;
  const last = curve.length - 1;
  if (last >= 0 && time <= curve.times[last]) {
    if (curve.channel.held) {
      curve.values[last] = value;
      return;
    }
    time = curve.times[last] + STEP_S;
  }
  // Of a value that holds, the first and the last time are enough, as in a recording.
  if (curve.channel.held && last > 0 && curve.values[last] === value && curve.values[last - 1] === value) {
    curve.times[last] = time;
    return;
  }
  if (curve.length >= most) thinOlder(curve, most);
  else if (curve.length === curve.times.length) setRoom(curve, Math.min(2 * curve.length, most));
  curve.times[curve.length] = time;
  curve.values[curve.length] = value;
  curve.length += 1;
}

/**
 * Gives a curve room for a number of points, which is not less than it has.
 * @param {Curve} curve
 * @param {number} room
 */
function setRoom(curve, room) {
  const [times, values] = [curve.times, curve.values].map((all) => all.subarray(0, curve.length));
  [curve.times, curve.values] = [new Float64Array(room), new Float64Array(room)];
  curve.times.set(times);
  curve.values.set(values);
}

/**
 * Thins the older half of a curve until it has fewer points than `most`. What was thinned before loses little again, since
 * it has few points in a column.
 * @param {Curve} curve
 * @param {number} most
 */
function thinOlder(curve, most) {
  while (curve.length >= most) {
    const half = curve.length >> 1;
    // A column keeps at most five points, and on average has eight.
    const [times, values] = thin(curve, { from: curve.times[0], to: curve.times[half] }, half / 8);
    const next = indexAt(curve, times[times.length - 1]) + 1;
    for (const all of [curve.times, curve.values]) all.copyWithin(times.length, next, curve.length);
    curve.times.set(times);
    curve.values.set(values.map((value) => value ?? NaN));
    curve.length -= next - times.length;
  }
  if (curve.times.length > most) setRoom(curve, most);
}

/**
 * The last point at or before a time; -1 if there is none.
 * @param {Curve} curve
 * @param {number} at
 */
export function indexAt(curve, at) {
  let [low, high] = [0, curve.length];
  while (low < high) {
    const middle = (low + high) >> 1;
    if (curve.times[middle] <= at) low = middle + 1;
    else high = middle;
  }
  return low - 1;
}

/**
 * The value at a time: that of the last point for a value that holds, else on the line to the next point. A value that holds
 * has no end.
 * @param {Curve} curve
 * @param {number} at
 */
export function valueAt(curve, at) {
  const i = indexAt(curve, at);
  if (i < 0) return NaN;
  const [time, value] = [curve.times[i], curve.values[i]];
  if (curve.channel.held || time === at) return value;
  const next = curve.values[i + 1];
  if (i + 1 >= curve.length || Number.isNaN(next)) return at - time < STEP_S ? value : NaN;
  return value + ((next - value) * (at - time)) / (curve.times[i + 1] - time);
}

/**
 * The points of a time, thinned: of those in one column the first, the least, the greatest and the last remain, so that a
 * drawn curve looks the same. With `shared` only the least and the greatest remain, at the same times of the column for every
 * curve: many curves then need few times together.
 * @param {Curve} curve
 * @param {import("./types").Range} range
 * @param {number} columns
 * @param {boolean} [shared]
 * @returns {[number[], (number | null)[]]} times and values; `null` is a gap
 */
export function thin(curve, range, columns, shared = false) {
  /** @type {number[]} */
  const times = [];
  /** @type {(number | null)[]} */
  const values = [];
  const put = (/** @type {number} */ i, time = curve.times[i]) => {
    if (times.length > 0 && times[times.length - 1] >= time) return;
    times.push(time);
    values.push(Number.isNaN(curve.values[i]) ? null : curve.values[i]);
  };
  const first = Math.max(0, indexAt(curve, range.from));
  const width = (range.to - range.from) / columns;
  let i = first;
  while (i < curve.length) {
    const begin = i;
    const column = Math.floor((curve.times[i] - range.from) / width);
    let [least, greatest] = [i, i];
    let gap = -1;
    while (i < curve.length && Math.floor((curve.times[i] - range.from) / width) === column) {
      if (Number.isNaN(curve.values[i])) gap = i;
      else {
        if (!(curve.values[i] >= curve.values[least])) least = i;
        if (!(curve.values[i] <= curve.values[greatest])) greatest = i;
      }
      i += 1;
    }
    const inner = gap < 0 ? [least, greatest] : [least, gap, greatest];
    inner.sort((a, b) => a - b);
    if (shared && i - begin > 2) {
      const step = width / (inner.length + 1);
      inner.forEach((index, n) => put(index, range.from + column * width + (n + 1) * step));
    } else [begin, ...inner, i - 1].forEach((index) => put(index));
    if (curve.times[i - 1] > range.to) break;
  }
  const last = times.length - 1;
  if (curve.channel.held && last >= 0 && values[last] !== null && times[last] < range.to) {
    times.push(range.to);
    values.push(values[last]);
  }
  return [times, values];
}
