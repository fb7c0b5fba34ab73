/* bench_timers.awl as C. */
#include "plc.h"

enum kind { PULSE, EXTENDED, ON_DELAY, RETENTIVE, OFF_DELAY };

struct timer {
    enum kind kind;
    uint8_t running, started, latched;
    uint16_t base, rest;
    uint64_t end;
};

struct counter {
    uint16_t value;
    uint8_t up, down;
};

static struct timer timers[256];
static struct counter counters[256];
static const uint64_t units[4] = { 10000000, 100000000, 1000000000, 10000000000 };

static uint16_t remaining(const struct timer *t)
{
    if (!t->running)
        return t->rest;
    uint64_t left = t->end > now ? t->end - now : 0;
    left = (left + units[t->base] - 1) / units[t->base];
    return left < 999 ? (uint16_t)left : 999;
}

static void settle(struct timer *t)
{
    if (t->running && now >= t->end) {
        t->running = 0;
        t->rest = 0;
        t->latched |= t->kind == ON_DELAY || t->kind == RETENTIVE;
    }
}

static void start(struct timer *t, uint16_t digits)
{
    t->base = 0;
    t->end = now + digits * units[0];
    t->rest = digits;
    t->running = 1;
    t->latched = 0;
    settle(t);
}

static void timer(struct timer *t, enum kind kind, int on, uint16_t digits)
{
    settle(t);
    int rising = on && !t->started, falling = !on && t->started;
    t->started = (uint8_t)on;
    t->kind = kind;
    switch (kind) {
    case PULSE:
    case ON_DELAY:
        if (rising) {
            start(t, digits);
        } else if (!on) {
            t->latched = 0;
            if (t->running) {
                t->rest = remaining(t);
                t->running = 0;
            }
        }
        break;
    case EXTENDED:
        if (rising)
            start(t, digits);
        break;
    case RETENTIVE:
        if (rising && !t->latched)
            start(t, digits);
        break;
    case OFF_DELAY:
        if (falling) {
            start(t, digits);
        } else if (rising) {
            t->running = 0;
            t->rest = 0;
            t->latched = 1;
        }
        break;
    }
}

static int output(const struct timer *t)
{
    int runs = t->running && now < t->end;
    switch (t->kind) {
    case PULSE:
    case EXTENDED:
        return runs;
    case OFF_DELAY:
        return t->latched || runs;
    default:
        return t->latched || (t->running && now >= t->end);
    }
}

static void up(struct counter *c, int on)
{
    if (on && !c->up && c->value < 999)
        c->value++;
    c->up = (uint8_t)on;
}

static void down(struct counter *c, int on)
{
    if (on && !c->down && c->value > 0)
        c->value--;
    c->down = (uint8_t)on;
}

#define STEP(n, kind)                                                                                        \
    do {                                                                                                     \
        timer(&timers[n], kind, !M(1, (n) % 8), 10 + (n));                                                   \
        PUT_M(2, (n) % 8, output(&timers[n]));                                                               \
        up(&counters[n], M(2, (n) % 8));                                                                     \
        down(&counters[n], E(0, (n) % 8));                                                                   \
        PUT_MW(20, (int16_t)counters[n].value);                                                              \
        PUT_MW(22, (int16_t)remaining(&timers[n]));                                                          \
        PUT_M(1, (n) % 8, !output(&timers[n]));                                                              \
    } while (0)
#define FIVE(n)                                                                                              \
    STEP(n, ON_DELAY); STEP((n) + 1, PULSE); STEP((n) + 2, EXTENDED); STEP((n) + 3, RETENTIVE);              \
    STEP((n) + 4, OFF_DELAY)

void ob1(void)
{
    for (int16_t i = 50; i != 0; i--) {
        PUT_MW(200, i);
        FIVE(0); FIVE(5); FIVE(10);
        STEP(15, ON_DELAY);
    }
}
