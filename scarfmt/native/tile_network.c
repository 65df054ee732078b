/* Indices of a tile-layer by the index network (SPEC 10.5, 10.6). */

#include "network.h"
#include "tile.h"

int64_t scar_indices(Rans *rans, const Network *net, Indices *s);
void scar_grid(const Grid *grid, const int64_t *positions, int64_t n, int16_t *out);

/* Features of the anchors whose indices are read, at their lattice points (R-10.6-3). */
static int16_t *grid_features(const Work *w, Pool *pool, const int64_t *before, const int64_t *after) {
    const Grid *grid = &w->m->grid;
    const int64_t n = w->t->known, shift = w->t->shift;
    int16_t *features = pool_zeros(pool, 2 * n * grid->width);
    if (!grid->levels) return features;
    for (int64_t i = 0; i < n; i++) {
        int64_t point[3];
        if (before[i] >= after[i]) continue;
        for (int axis = 0; axis < 3; axis++) {
            const int64_t cell = coordinate(w->t->codes[i] >> axis) << shift;
            point[axis] = w->t->corner[axis] + cell + ((int64_t)1 << shift >> 1);
        }
        scar_grid(grid, point, 1, features + i * grid->width);
    }
    return features;
}

void read_network_indices(Work *w, Rans *rans) {
    Pool *pool = &channel_scratch;
    const NetworkModel *net = w->m->network;
    if (!w->t->known) return;
    pool_empty(pool, 1);
    look_at_cells(w);
    const int64_t *before = by_anchor(w, pool, w->m->rows[w->k - 1].stages);
    const int64_t *after = by_anchor(w, pool, w->m->rows[w->k].stages);
    int64_t stages = 0;
    for (int64_t i = 0; i < w->t->known; i++)
        if (before[i] < after[i] && after[i] > stages) stages = after[i];
    if (!stages) return;
    Indices s = {.count = w->t->known, .stages = w->t->stages, .classes = w->t->classes, .settled = w->settled,
                 .features = grid_features(w, pool, before, after), .indices = w->t->indices, .before = before,
                 .after = after, .by_code = w->by_code, .passes_log2 = w->m->passes_log2,
                 .cells = cells_of(w, pool, net->attributes + net->latents)};
    lend_network(net, pool, &s, stages);
    if (net->attention)
        attentive_indices(rans, net, &s, pool);
    else
        demand(scar_indices(rans, &net->packed, &s) == ALL_READ, "bad-index");
}
