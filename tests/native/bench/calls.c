/* bench_calls.awl as C. */
#include "plc.h"

static void fc1(const uint8_t *x, int16_t y, uint8_t *result)
{
    int16_t t = (int16_t)(word(x) + y);
    put_word(result, (int16_t)(t + 1));
}

/* The instance: set 0.0, v 2, q 4, n 6, e 8.0. */
static void fb1(uint8_t *self)
{
    int set = bit(self, 0), rising = set & !bit(self + 8, 0);
    put_bit(self + 8, 0, set);
    if (rising)
        put_word(self + 6, word(self + 2));
    put_word(self + 6, (int16_t)(word(self + 6) + 1));
    put_word(self + 4, word(self + 6));
}

#define PAIR(k)                                                                                              \
    do {                                                                                                     \
        fc1(memory + 20 + 2 * (k), 3, memory + 22 + 2 * (k));                                                \
        put_bit(db, 0, M(0, (k) % 8));                                                                       \
        put_word(db + 2, MW(20 + 2 * (k)));                                                                  \
        fb1(db);                                                                                             \
        PUT_MW(60 + 2 * (k), word(db + 4));                                                                  \
    } while (0)

void ob1(void)
{
    for (int16_t i = 20; i != 0; i--) {
        PUT_MW(200, i);
        PAIR(0); PAIR(1); PAIR(2); PAIR(3); PAIR(4); PAIR(5); PAIR(6); PAIR(7); PAIR(8); PAIR(9);
    }
}
