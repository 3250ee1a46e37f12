/** A file: its name, whose ending says what it is (.bin, .ulg, .tlog, .mcap; .toml, .param), and its content. */
export interface Given {
  name: string;
  content: Blob | Uint8Array | ArrayBuffer;
}

/** A file of a result, as the program writes it. */
export interface Made {
  name: string;
  text: string;
}

/** The answer in words, and the files. */
export interface Done {
  words: string[];
  files: Made[];
}

export interface Options {
  /** A model, effects of a user, or what is known of a unit (.toml). */
  models?: Given | Given[];
  /** The vehicle's parameters, for what the log does not hold. */
  parameters?: Given;
  /** The day as "2026-11-25", for the age of what is known of a unit; without it the clock's. */
  today?: string;
  /** What is done at the moment, and how much of it, where that is known (total > 0). */
  progress?: (step: { progress: string; done: number; total: number }) => void;
}

/** Every job throws an Error with the reason as a sentence where there is no result. It runs on the calling thread: use a worker in a page. */
export class Analysis {
  /** The document `gaware.summary/1` of docs/summary.schema.json, with compasses, barometers and airspeed. */
  replay(log: Given, options?: Options): Promise<Record<string, unknown>>;
  report(log: Given, options?: Options): Promise<Done>;
  explain(logs: Given | Given[], options?: Options & { validate?: Given | Given[] }): Promise<Done>;
  compare(before: Given, after: Given, options?: Options): Promise<Done>;
}

/** Compiles the module: in Node from beside this file, in a browser from the bytes of gaware_web.wasm or a response with them. */
export function load(source?: ArrayBuffer | Uint8Array | Response): Promise<Analysis>;
