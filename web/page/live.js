
// Live from a vehicle: a serial port is read here, a worker estimates, and the pilot's page shows it in a frame. Nothing is ever written to the port.
const BAUD = [57600, 115200, 230400, 460800, 921600, 1500000, 38400, 9600];
const LOOK_MS = 200;
/** A port that cannot be opened is tried again after so long. */
const RETRY_MS = 2000;
/** Bytes that the worker may have before it: more wait in the port, which holds as many again. */
const AHEAD = 1 << 20;
/** After so many pieces in a row the rest of the page has its turn. */
const IN_A_ROW = 200;
/** The worker is late by so much before that is said, s. */
const LATE_S = 3;
const LISTENS = "Listening. Nothing is sent to the vehicle.";
const nowUs = () => (performance.timeOrigin + performance.now()) * 1000;
let live = null;
let unsaved = false;

function say(words, bad = false) {
  if (at("live-say").textContent !== words) at("live-say").textContent = words;
  at("live").classList.toggle("bad", bad);
}

function portWords(port) {
  const { usbVendorId: vendor, usbProductId: product } = port.getInfo();
  const hex = (id) => (id ?? 0).toString(16).padStart(4, "0");
  return vendor === undefined ? "serial port" : `USB ${hex(vendor)}-${hex(product)}`;
}

/** A session of one port until it is stopped. */
class Live {
  over = false;
  #posted = 0;
  #taken = 0;
  #asked = null;
  #failed = false;
  #go = () => {};
  #reader = null;
  #timer = 0;
  #began = performance.now();

  constructor(port, baud, settings) {
    this.port = port;
    this.baud = baud;
    const session = { port: portWords(port), today: today(), ...settings };
    this.worker = employ({ session, files: others().map(({ name, role, file }) => ({ name, role, file })) }, (data) => this.#heard(data));
  }

  /** Reads with another baud rate from now on. */
  change(baud) {
    this.baud = baud;
    this.wake();
  }

  stop() {
    this.over = true;
    this.wake();
  }

  /** Ends what is waited for. */
  wake() {
    this.#go();
    this.#reader?.cancel().catch(() => {});
  }

  #heard({ listens, refused, failed, taken, view, ended }) {
    if (listens) this.#begin();
    if (refused || (failed && (ended || !this.#timer))) return this.#close(refused ?? failed);
    if (failed) {
      this.#failed = true;
      say(`${failed} The recording goes on: stop to save it.`, true);
    }
    if (taken !== undefined) {
      this.#taken = taken;
      if (this.#posted - taken < AHEAD) this.#go();
    }
    if (view) {
      at("pilot").contentWindow.postMessage(view, "*");
      this.#late((nowUs() - this.#asked) * 1e-6);
      this.#asked = null;
    }
    if (ended) this.#save(ended);
  }

  /** The session has the whole window, or none of it. */
  #show(shown) {
    at("live").hidden = !shown;
    document.body.classList.toggle("live", shown);
    for (const element of document.body.children) element.inert = shown && element !== at("live");
  }

  #begin() {
    this.#show(true);
    say("Opening the port…");
    pilotPage().then((page) => { at("pilot").srcdoc = page; });
    this.#timer = setInterval(() => {
      if (this.#asked !== null) return;
      this.#asked = nowUs();
      this.worker.post({ look: this.#asked });
    }, LOOK_MS);
    navigator.wakeLock?.request("screen").catch(() => {});
    this.#read().then(() => this.worker.post({ end: true }));
  }

  #late(late_s) {
    if (this.#failed) return;
    if (late_s > LATE_S) say(`This computer is ${Math.round(late_s)} s behind the vehicle: close other programs.`, true);
    else if (/behind the vehicle/.test(at("live-say").textContent)) say(LISTENS);
  }

  async #read() {
    while (!this.over) {
      const baud = this.baud;
      try {
        await this.port.open({ baudRate: baud, bufferSize: AHEAD });
      } catch (error) {
        this.#gone(`The port cannot be opened (${error.message}). Is it plugged in, and does no other program use it, such as a ground station? It is tried again.`);
        await this.#pause();
        continue;
      }
      this.worker.post({ opened: baud });
      say(LISTENS);
      // Noise on the line ends a stream, and the port gives another one; a port that is gone gives none.
      while (this.port.readable && !this.over && this.baud === baud) await this.#stream();
      const lost = !this.port.readable;
      await this.port.close().catch(() => {});
      if (lost && !this.over) {
        this.#gone("The port is gone: plug it in again and the page goes on, or stop to save what was recorded.");
        await this.#pause();
      }
    }
  }

  async #stream() {
    this.#reader = this.port.readable.getReader();
    try {
      for (let row = 1; ; row += 1) {
        const { value, done } = await this.#reader.read();
        if (done) return;
        this.#posted += value.byteLength;
        const t_us = nowUs();
        const chunk = value.buffer.byteLength === value.byteLength ? value.buffer : value.slice().buffer;
        this.worker.post({ chunk, t_us }, [chunk]);
        if (this.#posted - this.#taken >= AHEAD) await new Promise((go) => { this.#go = go; });
        else if (row % IN_A_ROW === 0) await new Promise((go) => { setTimeout(go); });
      }
    } catch {
      // The port says by its next stream whether it goes on.
    } finally {
      this.#reader.releaseLock();
      this.#reader = null;
    }
  }

  #gone(words) {
    this.worker.post({ closed: words });
    say(words, true);
  }

  #pause() {
    return new Promise((go) => {
      this.#go = go;
      setTimeout(go, RETRY_MS);
    });
  }

  #save({ document: text, recording }) {
    const name = `live-${new Date().toISOString().slice(0, 19).replace(/[:T]/g, "-")}`;
    this.#close(recording.size > 0 ? "" : "Nothing was recorded: no MAVLink came over the port.");
    if (recording.size === 0) return;
    const file = new File([recording], `${name}.tlog`);
    const files = [{ name: file.name, text: file }];
    if (text) files.push({ name: `${name}.json`, text: JSON.stringify(JSON.parse(text), null, 2) });
    result("Live session", { done: { words: [`${size(file.size)} were recorded, in this page alone until you save them. The recording is also among the logs above: report and explain evaluate it.`], files }, seconds: (performance.now() - this.#began) / 1000, memory: "" });
    take([{ file, name: file.name }]);
    unsaved = true;
  }

  #close(words) {
    this.stop();
    clearInterval(this.#timer);
    this.worker.end();
    live = null;
    this.#show(false);
    at("pilot").srcdoc = "";
    if (words) trouble(`Live: ${words}`);
  }
}

/** The pilot's page, as the program serves it. */
async function pilotPage() {
  const bytes = Uint8Array.from(atob(at("pilot-page").textContent.replace(/\s/g, "")), (c) => c.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
}

async function connect() {
  if (live) return;
  trouble("");
  const value = (id) => at(id).value;
  try {
    const port = await navigator.serial.requestPort();
    at("live-baud").value = value("baud");
    at("live-port").textContent = portWords(port);
    live = new Live(port, Number(value("baud")), { airframe: value("airframe"), place: value("place"), vehicle: value("vehicle") });
  } catch (error) {
    // No port was chosen.
    if (error.name !== "NotFoundError") trouble(`Live: ${error.message}`);
  }
}

for (const id of ["baud", "live-baud"]) at(id).append(...BAUD.map((rate) => make("option", rate, { value: rate })));
if (navigator.serial) {
  at("connect").onclick = connect;
  at("live-stop").onclick = () => live?.stop();
  at("live-baud").onchange = () => live?.change(Number(at("live-baud").value));
  navigator.serial.addEventListener("connect", ({ target }) => {
    if (!live || live.port.readable || portWords(target) !== portWords(live.port)) return;
    live.port = target;
    live.wake();
  });
  document.addEventListener("click", ({ target }) => { if (target.download?.endsWith(".tlog")) unsaved = false; });
  addEventListener("beforeunload", (event) => { if (live || unsaved) event.preventDefault(); });
} else {
  at("live-fields").hidden = true;
  at("no-serial").hidden = false;
  const where = isSecureContext ? "" : " A page that comes over http from another computer has none at all: save it and open it from the disk.";
  at("no-serial").textContent = `This browser gives pages no serial ports (WebSerial): use Chrome or Edge on a computer.${where}`;
}
