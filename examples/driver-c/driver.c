/* The driver of a CP 240 with the protocol ASCII, for Linux, in C11 alone.
 *
 * It keeps the rules of docs/driver.md; offsets and words are those of docs/backplane.md, the handshake is that of
 * docs/cp240-registers.md. Build: cc -O2 -o driver driver.c. Test: ob1 driver test ./driver
 */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

/* Offsets in the segment. */
enum {
    MAGIC = 0x00, VERSION = 0x08, TOTAL = 0x10, IO_BYTES = 0x18, JSON_BYTES = 0x20, RECORD_BYTES = 0x28,
    EVENT_SLOTS = 0x30, COUNTER_WORDS = 0x38, OUTPUTS = 0x80, CHANGES = 0xc8, INPUTS = 0x100, CPU_STATE = 0x188,
    CPU_TIME = 0x198, GENERATION = 0x200, HEARTBEAT = 0x208, STATE = 0x210, LEDS = 0x218, MODEM = 0x220, REASON = 0x228,
    SLEEPING = 0x280, ENDS = 0x300, COUNTERS = 0x500, DIAGNOSIS = 0x600, PRODUCED = 0x900, LOST = 0x908,
    CONSUMED = 0x980, SLOTS = 0xa00, PARAMS = 0x1200, CHANNELS_VERSION = 0x2280, SEND_TO_CPU = 0x2400,
    RECEIVE_TO_CPU = 0x2480, POSTED = 0x2800, TIMES_WRITTEN = 0x2880, TIMES = 0x28c0, SIZE = 0x3000,
};
/* Counters. */
enum {
    ACCEPTED, SENT, SEND_ERRORS, ABORTED, ORDERS_LOST, RECEIVED, DELIVERED, RECEIVE_ABORTED, RECEIVE_LOST,
    RECEIVE_ERRORS, REJECTED_FULL, BYTES_TX, BYTES_RX, LINE_FAULTS, LINE_RESTARTS, DRIVER_STARTS,
};
/* Driver states, and kinds of events. */
enum { STARTING = 1, NO_PARAMETERS, PARAMETER_ERROR, READY, LINE_ERROR };
enum { MESSAGE = 6 };

enum { BLOCK = 12, TELEGRAM = 1024, QUEUE = 8 };

static _Atomic uint64_t *memory;

static uint64_t get(unsigned offset) { return atomic_load_explicit(&memory[offset / 8], memory_order_acquire); }
static uint64_t peek(unsigned offset) { return atomic_load_explicit(&memory[offset / 8], memory_order_relaxed); }
static void put(unsigned offset, uint64_t word) { atomic_store_explicit(&memory[offset / 8], word, memory_order_release); }
static void poke(unsigned offset, uint64_t word) { atomic_store_explicit(&memory[offset / 8], word, memory_order_relaxed); }
static void count(unsigned counter, uint64_t by) { poke(COUNTERS + 8 * counter, peek(COUNTERS + 8 * counter) + by); }

static uint64_t nanos(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

/* Writes words under the sequence before them. */
static void write_words(unsigned at, const uint64_t *words, unsigned n)
{
    uint64_t s = peek(at), odd = s % 2 == 0 ? s + 1 : s + 2;
    poke(at, odd);
    atomic_thread_fence(memory_order_release);
    for (unsigned i = 0; i < n; i++)
        poke(at + 8 + 8 * i, words[i]);
    put(at, odd + 1);
}

/* A whole copy of the words after a sequence: 1, and the sequence; 0: a writer is in the middle. */
static int read_words(unsigned at, uint64_t *words, unsigned n, uint64_t *sequence)
{
    for (int try = 0; try < 4; try++) {
        uint64_t a = get(at);
        if (a % 2 == 1)
            continue;
        for (unsigned i = 0; i < n; i++)
            words[i] = peek(at + 8 + 8 * i);
        atomic_thread_fence(memory_order_acquire);
        if (peek(at) == a) {
            *sequence = a;
            return 1;
        }
    }
    return 0;
}

static uint64_t born;

static void emit(unsigned kind, uint32_t number, const void *data, unsigned length)
{
    uint64_t produced = peek(PRODUCED), words[2] = {0, 0};
    if (produced - get(CONSUMED) >= 64) {
        poke(LOST, peek(LOST) + 1);
        return;
    }
    memcpy(words, data, length);
    unsigned slot = SLOTS + 32 * (unsigned)(produced % 64);
    poke(slot, nanos() - born);
    poke(slot + 8, kind | (uint64_t)length << 16 | (uint64_t)number << 32);
    poke(slot + 16, words[0]);
    poke(slot + 24, words[1]);
    put(PRODUCED, produced + 1);
}

/* Where the time of an order or a telegram went. */
enum { ORDER = 1, FROM_PARTNER };
enum { HEAD, WAS_POSTED, TAKEN, FIRST_OUT, LAST_OUT, FIRST_IN, LAST_IN, GIVEN, MOMENTS };

static void enter_times(uint64_t *times, unsigned kind, unsigned bytes)
{
    uint64_t written = peek(TIMES_WRITTEN);
    times[HEAD] = kind | (uint64_t)bytes << 8;
    times[GIVEN] = nanos();
    atomic_thread_fence(memory_order_release);
    for (unsigned i = 0; i < MOMENTS; i++)
        poke(TIMES + 64 * (unsigned)(written % 16) + 8 * i, times[i]);
    put(TIMES_WRITTEN, written + 1);
}

static void refuse(const char *why)
{
    fprintf(stderr, "driver: %s\n", why);
    exit(1);
}

/* The descriptor of the segment: from the socket on standard output, else by its path. */
static int segment(const char *path)
{
    char byte;
    union { char room[CMSG_SPACE(16 * sizeof(int))]; struct cmsghdr align; } space;
    struct iovec part = {&byte, 1};
    struct msghdr message = {
        .msg_iov = &part, .msg_iovlen = 1, .msg_control = space.room, .msg_controllen = sizeof space.room};
    if (recvmsg(1, &message, MSG_DONTWAIT | MSG_CMSG_CLOEXEC) > 0) {
        struct cmsghdr *head = CMSG_FIRSTHDR(&message);
        if (head && head->cmsg_type == SCM_RIGHTS)
            return *(int *)(void *)CMSG_DATA(head);
    }
    return path ? open(path, O_RDWR | O_CLOEXEC) : -1;
}

static void map(int fd)
{
    int needed = F_SEAL_SHRINK | F_SEAL_GROW, seals = fcntl(fd, F_GET_SEALS);
    struct stat file;
    if (seals < 0 || (seals & needed) != needed)
        refuse("the segment is not sealed");
    if (fstat(fd, &file) != 0 || file.st_size != SIZE)
        refuse("the segment has another size");
    memory = mmap(NULL, SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    if (memory == MAP_FAILED)
        refuse("the segment cannot be mapped");
    uint64_t magic;
    memcpy(&magic, "OB1BPLN", 8);
    if (get(VERSION) != 1 || peek(MAGIC) != magic || peek(TOTAL) != SIZE || peek(IO_BYTES) != 16
        || peek(JSON_BYTES) != 4096 || peek(RECORD_BYTES) != 240 || peek(EVENT_SLOTS) != 64
        || peek(COUNTER_WORDS) != 32 || peek(CHANNELS_VERSION) != 1)
        refuse("the header of the segment is not one of version 1");
    struct flock lock = {.l_type = F_WRLCK, .l_whence = SEEK_SET};
    if (fcntl(fd, F_SETLK, &lock) != 0)
        refuse("a driver is attached to the segment already");
}

static uint64_t lost(unsigned begun, unsigned ended)
{
    uint64_t open = peek(COUNTERS + 8 * begun);
    for (unsigned i = 0; i < 4 - (begun == RECEIVED); i++) {
        uint64_t n = peek(COUNTERS + 8 * (ended + i));
        open = n > open ? 0 : open - n;
    }
    return open;
}

static uint64_t attach(void)
{
    static const uint64_t zeros[32];
    poke(SLEEPING, 0);
    poke(STATE, STARTING);
    poke(LEDS, 0);
    poke(MODEM, 0);
    poke(REASON, 0);
    write_words(INPUTS, zeros, 8);
    write_words(SEND_TO_CPU, zeros, 8);
    write_words(RECEIVE_TO_CPU, zeros, 8);
    write_words(DIAGNOSIS, zeros, 2);
    count(ORDERS_LOST, lost(ACCEPTED, SENT));
    count(RECEIVE_LOST, lost(RECEIVED, DELIVERED));
    count(DRIVER_STARTS, 1);
    if (peek(PRODUCED) - get(CONSUMED) > 64)
        poke(PRODUCED, get(CONSUMED));
    uint64_t generation = peek(GENERATION) + 1;
    if (generation == 0)
        generation = 1;
    put(GENERATION, generation);
    return generation;
}

/* The line. */

static int line = -1, partner = -1;
static char published[256];
static unsigned char out[TELEGRAM];
static unsigned out_length, out_written;

static void close_line(void)
{
    if (line >= 0)
        close(line);
    if (partner >= 0)
        close(partner);
    if (published[0])
        unlink(published);
    line = partner = -1;
    published[0] = 0;
}

/* A new pty; the path becomes a link to it. Its other end stays open here, so that a partner may come and go. */
static int open_pty(const char *path)
{
    char name[64];
    struct stat old;
    int master = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC);
    if (master < 0 || grantpt(master) != 0 || unlockpt(master) != 0 || ptsname_r(master, name, sizeof name) != 0)
        return -1;
    partner = open(name, O_RDWR | O_NOCTTY | O_CLOEXEC);
    if (lstat(path, &old) == 0 && S_ISLNK(old.st_mode))
        unlink(path);
    if (symlink(name, path) == 0)
        strcpy(published, path);
    return master;
}

/* 0, or the error of the system. */
static int open_line(const char *kind, const char *path)
{
    close_line();
    int flags = O_RDWR | O_NOCTTY | O_NONBLOCK | O_CLOEXEC, is_pty = strcmp(kind, "pty") == 0;
    line = is_pty ? open_pty(path) : open(path, flags);
    int device = is_pty ? partner : line;
    struct termios settings;
    if (line < 0 || tcgetattr(device, &settings) != 0)
        return errno;
    cfmakeraw(&settings);
    settings.c_cflag |= CLOCAL | CREAD;
    cfsetspeed(&settings, B115200);
    tcsetattr(device, TCSANOW, &settings);
    tcflush(device, TCIOFLUSH);
    return 0;
}

/* The module. */

static enum { OFF, REFUSED, IDENTIFY, CLEARING, WORKING } phase;
static enum { IDLE, COLLECTING, SENDING, FAILED, CLOSING } sending;
static unsigned number, rest, length, code, reset_seen;
static unsigned char telegram[TELEGRAM];
static uint64_t times[MOMENTS];

/* Received telegrams, the oldest first, and how much of it has been fetched. */
static struct { unsigned char bytes[TELEGRAM]; unsigned length; uint64_t times[MOMENTS]; } queue[QUEUE];
static unsigned first, waiting, fetched, offered, closing;
static unsigned char coming[TELEGRAM];
static unsigned coming_length;
static uint64_t coming_since, silent_since, silence = 20000000;

static void clear(void)
{
    if (sending == SENDING)
        count(ABORTED, 1);
    count(RECEIVE_ABORTED, waiting);
    sending = IDLE;
    out_length = out_written = length = first = waiting = fetched = offered = closing = coming_length = 0;
}

static void identify(unsigned tx)
{
    clear();
    do
        number = number % 255 + 1;
    while (tx == (0x8000 | number));
    phase = IDENTIFY;
    unsigned char data[2] = {(unsigned char)number, 0};
    emit(MESSAGE, 1, data, 2);
}

static void fail(unsigned error)
{
    sending = FAILED;
    code = error;
}

static void look_send(unsigned tx, const unsigned char *block)
{
    unsigned kind = tx & 0xf800, n = tx & 0x7ff;
    if (sending == CLOSING && tx != 0x2000)
        sending = IDLE;
    if (sending == FAILED && tx == 0x2000)
        sending = CLOSING;
    if (sending == IDLE && (kind == 0x4000 || kind == 0x800 || kind == 0x1000) && n != 0)
        fail(0x0c);
    if (kind != 0)
        return;
    if (sending == IDLE && n > TELEGRAM)
        fail(0x17);
    else if ((sending == IDLE && n > 0) || (sending == COLLECTING && rest > BLOCK && n == rest - BLOCK)) {
        if (sending == IDLE) {
            length = 0;
            memset(times, 0, sizeof times);
            times[WAS_POSTED] = peek(POSTED);
        }
        unsigned part = n < BLOCK ? n : BLOCK;
        memcpy(telegram + length, block, part);
        length += part;
        rest = n;
        sending = COLLECTING;
    } else if (sending == COLLECTING && n == 0 && rest > BLOCK)
        sending = IDLE;
    else if (sending == COLLECTING && n == 0) {
        memcpy(out, telegram, length);
        out_length = length;
        out_written = 0;
        sending = SENDING;
        times[TAKEN] = nanos();
        count(ACCEPTED, 1);
    }
}

static void look_receive(unsigned echo)
{
    if (offered != 0 && echo == offered) {
        fetched += offered < BLOCK ? offered : BLOCK;
        offered = queue[first].length - fetched;
        if (offered == 0) {
            closing = 1;
            enter_times(queue[first].times, FROM_PARTNER, queue[first].length);
            first = (first + 1) % QUEUE;
            waiting--;
            count(DELIVERED, 1);
        }
    }
    if (closing && echo == 0)
        closing = 0;
    if (offered == 0 && !closing && waiting > 0 && echo == 0) {
        fetched = 0;
        offered = queue[first].length;
    }
}

static void look(const unsigned char *registers)
{
    unsigned rx = registers[0] << 8 | registers[1], tx = registers[2] << 8 | registers[3];
    unsigned reset = rx == 0x8002;
    if (phase >= IDENTIFY && reset && !reset_seen)
        identify(tx);
    reset_seen = reset;
    if (phase == IDENTIFY && rx == 0x8001 && tx == (0x8000 | number))
        phase = CLEARING;
    if (phase == CLEARING && ((rx | tx) & 0x8000) == 0)
        phase = WORKING;
    if (phase == WORKING) {
        look_send(tx, registers + 4);
        look_receive(rx);
    }
}

/* The silence after a character ends a telegram. */
static void end_telegram(uint64_t now)
{
    if (coming_length == 0 || (coming_length < TELEGRAM && now - silent_since < silence))
        return;
    if (waiting == QUEUE)
        count(REJECTED_FULL, 1);
    else {
        unsigned slot = (first + waiting) % QUEUE;
        memcpy(queue[slot].bytes, coming, coming_length);
        queue[slot].length = coming_length;
        queue[slot].times[FIRST_IN] = coming_since;
        queue[slot].times[LAST_IN] = silent_since;
        waiting++;
        count(RECEIVED, 1);
    }
    coming_length = 0;
}

static void hear(void)
{
    end_telegram(nanos());
    unsigned char bytes[256];
    ssize_t n;
    while (line >= 0 && (n = read(line, bytes, sizeof bytes)) > 0) {
        count(BYTES_RX, (uint64_t)n);
        silent_since = nanos();
        if (coming_length == 0)
            coming_since = silent_since;
        for (ssize_t i = 0; i < n && phase == WORKING; i++) {
            coming[coming_length++] = bytes[i];
            end_telegram(silent_since);
        }
    }
}

static void transmit(void)
{
    ssize_t n;
    if (out_written < out_length && (n = write(line, out + out_written, out_length - out_written)) > 0) {
        if (out_written == 0)
            times[FIRST_OUT] = nanos();
        out_written += (unsigned)n;
        times[LAST_OUT] = nanos();
        count(BYTES_TX, (uint64_t)n);
    }
    int queued = 0;
    if (sending == SENDING && out_written == out_length && (ioctl(line, TIOCOUTQ, &queued) != 0 || queued == 0)) {
        sending = IDLE;
        enter_times(times, ORDER, length);
        count(SENT, 1);
    }
}

static void show(void)
{
    static unsigned char shown[64];
    unsigned char registers[64] = {0};
    unsigned rx = 0, tx = 0;
    if (phase == IDENTIFY) {
        rx = 0x8001;
        tx = 0x8000 | number;
    } else if (phase == REFUSED) {
        rx = 0x8003;
        tx = 0x8000;
    } else if (phase == WORKING) {
        rx = offered;
        tx = sending == COLLECTING || sending == SENDING ? rest : sending == FAILED ? 0x2000 | code : 0;
        if (offered != 0)
            memcpy(registers + 4, queue[first].bytes + fetched, offered < BLOCK ? offered : BLOCK);
    }
    registers[0] = rx >> 8;
    registers[1] = rx & 255;
    registers[2] = tx >> 8;
    registers[3] = tx & 255;
    if (memcmp(registers, shown, sizeof shown) == 0)
        return;
    memcpy(shown, registers, sizeof shown);
    uint64_t words[8];
    memcpy(words, registers, sizeof words);
    write_words(INPUTS, words, 8);
}

/* The text of the key "line", split at its colon: "serial:PATH" or "pty:PATH". */
static int find_line(char *json, char **kind, char **path)
{
    char *at = strstr(json, "\"line\"");
    char *begin = at ? strchr(at + 6, '"') : NULL;
    char *colon = begin ? strchr(begin, ':') : NULL;
    char *end = begin ? strchr(begin + 1, '"') : NULL;
    if (json[0] != '{' || !end || !colon || colon > end || end - colon > 250)
        return 0;
    *end = *colon = 0;
    *kind = begin + 1;
    *path = colon + 1;
    return strcmp(*kind, "serial") == 0 || strcmp(*kind, "pty") == 0;
}

static void take_parameters(const uint64_t *words, unsigned tx)
{
    static char json[4097];
    char *kind, *path;
    unsigned char bytes[16];
    uint64_t text = words[0];
    memcpy(bytes, words + 1, 16);
    memset(json, 0, sizeof json);
    if (text > 4096) {
        emit(MESSAGE, 8, "", 0);
        text = 0;
    }
    memcpy(json, words + 3, text);
    silence = bytes[5] ? bytes[5] * 20000000ull : 200000000;
    clear();
    if (!find_line(json, &kind, &path) || bytes[1] > 1) {
        phase = REFUSED;
        emit(MESSAGE, 7, "", 0);
        poke(LEDS, 1 | 8);
        put(STATE, PARAMETER_ERROR | 0x100ull << 32);
        return;
    }
    int error = open_line(kind, path);
    identify(tx);
    poke(LEDS, 1);
    poke(MODEM, 0x30);
    put(STATE, error ? LINE_ERROR | (uint64_t)error << 32 : READY);
}

/* Everything that the CPU may have changed; 1: it was in the middle of a write, look again. */
static int look_at_cpu(void)
{
    static uint64_t seen_outputs = 1, seen_params, last_state;
    static unsigned char registers[64];
    static uint64_t words[8], params[3 + 512];
    uint64_t state = get(CPU_STATE), sequence;
    int again = 0;
    if (state > 2 && state != last_state)
        emit(MESSAGE, 8, "", 0);
    last_state = state;
    if (get(PARAMS) != seen_params) {
        if (!read_words(PARAMS, params, 3 + 512, &sequence))
            again = 1;
        else {
            seen_params = sequence;
            take_parameters(params, registers[2] << 8 | registers[3]);
        }
    }
    if (get(OUTPUTS) != seen_outputs) {
        if (!read_words(OUTPUTS, words, 8, &sequence))
            again = 1;
        else {
            seen_outputs = sequence;
            memcpy(registers, words, sizeof registers);
        }
    }
    if (!again)
        look(registers);
    return again;
}

static volatile sig_atomic_t terminated;
static void terminate(int signal) { terminated = signal; }

/* Sleeps until the bell, the line or a time; 0 when the bell is closed. */
static int wait_for_news(int timeout)
{
    struct pollfd fds[2] = {{.fd = 0, .events = POLLIN}, {.fd = line, .events = POLLIN}};
    if (out_written < out_length)
        fds[1].events |= POLLOUT;
    poll(fds, 2, timeout);
    if (fds[1].revents & (POLLHUP | POLLERR))
        usleep(1000);
    if (fds[0].revents == 0)
        return 1;
    char bytes[4096];
    ssize_t n;
    while ((n = read(0, bytes, sizeof bytes)) > 0)
        ;
    return n != 0;
}

int main(int count_of, char **arguments)
{
    const char *path = NULL;
    for (int i = 1; i + 1 < count_of; i++)
        if (strcmp(arguments[i], "--segment") == 0)
            path = arguments[i + 1];
    signal(SIGINT, SIG_IGN);
    signal(SIGHUP, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    struct sigaction action = {.sa_handler = terminate};
    sigaction(SIGTERM, &action, NULL);
    born = nanos();
    int fd = segment(path);
    if (fd < 0)
        refuse("there is no segment");
    map(fd);
    number = (unsigned)(attach() * 37 % 255);
    put(STATE, NO_PARAMETERS);
    fcntl(0, F_SETFL, fcntl(0, F_GETFL) | O_NONBLOCK);
    while (!terminated) {
        uint64_t mark = get(CHANGES);
        hear();
        int again = look_at_cpu();
        transmit();
        show();
        poke(SLEEPING, 1);
        atomic_thread_fence(memory_order_seq_cst);
        int idle = peek(CHANGES) == mark;
        int soon = again || sending == SENDING || coming_length > 0;
        if (!wait_for_news(!idle ? 0 : soon ? 1 : 50))
            break;
        poke(SLEEPING, 0);
        poke(HEARTBEAT, peek(HEARTBEAT) + 1);
    }
    close_line();
    return 0;
}
