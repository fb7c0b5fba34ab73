#!/usr/bin/env python3
"""Meters on an M-Bus level converter: answers requests with real meter frames.

    meter.py TTY ADDRESS=FRAME ...

FRAME is the answer of the meter with this primary address, in hexadecimal, from 68 to 16. A meter acknowledges SND_NKE and SND_UD (E5),
answers REQ_UD2, and can be selected by its secondary address (253); 254 reaches them all, 255 too, without an answer. Words on standard
input change what happens next: "silent ADDRESS" and "loud ADDRESS", "check ADDRESS" (one answer with a wrong check sum), "echo on" and
"echo off" (a converter that sends back what it hears). The end of standard input ends the meters.
"""

import os
import select
import sys
import tty

ACK = b"\xe5"
SELECTED, ANY, ALL = 253, 254, 255


class Meter:
    def __init__(self, address, answer):
        self.address, self.answer = address, answer
        self.secondary = answer[7:15]
        self.selected = self.silent = False
        self.wrong = 0

    def is_meant(self, pattern):
        """Fh stands for any digit of the identification, FFh for any byte behind it."""
        if len(pattern) < 8:
            return False
        digits = zip(self.secondary[:4].hex(), pattern[:4].hex())
        return all(w in ("f", o) for o, w in digits) and all(w in (255, o) for o, w in zip(self.secondary[4:], pattern[4:8]))

    def hear(self, c, a, rest):
        if a == SELECTED and rest[:1] == b"\x52":
            self.selected = self.is_meant(rest[1:])
            return ACK if self.selected else b""
        if not (a == self.address or a in (ANY, ALL) or a == SELECTED and self.selected):
            return b""
        answer = self.answer if c & 0x4F == 0x4B else ACK
        if self.wrong and answer is self.answer:
            self.wrong -= 1
            answer = answer[:-2] + bytes([answer[-2] ^ 0x55]) + answer[-1:]
        return b"" if a == ALL or self.silent else answer


def frame(came):
    """C, A and the rest of a whole frame at the beginning, and what is left; None: not yet."""
    while came and came[0] not in (0x10, 0x68):
        came = came[1:]
    if came[:1] == b"\x10" and len(came) >= 5:
        return (came[1], came[2], b""), came[5:]
    if came[:1] == b"\x68" and len(came) >= 6 and len(came) >= came[1] + 6:
        length = came[1] + 6
        return (came[4], came[5], came[6 : length - 2]), came[length:]
    return None, came


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    line = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    meters = [Meter(int(address), bytes.fromhex(answer)) for address, answer in (arg.split("=") for arg in sys.argv[2:])]
    came, echo, words = b"", False, b""
    while True:
        ready = select.select([line, sys.stdin.fileno()], [], [])[0]
        if sys.stdin.fileno() in ready:
            text = os.read(sys.stdin.fileno(), 256)
            if not text:
                print("meter.py: standard input is closed: end", file=sys.stderr)
                return
            words += text
            *lines, words = words.split(b"\n")
            for word, what in (said.decode().split() for said in lines if said.strip()):
                if word == "echo":
                    echo = what == "on"
                for meter in meters:
                    if what == str(meter.address):
                        meter.silent = word == "silent" if word != "check" else meter.silent
                        meter.wrong += word == "check"
            print("ok", flush=True)
        if line in ready:
            heard = os.read(line, 512)
            if not heard:
                sys.exit("meter.py: the line is closed")
            if echo:
                os.write(line, heard)
            came += heard
            found, came = frame(came)
            while found:
                answers = [answer for answer in (meter.hear(*found) for meter in meters) if answer]
                if answers:
                    # Who sends at the same time as another pulls its bits to 0.
                    longest = max(len(answer) for answer in answers)
                    mixed = bytearray(b"\xff" * longest)
                    for answer in answers:
                        for at, byte in enumerate(answer):
                            mixed[at] &= byte
                    os.write(line, bytes(mixed))
                found, came = frame(came)


try:
    main()
except OSError as error:
    sys.exit(f"meter.py: {sys.argv[1]}: {error.strerror}; does the station run, and is this its line?")
except KeyboardInterrupt:
    sys.exit("meter.py: ended by Ctrl-C")
