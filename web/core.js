// What every user of the module does: hand over the contents of files and the description of a job, and take the answer. For the page's worker and the package.
"use strict";
const SLICE = 8 << 20;
/** The most that the module may take (build.rs says it to the linker): what ended it without a word beyond half of it was memory. */
const MEMORY = 1 << 30;

/**
 * Does one job in an instance of its own, whose memory ends with it. `files`: name, role and content (a Blob) of each. The answer is
 * `{ done: { words, files }, memory }`, or `{ failed }` with the reason as a sentence.
 */
async function analyse(compiled, { command, today, files }, progress) {
  const decoder = new TextDecoder();
  let last = null;
  let module = null;
  const text = (at, length) => decoder.decode(new Uint8Array(module.memory.buffer, at, length));
  const page = {
    progress: (at, length, done, total) => progress({ progress: text(at, length), done, total }),
    panicked: (at, length) => { last = text(at, length); },
    now_ms: () => performance.now(),
  };
  const put = async (blob) => {
    const at = module.reserve(blob.size);
    for (let from = 0; from < blob.size; from += SLICE) {
      const part = new Uint8Array(await blob.slice(from, from + SLICE).arrayBuffer());
      new Uint8Array(module.memory.buffer, at + from, part.length).set(part);
    }
  };
  try {
    module = (await WebAssembly.instantiate(compiled, { page })).exports;
    for (const { name, file } of files) {
      progress({ progress: `reading ${name}`, done: 0, total: 0 });
      try {
        await put(file);
      } catch (error) {
        if (!(error instanceof DOMException)) throw error;
        return { failed: `${name} cannot be read: it was changed, moved or is a folder. Choose it again.` };
      }
      module.file();
    }
    await put(new Blob([JSON.stringify({ command, today, files: files.map(({ name, role }) => ({ name, role })) })]));
    const length = module.run();
    const answer = JSON.parse(text(module.answer(), length));
    return { ...answer, memory: module.memory.buffer.byteLength };
  } catch (error) {
    const full = module !== null && last === null && module.memory.buffer.byteLength + files.reduce((sum, { file }) => sum + file.size, 0) > MEMORY / 2;
    return { failed: full ? "The analysis needs more memory than a page may have (1 GiB): take shorter or fewer logs, or the program itself, which has no such limit." : `The analysis ended by a fault of its own, please report it: ${last ?? error}` };
  }
}
