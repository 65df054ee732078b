/* Networks in binary32 (SPEC 7.9), four vectors at a time. */

#include "gaussians.h"

typedef float Rows __attribute__((vector_size(4 * FILLED), aligned(4), may_alias));

int64_t mlp_width(const Mlp *network) {
    int64_t most = 0;
    for (int64_t l = 0; l < network->layers; l++)
        most = network->layer[l].stride > most ? network->layer[l].stride : most;
    return most;
}

WIDE void apply_mlp_layer(const MlpLayer *layer, const float *x, int64_t apart, float *y) {
    const int64_t stride = layer->stride;
    const float *x1 = x + apart, *x2 = x1 + apart, *x3 = x2 + apart;
    for (int64_t r = 0; r < stride; r += FILLED) {
        const Rows bias = *(const Rows *)(layer->biases + r);
        const float *weights = layer->weights + r;
        Rows a = bias, b = bias, c = bias, d = bias;
        for (int64_t k = 0; k < layer->columns; k++, weights += stride) {
            const Rows weight = *(const Rows *)weights;
            a += weight * x[k], b += weight * x1[k], c += weight * x2[k], d += weight * x3[k];
        }
        float *out = y + r;
        *(Rows *)out = a, *(Rows *)(out + stride) = b, *(Rows *)(out + 2 * stride) = c, *(Rows *)(out + 3 * stride) = d;
    }
}

const float *apply_mlp(const Mlp *network, const float *x, int64_t apart, float *room) {
    float *y = room, *next = room + FLOATS * mlp_width(network);
    for (int64_t l = 0; l < network->layers; l++) {
        const MlpLayer *layer = network->layer + l;
        apply_mlp_layer(layer, x, apart, y);
        for (int64_t i = 0; l + 1 < network->layers && i < FLOATS * layer->stride; i += 4)
            store4(y + i, most4(load4(y + i), all4(0)));
        x = y, apart = layer->stride;
        y = next, next = (float *)x;
    }
    return x;
}
