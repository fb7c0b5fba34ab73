#!/usr/bin/env python3
"""A CPU that executes MC7, and keeps the registers behind each statement (`mc7.py`)."""

import math

from mc7 import (A, ACCU1, DB, DI, E, FRAMES, L, M, RELATIONS, ROUNDING, SCANS, USE_RLO, V, WRITES, Pass, Unknown, bits_of, real, signed,
                 statements)


class Cpu:
    """Blocks are (type, number) -> (statements, bytes of local data); data blocks are number -> bytearray."""

    FLAGS = ["FC", "RLO", "STA", "OR", "OS", "OV", "CC0", "CC1", "BR"]

    def __init__(self, blocks, data):
        self.blocks, self.data = blocks, data
        self.areas = {E: bytearray(1024), A: bytearray(1024), M: bytearray(4096)}

    def scan(self):
        """One OB 1; the passes through blocks in the order of their begin."""
        self.passes, self.executed = [], 0
        self.FC = self.RLO = self.STA = self.OR = self.OS = self.OV = self.CC0 = self.CC1 = self.BR = 0
        self.accu1 = self.accu2 = self.db = self.di = 0
        self.ar = [0, 0]
        self.left_db = False
        self.block(("OB", 1), None, [])
        return self.passes

    def registers(self):
        """In front of all, whether RLO and STA are those that a CALL has left."""
        stw = sum(getattr(self, name) << bit for bit, name in enumerate(self.FLAGS))
        accus = [None if self.left_accus > other else accu for other, accu in ((1, self.accu1), (0, self.accu2))]
        return (self.left_rlo, stw, *accus, *self.ar, None if self.left_db else self.db, self.di)

    def left_by_call(self, opened):
        self.left_accus, self.left_rlo, self.left_db = 2, True, self.left_db or opened

    def needs(self, accus):
        if self.left_accus > 2 - accus:
            raise Unknown("it uses an accumulator that a CALL has left")

    def block(self, block, caller, pointers):
        code, local = self.blocks[block]
        now = Pass(block, caller, local, pointers, (self.db, self.di))
        self.passes.append(now)
        self.left_by_call(caller is not None and caller.call_opens)
        at = 0
        while at is not None:
            if at not in code or self.executed > 2_000_000:
                raise Unknown("%s %d leaves its statements at %04X, or does not end" % (*block, at))
            self.executed += 1
            following, statement = code[at]
            goes_on = self.execute(now, *statement, following=following)
            now.behind[at] = self.registers()
            at = None if goes_on == "end" else following if goes_on is None else goes_on

    # Operands

    def memory(self, now, area):
        if area in self.areas:
            return self.areas[area]
        if area in (L, V):
            return now.local if area == L else now.caller.local
        if area == DB and self.left_db:
            raise Unknown("it uses a DB that a CALL has left")
        return self.data[self.db if area == DB else self.di]

    def place(self, now, operand):
        """Memory and bit address."""
        kind = operand[0]
        if kind == "at":
            return self.memory(now, operand[1]), operand[2]
        if kind == "in":
            return self.memory(now, operand[3]), self.get(self.memory(now, operand[1]), operand[2] * 8, 4) & 0xFFFFFF
        if kind == "ar":
            base = self.ar[operand[1]]
            area = base >> 24 & 7 if operand[2] is None else operand[2]
            return self.memory(now, area), (base & 0xFFFFFF) + operand[3] & 0x7FFFF
        pointer = now.pointers[operand[1] // 2 - 1]
        return self.memory(now, pointer >> 24 & 7), pointer & 0xFFFFFF

    def get(self, memory, bit, width, value=None):
        """The value there; after it was written, if one is given."""
        at = slice(bit // 8, bit // 8 + width)
        if bit & 7 or at.stop > len(memory):
            raise Unknown("address %d.%d" % (bit // 8, bit & 7))
        if value is not None:
            memory[at] = (value & (1 << 8 * width) - 1).to_bytes(width, "big")
        return int.from_bytes(memory[at], "big")

    def bit(self, memory, bit, value=None):
        byte = self.get(memory, bit & ~7, 1)
        if value is not None:
            memory[bit // 8] = byte = byte & ~(1 << (bit & 7)) | value << (bit & 7)
        return byte >> (bit & 7) & 1

    # Statements

    def execute(self, now, name, *args, following):
        """Where it goes on, if not with the following statement."""
        if name in SCANS and args and not self.FC:
            self.left_rlo = False  # a new string
        if self.left_rlo and not now.in_call and name in USE_RLO:
            raise Unknown("it uses an RLO that a CALL has left")
        if name in SCANS and args:
            operand = args[0]
            value = self.bit(*self.place(now, operand)) if isinstance(operand, tuple) else self.holds(operand)
            self.scanned(name, value, value, self.RLO, self.OR, self.FC)
        elif name in WRITES.values():
            self.write(name, self.place(now, args[0]))
        elif name.endswith("("):
            now.brackets.append((name[:-1], self.RLO, self.OR, self.FC))
            self.OR, self.STA, self.FC = 0, 1, 0
        elif name == ")":
            kind, *before = now.brackets.pop()
            self.scanned(kind, self.RLO, 1, *before)
        elif name.startswith("SP") or name == "LOOP":
            return self.jump(name, args, following)
        elif name in ("BE", "BEA", "BEB"):
            return self.end(name)
        elif name == "UC":
            self.call(now, *args)
        elif name == "T":
            self.needs(1)
            self.get(*self.place(now, args[1]), args[0], self.accu1)
        elif name == "AUF":
            self.open(now, *args)
        elif name == "BLD":
            self.frame(now, args[0])
        elif not (self.logic(name) or self.load(now, name, args) or self.address_register(now, name, args)):
            self.calculate(name, args)
        return None

    def holds(self, condition):
        if condition.startswith("no "):
            return self.holds(condition[3:]) ^ 1
        flag = {"RLO": self.RLO, "BIE": self.BR, "OV": self.OV, "OS": self.OS, "UO": self.CC1 & self.CC0}.get(condition)
        sign = self.CC1 - self.CC0
        return flag if flag is not None else int(RELATIONS[condition[:-1]](sign, 0) and not self.CC1 & self.CC0)

    def scanned(self, name, value, sta, rlo, gate, fc):
        """`rlo`, `gate` and `fc` are RLO, OR and /FC in front of the statement, or of its bracket."""
        wanted = value ^ 1 if name.endswith("N") else value
        self.OR = gate & fc if name[0] == "U" else 0
        if name[0] == "U":
            self.RLO = (rlo | fc ^ 1) & wanted | self.OR
        else:
            self.RLO = rlo & fc | wanted if name[0] == "O" else rlo & fc ^ wanted
        self.STA, self.FC = sta, 1

    def write(self, name, place):
        self.OR, self.STA = 0, self.RLO
        self.FC = int(name in ("FP", "FN"))
        if self.FC:
            before = self.bit(*place)
            self.bit(*place, self.RLO)
            self.RLO = self.RLO & (before ^ 1) if name == "FP" else (self.RLO ^ 1) & before
        elif name == "=" or self.RLO:
            self.bit(*place, {"=": self.RLO, "S": 1, "R": 0}[name])

    def logic(self, name):
        if name == "O":
            self.OR, self.STA, self.FC = (self.RLO | self.OR) & self.FC, 1, self.RLO & self.FC
        elif name in ("SET", "CLR"):
            self.RLO = self.STA = int(name == "SET")
            self.OR = self.FC = 0
            self.left_rlo = False
        elif name == "NOT":
            self.RLO, self.STA = self.RLO ^ 1, 1
        elif name == "SAVE":
            self.BR = self.RLO
        return name in ("O", "SET", "CLR", "NOT", "SAVE", "NOP")

    def jump(self, name, args, following):
        if name in ("LOOP", "SPL"):
            self.needs(1)
        if name == "SPL":  # its entries are SPA of four bytes
            return following + 4 * min(self.accu1 & 0xFF, args[0])
        if name == "LOOP":
            count = self.accu1 - 1 & 0xFFFF
            self.accu1 = self.accu1 & 0xFFFF0000 | count
            return args[0] if count else None
        if name == "SPA":
            return args[0]
        taken = self.holds(args[0])
        if name.startswith("SPB"):
            self.BR = self.RLO if name in ("SPBB", "SPBNB") else self.BR
            self.RLO = self.RLO if name in ("SPBI", "SPBIN") else 1
            self.OR, self.STA, self.FC = 0, 1, 0
        elif name == "SPS":
            self.OS = 0
        return args[1] if taken else None

    # Blocks

    def begins(self):
        """The status word at the begin and behind the end of a called block."""
        self.OS, self.OR, self.STA, self.FC = 0, 0, 1, 0

    def call(self, now, kind, number, pointers):
        opened = self.db, self.di, self.left_db
        self.begins()
        self.block((kind, number), now, pointers)
        self.begins()
        self.db, self.di, self.left_db = opened
        self.left_by_call(False)

    def end(self, name):
        if name == "BEB":
            ends, self.RLO = self.RLO, 1
            self.OR, self.STA, self.FC = 0, 1, 0
            if not ends:
                return None
        self.begins()
        return "end"

    def open(self, now, register, number):
        number = self.get(*self.place(now, number), 2) if isinstance(number, tuple) else number
        if register == DI:
            self.di = number
        else:
            self.db, self.left_db, now.call_opens = number, False, now.in_call

    def frame(self, now, number):
        if number in FRAMES:
            now.in_call, now.call_opens = True, False
        elif number in FRAMES.values():
            self.left_by_call(now.call_opens)
            now.in_call = now.call_opens = False

    # Registers

    def load(self, now, name, args):
        if name == "L":
            value = self.get(*self.place(now, args[1]), args[0])
        elif name in ("DBLG", "DILG"):
            value = len(self.memory(now, DB if name == "DBLG" else DI))
        else:
            value = {"DBNO": self.db, "DINO": self.di, "TAR1": self.ar[0], "TAR2": self.ar[1], "L const": args and args[0]}.get(name)
        if value is None or name == "TAR1" and args:
            return False
        self.accu2, self.accu1, self.left_accus = self.accu1, value, max(0, self.left_accus - 1)
        return True

    def address_register(self, now, name, args):
        if name == "TDB":
            self.db, self.di, self.left_db = self.di, self.db, False
        elif name in ("LAR1", "LAR2", "+AR1", "+AR2"):
            self.needs(1)
            self.to_register(int(name.endswith("2")), self.accu1 if name[0] == "L" else signed(self.accu1, 16), name[0] == "+")
        elif name in ("LAR const", "+AR const"):
            self.to_register(*args, name[0] == "+")
        elif name == "LAR":
            self.to_register(args[0], self.get(*self.place(now, args[1]), 4), False)
        elif name == "TAR":
            self.get(*self.place(now, args[1]), 4, self.ar[args[0]])
        else:
            return False
        return True

    def to_register(self, register, value, add):
        """An addition leaves the area as it is."""
        old = self.ar[register]
        self.ar[register] = old & 0xFF000000 | old + value & 0xFFFFFF if add else value

    # Arithmetic

    def calculate(self, name, args):
        self.needs(2)
        if name in ACCU1:
            self.accu1 = ACCU1[name](self.accu1, *args)
        elif name in ("TAK", "PUSH", "POP"):
            one, two = self.accu1, self.accu2
            self.accu1, self.accu2 = {"TAK": (two, one), "PUSH": (one, one), "POP": (two, two)}[name]
        elif name in ROUNDING:
            self.accu1, self.OV = ROUNDING[name](real(self.accu1)) & 0xFFFFFFFF, 0
        elif name in ("ITB", "DTB"):
            self.to_bcd(*((16, 3) if name == "ITB" else (32, 7)))
        elif name in ("UW", "OW", "XOW", "UD", "OD", "XOD"):
            self.word_logic(name, args[0] if args else self.accu2)
        elif name == "compare":
            self.compare(*args)
        elif name in ("NEGI", "NEGD"):
            bits = 16 if name == "NEGI" else 32
            self.result(-signed(self.accu1, bits), bits)
        elif name in ("+R", "-R", "*R", "/R"):
            self.reals(name[0])
        elif name[0] in "+-*/M":
            self.whole_numbers(name[0], 16 if name[-1] == "I" else 32)
        else:
            self.shift(name, args[0] if args else self.accu2 & 0xFF)

    def result_flags(self, sign, overflow):
        self.CC1, self.CC0, self.OV = int(sign > 0), int(sign < 0), int(overflow)
        self.OS |= self.OV

    def keep(self, value, bits):
        """Into the lower bits of ACCU1."""
        mask = (1 << bits) - 1
        self.accu1 = self.accu1 & ~mask & 0xFFFFFFFF | value & mask

    def to_bcd(self, bits, digits):
        value = signed(self.accu1, bits)
        self.OV = int(abs(value) >= 10 ** digits)
        self.OS |= self.OV
        if not self.OV:
            self.keep(int(str(abs(value)), 16) | (0xF << 4 * digits if value < 0 else 0), bits)

    def word_logic(self, name, other):
        bits = 16 if name.endswith("W") else 32
        value = {"U": self.accu1 & other, "O": self.accu1 | other, "X": self.accu1 ^ other}[name[0]] & (1 << bits) - 1
        self.keep(value, bits)
        self.CC1, self.CC0, self.OV = int(value != 0), 0, 0

    def compare(self, relation, kind):
        one, other = (real(accu) if kind == "R" else signed(accu, 16 if kind == "I" else 32) for accu in (self.accu2, self.accu1))
        self.result_flags((one > other) - (one < other), False)
        self.RLO = self.STA = int(RELATIONS[relation](one, other))
        self.OR, self.FC, self.left_rlo = 0, 1, False

    def result(self, value, bits):
        """Of an addition: the condition codes are those of what there is room for."""
        self.result_flags(signed(value, bits), signed(value, bits) != value)
        self.keep(value, bits)

    def whole_numbers(self, operation, bits):
        one, other = signed(self.accu2, bits), signed(self.accu1, bits)
        if operation in "+-":
            return self.result(one + other if operation == "+" else one - other, bits)
        if operation == "*":
            value = one * other
        elif other == 0:
            raise Unknown("division by zero")
        else:
            quotient = abs(one) // abs(other) * (1 if (one < 0) == (other < 0) else -1)
            value, rest = quotient, one - quotient * other
        if operation == "M":
            value = rest
        overflow = signed(value, bits) != value
        if overflow and bits == 32:
            raise Unknown("a result beyond 32 bits")
        self.result_flags(value, overflow)
        # *I has 32 bits; /I has its remainder in the upper word.
        self.accu1 = (rest & 0xFFFF) << 16 | value & 0xFFFF if (operation, bits) == ("/", 16) else value & 0xFFFFFFFF
        return None

    def reals(self, operation):
        one, other = real(self.accu2), real(self.accu1)
        if operation == "/" and other == 0:
            raise Unknown("division by zero")
        exact = {"+": lambda: one + other, "-": lambda: one - other, "*": lambda: one * other, "/": lambda: one / other}[operation]()
        self.accu1 = bits_of(exact)
        if exact and not 2.0 ** -126 <= abs(real(self.accu1)) < math.inf:
            raise Unknown("REAL out of range")
        self.result_flags(exact, False)

    def shift(self, name, count):
        bits = 16 if name in ("SLW", "SRW", "SSI") else 32
        value = self.accu1 & (1 << bits) - 1
        if name in ("RLDA", "RRDA"):  # by one place through CC1
            last = value >> 31 if name == "RLDA" else value & 1
            value = value << 1 | self.CC1 if name == "RLDA" else value >> 1 | self.CC1 << 31
        elif count == 0:
            return
        elif name in ("RLD", "RRD"):
            left = count % 32 if name == "RLD" else -count % 32
            value = value << left | value >> 32 - left
            last = value & 1 if name == "RLD" else value >> 31 & 1
        elif name[1] == "L":
            last = value << count >> bits & 1
            value <<= count
        else:
            if name[1] == "S":
                value, count = signed(value, bits), min(count, bits)
            last = value >> count - 1 & 1
            value >>= count
        self.keep(value, bits)
        self.CC1, self.CC0, self.OV = last, 0, 0


def selftest():
    """Short programs, reckoned by hand."""
    def cpu(main, other="6500"):
        blocks = {("OB", 1): (statements(bytes.fromhex(main + "6500")), 16), ("FC", 1): (statements(bytes.fromhex(other)), 0)}
        made = Cpu(blocks, {})
        made.scan()
        return made

    def last(main):
        """Status word and both accumulators behind the last statement but the BE."""
        behind = cpu(main).passes[0].behind
        return behind[sorted(behind)[-2]][1:4]

    two = "3003%04x3003%04x%s"
    assert last(two % (0x7FFF, 1, "7900")) == (0x070, 0x8000, 0x7FFF), "+I beyond the range: CC0, OV, OS"
    assert last(two % (7, 0xFFFE, "6000")) == (0x040, 0x1FFFD, 7), "7 / -2 is -3, rest 1"
    assert last(two % (0x4000, 4, "6004")) == (0x0B0, 0x10000, 0x4000), "*I has 32 bits"
    assert last(two % (5, 5, "2180")) == (0x007, 5, 5), "==I"
    assert last(two % (0, 0xF0F0, "6104")) == (0x080, 0x0F00, 0), "SLW 4: the last bit is in CC1"
    assert last(two % (0, 0x8006, "6821")) == (0x080, 0xE001, 0), "SSI 2"
    assert last(two % (0, 3, "681dba00681cbf00")) == (0x005, 3, 0), "a bracket with 0 begins a string"
    # U M 0.0 (1), O, U M 0.1 (0): OR holds the first part.
    bits = cpu("681d9800681c99008000fb0081009a00").passes[0].behind
    assert [bits[at][1] for at in (8, 10, 12, 14)] == [0x007, 0x00F, 0x00B, 0x006], bits
    # L 3; T MW 10; L MW 10; LOOP: of the last round.
    loop = cpu("30030003130a120a7008fffe")
    assert loop.passes[0].behind[8][2] == 0 and loop.passes[0].behind[4][2] == 1 and loop.executed == 1 + 3 * 3 + 1
    # FC 1 copies its first parameter into its second one, MW 4 into MW 6.
    call = cpu("3007123413043d01700b00068300002083000030", "fbc20002fbc600046500")
    assert call.areas[M][4:8] == b"\x12\x34" * 2 and [one.block for one in call.passes] == [("OB", 1), ("FC", 1)]
    assert call.passes[1].behind[0][2:4] == (0x1234, None) and call.passes[1].path() == [("OB", 1)]
    for wrong in ("3d01700b00027900", "3d01700b00029800", "3003000130030000" + "6000"):
        try:
            cpu(wrong)
        except Unknown:
            continue
        raise AssertionError(wrong)
    print("mc7_cpu.py: passed")


if __name__ == "__main__":
    selftest()
