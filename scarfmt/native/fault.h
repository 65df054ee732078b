/* Refusals (SPEC 12.1). Nothing is said back by functions: a refusal ends the call into the module. */

#ifndef SCAR_FAULT_H
#define SCAR_FAULT_H

/* Ends the call; scar_refusal tells the id. What was being read is not to be used afterwards. */
_Noreturn void refuse(const char *id);

static inline void demand(int holds, const char *id) {
    if (!holds) refuse(id);
}

#endif
