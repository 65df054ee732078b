/** In place of src/decoder/files.ts in a page of one file: what is there was put beside the scripts as objects. */

const { worker, decoder } = (globalThis as unknown as { scarFiles: Record<"worker" | "decoder", string> }).scarFiles;

export const makeWorker = () => new Worker(worker, { type: "module" });
export const moduleUrl = () => new URL(decoder);
