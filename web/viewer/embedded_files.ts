/** In place of src/decoder/files.ts in a page of one file: what is there was put beside the scripts as objects. No module worker: a page from a disk may not load one. */

const { worker, decoder } = (globalThis as unknown as { scarFiles: Record<"worker" | "decoder", string> }).scarFiles;

export const makeWorker = () => new Worker(worker);
export const moduleUrl = () => new URL(decoder);
