// A worker for one job: it unpacks the module, hands over the files and gives back the answer. Its end frees all memory.
"use strict";
const SLICE = 8 << 20;
/** The most that the module may take (build.rs says it to the linker): what ended it without a word beyond half of it was memory. */
const MEMORY = 1 << 30;
const words = new TextDecoder();

async function load(packed, imports) {
  const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
  const unpacked = new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
  return (await WebAssembly.instantiate(await unpacked.arrayBuffer(), imports)).instance.exports;
}

onmessage = async ({ data: { packed, command, today, files } }) => {
  let last = null;
  let module = null;
  const text = (at, length) => words.decode(new Uint8Array(module.memory.buffer, at, length));
  const page = {
    progress: (at, length, done, total) => postMessage({ progress: text(at, length), done, total }),
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
    module = await load(packed, { page });
  } catch (error) {
    postMessage({ failed: `This browser cannot run the analysis (${error.message}): use a present version of Chrome, Edge, Firefox or Safari.` });
    return;
  }
  try {
    for (const { name, file } of files) {
      postMessage({ progress: `reading ${name}`, done: 0, total: 0 });
      try {
        await put(file);
      } catch (error) {
        if (!(error instanceof DOMException)) throw error;
        postMessage({ failed: `${name} cannot be read: it was changed, moved or is a folder. Choose it again.` });
        return;
      }
      module.file();
    }
    await put(new Blob([JSON.stringify({ command, today, files: files.map(({ name, role }) => ({ name, role })) })]));
    const length = module.run();
    const answer = JSON.parse(text(module.answer(), length));
    postMessage({ ...answer, memory: module.memory.buffer.byteLength });
  } catch (error) {
    const full = last === null && module.memory.buffer.byteLength + files.reduce((sum, { file }) => sum + file.size, 0) > MEMORY / 2;
    postMessage({ failed: full ? "The analysis needs more memory than a page may have (1 GiB): take shorter or fewer logs, or the program itself, which has no such limit." : `The analysis ended by a fault of its own, please report it: ${last ?? error}` });
  }
};
