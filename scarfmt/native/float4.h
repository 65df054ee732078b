/* Elementary functions of four numbers in binary32, to a few units in the last place: what SPEC 9.3 to 9.6 ask for. */

#ifndef SCAR_FLOAT4_H
#define SCAR_FLOAT4_H

#include "kernel.h"

typedef float Float4 __attribute__((vector_size(16), aligned(4), may_alias));
typedef int32_t Int4 __attribute__((vector_size(16), aligned(4), may_alias));

INLINE Float4 all4(float x) { return (Float4){x, x, x, x}; }
INLINE Float4 load4(const float *x) { return *(const Float4 *)x; }
INLINE void store4(float *out, Float4 x) { *(Float4 *)out = x; }

/* Where mask is all ones, x; else y. */
INLINE Float4 choose4(Int4 mask, Float4 x, Float4 y) { return (Float4)((mask & (Int4)x) | (~mask & (Int4)y)); }
INLINE Float4 least4(Float4 x, Float4 y) { return choose4(x < y, x, y); }
INLINE Float4 most4(Float4 x, Float4 y) { return choose4(x > y, x, y); }
INLINE Float4 abs4(Float4 x) { return (Float4)((Int4)x & 0x7fffffff); }

#if defined(__wasm__)
typedef float Packed4 __attribute__((vector_size(16)));
INLINE Float4 root4(Float4 x) { return (Float4)__builtin_wasm_sqrt_f32x4((Packed4)x); }
INLINE Float4 nearest4(Float4 x) { return (Float4)__builtin_wasm_nearest_f32x4((Packed4)x); }
#else
INLINE Float4 root4(Float4 x) {
    for (int j = 0; j < 4; j++) x[j] = __builtin_sqrtf(x[j]);
    return x;
}
INLINE Float4 nearest4(Float4 x) {
    for (int j = 0; j < 4; j++) x[j] = __builtin_rintf(x[j]);
    return x;
}
#endif

INLINE Int4 integers4(Float4 x) { return __builtin_convertvector(x, Int4); }

/* 2^n, n from -126 to 127. */
INLINE Float4 power4(Int4 n) { return (Float4)((n + 127) << 23); }

/* e^x; infinity and 0 beyond the range of numbers. */
INLINE Float4 exp4(Float4 x) {
    const Float4 limited = least4(most4(x, all4(-126)), all4(126)), n = nearest4(limited * 1.44269504f);
    const Float4 r = (limited - n * 0.693359375f) + n * 2.12194440e-4f;
    Float4 sum = all4(1.f / 5040);
    sum = sum * r + 1.f / 720;
    sum = sum * r + 1.f / 120;
    sum = sum * r + 1.f / 24;
    sum = sum * r + 1.f / 6;
    sum = sum * r + .5f;
    sum = sum * r + 1;
    sum = sum * r + 1;
    const Int4 half = integers4(n) >> 1;
    return sum * power4(half) * power4(integers4(n) - half);
}

/* ln x of a normal number above 0. */
INLINE Float4 log4(Float4 x) {
    const Int4 n = ((Int4)x - 0x3f3504f3) >> 23; /* of sqrt(1/2) */
    const Float4 m = (Float4)((Int4)x - (n << 23)), s = (m - 1) / (m + 1), ss = s * s;
    const Float4 series = 2 * s * (1 + ss * (1.f / 3 + ss * (1.f / 5 + ss * (1.f / 7 + ss * (1.f / 9)))));
    return series + __builtin_convertvector(n, Float4) * .69314718f;
}

/* 1 / (1 + e^-x). */
INLINE Float4 logistic4(Float4 x) { return 1 / (1 + exp4(-x)); }

INLINE Float4 tanh4(Float4 x) {
    const Float4 size = 1 - 2 / (1 + exp4(2 * abs4(x)));
    return choose4(x < 0, -size, size);
}

/* Sine and cosine of quarter turns plus an angle of up to pi / 4. */
INLINE void turn4(Int4 quarters, Float4 angle, Float4 *sine, Float4 *cosine) {
    const Float4 xx = angle * angle;
    const Float4 s = angle * (1 + xx * (-1.f / 6 + xx * (1.f / 120 + xx * (-1.f / 5040 + xx * (1.f / 362880)))));
    const Float4 c = 1 + xx * (-.5f + xx * (1.f / 24 + xx * (-1.f / 720 + xx * (1.f / 40320))));
    const Int4 odd = -(quarters & 1), below = (quarters & 2) << 30, left = ((quarters + 1) & 2) << 30;
    *sine = (Float4)((Int4)choose4(odd, c, s) ^ below);
    *cosine = (Float4)((Int4)choose4(odd, s, c) ^ left);
}

#define PLAIN_ANGLE 64 /* beyond it, angles are reduced by the digits of 2 / pi */

/* An angle of up to PLAIN_ANGLE. */
INLINE void sincos4(Float4 x, Float4 *sine, Float4 *cosine) {
    const Float4 n = nearest4(x * 0.636619772f);
    const Float4 r = ((x - n * 1.5703125f) - n * 4.837512969970703125e-4f) - n * 7.549789948768648e-8f;
    turn4(integers4(n), r, sine, cosine);
}

/* The quarter turn nearest to any angle, of which a binary32 has 24 bits, and what is left: 64 bits of 2 / pi, from the
first that counts modulo 4 on, give it to 2^-38. */
static inline float reduced_angle(float x, int32_t *quarters) {
    static const uint32_t digits[8] = {0xA2F9836E, 0x4E441529, 0xFC2757D1, 0xF534DDC0,
                                       0xDB629599, 0x3C439041, 0xFE5163AB, 0xDEBBC561};
    union {
        float number;
        uint32_t bits;
    } parts = {x};
    const int64_t first = (int64_t)(parts.bits >> 23 & 255) - 127 - 23 - 2;
    uint64_t window = 0;
    for (int64_t bit = first; bit < first + 64; bit++)
        window = window << 1 | (bit >= 0 && bit < 256 ? digits[bit >> 5] >> (31 - (bit & 31)) & 1 : 0);
    const uint64_t turned = ((parts.bits & 0x7fffff) | 0x800000) * window, near = turned + (1ull << 61);
    const float rest = (float)((double)(int64_t)(turned - (near & 3ull << 62)) * (0x1p-62 * 1.5707963267948966));
    *quarters = (int32_t)(near >> 62) * (x < 0 ? -1 : 1);
    return x < 0 ? -rest : rest;
}

#endif
