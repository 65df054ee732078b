/* Channel values (SPEC 9.2): what scarfmt/codecs/channels.py defines. */

#include "kernel.h"

/* Values in coded units of (n, columns) integers at (n,) `steps`, by the (steps, columns) widths of cells: a product in
binary64, rounded to binary32. */
WIDE EXPORT void scar_values(const int32_t *values, const int64_t *steps, const double *widths, int64_t n,
                             int64_t columns, float *out) {
    for (int64_t i = 0; i < n; i++, values += columns, out += columns) {
        const double *width = widths + steps[i] * columns;
        for (int64_t c = 0; c < columns; c++) out[c] = (float)(values[c] * width[c]);
    }
}
