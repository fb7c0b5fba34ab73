#!/usr/bin/env python3
"""A judge of block status over S7 communication, with a client of its own.

    s7_status.py HOST PORT [--pdu 960] [--seed 1]

It uploads the blocks of a CPU whose program does the same in each scan (`s7_programs.py`), executes their machine code (`mc7_cpu.py`),
asks for the status of every block in both forms, and compares line by line: a line that ran has the registers behind it, those of the
last round of a loop; a line that did not run is not told. A line that belongs to a CALL has the registers behind that CALL. The last
line of the output is the verdict.
"""

import argparse
import random
import socket
import struct
import sys
import threading

import mc7
import mc7_cpu
from s7_programs import SCANS

TYPES = {"OB": 0x08, "FC": 0x0C, "FB": 0x0E, "DB": 0x0A}
LETTERS = {"OB": "8", "DB": "A", "FC": "C", "FB": "E"}
# Registers of a line: bit in the form 01/13, bit in 01/01 (None: always there), bytes.
REGISTERS = [("STW", 0x01, None, 2), ("ACCU1", 0x02, 0x01, 4), ("ACCU2", 0x04, 0x01, 4), ("AR1", 0x08, 0x02, 4), ("AR2", 0x10, 0x04, 4),
             ("DB and DI", 0x20, 0x08, 6)]
# Form: all registers of a line; bytes of the result in front of its lines.
FORMS = {0x13: 0x3F, 0x01: 0x0F}
HEADS = {0x13: 2, 0x01: 4}
# To rack 0, slot 2, with TPDUs of 1024 bytes.
CONNECT = bytes.fromhex("0300001611e00000000100c0010ac1020100c2020102")

# The number of the scan that the judge executes. That of the CPU is as far ahead in all lines of a result: they are of one pass.
NUMBER = 0xC0DEFACE


class Refused(Exception):
    pass


class Client:
    """One connection as a programming device; one request at a time."""

    def __init__(self, host, port, pdu):
        self.socket = socket.create_connection((host, port), 10)
        self.stream = self.socket.makefile("rb")
        self.socket.sendall(CONNECT)
        if self.packet()[5] != 0xD0:
            raise Refused("the connection")
        self.reference = 0
        answer, _ = self.job(struct.pack(">BBHHH", 0xF0, 0, 1, 1, pdu))
        self.pdu = int.from_bytes(answer[6:8], "big")

    def packet(self):
        head = self.stream.read(4)
        packet = head + self.stream.read(max(0, int.from_bytes(head[2:], "big") - 4))
        if len(packet) < 7:
            raise Refused("the connection was closed")
        return packet

    def send(self, kind, parameters, data):
        self.reference = (self.reference + 1) & 0xFFFF
        telegram = struct.pack(">BBHHHH", 0x32, kind, 0, self.reference, len(parameters), len(data)) + parameters + data
        self.socket.sendall(struct.pack(">BBHBBB", 3, 0, len(telegram) + 7, 2, 0xF0, 0x80) + telegram)

    def receive(self):
        """Kind, parameters, data of the next telegram."""
        telegram = self.packet()[7:]
        kind, parameters, data = telegram[1], *struct.unpack(">HH", telegram[6:10])
        at = 12 if kind in (2, 3) else 10
        if kind in (2, 3) and telegram[10:12] != b"\0\0":
            raise Refused(telegram[10:12].hex())
        return kind, telegram[at:at + parameters], telegram[at + parameters:at + parameters + data]

    def job(self, parameters, data=b""):
        self.send(1, parameters, data)
        kind, parameters, data = self.receive()
        if kind != 3:
            raise Refused("kind %d" % kind)
        return parameters, data

    def user_data(self, group, function, data, long=False, sequence=0):
        """Parameters and data of the answer."""
        head = [0, 1, 0x12, 8, 0x12, 0x40 | group, function, sequence, 0, 0, 0, 0] if long else [0, 1, 0x12, 4, 0x11, 0x40 | group, function, 0]
        self.send(7, bytes(head), (struct.pack(">BBH", 0xFF, 9, len(data)) if data else b"\x0a\0\0\0") + data)
        return self.answer(0x80 | group, function)

    def answer(self, group, function):
        kind, parameters, data = self.receive()
        if (kind, parameters[5], parameters[6]) != (7, group, function):
            raise Refused("kind %d, function %02x/%02x instead of %02x/%02x" % (kind, parameters[5], parameters[6], group, function))
        if parameters[10:12] != b"\0\0":
            raise Refused(parameters[10:12].hex())
        return parameters, data[4:]

    def numbers(self, kind):
        """Of the blocks of one type."""
        try:
            parameters, data = self.user_data(3, 2, b"0" + LETTERS[kind].encode())
        except Refused as why:
            if str(why) == "d20e":  # there is none
                return []
            raise
        while parameters[9]:
            parameters, more = self.user_data(3, 2, b"", True, parameters[7])
            data += more
        return sorted(int.from_bytes(data[at:at + 2], "big") for at in range(0, len(data), 4))

    def upload(self, kind, number):
        name = b"_0%s%05dA" % (LETTERS[kind].encode(), number)
        begun, _ = self.job(b"\x1d\0\0\0\0\0\0\0\x09" + name)
        handle, block, more = begun[4:8], b"", 1
        while more:
            parameters, data = self.job(b"\x1e\0\0\0" + handle)
            more, block = parameters[1] & 1, block + data[4:4 + int.from_bytes(data[:2], "big")]
        self.job(b"\x1f\0\0\0" + handle)
        return block

    # Block status

    def status(self, form, parameters, data, length, once):
        """Sets a job up, and gives its one result. `parameters` begins with the trigger."""
        begin, end = (0, 1) if once else (1, 0)
        words = [0, begin, end, length, 1, 1, 1, 1, 1, *parameters]
        job = self.set_up(form, struct.pack(">%dH" % len(words), *words), data)
        if not once:
            self.set_up(0x0E, struct.pack(">10H", 0, 1, 0, 0, 0, 1, 1, 1, 1, 0), bytes([form, job]))
        pushed, result = self.answer(0x01, form)
        if pushed[7] != job:
            raise Refused("a result of job %d instead of %d" % (pushed[7], job))
        if not once:
            self.set_up(0x0F, struct.pack(">10H", 0, 0, 1, 0, 0, 1, 1, 1, 1, 0), bytes([0, 1, form, job]))
        head, size = struct.unpack(">HH", result[:4])
        if result[4:6] != b"\1\0" or len(result) != 4 + head + size:
            raise Refused("lengths of a result: " + result[:8].hex())
        return result[4 + head:]

    def set_up(self, function, parameters, data):
        answer, _ = self.user_data(1, function, struct.pack(">HH", len(parameters), len(data)) + parameters + data, True)
        return answer[7]


def parts(block):
    """Machine code or data of an uploaded block, and its local data."""
    if block[:2] != b"pp" or int.from_bytes(block[8:12], "big") != len(block):
        raise Refused("a block without its head, or cut")
    local, length = struct.unpack(">HH", block[32:36])
    return block[36:36 + length], local


def request(form, lines, every):
    """The data of a request; `lines` is address -> wanted registers, `every` all addresses of the range in order."""
    if form == 0x13:
        return bytes([0, len(lines), 0, 0]) + b"".join(struct.pack(">HBB", at, 0, wanted) for at, wanted in sorted(lines.items()))
    pairs = b"\x80\0"
    for at, following in every:
        pairs += bytes([0x80, lines.get(at, 0x80)]) + b"\0\0" * ((following - at) // 2 - 1)
    return pairs


def chosen(form, wanted):
    """Which of the registers a line has."""
    return [bool(wanted & new if form == 0x13 else old is None or wanted & old) for _, new, old, _ in REGISTERS]


def width(form, wanted):
    return sum(size for has, (*_, size) in zip(chosen(form, wanted), REGISTERS) if has)


def line(form, wanted, registers):
    """As hexadecimal digits, with dots for what is not known."""
    loose_rlo, stw, *double, db, di = registers
    values = ["%03x" % (stw >> 4) + ("." if loose_rlo else "%x" % (stw & 15))] + ["." * 8 if value is None else "%08x" % value for value in double]
    kind, number = ("..", "....") if db is None else ("%02x" % (0x0A if db else 0), "%04x" % db)
    values.append("%s%02x%s%04x" % (kind, 0x0A if di else 0, number, di))
    return "".join(value for has, value in zip(chosen(form, wanted), values) if has)


def equal(expected, seen):
    """Of a line that ran, or did not (None)."""
    if expected is None or seen is None:
        return expected is seen
    return len(expected) == len(seen) and all(one in (".", other) for one, other in zip(expected, seen))


def told(form, lines, result):
    """Address -> bytes of the lines of a result."""
    at, found = HEADS[form], {}
    while at < len(result):
        address = int.from_bytes(result[at:at + 2], "big")
        if address not in lines:
            raise Refused("a line %04X that was not asked for" % address)
        size = width(form, lines[address])
        if len(result) < at + 2 + size or address in found:
            raise Refused("line %04X is cut, or comes twice" % address)
        found[address] = result[at + 2:at + 2 + size].hex()
        at += 2 + size
    return found


class Program:
    """The blocks of a CPU, and what one scan does with them."""

    def __init__(self, client):
        self.code = {}
        for kind in ("OB", "FC", "FB"):
            for number in client.numbers(kind):
                code, local = parts(client.upload(kind, number))
                self.code[kind, number] = (mc7.statements(code), local)
        data = {number: bytearray(parts(client.upload("DB", number))[0]) for number in client.numbers("DB")}
        self.passes = self.settled(mc7_cpu.Cpu(self.code, data))

    @staticmethod
    def settled(cpu):
        """The passes of a scan that is like the one before."""
        before = None
        for _ in range(4):
            # OB 1 counts.
            cpu.areas[mc7.M][SCANS:SCANS + 4] = (NUMBER - 1).to_bytes(4, "big")
            passes = cpu.scan()
            trace = [(one.block, one.path(), one.behind) for one in passes]
            if trace == before:
                return passes
            before = trace
        raise Refused("the program does not do the same in each scan")

    def watched(self):
        """Each block with its first pass; where it has several callers or instances, also the first pass of each, with
        the call environment that chooses it: a block that is in the path of calls, or an instance.
        """
        for block in dict.fromkeys(one.block for one in self.passes):
            of = [one for one in self.passes if one.block == block]
            yield of[0], []
            for kind, number in dict.fromkeys(one.caller.block for one in of if one.caller and one.caller.block not in of[0].path()):
                yield next(one for one in of if (kind, number) in one.path()), [0, 0x0001, TYPES[kind], number]
            for instance in dict.fromkeys(one.opened[1] for one in of if block[0] == "FB" and one.opened[1] != of[0].opened[1]):
                yield next(one for one in of if one.opened[1] == instance), [2, 0x000A, 0, instance]


class Judge(threading.Thread):
    """Of one form, with a connection of its own."""

    def __init__(self, client, program, form, seed):
        super().__init__()
        self.client, self.program, self.form = client, program, form
        self.draw = random.Random(seed)
        self.blocks, self.numbers, self.differences = set(), set(), []
        self.environments = self.statements = self.ran = self.left = 0

    def run(self):
        for one, environment in self.program.watched():
            self.environments += bool(environment)
            for lines, window in self.windows(self.program.code[one.block][0]):
                try:
                    found = self.ask(one, environment, lines, window)
                except (Refused, OSError) as why:
                    self.differences.append("%s %d, %02x, from %04X: %r" % (*one.block, self.form, window[0][0], why))
                    continue
                self.compare(one, lines, found)
            self.blocks.add(one.block)

    def windows(self, code):
        """Wanted registers of each statement, and where they begin and end: as many as request and result have room for."""
        lines, window, asked, size = {}, [], 0, 0
        for at, (following, statement) in sorted(code.items()):
            if statement == ("BE",):
                continue
            wanted = FORMS[self.form] if self.draw.random() < 0.8 else self.draw.randrange(self.form == 0x13, FORMS[self.form])
            more = 4 if self.form == 0x13 else following - at
            if asked + more > self.client.pdu - 80 or size + 2 + width(self.form, wanted) > self.client.pdu - 40:
                yield lines, window
                lines, window, asked, size = {}, [], 0, 0
            lines[at] = wanted
            window.append((at, following))
            asked, size = asked + more, size + 2 + width(self.form, wanted)
        yield lines, window

    def ask(self, one, environment, lines, window):
        begin, end = window[0][0], window[-1][1]
        parameters = [0x0601 if environment else 0x0600, TYPES[one.block[0]], one.block[1], begin, end - begin] + environment
        # The head has the address, and in the old form a status word.
        length = HEADS[self.form] + sum(2 + width(self.form, wanted) for wanted in lines.values())
        result = self.client.status(self.form, parameters, request(self.form, lines, window), length, once=self.draw.random() < 0.5)
        return told(self.form, lines, result)

    def compare(self, one, lines, found):
        code = self.program.code[one.block][0]
        frame_of, ahead = mc7.frames(code), None
        for at, wanted in lines.items():
            behind = one.behind.get(frame_of.get(at, at)) if at in one.behind else None
            expected = None if behind is None else line(self.form, wanted, behind)
            for digits in ("%08x" % (NUMBER - 1), "%08x" % NUMBER):
                if at in found and digits in (expected or ""):
                    begin = expected.index(digits)
                    if ahead is None:
                        ahead = int(found[at][begin:begin + 8], 16) - int(digits, 16)
                        self.numbers.add(ahead)
                    expected = expected.replace(digits, "%08x" % (int(digits, 16) + ahead & 0xFFFFFFFF))
            self.statements += 1
            self.ran += expected is not None
            self.left += 0 if behind is None else behind[0] + behind.count(None)
            if not equal(expected, found.get(at)):
                self.differences.append("%s %d, %02x, %04X %s, registers %02X: expected %s, told %s" % (
                    *one.block, self.form, at, code[at][1], wanted, expected or "nothing", found.get(at, "nothing")))


def selftest():
    """Telegrams made by hand; a server that answers one connection with them."""
    assert request(0x13, {0: 1, 4: 2, 6: 3}, []).hex() == "00030000" "00000001" "00040002" "00060003"
    assert request(0x01, {0: 0x0F}, [(0, 4), (4, 6)]).hex() == "8000" "800f" "0000" "8080"
    new = told(0x13, {0: 1, 4: 2, 6: 3, 8: 1}, bytes.fromhex("0000" "00000007" "000400000064" "000600860000012c"))
    assert new == {0: "0007", 4: "00000064", 6: "00860000012c"}
    assert told(0x01, {4: 9}, bytes.fromhex("00040000" "0004" "0007" "0000000100000002" "0a00000a0000")) == {4: "000700000001000000020a00000a0000"}
    for wrong in ("0000" "0002" "0007", "0000" "0000" "00", "0000" "00000007" "00000007"):
        try:
            told(0x13, {0: 1}, bytes.fromhex(wrong))
        except Refused:
            continue
        raise AssertionError(wrong)
    registers = (False, 0x107, 1, None, 2, 3, 10, 0)
    assert line(0x13, 0x27, registers) == "0107" "00000001" "........" "0a00000a0000"
    assert equal("0107........", "010712345678") and not equal("0107", "0106") and not equal(None, "0107") and not equal("0107", None)
    selftest_of_comparing()
    with socket.create_server(("127.0.0.1", 0)) as server:
        client = threading.Thread(target=lambda: ran.append(Client("127.0.0.1", server.getsockname()[1], 960)))
        ran = []
        client.start()
        partner, _ = server.accept()
        with partner:
            assert partner.recv(100) == CONNECT
            partner.sendall(bytes.fromhex("0300000b06d00001000100"))
            assert partner.recv(100).hex() == "0300001902f080" "32010000000100080000" "f0000001000103c0"
            partner.sendall(bytes.fromhex("0300001b02f080" "320300000001000800000000" "f0000001000100f0"))
            client.join()
        assert ran[0].pdu == 240
        ran[0].socket.close()
    print("s7_status.py: passed")
    return 0


def selftest_of_comparing():
    """L MD 204; SPA over L 2; L MD 204; BE: what is told, and how many differences that makes."""
    code = mc7.statements(bytes.fromhex("7e3300cc" "700b0004" "30030002" "7e3300cc" "6500"))
    blocks = {("OB", 1): (code, 0)}
    program = Program.__new__(Program)
    cpu = mc7_cpu.Cpu(blocks, {})
    cpu.areas[mc7.M][SCANS:SCANS + 4] = NUMBER.to_bytes(4, "big")
    program.code, (one,) = blocks, cpu.scan()
    wanted = dict.fromkeys((0, 4, 8, 12), 2)
    for seen, differences in (
            ({0: "00000063", 4: "00000063", 12: "00000063"}, 0),
            ({0: "00000063", 4: "00000063", 12: "00000064"}, 1),  # of another scan
            ({0: "00000063", 4: "00000063", 8: "00000002", 12: "00000063"}, 1),  # has not run
            ({0: "00000063", 12: "00000063"}, 1)):  # has run
        judge = Judge(None, program, 0x13, 1)
        judge.compare(one, wanted, seen)
        assert (len(judge.differences), judge.statements, judge.ran) == (differences, 4, 3), judge.differences


def main():
    if sys.argv[1:] == ["--selftest"]:
        return selftest()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    parser.add_argument("--pdu", type=int, default=960)
    parser.add_argument("--seed", type=int, default=1, help="of the registers that are asked for")
    parser.add_argument("--show", type=int, default=40, help="differences that are printed")
    args = parser.parse_args()
    clients = [Client(args.host, args.port, args.pdu) for _ in FORMS]
    program = Program(clients[0])
    judges = [Judge(client, program, form, args.seed) for client, form in zip(clients, FORMS)]
    for judge in judges:
        judge.start()
    different = 0
    for judge in judges:
        judge.join()
        different += len(judge.differences)
        for difference in judge.differences[:args.show]:
            print(difference)
    for judge in judges:
        print("form %02x: %d blocks, %d call environments, %d statements, %d of them ran, %d values are left by a CALL, passes of %d scans" % (
            judge.form, len(judge.blocks), judge.environments, judge.statements, judge.ran, judge.left, len(judge.numbers)))
    blocks = set.intersection(*(judge.blocks for judge in judges)) - {("OB", 1)}
    print("%d blocks, %d statements, %d different" % (len(blocks), sum(judge.statements for judge in judges), different))
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
