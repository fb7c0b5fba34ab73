#!/usr/bin/env python3
"""A DP slave on a serial line: an ET 200M with eight modules, simulated. Needs Python and nothing else.

    slave.py LINE [--station N]     LINE: the pty that the bus makes, or a serial device
    slave.py LINE --steps           for tests: plays JSON lines of its standard input, and ends with it
    slave.py --selftest             its telegrams, against known ones

Its outputs come back as its inputs: slots 3 and 4 (DO) are wired to slots 1 and 2 (DI), slot 7 (AO) to slots 5 and 6
(AI). Steps: {"inputs": HEX} senses that instead, {"report": HEX} has these blocks in its diagnosis, {"config": HEX} has
other modules, {"power": false} is silent, {"power": true} begins anew; each answers
{"state": ..., "outputs": HEX, "exchanges": N}.
"""

import argparse
import json
import os
import select
import sys
import time
import tty

IDENT = 0x7F01
DI, DO = bytes([0x42, 0x01, 0x01, 0x00]), bytes([0x82, 0x01, 0x02, 0x00])
AI, AO = b"\x51", b"\x61"
CONFIG = DI + DI + DO + DO + AI + AI + AO + DI
INPUTS, OUTPUTS = 2 + 2 + 4 + 4 + 2, 2 + 2 + 4
MASTER, DIAGNOSIS, PARAMETERS, CHECK, GLOBAL, GET = 62, 60, 61, 62, 58, 59
NOT_OPEN, DATA, DATA_HIGH = 3, 8, 10


def frame(da, sa, dsap, ssap, fc, data):
    body = bytes([da | (0x80 if dsap is not None else 0), sa | (0x80 if ssap is not None else 0), fc])
    body += bytes(sap for sap in (dsap, ssap) if sap is not None) + data
    tail = bytes([sum(body) & 0xFF, 0x16])
    if len(body) == 3:
        return b"\x10" + body + tail
    if len(body) == 11:
        return b"\xa2" + body + tail
    return bytes([0x68, len(body), len(body), 0x68]) + body + tail


def parse(received):
    """(da, sa, dsap, ssap, fc, data) or None, and how many bytes that takes; 0: more must come."""
    first = received[0]
    if first == 0xE5:
        return None, 1
    if first == 0xDC:
        return None, 3 if len(received) >= 3 else 0
    if first == 0x68:
        if len(received) < 4:
            return None, 0
        length, start = received[1], 4
        if received[2] != length or received[3] != 0x68 or not 4 <= length <= 249:
            return None, len(received)
    elif first in (0x10, 0xA2):
        length, start = 3 if first == 0x10 else 11, 1
    else:
        return None, len(received)
    end = start + length
    if len(received) < end + 2:
        return None, 0
    body = received[start:end]
    if received[end] != sum(body) & 0xFF or received[end + 1] != 0x16:
        return None, len(received)
    da, sa, fc, data = body[0], body[1], body[2], body[3:]
    dsap = ssap = None
    if da & 0x80:
        dsap, data = data[0], data[1:]
    if sa & 0x80:
        ssap, data = data[0], data[1:]
    return (da & 0x7F, sa & 0x7F, dsap, ssap, fc, data), end + 2


class Slave:
    def __init__(self, station):
        self.station, self.config, self.report, self.fixed = station, CONFIG, b"", None
        self.power, self.exchanges = True, 0
        self.begin()

    def begin(self):
        self.master, self.state, self.faults, self.last, self.tell = None, "parameters", 0, None, False
        self.leave()

    def leave(self):
        self.outputs, self.state, self.master, self.watchdog, self.over = bytes(OUTPUTS), "parameters", None, 0, None

    def inputs(self):
        if self.fixed is not None:
            return self.fixed
        return self.outputs[:4] + self.outputs[4:] * 2 + bytes(2)

    def trigger(self):
        if self.watchdog:
            self.over = time.monotonic() + self.watchdog

    def diagnosis(self):
        one = (0x02 if self.state != "exchange" else 0) | self.faults | (0x08 if self.report else 0)
        two = 0x04 | (0x01 if self.state == "parameters" else 0) | (0x08 if self.watchdog else 0)
        master = 0xFF if self.master is None else self.master
        return bytes([one, two, 0, master]) + IDENT.to_bytes(2, "big") + self.report

    def answer(self, telegram):
        da, sa, dsap, ssap, fc, data = telegram
        if not fc & 0x40 or not self.power:
            return None
        if da == 127:
            if dsap == GLOBAL and sa == self.master:
                self.trigger()
                if data[:1] and data[0] & 0x02:
                    self.outputs = bytes(OUTPUTS)
            return None
        if da != self.station:
            return None
        reply = lambda status, data=b"": frame(sa, da, ssap, dsap, status, data)
        if fc & 0x0F == 9:
            return frame(sa, da, None, None, 0, b"")
        if fc & 0x10 and self.last and self.last[0] == fc & 0x20:
            self.trigger()
            return self.last[1]
        if dsap == DIAGNOSIS:
            self.tell = False
            said = reply(DATA, self.diagnosis())
        elif dsap == GET:
            said = reply(DATA, self.config)
        elif dsap == PARAMETERS:
            self.parameters(sa, data)
            said = b"\xe5"
        elif dsap == CHECK and sa == self.master:
            if data == self.config:
                self.state = "exchange"
            else:
                self.leave()
                self.faults = 0x04
            said = b"\xe5"
        elif dsap is None and self.state == "exchange" and sa == self.master and len(data) == OUTPUTS:
            self.outputs = bytes(data)
            self.exchanges += 1
            said = reply(DATA_HIGH if self.tell else DATA, self.inputs())
        else:
            said = frame(sa, da, None, None, NOT_OPEN, b"")
        if sa == self.master:
            self.trigger()
        if fc & 0x30:
            self.last = (fc & 0x20, said)
        return said

    def parameters(self, sa, data):
        if self.master not in (None, sa):
            return
        self.leave()
        if len(data) < 7 or int.from_bytes(data[4:6], "big") != IDENT:
            self.faults = 0x40
            return
        self.faults, self.master, self.state = 0, sa, "config"
        self.watchdog = data[1] * data[2] / 100 if data[0] & 0x08 else 0

    def step(self, step):
        if "inputs" in step:
            self.fixed = bytes.fromhex(step["inputs"])
        if "report" in step:
            self.report, self.tell = bytes.fromhex(step["report"]), True
        if "config" in step:
            self.config = bytes.fromhex(step["config"])
        if "power" in step:
            self.power = step["power"]
            self.begin()
        return {"state": self.state, "outputs": self.outputs.hex(), "exchanges": self.exchanges}


def serve(args):
    slave, received = Slave(args.station), b""
    line = os.open(args.line, os.O_RDWR | os.O_NOCTTY)
    tty.setraw(line)
    print(json.dumps({"ready": True}), flush=True)
    steps, shown, lines = b"", None, [line]
    while True:
        wait = None if slave.over is None else max(0, slave.over - time.monotonic())
        ready, _, _ = select.select(lines + ([0] if args.steps else []), [], [], wait)
        if slave.over is not None and time.monotonic() >= slave.over:
            slave.leave()
        if 0 in ready:
            read = os.read(0, 4096)
            if not read:
                return
            *whole, steps = (steps + read).split(b"\n")
            for text in whole:
                print(json.dumps(slave.step(json.loads(text))), flush=True)
        if line in ready:
            try:
                read = os.read(line, 4096)
            except OSError:
                read = b""
            if not read and not args.steps:
                return  # Its other end is gone.
            lines = [line] if read else []
            received += read
        while received:
            telegram, used = parse(received)
            if not used:
                break
            received = received[used:]
            said = slave.answer(telegram) if telegram else None
            if said:
                os.write(line, said)
        if not args.steps and (slave.state, slave.outputs) != shown:
            shown = slave.state, slave.outputs
            print(f"{slave.state}: outputs {slave.outputs.hex(' ')}", flush=True)


def selftest():
    ask = bytes([0x68, 5, 5, 0x68, 0x88, 0x82, 0x6D, 0x3C, 0x3E, 0xF1, 0x16])
    assert frame(8, 2, DIAGNOSIS, MASTER, 0x6D, b"") == ask
    assert parse(ask) == ((8, 2, DIAGNOSIS, MASTER, 0x6D, b""), len(ask))
    assert parse(ask[:-1]) == (None, 0)
    assert parse(ask[:-2] + b"\0\x16")[0] is None
    slave = Slave(8)
    telegram, _ = parse(slave.answer(parse(ask)[0]))
    assert telegram == (2, 8, MASTER, DIAGNOSIS, DATA, bytes([0x02, 0x05, 0, 0xFF, 0x7F, 0x01]))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("line", nargs="?")
    parser.add_argument("--station", type=int, default=8)
    parser.add_argument("--steps", action="store_true")
    parser.add_argument("--selftest", action="store_true")
    arguments = parser.parse_args()
    if arguments.selftest:
        selftest()
    elif arguments.line:
        serve(arguments)
    else:
        parser.error("which line?")
    sys.exit(0)
