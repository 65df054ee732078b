#include "numbers.h"

#include "fault.h"
#include "rans.h"

#define ONE 65536 /* the unit of probabilities */
#define MOST_SEEN 30

static uint32_t read_bit(Rans *rans, BitModel *model) {
    const int32_t zero = ONE / 2 + model->lean, part = model->seen + 2;
    const uint32_t slot = (uint32_t)rans->state & SLOT_MASK, second = (uint32_t)zero * (TOTAL / ONE);
    const uint32_t bit = slot >= second;
    model->lean = (int16_t)(model->lean + (bit ? -(zero / part) : (ONE - zero) / part));
    model->seen = (int16_t)(model->seen + (model->seen < MOST_SEEN));
    advance(rans, slot, bit ? second : 0, bit ? TOTAL : second);
    return bit;
}

static uint32_t read_even_bit(Rans *rans) {
    const uint32_t slot = (uint32_t)rans->state & SLOT_MASK, bit = slot >= TOTAL / 2;
    advance(rans, slot, bit * (TOTAL / 2), (bit + 1) * (TOTAL / 2));
    return bit;
}

uint32_t read_number(Rans *rans, NumberModel *model) {
    int length = 0;
    while (read_bit(rans, model->prefix + length)) demand(++length < MOST_NUMBER_BITS, "bad-number");
    uint32_t value = length ? 2 + read_bit(rans, model->second + length) : 1;
    for (int i = 1; i < length; i++) value = 2 * value + read_even_bit(rans);
    return value - 1;
}

int64_t read_signed(Rans *rans, NumberModel *model) {
    const int64_t number = read_number(rans, model);
    return number & 1 ? -(number >> 1) - 1 : number >> 1;
}

float read_f32(Rans *rans, NumberModel *model) {
    const uint32_t bits = read_number(rans, model);
    float out;
    memcpy(&out, &bits, 4);
    return out;
}

int64_t read_limited(Rans *rans, NumberModel *model, int64_t most) {
    const int64_t number = read_number(rans, model);
    demand(number <= most, "count-limit");
    return number;
}
