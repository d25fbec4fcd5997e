// The WebSocket to the run: opened again after a loss. The page requests the next state when one has come.

const FIRST_RETRY_MS = 250;
const LAST_RETRY_MS = 2000;
const WRONG_TOKEN = 4401;

export class Stream {
  // handlers: scene, state, picture (a Blob, of the state before it), answer, lost (why, or null), opened
  constructor(handlers) {
    this.handlers = handlers;
    this.retryMs = FIRST_RETRY_MS;
    this.open();
  }

  open() {
    // The fragment of an address never leaves the browser by itself
    const token = new URLSearchParams(location.hash.slice(1)).get("token");
    const offered = token ? ["softaim.v1", `token.${token}`] : ["softaim.v1"];
    let socket;
    try {
      socket = new WebSocket(`ws://${location.host}/stream?pictures=1&pace=1`, offered);
    } catch {
      this.handlers.lost("the token in the address is malformed");
      return;
    }
    this.socket = socket;
    socket.onmessage = (event) => this.take(event.data);
    socket.onclose = (event) => {
      if (event.code === WRONG_TOKEN) {
        this.handlers.lost("open the address that the command printed: the token is missing here, or belongs to another run");
        return;
      }
      this.handlers.lost(null);
      setTimeout(() => this.open(), this.retryMs);
      this.retryMs = Math.min(2 * this.retryMs, LAST_RETRY_MS);
    };
  }

  take(data) {
    if (typeof data !== "string") {
      this.handlers.picture(data);
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "scene") this.retryMs = FIRST_RETRY_MS;
    if (message.type === "state") this.socket.send("next");
    this.handlers[message.type]?.(message);
  }

  command(command) {
    if (this.socket.readyState !== WebSocket.OPEN) return false;
    this.socket.send(JSON.stringify(command));
    return true;
  }
}
