/* The positions sub-stream (SPEC 7.2): what scarfmt/codecs/positions.py defines. */

#include "steps.h"

#define OWN_TABLES 16 /* nodes of up to this many anchors have a table of their own */
#define BINS 16
#define CHUNK 12 /* bits of a uniform symbol */
#define BAD_BIN (-2)
#define BAD_REST (-3)
#define BAD_SPLIT (-4)

static void read_uniform(Rans *rans, int64_t size, int64_t n, int32_t *out) {
    if (size > 1)
        scar_rans_uniform(rans, (uint32_t)size, n, out);
    else
        for (int64_t i = 0; i < n; i++) out[i] = 0;
}

static inline int64_t bin_edge(int64_t count, int64_t bin) { return (bin * (count + 1) + BINS - 1) / BINS; }

/* Uniform rests below `size` of the m nodes listed in `order`. */
static int64_t read_rests(Rans *rans, Positions *p, int64_t size, int64_t m) {
    const int64_t high = size > 1 << CHUNK ? ((size - 1) >> CHUNK) + 1 : 0;
    if (high) {
        read_uniform(rans, high, m, p->symbols);
        for (int64_t i = 0; i < m; i++) p->rest[p->order[i]] = (int64_t)p->symbols[i] << CHUNK;
    }
    read_uniform(rans, high ? 1 << CHUNK : size, m, p->symbols);
    for (int64_t i = 0; i < m; i++) {
        p->rest[p->order[i]] += p->symbols[i];
        if (p->rest[p->order[i]] >= size) return BAD_REST;
    }
    return ALL_READ;
}

/* Splits of the nodes of more than OWN_TABLES anchors: a bin, then what is left within it, widths ascending. */
static int64_t read_large(Rans *rans, Positions *p, const Tables *tables, int64_t nodes) {
    int64_t m = 0, width = 1;
    for (int64_t i = 0; i < nodes; i++)
        if (p->here.count[i] > OWN_TABLES) p->kind[m++] = OWN_TABLES + 1;
    if (!m) return ALL_READ;
    const int64_t read = scar_rans_grouped(rans, tables, p->kind, m, p->counts, p->order, p->symbols);
    if (read != ALL_READ) return read;
    for (int64_t i = 0, k = 0; i < nodes; i++) {
        if (p->here.count[i] <= OWN_TABLES) continue;
        const int64_t bin = p->symbols[k++];
        if (bin < 0 || bin >= BINS) return BAD_BIN;
        p->lower[i] = bin_edge(p->here.count[i], bin);
        p->rest[i] = -bin_edge(p->here.count[i], bin + 1) + p->lower[i]; /* minus the width until it is read */
    }
    for (;;) {
        int64_t next = INT64_MAX;
        for (int64_t i = 0; i < nodes; i++)
            if (p->here.count[i] > OWN_TABLES && -p->rest[i] > width && -p->rest[i] < next) next = -p->rest[i];
        if (next == INT64_MAX) break;
        width = next, m = 0;
        for (int64_t i = 0; i < nodes; i++)
            if (p->here.count[i] > OWN_TABLES && -p->rest[i] == width) p->order[m++] = (int32_t)i, p->rest[i] = 0;
        const int64_t done = read_rests(rans, p, width, m);
        if (done != ALL_READ) return done;
    }
    for (int64_t i = 0; i < nodes; i++)
        if (p->here.count[i] > OWN_TABLES && p->rest[i] > 0) p->lower[i] += p->rest[i];
    return ALL_READ;
}

/* How many anchors of each node lie in its lower half. */
static int64_t read_splits(Rans *rans, Positions *p, const Tables *tables, int64_t nodes) {
    int64_t m = 0;
    for (int64_t i = 0; i < nodes; i++)
        if (p->here.count[i] <= OWN_TABLES) p->kind[m++] = (uint16_t)p->here.count[i];
    int64_t read = scar_rans_grouped(rans, tables, p->kind, m, p->counts, p->order, p->symbols);
    if (read != ALL_READ) return read;
    for (int64_t i = 0, k = 0; i < nodes; i++)
        if (p->here.count[i] <= OWN_TABLES) p->lower[i] = p->symbols[k++];
    read = read_large(rans, p, tables, nodes);
    if (read != ALL_READ) return read;
    for (int64_t i = 0; i < nodes; i++)
        if (p->lower[i] < 0 || p->lower[i] > p->here.count[i]) return BAD_SPLIT;
    return ALL_READ;
}

/* Takes anchors that are alone out of the nodes; returns how many nodes are left. */
static int64_t set_apart(Positions *p, int64_t nodes, int64_t open) {
    int64_t left = 0;
    for (int64_t i = 0; i < nodes; i++) {
        const int64_t start = p->here.start[i];
        if (p->here.count[i] == 1) {
            p->open[start] = (uint8_t)open;
            p->codes[start] = p->here.prefix[i];
            continue;
        }
        p->here.start[left] = start;
        p->here.count[left] = p->here.count[i];
        p->here.prefix[left++] = p->here.prefix[i];
    }
    return left;
}

static inline int64_t put_node(Nodes *nodes, int64_t at, int64_t start, int64_t count, uint64_t prefix) {
    nodes->start[at] = start;
    nodes->count[at] = count;
    nodes->prefix[at] = prefix;
    return at + (count > 0);
}

static int64_t children(Positions *p, int64_t nodes, int64_t bit) {
    int64_t made = 0;
    for (int64_t i = 0; i < nodes; i++) {
        const int64_t start = p->here.start[i], lower = p->lower[i];
        const uint64_t prefix = p->here.prefix[i];
        if (lower) made = put_node(&p->below, made, start, lower, prefix);
        if (p->here.count[i] > lower)
            made = put_node(&p->below, made, start + lower, p->here.count[i] - lower, prefix | 1ull << bit);
    }
    const Nodes above = p->here;
    p->here = p->below;
    p->below = above;
    return made;
}

/* The bits left of anchors that are alone, those with most bits left first. */
static void read_open(Rans *rans, Positions *p) {
    for (int64_t width = 3 * p->bits; width > 0; width--) {
        int64_t m = 0;
        for (int64_t i = 0; i < p->total; i++)
            if (p->open[i] == width) p->order[m++] = (int32_t)i;
        for (int64_t low = CHUNK * ((width - 1) / CHUNK); m && low >= 0; low -= CHUNK) {
            read_uniform(rans, 1 << (width - low < CHUNK ? width - low : CHUNK), m, p->symbols);
            for (int64_t i = 0; i < m; i++) p->codes[p->order[i]] |= (uint64_t)p->symbols[i] << low;
        }
    }
}

/* Reads the codes of total >= 1 anchors: ALL_READ, BAD_BIN, BAD_REST, BAD_SPLIT, or a kind that has no table. */
int64_t scar_positions(Rans *rans, Positions *p, const Tables *tables) {
    int64_t nodes = put_node(&p->here, 0, 0, p->total, 0);
    for (int64_t bit = 3 * p->bits - 1; bit >= 0; bit--) {
        nodes = set_apart(p, nodes, bit + 1);
        if (!nodes) break;
        const int64_t read = read_splits(rans, p, tables, nodes);
        if (read != ALL_READ) return read;
        nodes = children(p, nodes, bit);
    }
    for (int64_t i = 0; i < nodes; i++)
        for (int64_t k = 0; k < p->here.count[i]; k++) p->codes[p->here.start[i] + k] = p->here.prefix[i];
    read_open(rans, p);
    return ALL_READ;
}
