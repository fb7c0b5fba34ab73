/* Blocks for ob1 in C: what plugin and host agree on. docs/plugins.md tells how to use it.
 *
 * Generated from plugins/sdk/src/abi; see plugins/sdk/tests/header.rs. */


#ifndef OB1_H
#define OB1_H

#include <stddef.h>
#include <stdint.h>
struct Ob1PluginTable;

#ifdef __cplusplus
extern "C"
#endif
// The one function a plugin exports. What it returns is constant and lives as long as the plugin.
const struct Ob1PluginTable *ob1_plugin(void);


// The interface's major version; plugin and host must have the same.
#define OB1_ABI_MAJOR 1

// The minor version: grows with additions. 1: a plugin's block may be an SFB or an SFC.
#define OB1_ABI_MINOR 1

// Block kinds, `BlockDesc::kind`: organization block.
#define OB1_KIND_OB 0

// Function block: it has an instance data block.
#define OB1_KIND_FB 1

// Function: a block without instance.
#define OB1_KIND_FC 2

// System function block. Of a plugin's own blocks since 1.1.
#define OB1_KIND_SFB 3

// System function. Of a plugin's own blocks since 1.1.
#define OB1_KIND_SFC 4

// Sections, `ParamDesc::section`: `VAR_INPUT`, read by the block.
#define OB1_SECTION_IN 0

// `VAR_OUTPUT`, written by the block.
#define OB1_SECTION_OUT 1

// `VAR_IN_OUT`, read and written by the block.
#define OB1_SECTION_IN_OUT 2

// Instance data of an FB or SFB that is not a parameter.
#define OB1_SECTION_STATIC 3

// The function value `RET_VAL` of an FC or SFC. Its index is its place among the parameters, as that of the others.
#define OB1_SECTION_RETURN 4

// Areas of `HostTable::area_read`: inputs (process image).
#define OB1_AREA_E 0

// Outputs A (Q), in the process image.
#define OB1_AREA_A 1

// Bit memory M, by byte address.
#define OB1_AREA_M 2

// A data block, by number.
#define OB1_AREA_DB 3

// The block's instance data (FB), from its first byte; multi-instances included.
#define OB1_AREA_INSTANCE 4

// Local data of the calling block (the block that called this one), for pointers with area code 87h.
#define OB1_AREA_L 5

// Timer kinds of `HostTable::timer_run`: `SI`, pulse.
#define OB1_TIMER_PULSE 0

// `SV`, extended pulse: runs its whole time.
#define OB1_TIMER_EXTENDED_PULSE 1

// `SE`, on-delay: needs 1 while it runs.
#define OB1_TIMER_ON_DELAY 2

// `SS`, retentive on-delay: runs on without its 1.
#define OB1_TIMER_RETENTIVE_ON_DELAY 3

// `SA`, off-delay: starts when the 1 goes.
#define OB1_TIMER_OFF_DELAY 4

// Log levels, `HostTable::log`: something does not work.
#define OB1_LOG_ERROR 1

// Warning: something is odd, and work goes on.
#define OB1_LOG_WARN 2

// Information: something happened, as it should.
#define OB1_LOG_INFO 3

// Longest text of `HostTable::log` and `HostTable::diag_entry` in bytes; the rest is cut.
#define OB1_TEXT_MAX 200

#define OB1_TY_BOOL 1

#define OB1_TY_BYTE 2

#define OB1_TY_CHAR 3

#define OB1_TY_WORD 4

#define OB1_TY_INT 5

#define OB1_TY_DWORD 6

#define OB1_TY_DINT 7

#define OB1_TY_REAL 8

#define OB1_TY_S5TIME 9

#define OB1_TY_TIME 10

#define OB1_TY_DATE 11

#define OB1_TY_TIME_OF_DAY 12

#define OB1_TY_DATE_AND_TIME 13

// `STRING[n]`: n in `ParamDesc::length`.
#define OB1_TY_STRING 14

// An opaque array of `length` bytes (instance data only).
#define OB1_TY_BYTES 15

#define OB1_TY_POINTER 16

#define OB1_TY_ANY 17

#define OB1_TY_BLOCK_DB 20

#define OB1_TY_BLOCK_FB 21

#define OB1_TY_BLOCK_FC 22

#define OB1_TY_TIMER 24

#define OB1_TY_COUNTER 25

// A timer's number, given as a timer or as a WORD.
#define OB1_TY_TIMER_OR_WORD 26

// Result of a host function or of a block. Zero is success; a block that gets `ABORT` must return it at once.
typedef int32_t Ob1Status;

// UTF-8 text: pointer and length, no terminator. Lives as long as the plugin.
struct Ob1Text {
  // First byte; may be null when `len` is 0.
  const uint8_t *ptr;
  // Length of the text in bytes.
  uint32_t len;
};

// A parameter or an instance variable of a block.
struct Ob1ParamDesc {
  // `sizeof` this struct in the plugin.
  uint32_t size;
  // Name of the parameter, as the manual prints it.
  struct Ob1Text name;
  // Other spellings, separated by `|`.
  struct Ob1Text aliases;
  // Where it is declared: a value of `SECTION_*`.
  uint8_t section;
  // A value of `ty`.
  uint8_t ty;
  // Length of `STRING` and `BYTES`, else 0.
  uint16_t length;
  // Initial value of instance data (FB), right-aligned; elementary types only.
  uint32_t initial;
};

// The call in progress; opaque to the plugin.
struct Ob1CallContext;

// Location of the instance of the running FB.
struct Ob1InstanceInfo {
  // `sizeof` this struct, set by the caller.
  uint32_t size;
  // The instance data block's number.
  uint16_t db;
  // Padding; a plugin must ignore it.
  uint16_t reserved;
  // First byte of this instance in the data block (0 except for multi-instances).
  uint32_t offset;
  // Length of the instance in bytes.
  uint32_t len;
};

// The open data blocks and the binary result of the caller.
struct Ob1Registers {
  // `sizeof` this struct, set by the caller.
  uint32_t size;
  // Data block in the DB register, 0 for none.
  uint16_t db;
  // Data block in the DI register, 0 for none.
  uint16_t di;
};

// A timer as `L T`, `LC T` and `U T` see it.
struct Ob1TimerInfo {
  // `sizeof` this struct, set by the caller.
  uint32_t size;
  // 1 when a scan of the timer gives 1.
  uint8_t output;
  // 1 while it runs.
  uint8_t running;
  // Remaining time as S5TIME.
  uint16_t remaining;
};

// A module as the CPU sees it.
struct Ob1ModuleInfo {
  // `sizeof` this struct, set by the caller.
  uint32_t size;
  // Logical base address, as LADDR gives it.
  uint16_t address;
  // Bytes of its input registers.
  uint16_t input_bytes;
  // Bytes of its output registers.
  uint16_t output_bytes;
  // 1 while its driver answers.
  uint8_t present;
  // Padding; a plugin must ignore it.
  uint8_t reserved;
  // Counts the driver's starts; a changed number means that everything the driver held is gone.
  uint32_t generation;
};

// An actual parameter of `HostTable::call_block`.
struct Ob1CallArg {
  // 0: not supplied (FB only); 1: value `value` (timer, counter and block numbers too); 2: operand.
  uint8_t kind;
  // `AREA_*` of an operand.
  uint8_t area;
  // Data block of an operand in `AREA_DB`.
  uint16_t db;
  // Bit address (byte * 8 + bit) of an operand.
  uint32_t bit_address;
  // The value, right-aligned; of an operand it is ignored.
  uint32_t value;
};

// The running organization block and its start information.
struct Ob1ObInfo {
  // `sizeof` this struct, set by the caller.
  uint32_t size;
  // Number of the running OB.
  uint16_t number;
  // Its priority class; OB 1 has 1.
  uint8_t priority;
  // Padding; a plugin must ignore it.
  uint8_t reserved;
  // The 20 bytes of start information as they lie in the OB's local data.
  uint8_t start[20];
};

// The host's functions. All run on the scan thread, inside a block's entry; pointers passed in are read or written
// before they return. Values of parameters and cells are numbers, not bytes in memory order, wherever a `u32` is
// passed.
struct Ob1HostTable {
  // `sizeof` this struct in the host: a newer host has more functions at its end.
  uint32_t size;
  // `ABI_MAJOR` the host was built with.
  uint16_t abi_major;
  // `ABI_MINOR` the host was built with.
  uint16_t abi_minor;
  // Value of the actual of formal `index`, up to 32 bits wide; BOOL as 0/1; the number of a timer, counter or block.
  Ob1Status (*param_get)(struct Ob1CallContext *call, uint32_t index, uint32_t *value);
  // Writes the actual of formal `index`: at once for M, E, A, L operands and the instance, after the return for data
  // operands.
  Ob1Status (*param_set)(struct Ob1CallContext *call, uint32_t index, uint32_t value);
  // Bytes of an actual wider than 32 bits (STRING, DATE_AND_TIME, ANY), from byte `at`.
  Ob1Status (*param_read)(struct Ob1CallContext *call, uint32_t index, uint32_t at, uint8_t *into, uint32_t len);
  // Writes bytes of such an actual.
  Ob1Status (*param_write)(struct Ob1CallContext *call, uint32_t index, uint32_t at, const uint8_t *from, uint32_t len);
  // `OK` when the actual was supplied, `NO_PARAM` when it was left open (FB).
  Ob1Status (*param_given)(struct Ob1CallContext *call, uint32_t index);
  // Copies bytes out of an area (`AREA_*`; `db` for `AREA_DB`).
  Ob1Status (*area_read)(struct Ob1CallContext *call,
                         uint8_t area,
                         uint16_t db,
                         uint32_t at,
                         uint8_t *into,
                         uint32_t len);
  // Copies bytes into an area.
  Ob1Status (*area_write)(struct Ob1CallContext *call,
                          uint8_t area,
                          uint16_t db,
                          uint32_t at,
                          const uint8_t *from,
                          uint32_t len);
  // Reads a bit (byte * 8 + bit).
  Ob1Status (*bit_get)(struct Ob1CallContext *call, uint8_t area, uint16_t db, uint32_t bit_address, uint8_t *value);
  // Writes a bit (byte * 8 + bit), 0 or 1.
  Ob1Status (*bit_set)(struct Ob1CallContext *call, uint8_t area, uint16_t db, uint32_t bit_address, uint8_t value);
  // Length of an area in bytes. `NO_DB`, `DB_NUMBER` for data blocks that are not there.
  Ob1Status (*area_len)(struct Ob1CallContext *call, uint8_t area, uint16_t db, uint32_t *len);
  // The instance data block of the running FB. `NO_PARAM` in an FC.
  Ob1Status (*instance)(struct Ob1CallContext *call, struct Ob1InstanceInfo *info);
  // The data blocks the caller has opened.
  Ob1Status (*registers)(struct Ob1CallContext *call, struct Ob1Registers *registers);
  // Sets the binary result the caller sees after the call. It is 1 unless set.
  Ob1Status (*set_br)(struct Ob1CallContext *call, uint8_t br);
  // Starts or scans a timer as the statement `kind T number` does with the given result of logic operation; an edge
  // of `rlo` between two calls starts it. `s5time` is an S5TIME.
  Ob1Status (*timer_run)(struct Ob1CallContext *call, uint16_t number, uint8_t kind, uint8_t rlo, uint16_t s5time);
  // Stops a timer and sets its time and output to 0, as `R T` does.
  Ob1Status (*timer_reset)(struct Ob1CallContext *call, uint16_t number);
  // Reads a timer without changing it.
  Ob1Status (*timer_get)(struct Ob1CallContext *call, uint16_t number, struct Ob1TimerInfo *info);
  // Reads a counter, 0 to 999.
  Ob1Status (*counter_get)(struct Ob1CallContext *call, uint16_t number, uint16_t *value);
  // Sets a counter, 0 to 999.
  Ob1Status (*counter_set)(struct Ob1CallContext *call, uint16_t number, uint16_t value);
  // The module at a logical base address.
  Ob1Status (*module_info)(struct Ob1CallContext *call, uint32_t address, struct Ob1ModuleInfo *info);
  // This plugin's memory for the module at a logical address, `PluginTable::module_state_size` bytes,
  // aligned to 16.
  Ob1Status (*module_state)(struct Ob1CallContext *call, uint32_t address, void **state);
  // Reads peripheral bytes directly from the module (`PEB address`...). A driver that is down reads as 0 unless the
  // station file says `absent = "fault"`.
  Ob1Status (*io_read)(struct Ob1CallContext *call, uint32_t address, uint8_t *into, uint32_t len);
  // Writes peripheral bytes to the module at once, all together, and into the process image where they lie inside
  // it.
  Ob1Status (*io_write)(struct Ob1CallContext *call, uint32_t address, const uint8_t *from, uint32_t len);
  // Reads a record (data set) of the module; `read` gets the bytes copied.
  Ob1Status (*record_read)(struct Ob1CallContext *call,
                           uint32_t address,
                           uint8_t record,
                           uint8_t *into,
                           uint32_t len,
                           uint32_t *read);
  // Writes a whole record (data set) of the module at a logical base address.
  Ob1Status (*record_write)(struct Ob1CallContext *call,
                            uint32_t address,
                            uint8_t record,
                            const uint8_t *from,
                            uint32_t len);
  // Calls another block: FC, FB, SFC or SFB (`KIND_*`), with its instance data block (0 for an FC or SFC) and one
  // argument per formal. At most 64 arguments.
  Ob1Status (*call_block)(struct Ob1CallContext *call,
                          uint8_t kind,
                          uint16_t number,
                          uint16_t instance_db,
                          const struct Ob1CallArg *args,
                          uint32_t arg_count);
  // Nanoseconds since the runtime started; virtual in a simulation.
  Ob1Status (*now)(struct Ob1CallContext *call, uint64_t *nanos);
  // The running organization block.
  Ob1Status (*ob_info)(struct Ob1CallContext *call, struct Ob1ObInfo *info);
  // A safe point: higher priorities may run now. Blocks that loop call it in every iteration.
  Ob1Status (*attend)(struct Ob1CallContext *call);
  // Raises a programming or access error (event number 25xxh, 29xxh) as a statement would: OB 121/122 or STOP.
  // Returns `OK` to continue or `ABORT`.
  Ob1Status (*raise_fault)(struct Ob1CallContext *call, uint16_t event, uint32_t number);
  // Raises a diagnostic interrupt (OB 82) for the module, with up to 16 bytes of its diagnostic data.
  Ob1Status (*diagnostic_interrupt)(struct Ob1CallContext *call, uint32_t address, const uint8_t *data, uint32_t len);
  // Writes an entry into the diagnostic buffer: a number of the plugin's own and a text.
  Ob1Status (*diag_entry)(struct Ob1CallContext *call, uint16_t number, struct Ob1Text text);
  // Asks for STOP, with a text for the diagnostic buffer. Returns `ABORT`.
  Ob1Status (*stop)(struct Ob1CallContext *call, struct Ob1Text text);
  // Copies a line into the log ring; never blocks, drops when full.
  Ob1Status (*log)(struct Ob1CallContext *call, uint8_t level, struct Ob1Text text);
  // A named extension table, or null.
  const void *(*extension)(struct Ob1CallContext *call, struct Ob1Text name);
};

// A block's entry. `state` is the plugin's memory for this station (see `BlockDesc::state_size`).
typedef Ob1Status (*Ob1BlockEntry)(const struct Ob1HostTable *host, struct Ob1CallContext *call, void *state);

// A block of a plugin.
struct Ob1BlockDesc {
  // `sizeof` this struct in the plugin.
  uint32_t size;
  // `KIND_*`; `KIND_SFB` and `KIND_SFC` since 1.1.
  uint8_t kind;
  // Padding; a plugin must set it to 0.
  uint8_t reserved;
  // The number it wants; a station file may give it another.
  uint16_t number;
  // The manual's name, `SEND`.
  struct Ob1Text name;
  // Parameters in the manual's order, then instance variables of an FB or SFB. The place in this table, from 0,
  // is the parameter index in the host's functions, for inputs, outputs, in/outs and the function value
  // `RET_VAL` alike, in any order; instance variables have no index.
  const struct Ob1ParamDesc *params;
  // Number of entries of `params`.
  uint32_t param_count;
  // Bytes of memory this block keeps per station: allocated by the host, zeroed at every start-up, aligned to 16
  // bytes, given to `entry`. 0: `state` is null. Data that must survive belongs in the instance data block.
  uint32_t state_size;
  // The code of the block; it runs on the scan thread.
  Ob1BlockEntry entry;
};

// What `ENTRY_SYMBOL` returns. Static data of the plugin.
struct Ob1PluginTable {
  // `sizeof` this struct in the plugin.
  uint32_t size;
  // `ABI_MAJOR` the plugin was built with.
  uint16_t abi_major;
  // `ABI_MINOR` the plugin was built with.
  uint16_t abi_minor;
  // The plugin's name, `cp240`.
  struct Ob1Text name;
  // The plugin's version, `0.1.0`.
  struct Ob1Text version;
  // The first of `block_count` blocks, one after the other.
  const struct Ob1BlockDesc *blocks;
  // Number of blocks at `blocks`.
  uint32_t block_count;
  // Bytes of memory the plugin keeps per module it serves (`HostTable::module_state`): zeroed at every start-up.
  uint32_t module_state_size;
  // Called once after loading, on the loading thread, before any block runs; may be null. Not `OK`: the plugin is
  // refused.
  Ob1Status (*init)(void);
  // Copies the message of the last panic (UTF-8, at most `len` bytes) and returns its length; may be null.
  uint32_t (*panic_message)(uint8_t *into, uint32_t len);
};

// The type of the exported function `ENTRY_SYMBOL`.
typedef const struct Ob1PluginTable *(*Ob1PluginEntry)(void);

// What `EXTENSION_SETTINGS` names. Lives as long as the host.
struct Ob1SettingsTable {
  // `sizeof` this struct in the host.
  uint32_t size;
  // A setting that is a number, of the module at a logical base address. `NO_MODULE`; `NO_SETTING` when the station
  // file does not give it, or gives it as a text.
  Ob1Status (*get_int)(struct Ob1CallContext *call, uint32_t address, struct Ob1Text name, int64_t *value);
  // A setting that is a text (UTF-8): copies at most `len` bytes of it, `read` gets its whole length. `NO_MODULE`;
  // `NO_SETTING` when the station file does not give it, or gives it as a number.
  Ob1Status (*get_text)(struct Ob1CallContext *call,
                        uint32_t address,
                        struct Ob1Text name,
                        uint8_t *into,
                        uint32_t len,
                        uint32_t *read);
};

// Success: the function or the block has done its work.
#define OB1_OK 0

// The CPU is going to STOP (or a higher priority asked to end this call): return this value at once.
#define OB1_ABORT 1

// A parameter index outside the block's interface, or not of the kind asked for.
#define OB1_NO_PARAM -1

// The address lies outside its area.
#define OB1_OUTSIDE -2

// The data block does not exist.
#define OB1_NO_DB -3

// An impossible data block number (0, or above the CPU's limit).
#define OB1_DB_NUMBER -4

// No module at this logical address, or a module of a kind without this function.
#define OB1_NO_MODULE -5

// The module does not answer: its driver is down.
#define OB1_ABSENT -6

// The module is busy with another request; a later request may succeed.
#define OB1_BUSY -7

// The record does not exist.
#define OB1_NO_RECORD -8

// The block to call does not exist or its parameters do not match.
#define OB1_NO_BLOCK -9

// A pointer was null or a length impossible.
#define OB1_BAD_ARGUMENT -10

// The data block is write-protected.
#define OB1_READ_ONLY -11

// The station file does not give the module this setting.
#define OB1_NO_SETTING -12

// Returned by a block's entry: it panicked; the message is in the plugin's panic buffer.
#define OB1_PANICKED -100

#endif  /* OB1_H */
