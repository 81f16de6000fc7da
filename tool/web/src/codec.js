// The bytes of points, which `tool/src/web/codec.rs` writes.

/**
 * @typedef {object} Piece
 * @property {number} channel the number of the channel
 * @property {boolean} breaks whether the first point is not connected with the channel's point before
 * @property {Float64Array} times nanoseconds
 * @property {Float64Array} values steps of the channel's factor
 */

/**
 * The records of a block. A block that is cut or has a channel twice as long as it says ends early.
 * @param {Uint8Array} bytes
 * @returns {Piece[]}
 */
export function decodeBlock(bytes) {
  let at = 0;
  const unsigned = () => {
    let value = 0;
    let weight = 1;
    for (;;) {
      const byte = bytes[at++];
      if (byte === undefined) throw new RangeError("the block ends inside a number");
      value += (byte & 0x7f) * weight;
      if (byte < 0x80) return value;
      weight *= 128;
    }
  };
  const signed = () => {
    const value = unsigned();
    return value % 2 === 0 ? value / 2 : -(value + 1) / 2;
  };
  /** @type {Piece[]} */
  const pieces = [];
  while (at < bytes.length) {
    const channel = unsigned();
    const breaks = unsigned() % 2 === 1;
    const count = unsigned();
    // Each point has two bytes at least, so that a wrong count cannot ask for much memory.
    if (count > (bytes.length - at) / 2) throw new RangeError("the block has fewer points than it says");
    const times = new Float64Array(count);
    const values = new Float64Array(count);
    let [time, step, value] = [0, 0, 0];
    for (let i = 0; i < count; i++) {
      step += signed();
      time += step;
      value += signed();
      times[i] = time;
      values[i] = value;
    }
    pieces.push({ channel, breaks, times, values });
  }
  return pieces;
}

/**
 * @param {string} text in base64
 * @returns {Uint8Array}
 */
export function fromBase64(text) {
  return Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
}
