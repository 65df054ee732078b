/* Exponentials and logarithms by IEEE sums and products alone: the same bits on every machine. */

#ifndef SCAR_NUMBERS_H
#define SCAR_NUMBERS_H

#include <stdint.h>
#include <string.h>

/* log2 of a positive, normal number, to 1e-10 and then rounded. */
static inline float log2_of(float value) {
    int32_t word;
    memcpy(&word, &value, sizeof word);
    int32_t exponent = (word - 0x3f3504f3) >> 23; /* the rest lies between sqrt(1/2) and sqrt(2) */
    word -= (int32_t)((uint32_t)exponent << 23);
    memcpy(&value, &word, sizeof value);
    double s = (value - 1.0) / (value + 1.0), q = s * s;
    double series = 1 + q * (1 / 3.0 + q * (1 / 5.0 + q * (1 / 7.0 + q * (1 / 9.0 + q * (1 / 11.0 + q / 13.0)))));
    return (float)(exponent + 2.8853900817779268 * s * series);
}

/* exp(x) for -700 <= x <= 700, to 1e-14; beyond, that of the nearest of these. */
static inline double exp_of(double x) {
    x = x < -700 ? -700 : x > 700 ? 700 : x;
    const double magic = 6755399441055744.0; /* 1.5 * 2^52: adding it rounds to a whole number, in the low bits */
    double shifted = x * 1.4426950408889634 + magic, whole = shifted - magic;
    double r = x - whole * 0.693147180369123816490 - whole * 1.90821492927058770002e-10;
    double p = 1 / 39916800.0;
    p = p * r + 1 / 3628800.0;
    p = p * r + 1 / 362880.0;
    p = p * r + 1 / 40320.0;
    p = p * r + 1 / 5040.0;
    p = p * r + 1 / 720.0;
    p = p * r + 1 / 120.0;
    p = p * r + 1 / 24.0;
    p = p * r + 1 / 6.0;
    p = p * r + 0.5;
    p = p * r + 1;
    p = p * r + 1;
    int64_t power = (int64_t)whole + 1023;
    uint64_t word = (uint64_t)power << 52;
    double scale;
    memcpy(&scale, &word, sizeof scale);
    return p * scale;
}

/* How far the ellipse of an opacity reaches, deviations^2: there its alpha is the least that shows. */
static inline float reach_of(float log_opacity, float log_min_alpha) {
    return 1.38629436f * (log_opacity - log_min_alpha);
}

#endif
