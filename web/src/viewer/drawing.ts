/** What needs three.js and Spark, which are large: it is loaded while the first bytes of a scene come. */

export { Pilot } from "./pilot.js";
export { Stage } from "./stage.js";
