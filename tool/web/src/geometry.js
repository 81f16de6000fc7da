// Where the axes of a machine are in its picture: numbers alone, without a document.

/** @typedef {import("./types").SlaveInfo} SlaveInfo */
/**
 * What is drawn as one: an axis on a rail, an axis on a dial, two axes of a table, or the two or three of a gantry.
 * @typedef {{kind: "linear" | "rotary" | "xy" | "gantry", slaves: number[]}} Figure
 */
/**
 * The scale of an axis, with its soft limits.
 * @typedef {{from: number, to: number, min?: number, max?: number}} Reach
 */

/** How far beyond the ends of its scale an axis is drawn at most, as a part of the scale. */
const BEYOND = 0.06;

/**
 * The figures of a machine. Axes that the machine file draws together are one figure, as soon as all of them have a position.
 * @param {number[]} axes the slaves with a position
 * @param {SlaveInfo[]} slaves
 * @param {import("./types").Picture} [picture]
 * @returns {Figure[]}
 */
export function figures(axes, slaves, picture) {
  /** @type {Figure[]} */
  const named = [
    ...(picture?.xy ?? []).map((pair) => ({ kind: /** @type {const} */ ("xy"), slaves: pair })),
    ...(picture?.gantries ?? []).map(({ sides, bridge }) =>
      ({ kind: /** @type {const} */ ("gantry"), slaves: bridge === undefined ? sides : [...sides, bridge] })),
  ];
  const together = named.filter((figure) => figure.slaves.every((slave) => axes.includes(slave)));
  const drawn = new Set(together.flatMap((figure) => figure.slaves));
  const turns = (/** @type {number} */ number) => slaves.some((slave) => slave.number === number && slave.turn);
  const alone = axes.filter((slave) => !drawn.has(slave));
  /** @type {Figure[]} */
  const rails = alone.filter((slave) => !turns(slave)).map((slave) => ({ kind: "linear", slaves: [slave] }));
  /** @type {Figure[]} */
  const dials = alone.filter(turns).map((slave) => ({ kind: "rotary", slaves: [slave] }));
  return [...together, ...rails, ...dials];
}

/**
 * The scale of an axis: from limit to limit. Where it has none, to the extreme that was seen, rounded to a step.
 * @param {{min?: number, max?: number}} limits
 * @param {number} least the least position or target that was seen; infinite if there was none
 * @param {number} greatest the greatest one
 * @returns {Reach}
 */
export function reach({ min, max }, least, greatest) {
  let from = min ?? Math.min(least, max ?? least);
  let to = max ?? Math.max(greatest, min ?? greatest);
  if (!Number.isFinite(from)) from = Number.isFinite(to) ? to : 0;
  if (!Number.isFinite(to)) to = from;
  const step = stepOf((to - from) / 4);
  if (min === undefined) from = Math.floor(from / step + 1e-9) * step;
  if (max === undefined) to = Math.ceil(to / step - 1e-9) * step;
  if (to <= from) {
    if (min === undefined) from -= step;
    if (max === undefined || min !== undefined) to += step;
  }
  return { from, to, min, max };
}

/**
 * The scale of two axes that share one.
 * @param {Reach} one
 * @param {Reach} other
 * @returns {Reach}
 */
export function both(one, other) {
  return { from: Math.min(one.from, other.from), to: Math.max(one.to, other.to) };
}

/**
 * The least of 1, 2, 5, 10, ... times a power of ten that is no less than this.
 * @param {number} least
 */
export function stepOf(least) {
  if (!(least > 0)) return 1;
  const power = 10 ** Math.floor(Math.log10(least));
  return power * ([1, 2, 5].find((digit) => digit * power >= least * (1 - 1e-9)) ?? 10);
}

/**
 * Where a scale has its marks.
 * @param {Reach} reach
 * @param {number} most how many there are at most, about
 */
export function marks({ from, to }, most) {
  const step = stepOf((to - from) / most);
  const [first, last] = [Math.ceil(from / step - 1e-9), Math.floor(to / step + 1e-9)];
  // 0 and not -0.
  return Array.from({ length: Math.max(0, last - first + 1) }, (_, i) => (first + i) * step + 0);
}

/**
 * Where a position is between two ends of a drawing. A position beyond the scale is drawn beyond its end, but never far.
 * @param {number} position
 * @param {Reach} reach
 * @param {number} begin where `from` is drawn
 * @param {number} end where `to` is drawn
 * @returns {number} not a number if the position is none
 */
export function place(position, { from, to }, begin, end) {
  const part = (position - from) / (to - from);
  return begin + Math.min(1 + BEYOND, Math.max(-BEYOND, part)) * (end - begin);
}

/**
 * The angle of a pointer in degrees, clockwise from the top. It counts turns, so that a pointer never turns back.
 * @param {number} position
 * @param {number} turn how many units a turn has
 */
export function angle(position, turn) {
  return (position / turn) * 360;
}

/**
 * The angles between which an axis may turn; none if that is all around, or without both limits.
 * @param {{min?: number, max?: number}} limits
 * @param {number} turn
 * @returns {[number, number] | undefined}
 */
export function sector({ min, max }, turn) {
  if (min === undefined || max === undefined || max - min >= turn) return undefined;
  return [angle(min, turn), angle(max, turn)];
}

/**
 * The size of a table with the same scale in both directions.
 * @param {Reach} across
 * @param {Reach | undefined} up `undefined`: nothing moves up
 * @param {{width: number, height: number}} room
 */
export function table(across, up, room) {
  /** The least size of a side, so that a carriage has room. */
  const least = 24;
  if (!up) return { width: room.width, height: 2 * least };
  const [wide, high] = [across.to - across.from, up.to - up.from];
  const scale = Math.min(room.width / wide, room.height / high);
  return { width: Math.max(least, wide * scale), height: Math.max(least, high * scale) };
}
