// What is shown, as MCAP (https://mcap.dev/spec), for Foxglove and PlotJuggler. Values are in the units of the page, unlike
// those of `ecmsk recording export`, so the topics have other names. Times count from the first frame of the page.
import { moments } from "./csv.js";
import { valueAt } from "./channels.js";
import { channelName } from "./words.js";

const MAGIC = Uint8Array.from([0x89, ...new TextEncoder().encode("MCAP0\r\n")]);
/** The opcodes of the records that are written. */
const OP = { header: 1, footer: 2, schema: 3, channel: 4, message: 5, statistics: 11, dataEnd: 15 };
/** How many messages are made before the page does something else. */
const MESSAGES_AT_ONCE = 2000;

/** Bytes that grow at their end. */
class Bytes {
  constructor() {
    this.all = new Uint8Array(1 << 16);
    this.length = 0;
  }

  /** @param {Uint8Array} bytes */
  put(bytes) {
    if (this.length + bytes.length > this.all.length) {
      const all = new Uint8Array(2 * (this.length + bytes.length));
      all.set(this.all.subarray(0, this.length));
      this.all = all;
    }
    this.all.set(bytes, this.length);
    this.length += bytes.length;
    return this;
  }

  /**
   * A number, the lowest byte first.
   * @param {number} value
   * @param {number} width
   */
  uint(value, width) {
    const bytes = new Uint8Array(width);
    for (let i = 0; i < width; i++, value = Math.floor(value / 256)) bytes[i] = value % 256;
    return this.put(bytes);
  }

  /**
   * A text behind its length.
   * @param {string} words
   */
  text(words) {
    const bytes = new TextEncoder().encode(words);
    return this.uint(bytes.length, 4).put(bytes);
  }

  /**
   * @param {number} op
   * @param {Bytes} content
   */
  record(op, content) {
    return this.uint(op, 1).uint(content.length, 8).put(content.all.subarray(0, content.length));
  }
}

/** @param {import("./types").Channel} channel */
function field({ quantity, bit }) {
  return quantity === "input" || quantity === "output" ? `${quantity}_${bit}` : quantity;
}

/**
 * A topic for the board and for each slave. It has a message for each moment at which one of its curves has a point.
 * @param {import("./types").Curve[]} curves
 * @param {import("./types").Range} range
 * @param {import("./types").SlaveInfo[]} slaves
 * @returns {Promise<Uint8Array>} the file
 */
export async function mcap(curves, range, slaves) {
  const numbers = Array.from(new Set(curves.map(({ channel }) => channel.slave))).sort((a, b) => a - b);
  const topics = numbers.map((slave, i) => {
    const isIo = slaves.some(({ number, kind }) => number === slave && kind === "io");
    const name = slave === 0 ? "/page/board" : `/page/${isIo ? "io" : "axis"}/${slave}`;
    return { id: i + 1, name, own: curves.filter(({ channel }) => channel.slave === slave), count: 0 };
  });
  const heads = new Bytes();
  for (const { id, name, own } of topics) {
    const property = (/** @type {import("./types").Curve} */ { channel }) =>
      [field(channel), { type: "number", description: `${channelName(channel, slaves)} ${channel.unit}`.trim() }];
    const schema = { title: name, type: "object", properties: Object.fromEntries(own.map(property)) };
    heads.record(OP.schema, new Bytes().uint(id, 2).text(name).text("jsonschema").text(JSON.stringify(schema)));
    heads.record(OP.channel, new Bytes().uint(id, 2).uint(id, 2).text(name).text("json").uint(0, 4));
  }
  const file = new Bytes().put(MAGIC).record(OP.header, new Bytes().text("").text("ecmsk"));
  file.put(heads.all.subarray(0, heads.length));
  const rows = topics.flatMap((topic) => moments(topic.own, range).map((at) => ({ at, topic })));
  rows.sort((a, b) => a.at - b.at || a.topic.id - b.topic.id);
  const ns = (/** @type {number} */ at) => Math.max(0, Math.round(at * 1e9));
  for (const [i, { at, topic }] of rows.entries()) {
    // Meanwhile a stop is heard, and the server's questions are answered.
    if (i % MESSAGES_AT_ONCE === 0) await new Promise((done) => setTimeout(done));
    const values = topic.own.map((curve) => [field(curve.channel), Number(valueAt(curve, at).toPrecision(12))]);
    const json = JSON.stringify(Object.fromEntries(values.filter(([, value]) => Number.isFinite(value))));
    topic.count += 1;
    const content = new Bytes().uint(topic.id, 2).uint(topic.count, 4).uint(ns(at), 8).uint(ns(at), 8);
    file.record(OP.message, content.put(new TextEncoder().encode(json)));
  }
  file.record(OP.dataEnd, new Bytes().uint(0, 4));
  const summary = file.length;
  const [first, last] = [rows[0], rows[rows.length - 1]].map((row) => (row ? ns(row.at) : 0));
  const statistics = new Bytes().uint(rows.length, 8).uint(topics.length, 2).uint(topics.length, 4);
  // There are no attachments, metadata and chunks.
  statistics.uint(0, 12).uint(first, 8).uint(last, 8).uint(10 * topics.length, 4);
  for (const { id, count } of topics) statistics.uint(id, 2).uint(count, 8);
  file.put(heads.all.subarray(0, heads.length)).record(OP.statistics, statistics);
  file.record(OP.footer, new Bytes().uint(summary, 8).uint(0, 8).uint(0, 4)).put(MAGIC);
  return file.all.slice(0, file.length);
}
