/** One instance of the WebAssembly module: its functions, its memory, and refusals from traps. */

import { Refused } from "../../../conformance/decoders/js/errors.js";

/** Where something lies in the module's memory; 0 is nowhere. */
export type Address = number;

/** What the files of web/wasm export. */
export interface WasmFunctions {
  memory: WebAssembly.Memory;
  __stack_pointer: WebAssembly.Global<"i32">;
  scar_refusal(): Address;
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
  ): void;
  scar_block(layer: number, kind: number, at: Address, length: number): void;
  scar_models(from: number, to: number): void;
  scar_tile(depth: number, shift: number, prefixLow: number, prefixHigh: number): Address;
  scar_advance(tile: Address, at: Address, length: number, appear: number): Address;
  scar_abandon(): Address;
  scar_release(tile: Address): void;
  scar_gaussians(tile: Address, x: number, y: number, z: number, drawn: number): Address;
  scar_spark(tile: Address, x: number, y: number, z: number): Address;
  scar_tile_count(tile: Address): number;
  scar_tile_layer(tile: Address): number;
  scar_tile_array(tile: Address, what: number, channel: number): Address;
  scar_exact(tile: Address, what: number, channel: number): Address;
  scar_model_number(what: number, which: number): number;
  scar_model_words(book: number): Address;
  scar_model_bits(level: number): Address;
}

export class WasmModule {
  readonly #functions: WasmFunctions;
  readonly #stack: number;

  /** @param module of web/wasm, which imports nothing */
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
      const id = this.#text(this.#functions.scar_refusal());
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
