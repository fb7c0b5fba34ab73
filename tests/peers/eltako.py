#!/usr/bin/env python3
"""EnOcean's serial protocol (ESP2) with a program that is not ours: eltako14bus, on a tty at 9600 baud.

    eltako.py module TTY --id-base FF800080     in the place of the module inside a CP 240: answers RD_IDBASE, sends radio telegrams
    eltako.py control TTY                       in the place of a CPU: asks a module for its ID base and version, has it send telegrams

Steps come as JSON, one a line, on standard input; what the library has understood of the line goes to standard output, one JSON line a
telegram. The end of the input ends it.

    {"org": "rps", "id": "00121c7a", "data": "50", "status": 48}      rps, 1bs, 4bs; "outgoing": true makes it a telegram to be sent
    {"ask": "id_base"}                                               id_base, version: the library's own requests
"""

import argparse
import asyncio
import json
import os
import sys
import threading
import tty

import serial
from eltakobus import AddressExpression, EltakoMessage, Regular1BSMessage, Regular4BSMessage, RPSMessage, RS485SerialInterfaceV2

ORGS = {"rps": RPSMessage, "1bs": Regular1BSMessage, "4bs": Regular4BSMessage}
RD_IDBASE = 0x58


def patient(open_port):
    """The library gives up a write after 0.1 s; a busy machine may take longer than that."""
    return lambda *args, **options: open_port(*args, **{**options, "write_timeout": 20.0})


serial.serial_for_url = patient(serial.serial_for_url)


def described(message):
    """What the library has made of a telegram."""
    event = {"telegram": type(message).__name__, "bytes": bytes(message.body).hex()}
    for name in ("address", "data"):
        value = getattr(message, name, None)
        if isinstance(value, (bytes, bytearray)):
            event[name] = value.hex()
    for name in ("outgoing", "status", "rp_count", "nu", "t21", "org", "is_request"):
        if hasattr(message, name):
            event[name] = getattr(message, name)
    return event


class Peer:
    def __init__(self, path, id_base, report):
        """`id_base` is that of a module, None for one who controls a module."""
        self.id_base, self.report = id_base, report
        # Its test for an echo writes characters that are no frame; ours must get over them.
        self.bus = RS485SerialInterfaceV2(path, callback=self.heard, baud_rate=9600, auto_reconnect=False)
        self.bus.start()
        if not self.bus.is_serial_connected.wait(20.0):
            raise SystemExit("eltako: %s is not to be opened" % path)
        report(event="ready", echo=self.bus.suppress_echo)

    def heard(self, message):
        self.report(event="heard", **described(message))
        is_question = isinstance(message, EltakoMessage) and message.is_request and message.org == RD_IDBASE
        if is_question and self.id_base is not None:
            address = AddressExpression((self.id_base, None))
            self.send(self.bus.create_base_id_info_message(address, 0))

    def send(self, message):
        asyncio.run(self.bus.send(message))

    def play(self, step):
        if "ask" in step:
            ask = {"id_base": self.bus.send_base_id_request, "version": self.bus.send_version_request}[step["ask"]]
            asyncio.run(ask())
        else:
            make, value = ORGS[step["org"]], bytes.fromhex
            self.send(make(value(step["id"]), step["status"], value(step["data"]), step.get("outgoing", False)))

    def end(self):
        while not self.bus.transmit.empty():
            self.bus.transmit.join()
        self.bus.stop()
        self.bus.join()


def reporter():
    lock = threading.Lock()

    def report(**event):
        with lock:
            print(json.dumps(event), flush=True)

    return report


def selftest():
    """A module and a controller on the two ends of a line, and the frames they exchange, byte by byte."""
    failed = []

    def check(what, good):
        if not good:
            failed.append(what)
            print("FAILED: " + what)

    ends = [os.openpty(), os.openpty()]
    for pair in ends:
        for end in pair:
            tty.setraw(end)
    passed = [b"", b""]

    def carry(source, target, index):
        while True:
            try:
                data = os.read(source, 100)
            except OSError:
                return
            passed[index] += data
            os.write(target, data)

    masters = [pair[0] for pair in ends]
    for index in (0, 1):
        threading.Thread(target=carry, args=(masters[index], masters[1 - index], index), daemon=True).start()
    heard, done = [[], []], threading.Condition()

    def of(index):
        def report(**event):
            with done:
                heard[index].append(event)
                done.notify_all()

        return report

    def until(index, count):
        """So many telegrams have been heard there."""
        with done:
            telegrams = lambda: [event for event in heard[index] if event["event"] == "heard"]
            check("%d telegrams" % count, done.wait_for(lambda: len(telegrams()) >= count, 20.0))
            return telegrams()

    module = Peer(os.ttyname(ends[0][1]), bytes.fromhex("ff800080"), of(0))
    control = Peer(os.ttyname(ends[1][1]), None, of(1))
    control.play({"ask": "id_base"})
    control.play({"org": "rps", "id": "ff8000e7", "data": "02", "status": 6, "outgoing": True})
    asked, sent = until(0, 2)
    module.play({"org": "4bs", "id": "01020304", "data": "0a0b0c08", "status": 1})
    base, sensor = until(1, 2)
    check("RD_IDBASE", asked["bytes"] == "ab58" + 9 * "00")
    check("TX_TELEGRAM", (sent["telegram"], sent["address"], sent["outgoing"]) == ("RPSMessage", "ff8000e7", True))
    check("INF_IDBASE", base["bytes"] == "8b98ff800080" + 5 * "00")
    check("RX_TELEGRAM", (sensor["telegram"], sensor["data"]) == ("Regular4BSMessage", "0a0b0c08"))
    check("the frame", bytes.fromhex("a55a6b0502000000ff8000e706de") in passed[1])
    control.end()
    module.end()
    return 1 if failed else 0


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("role", nargs="?", choices=("module", "control"))
    options.add_argument("tty", nargs="?", help="device, or the end of a pty")
    options.add_argument("--id-base", default="FF800080")
    options.add_argument("--selftest", action="store_true", help="a module and a controller on the two ends of a line")
    given = options.parse_args()
    if given.selftest:
        return selftest()
    if given.role is None or given.tty is None:
        options.error("which role, and which tty?")
    id_base = bytes.fromhex(given.id_base) if given.role == "module" else None
    peer = Peer(given.tty, id_base, reporter())
    for line in sys.stdin:
        if line.strip():
            peer.play(json.loads(line))
    peer.end()
    return 0


if __name__ == "__main__":
    sys.exit(main())
