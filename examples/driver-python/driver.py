#!/usr/bin/env python3
"""The driver of a CP 240 with the protocol ASCII, in Python alone.

It keeps the rules of docs/driver.md; offsets and words are those of docs/backplane.md, the handshake is that of
docs/cp240-registers.md. Test: ob1 driver test ./driver.py
"""
import array, ctypes, errno, fcntl, json, mmap, os, pty, select, signal, socket, struct, sys, termios, threading, time, tty

SIZE = 0x3000
HEADER = {0x00: int.from_bytes(b"OB1BPLN\0", sys.byteorder), 0x08: 1, 0x10: SIZE, 0x18: 16, 0x20: 4096, 0x28: 240,
          0x30: 64, 0x38: 32, 0x2280: 1}
OUTPUTS, CHANGES, INPUTS, CPU_STATE = 0x80, 0xC8, 0x100, 0x188
GENERATION, HEARTBEAT, STATE, LEDS, MODEM, REASON, SLEEPING = 0x200, 0x208, 0x210, 0x218, 0x220, 0x228, 0x280
COUNTERS, DIAGNOSIS, PRODUCED, LOST, CONSUMED, SLOTS = 0x500, 0x600, 0x900, 0x908, 0x980, 0xA00
PARAMS, SEND_TO_CPU, RECEIVE_TO_CPU = 0x1200, 0x2400, 0x2480
(ACCEPTED, SENT, SEND_ERRORS, ABORTED, ORDERS_LOST, RECEIVED, DELIVERED, RECEIVE_ABORTED, RECEIVE_LOST, _, REJECTED,
 BYTES_TX, BYTES_RX, _, _, STARTS) = range(16)
STARTING, NO_PARAMETERS, PARAMETER_ERROR, READY, LINE_ERROR = range(1, 6)
MESSAGE = 6
BLOCK, TELEGRAM, QUEUE = 12, 1024, 8
FENCE = threading.Lock()


def refuse(why):
    print("driver:", why, file=sys.stderr)
    sys.exit(1)


class Segment:
    """The memory: words by their offset. On x86-64 a load or store of a word orders as acquire or release does."""

    def __init__(self, descriptor):
        seals = fcntl.fcntl(descriptor, fcntl.F_GET_SEALS) if os.path.exists(f"/proc/self/fd/{descriptor}") else 0
        if seals & 6 != 6:
            refuse("the segment is not sealed")
        if os.fstat(descriptor).st_size != SIZE:
            refuse("the segment has another size")
        self.descriptor = descriptor
        self.words = (ctypes.c_uint64 * (SIZE // 8)).from_buffer(mmap.mmap(descriptor, SIZE))
        if any(self[offset] != word for offset, word in HEADER.items()):
            refuse("the header of the segment is not one of version 1")
        try:
            fcntl.lockf(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            refuse("a driver is attached to the segment already")

    def __getitem__(self, offset):
        return self.words[offset // 8]

    def __setitem__(self, offset, word):
        self.words[offset // 8] = word & 0xFFFF_FFFF_FFFF_FFFF

    def count(self, counter, by=1):
        self[COUNTERS + 8 * counter] += by

    def write(self, at, data):
        """Writes bytes under the sequence before them."""
        before = self[at]
        odd = before + 1 if before % 2 == 0 else before + 2
        self[at] = odd
        for index, word in enumerate(struct.unpack(f"={len(data) // 8}Q", data)):
            self[at + 8 + 8 * index] = word
        self[at] = odd + 1

    def read(self, at, length):
        """A whole copy of the bytes after a sequence, and the sequence; None: a writer is in the middle."""
        for _ in range(4):
            before = self[at]
            if before % 2 == 1:
                continue
            words = self.words[at // 8 + 1 : at // 8 + 1 + length // 8]
            if self[at] == before:
                return struct.pack(f"={length // 8}Q", *words), before
        return None

    def emit(self, number, data=b""):
        produced = self[PRODUCED]
        if (produced - self[CONSUMED]) % 2**64 >= 64:
            self[LOST] += 1
            return
        slot = SLOTS + 32 * (produced % 64)
        self[slot] = time.monotonic_ns() - BORN
        self[slot + 8] = MESSAGE | len(data) << 16 | number << 32
        self[slot + 16], self[slot + 24] = struct.unpack("=2Q", data.ljust(16, b"\0"))
        self[PRODUCED] = produced + 1

    def attach(self):
        for offset, word in {SLEEPING: 0, STATE: STARTING, LEDS: 0, MODEM: 0, REASON: 0}.items():
            self[offset] = word
        for at in (INPUTS, SEND_TO_CPU, RECEIVE_TO_CPU):
            self.write(at, bytes(64))
        self.write(DIAGNOSIS, bytes(16))
        of = [self[COUNTERS + 8 * counter] for counter in range(9)]
        self.count(ORDERS_LOST, max(0, of[ACCEPTED] - sum(of[SENT : ORDERS_LOST + 1])))
        self.count(RECEIVE_LOST, max(0, of[RECEIVED] - sum(of[DELIVERED : RECEIVE_LOST + 1])))
        self.count(STARTS)
        if (self[PRODUCED] - self[CONSUMED]) % 2**64 > 64:
            self[PRODUCED] = self[CONSUMED]
        generation = (self[GENERATION] + 1) % 2**64 or 1
        self[GENERATION] = generation
        return generation


class Module:
    """The CP 240: its registers and its line."""

    def __init__(self, segment):
        self.segment, self.number, self.line, self.shown = segment, segment.attach() * 37 % 255, None, bytes(64)
        self.descriptors, self.published = [], None
        self.phase, self.reset_seen, self.silence = "off", False, 0.2
        self.seen_outputs, self.seen_params, self.outputs, self.cpu_state = 1, 0, bytes(64), 0
        self.forget()
        segment[STATE] = NO_PARAMETERS

    def forget(self):
        self.sending, self.collected, self.rest, self.code, self.out = "idle", b"", 0, 0, b""
        self.queue, self.fetched, self.offered, self.closing, self.coming, self.silent_since = [], 0, 0, False, b"", 0

    def clear(self):
        self.segment.count(ABORTED, self.sending == "sending")
        self.segment.count(RECEIVE_ABORTED, len(self.queue))
        self.forget()

    def identify(self, tx):
        self.clear()
        self.number = self.number % 255 + 1
        if tx == 0x8000 | self.number:
            self.number = self.number % 255 + 1
        self.phase = "identify"
        self.segment.emit(1, bytes([self.number, 0]))

    # The CPU's side.

    def look(self):
        """True: a writer was in the middle, look again."""
        segment, again = self.segment, False
        state = segment[CPU_STATE]
        if state > 2 and state != self.cpu_state:
            segment.emit(8)
        self.cpu_state = state
        if segment[PARAMS] != self.seen_params:
            found = segment.read(PARAMS, 4096 + 24)
            again = found is None
            if found:
                data, self.seen_params = found
                self.parametrise(data)
        if segment[OUTPUTS] != self.seen_outputs:
            found = segment.read(OUTPUTS, 64)
            again = again or found is None
            if found:
                self.outputs, self.seen_outputs = found
        if not again:
            self.look_registers(*struct.unpack(">2H", self.outputs[:4]))
        return again

    def parametrise(self, data):
        (length,), parameters = struct.unpack("=Q", data[:8]), data[8:24]
        self.clear()
        try:
            if length > 4096:
                self.segment.emit(8)
            line = json.loads(data[24 : 24 + length] if length <= 4096 else "")["line"]
            kind, path = line.split(":", 1)
            if kind not in ("serial", "pty") or parameters[1] > 1:
                raise ValueError(line)
        except (ValueError, KeyError, TypeError, AttributeError):
            self.phase = "refused"
            self.segment.emit(7)
            self.segment[LEDS] = 1 | 8
            self.segment[STATE] = PARAMETER_ERROR | 0x100 << 32
            return
        self.silence = parameters[5] * 0.02 or 0.2
        error = self.open(kind, path)
        self.identify(struct.unpack(">H", self.outputs[2:4])[0])
        self.segment[LEDS], self.segment[MODEM] = 1, 0x30
        self.segment[STATE] = LINE_ERROR | error << 32 if error else READY

    def look_registers(self, rx, tx):
        reset, was_reset = rx == 0x8002, self.reset_seen
        self.reset_seen = reset
        if self.phase in ("identify", "clearing", "working") and reset and not was_reset:
            self.identify(tx)
        if self.phase == "identify" and rx == 0x8001 and tx == 0x8000 | self.number:
            self.phase = "clearing"
        if self.phase == "clearing" and (rx | tx) & 0x8000 == 0:
            self.phase = "working"
        if self.phase == "working":
            self.look_send(tx, self.outputs[4:16])
            self.look_receive(rx)

    def look_send(self, tx, block):
        kind, count = tx & 0xF800, tx & 0x7FF
        if self.sending == "closing" and tx != 0x2000:
            self.sending = "idle"
        if self.sending == "failed" and tx == 0x2000:
            self.sending = "closing"
        if self.sending == "idle" and kind in (0x4000, 0x800, 0x1000) and count:
            self.sending, self.code = "failed", 0x0C
        if kind:
            return
        collecting = self.sending == "collecting"
        if self.sending == "idle" and count > TELEGRAM:
            self.sending, self.code = "failed", 0x17
        elif self.sending == "idle" and count or collecting and self.rest > BLOCK and count == self.rest - BLOCK:
            self.collected = (self.collected if collecting else b"") + block[: min(count, BLOCK)]
            self.sending, self.rest = "collecting", count
        elif collecting and count == 0 and self.rest > BLOCK:
            self.sending = "idle"
        elif collecting and count == 0:
            self.sending, self.out = "sending", self.collected
            self.segment.count(ACCEPTED)

    def look_receive(self, echo):
        if self.offered and echo == self.offered:
            self.fetched += min(self.offered, BLOCK)
            self.offered = len(self.queue[0]) - self.fetched
            if self.offered == 0:
                self.closing = True
                self.queue.pop(0)
                self.segment.count(DELIVERED)
        if echo == 0:
            self.closing = False
        if not self.offered and not self.closing and self.queue and echo == 0:
            self.fetched, self.offered = 0, len(self.queue[0])

    def show(self):
        rx = tx = 0
        block = b""
        if self.phase == "identify":
            rx, tx = 0x8001, 0x8000 | self.number
        elif self.phase == "refused":
            rx, tx = 0x8003, 0x8000
        elif self.phase == "working":
            rx = self.offered
            tx = {"collecting": self.rest, "sending": self.rest, "failed": 0x2000 | self.code}.get(self.sending, 0)
            if rx:
                block = self.queue[0][self.fetched : self.fetched + BLOCK]
        registers = struct.pack(">2H", rx, tx) + block.ljust(60, b"\0")
        if registers != self.shown:
            self.shown = registers
            self.segment.write(INPUTS, registers)

    # The line.

    def close(self):
        for descriptor in self.descriptors:
            os.close(descriptor)
        if self.published:
            os.unlink(self.published)
        self.line, self.descriptors, self.published = None, [], None

    def open(self, kind, path):
        """0, or the error of the system. A pty is new, and the path becomes a link to it."""
        self.close()
        try:
            if kind == "pty":
                self.descriptors = list(pty.openpty())
                if os.path.islink(path):
                    os.unlink(path)
                os.symlink(os.ttyname(self.descriptors[1]), path)
                self.published = path
            else:
                self.descriptors = [os.open(path, os.O_RDWR | os.O_NOCTTY)]
            tty.setraw(self.descriptors[-1], termios.TCSANOW)
            termios.tcflush(self.descriptors[-1], termios.TCIOFLUSH)
        except (OSError, termios.error) as error:
            return error.args[0] or errno.EIO
        self.line = self.descriptors[0]
        os.set_blocking(self.line, False)
        return 0

    def end_telegram(self):
        silent = time.monotonic() - self.silent_since
        while self.coming and (len(self.coming) >= TELEGRAM or silent >= self.silence):
            telegram, self.coming = self.coming[:TELEGRAM], self.coming[TELEGRAM:]
            if len(self.queue) == QUEUE:
                self.segment.count(REJECTED)
            else:
                self.queue.append(telegram)
                self.segment.count(RECEIVED)

    def hear(self):
        self.end_telegram()
        try:
            while self.line is not None and (data := os.read(self.line, 4096)):
                self.segment.count(BYTES_RX, len(data))
                self.silent_since = time.monotonic()
                if self.phase == "working":
                    self.coming += data
                    self.end_telegram()
        except OSError:
            pass

    def transmit(self):
        if self.out:
            try:
                written = os.write(self.line, self.out)
            except OSError:
                return
            self.segment.count(BYTES_TX, written)
            self.out = self.out[written:]
        if self.sending == "sending" and not self.out:
            queued = array.array("i", [0])
            fcntl.ioctl(self.line, termios.TIOCOUTQ, queued)
            if queued[0] == 0:
                self.sending = "idle"
                self.segment.count(SENT)

    def is_soon(self):
        return self.sending == "sending" or bool(self.coming) or bool(self.queue and not self.offered)


def find(path):
    """The descriptor of the segment: from the socket on standard output, else by its path."""
    try:
        with socket.socket(fileno=os.dup(1)) as handed:
            _, descriptors, _, _ = socket.recv_fds(handed, 1, 16, socket.MSG_DONTWAIT)
            if descriptors:
                return descriptors[0]
    except OSError:
        pass
    try:
        return os.open(path, os.O_RDWR)
    except (OSError, TypeError):
        refuse("there is no segment")


def run(module, segment):
    """Until the doorbell closes."""
    poll = select.poll()
    poll.register(0, select.POLLIN)
    os.set_blocking(0, False)
    polled = None
    while True:
        mark = segment[CHANGES]
        module.hear()
        again = module.look()
        module.transmit()
        module.show()
        if module.line != polled:
            if polled is not None:
                poll.unregister(polled)
            if module.line is not None:
                poll.register(module.line, select.POLLIN)
            polled = module.line
        segment[SLEEPING] = 1
        with FENCE:  # a locked instruction: nothing passes it
            idle = segment[CHANGES] == mark
        ready = dict(poll.poll(0 if not idle else 1 if again or module.is_soon() else 50))
        if 0 in ready:
            try:
                while data := os.read(0, 65536):
                    pass
                if data == b"":
                    return
            except BlockingIOError:
                pass
        segment[SLEEPING] = 0
        segment[HEARTBEAT] += 1


BORN = time.monotonic_ns()
if __name__ == "__main__":
    for ignored in (signal.SIGINT, signal.SIGHUP):
        signal.signal(ignored, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
    named = dict(zip(sys.argv[1::2], sys.argv[2::2]))
    memory = Segment(find(named.get("--segment")))
    module = Module(memory)
    try:
        run(module, memory)
    finally:
        module.close()
