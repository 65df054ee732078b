/* The inner loops of rANS decoding (SPEC 8.1-8.3): what scarfmt/entropy defines. */

#include "rans.h"

/* Takes the first state from the end of the words. */
void scar_rans_open(Rans *rans) {
    rans->state = 0;
    refill(rans);
    refill(rans);
}

/* The order of n symbols by ascending kind; counts[k] is then where kind k ends. ALL_READ, or a kind without table. */
static int64_t sorted_by_kind(const Tables *tables, const uint16_t *kind, int64_t n, int64_t *counts, int32_t *order) {
    const int64_t kinds = tables->kinds;
    for (int64_t k = 0; k <= kinds; k++) counts[k] = 0;
    for (int64_t i = 0; i < n; i++) {
        if (kind[i] >= kinds) return kind[i];
        counts[kind[i] + 1]++;
    }
    for (int64_t k = 0; k < kinds; k++)
        if (counts[k + 1] && !tables->table[k]) return k;
    for (int64_t k = 0; k < kinds; k++) counts[k + 1] += counts[k];
    for (int64_t i = 0; i < n; i++) order[counts[kind[i]]++] = (int32_t)i;
    return ALL_READ;
}

/* Values of n symbols that travel grouped by ascending kind, their order kept within a group.

counts: kinds + 1 numbers of scratch; order: n of them. Returns ALL_READ, or the least kind that occurs and has no
table; nothing is then read. */
int64_t scar_rans_grouped(Rans *rans, const Tables *tables, const uint16_t *kind, int64_t n, int64_t *counts,
                                 int32_t *order, int32_t *out) {
    const int64_t missing = sorted_by_kind(tables, kind, n, counts, order);
    if (missing != ALL_READ) return missing;
    /* In registers: through memory, each symbol would wait for the one before. */
    Rans local = *rans;
    int64_t at = 0;
    for (int64_t k = 0; k < tables->kinds; k++) {
        const int64_t past = counts[k];
        if (at == past) continue;
        const StaticTable table = *tables->table[k];
        if (table.few.third)
            for (; at < past; at++) out[order[at]] = few_symbols(&local, &table.few);
        else
            for (; at < past; at++) out[order[at]] = near_symbol(&local, &table);
    }
    *rans = local;
    return ALL_READ;
}

/* n symbols of the uniform table of `size` symbols, 2 <= size <= 4096. */
void scar_rans_uniform(Rans *rans, uint32_t size, int64_t n, int32_t *out) {
    const uint64_t spare = TOTAL - size;
    for (int64_t i = 0; i < n; i++) {
        const uint32_t slot = (uint32_t)rans->state & SLOT_MASK;
        /* The symbol, or one before it: c_s <= s 2^24 / size <= slot. */
        uint32_t s = (uint32_t)((uint64_t)slot * size >> PRECISION);
        uint32_t first = edge(s, spare, size, s), past = edge(s + 1, spare, size, s + 1);
        while (past <= slot) first = past, s++, past = edge(s + 1, spare, size, s + 1);
        advance(rans, slot, first, past);
        out[i] = (int32_t)s;
    }
}
