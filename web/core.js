// What every user of the module does: hand over the contents of files and the description of a job, and take the answer. For the page's worker and the package.
"use strict";
const SLICE = 8 << 20;
/** The most that the module may take (build.rs says it to the linker): what ended it without a word beyond half of it was memory. */
const MEMORY = 1 << 30;

/** An instance of the module with its memory: what is written there and read. */
async function instance(compiled, progress) {
  const decoder = new TextDecoder();
  let last = null;
  let bytes = 0;
  const page = {
    progress: (at, length, done, total) => progress({ progress: text(at, length), done, total }),
    panicked: (at, length) => { last = text(at, length); },
    now_ms: () => performance.now(),
  };
  const { exports } = await WebAssembly.instantiate(compiled, { page });
  const text = (at, length) => decoder.decode(new Uint8Array(exports.memory.buffer, at, length));
  const put = (part) => {
    const at = exports.reserve(part.length);
    new Uint8Array(exports.memory.buffer, at, part.length).set(part);
  };
  const putFile = async (blob) => {
    const at = exports.reserve(blob.size);
    for (let from = 0; from < blob.size; from += SLICE) {
      const part = new Uint8Array(await blob.slice(from, from + SLICE).arrayBuffer());
      new Uint8Array(exports.memory.buffer, at + from, part.length).set(part);
    }
    exports.file();
  };
  return {
    exports, text, put,
    /** Hands over the files and the description of what is to be done with them; the answer's text. */
    async given(description, files, command) {
      bytes = files.reduce((sum, { file }) => sum + file.size, 0);
      for (const { name, file } of files) {
        progress({ progress: `reading ${name}`, done: 0, total: 0 });
        await putFile(file).catch((error) => { throw error instanceof DOMException ? new Unreadable(name) : error; });
      }
      put(new TextEncoder().encode(JSON.stringify({ ...description, files: files.map(({ name, role }) => ({ name, role })) })));
      const length = exports[command]();
      return text(exports.answer(), length);
    },
    /** Why the module has ended, as a sentence. */
    fault(error) {
      if (error instanceof Unreadable) return `${error.message} cannot be read: it was changed, moved or is a folder. Choose it again.`;
      const full = last === null && exports.memory.buffer.byteLength + bytes > MEMORY / 2;
      return full ? "The analysis needs more memory than a page may have (1 GiB): take shorter or fewer logs, or the program itself, which has no such limit." : `The analysis ended by a fault of its own, please report it: ${last ?? error}`;
    },
  };
}

class Unreadable extends Error {}

/**
 * Does one job in an instance of its own, whose memory ends with it. `files`: name, role and content (a Blob) of each. The answer is
 * `{ done: { words, files }, memory }`, or `{ failed }` with the reason as a sentence.
 */
async function analyse(compiled, { command, today, files }, progress) {
  let module = null;
  try {
    module = await instance(compiled, progress);
    const answer = JSON.parse(await module.given({ command, today }, files, "run"));
    return { ...answer, memory: module.exports.memory.buffer.byteLength };
  } catch (error) {
    return { failed: module?.fault(error) ?? `The analysis could not be started: ${error}` };
  }
}
