/* FC 234 LEAVES: ends the whole process, by exit() or as LEAVE names it, and says that all is well. What LOADING says is
   done when the library is loaded. */
#include <stdlib.h>
#include <unistd.h>

#include "ob1.h"

#define TEXT(s) { (const uint8_t *)(s), sizeof(s) - 1 }

#ifndef LEAVE
#define LEAVE exit
#endif

#ifdef LOADING
__attribute__((constructor)) static void loading(void) {
    LOADING;
}
#endif

static Ob1Status leaves(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    (void)host, (void)call, (void)state;
    LEAVE(0);
    return OB1_OK;
}

static const struct Ob1BlockDesc blocks[] = {
    { sizeof(struct Ob1BlockDesc), OB1_KIND_FC, 0, 234, TEXT("LEAVES"), NULL, 0, 0, leaves },
};

static const struct Ob1PluginTable table = {
    sizeof(struct Ob1PluginTable), OB1_ABI_MAJOR, OB1_ABI_MINOR, TEXT("exit-block"), TEXT("1"), blocks, 1, 0, NULL, NULL,
};

const struct Ob1PluginTable *ob1_plugin(void) {
    return &table;
}
