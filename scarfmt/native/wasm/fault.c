/* Refusals end a call by a trap, the one way out of a module that imports nothing. Whoever called asks for the id:
there is one after a refusal, none after a trap of another kind, which would be a fault of the module. */

#include <stddef.h>

#include "fault.h"

#include "scar.h"

static const char *pending;

_Noreturn void refuse(const char *id) {
    pending = id;
    __builtin_trap();
}

/* The id of the refusal that ended the last call, NULL for none; it is then forgotten. */
const char *scar_refusal(Scar *scar) {
    (void)scar;
    const char *id = pending;
    pending = NULL;
    return id;
}
