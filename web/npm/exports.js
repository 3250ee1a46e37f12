
/**
 * The module, compiled. In a browser `source` is the bytes of gaware_web.wasm or a response with them; in Node it may be left out.
 */
export async function load(source) {
  if (source === undefined) {
    const { readFile } = await import("node:fs/promises");
    source = await readFile(new URL("gaware_web.wasm", import.meta.url));
  }
  const bytes = source instanceof Response ? await source.arrayBuffer() : source;
  return new Analysis(await WebAssembly.compile(bytes));
}

export class Analysis {
  #compiled;
  constructor(compiled) { this.#compiled = compiled; }

  /** What a log makes known: the document of "gaware replay --json", with compasses, barometers and airspeed. */
  async replay(log, options = {}) {
    const { files } = await this.report(log, options);
    return JSON.parse(files.find(({ name }) => name.endsWith(".json")).text);
  }

  /** The report of a log, as the files that "gaware report" and "gaware replay --json" make. */
  report(log, options) { return this.#job("report", [given(log, "log")], options); }

  /** Which sensor error the model lacks: a sentence or more, and the files of "gaware explain". `validate`: logs that only judge. */
  explain(logs, options = {}) {
    const files = [...all(logs, "log"), ...all(options.validate ?? [], "validate")];
    return this.#job("explain", files, options);
  }

  /** The autopilot's own innovations of two flights, before a change and after it. */
  compare(before, after, options) { return this.#job("compare", [given(before, "log"), given(after, "log")], options); }

  async #job(command, files, { models = [], parameters, today = new Date().toISOString().slice(0, 10), progress = () => {} } = {}) {
    files.push(...all(models, "model"), ...all(parameters ?? [], "parameters"));
    const { done, failed } = await analyse(this.#compiled, { command, today, files }, progress);
    if (failed) throw new Error(failed);
    return done;
  }
}

const given = ({ name, content }, role) => ({ name, role, file: content instanceof Blob ? content : new Blob([content]) });
const all = (some, role) => (Array.isArray(some) ? some : [some]).map((one) => given(one, role));
