/** The messages of a source, as `tool/src/web/hello.rs` and `tool/src/serve/web/live.rs` write them. */
export interface Channel {
  slave: number;
  quantity: string;
  bit: number;
  name?: string;
  factor: number;
  unit: string;
  held: boolean;
}
export interface SlaveInfo { number: number; kind: string; name?: string; min?: number; max?: number; turn?: number }
/** The axes that are drawn together, by the numbers of their slaves. */
export interface Picture { xy: [number, number][]; gantries: { sides: [number, number]; bridge?: number }[] }
export interface Happening { at_ns: number; slave: number; kind: string; text: string; code?: number }
export interface Span { slave: number; state: string; from: number; to: number; text: string }
export interface Words { drive_states: string[]; al_states: { [byte: string]: string } }
export interface Hello {
  format: number;
  version: string;
  source: "recording" | "board";
  name: string;
  notes: string[];
  slaves: SlaveInfo[];
  words: Words;
  channels: Channel[];
  events: Happening[];
  spans: Span[];
  plane?: [number, number];
  picture?: Picture;
  /** The expression of `--find`. */
  find?: string;
  block?: string;
  /** Whether pages may move axes. */
  control?: boolean;
}
/** The page that has control: this one, also while the board is opened for it, another one, or none. */
export type Holder = "none" | "other" | "opening" | "you";
/** A text for a person; `is_stop`: what has become of a stop. */
export interface Said { type: "said"; text: string; is_error: boolean; is_stop: boolean }
export interface ControlState { type: "control"; holder: Holder; is_wanted: boolean; busy: string | null }
export interface Status {
  reports: number;
  reports_lost: number;
  reports_bad_crc: number;
  reports_per_s?: number;
  trouble?: string;
  counters?: { [name: string]: number };
}
export type Message =
  | ({ type: "hello" } & Hello)
  | { type: "channels"; channels: Channel[]; slaves: SlaveInfo[] }
  | { type: "events"; events: Happening[] }
  | { type: "ask"; n: number }
  | Said
  | ControlState
  | { type: "status"; status: Status; dropped: number };
/**
 * A channel with its points: times in seconds, values in its unit. A value that is not a number is a gap. `least` and
 * `greatest` are those of all points so far, also of those that are forgotten; infinite if there was none.
 */
export interface Curve {
  channel: Channel;
  times: Float64Array;
  values: Float64Array;
  length: number;
  least: number;
  greatest: number;
}
export interface Range { from: number; to: number }
