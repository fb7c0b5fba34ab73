#!/usr/bin/env python3
"""An RK 512 partner on the 3964R one beside it (`s3964r.py`), written from the CP 240 manual [S0 L1663-1796] and the telegram tables.

Both roles at once: while it waits for the reaction to an order of its own it serves the station's. It has a memory of 255 data blocks
of 256 words, all 0 at the start. Steps, one JSON object each, as in `s3964r.py`:

    {"do": "put", "db": 21, "dw": 0, "data": "0102"}        SEND to a data block; also "flag": "0604"
    {"do": "fetch", "area": "D", "db": 22, "dw": 0, "length": 2}    FETCH; length in words (bytes for M, E, A)
    {"do": "raw", "data": "0000424405.."}                   any telegram, then a reaction
    {"do": "serve", "count": 3, "refuse": "32"}             so many whole orders of the station; refused with that number, if given

Events: `reaction` (error number and data of the reaction to our order, of all its telegrams), `order` (an order of the station: command,
area, db, dw, flag, data), and those of the 3964R partner.
"""

import argparse
import json
import os
import sys
import termios
import threading
import time
import tty

import s3964r
from s3964r import GaveUp, Line, Peer

PIECE = 128
WORDS = "DXZT"


class Rk512(Peer):
    """One station of the link."""

    def __init__(self, *args):
        super().__init__(*args)
        self.memory = {number: bytearray(512) for number in range(1, 256)}
        self.inbox = []
        # The station's order that is under way: header fields and data so far, and what is still to go out.
        self.job = None
        self.served = 0
        self.refusal = 0

    # Telegrams

    def connect(self, take_over):
        # Low priority: what comes first is dealt with later, in its order.
        return super().connect(lambda: self.inbox.append(take_over()))

    def next_telegram(self):
        return self.inbox.pop(0) if self.inbox else self.receive(stx_seen=False)

    def order(self, telegrams):
        """Sends the telegrams of an order one by one; the data of the reactions, or the error number that ended it."""
        data = bytearray()
        for telegram in telegrams:
            self.send(telegram)
            code, more = self.reaction(telegram[0])
            data += more
            if code:
                return code, bytes(data)
        return 0, bytes(data)

    def reaction(self, first):
        """Byte 3 tells reactions (00h) from orders; the station's orders may come before its reaction."""
        while True:
            telegram = self.next_telegram()
            if len(telegram) >= 4 and telegram[2] == 0:
                if telegram[0] != first or telegram[1] != 0:
                    raise GaveUp("a reaction %s to a telegram %02x" % (telegram[:4].hex(), first))
                return telegram[3], telegram[4:]
            self.serve(telegram)

    # Active

    def put_order(self, db, dw, data, flag=b"\xff\xff"):
        """[S0 "Structure of the output message"], [S0 "Structure of additional messages"]"""
        header = b"\0\0AD" + bytes((db, dw)) + (len(data) // 2).to_bytes(2, "big") + flag
        pieces = [data[at:at + PIECE] for at in range(0, len(data), PIECE)] or [b""]
        return [header + pieces[0]] + [b"\xff\0AD" + piece for piece in pieces[1:]]

    def fetch_order(self, area, db, dw, length, flag=b"\xff\xff"):
        """[S0 "Structure of the input message"]"""
        letter = area.encode("ascii")
        header = b"\0\0E" + letter + bytes((db, dw)) + length.to_bytes(2, "big") + flag
        size = length * (2 if area in WORDS else 1)
        follow = max(0, -(-size // PIECE) - 1)
        return [header] + [b"\xff\0E" + letter] * follow

    # Passive

    def serve(self, telegram):
        """One telegram of the station, and the reaction to it."""
        if telegram[0] == 0:
            command, area, db, dw = chr(telegram[2]), chr(telegram[3]), telegram[4], telegram[5]
            length = int.from_bytes(telegram[6:8], "big") * (2 if area in WORDS else 1)
            self.job = dict(command=command, area=area, db=db, dw=dw, flag=telegram[8:10].hex(), length=length)
            self.job["data"] = bytearray(telegram[10:])
            self.job["sent"] = 0
        elif self.job is None:
            raise GaveUp("a follow-on telegram without an order")
        else:
            self.job["data"] += telegram[4:]
        job = self.job
        if job["command"] == "A":
            whole = len(job["data"]) == job["length"]
            code = self.refusal if whole else 0
            if whole and not code:
                at = 2 * job["dw"]
                self.memory[job["db"]][at:at + job["length"]] = job["data"]
            self.end_order(whole)
            self.send(bytes((telegram[0], 0, 0, code)))
            return
        at = 2 * job["dw"] + job["sent"]
        piece = bytes(self.memory[job["db"]][at:2 * job["dw"] + job["length"]][:PIECE])
        job["sent"] += len(piece)
        if self.refusal:
            piece = b""
        self.end_order(self.refusal or job["sent"] == job["length"])
        self.send(bytes((telegram[0], 0, 0, self.refusal)) + piece)

    def end_order(self, whole):
        if whole:
            job, self.job = self.job, None
            self.served += 1
            told = {key: job[key] for key in ("command", "area", "db", "dw", "flag")}
            self.report("order", data=job["data"].hex(), **told)

    # Steps

    def play(self, step):
        what = step["do"]
        if what not in ("put", "fetch", "raw", "serve"):
            super().play(step)
            return
        self.until = time.monotonic() + float(step.get("guard_s", self.guard))
        data = bytes.fromhex(step.get("data", ""))
        flag = bytes.fromhex(step.get("flag", "ffff"))
        if what == "serve":
            self.refusal = int(step.get("refuse", "0"), 16)
            until = self.served + step.get("count", 1)
            while self.served < until:
                self.serve(self.next_telegram())
            self.refusal = 0
            return
        if what == "put":
            telegrams = self.put_order(step["db"], step["dw"], data, flag)
        elif what == "fetch":
            telegrams = self.fetch_order(step["area"], step.get("db", 0), step["dw"], step["length"], flag)
        else:
            telegrams = [data]
        code, data = self.order(telegrams)
        self.report("reaction", code="%02x" % code, data=data.hex())


def selftest():
    """Two partners on a pty: one gives orders, the other serves them."""
    failed = []

    def check(what, held):
        print(json.dumps({"event": "check", "what": what, "held": bool(held)}), flush=True)
        if not held:
            failed.append(what)

    peer = Rk512(None, True, 0.5, 0.5, 20.0, None)
    # The samples: SEND to DB 5, DW 1, 8 words; FETCH of 32 bytes from MB 16 with M 6.4.
    sample = peer.put_order(5, 1, bytes(range(1, 17)))[0].hex()
    check("SEND", sample == "00004144050100 08ffff".replace(" ", "") + bytes(range(1, 17)).hex())
    check("FETCH", peer.fetch_order("M", 0, 16, 32, b"\x06\x04")[0].hex() == "0000454d001000200604")
    check("follow-on", [len(t) for t in peer.put_order(5, 0, bytes(300))] == [138, 132, 48])

    block = bytes(i % 251 for i in range(300))
    active = [
        {"do": "put", "db": 7, "dw": 3, "data": block.hex()},
        {"do": "fetch", "area": "D", "db": 7, "dw": 3, "length": 150},
        {"do": "put", "db": 7, "dw": 0, "data": "0000"},
    ]
    passive = [{"do": "serve", "count": 2}, {"do": "serve", "refuse": "32"}]
    master, slave = os.openpty()
    tty.setraw(slave, termios.TCSANOW)
    ok, events = [False, False], [[], []]

    def end(index, fd, steps):
        def report(event, **more):
            events[index].append(dict(event=event, **more))

        ok[index] = s3964r.play_all(Rk512(Line(fd), index == 0, 0.5, 0.5, 20.0, report), steps)

    threads = [threading.Thread(target=end, args=a) for a in ((0, master, active), (1, slave, passive))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    reactions = [(e["code"], e["data"]) for e in events[0] if e["event"] == "reaction"]
    check("both ended", all(ok))
    check("there, back and refused", reactions == [("00", ""), ("00", block.hex()), ("32", "")])
    return 1 if failed else 0


def main():
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("tty", nargs="?", help="device, or the end of a pty")
    options.add_argument("--priority", choices=("high", "low"), default="low")
    options.add_argument("--baud", type=int, default=115200)
    options.add_argument("--qvz-ms", type=int, default=500)
    options.add_argument("--zvz-ms", type=int, default=200)
    options.add_argument("--guard-s", type=float, default=30.0)
    options.add_argument("--selftest", action="store_true", help="two partners on the two ends of a pty")
    given = options.parse_args()
    if given.selftest:
        return selftest()
    if given.tty is None:
        options.error("which tty?")

    def report(event, **more):
        print(json.dumps(dict(event=event, **more)), flush=True)

    line = Line.open(given.tty, given.baud)
    high = given.priority == "high"
    peer = Rk512(line, high, given.qvz_ms / 1000, given.zvz_ms / 1000, given.guard_s, report)
    return 0 if s3964r.play_all(peer, (json.loads(text) for text in sys.stdin if text.strip())) else 1


if __name__ == "__main__":
    sys.exit(main())
