// Lets a page get the blocks, events and counters of virtual hours, as fast as it takes them. A test of the tool runs this in
// a browser: `await hours(from, to)`.

/** The channels, and how many points they have in a second: an axis that moves all the time, its state, and the board. */
const CHANNELS = [
  [1, "position", false], [1, "velocity", false], [1, "torque", false], [1, "statusword", true], [0, "fifo_free", false],
].map(([slave, quantity, held]) => ({ slave, quantity, bit: 0, factor: 1, unit: "", held }));
const RATES = [1000, 20, 20, 20, 20];

const unsigned = (value) => (value < 128 ? [value] : [(value % 128) + 128, ...unsigned(Math.floor(value / 128))]);
const signed = (value) => unsigned(value < 0 ? -2 * value - 1 : 2 * value);
/** The points after the second one, at equal steps of time; their values go to and fro by a count. */
const tails = RATES.map((rate) => Uint8Array.from({ length: 2 * (rate - 2) }, (_, i) => (i % 2 === 0 ? 0 : 1 + (i >> 1) % 2)));
const room = new Uint8Array(tails.reduce((sum, tail) => sum + tail.length + 50, 0));

function block(second) {
  let at = 0;
  RATES.forEach((rate, place) => {
    const [from, step] = [second * 1e9, 1e9 / rate];
    const head = [...[place, 0, rate].flatMap(unsigned), ...[from, second % 50, step - from, 1].flatMap(signed)];
    for (const part of [head, tails[place]]) {
      room.set(part, at);
      at += part.length;
    }
  });
  return room.subarray(0, at);
}

globalThis.hours = async (from, to) => {
  if (from === 0) {
    const words = { drive_states: page.words.drive_states, al_states: page.words.al_states };
    const hello = { format: 1, version: "", source: "board", name: "a day", notes: [], slaves: [{ number: 1, kind: "drive" }] };
    page.message({ type: "hello", ...hello, words, channels: CHANNELS, events: [], spans: [] });
  }
  for (let second = from * 3600; second < to * 3600; second++) {
    page.store.addBlock(block(second));
    page.dirty = true;
    if (second % 300 !== 0) continue;
    const events = Array.from({ length: 60 }, (_, i) =>
      ({ at_ns: (second + 5 * i) * 1e9, slave: 1, kind: "drive", text: `event ${second + 5 * i}` }));
    page.message({ type: "events", events });
    page.message({ type: "status", status: { reports: second * 1000, reports_lost: 0, reports_bad_crc: 0 }, dropped: 0 });
    // The page draws meanwhile.
    await new Promise((done) => requestAnimationFrame(() => setTimeout(done)));
  }
  // On a busy machine the page may not have drawn the last points.
  page.dirty = true;
  page.draw();
  return [page.store.from, page.store.to, page.events.length];
};
