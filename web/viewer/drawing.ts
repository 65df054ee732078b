/** What needs three.js and Spark, which are large: the page loads it while the first bytes of a scene come. */

export { Pilot } from "./pilot.js";
export { Stage } from "./stage.js";
