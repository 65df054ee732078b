/** Answers questions to planners: `node plans.mjs CASES.json` writes a list of plans. tests/web compares them with Python's. */

import { readFileSync } from "node:fs";
import { answer, type PlanCase } from "./planning.js";

const cases: PlanCase[] = JSON.parse(readFileSync(process.argv[2], "utf8"));
process.stdout.write(JSON.stringify(cases.map(answer)));
