// What a live page keeps of the points of a board, in node.
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import test from "node:test";

import { Store, valueAt } from "../src/channels.js";
import { fires } from "../src/trigger.js";

/** How long a page keeps points, seconds. */
const KEPT_S = 600;
/** The channels that a board has for each axis (`tool/src/web/sampler.rs`), and whether their values hold. */
const OF_AXIS = [["position", false], ["velocity", false], ["torque", false], ["statusword", true], ["error_code", true]];
const OF_BOARD = [["al_state", true], ["fifo_free", false], ["full_count", true]];

const unsigned = (value) => (value < 128 ? [value] : [(value % 128) + 128, ...unsigned(Math.floor(value / 128))]);
const signed = (value) => unsigned(value < 0 ? -2 * value - 1 : 2 * value);

/** The bytes of `count` points after the second, at equal steps of time, whose values go to and fro by a count, or stay. */
const tail = (count, stays) => Uint8Array.from({ length: 2 * count }, (_, i) => (i % 2 === 0 || stays ? 0 : 1 + (i >> 1) % 2));

/** A record of a block, which begins at a time; all times are nanoseconds. */
function record(place, from, step, rest) {
  const count = rest.length / 2 + 2;
  return Buffer.concat([
    Uint8Array.from([place, 0, count].flatMap(unsigned)),
    Uint8Array.from([from, 0, step - from, 0].flatMap(signed)),
    rest,
  ]);
}

/** A page that has got reports of a board for some seconds. */
function watched(axes, cycle_ns, seconds) {
  const store = new Store(KEPT_S);
  const quantities = [[0, OF_BOARD], ...Array.from({ length: axes }, (_, i) => [i + 1, OF_AXIS])];
  const channels = quantities.flatMap(([slave, all]) =>
    all.map(([quantity, held]) => ({ slave, quantity, bit: 0, factor: 1, unit: "", held })));
  store.setChannels(channels);
  const [stays, moves] = [true, false].map((stays) => tail(1e9 / cycle_ns - 2, stays));
  let largest = 0;
  for (let second = 0; second < seconds; second++) {
    store.addBlock(Buffer.concat(channels.map(({ held }, place) => record(place, second * 1e9, cycle_ns, held ? stays : moves))));
    largest = Math.max(largest, store.size);
  }
  return { store, largest };
}

test("the points of a live page take no more memory than WEB.md says", () => {
  const page = readFileSync(new URL("../../../docs/WEB.md", import.meta.url), "utf8");
  const rows = Array.from(page.matchAll(/^\| (\d+) axes \| (\d+) MB \|/gm), ([, axes, mb]) => [Number(axes), Number(mb)]);
  assert.deepEqual(rows.map(([axes]) => axes), [2, 8, 40]);
  // Axes, the cycle in ns, and the seconds after which all curves have been full.
  const boards = [[2, 1e6, KEPT_S * 1.2], [8, 1e6, 210], [8, 250_000, 55], [40, 1e6, 85], [40, 250_000, 22]];
  for (const [axes, cycle_ns, seconds] of boards) {
    const { store, largest } = watched(axes, cycle_ns, seconds);
    const words = `${axes} axes at ${cycle_ns} ns: ${largest} bytes`;
    const said = 1e6 * Number(rows.find(([some]) => some === axes)?.[1]);
    assert.ok(largest <= said && largest > 0.95 * said, words);
    assert.ok(store.from <= Math.max(0, seconds - KEPT_S), `${words}, from ${store.from} s`);
  }
});

test("of the older points the peaks remain, and the newest points all", () => {
  const store = new Store(KEPT_S);
  store.setChannels([{ slave: 1, quantity: "position", bit: 0, factor: 1, unit: "", held: false }]);
  const points = 600_000;
  const peaks = [123, 123_456, 345_678];
  const valueOf = (i) => (peaks.includes(i) ? 9999 : i % 3);
  for (let at = 0; at < points; at += 1000) {
    const bytes = [0, 0, ...unsigned(1000)];
    let [time, step, value] = [0, 0, 0];
    for (let i = at; i < at + 1000; i++) {
      bytes.push(...signed(i * 1e6 - time - step), ...signed(valueOf(i) - value));
      [step, time, value] = [i * 1e6 - time, i * 1e6, valueOf(i)];
    }
    store.addBlock(Uint8Array.from(bytes));
  }
  const [curve] = store.curves;
  assert.ok(curve.length <= 200_000, `${curve.length} points`);
  for (const peak of peaks) assert.equal(valueAt(curve, peak / 1e3), 9999, `the peak at ${peak} ms`);
  for (let i = points - 90_000; i < points; i++) assert.equal(valueAt(curve, i / 1e3), i % 3);
  assert.ok(curve.times.subarray(0, curve.length).every((at, i, all) => i === 0 || at > all[i - 1]));
});

test("a state that stays takes two points, and is known at any time", () => {
  const store = new Store(KEPT_S);
  store.setChannels([{ slave: 1, quantity: "statusword", bit: 0, factor: 1, unit: "", held: true }]);
  for (let second = 0; second < 100; second++) {
    store.addBlock(record(0, second * 1e9, 1e6, tail(998, true)));
  }
  const [curve] = store.curves;
  assert.equal(curve.length, 2);
  assert.deepEqual([store.from, store.to, curve.times[1]], [0, 99.999, 99.999]);
  assert.deepEqual([0, 50, 1e3].map((at) => valueAt(curve, at)), [0, 0, 0]);
  assert.equal(fires({ kind: "below", level: 1 }, curve, [], 50), 50, "a trigger whose level is reached already fires at once");
  assert.equal(fires({ kind: "above", level: 1 }, curve, [], 50), undefined);
});
