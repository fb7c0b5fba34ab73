/* bench_int.awl as C. */
#include "plc.h"

#define STEP(k)                                                                                              \
    do {                                                                                                     \
        const int w = 20 + 2 * (k);                                                                          \
        PUT_MW(w, (int16_t)(MW(w) + (k) + 1));                                                               \
        int16_t product = (int16_t)((int16_t)(MW(w) - MW(w + 2)) * 3);                                       \
        PUT_MW(w, product);                                                                                  \
        PUT_MW(w + 2, (int16_t)((uint16_t)(product / 7) << 2 & 0x0FF0));                                     \
        put_dword(memory + 100, (int32_t)((uint32_t)dword(memory + 100) + 12345));                           \
        if (MW(w) > 100)                                                                                     \
            PUT_MW(w, (int16_t)((MW(w) & 0xFF00) | ((MW(w) + 1) & 0xFF)));                                   \
    } while (0)

void ob1(void)
{
    for (int16_t i = 50; i != 0; i--) {
        PUT_MW(200, i);
        STEP(0); STEP(1); STEP(2); STEP(3); STEP(4); STEP(5); STEP(6); STEP(7); STEP(8); STEP(9);
        STEP(10); STEP(11); STEP(12); STEP(13); STEP(14); STEP(15); STEP(16); STEP(17); STEP(18); STEP(19);
    }
}
