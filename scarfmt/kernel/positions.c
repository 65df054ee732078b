/* The positions sub-stream (SPEC 7.2): what scarfmt/codecs/positions.py defines. */

#include "steps.h"

#define OWN_TABLES 16 /* nodes of up to this many anchors have a table of their own */
#define BINS 16
#define CHUNK 12 /* bits of a uniform symbol */
#define BAD_BIN (-2)
#define BAD_REST (-3)
#define BAD_SPLIT (-4)

static void read_uniform(Rans *rans, Positions *p, int64_t size, int64_t n, int32_t *out) {
    p->uniform_read += n;
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
        read_uniform(rans, p, high, m, p->symbols);
        for (int64_t i = 0; i < m; i++) p->rest[p->order[i]] = (int64_t)p->symbols[i] << CHUNK;
    }
    read_uniform(rans, p, high ? 1 << CHUNK : size, m, p->symbols);
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
    p->static_read += m;
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
    p->static_read += m;
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
            read_uniform(rans, p, 1 << (width - low < CHUNK ? width - low : CHUNK), m, p->symbols);
            for (int64_t i = 0; i < m; i++) p->codes[p->order[i]] |= (uint64_t)p->symbols[i] << low;
        }
    }
}

/* Writing. */

static void open_group(WrittenPositions *p, int64_t size) {
    if (p->sizes) p->sizes[p->groups] = size;
}

/* The group that was opened last is over: it counts if it holds anything. */
static void close_group(WrittenPositions *p, int64_t from) {
    if (p->symbols == from) return;
    if (p->sizes) p->lengths[p->groups] = p->symbols - from;
    p->groups++;
}

INLINE void put_uniform_value(WrittenPositions *p, int64_t value) {
    if (p->values) p->values[p->symbols] = (int32_t)value;
    p->symbols++;
}

INLINE void put_static(WrittenPositions *p, int64_t kind, int64_t value) {
    if (p->kinds) p->kinds[p->statics] = (uint16_t)kind;
    p->statics++;
    put_uniform_value(p, value);
}

/* How many of n codes, ascending and equal above `bit`, have a 0 there. */
static int64_t count_lower(const uint64_t *codes, int64_t n, int64_t bit) {
    int64_t low = 0, past = n;
    while (low < past) {
        const int64_t middle = (low + past) / 2;
        if (codes[middle] >> bit & 1)
            past = middle;
        else
            low = middle + 1;
    }
    return low;
}

/* Rests of the nodes of one width, its upper bits first where it takes two symbols. */
static void write_rests(WrittenPositions *p, int64_t width, int64_t nodes) {
    const int64_t high = width > 1 << CHUNK ? ((width - 1) >> CHUNK) + 1 : 0;
    for (int part = high ? 0 : 1; part < 2; part++) {
        const int64_t from = p->symbols;
        open_group(p, !part ? high : high ? 1 << CHUNK : width);
        for (int64_t i = 0; i < nodes; i++)
            if (p->width[i] == width) put_uniform_value(p, part ? high ? p->rest[i] & ((1 << CHUNK) - 1) : p->rest[i]
                                                                : p->rest[i] >> CHUNK);
        close_group(p, from);
    }
}

/* Splits of the nodes, each of two anchors or more: own tables, bins, and what is left within these, widths ascending. */
static void write_splits(WrittenPositions *p, int64_t nodes) {
    int64_t from = p->symbols, width = 1;
    open_group(p, 0);
    for (int64_t i = 0; i < nodes; i++)
        if (p->here.count[i] <= OWN_TABLES) put_static(p, p->here.count[i], p->lower[i]);
    close_group(p, from);
    from = p->symbols;
    open_group(p, 0);
    for (int64_t i = 0; i < nodes; i++) {
        const int64_t count = p->here.count[i], bin = p->lower[i] * BINS / (count + 1);
        p->width[i] = 0;
        if (count <= OWN_TABLES) continue;
        put_static(p, OWN_TABLES + 1, bin);
        p->rest[i] = p->lower[i] - bin_edge(count, bin);
        p->width[i] = bin_edge(count, bin + 1) - bin_edge(count, bin);
    }
    close_group(p, from);
    for (;;) {
        int64_t next = INT64_MAX;
        for (int64_t i = 0; i < nodes; i++)
            if (p->width[i] > width && p->width[i] < next) next = p->width[i];
        if (next == INT64_MAX) return;
        width = next;
        write_rests(p, width, nodes);
    }
}

/* The nodes that are left once anchors that are alone are set apart, and how many of each lie in its lower half. */
static int64_t several(WrittenPositions *p, int64_t nodes, int64_t bit) {
    int64_t left = 0;
    for (int64_t i = 0; i < nodes; i++) {
        const int64_t start = p->here.start[i], count = p->here.count[i];
        if (count == 1) {
            p->open[start] = (uint8_t)(bit + 1);
            continue;
        }
        p->here.start[left] = start, p->here.count[left] = count;
        p->lower[left++] = count_lower(p->codes + start, count, bit);
    }
    return left;
}

/* The halves that hold anything. */
static int64_t halves(WrittenPositions *p, int64_t nodes) {
    int64_t made = 0;
    for (int64_t i = 0; i < nodes; i++) {
        const int64_t start = p->here.start[i], count = p->here.count[i], lower = p->lower[i];
        if (lower) p->below.start[made] = start, p->below.count[made++] = lower;
        if (count > lower) p->below.start[made] = start + lower, p->below.count[made++] = count - lower;
    }
    const Nodes above = p->here;
    p->here = p->below, p->below = above;
    return made;
}

/* The bits left of anchors that are alone, those with most bits left first. */
static void write_open(WrittenPositions *p) {
    int64_t counts[256] = {0};
    for (int64_t i = 0; i < p->total; i++) counts[p->open[i]]++;
    for (int64_t width = 3 * p->bits; width > 0; width--)
        for (int64_t low = CHUNK * ((width - 1) / CHUNK); counts[width] && low >= 0; low -= CHUNK) {
            const int64_t from = p->symbols, size = 1 << (width - low < CHUNK ? width - low : CHUNK);
            open_group(p, size);
            for (int64_t i = 0; i < p->total; i++)
                if (p->open[i] == width) put_uniform_value(p, (int64_t)(p->codes[i] >> low & (uint64_t)(size - 1)));
            close_group(p, from);
        }
}

/* Writes the codes of total >= 1 anchors, or counts what that takes. */
EXPORT void scar_positions_groups(WrittenPositions *p) {
    int64_t nodes = 1;
    p->groups = p->statics = p->symbols = 0;
    p->here.start[0] = 0, p->here.count[0] = p->total;
    for (int64_t i = 0; i < p->total; i++) p->open[i] = 0;
    for (int64_t bit = 3 * p->bits - 1; bit >= 0 && nodes; bit--) {
        nodes = several(p, nodes, bit);
        write_splits(p, nodes);
        nodes = halves(p, nodes);
    }
    write_open(p);
}

/* Reads the codes of total >= 1 anchors: ALL_READ, BAD_BIN, BAD_REST, BAD_SPLIT, or a kind that has no table. */
EXPORT int64_t scar_positions(Rans *rans, Positions *p, const Tables *tables) {
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
