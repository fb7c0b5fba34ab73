#!/usr/bin/env python3
"""A scale on a tty: answers STX W ETX with its weight.

    scale.py TTY [GRAMS]

A number on standard input is a new weight, with "moving" behind it one that is not stable yet; anything else is sent as it is.
The end of standard input ends the scale.
"""

import os
import select
import sys
import tty

STX, ETX = b"\x02", b"\x03"


def answer(line):
    words = line.split()
    try:
        grams = int(words[0])
    except (IndexError, ValueError):
        return line
    state = "D" if words[1:] == ["moving"] else "S"
    return f"{state} {'-' if grams < 0 else '+'}{abs(grams):07d} g"


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    line = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    shows = answer(sys.argv[2] if len(sys.argv) > 2 else "0")
    came = b""
    while True:
        ready = select.select([line, sys.stdin.fileno()], [], [])[0]
        if line in ready:
            heard = os.read(line, 64)
            if not heard:
                sys.exit("scale.py: the line is closed")
            came += heard
            if STX + b"W" + ETX in came:
                came = b""
                os.write(line, STX + shows.encode("ascii") + ETX)
        if sys.stdin.fileno() in ready:
            text = os.read(sys.stdin.fileno(), 256)
            if not text:
                print("scale.py: standard input is closed: end", file=sys.stderr)
                return
            shows = answer(text.decode().strip())


try:
    main()
except OSError as error:
    sys.exit(f"scale.py: {sys.argv[1]}: {error.strerror}; does the station run, and is this its line?")
except KeyboardInterrupt:
    sys.exit("scale.py: ended by Ctrl-C")
