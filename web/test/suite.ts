/**
 * The conformance vectors in a browser: a page with `<p id="status">` and `<ul id="failed">`, served from the repository,
 * `?decoder=js` or `wasm`. Left out are vectors of which both outcomes are allowed, those of METADATA and STREAMING alone, and
 * those that are longer than their file.
 */

import { answer } from "../../conformance/decoders/js/answers.js";
import { loadModule } from "../src/decoder/shared_module.js";
import { STAGES, wasmOpener } from "./wasm_scar.js";

type Arrays = Record<string, { sha256?: string }>;
type Found = { refused?: string; stages?: Record<string, { arrays?: Arrays }> };
type Expect = {
  layers: { layer: number; stages: Record<string, { arrays?: Arrays }> }[];
  refusal: string;
  stage?: string;
  extend_to?: number;
};
type Vector = { id: string; result: string; expect: string; file: string };

const suite = new URL("/conformance/", location.href);
const load = (path: string) => fetch(new URL(path, suite));
const inWasm = new URLSearchParams(location.search).get("decoder") !== "js";
const decoder = inWasm
  ? { open: wasmOpener(await loadModule(new URL("/web/dist/scar.wasm", location.href))), decoded: STAGES }
  : undefined;

function passes(vector: Vector, expect: Expect, bytes: Uint8Array): boolean {
  const source = { length: bytes.length, read: (at: number, length: number) => bytes.subarray(at, at + length) };
  const refused = vector.result === "refused";
  const layers = refused ? [{ layer: 0, stages: {} }] : expect.layers;
  return layers.every(({ layer, stages }) => {
    const found: Found = JSON.parse([...answer(source, { layers: layer, stage: "all" }, decoder)].join(""));
    if (refused) return found.refused === expect.refusal;
    const answered = Object.entries(stages).filter(([stage]) => !inWasm || STAGES.includes(stage));
    return answered.every(([stage, { arrays = {} }]) =>
      Object.entries(arrays).every(
        ([name, { sha256 }]) => sha256 === undefined || found.stages?.[stage]?.arrays?.[name]?.sha256 === sha256,
      ),
    );
  });
}

const { vectors }: { vectors: Vector[] } = await (await load("manifest.json")).json();
let [asked, failed] = [0, 0];
for (const vector of vectors) {
  const expect: Expect = await (await load(vector.expect)).json();
  const alone = expect.stage === "metadata" || expect.stage === "streaming";
  if (vector.result === "either" || expect.extend_to !== undefined || alone) continue;
  const bytes = new Uint8Array(await (await load(vector.file)).arrayBuffer());
  asked++;
  if (passes(vector, expect, bytes)) continue;
  failed++;
  document.querySelector("#failed")!.append(Object.assign(document.createElement("li"), { textContent: vector.id }));
}
document.querySelector("#status")!.textContent = `Done: ${asked - failed} of ${asked} vectors pass.`;
