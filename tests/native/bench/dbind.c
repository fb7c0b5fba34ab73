/* bench_dbind.awl as C. A place that is computed is checked, as compilers of PLC languages do it for arrays. */
#include "plc.h"

static void outside(void)
{
    fputs("outside of the data block\n", stderr);
    exit(1);
}

static inline uint8_t *at(uint32_t byte, uint32_t bytes)
{
    if (byte + bytes > 600)
        outside();
    return db + byte;
}

#define STEP(k)                                                                                              \
    do {                                                                                                     \
        put_word(at(p + 2 * (k), 2), (int16_t)(word(at(p + 2 * (k), 2)) + word(at(p + 2 * (k) + 2, 2))));    \
        put_bit(at(p + 1, 1), k, bit(at(p, 1), k));                                                          \
        p += 4;                                                                                              \
    } while (0)

void ob1(void)
{
    for (int16_t i = 4; i != 0; i--) {
        PUT_MW(200, i);
        for (int16_t j = 50; j != 0; j--) {
            PUT_MW(202, j);
            put_dword(memory + 204, (int32_t)((uint32_t)(uint16_t)MW(202) << 5));
            uint32_t pointer = (uint32_t)dword(memory + 204);
            uint8_t *w = at((pointer & 0x7FFFF) >> 3, 2);
            put_word(w, (int16_t)(word(w) + 1));
            uint32_t p = 0;
            STEP(0); STEP(1); STEP(2); STEP(3); STEP(4); STEP(5); STEP(6); STEP(7);
            put_word(db + 2, word(db));
        }
    }
}
