// The conversation with the server: at most one picture is asked for at a time, and a lost connection comes back.

/** Pauses before the next attempts to connect, milliseconds; the last one is repeated. */
const PAUSES = [300, 700, 1500, 3000];
/** The code of a server that has no place for this page now. */
const AGAIN = 1013;

/**
 * @typedef {object} Handlers
 * @property {() => void} opened
 * @property {(reason: string) => void} closed
 * @property {(facts: any, jpeg: Blob) => void} frame
 * @property {(status: any) => void} status
 * @property {(reason: string) => void} refused
 */

export class Link {
  /** @param {Handlers} handlers */
  constructor(handlers) {
    this.handlers = handlers;
    /** @type {WebSocket | undefined} */
    this.socket = undefined;
    this.attempts = 0;
    this.next = 0;
    /** The request that is not answered yet, and when it was sent. @type {{ id: number, sent: number } | undefined} */
    this.waiting = undefined;
  }

  get isOpen() {
    return this.socket?.readyState === WebSocket.OPEN;
  }

  /** Whether a picture can be asked for. */
  get isFree() {
    return this.isOpen && !this.waiting;
  }

  connect() {
    const address = new URL('socket', location.href);
    address.protocol = address.protocol.replace('http', 'ws');
    address.hash = '';
    const socket = new WebSocket(address);
    socket.binaryType = 'arraybuffer';
    socket.addEventListener('open', () => this.handlers.opened());
    socket.addEventListener('message', (event) => {
      // Not when it opens: a server without a place for this page opens it too, to say so.
      this.attempts = 0;
      this.#receive(event.data);
    });
    socket.addEventListener('close', (event) => {
      this.waiting = undefined;
      this.handlers.closed(event.code === AGAIN ? event.reason : '');
      const pause = PAUSES[Math.min(this.attempts, PAUSES.length - 1)];
      this.attempts += 1;
      setTimeout(() => this.connect(), pause);
    });
    this.socket = socket;
  }

  /** Asks for a picture. @param {object} request */
  ask(request) {
    this.next += 1;
    this.waiting = { id: this.next, sent: performance.now() };
    this.#send({ type: 'frame', id: this.next, ...request });
  }

  /** Sends a command: `pause`, `go_on` or `checkpoint`. @param {string} type */
  command(type) {
    if (this.isOpen) this.#send({ type });
  }

  /** @param {object} message */
  #send(message) {
    this.socket?.send(JSON.stringify(message));
  }

  /** @param {string | ArrayBuffer} data */
  #receive(data) {
    if (typeof data === 'string') {
      const message = JSON.parse(data);
      if (message.type === 'status') this.handlers.status(message);
      if (message.type === 'refused') {
        // A request that could not be read has no number, and is the one that waits.
        this.#answered(message.id ?? this.waiting?.id);
        this.handlers.refused(message.reason);
      }
      return;
    }
    const length = new DataView(data).getUint32(0, true);
    const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    facts.roundTrip = this.#answered(facts.id);
    this.handlers.frame(facts, new Blob([new Uint8Array(data, 4 + length)], { type: 'image/jpeg' }));
  }

  /** Milliseconds that an answer took. @param {number | undefined} id */
  #answered(id) {
    if (!this.waiting || id !== this.waiting.id) return undefined;
    const took = performance.now() - this.waiting.sent;
    this.waiting = undefined;
    return took;
  }
}
