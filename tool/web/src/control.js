// Hands on a board, with `ecmsk serve web --control`. The server asks 20 times a second which button is held; an axis
// runs as long as the answers say so. A page that is hidden, frozen or gone does not answer that.
import { slaveName } from "./words.js";

/** The parts of the speed by hand. */
const PARTS = [0.05, 0.1, 0.25, 0.5, 1];
/** The part that is chosen at first. [OURS] */
const FIRST_PART = 0.25;
/** How many texts of the server stay. */
const TEXTS_MAX = 50;
/** How long the server may take to confirm a stop: a connection to the board's server, and a brake. [OURS] */
const CONFIRMED_MS = 6000;
/** How soon and how late a second click may come: a double click, or a key that repeats, is none. [OURS] */
const SURE_MS = { from: 500, to: 4000 };
/** The kinds of slaves with axes, and the outputs of the others: slave 0 is the board. */
const AXES = ["drive", "step", "hsp"];
const BOARD_OUTPUTS = 6;
const SLAVE_OUTPUTS = 16;
/** The types of objects; without one the server knows it, or asks for it. */
const TYPES = ["known", "u8", "i8", "u16", "i16", "u32", "i32"];

/** @typedef {{press: number, slave: number, is_positive: boolean, part: number}} Press */

export class Control {
  /** @param {HTMLElement} root */
  constructor(root) {
    this.root = root;
    /** @type {((message: object) => boolean) | undefined} */
    this.send = undefined;
    /** @type {Press | null} what is held */
    this.hold = null;
    /** @type {number | "key" | undefined} the pointer that holds it, or a key */
    this.holds = undefined;
    this.presses = 0;
    this.part = FIRST_PART;
    /** @type {import("./types").Holder} */
    this.holder = "none";
    this.built = "";
    /** @type {number | undefined} the timer of a stop that is not confirmed */
    this.stopping = undefined;
    const top = document.createElement("p");
    this.stopButton = button("STOP", () => {});
    this.stopButton.className = "stop";
    // A press counts, also one whose end slides off, and one beside a finger that holds another button.
    this.stopButton.addEventListener("pointerdown", () => this.stop());
    this.stopButton.addEventListener("click", (event) => { if (event.detail === 0) this.stop(); });
    this.takeButton = button("", () => this.tell({ do: this.holder === "you" ? "give" : "take" }));
    this.op = button("Start network (OP)", () => this.tell({ do: "op" }));
    this.speed = document.createElement("select");
    this.speed.append(...PARTS.map((part) => new Option(`${part * 100} %`, String(part))));
    this.speed.value = String(FIRST_PART);
    this.speed.addEventListener("change", () => { this.part = Number(this.speed.value); });
    const label = document.createElement("label");
    label.title = "The whole speed is a tenth of max_velocity in the machine file, else 10,000 counts/s";
    label.append("Speed by hand ", this.speed);
    top.append(this.stopButton, this.takeButton, this.op, label);
    // One line of its own: nothing above a button may change its height while somebody presses it.
    this.words = document.createElement("p");
    this.words.className = "state";
    this.words.setAttribute("role", "status");
    this.hands = document.createElement("div");
    const note = document.createElement("p");
    note.textContent = "STOP stops all axes, whoever moves them, and leaves them on. It is no emergency stop, which works "
      + "without software.";
    this.texts = document.createElement("div");
    this.texts.className = "texts";
    this.texts.tabIndex = 0;
    this.texts.setAttribute("role", "log");
    this.texts.setAttribute("aria-label", "What the server says");
    root.append(top, this.words, this.hands, note, this.texts);
    addEventListener("blur", () => this.release());
    addEventListener("pagehide", () => this.halt());
    document.addEventListener("visibilitychange", () => { if (document.hidden) this.halt(); });
    // At the window: the button may no longer be there.
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      addEventListener(end, (event) => this.let(/** @type {PointerEvent} */ (event).pointerId), true);
    }
    // While another button of the mouse is held, or a menu is open, the first one ends without `pointerup`.
    addEventListener("pointermove", ({ buttons, pointerId }) => { if (!(buttons & 1)) this.let(pointerId); }, true);
    // Any key: with Shift and others the same key has another name when it comes up, or does not come up at all.
    addEventListener("keyup", () => this.let("key"), true);
    addEventListener("keydown", (event) => { if (!event.repeat) this.let("key"); }, true);
    // A key that is held clicks once.
    root.addEventListener("keydown", (event) => { if (event.repeat) event.preventDefault(); });
    this.show({ type: "control", holder: "none", is_wanted: false, busy: null });
  }

  /** @param {object} message */
  tell(message) {
    if (!this.send?.(message)) this.say("NOT SENT: not connected; use the emergency stop if axes move", true);
  }

  /** Stops all axes, whoever moves them. */
  stop() {
    this.release();
    this.tell({ do: "stop" });
    // The time of the first press counts, however often somebody presses.
    this.stopping ??= setTimeout(() => {
      this.stopping = undefined;
      this.say("STOP IS NOT CONFIRMED: use the emergency stop if axes move", true);
    }, CONFIRMED_MS);
  }

  /** @param {import("./types").Said} said */
  said({ text, is_error, is_stop }) {
    if (is_stop) {
      clearTimeout(this.stopping);
      this.stopping = undefined;
    }
    this.say(text, is_error);
  }

  /** @param {number} n the number of the server's question */
  answer(n) {
    this.send?.({ do: "alive", n, hold: document.hidden ? null : this.hold });
  }

  /**
   * Lets go what this pointer or key holds.
   * @param {number | "key"} holds
   */
  let(holds) {
    if (this.holds === holds) this.release();
  }

  release() {
    if (this.hold) this.send?.({ do: "release" });
    [this.hold, this.holds] = [null, undefined];
  }

  /** Ends what this page has begun. */
  halt() {
    this.release();
    if (this.holder === "you") this.send?.({ do: "halt" });
  }

  /** Stops all axes if this page has control; returns whether it has. */
  stopOwn() {
    const isOwn = this.holder === "you";
    if (isOwn) this.stop();
    return isOwn;
  }

  /** The connection is lost. */
  lost() {
    this.send = undefined;
    this.show({ type: "control", holder: "none", is_wanted: false, busy: null });
  }

  /** @param {import("./types").ControlState} state */
  show(state) {
    this.state = state;
    this.holder = state.holder;
    const isMine = this.holder === "you";
    if (!isMine) {
      this.release();
      for (const reading of this.root.querySelectorAll("[data-reading]")) reading.textContent = "";
    }
    this.takeButton.textContent = isMine ? "Give control up" : "Take control";
    for (const other of this.root.querySelectorAll(".mine")) {
      if (other instanceof HTMLButtonElement) other.disabled = !isMine;
    }
    this.op.disabled = !isMine;
    const words = {
      none: "No page has control.",
      other: state.is_wanted ? "Another page has control, and is asked for it." : "Another page has control.",
      opening: "The board is being opened.",
      you: state.is_wanted ? "Another page asks for control." : "This page has control.",
    };
    const text = words[state.holder] + (state.busy ? ` ${state.busy}` : "");
    if (this.words.textContent !== text) this.words.textContent = text;
  }

  /**
   * Shows the newest position of each axis, and its alarm, beside its buttons.
   * @param {{cells: string[]}[]} rows those of the table of slaves
   */
  readings(rows) {
    for (const { cells: [slave, , , alarm, position] } of rows) {
      const reading = this.root.querySelector(`[data-reading="${slave}"]`);
      const text = [position, alarm].filter(Boolean).join(", ");
      if (reading && reading.textContent !== text) reading.textContent = text;
    }
  }

  /**
   * @param {string} text
   * @param {boolean} isError
   */
  say(text, isError) {
    const line = document.createElement("div");
    const at = document.createElement("time");
    at.textContent = new Date().toLocaleTimeString([], { hour12: false });
    line.append(at, ` ${text}`);
    line.className = isError ? "alarm" : "";
    this.texts.prepend(line);
    while (this.texts.children.length > TEXTS_MAX) this.texts.lastChild?.remove();
  }

  /**
   * Shows buttons for these slaves.
   * @param {import("./types").SlaveInfo[]} slaves
   * @param {import("./types").Channel[]} channels
   */
  list(slaves, channels) {
    const names = channels.filter(({ quantity, name }) => quantity === "output" && name);
    for (const { slave, bit, name } of names) {
      const word = this.root.querySelector(`[data-output="${slave}.${bit}"]`);
      if (word) word.textContent = ` ${name}`;
    }
    const built = JSON.stringify(slaves.map(({ number, kind, name }) => [number, kind, name]));
    if (built === this.built) return;
    this.built = built;
    this.release();
    const axes = slaves.filter(({ kind }) => AXES.includes(kind));
    const table = document.createElement("table");
    for (const { number } of axes) this.axis(table, number, slaveName(slaves, number));
    const ios = slaves.filter(({ kind }) => kind === "io").map(({ number }) => number);
    const outputs = [...ios, 0].map((slave) => {
      const title = slave === 0 ? "board" : slaveName(slaves, slave);
      const named = new Map(names.filter((channel) => channel.slave === slave).map(({ bit, name }) => [bit, name]));
      return this.outputs(slave, title, named);
    });
    const objects = slaves.length > 0 ? [this.objects(slaves)] : [];
    this.hands.replaceChildren(table, ...outputs, ...objects);
    if (this.state) this.show(this.state);
  }

  /**
   * @param {HTMLTableElement} table
   * @param {number} slave
   * @param {string} name
   */
  axis(table, slave, name) {
    const row = table.insertRow();
    const head = document.createElement("th");
    head.scope = "row";
    const reading = document.createElement("small");
    reading.dataset.reading = String(slave);
    head.append(name, reading);
    row.append(head);
    const cell = row.insertCell();
    for (const is_positive of [false, true]) {
      const hold = button(is_positive ? "+" : "\u2212", () => {});
      hold.setAttribute("aria-label", `Hold: ${name} ${is_positive ? "plus" : "minus"}`);
      hold.className = "mine hold";
      this.isHeld(hold, slave, is_positive);
      cell.append(hold, " ");
    }
    for (const [words, what] of [["On", "on"], ["Off", "off"], ["Clear alarm", "clear"]]) {
      const once = button(words, () => this.tell({ do: what, slave }));
      once.className = "mine";
      once.setAttribute("aria-label", `${words}: ${name}`);
      cell.append(once, " ");
    }
    cell.append(this.sure("Home", () => name, false, () => this.tell({ do: "home", slave })).made);
  }

  /**
   * A button that acts at its second click: homing moves without a hand, or gives positions another meaning, and so may an
   * object that is written.
   * @param {string} words
   * @param {() => string} of what it acts on
   * @param {boolean} names whether the question says that
   * @param {() => void} act
   * @returns {{made: HTMLButtonElement, calm: () => void}} the button, and what takes its question back
   */
  sure(words, of, names, act) {
    /** @type {number | undefined} */
    let asked;
    let since = 0;
    const made = button(words, () => {
      if (asked !== undefined) {
        if (performance.now() - since < SURE_MS.from) return;
        calm();
        act();
        return;
      }
      since = performance.now();
      asked = setTimeout(calm, SURE_MS.to);
      made.textContent = names ? `${words} ${of()} now?` : `${words} now?`;
      made.setAttribute("aria-label", `${words} now, a second click: ${of()}`);
    });
    const calm = () => {
      clearTimeout(asked);
      asked = undefined;
      made.textContent = words;
      made.setAttribute("aria-label", `${words}: ${of()}`);
    };
    calm();
    made.className = "mine";
    return { made, calm };
  }

  /**
   * @param {HTMLButtonElement} hold
   * @param {number} slave
   * @param {boolean} is_positive
   */
  isHeld(hold, slave, is_positive) {
    const press = (/** @type {number | "key"} */ by) => {
      this.release();
      this.presses += 1;
      this.holds = by;
      this.hold = { press: this.presses, slave, is_positive, part: this.part };
    };
    hold.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || this.holder !== "you") return;
      try {
        hold.setPointerCapture(event.pointerId);
      } catch {
        // The pointer has gone already: its axis does not begin to move.
        return;
      }
      press(event.pointerId);
    });
    hold.addEventListener("keydown", (event) => {
      if (event.key !== " " && event.key !== "Enter") return;
      event.preventDefault();
      event.stopPropagation();
      const isPlain = !event.repeat && !event.shiftKey && !event.ctrlKey && !event.altKey && !event.metaKey;
      if (isPlain && this.holder === "you") press("key");
    });
    hold.addEventListener("blur", () => {
      // Pressing another button takes the focus from this one, whose key then comes up elsewhere.
      this.let("key");
    });
    hold.addEventListener("contextmenu", (event) => event.preventDefault());
  }

  /**
   * @param {number} slave
   * @param {string} title
   * @param {Map<number, string | undefined>} named
   */
  outputs(slave, title, named) {
    const all = document.createElement("details");
    const summary = document.createElement("summary");
    summary.textContent = `Outputs of ${title}`;
    const count = slave === 0 ? BOARD_OUTPUTS : SLAVE_OUTPUTS;
    const boxes = Array.from({ length: count }, (_, bit) => {
      const box = document.createElement("input");
      box.type = "checkbox";
      const word = document.createElement("span");
      word.dataset.output = `${slave}.${bit}`;
      word.textContent = ` ${named.get(bit) ?? bit}`;
      const label = document.createElement("label");
      label.append(box, word);
      return { box, label };
    });
    const set = button("Write these", () => {
      const bits = boxes.reduce((sum, { box }, bit) => sum + (box.checked ? 1 << bit : 0), 0);
      this.tell({ do: "outputs", slave, bits });
    });
    set.className = "mine";
    set.setAttribute("aria-label", `Write these: all outputs of ${title}`);
    set.title = "All outputs become as they are ticked here. The board does not report those that a program has set";
    all.append(summary, ...boxes.map(({ label }) => label), " ", set);
    return all;
  }

  /**
   * Reads and writes objects of slaves (SDO).
   * @param {import("./types").SlaveInfo[]} slaves
   */
  objects(slaves) {
    const all = document.createElement("details");
    const summary = document.createElement("summary");
    summary.textContent = "Objects (SDO)";
    const slave = document.createElement("select");
    slave.append(...slaves.map(({ number }) => new Option(slaveName(slaves, number), String(number))));
    const [object, value] = ["0x6041 or a name", "1000 or 0x3E8"].map((hint) => {
      const field = document.createElement("input");
      [field.type, field.size, field.placeholder, field.spellcheck, field.maxLength] = ["text", 16, hint, false, 60];
      return field;
    });
    const type = document.createElement("select");
    type.append(...TYPES.map((word) => new Option(word, word)));
    const what = () => ({
      slave: Number(slave.value),
      object: object.value.trim(),
      type: type.value === TYPES[0] ? null : type.value,
    });
    const read = button("Read", () => this.tell({ do: "read", ...what() }));
    read.className = "mine";
    read.setAttribute("aria-label", "Read the object");
    const said = () => `${object.value.trim()} = ${value.value.trim()} to ${slave.selectedOptions[0]?.text ?? ""}`;
    const order = () => this.tell({ do: "write", ...what(), value: value.value.trim() });
    const { made: write, calm } = this.sure("Write", said, true, order);
    // The question is of what it names: whoever changes that is asked anew.
    for (const field of [slave, object, type, value]) field.addEventListener("input", calm);
    // As in a form, but nothing is written by a key that is pressed in passing.
    object.addEventListener("keydown", ({ key, repeat }) => { if (key === "Enter" && !repeat) read.click(); });
    const fields = [labelled("of", slave), labelled("object", object), labelled("type", type), read];
    all.append(summary, ...fields.flatMap((field) => [field, " "]), labelled("value", value), " ", write);
    return all;
  }
}

/**
 * @param {string} words
 * @param {HTMLElement} field
 */
function labelled(words, field) {
  const label = document.createElement("label");
  label.append(`${words} `, field);
  return label;
}

/**
 * @param {string} words
 * @param {(event: MouseEvent) => void} act
 */
function button(words, act) {
  const made = document.createElement("button");
  made.textContent = words;
  made.addEventListener("click", act);
  return made;
}
