/* FC 233 TAKES_TIME: fifty million turns of a loop the compiler must not shorten, a cycle of any processor for each at least. */
#include "ob1.h"

#define TEXT(s) { (const uint8_t *)(s), sizeof(s) - 1 }
#define TURNS 50000000u

static Ob1Status takes_time(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    (void)host, (void)call, (void)state;
    for (volatile uint32_t turn = 0; turn < TURNS; turn++) {
    }
    return OB1_OK;
}

static const struct Ob1BlockDesc blocks[] = {
    { sizeof(struct Ob1BlockDesc), OB1_KIND_FC, 0, 233, TEXT("TAKES_TIME"), NULL, 0, 0, takes_time },
};

static const struct Ob1PluginTable table = {
    sizeof(struct Ob1PluginTable), OB1_ABI_MAJOR, OB1_ABI_MINOR, TEXT("timing-blocks"), TEXT("1"), blocks, 1, 0, NULL, NULL,
};

const struct Ob1PluginTable *ob1_plugin(void) {
    return &table;
}
