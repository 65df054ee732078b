#include "numbers.h"

#include "rans.h"
#include "tile.h"

#define ONE 65536 /* the unit of probabilities */
#define MOST_SEEN 30
#define MOST_NUMBER_SHIFT 31
#define MOST_SHIFTED 2147483647

Numbers open_numbers(Model *m, Body block) { return (Numbers){open_stream(block), &m->numbers_left}; }

void seal_numbers(const Numbers *numbers) { seal_stream(&numbers->rans); }

void spend(Numbers *numbers, int64_t n) {
    *numbers->left -= n;
    demand(*numbers->left >= 0, "limit-expansion");
}

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

uint32_t next_number(Numbers *numbers, NumberModel *model) {
    Rans *rans = &numbers->rans;
    int length = 0;
    while (read_bit(rans, model->prefix + length)) demand(++length < MOST_NUMBER_BITS, "bad-number");
    uint32_t value = length ? 2 + read_bit(rans, model->second + length) : 1;
    for (int i = 1; i < length; i++) value = 2 * value + read_even_bit(rans);
    return value - 1;
}

int64_t next_signed(Numbers *numbers, NumberModel *model) {
    const int64_t number = next_number(numbers, model);
    return number & 1 ? -(number >> 1) - 1 : number >> 1;
}

float float_of(uint32_t bits) {
    float out;
    memcpy(&out, &bits, 4);
    return out;
}

float next_f32(Numbers *numbers, NumberModel *model) { return float_of(next_number(numbers, model)); }

int64_t read_limited(Numbers *numbers, NumberModel *model, int64_t most) {
    spend(numbers, 1);
    const int64_t number = next_number(numbers, model);
    demand(number <= most, "count-limit");
    return number;
}

int64_t read_once(Numbers *numbers, int64_t most) { return read_limited(numbers, &(NumberModel){0}, most); }

int32_t *read_array(Numbers *numbers, NumberModel *model, Pool *pool, int64_t n, int64_t shift, int64_t most,
                    const char *id) {
    spend(numbers, n);
    int32_t *out = pool_take(pool, 4 * n);
    int fits = 1;
    for (int64_t i = 0; i < n; i++) {
        const int64_t value = next_signed(numbers, model) * ((int64_t)1 << shift);
        fits &= value >= -most && value <= most;
        out[i] = (int32_t)value;
    }
    demand(fits, id);
    return out;
}

int32_t *read_shifted(Numbers *numbers, ShiftedModel *model, Pool *pool, int64_t n) {
    const int64_t shift = read_limited(numbers, &model->shift, MOST_NUMBER_SHIFT);
    return read_array(numbers, &model->values, pool, n, shift, MOST_SHIFTED, "bad-number");
}
