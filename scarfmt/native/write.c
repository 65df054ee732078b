/* The inner loops of writing, of Python alone: symbols of steps (SPEC 7.5), how often each comes, and rANS (SPEC 8). */

#include <math.h>
#include "rans.h"
#include "steps.h"

/* name: the key of tables without context; minus the size of a uniform alphabet; or 0, and values are pairs, a span each. */
typedef struct { int64_t name, count; } Group;

/* Static tables side by side, keys ascending: table t has values from starts[t] on, and sums, one more, from starts[t] + t. */
typedef struct {
    int64_t count;
    const int32_t *keys, *values;
    const int64_t *starts;
    const uint32_t *sums;
} SideBySide;

/* Contexts and symbols of a ternary step of `wide` anchors `chosen`, component by component. values: (n, components) after
`at` steps each. Quotients of binary64 are exact enough to be rounded down: numbers have 33 bits. */
EXPORT WIDE void scar_steps(const int32_t *values, int64_t components, const int64_t *at, const int64_t *chosen,
                            int64_t wide, int64_t step, uint8_t *contexts, int32_t *symbols) {
    double power[BLOCK], value[BLOCK];
    for (int64_t from = 0; from < wide; from += BLOCK) {
        const int64_t some = wide - from < BLOCK ? wide - from : BLOCK;
        for (int64_t i = 0; i < some; i++)
            for (int64_t left = (power[i] = 1, at[chosen[from + i]] - step); left > 0; left--) power[i] *= 3;
        for (int64_t c = 0; c < components; c++) {
            uint8_t *restrict context = contexts + c * wide + from;
            int32_t *restrict symbol = symbols + c * wide + from;
            for (int64_t i = 0; i < some; i++) value[i] = values[chosen[from + i] * components + c];
            for (int64_t i = 0; i < some; i++) {
                const double here = floor((value[i] + (power[i] - 1) / 2) / power[i]), coarse = floor((here + 1) / 3);
                const double near = coarse < -2 ? -2 : coarse > 2 ? 2 : coarse;
                context[i] = step > 1 ? (uint8_t)(int32_t)(near + 2) : 0;
                symbol[i] = (int32_t)(step > 1 ? here - 3 * coarse : here);
            }
        }
    }
}

/* Counts a symbol, (key << 32) + value + 2^31, in a power of two of cells, some of them free (0): whether it is new. */
static int count_symbol(int64_t (*cells)[2], int64_t room, int64_t key, int64_t value, int64_t times) {
    const int64_t symbol = key * (1ll << 32) + value + (1ll << 31);
    uint64_t at = ((uint64_t)symbol * 0x9E3779B97F4A7C15u) >> 32;
    while (cells[at &= (uint64_t)(room - 1)][0] && cells[at][0] != symbol) at++;
    cells[at][0] = symbol, cells[at][1] += times;
    return cells[at][1] == times;
}

/* Counts symbols that have static tables in `room` cells, of which fewer than half get `used`. Returns how many of n groups
were counted, `ends` where their contexts and values end: there was no room for the next one. */
EXPORT int64_t scar_count(const Group *groups, int64_t n, const uint8_t *contexts, const int32_t *values, int64_t (*cells)[2],
                          int64_t room, int64_t *used, int64_t *ends) {
    for (int64_t g = 0; g < n; ends[1] += groups[g++].count) {
        if (groups[g].name < 0) continue;
        if (2 * (*used + groups[g].count) >= room) return g;
        uint32_t trits[3 * KINDS] = {0};
        for (int64_t i = ends[1]; i < ends[1] + groups[g].count; i++) {
            const int64_t context = contexts[ends[0]++];
            if (values[i] >= -1 && values[i] <= 1) trits[3 * context + values[i] + 1]++;
            else *used += count_symbol(cells, room, groups[g].name + context, values[i], 1);
        }
        for (int64_t k = 0; k < 3 * KINDS; k++)
            if (trits[k]) *used += count_symbol(cells, room, groups[g].name + k / 3, k % 3 - 1, trits[k]);
    }
    return n;
}

/* Where `value` is among n ascending numbers; -1: nowhere. Most alphabets have no gaps. */
static int64_t find_number(const int32_t *numbers, int64_t n, int64_t value) {
    int64_t low = 0, high = n, near = n ? value - numbers[0] : -1;
    if (near >= 0 && near < n && numbers[near] == value) return near;
    while (low < high) {
        const int64_t middle = (low + high) / 2;
        if (numbers[middle] < value) low = middle + 1; else high = middle;
    }
    return low < n && numbers[low] == value ? low : -1;
}

/* Spans of the symbols of a group in their tables, contexts ascending; 0 where no table has one. */
static int find_spans(const SideBySide *t, Group group, const uint8_t *contexts, const int32_t *values, uint32_t (*spans)[2]) {
    int64_t place[KINDS + 1] = {0}, table[KINDS];
    for (int64_t i = 0; i < group.count; i++) place[contexts[i] + 1]++;
    for (int64_t c = 0; c < KINDS; place[c + 1] += place[c], c++)
        if (place[c + 1] && (table[c] = find_number(t->keys, t->count, group.name + c)) < 0) return 0;
    for (int64_t i = 0; i < group.count; i++) {
        const int64_t which = table[contexts[i]], start = t->starts[which];
        const int64_t found = find_number(t->values + start, t->starts[which + 1] - start, values[i]);
        if (found < 0) return 0;
        memcpy(spans[place[contexts[i]]++], t->sums + start + which + found, sizeof *spans);
    }
    return 1;
}

/* Appends words of one symbol more to the `count` of a state, which it returns. */
static uint64_t push(uint64_t state, uint32_t first, uint32_t past, uint32_t *words, int64_t *count) {
    const uint64_t frequency = past - first;
    if (state >> (64 - PRECISION) >= frequency) words[(*count)++] = (uint32_t)state, state >>= 32;
    return (state / frequency << PRECISION) + state % frequency + first;
}

/* Codes the symbols of n groups, the last one first. contexts, values: their ends. spans: as many as the largest group has
symbols; words: as many as all have, and two. Returns how many were written (SPEC 8.2); -1: no table has a symbol. */
EXPORT int64_t scar_code(const SideBySide *tables, const Group *groups, int64_t n, const uint8_t *contexts,
                         const int32_t *values, uint32_t (*spans)[2], uint32_t *words) {
    uint64_t state = 0;
    int64_t count = 0;
    while (n--) {
        const Group group = groups[n];
        const uint32_t size = (uint32_t)-group.name;
        values -= group.name ? group.count : 2 * group.count;
        if (group.name > 0 && !find_spans(tables, group, contexts -= group.count, values, spans)) return -1;
        const uint32_t *span = group.name ? spans[0] : (const uint32_t *)values;
        for (int64_t i = group.count; i--;) {
            const uint32_t s = (uint32_t)values[i];
            if (group.name < 0 && s >= size) return -1;
            const uint32_t first = group.name < 0 ? edge(s, TOTAL - size, size, s) : span[2 * i];
            const uint32_t past = group.name < 0 ? edge(s + 1, TOTAL - size, size, s + 1) : span[2 * i + 1];
            state = push(state, first, past, words, &count);
        }
    }
    for (; state; state >>= 32) words[count++] = (uint32_t)state;
    return count;
}
