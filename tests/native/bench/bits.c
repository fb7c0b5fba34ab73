/* bench_bits.awl as C. */
#include "plc.h"

#define NET(b, n)                                                                                            \
    do {                                                                                                     \
        int q = (E(b, n) & !M((b) + 10, n)) | (M((b) + 11, n) & E((b) + 1, n));                              \
        q &= (M((b) + 20, n) | !A(b, n)) ^ M((b) + 12, n);                                                   \
        put_bit(outputs + (b), n, q);                                                                        \
    } while (0)
#define EDGE(b, n)                                                                                           \
    do {                                                                                                     \
        int q = A(b, n), edge = q & !M((b) + 40, n);                                                         \
        PUT_M((b) + 40, n, q);                                                                               \
        if (edge)                                                                                            \
            PUT_M((b) + 10, n, 1);                                                                           \
        if (E(b, n))                                                                                         \
            PUT_M((b) + 10, n, 0);                                                                           \
    } while (0)
#define BYTE(b)                                                                                              \
    NET(b, 0); EDGE(b, 0); NET(b, 1); NET(b, 2); NET(b, 3);                                                  \
    NET(b, 4); EDGE(b, 4); NET(b, 5); NET(b, 6); NET(b, 7)

void ob1(void)
{
    for (int16_t i = 50; i != 0; i--) {
        PUT_MW(200, i);
        BYTE(0); BYTE(1); BYTE(2); BYTE(3); BYTE(4);
    }
}
