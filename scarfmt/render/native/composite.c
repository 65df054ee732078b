/* Which vectors the processor at hand has, and how threads share the work. */

#include <string.h>

#include "composite.h"
#include "numbers.h"

/* Grows with every change of Job or of what its arrays hold: binding.py loads no other. */
#define INTERFACE 4

EXPORT int64_t scar_render_interface(void) { return INTERFACE; }
EXPORT int64_t scar_render_structs(void) {
    return sizeof(Job) + sizeof(Lens) + sizeof(Outlook) + sizeof(Scene) + sizeof(Splat);
}

static int plain = 0;

/* Whether to do without wide vectors, which are as exact, and faster. */
EXPORT void scar_render_plainly(int64_t wanted) { plain = wanted != 0; }

static const Pass *tiles_at_hand(void) {
#if WIDE_TILES
    if (!plain && __builtin_cpu_supports("avx2")) return tiles_avx2;
#endif
    return tiles_plain;
}

/* Does one of the passes over the tiles that it takes: numbers from `next` up. */
EXPORT void scar_composite(const Job *job, int64_t pass, int64_t *next) {
    Pass work = tiles_at_hand()[pass];
    for (int64_t tile; (tile = __atomic_fetch_add(next, 1, __ATOMIC_RELAXED)) < job->tiles;) work(job, tile);
}

/* Fills the gradients of what splats `first` to `past` were made of, from the gradients of their intersections: of the
ellipses (across, slope, down) in the order of the splats, of the others where `which` says. */
EXPORT void scar_composite_gather(const float *gradients, const int64_t *starts, const int64_t *which, const Splat *splats,
                                  int64_t first, int64_t past, float *ellipses, float *means, float *opacities,
                                  float *colours) {
    for (int64_t i = first; i < past; i++) {
        float sums[GRADIENTS] = {0};
        for (int64_t r = starts[i]; r < starts[i + 1]; r++)
            for (int64_t c = 0; c < GRADIENTS; c++) sums[c] += gradients[r * GRADIENTS + c];
        const float *moments = sums + 3;
        float across = splats[i].ellipse.across, slope = splats[i].ellipse.slope, down = splats[i].ellipse.down;
        ellipses[3 * i] = -0.5f * moments[3];
        ellipses[3 * i + 1] = across * moments[2];
        ellipses[3 * i + 2] = -0.5f * moments[5];
        means[2 * which[i]] = across * moments[1];
        means[2 * which[i] + 1] = down * moments[4] - slope * across * moments[1];
        opacities[which[i]] = moments[0] * (float)exp_of(-0.6931471805599453 * splats[i].ellipse.log_opacity);
        for (int64_t c = 0; c < 3; c++) colours[3 * which[i] + c] = sums[c];
    }
}

/* Fills the (count, MEASURES) sums of the `measures` of each splat, of the last the largest; those without a weight are 0. */
EXPORT void scar_composite_measures(const float *weights, const float *measures, const int64_t *starts, int64_t count,
                                    double *sums) {
    memset(sums, 0, sizeof *sums * MEASURES * count);
    for (int64_t i = 0; i < count; i++)
        for (int64_t r = starts[i]; r < starts[i + 1]; r++) {
            const float *found = measures + MEASURES * r;
            double *sum = sums + MEASURES * i;
            if (!(weights[r] > 0)) continue;
            sum[0] += found[0], sum[1] += found[1];
            if (found[2] > sum[2]) sum[2] = found[2];
        }
}
