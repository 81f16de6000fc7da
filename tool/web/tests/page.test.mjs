// The logic of the page, in node: `node --test tool/web/tests`.
import assert from "node:assert/strict";
import test from "node:test";

import { indexAt, Store, thin, valueAt } from "../src/channels.js";
import { decodeBlock, fromBase64 } from "../src/codec.js";
import { csv } from "../src/csv.js";
import { way } from "../src/plane.js";
import { readings } from "../src/readings.js";
import { fires } from "../src/trigger.js";
import { boardState, channelName, hex, number, statuswordInWords, steps, time } from "../src/words.js";

const channel = (slave, quantity, more = {}) => ({ slave, quantity, bit: 0, factor: 1, unit: "", held: false, ...more });

/** A number as the tool writes it. */
const unsigned = (value) => (value < 128 ? [value] : [(value % 128) + 128, ...unsigned(Math.floor(value / 128))]);
const signed = (value) => unsigned(value < 0 ? -2 * value - 1 : 2 * value);

/** A record of a block. */
function record(place, points, breaks = false) {
  const bytes = [...unsigned(place), breaks ? 1 : 0, ...unsigned(points.length)];
  let [time, step, value] = [0, 0, 0];
  for (const [at, now] of points) {
    bytes.push(...signed(at - time - step), ...signed(now - value));
    [step, time, value] = [at - time, at, now];
  }
  return bytes;
}

const ms = (n) => n * 1_000_000;

/** A store with one curve. */
function store(points, more = {}, kept = undefined) {
  const found = new Store(kept);
  found.setChannels([channel(1, "position", more)]);
  found.addBlock(Uint8Array.from(record(0, points)));
  return found;
}

test("a block has the bytes that the tool writes", () => {
  // The same bytes are in tool/src/web/codec.rs.
  const bytes = [0xac, 0x02, 0x01, 0x03, 0x80, 0x89, 0x7a, 0x09, 0x00, 0x18, 0xc8, 0x01, 0x00];
  const [piece, ...others] = decodeBlock(Uint8Array.from(bytes));
  assert.equal(others.length, 0);
  assert.deepEqual([piece.channel, piece.breaks], [300, true]);
  assert.deepEqual(Array.from(piece.times), [1_000_000, 2_000_000, 3_000_100]);
  assert.deepEqual(Array.from(piece.values), [-5, 7, 7]);
  assert.deepEqual(Array.from(fromBase64(Buffer.from(bytes).toString("base64"))), bytes);
});

test("a block that is cut or says too much is an error", () => {
  assert.throws(() => decodeBlock(Uint8Array.from([0x80])), RangeError);
  assert.throws(() => decodeBlock(Uint8Array.from([0, 0, 0xff, 0xff, 0xff, 0x7f, 0, 0])), RangeError);
});

test("numbers beyond 32 bits stay exact", () => {
  const points = [[ms(86_400_000), 4_294_967_295], [ms(86_400_001), -4_294_967_295]];
  const [piece] = decodeBlock(Uint8Array.from(record(0, points)));
  assert.deepEqual(Array.from(piece.times), points.map(([at]) => at));
  assert.deepEqual(Array.from(piece.values), points.map(([, value]) => value));
});

test("a value is on the line between two points, or holds", () => {
  const points = [[ms(0), 0], [ms(10), 100], [ms(20), 100]];
  assert.equal(valueAt(store(points, { factor: 0.5 }).curves[0], 0.005), 25);
  assert.equal(valueAt(store(points, { held: true }).curves[0], 0.005), 0);
  assert.equal(valueAt(store(points, { held: true }).curves[0], 9), 100);
  assert.ok(Number.isNaN(valueAt(store(points).curves[0], 9)), "a line has an end");
  assert.ok(Number.isNaN(valueAt(store(points).curves[0], -1)));
});

test("a gap has no value", () => {
  const found = store([[ms(0), 0], [ms(10), 100]]);
  found.addBlock(Uint8Array.from(record(0, [[ms(50), 1], [ms(60), 2]], true)));
  const [curve] = found.curves;
  assert.ok(Number.isNaN(valueAt(curve, 0.03)));
  assert.deepEqual([valueAt(curve, 0.01), valueAt(curve, 0.05)], [100, 1]);
  assert.ok(thin(curve, { from: 0, to: 0.1 }, 1000)[1].includes(null));
  assert.ok(thin(curve, { from: 0, to: 0.1 }, 1)[1].includes(null), "in one column, too");
});

test("the oldest points are forgotten, and no others", () => {
  const found = store(Array.from({ length: 20_001 }, (_, i) => [ms(i), i]), {}, 10);
  assert.ok(found.from >= 10 && found.from < 11, `from ${found.from}`);
  assert.equal(found.to, 20);
  assert.equal(found.value(1, "position", 15), 15_000);
  assert.ok(indexAt(found.curves[0], found.from) >= 0, "what is shown begins with a point");
});

test("thinning keeps peaks and needs few points", () => {
  const points = Array.from({ length: 50_000 }, (_, i) => [ms(i), i === 31_415 ? 9_999 : i % 3]);
  const [times, values] = thin(store(points).curves[0], { from: 0, to: 50 }, 500);
  assert.ok(times.length <= 4 * 501, `${times.length} points`);
  assert.equal(Math.max(...values), 9_999);
  assert.ok(times.every((at, i) => i === 0 || at > times[i - 1]));
});

test("many curves share their times, and keep their peaks", () => {
  const [one, other] = [31_415, 27_182].map((peak) =>
    store(Array.from({ length: 50_000 }, (_, i) => [ms(i), i === peak ? 9_999 : (i * peak) % 7])).curves[0]);
  const [[times, values], [others]] = [one, other].map((curve) => thin(curve, { from: 0, to: 50 }, 500, true));
  assert.ok(times.length <= 2 * 502, `${times.length} points`);
  assert.equal(Math.max(...values), 9_999);
  assert.ok(times.every((at, i) => i === 0 || at > times[i - 1]));
  assert.ok(new Set([...times, ...others]).size <= 2 * 502);
  const [broken] = [store(Array.from({ length: 100 }, (_, i) => [ms(i), i]))];
  broken.addBlock(Uint8Array.from(record(0, [[ms(100), 1], [ms(110), 2]], true)));
  assert.ok(thin(broken.curves[0], { from: 0, to: 0.2 }, 1, true)[1].includes(null), "a gap stays");
});

test("cursors read values, their difference and what is between", () => {
  const points = [[ms(0), 0], [ms(10), 70], [ms(20), 20], [ms(30), 50]];
  const [reading] = readings(store(points).curves, 0, 0.02);
  assert.deepEqual([reading.a, reading.b, reading.difference], [0, 20, 20]);
  assert.deepEqual([reading.least, reading.greatest], [0, 70]);
  assert.ok(Number.isNaN(readings(store(points).curves, 0, undefined)[0].difference));
});

test("triggers fire at the moment, and not at one before they were armed", () => {
  const [curve] = store([[ms(0), 0], [ms(10), 10], [ms(20), 0], [ms(30), 10]]).curves;
  const at = (kind, from, level = 5) => fires({ kind, level }, curve, [], from);
  assert.equal(at("rising", -1), 0.01);
  assert.equal(at("rising", 0.01), 0.03);
  assert.equal(at("rising", 0.03), undefined);
  assert.equal(at("falling", -1), 0.02);
  assert.equal(at("above", 0.01), 0.03);
  assert.equal(at("below", -1, 0), undefined);
  const events = ["network", "alarm", "fifo", "lost", "gap"].map((kind, i) => ({ kind, at_ns: ms(i), slave: 1, text: "" }));
  const fired = ["alarm", "gap", "lost"].map((kind) => fires({ kind, level: 0 }, undefined, events, 0));
  assert.deepEqual(fired, [0.001, 0.002, 0.003]);
  assert.equal(fires({ kind: "gap", level: 0 }, undefined, events, 0.002), 0.004);
});

test("a way has the points of both axes", () => {
  const found = new Store();
  found.setChannels([channel(1, "position"), channel(2, "position")]);
  found.addBlock(Uint8Array.from([...record(0, [[ms(0), 1], [ms(10), 2]]), ...record(1, [[ms(0), 5], [ms(20), 15]])]));
  assert.deepEqual(way(found.find(1, "position"), found.find(2, "position"), { from: 0, to: 1 }), [[1, 5], [2, 10]]);
  assert.deepEqual(way(found.find(1, "position"), undefined, { from: 0, to: 1 }), []);
});

test("a table has a row for each moment, and no formulas", () => {
  const found = new Store();
  found.setChannels([channel(1, "position", { unit: "mm" }), channel(3, "input", { name: '=cmd("x")', held: true })]);
  found.addBlock(Uint8Array.from([...record(0, [[ms(0), 1], [ms(20), 3]]), ...record(1, [[ms(10), 1]])]));
  const lines = csv(found.curves, { from: 0, to: 1 }, [{ number: 1, kind: "drive", name: "X" }]).split("\r\n");
  assert.equal(lines[0], `time (s),X position (mm),"'=cmd(""x"")"`);
  assert.deepEqual(lines.slice(1), ["0.000000000,1,", "0.010000000,2,1", "0.020000000,3,1", ""]);
});

test("numbers stand in words", () => {
  const words = { drive_states: Array(128).fill(""), al_states: { 8: "OP" } };
  words.drive_states[0x37] = "Operation enabled";
  assert.equal(statuswordInWords(words, 0x1637), "Operation enabled, target reached");
  assert.equal(statuswordInWords(words, 0x0880), "no CiA 402 state, warning, internal limit active");
  assert.deepEqual([boardState(words, 8), boardState(words, 0x55)], ["OP", "unknown 0x55"]);
  assert.equal(hex(0x603f, 6), "0x00603F");
  assert.deepEqual([number(1.23456, 0.01), number(12, 1), number(NaN, 1)], ["1.23", "12", ""]);
  assert.equal(time(1.5), "1.500 s");
  assert.deepEqual(steps([0.425, 0.45, 0.475]), ["0.425", "0.450", "0.475"]);
  assert.deepEqual(steps([-20, 0, 20]), ["-20", "0", "20"]);
  assert.equal(channelName(channel(2, "output", { bit: 7 }), []), "slave 2 out 7");
});
