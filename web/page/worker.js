
// A worker for one job: it unpacks the module and gives back the answer.
async function unpacked(packed) {
  const bytes = Uint8Array.from(atob(packed), (c) => c.charCodeAt(0));
  const module = new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip")));
  return WebAssembly.compile(await module.arrayBuffer());
}

onmessage = async ({ data: { packed, ...job } }) => {
  let compiled;
  try {
    compiled = await unpacked(packed);
  } catch (error) {
    postMessage({ failed: `This browser cannot run the analysis (${error.message}): use a present version of Chrome, Edge, Firefox or Safari.` });
    return;
  }
  postMessage(await analyse(compiled, job, postMessage));
};
