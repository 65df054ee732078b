/* What is asked of the compiler: what a library shows, vectors as wide as the machine's, code put in place. */

#ifndef SCAR_COMPILER_H
#define SCAR_COMPILER_H

#define EXPORT __attribute__((visibility("default")))

/* Wider vectors where the machine has them, chosen when the library is loaded: glibc can, musl cannot. Not where the
whole unit is compiled for the widest (-march=x86-64-v4, native): there is nothing to choose, and GCC 12 fails. */
#if defined(__x86_64__) && defined(__GLIBC__) && __GNUC__ >= 12 && !defined(__clang__) && !defined(__AVX512F__)
#define WIDE __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define WIDE
#endif

/* Without fused multiply-adds: exact values are of one rounding an operation. */
#if defined(__clang__)
#define UNFUSED
#pragma STDC FP_CONTRACT OFF
#else
#define UNFUSED __attribute__((optimize("fp-contract=off")))
#endif

/* Compiled anew in each caller, for the vectors that it uses. */
#define INLINE static inline __attribute__((always_inline))

#endif
