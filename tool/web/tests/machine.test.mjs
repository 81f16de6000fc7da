// Where the axes of a machine are drawn, in node.
import assert from "node:assert/strict";
import test from "node:test";

import { Store } from "../src/channels.js";
import { angle, both, figures, marks, place, reach, sector, stepOf, table } from "../src/geometry.js";
import { inWords, limits, Machine, skew } from "../src/machine.js";
import { slaveRows } from "../src/tables.js";

const slave = (number, more = {}) => ({ number, kind: "drive", ...more });

test("axes are drawn together as the machine file says, and the others alone", () => {
  const slaves = [1, 2, 3, 4, 5, 6].map((number) => slave(number, number === 6 ? { turn: 360 } : {}));
  const picture = { xy: [[1, 2]], gantries: [{ sides: [3, 4], bridge: 5 }] };
  assert.deepEqual(figures([1, 2, 3, 4, 5, 6], slaves, picture), [
    { kind: "xy", slaves: [1, 2] },
    { kind: "gantry", slaves: [3, 4, 5] },
    { kind: "rotary", slaves: [6] },
  ]);
  assert.deepEqual(figures([1, 2], [], undefined), [{ kind: "linear", slaves: [1] }, { kind: "linear", slaves: [2] }]);
  const alone = figures([1, 3, 4], slaves, picture).map((figure) => figure.kind);
  assert.deepEqual(alone, ["linear", "linear", "linear"], "of a table one axis has no position yet");
  assert.deepEqual(figures([5, 6, 1], slaves, undefined).map((figure) => figure.slaves), [[5], [1], [6]], "dials last");
  const without = figures([3, 4], slaves, { xy: [], gantries: [{ sides: [3, 4] }] });
  assert.deepEqual(without, [{ kind: "gantry", slaves: [3, 4] }]);
});

test("a scale goes from limit to limit, else to what was seen", () => {
  assert.deepEqual(reach({ min: -10, max: 250 }, 3, 4), { from: -10, to: 250, min: -10, max: 250 });
  const ends = (limits, least, greatest) => {
    const { from, to } = reach(limits, least, greatest);
    return [from, to];
  };
  assert.deepEqual(ends({}, -0.3, 9.7), [-5, 10]);
  assert.deepEqual(ends({}, 0, 10_000), [0, 10_000]);
  assert.deepEqual(ends({}, 5, 5), [4, 6], "an axis that has not moved");
  assert.deepEqual(ends({}, Infinity, -Infinity), [-1, 1], "an axis without a position");
  assert.deepEqual(ends({ min: 2 }, 5, 9.5), [2, 10]);
  assert.deepEqual(ends({ max: 2 }, 0.5, 1), [0.5, 2]);
  assert.deepEqual(ends({ min: 2 }, -5, -5), [2, 3], "below its only limit");
  assert.deepEqual(ends({ max: 2 }, 7, 7), [1, 2], "above its only limit");
  assert.deepEqual(ends({ min: 2 }, Infinity, -Infinity), [2, 3]);
  assert.deepEqual(both(reach({ min: 0, max: 5 }, 0, 0), reach({ min: -1, max: 3 }, 0, 0)), { from: -1, to: 5 });
});

test("marks are round numbers", () => {
  assert.deepEqual([0.3, 1, 1.1, 3, 7, 0].map(stepOf), [0.5, 1, 2, 5, 10, 1]);
  assert.deepEqual(marks({ from: -10, to: 250 }, 5), [0, 100, 200]);
  assert.deepEqual(marks({ from: -2, to: 2 }, 5), [-2, -1, 0, 1, 2]);
  assert.ok(!Object.is(marks({ from: -0.5, to: 2 }, 5)[1], -0));
});

test("a position is drawn on its scale, and not far beyond it", () => {
  const scale = { from: -10, to: 90 };
  assert.deepEqual([-10, 40, 90].map((at) => place(at, scale, 20, 220)), [20, 120, 220]);
  assert.deepEqual([-10, 90].map((at) => place(at, scale, 0, -50) + 0), [0, -50], "upwards");
  assert.ok(place(91, scale, 20, 220) > 220, "beyond the limit");
  assert.ok(place(1e9, scale, 20, 220) < 235 && place(-1e9, scale, 20, 220) > 5);
  assert.ok(Number.isNaN(place(NaN, scale, 20, 220)));
});

test("a pointer counts turns, and has a sector with limits of less than one", () => {
  assert.equal(angle(90, 360), 90);
  assert.equal(angle(-2.5, 1), -900);
  assert.deepEqual(sector({ min: -90, max: 90 }, 360), [-90, 90]);
  assert.equal(sector({ min: -180, max: 180 }, 360), undefined);
  assert.equal(sector({ min: 0 }, 360), undefined);
});

test("a table has one scale for both directions", () => {
  const room = { width: 240, height: 150 };
  assert.deepEqual(table({ from: 0, to: 100 }, { from: 0, to: 50 }, room), { width: 240, height: 120 });
  assert.deepEqual(table({ from: 0, to: 50 }, { from: 0, to: 100 }, room), { width: 75, height: 150 });
  assert.deepEqual(table({ from: 0, to: 1000 }, { from: 0, to: 1 }, room), { width: 240, height: 24 }, "a thin one");
  assert.deepEqual(table({ from: 0, to: 100 }, undefined, room), { width: 240, height: 48 });
});

test("values, limits and a skew have the digits that a count has in its unit", () => {
  const shown = (unit, factor, counts, ends) => {
    const store = new Store();
    const channel = { quantity: "position", bit: 0, factor, unit, held: false };
    store.setChannels([1, 2].map((slave) => ({ ...channel, slave })));
    const known = { slaves: [slave(1, { name: "X", ...ends }), slave(2, { name: "Y" })] };
    const axes = [1, 2].map((one) => new Machine(null, store, known).axis(one, "light"));
    const nows = counts.map((count) => ({ position: count * factor, target: NaN, look: "", alarm: "" }));
    // A record of a block: the channel, no break, one point at 0 ns, and its value by zigzag.
    store.addBlock(Uint8Array.from([0, 0, 1, 0, ...leb(counts[0])]));
    const { cells } = slaveRows(store, known.slaves, { drive_states: [], al_states: {} }, new Map(), 0)[0];
    return [inWords(axes[0], nows[0]), limits(axes[0]), skew(axes, nows), cells[4]];
  };
  const leb = (value) => {
    const zigzag = value < 0 ? -2 * value - 1 : 2 * value;
    return [(zigzag & 0x7f) | 0x80, ((zigzag >> 7) & 0x7f) | 0x80, zigzag >> 14];
  };
  assert.deepEqual(shown("m", 1e-6, [12_345, 11_945], { min: 0, max: 0.0125 }),
    ["X: 0.012345 m", "limits of X from 0 to 0.0125 m", "X - Y: 0.000400 m", "0.012345 m"]);
  assert.deepEqual(shown("turn", 1 / 4096, [1026, 0], { max: 0.2505 }).slice(0, 2),
    ["X: 0.2505 turn", "limits of X to 0.2505 turn"]);
  assert.deepEqual(shown("mm", -0.01, [-250, -249], {}), ["X: 2.50 mm", "", "X - Y: 0.01 mm", "2.50 mm"], "reversed");
  assert.deepEqual(shown("", 1, [20_000, 0], { min: -123_456_789 }),
    ["X: 20000 ", "limits of X from -123456789 ", "X - Y: 20000 ", "20000"], "in counts");
});
