// The way of two axes in their plane.
import { indexAt, valueAt } from "./channels.js";

/** The most points of a way. */
const POINTS_MAX = 20000;

/**
 * The points at which both curves have a value.
 * @param {import("./types").Curve | undefined} across
 * @param {import("./types").Curve | undefined} up
 * @param {import("./types").Range} range
 * @returns {(readonly [number, number] | null)[]} `null` is a gap
 */
export function way(across, up, range) {
  if (!across || !up) return [];
  const first = Math.max(0, indexAt(across, range.from));
  const last = indexAt(across, range.to);
  const step = Math.max(1, Math.ceil((last - first) / POINTS_MAX));
  /** @type {(readonly [number, number] | null)[]} */
  const points = [];
  for (let i = first; i <= last; i += step) {
    const [x, y] = [across.values[i], valueAt(up, across.times[i])];
    points.push(Number.isNaN(x) || Number.isNaN(y) ? null : [x, y]);
  }
  return points;
}

/**
 * Draws ways with the same scale in both directions.
 * @param {HTMLCanvasElement} canvas
 * @param {{points: (readonly [number, number] | null)[], colour: string, dashed: boolean}[]} ways
 */
export function drawPlane(canvas, ways) {
  const context = canvas.getContext("2d");
  if (!context) return;
  const ratio = globalThis.devicePixelRatio || 1;
  const side = Math.max(1, Math.round(canvas.clientWidth * ratio));
  [canvas.width, canvas.height] = [side, side];
  const all = ways.flatMap((one) => one.points).filter((point) => point !== null);
  if (all.length === 0) return;
  const ends = [0, 1].map((k) => {
    let [least, greatest] = [Infinity, -Infinity];
    for (const point of all) {
      least = Math.min(least, point[k]);
      greatest = Math.max(greatest, point[k]);
    }
    return { middle: (least + greatest) / 2, size: greatest - least };
  });
  const scale = (side * 0.9) / (Math.max(ends[0].size, ends[1].size) || 1);
  const place = (/** @type {readonly [number, number]} */ [x, y]) =>
    [side / 2 + (x - ends[0].middle) * scale, side / 2 - (y - ends[1].middle) * scale];
  for (const { points, colour, dashed } of ways) {
    context.beginPath();
    let isDown = false;
    for (const point of points) {
      if (point) {
        const [x, y] = place(point);
        if (isDown) context.lineTo(x, y);
        else context.moveTo(x, y);
      }
      isDown = point !== null;
    }
    context.setLineDash(dashed ? [5 * ratio, 4 * ratio] : []);
    [context.strokeStyle, context.lineWidth] = [colour, 1.5 * ratio];
    context.stroke();
  }
}
