// The connection to `ecmsk serve web`.

/** How long after a lost connection the next is tried. */
const AGAIN_MS = 1000;

/**
 * Connects, and again whenever the connection ends.
 * @param {URL} page the address of this page, which has the token
 * @param {{message: (message: import("./types").Message) => void, block: (bytes: Uint8Array) => void, state: (words: string) => void, sender: (send?: (message: object) => boolean) => void}} to
 */
export function connect(page, to) {
  const address = new URL("live" + page.search, page);
  address.protocol = page.protocol === "https:" ? "wss:" : "ws:";
  let isOpened = false;
  const socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.addEventListener("open", () => {
    isOpened = true;
    to.state("");
    to.sender((message) => {
      const isOpen = socket.readyState === WebSocket.OPEN;
      if (isOpen) socket.send(JSON.stringify(message));
      return isOpen;
    });
  });
  socket.addEventListener("message", ({ data }) => {
    if (typeof data === "string") to.message(JSON.parse(data));
    else to.block(new Uint8Array(data));
  });
  socket.addEventListener("close", ({ reason }) => {
    // Some browsers go on to a page whose certificate they do not know, and still refuse its WebSocket, as those of iOS do.
    const hint = address.protocol === "wss:" && !isOpened
      ? "; if this stays so, let the system trust the certificate of the server" : "";
    to.state(reason || `not connected: what is shown is old${hint}`);
    to.sender(undefined);
    setTimeout(() => connect(page, to), AGAIN_MS);
  });
}
