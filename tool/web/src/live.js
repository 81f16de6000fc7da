// The connection to `ecmsk serve web`.

/** How long after a lost connection the next is tried. */
const AGAIN_MS = 1000;

/**
 * Connects, and again whenever the connection ends.
 * @param {URL} page the address of this page, which has the token
 * @param {{message: (message: import("./types").Message) => void, block: (bytes: Uint8Array) => void, state: (words: string) => void}} to
 */
export function connect(page, to) {
  const address = new URL("live" + page.search, page);
  address.protocol = "ws:";
  const socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("open", () => to.state(""));
  socket.addEventListener("message", ({ data }) => {
    if (typeof data === "string") to.message(JSON.parse(data));
    else to.block(new Uint8Array(data));
  });
  socket.addEventListener("close", ({ reason }) => {
    to.state(reason || "not connected: what is shown is old");
    setTimeout(() => connect(page, to), AGAIN_MS);
  });
}
