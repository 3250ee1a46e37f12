// A worker for one job, or for one vehicle that is listened to: it unpacks the module and gives back the answer.
async function unpacked(packed) {
  const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
  const module = new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
  return WebAssembly.compile(await module.arrayBuffer());
}

async function begin({ packed, session, ...job }) {
  let compiled;
  try {
    compiled = await unpacked(packed);
  } catch (error) {
    postMessage({ failed: `This browser cannot run the analysis (${error.message}): use a present version of Chrome, Edge, Firefox or Safari.` });
    return null;
  }
  if (!session) {
    postMessage(await analyse(compiled, job, postMessage));
    return null;
  }
  const module = await instance(compiled, () => {});
  const refused = await module.given(session, job.files, "listen");
  if (refused) {
    postMessage({ refused });
    return null;
  }
  postMessage({ listens: true });
  return listening(module, postMessage);
}

let listener = null;
onmessage = ({ data }) => {
  if (data.packed) listener = begin(data);
  else listener = listener.then((take) => { take?.(data); return take; });
};
