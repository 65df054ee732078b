// Makes objects with addresses of what the page has within it, and starts.
const text = (id) => document.getElementById(id).textContent;
const blob = async (id, type) => (await fetch(`data:${type};base64,${text(id)}`)).blob();
const unzipped = async (id, type) => {
  const stream = (await blob(id, type)).stream().pipeThrough(new DecompressionStream("gzip"));
  return URL.createObjectURL(await new Response(stream, { headers: { "Content-Type": type } }).blob());
};
const [page, worker, decoder, spark] = await Promise.all([
  unzipped("file-page", "text/javascript"),
  unzipped("file-worker", "text/javascript"),
  unzipped("file-decoder", "application/wasm"),
  unzipped("file-spark", "application/wasm"),
]);
const scene = new File([await blob("scene", "application/octet-stream")], document.getElementById("scene").title);
globalThis.scarFiles = { worker, decoder, spark, scene };
await import(page);
