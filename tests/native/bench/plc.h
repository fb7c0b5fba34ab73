/* What the six programs share: a CPU's memory, in the byte order of STEP 7, and a main that runs OB 1.
 *
 *     PROGRAM CALLS ROUNDS
 *
 * runs OB 1 so many times and prints bit memory and data block as hexadecimal lines; then it runs it that often again in
 * each round, and prints the nanoseconds of one OB 1 in the best round. Time moves by 7 ms for each OB 1. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

uint8_t inputs[128], outputs[128], memory[256], db[604];
uint64_t now;
void ob1(void);

static inline int16_t word(const uint8_t *at)
{
    uint16_t v;
    memcpy(&v, at, 2);
    return (int16_t)__builtin_bswap16(v);
}

static inline void put_word(uint8_t *at, int16_t value)
{
    uint16_t v = __builtin_bswap16((uint16_t)value);
    memcpy(at, &v, 2);
}

static inline int32_t dword(const uint8_t *at)
{
    uint32_t v;
    memcpy(&v, at, 4);
    return (int32_t)__builtin_bswap32(v);
}

static inline void put_dword(uint8_t *at, int32_t value)
{
    uint32_t v = __builtin_bswap32((uint32_t)value);
    memcpy(at, &v, 4);
}

static inline float real(const uint8_t *at)
{
    int32_t v = dword(at);
    float f;
    memcpy(&f, &v, 4);
    return f;
}

static inline void put_real(uint8_t *at, float value)
{
    int32_t v;
    memcpy(&v, &value, 4);
    put_dword(at, v);
}

static inline int bit(const uint8_t *at, int n)
{
    return *at >> n & 1;
}

static inline void put_bit(uint8_t *at, int n, int value)
{
    *at = (uint8_t)((*at & ~(1 << n)) | value << n);
}

#define E(byte, n) bit(inputs + (byte), n)
#define A(byte, n) bit(outputs + (byte), n)
#define M(byte, n) bit(memory + (byte), n)
#define PUT_M(byte, n, value) put_bit(memory + (byte), n, value)
#define MW(byte) word(memory + (byte))
#define PUT_MW(byte, value) put_word(memory + (byte), value)

static void show(const char *name, const uint8_t *bytes, int count)
{
    printf("%s ", name);
    for (int i = 0; i < count; i++)
        printf("%02x", bytes[i]);
    printf("\n");
}

static void run(long calls)
{
    for (long i = 0; i < calls; i++) {
        now += 7000000;
        ob1();
        __asm__ volatile("" ::: "memory");
    }
}

int main(int argc, char **argv)
{
    long calls = argc > 1 ? atol(argv[1]) : 3, rounds = argc > 2 ? atol(argv[2]) : 0;
    double best = 0;
    run(calls);
    show("M", memory, sizeof memory);
    show("DB", db, 600);
    for (long i = 0; i < rounds; i++) {
        struct timespec from, to;
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &from);
        run(calls);
        clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &to);
        double one = ((double)(to.tv_sec - from.tv_sec) * 1e9 + (double)(to.tv_nsec - from.tv_nsec)) / (double)calls;
        if (i == 0 || one < best)
            best = one;
    }
    printf("ns %f\n", best);
    return 0;
}
