// The event stream with its own watchdog: a page in flight must know when what it shows is old.

const SILENT_MS = 3000; // The server says something every second.
const GIVE_UP_MS = 8000; // A dead radio link does not close the connection: open another one.
const RETRY_MS = [500, 1000, 2000, 3000];

/** One answer of the server. The page in the browser (web/page/stream.js) has another stream and other answers. */
export const ask = (path, options) => fetch(path, options);

export class Stream {
  #source = null;
  #last = 0;
  #tries = 0;
  #state = "connecting";
  #ended = false;
  #timer = 0;

  /** Handlers: onSnapshot(object), onSinks(object), onState("connecting" | "live" | "lost" | "ended", secondsSilent). */
  constructor(handlers) {
    this.handlers = handlers;
  }

  start() {
    this.#last = performance.now();
    this.#open();
    setInterval(() => this.#watch(), 500);
  }

  #open() {
    clearTimeout(this.#timer);
    this.#source?.close();
    const source = new EventSource("/api/v1/events");
    this.#source = source;
    const heard = (handler) => (event) => {
      this.#last = performance.now();
      this.#tries = 0;
      this.#ended = false;
      this.#say("live");
      handler(JSON.parse(event.data));
    };
    source.addEventListener("snapshot", heard(this.handlers.onSnapshot));
    source.addEventListener("sinks", heard(this.handlers.onSinks));
    // An orderly end; another program may be started.
    source.addEventListener("end", () => (this.#ended = true));
    source.onerror = () => {
      // The browser's own retry is slow and gives up on an HTTP error; ours does neither.
      source.close();
      this.#gone();
      this.#retry();
    };
  }

  #retry() {
    clearTimeout(this.#timer);
    const delay = RETRY_MS[Math.min(this.#tries, RETRY_MS.length - 1)];
    this.#tries += 1;
    this.#timer = setTimeout(() => this.#open(), delay);
  }

  #watch() {
    const silent = performance.now() - this.#last;
    if (silent > SILENT_MS) this.#gone();
    if (silent > GIVE_UP_MS && this.#tries === 0) this.#retry();
  }

  #gone() {
    this.#say(this.#ended ? "ended" : "lost");
  }

  #say(state) {
    const changed = state !== this.#state;
    this.#state = state;
    if (changed || state === "lost") {
      this.handlers.onState(state, (performance.now() - this.#last) / 1000, changed);
    }
  }
}
