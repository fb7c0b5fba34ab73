#!/usr/bin/env python3
"""A 3964R partner, written from the CP 240 manual alone: [S0 L1594-1660], parameters [S0 L1931-2021].

It opens a tty and plays steps, one JSON object each, and prints what it saw as JSON lines. The steps come as one JSON
array on the command line, or line by line on standard input, where the next one is read when the last is through.

    {"do": "send", "data": "313233"}            one telegram, hex; also "text": "123"
        "bad_bcc": 1                            the first n blocks carry a wrong BCC
    {"do": "receive"}                           one telegram
        "omit_dle": 1                           n connection requests get no answer, so that the station's QVZ expires
        "nak_connect": 1                        n connection requests are refused with NAK
        "omit_end_dle": 1                       n good blocks get no answer
        "nak_block": 1                          n good blocks are refused with NAK
        "count": 3                              so many telegrams instead of one
    {"do": "echo", "count": 3}                  receive, send the same back; so many times
    {"do": "conflict", "data": "31"}            wait for the station's STX and answer with our own: the one with the lower
                                                priority gives way. As low priority this step receives, then sends
    {"do": "character", "data": "41"}           a character that is no STX while the line is idle: a NAK is due

Events: `sent` (with the number of `connects` and `blocks` it took), `received`, `conflict` (who gives way), `answer` (other
than DLE, to `stx` or `block`; `silence` when QVZ expired), `refused` (what we did not acknowledge and why), `idle` (a character
outside a telegram), `abandoned` (all repetitions used up; the step begins anew until its guard ends it), `gave_up`, `done`.

Exit code 0 when every step was played, 1 when one was given up, 2 for a wrong command line. No protocol time is waited out for
its own sake: QVZ and ZVZ end waits for a partner who is silent, and the guard (30 s a step) ends a test that hangs.
"""

import argparse
import errno
import json
import os
import select
import subprocess
import sys
import termios
import threading
import time
import tty

STX, ETX, DLE, NAK = 0x02, 0x03, 0x10, 0x15
# "This process is repeated 5 times" [S0 "Timeout times"]: one attempt and five repetitions.
ATTEMPTS = 6


class GaveUp(Exception):
    """The guard of a step ran out, or the line is gone."""


def encode(payload, spoil_bcc=False):
    """What follows the connection: data with each DLE doubled, DLE, ETX, BCC.

    BCC is the XOR over the entire data including the closing DLE/ETX [S0 "Block check character (BCC-Byte)"].
    """
    block = bytearray()
    for byte in payload:
        block.append(byte)
        if byte == DLE:
            block.append(DLE)
    block += bytes((DLE, ETX))
    bcc = 0
    for byte in block:
        bcc ^= byte
    block.append(bcc ^ 0x5A if spoil_bcc else bcc)
    return bytes(block)


class Line:
    """A tty, or one end of a pty, in raw mode: bytes with a deadline."""

    def __init__(self, fd):
        self.fd = fd
        self.ahead = bytearray()
        os.set_blocking(fd, False)

    @classmethod
    def open(cls, path, baud):
        fd = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        tty.setraw(fd, termios.TCSANOW)
        mode = termios.tcgetattr(fd)
        speed = getattr(termios, "B%d" % baud)
        mode[2] = (mode[2] & ~(termios.CSTOPB | termios.PARENB | termios.CSIZE)) | termios.CS8 | termios.CLOCAL | termios.CREAD
        mode[4] = mode[5] = speed
        termios.tcsetattr(fd, termios.TCSANOW, mode)
        return cls(fd)

    def read(self, until):
        """The next byte, or None when the clock passes `until`."""
        while not self.ahead:
            left = until - time.monotonic()
            if not select.select([self.fd], [], [], max(0.0, left))[0]:
                if left <= 0:
                    return None
                continue
            try:
                self.ahead += self._gone_if_empty(os.read(self.fd, 4096))
            except BlockingIOError:
                continue
            except OSError as why:
                if why.errno == errno.EIO:
                    raise GaveUp("the line is gone") from why
                raise
        return self.ahead.pop(0)

    @staticmethod
    def _gone_if_empty(data):
        if not data:
            raise GaveUp("the line is gone")
        return data

    def write(self, data, until):
        data = memoryview(data)
        while data:
            if not select.select([], [self.fd], [], max(0.0, until - time.monotonic()))[1]:
                raise GaveUp("the line takes no bytes")
            try:
                data = data[os.write(self.fd, data):]
            except BlockingIOError:
                continue


class Peer:
    """One station of the link. Times in seconds."""

    def __init__(self, line, high_priority, qvz, zvz, guard, report):
        self.line = line
        self.high_priority = high_priority
        self.qvz = qvz
        self.zvz = zvz
        self.guard = guard
        self.report = report
        self.until = 0.0

    # Small words

    def put(self, *bytes_):
        self.line.write(bytes(bytes_), self.until)

    def get(self, seconds):
        """A byte within `seconds`, else None; the guard ends the step."""
        now = time.monotonic()
        byte = self.line.read(min(now + seconds, self.until))
        if byte is None and time.monotonic() >= self.until:
            raise GaveUp("the guard of the step ran out")
        return byte

    def get_any(self):
        """A byte, however long it takes."""
        while True:
            byte = self.get(self.guard)
            if byte is not None:
                return byte

    # Sending

    def connect(self, take_over):
        """Sends STX until DLE comes back: the number of attempts, or None after the last [S0 "Timeout times"].

        `take_over` is called when the partner's STX crosses ours and ours is the lower priority; then nothing was sent
        and the connection is to be asked for anew [S0 "Initialization conflict"].
        """
        attempt = 0
        while attempt < ATTEMPTS:
            attempt += 1
            self.put(STX)
            end = time.monotonic() + self.qvz
            while True:
                answer = self.get(end - time.monotonic())
                if answer == STX and self.high_priority:
                    # The partner will give way: its DLE is still to come, and QVZ goes on.
                    self.report("conflict", gives_way="partner")
                    continue
                break
            if answer == DLE:
                return attempt
            if answer == STX:
                self.report("conflict", gives_way="self")
                take_over()
                attempt = 0
                continue
            self.report("answer", to="stx", byte=name(answer))
        self.put(NAK)
        return None

    def send(self, payload, bad_bcc=0):
        """One telegram; begins anew after an abandoned attempt, until the guard."""
        connects = blocks = 0
        while True:
            for _ in range(ATTEMPTS):
                made = self.connect(self.receive)
                if made is None:
                    break
                connects += made
                blocks += 1
                self.line.write(encode(payload, spoil_bcc=blocks <= bad_bcc), self.until)
                answer = self.get(self.qvz)
                if answer == DLE:
                    self.report("sent", data=payload.hex(), connects=connects, blocks=blocks)
                    return
                self.report("answer", to="block", byte=name(answer))
            else:
                self.put(NAK)
            self.report("abandoned", data=payload.hex())
            # A partner that is not ready answers at once; what it says next is no answer to us.
            self.get(self.qvz)

    # Receiving

    def wait_for_stx(self):
        """[S0 "Passive operation"]: NAK gets no answer, any other character but STX gets a NAK."""
        while True:
            byte = self.get_any()
            if byte == STX:
                return
            self.report("idle", byte=name(byte))
            if byte != NAK:
                self.put(NAK)

    def receive(self, stx_seen=True, omit_dle=0, nak_connect=0, omit_end_dle=0, nak_block=0):
        """One telegram, in spite of what we are told to do to the partner first."""
        while True:
            if not stx_seen:
                self.wait_for_stx()
            stx_seen = False
            if omit_dle > 0:
                omit_dle -= 1
                self.report("refused", what="connection", why="omit_dle")
                continue
            if nak_connect > 0:
                nak_connect -= 1
                self.report("refused", what="connection", why="nak_connect")
                self.put(NAK)
                continue
            self.put(DLE)
            payload, fault = self.block()
            if fault is not None:
                self.report("refused", what="block", why=fault, data=payload.hex())
                self.put(NAK)
            elif nak_block > 0:
                nak_block -= 1
                self.report("refused", what="block", why="nak_block", data=payload.hex())
                self.put(NAK)
            elif omit_end_dle > 0:
                omit_end_dle -= 1
                self.report("refused", what="block", why="omit_end_dle", data=payload.hex())
            else:
                self.put(DLE)
                self.report("received", data=payload.hex())
                return payload

    def block(self):
        """Data up to DLE/ETX/BCC: (payload, None), or (what came, the fault). ZVZ watches all of it [S0 "Timeout times"]."""
        payload, bcc, fault = bytearray(), 0, None
        while True:
            byte = self.get(self.zvz)
            if byte is None:
                return bytes(payload), "zvz"
            bcc ^= byte
            if byte != DLE:
                payload.append(byte)
                continue
            # A doubled DLE is saved as one; DLE/ETX is the end [S0 "Data Link Escape (DLE-character)"].
            byte = self.get(self.zvz)
            if byte is None:
                return bytes(payload), "zvz"
            bcc ^= byte
            if byte == DLE:
                payload.append(DLE)
            elif byte == ETX:
                break
            else:
                fault = "dle"
        check = self.get(self.zvz)
        if check is None:
            return bytes(payload), "zvz"
        if check != bcc:
            fault = fault or "bcc"
        return bytes(payload), fault

    # Steps

    def conflict(self, payload):
        """Lets the station ask first, then asks too, within its QVZ."""
        self.wait_for_stx()
        self.put(STX)
        if not self.high_priority:
            # Our request crossed its request, and ours is the one to give way.
            self.report("conflict", gives_way="self")
            self.receive()
            self.send(payload)
            return
        self.report("conflict", gives_way="partner")
        answer = self.get(self.qvz)
        if answer != DLE:
            self.report("answer", to="stx", byte=name(answer))
            self.send(payload)
            return
        self.line.write(encode(payload), self.until)
        answer = self.get(self.qvz)
        if answer == DLE:
            self.report("sent", data=payload.hex(), connects=1, blocks=1)
            return
        self.report("answer", to="block", byte=name(answer))
        self.send(payload)

    def character(self, data):
        self.put(*data)
        while True:
            answer = self.get_any()
            self.report("idle", byte=name(answer))
            if answer == NAK:
                return

    def play(self, step):
        self.until = time.monotonic() + float(step.pop("guard_s", self.guard))
        what = step.pop("do")
        if "text" in step:
            payload = step.pop("text").encode("latin-1")
        else:
            payload = bytes.fromhex(step.pop("data", ""))
        count = step.pop("count", 1)
        if what == "send":
            self.send(payload, **step)
        elif what == "receive":
            for _ in range(count):
                self.receive(stx_seen=False, **step)
                step = {}
        elif what == "echo":
            for _ in range(count):
                self.send(self.receive(stx_seen=False, **step))
        elif what == "conflict":
            self.conflict(payload, **step)
        elif what == "character":
            self.character(payload, **step)
        else:
            raise ValueError("unknown step `%s`" % what)


def name(byte):
    if byte is None:
        return "silence"
    return {STX: "STX", ETX: "ETX", DLE: "DLE", NAK: "NAK"}.get(byte, "%02x" % byte)


def play_all(peer, steps):
    """Plays; False when a step was given up."""
    for index, step in enumerate(steps):
        try:
            peer.play(dict(step))
        except GaveUp as why:
            peer.report("gave_up", step=index, why=str(why))
            return False
    peer.report("done")
    return True


# Self-test: two partners on the two ends of a pty


class Pair:
    """Plays two scenarios against each other and keeps the events of both."""

    def __init__(self, a_steps, b_steps, a_high=True, b_high=False):
        master, slave = os.openpty()
        tty.setraw(slave, termios.TCSANOW)
        self.ok, self.events = [False, False], [[], []]
        ends = ((master, a_high, a_steps), (slave, b_high, b_steps))
        threads = [threading.Thread(target=self._end, args=(index, *end)) for index, end in enumerate(ends)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        os.close(master)
        os.close(slave)

    def _end(self, index, fd, high, steps):
        def report(event, **more):
            self.events[index].append(dict(event=event, **more))

        peer = Peer(Line(fd), high, qvz=0.5, zvz=0.5, guard=20.0, report=report)
        self.ok[index] = play_all(peer, steps)

    def all(self, index, event):
        return [entry for entry in self.events[index] if entry["event"] == event]

    def received(self, index):
        return [entry["data"] for entry in self.all(index, "received")]


def selftest():
    def check(what, held, pair=None):
        print(json.dumps({"event": "check", "what": what, "held": bool(held)}), flush=True)
        if not held:
            if pair:
                print(json.dumps(pair.events), file=sys.stderr)
            failed.append(what)

    failed = []
    # The XOR of data, doubled DLEs, DLE and ETX, done by hand.
    vectors = {"31": "31100322", "414243": "414243100353", "10": "1010100313", "0210": "0210101003" + "11"}
    for payload, block in vectors.items():
        check("block of " + payload, encode(bytes.fromhex(payload)).hex() == block)

    payloads = [b"1", bytes(range(256))[:250], b"\x10" * 125, b"\x02\x10\x03\x15\x10\x10\x03", bytes(250)]
    hexes = [payload.hex() for payload in payloads]
    sends = [{"do": "send", "data": data} for data in hexes]
    pair = Pair(sends + [{"do": "receive", "count": len(hexes)}], [{"do": "receive", "count": len(hexes)}] + sends)
    check("telegrams both ways", all(pair.ok) and pair.received(0) == pair.received(1) == hexes, pair)

    pair = Pair([{"do": "send", "data": "3110", "bad_bcc": 1}], [{"do": "receive"}])
    refused = [entry["why"] for entry in pair.all(1, "refused")]
    answers = [(entry["to"], entry["byte"]) for entry in pair.all(0, "answer")]
    check("a wrong BCC gets a NAK", all(pair.ok) and "bcc" in refused and ("block", "NAK") in answers, pair)
    check("and the repetition arrives once", pair.received(1) == ["3110"] and pair.all(0, "sent")[0]["blocks"] >= 2, pair)

    for order, to, byte in (
        ("omit_dle", "stx", "silence"),
        ("nak_connect", "stx", "NAK"),
        ("omit_end_dle", "block", "silence"),
        ("nak_block", "block", "NAK"),
    ):
        pair = Pair([{"do": "send", "text": "x"}], [{"do": "receive", order: 2}])
        answers = [entry for entry in pair.all(0, "answer") if (entry["to"], entry["byte"]) == (to, byte)]
        check(order + " is repeated", all(pair.ok) and len(answers) >= 2 and pair.received(1) == ["78"], pair)

    for high in (True, False):
        first = [{"do": "conflict", "text": "a"}] + ([{"do": "receive"}] if high else [])
        second = [{"do": "send", "text": "b"}] + ([] if high else [{"do": "receive"}])
        pair = Pair(first, second, a_high=high, b_high=not high)
        gives_way = [pair.all(index, "conflict")[0]["gives_way"] for index in (0, 1)]
        wanted = ["partner", "self"] if high else ["self", "partner"]
        held = all(pair.ok) and gives_way == wanted and pair.received(0) == ["62"] and pair.received(1) == ["61"]
        check("conflict as %s priority" % ("high" if high else "low"), held, pair)

    pair = Pair([{"do": "character", "data": "41"}, {"do": "send", "text": "x"}], [{"do": "receive"}])
    check("a character that is no STX gets a NAK", all(pair.ok) and pair.all(0, "idle")[0]["byte"] == "NAK", pair)

    pair = Pair([{"do": "receive", "guard_s": 0.2}], [{"do": "receive", "guard_s": 0.2}])
    check("the guard ends a silent line", pair.ok == [False, False] and pair.all(0, "gave_up"), pair)

    # As a program on a path, its steps on standard input.
    master, slave = os.openpty()
    command = [sys.executable, os.path.abspath(__file__), os.ttyname(slave), "--priority", "high"]
    program = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    program.stdin.write(json.dumps({"do": "send", "text": "there"}) + "\n" + json.dumps({"do": "receive"}) + "\n")
    program.stdin.close()
    events = []
    peer = Peer(Line(master), False, 0.5, 0.5, 20.0, lambda event, **more: events.append(dict(event=event, **more)))
    held = play_all(peer, [{"do": "receive"}, {"do": "send", "text": "back"}])
    said = [json.loads(line) for line in program.stdout]
    program.wait()
    held = held and program.returncode == 0 and [entry["event"] for entry in said] == ["sent", "received", "done"]
    check("as a program", held and events[0]["data"] == b"there".hex() and said[1]["data"] == b"back".hex())
    os.close(master)
    os.close(slave)

    print(json.dumps({"event": "selftest", "failed": failed}), flush=True)
    return 1 if failed else 0


def main():
    options = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    options.add_argument("tty", nargs="?", help="path of the tty")
    options.add_argument("steps", nargs="?", help="JSON array of steps; without it they are read from standard input, one a line")
    options.add_argument("--priority", choices=("high", "low"), default="low")
    options.add_argument("--baud", type=int, default=115200)
    options.add_argument("--qvz-ms", type=int, default=500, help="acknowledgement delay time; the manual's default is 25 x 20 ms")
    options.add_argument("--zvz-ms", type=int, default=200, help="character delay time; the manual's default is 10 x 20 ms")
    options.add_argument("--guard-s", type=float, default=30.0, help="a step that takes longer has failed")
    options.add_argument("--selftest", action="store_true", help="two partners on the two ends of a pty")
    given = options.parse_args()
    if given.selftest:
        return selftest()
    if given.tty is None:
        options.error("which tty?")
    steps = json.loads(given.steps) if given.steps else (json.loads(line) for line in sys.stdin if line.strip())

    def report(event, **more):
        print(json.dumps(dict(event=event, **more)), flush=True)

    line = Line.open(given.tty, given.baud)
    peer = Peer(line, given.priority == "high", given.qvz_ms / 1000, given.zvz_ms / 1000, given.guard_s, report)
    return 0 if play_all(peer, steps) else 1


if __name__ == "__main__":
    sys.exit(main())
