/* The colour that spherical harmonics have in a direction, INRIA's order and signs. */

#ifndef SCAR_HARMONICS_H
#define SCAR_HARMONICS_H

#include "vectors.h"

typedef float Four __attribute__((vector_size(16)));

/* Fills what ((degree + 1)^2) coefficients count for along directions of any length. */
INLINE void harmonic_basis(V x, V y, V z, int degree, V *basis) {
    V per = 1.0f / root(x * x + y * y + z * z);
    x *= per, y *= per, z *= per;
    V xx = x * x, yy = y * y, zz = z * z;
    basis[0] = all(0.28209479f);
    if (degree > 0) {
        basis[1] = -0.48860251f * y;
        basis[2] = 0.48860251f * z;
        basis[3] = -0.48860251f * x;
    }
    if (degree > 1) {
        basis[4] = 1.09254843f * x * y;
        basis[5] = -1.09254843f * y * z;
        basis[6] = 0.31539157f * (2.0f * zz - xx - yy);
        basis[7] = -1.09254843f * x * z;
        basis[8] = 0.54627422f * (xx - yy);
    }
    if (degree > 2) {
        basis[9] = -0.59004359f * y * (3.0f * xx - yy);
        basis[10] = 2.89061144f * x * y * z;
        basis[11] = -0.4570458f * y * (4.0f * zz - xx - yy);
        basis[12] = 0.37317633f * z * (2.0f * zz - 3.0f * xx - 3.0f * yy);
        basis[13] = -0.4570458f * x * (4.0f * zz - xx - yy);
        basis[14] = 1.44530572f * z * (xx - yy);
        basis[15] = -0.59004359f * x * (xx - 3.0f * yy);
    }
}

/* Fills red, green and blue from ((degree + 1)^2, 3) coefficients, by one of the directions. */
INLINE void harmonic_colour(const float *coefficients, const V *basis, int lane, int degree, float *colour) {
    int last = (degree + 1) * (degree + 1) - 1;
    const float *end = coefficients + 3 * last;
    Four sum = {0.5f, 0.5f, 0.5f, 0};
    sum += basis[last][lane] * (Four){end[0], end[1], end[2], 0};
    for (int k = 0; k < last; k++) {
        Four value; /* the fourth number is the next one's */
        memcpy(&value, coefficients + 3 * k, sizeof value);
        sum += basis[k][lane] * value;
    }
    memcpy(colour, &sum, 3 * sizeof(float));
}

#endif
