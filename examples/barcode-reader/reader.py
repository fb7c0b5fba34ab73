#!/usr/bin/env python3
"""A barcode reader on a tty: sends each code with CR LF, waits for ACK or NAK, and says what it was.

    reader.py TTY CODE...

A code that nobody answers within a second is sent again: the CP may still be starting.
"""

import os
import select
import sys
import tty

ANSWERS = {b"\x06": "ACK", b"\x15": "NAK"}


def read(line, code):
    while True:
        os.write(line, code.encode("ascii") + b"\r\n")
        if select.select([line], [], [], 1.0)[0]:
            return ANSWERS.get(os.read(line, 1), "?")


def main():
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    line = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    for code in sys.argv[2:]:
        print(code, read(line, code), flush=True)


try:
    main()
except OSError as error:
    sys.exit(f"reader.py: {sys.argv[1]}: {error.strerror}; does the station run, and is this its line?")
except KeyboardInterrupt:
    sys.exit("reader.py: ended by Ctrl-C")
