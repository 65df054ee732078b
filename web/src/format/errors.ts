/** The one error that says "this file is not to be decoded" (SPEC §12). Anything else that is thrown is a bug. */

export class Refused extends Error {
  override readonly name = "Refused";

  /**
   * @param id refusal id of SPEC §12.1
   * @param message what was found, for a person
   * @param offset byte of the file at which, where that is known
   */
  constructor(
    readonly id: string,
    message: string,
    readonly offset: number | null = null,
  ) {
    super(message);
  }
}

/** @throws Refused unless a rule holds */
export function demand(holds: boolean, id: string, message: string, offset: number | null = null): asserts holds {
  if (!holds) throw new Refused(id, message, offset);
}
