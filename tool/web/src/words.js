// Numbers as words.

/** What each quantity is called. */
const QUANTITIES = new Map([
  ["position", "position"],
  ["target", "target"],
  ["beside", "position in the other recording"],
  ["following_error", "following error"],
  ["velocity", "velocity"],
  ["target_velocity", "target velocity"],
  ["csv", "target (CSV)"],
  ["torque", "torque"],
  ["cst", "target (CST)"],
  ["statusword", "statusword"],
  ["error_code", "error code"],
  ["fifo_free", "free FIFO entries"],
  ["full_count", "FIFO-full count"],
  ["al_state", "state"],
  ["input", "in"],
  ["output", "out"],
]);

/** The bits of a statusword that mean the same in every mode. */
const BITS = [
  [7, "warning"],
  [10, "target reached"],
  [11, "internal limit active"],
];

/**
 * @param {number} value
 * @param {number} digits
 */
export function hex(value, digits) {
  return "0x" + value.toString(16).toUpperCase().padStart(digits, "0");
}

/**
 * The state of a drive and the flags of its statusword.
 * @param {import("./types").Words} words
 * @param {number} statusword
 */
export function statuswordInWords(words, statusword) {
  const state = words.drive_states[statusword & 0x7f] || "no CiA 402 state";
  const flags = BITS.filter(([bit]) => (statusword >> Number(bit)) & 1).map(([, name]) => name);
  return [state, ...flags].join(", ");
}

/**
 * @param {import("./types").Words} words
 * @param {number} byte the state byte of the board
 */
export function boardState(words, byte) {
  return words.al_states[String(byte)] ?? `unknown ${hex(byte, 2)}`;
}

/**
 * A slave as a person calls it.
 * @param {import("./types").SlaveInfo[]} slaves
 * @param {number} number
 */
export function slaveName(slaves, number) {
  if (number === 0) return "board";
  const name = slaves.find((slave) => slave.number === number)?.name;
  return name ?? `slave ${number}`;
}

/**
 * @param {import("./types").Channel} channel
 * @param {import("./types").SlaveInfo[]} slaves
 */
export function channelName(channel, slaves) {
  const quantity = QUANTITIES.get(channel.quantity) ?? channel.quantity;
  if (channel.name) return channel.name;
  const bit = channel.quantity === "input" || channel.quantity === "output" ? ` ${channel.bit}` : "";
  return channel.slave === 0 ? quantity : `${slaveName(slaves, channel.slave)} ${quantity}${bit}`;
}

/**
 * A number with as many digits as a step of `resolution` needs.
 * @param {number} value
 * @param {number} resolution
 */
export function number(value, resolution) {
  if (!Number.isFinite(value)) return "";
  const digits = Math.min(9, Math.max(0, Math.ceil(-Math.log10(resolution) - 1e-9)));
  return value.toFixed(digits);
}

/**
 * The resolution with which values of a channel are shown: a step of its factor, but at least a millionth of the unit. [OURS]
 * @param {number} factor negative for an axis that counts the other way
 */
export function resolutionOf(factor) {
  return Math.max(1e-6, Math.abs(factor));
}

/**
 * A number with six digits, or those before its point, without zeros at its end. [OURS]
 * @param {number} value
 */
export function short(value) {
  return String(Math.abs(value) < 1e6 ? Number(value.toPrecision(6)) : Math.round(value));
}

/**
 * Numbers at an axis, with as many digits as their distance has.
 * @param {number[]} splits
 */
export function steps(splits) {
  const step = splits.length > 1 ? Math.abs(splits[1] - splits[0]) : 1;
  let resolution = 1;
  // A step of 0.025 has three digits, one of 0.02 two.
  while (resolution > 1e-9 && Math.abs(step / resolution - Math.round(step / resolution)) > 1e-6) resolution /= 10;
  return splits.map((split) => number(split, resolution));
}

/**
 * A time in seconds, to the microsecond where a range is that short.
 * @param {number} seconds
 * @param {number} [range]
 */
export function time(seconds, range = 1) {
  return number(seconds, Math.max(1e-6, Math.min(1e-3, range / 1000))) + " s";
}
