/** One instance of the WebAssembly module: its functions, its memory, and refusals from traps. */

import { Refused } from "../format/errors.js";

/** Where something lies in the module's memory; 0 is nowhere. */
export type Address = number;

/** What scarfmt/native exports. */
export interface WasmFunctions {
  memory: WebAssembly.Memory;
  __stack_pointer: WebAssembly.Global<"i32">;
  scar_refusal(scar: Address): Address;
  scar_take(bytes: number): Address;
  scar_give(at: Address): void;
  scar_memory(): number;
  scar_open(
    profile: number,
    shDegree: number,
    slots: number,
    latticeBits: number,
    fileLength: number,
    x: number,
    y: number,
    z: number,
    voxel: number,
  ): Address;
  scar_close(scar: Address): void;
  scar_block(scar: Address, layer: number, kind: number, at: Address, length: number): number;
  scar_models(scar: Address, from: number, to: number): number;
  scar_tile(scar: Address, depth: number, shift: number, prefixLow: number, prefixHigh: number): Address;
  scar_advance(
    scar: Address,
    tile: Address,
    at: Address,
    length: number,
    appear: number,
    streams: number,
  ): Address;
  scar_release(tile: Address): void;
  scar_gaussians(scar: Address, tile: Address, x: number, y: number, z: number, drawn: number): Address;
  scar_words(scar: Address, tile: Address, x: number, y: number, z: number): Address;
  scar_tile_count(tile: Address): number;
  scar_tile_layer(tile: Address): number;
  scar_values(scar: Address, tile: Address, what: number, channel: number): Address;
  scar_model_number(scar: Address, what: number, which: number): number;
  scar_model_words(scar: Address, book: number): Address;
  scar_model_bits(scar: Address, level: number): Address;
}

export class WasmModule {
  readonly #functions: WasmFunctions;
  readonly #stack: number;
  /** The open file, what scar_open gave; 0 before. */
  scar: Address = 0;

  /** @param module of scarfmt/native, which imports nothing */
  constructor(module: WebAssembly.Module) {
    this.#functions = new WebAssembly.Instance(module).exports as unknown as WasmFunctions;
    this.#stack = this.#functions.__stack_pointer.value;
  }

  /**
   * Runs something with the module's functions.
   * @throws Refused where the module refuses; after that it is as it was before, but for what the call worked on
   */
  call<T>(run: (functions: WasmFunctions) => T): T {
    try {
      return run(this.#functions);
    } catch (error) {
      if (!(error instanceof WebAssembly.RuntimeError)) throw error;
      this.#functions.__stack_pointer.value = this.#stack;
      const id = this.#text(this.#functions.scar_refusal(0));
      throw id === "" ? error : new Refused(id, `refused by the decoder: ${id}`);
    }
  }

  /** A copy of some bytes in the module's memory, which scar_give gives back. */
  put(bytes: Uint8Array): Address {
    const at = this.call((functions) => functions.scar_take(bytes.length)) >>> 0;
    new Uint8Array(this.#functions.memory.buffer, at, bytes.length).set(bytes);
    return at;
  }

  /** A copy of n numbers. */
  numbers<T extends ArrayBufferView & { slice(): T }>(
    type: new (buffer: ArrayBuffer, offset: number, length: number) => T,
    at: Address,
    n: number,
  ): T {
    return new type(this.#functions.memory.buffer, at >>> 0, n).slice();
  }

  #text(at: Address): string {
    const bytes = new Uint8Array(this.#functions.memory.buffer, at >>> 0);
    return at === 0 ? "" : String.fromCharCode(...bytes.subarray(0, bytes.indexOf(0)));
  }
}
