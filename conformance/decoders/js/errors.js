/** The one error that says "this file is not to be decoded" (SPEC §12). Anything else that is thrown is a bug. */

export class Refused extends Error {
  /**
   * @param {string} id refusal id of SPEC §12.1
   * @param {string} message what was found, for a person
   * @param {number | null} [offset] byte of the file at which, where that is known
   */
  constructor(id, message, offset = null) {
    super(message);
    this.name = "Refused";
    this.id = id;
    this.offset = offset;
  }
}

/**
 * @param {boolean} holds
 * @param {string} id
 * @param {string} message
 * @param {number | null} [offset]
 */
export function demand(holds, id, message, offset = null) {
  if (!holds) throw new Refused(id, message, offset);
}
