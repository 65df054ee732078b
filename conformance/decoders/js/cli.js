#!/usr/bin/env node
/**
 * The decoder protocol on the command line:
 *
 *     node cli.js FILE [--layers K] [--stage S] [--camera X,Y,Z]
 *     node cli.js --session
 */

import { answer, CAPABILITIES } from "./answers.js";
import { serve } from "./protocol.js";

serve({ capabilities: CAPABILITIES, answer });
