/* bench_real.awl as C. */
#include "plc.h"

#define STEP(n)                                                                                              \
    do {                                                                                                     \
        put_real(memory + 108, real(memory + 104) * 1.001f + 0.25f);                                         \
        put_real(memory + 104, sqrtf(fabsf(real(memory + 108) - real(memory + 104)) / 3.0f));                \
        PUT_M(0, (n) % 8, real(memory + 108) > 2.0f);                                                        \
        put_dword(memory + 112, (int32_t)lrintf(real(memory + 108)));                                        \
        put_real(memory + 116, (float)dword(memory + 112));                                                  \
    } while (0)

void ob1(void)
{
    for (int16_t i = 50; i != 0; i--) {
        PUT_MW(200, i);
        /* Of the counter: no compiler can calculate what follows. */
        put_real(memory + 104, (float)i / 32.0f);
        STEP(0); STEP(1); STEP(2); STEP(3); STEP(4); STEP(5); STEP(6); STEP(7); STEP(8); STEP(9);
        STEP(10); STEP(11); STEP(12); STEP(13); STEP(14); STEP(15); STEP(16); STEP(17); STEP(18); STEP(19);
    }
}
