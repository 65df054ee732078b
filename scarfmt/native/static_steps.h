/* Reading the steps of channels with static contexts, values in planes (SPEC 7.5, 8.4). */

#ifndef SCAR_STATIC_STEPS_H
#define SCAR_STATIC_STEPS_H

#include <string.h>

#include "rans.h"
#include "steps.h"

/* Finds which anchors receive a step, and how many; those found last stay where the classes are the same. */
static int64_t choose_anchors(StaticSteps *w, const int64_t *before, const int64_t *after, int64_t step) {
    const int64_t *classes = w->classes;
    int32_t *chosen = w->chosen;
    int64_t taken = 0, count = 0;
    for (int64_t k = 0; k < CLASS_ROOM; k++) taken |= (int64_t)(before[k] < step && after[k] >= step) << k;
    if (taken == w->taken) return w->taken_count;
    for (int64_t i = 0; i < w->known; i++) {
        chosen[count] = (int32_t)i;
        count += taken >> classes[i] & 1;
    }
    w->taken = taken;
    return w->taken_count = count;
}

/* Context numbers of a component's symbols; whether its values leave room for one more trit. */
WIDE static int refined_kinds(const StaticSteps *w, int64_t count, const int32_t *plane) {
    const int32_t room = (VALUE_LIMIT - 1) / 3;
    const int whole = count == w->known;
    int outside = 0;
    for (int64_t i = 0; i < count; i++) {
        const int32_t value = plane[whole ? i : w->chosen[i]];
        const int32_t low = value < -2 ? -2 : value;
        outside |= (value < -room) | (value > room);
        w->kind[i] = (uint8_t)((low > 2 ? 2 : low) + 2);
    }
    return !outside;
}

/* The chosen anchors by ascending kind into `order`; past[k] is where kind k ends. */
static __attribute__((noinline)) void sort_chosen(const StaticSteps *w, int64_t count, uint32_t past[TRIT_KINDS]) {
    const uint8_t *kind = w->kind;
    uint32_t parts[4][TRIT_KINDS];
    int64_t i = 0;
    memset(parts, 0, sizeof parts);
    /* Four counts of each kind: one would wait for itself where neighbours are of a kind. */
    for (; i + 4 <= count; i += 4)
        for (int p = 0; p < 4; p++) parts[p][kind[i + p]]++;
    for (; i < count; i++) parts[0][kind[i]]++;
    uint32_t sum = 0;
    for (int64_t k = 0; k < TRIT_KINDS; k++) {
        past[k] = sum;
        for (int p = 0; p < 4; p++) sum += parts[p][k];
    }
    int32_t *order = w->order;
    const int32_t *chosen = w->chosen;
    for (i = 0; i < count; i++) order[past[kind[i]]++] = chosen[i];
}

/* One symbol more for each of m anchors of a plane: factor * value + symbol. Not inlined, for registers of its own. */
static __attribute__((noinline)) void take_few(Rans *rans, const FewSymbols *table, const int32_t *order, int64_t m,
                                               int32_t factor, int32_t *plane) {
    const FewSymbols few = *table;
    Rans local = *rans;
    for (int64_t i = 0; i < m; i++) {
        int32_t *value = plane + order[i];
        *value = factor * *value + few_symbols(&local, &few);
    }
    *rans = local;
}

static __attribute__((noinline)) void take_many(Rans *rans, const StaticTable *many, const int32_t *order, int64_t m,
                                                int32_t factor, int32_t *plane) {
    const StaticTable table = *many;
    Rans local = *rans;
    for (int64_t i = 0; i < m; i++) {
        int32_t *value = plane + order[i];
        *value = factor * *value + near_symbol(&local, &table);
    }
    *rans = local;
}

static void take_group(Rans *rans, const StaticTable *table, const int32_t *order, int64_t m, int32_t factor,
                       int32_t *plane) {
    if (table->few.third)
        take_few(rans, &table->few, order, m, factor, plane);
    else
        take_many(rans, table, order, m, factor, plane);
}

static int trits_alone(const StaticTable *table) {
    return table->values[0] >= -1 && table->values[table->size - 1] <= 1;
}

#endif
