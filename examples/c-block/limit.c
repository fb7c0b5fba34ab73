/* Two blocks in C: FC 210 LIMIT keeps a value within bounds, FB 211 RATE counts how often it had to.
 *
 *     CALL FC 210 (IN := MW 10, MN := -500, MX := 500, OUT := MW 12, CLIPPED := M 1.0);
 */
#include "ob1.h"

#define TEXT(s) { (const uint8_t *)(s), sizeof(s) - 1 }
#define NONE { NULL, 0 }
#define PARAM(name, aliases, section, ty) \
    { sizeof(struct Ob1ParamDesc), TEXT(name), aliases, section, ty, 0, 0 }

/* Parameters are numbers: their place in the list. */
enum { LIMIT_IN, LIMIT_MN, LIMIT_MX, LIMIT_OUT, LIMIT_CLIPPED };

static const struct Ob1ParamDesc limit_params[] = {
    PARAM("IN", NONE, OB1_SECTION_IN, OB1_TY_INT),
    PARAM("MN", TEXT("MIN"), OB1_SECTION_IN, OB1_TY_INT),
    PARAM("MX", TEXT("MAX"), OB1_SECTION_IN, OB1_TY_INT),
    PARAM("OUT", NONE, OB1_SECTION_OUT, OB1_TY_INT),
    PARAM("CLIPPED", NONE, OB1_SECTION_OUT, OB1_TY_BOOL),
};

/* Every status that is not OB1_OK leaves the block; OB1_ABORT must. */
#define TRY(call) do { Ob1Status status = (call); if (status != OB1_OK) return status; } while (0)

static Ob1Status limit(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    uint32_t in, mn, mx;
    (void)state;
    TRY(host->param_get(call, LIMIT_IN, &in));
    TRY(host->param_get(call, LIMIT_MN, &mn));
    TRY(host->param_get(call, LIMIT_MX, &mx));
    int16_t value = (int16_t)in, low = (int16_t)mn, high = (int16_t)mx;
    if (low > high) {
        static const char text[] = "FC 210 LIMIT: MN is above MX";
        struct Ob1Text message = { (const uint8_t *)text, sizeof text - 1 };
        return host->stop(call, message);
    }
    int16_t out = value < low ? low : value > high ? high : value;
    TRY(host->param_set(call, LIMIT_OUT, (uint16_t)out));
    return host->param_set(call, LIMIT_CLIPPED, out != value);
}

enum { RATE_CLIPPED, RATE_COUNT };

/* The instance: CLIPPED 0.0, COUNT 2, LAST 4.0. */
#define RATE_LAST (4 * 8)

static const struct Ob1ParamDesc rate_params[] = {
    PARAM("CLIPPED", NONE, OB1_SECTION_IN, OB1_TY_BOOL),
    PARAM("COUNT", NONE, OB1_SECTION_OUT, OB1_TY_WORD),
    PARAM("LAST", NONE, OB1_SECTION_STATIC, OB1_TY_BOOL),
};

static Ob1Status rate(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state) {
    uint32_t clipped, count;
    uint8_t last;
    (void)state;
    TRY(host->param_get(call, RATE_CLIPPED, &clipped));
    TRY(host->bit_get(call, OB1_AREA_INSTANCE, 0, RATE_LAST, &last));
    if (clipped && !last) {
        TRY(host->param_get(call, RATE_COUNT, &count));
        TRY(host->param_set(call, RATE_COUNT, (count + 1) & 0xFFFF));
    }
    return host->bit_set(call, OB1_AREA_INSTANCE, 0, RATE_LAST, (uint8_t)clipped);
}

static const struct Ob1BlockDesc blocks[] = {
    { sizeof(struct Ob1BlockDesc), OB1_KIND_FC, 0, 210, TEXT("LIMIT"), limit_params, 5, 0, limit },
    { sizeof(struct Ob1BlockDesc), OB1_KIND_FB, 0, 211, TEXT("RATE"), rate_params, 3, 0, rate },
};

static const struct Ob1PluginTable table = {
    sizeof(struct Ob1PluginTable), OB1_ABI_MAJOR, OB1_ABI_MINOR, TEXT("c-block"), TEXT("1.0"), blocks, 2, 0, NULL, NULL,
};

const struct Ob1PluginTable *ob1_plugin(void) {
    return &table;
}
