/* What a native block must not do: FC 230 ALLOCATES, FC 231 CALLS the kernel, FC 232 NEVER_RETURNS, FC 233 CRASHES. They break the scan's guards, to
 * prove that these can fail.
 */
#include "ob1.h"

#include <stdlib.h>
#include <unistd.h>

#define TEXT(s) { (const uint8_t *)(s), sizeof(s) - 1 }

/* Volatile: else the compiler sees through a block that is given back at once. */
static void *volatile kept;

static Ob1Status allocates(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    (void)host, (void)call, (void)state;
    kept = malloc(100);
    free(kept);
    return OB1_OK;
}

static Ob1Status calls_the_kernel(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    (void)host, (void)call, (void)state;
    return getppid() < 0 ? OB1_BAD_ARGUMENT : OB1_OK;
}

static Ob1Status never_returns(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    (void)host, (void)call, (void)state;
    volatile int for_ever = 1;
    while (for_ever) {
    }
    return OB1_OK;
}

static Ob1Status crashes(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    (void)host, (void)call, (void)state;
    int *volatile nowhere = NULL;
    return *nowhere ? OB1_BAD_ARGUMENT : OB1_OK;
}

#define BLOCK(number, name, entry) \
    { sizeof(struct Ob1BlockDesc), OB1_KIND_FC, 0, number, TEXT(name), NULL, 0, 0, entry }

static const struct Ob1BlockDesc blocks[] = {
    BLOCK(230, "ALLOCATES", allocates),
    BLOCK(231, "CALLS_THE_KERNEL", calls_the_kernel),
    BLOCK(232, "NEVER_RETURNS", never_returns),
    BLOCK(233, "CRASHES", crashes),
};

static const struct Ob1PluginTable table = {
    sizeof(struct Ob1PluginTable), OB1_ABI_MAJOR, OB1_ABI_MINOR, TEXT("scan-blocks"), TEXT("1"), blocks, 4, 0, NULL, NULL,
};

const struct Ob1PluginTable *ob1_plugin(void) {
    return &table;
}
