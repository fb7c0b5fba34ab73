#!/usr/bin/env python3
"""MC7, the machine code of S7-300 blocks: a decoder, and a CPU with two accumulators that executes it and keeps the registers behind
each statement. Written from the manual of the instructions and the table of opcodes; without timers, counters, MCR, peripheral
addresses and system blocks.

A CALL is many statements between two BLD. What they leave in the accumulators, in RLO and STA, and the DB that they open for an actual
parameter, is a matter of the compiler; the registers behind a statement have None for it, and a program that uses it is refused.
"""

import math
import operator
import struct

P, E, A, M, DB, DI, L, V = range(8)  # areas of operands; V is the caller's local data
SCANS = ["U", "UN", "O", "ON", "X", "XN"]
WRITES = {0: "S", 1: "R", 2: "=", 4: "FP", 5: "FN"}
WIDTHS = {1: 1, 2: 2, 3: 4}
PLAIN_TEXT = """
    7900 +I     5900 -I   6004 *I   6000 /I     600D +D    6009 -D    600A *D   600E /D    6001 MOD   600F +R   600B -R   6007 *R
    6003 /R     6002 ABS  6006 NEGR 0100 INVI   0900 NEGI  680D INVD  6807 NEGD 6806 DTR   6808 ITB   680A DTB  680C BTI  680E BTD
    681E ITD    685C RND  685D RND- 685E RND+   685F TRUNC 681A TAW   681B TAD  4100 UW    4900 OW    5100 XOW  6837 UD   6847 OD
    6857 XOD    6812 SLW  6822 SRW  6813 SLD    6823 SRD   6824 SSI   6825 SSD  6817 RLD   6827 RRD   6818 RLDA 6828 RRDA 7002 TAK
    682E PUSH   683E POP  FB7C TDB  FE04 LAR1   FE0C LAR2  FE05 TAR1  FE0D TAR2 FE06 +AR1  FE0E +AR2  6500 BE   6501 BEA  0500 BEB
    0000 NOP    FFFF NOP  BA00 U(   BB00 O(     FFF1 UN(   FFF3 ON(   FFF4 X(   FFF5 XN(   BF00 )     FB00 O    681C CLR  681D SET
    682C SAVE   682D NOT  FB3C DBLG FB3D DILG   FB4C DBNO  FB4D DINO"""
PLAIN = {int(code, 16): name for code, name in zip(PLAIN_TEXT.split()[::2], PLAIN_TEXT.split()[1::2])}
# Jumps, and the condition under which they jump.
JUMPS = {0xF8: ("SPB", "RLO"), 0xB8: ("SPBN", "no RLO"), 0xD8: ("SPBB", "RLO"), 0x98: ("SPBNB", "no RLO"), 0xE8: ("SPBI", "BIE"),
         0x78: ("SPBIN", "no BIE"), 0x18: ("SPO", "OV"), 0x08: ("SPS", "OS"), 0x88: ("SPZ", "==0"), 0x68: ("SPN", "<>0"),
         0x28: ("SPP", ">0"), 0x48: ("SPM", "<0"), 0xA8: ("SPPZ", ">=0"), 0xC8: ("SPMZ", "<=0"), 0x58: ("SPU", "UO")}
CONDITIONS = {0x0: "OS", 0x1: "OV", 0x2: ">0", 0x4: "<0", 0x5: "UO", 0x6: "<>0", 0x8: "==0", 0xA: ">=0", 0xC: "<=0", 0xE: "BIE"}
COMPARES = {0x20: ">", 0x40: "<", 0x60: "<>", 0x80: "==", 0xA0: ">=", 0xC0: "<="}
SHORT_BITS = {0x80: "U", 0x88: "O", 0x90: "S", 0x98: "=", 0xA0: "UN", 0xA8: "ON", 0xB0: "R"}
LONG_BITS = {0x00: ("U", "UN"), 0x01: ("O", "ON"), 0x05: ("X", "XN"), 0x09: ("S", "R"), 0x41: ("=", "="), 0x49: ("FP", "FN")}
INDIRECT_BITS = {0x51: ("U", "O", "UN", "ON"), 0x58: ("X", "S", "XN", "R"), 0x59: ("=", "FP", "", "FN")}
SHIFTS = {0x61: "SLW", 0x69: "SRW", 0x29: "SLD", 0x71: "SSD", 0x64: "RLD", 0x74: "RRD"}
WORD_LOGIC = {0x34: "UW", 0x44: "OW", 0x54: "XOW", 0x36: "UD", 0x46: "OD", 0x56: "XOD"}
# L and T with a short address: those of bit memory, then those of inputs and outputs.
SHORT_LOADS = {0x0A: ("L", 1), 0x12: ("L", 2), 0x1A: ("L", 4), 0x0B: ("T", 1), 0x13: ("T", 2), 0x1B: ("T", 4)}
FRAMES = {1: 2, 3: 4, 14: 15}  # BLD around a CALL of an FC, of an FB, of a multi-instance
USE_RLO = SCANS + list(WRITES.values()) + [name for name, _ in list(JUMPS.values())[:4]] + [name + "(" for name in SCANS] + ["BEB", "SAVE", "NOT"]
RELATIONS = {">": operator.gt, "<": operator.lt, "<>": operator.ne, "==": operator.eq, ">=": operator.ge, "<=": operator.le}


class Unknown(Exception):
    """A statement that is not known, or one whose effect no manual tells."""


def signed(value, bits):
    value &= (1 << bits) - 1
    return value - (1 << bits) if value >> (bits - 1) else value


def decode(code, at):
    """Length and statement: its name, then its arguments. An operand in memory is ("at", area, bit address), ("in", area and byte of the
    pointer, area), ("ar", register, area or None, offset) or ("#", word in the pointer list).
    """
    first, second = code[at], code[at + 1]
    both, word, long = first << 8 | second, int.from_bytes(code[at + 2:at + 4], "big"), int.from_bytes(code[at + 2:at + 6], "big")
    hi, lo = second >> 4, second & 15
    in_or_out = ("at", A if hi & 8 else E, (second & 0x7F) * 8)
    if both in PLAIN:
        return 2, (PLAIN[both],)
    if first & 0xF8 in SHORT_BITS:
        return 2, (SHORT_BITS[first & 0xF8], ("at", M, second * 8 + (first & 7)))
    if (first & 0xF8) - 0x40 in SHORT_BITS:
        return 2, (SHORT_BITS[(first & 0xF8) - 0x40], (*in_or_out[:2], in_or_out[2] + (first & 7)))
    if first in LONG_BITS:
        return 4, (LONG_BITS[first][hi >> 3], ("at", hi & 7, word * 8 + lo))
    if both == 0x5800:
        return 4, ("+", signed(word, 16), 16)
    if first in INDIRECT_BITS:
        return 4, (INDIRECT_BITS[first][(lo >> 3) + 2 * (hi >> 3)], ("in", hi & 7, word, lo & 7))
    if first == 0x79:
        return 4, (SCANS[lo & 7] if hi < 8 else WRITES[lo & 7], ("ar", lo >> 3, hi & 7, word))
    if first in SHORT_LOADS:
        return 2, (*SHORT_LOADS[first], ("at", M, second * 8))
    if first - 0x40 in SHORT_LOADS:
        return 2, (*SHORT_LOADS[first - 0x40], in_or_out)
    if first == 0x7E:
        return 4, ("L" if lo < 4 else "T", WIDTHS[lo & 3], ("at", hi, word * 8))
    if first == 0xBE:
        return 4, ("L" if lo & 7 < 4 else "T", WIDTHS[lo & 3], ("ar", lo >> 3, hi, word))
    if first in (0xBA, 0xBB):
        return 4, ("T" if hi & 8 else "L", 1 if first == 0xBA else 4 if lo & 8 else 2, ("in", hi & 7, word, lo & 7))
    if first in (0x28, 0x30, 0x38):
        return {0x28: (2, ("L const", second)), 0x30: (4, ("L const", word)), 0x38: (6, ("L const", long))}[first]
    if first in (0x21, 0x31, 0x39):
        return 2, ("compare", COMPARES[second], {0x21: "I", 0x31: "R", 0x39: "D"}[first])
    if both == 0x6005:
        return 6, ("+", signed(long, 32), 32)
    if first == 0x68 and second in WORD_LOGIC:
        name = WORD_LOGIC[second]
        return (4, (name, word)) if name.endswith("W") else (6, (name, long))
    if first in SHIFTS or first == 0x68 and lo == 1:
        return 2, (SHIFTS[first], second) if first in SHIFTS else ("SSI", hi)
    if first in (0x11, 0x19):
        return 2, ("INC", second if first == 0x11 else -second)
    if first in (0x20, 0x10):
        return 2, ("AUF", DB, second) if first == 0x20 else ("BLD", second)
    if first in (0x3D, 0x75):
        return (2, ("UC", "FB", second, [])) if first == 0x75 else with_pointers(code, at, 2, second)
    if both in (0x7008, 0x700B):
        return 4, ("LOOP" if second == 8 else "SPA", at + 2 * signed(word, 16))
    if both == 0x7009:
        return 4, ("SPL", word)
    if first == 0xFF and second in JUMPS:
        return 4, (*JUMPS[second], at + 2 * signed(word, 16))
    if first == 0xFF and hi in CONDITIONS and lo < 6:
        return 2, (SCANS[lo], CONDITIONS[hi])
    if first == 0xFE and 0xC0 <= second <= 0xE0:
        return 2, ("SRD", second - 0xC0)
    if first == 0xFE and (lo & 7 in (2, 3, 7)):
        register = lo >> 3
        if hi == 0:
            return (4, ("+AR const", register, signed(word, 16))) if lo & 7 == 2 else (6, ("LAR const", register, long))
        return 4, ("LAR" if lo & 7 == 3 else "TAR", register, ("at", hi, word * 8))
    if first == 0xFB:
        return decode_fb(code, at, second, word)
    raise Unknown("%04X at %04X" % (both, at))


def decode_fb(code, at, second, word):
    hi, lo = second >> 4, second & 15
    if hi == 0:
        return 4, ("L" if lo & 7 < 4 else "T", WIDTHS[lo & 3], ("ar", lo >> 3, None, word))
    if hi in (1, 2):
        return 4, (SCANS[lo & 7] if hi == 1 else WRITES[lo & 7], ("ar", lo >> 3, None, word))
    if hi in (8, 9):
        return 4, (SCANS[lo] if hi == 8 else WRITES[lo], ("#", word))
    if hi == 0xC and lo & 3:
        return 4, ("L" if lo < 4 else "T", WIDTHS[lo & 3], ("#", word))
    if lo in (8, 9):
        return 4, ("AUF", DB if lo == 8 else DI, word if hi == 7 else ("at", hi, word * 8))
    if second in (0x70, 0x72):
        return (4, ("UC", "FB", word, [])) if second == 0x72 else with_pointers(code, at, 4, word)
    raise Unknown("FB%02X at %04X" % (second, at))


def with_pointers(code, at, length, number):
    """UC FC with the jump behind it, and the pointers that it jumps over."""
    if code[at + length:at + length + 2] != b"\x70\x0b":
        raise Unknown("no pointer list at %04X" % at)
    end = at + length + 2 * int.from_bytes(code[at + length + 2:at + length + 4], "big")
    return end - at, ("UC", "FC", number, [int.from_bytes(code[i:i + 4], "big") for i in range(at + length + 4, end, 4)])


def statements(code):
    """All statements: address -> (address of the next one, statement)."""
    at, found = 0, {}
    while at < len(code):
        length, statement = decode(code, at)
        found[at] = (at + length, statement)
        at += length
    return found


def frames(code):
    """Address -> address of the BLD that ends the CALL to which the statement belongs."""
    of, inside, end = {}, [], None
    for at, (_, statement) in sorted(code.items()):
        if end is None and statement[0] == "BLD":
            end = FRAMES.get(statement[1])
        if end is not None:
            inside.append(at)
            if statement == ("BLD", end):
                of.update(dict.fromkeys(inside, at))
                inside, end = [], None
    return of


def real(bits):
    return struct.unpack(">f", bits.to_bytes(4, "big"))[0]


def bits_of(value):
    return int.from_bytes(struct.pack(">f", value), "big")


def of_bcd(word, digits):
    text = "%08X" % word
    if not text[-digits:].isdigit():
        raise Unknown("no BCD number")
    return int(text[-digits:]) * (-1 if word >> 4 * digits + 3 & 1 else 1)


# What makes a new ACCU1 of the old one, and changes nothing else.
ACCU1 = {
    "TAW": lambda accu: accu & 0xFFFF0000 | accu >> 8 & 0xFF | (accu & 0xFF) << 8,
    "TAD": lambda accu: int.from_bytes(accu.to_bytes(4, "big"), "little"),
    "INVI": lambda accu: accu ^ 0xFFFF,
    "INVD": lambda accu: accu ^ 0xFFFFFFFF,
    "ITD": lambda accu: signed(accu, 16) & 0xFFFFFFFF,
    "ABS": lambda accu: accu & 0x7FFFFFFF,
    "NEGR": lambda accu: accu ^ 0x80000000,
    "DTR": lambda accu: bits_of(float(signed(accu, 32))),
    "INC": lambda accu, step: accu & 0xFFFFFF00 | (accu + step) & 0xFF,
    "+": lambda accu, step, bits: accu & 0xFFFF0000 | (accu + step) & 0xFFFF if bits == 16 else (accu + step) & 0xFFFFFFFF,
    "BTI": lambda accu: accu & 0xFFFF0000 | of_bcd(accu & 0xFFFF, 3) & 0xFFFF,
    "BTD": lambda accu: of_bcd(accu, 7) & 0xFFFFFFFF,
}
ROUNDING = {"RND": round, "RND-": math.floor, "RND+": math.ceil, "TRUNC": math.trunc}


class Pass:
    """One run through a block."""

    def __init__(self, block, caller, local, pointers, opened):
        self.block, self.caller, self.pointers, self.opened = block, caller, pointers, opened
        self.local, self.brackets, self.in_call, self.call_opens = bytearray(local), [], False, False
        self.behind = {}  # address -> registers behind the statement; of a loop, those of the last round

    def path(self):
        """Who has called it, the nearest first."""
        return [] if self.caller is None else [self.caller.block] + self.caller.path()


def selftest():
    """Rows of the table of opcodes, one of each kind."""
    rows = {
        "8305": ("U", ("at", M, 43)), "db84": ("=", ("at", A, 35)), "e17f": ("UN", ("at", E, 0x3F9)), "00b50200": ("UN", ("at", M, 0x1005)),
        "49b70001": ("FN", ("at", M, 15)), "51db0010": ("ON", ("in", DI, 16, M)), "58ee0002": ("R", ("in", L, 2, L)), "5966003c": ("=", ("in", L, 60, L)),
        "79580021": ("U", ("ar", 1, DI, 0x21)), "79c20003": ("=", ("ar", 0, DB, 3)), "fb1d0027": ("XN", ("ar", 1, None, 0x27)),
        "fb220008": ("=", ("ar", 0, None, 8)), "1364": ("T", 2, ("at", M, 800)), "5384": ("T", 2, ("at", A, 32)), "7e420014": ("L", 2, ("at", DB, 160)),
        "bbee0008": ("T", 4, ("in", L, 8, L)), "be5a0010": ("L", 2, ("ar", 1, DI, 16)), "be47fff8": ("T", 4, ("ar", 0, DB, 0xFFF8)),
        "fb0f0100": ("T", 4, ("ar", 1, None, 0x100)), "38048400000c": ("L const", 0x8400000C), "31c0": ("compare", "<=", "R"), "5800fff6": ("+", -10, 16),
        "685600ff00ff": ("XOD", 0xFF00FF), "fed0": ("SRD", 16), "6831": ("SSI", 3), "fe0d": ("TAR2",), "fe0386000010": ("LAR const", 0, 0x86000010),
        "fe02fff0": ("+AR const", 0, -16), "fe4b0010": ("LAR", 1, ("at", DB, 128)), "fe670008": ("TAR", 0, ("at", L, 64)), "2005": ("AUF", DB, 5),
        "fb790012": ("AUF", DI, 18), "fb49000a": ("AUF", DI, ("at", DB, 80)), "3d64700b000687000008000f0000": ("UC", "FC", 100, [0x87000008, 0xF0000]),
        "fb720200": ("UC", "FB", 512, []), "700b0006": ("SPA", 12), "fff8fffc": ("SPB", "RLO", -8), "7009000e": ("SPL", 14), "ff80": ("U", "==0"),
        "fb910004": ("R", ("#", 4)), "fbc70006": ("T", 4, ("#", 6)), "6501": ("BEA",)}
    for code, statement in rows.items():
        assert decode(bytes.fromhex(code), 0) == (len(code) // 2, statement), (code, decode(bytes.fromhex(code), 0))
    assert frames(statements(bytes.fromhex("0000100141600000100210e76500"))) == {2: 8, 4: 8, 8: 8}
    print("mc7.py: passed")


if __name__ == "__main__":
    selftest()
