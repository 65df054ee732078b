/* Channel values (SPEC 9.2): what scarfmt/codecs/channels.py defines. */

#include "kernel.h"

/* (n, columns) values in coded units of planes of integers, `apart` of each other, at (n,) `steps`, by the (steps, columns)
widths of cells: a product in binary64, rounded to binary32. */
EXPORT void scar_values(const int32_t *planes, int64_t apart, const int64_t *steps, const double *widths, int64_t n,
                        int64_t columns, float *out) {
    for (int64_t i = 0; i < n; i++, out += columns) {
        const double *width = widths + steps[i] * columns;
        for (int64_t c = 0; c < columns; c++) out[c] = (float)(planes[c * apart + i] * width[c]);
    }
}
