#!/usr/bin/env python3
"""Random STL programs for the judge of block status: each scan of one does the same as the one before.

    s7_programs.py SEED [BLOCKS]        the source, on standard output; it needs 2048 bytes of bit memory

OB 1 gives the memory its values; then come the blocks, each called from one place, a few from two. What a block reads, it or a caller
has written in the same scan. A program uses nothing that is a matter of the compiler: what a CALL leaves in the accumulators, and
whether a parameter is passed by its address or copied (no operand twice in a CALL; outputs into memory that nothing else uses).
"""

import random
import re
import sys

SIZES = {"BOOL": 1, "WORD": 2, "INT": 2, "DWORD": 4, "DINT": 4}
# Bytes of bit memory: up to here only read; up to here written too; 8 REALs; 8 results; a counter; the number of the scan; from here on
# outputs of calls.
READ, WRITTEN, REALS, RESULTS, COUNT, SCANS, CELLS = 64, 128, 128, 160, 200, 204, 256
# What shows that lines are of one pass: the number of the scan, which is different in each.
NUMBER = "L MD %d; L MD %d; L {!INT}; L {!INT}" % (SCANS, SCANS)
WORDS = 40  # of DB 500
# Counters of loops, a pointer, edge memory: written by their own statements only.
KEPT = ["tn", "tm", "tp", "te", "se"]
OWN_TEMPS = [("tb", "BOOL"), ("te", "BOOL"), ("tn", "INT"), ("tm", "INT"), ("td", "DINT"), ("tp", "DWORD")]
REAL = "{MD {128..156/4}|{1.5|-22.25|0.3|-871.0|3.0e4}}"

# Begin, steps of which some are drawn, end. {INT} is a value of this type, {=INT} a place for one, {!INT} a constant, {1..9} a number,
# {0..8/2} an even one, {a|b} one of them.
PIECES = [
    ("L {INT}; L {INT}; {+I|-I}", ["L {INT}; {+I|-I}", "L {1..300}; /I", "NEGI", "INVI", "+ {-300..300}", "TAK", "INC {0..255}", "DEC {0..255}", "PUSH",
                                   "POP", "TAW", "L {INT}; *I"], "T {=INT}"),
    ("L {DINT}; L {DINT}; {+D|-D}", ["L {DINT}; {+D|-D}", "L L#{1..300}; {/D|MOD}", "NEGD", "INVD", "+ L#{-70000..70000}", "TAK", "TAD"], "T {=DINT}"),
    ("L {INT}; ITD; L L#{-60000..60000}; *D; L L#{1..9999}; {/D|MOD}", [], "T {=DINT}"),
    ("L {WORD}; L {WORD}", ["{UW|OW|XOW}", "{UW|OW|XOW} {!WORD}", "{SLW|SRW|SSI} {0..15}", "{SLW|SRW|SSI}", "{RLDA|RRDA}"], "T {=WORD}"),
    ("L {DWORD}; L {DWORD}", ["{UD|OD|XOD}", "{UD|OD|XOD} {!DWORD}", "{SLD|SRD|SSD|RLD|RRD} {0..32}", "{SLD|SRD|SSD|RLD|RRD}", "{RLDA|RRDA}"], "T {=DWORD}"),
    ("L W#16#{0|F}{100..999}; BTI; ITD", [], "T {=DINT}"),
    ("L DW#16#{0|F}{1000000..9999999}; BTD; DTR; RND", [], "T {=DINT}"),
    ("L {INT}; ITB", [], "T {=WORD}"),
    ("L {DINT}; DTB", [], "T {=DWORD}"),
    ("L %s; L %s; {+R|-R|*R|/R}" % (REAL, REAL), ["L %s; {+R|-R}" % REAL, "NEGR", "ABS"], "T MD {160..188/4}; {RND|RND-|RND+|TRUNC}; T {=DINT}"),
    ("L P#{0..120/2}.0; T #tp; L MW [#tp]; AUF DB 500; L P#{0..74/2}.0; T #tp; T DBW [#tp]; L DBD [#tp]; U DBX [#tp]; = {=BOOL}", [], "T {=DINT}"),
    ("L P#M {0..120}.{0..7}; LAR1; U [AR1,P#0.0]; = {=BOOL}; LAR1 P#M {0..120/2}.0; +AR1 P#2.0; L W [AR1,P#0.0]; L MW [AR1,P#{0..2/2}.0]; TAR1",
     [], "T {=DWORD}"),
    (NUMBER, [], "T {=INT}"),
]
SCAN = ["{U|UN|O|ON|X|XN} {BOOL}"] * 5 + ["O; U {BOOL}", "{U|O|UN|XN} {==0|<>0|>0|<0|>=0|<=0|OV|OS|UO|BIE}", "{NOT|SAVE|SET|CLR}"]


class Block:
    cells = CELLS

    def __init__(self, draw, kind, number):
        self.draw, self.kind, self.number, self.depth = draw, kind, number, 1
        self.inputs, self.outputs, self.in_outs = self.some("i", 1, 4), self.some("q", 1, 3), self.some("x", 0, 2)
        self.statics = self.some("s", 2, 4) + [("sb", "BOOL"), ("se", "BOOL")] if kind == "FB" else []
        self.temps = self.some("t", 1, 3) + OWN_TEMPS
        self.callers, self.inner, self.lines, self.labels, self.loops = [], [], [], 0, 0

    def some(self, letter, low, high):
        return [("%s%d" % (letter, n), self.draw.choice(list(SIZES))) for n in range(self.draw.randint(low, high))]

    # Text

    def put(self, text):
        """Statements, with their placeholders filled in; the innermost first."""
        while "{" in text:
            text = re.sub(r"{([^{}]*)}", lambda found: self.drawn(found[1]), text)
        self.lines += ["%s;" % line.strip() for line in text.split(";") if line.strip()]

    def drawn(self, what):
        if "|" in what:
            return self.draw.choice(what.split("|"))
        if ".." in what:
            low, high, step = re.match(r"(-?\d+)\.\.(-?\d+)/?(\d*)", what).groups()
            return str(self.draw.randrange(int(low), int(high) + 1, int(step or 1)))
        if what[0] in "!=":
            return self.constant(what[1:]) if what[0] == "!" else self.place(what[1:])
        return self.constant(what) if what != "BOOL" and self.draw.random() < 0.4 else self.operand(what)

    def label(self):
        self.labels += 1
        return "m%03d" % self.labels

    def constant(self, kind):
        draw = self.draw
        return {"BOOL": draw.choice(["TRUE", "FALSE"]), "WORD": "W#16#%X" % draw.getrandbits(16), "INT": "%d" % draw.randint(-32768, 32767),
                "DWORD": "DW#16#%X" % draw.getrandbits(32), "DINT": "L#%d" % draw.randint(-2 ** 31, 2 ** 31 - 1)}[kind]

    def cell(self, kind, low, high, db, end):
        """In bit memory of this range, or in a data block."""
        size = SIZES[kind]
        area, low, high = self.draw.choice([("M", low, high), ("DB%d.DB" % db, 0 if db == 500 else low, end)])
        if kind == "BOOL":
            return "%s %d.%d" % (area + "X" if "." in area else area, self.draw.randrange(low, high), self.draw.randrange(8))
        return "%s %d" % (area + {2: "W", 4: "D"}[size], self.draw.randrange(low, high - size + 1, 2))

    def own(self, kind, rows, without=()):
        names = ["#" + name for name, of in rows if of == kind and "#" + name not in without]
        return self.draw.choice(names) if names and self.draw.random() < 0.6 else None

    def written(self):
        return self.outputs + self.in_outs + self.statics + self.temps

    def operand(self, kind):
        if kind == "BOOL" and self.draw.random() < 0.2:
            return "%s %d.%d" % (self.draw.choice("EA"), self.draw.randrange(4), self.draw.randrange(8))
        return self.own(kind, self.inputs + self.written(), ["#tp"]) or self.cell(kind, 0, WRITTEN, 500, 2 * WORDS)

    def place(self, kind):
        if kind == "BOOL" and self.draw.random() < 0.1:
            return "A %d.%d" % (self.draw.randrange(4), self.draw.randrange(8))
        return self.own(kind, self.written(), ["#" + name for name in KEPT]) or self.cell(kind, READ, WRITTEN, 500, 2 * WORDS)

    # Pieces of a body

    def string(self, depth=0):
        """A logic string without what it is for."""
        for _ in range(self.draw.randint(1, 4)):
            if depth < 3 and self.draw.random() < 0.15:
                self.put("{U|O|X|UN|ON|XN}(")
                self.string(depth + 1)
                self.put(")")
            else:
                self.put(self.draw.choice(SCAN))

    def logic(self):
        self.string()
        if self.draw.random() < 0.2:
            self.put("{FP|FN} " + self.draw.choice(["#te"] + ["#se"] * (self.kind == "FB")))
        for _ in range(self.draw.randint(1, 2)):
            self.put("{=|S|R} {=BOOL}")

    def straight(self):
        begin, steps, end = self.draw.choice(PIECES)
        self.put(begin)
        for _ in range(self.draw.randint(0, 3) if steps else 0):
            self.put(self.draw.choice(steps))
        self.put(end)

    def compared(self, depth):
        after = self.label()
        self.put(self.draw.choice(["L {INT}; L {INT}; {==|<>|>|<|>=|<=}I", "L {DINT}; L {DINT}; {==|<>|>|<|>=|<=}D"]) + "; {SPB|SPBN|SPBB|SPBNB} " + after)
        self.piece(depth + 1)
        self.put("%s: NOP 0" % after)
        if self.draw.random() < 0.3:
            after = self.label()
            self.put("SPBI " + after)
            self.piece(depth + 1)
            self.put("%s: NOP 1" % after)

    def by_condition_codes(self, depth):
        other, after = self.label(), self.label()
        self.put(self.draw.choice(["L {INT}; L {INT}; {+I|-I|*I}", "L {DINT}; L {DINT}; {+D|-D}"]) + "; {SPZ|SPN|SPP|SPM|SPPZ|SPMZ|SPO|SPS|SPU} " + other)
        self.piece(depth + 1)
        self.put("SPA %s; %s: NOP 0" % (after, other))
        self.piece(depth + 1)
        self.put("%s: NOP 0" % after)

    def distributor(self, depth):
        *entries, other, after = (self.label() for _ in range(self.draw.randint(4, 6)))
        self.put("L {WORD}; UW W#16#{3|5|7}; SPL %s; %s; %s: SPA %s" % (other, "; ".join("SPA " + entry for entry in entries), other, after))
        for entry in entries:
            self.put("%s: NOP 0" % entry)
            self.piece(depth + 1)
            self.put("SPA " + after)
        self.put("%s: NOP 0" % after)

    def loop(self, depth, body=None):
        again, counter = self.label(), ["#tn", "#tm"][self.loops]
        self.loops += 1
        self.put("L {1..4}; %s: T %s" % (again, counter))
        (body or self.piece)(depth + 1)
        self.put("L %s; LOOP %s" % (counter, again))
        self.loops -= 1

    def piece(self, depth):
        if depth < 2 and self.draw.random() < 0.3:
            self.draw.choice([self.compared, self.by_condition_codes, self.distributor, self.loop])(depth)
        else:
            self.draw.choice([self.logic, self.straight, self.straight, self.straight])()

    def defined(self):
        """Accumulators and RLO, where a CALL has left them."""
        self.put("L {!DWORD}; L {!INT}; {SET|CLR}")

    def body(self, calls):
        self.defined()
        for name, kind in self.written():
            self.put("{SET|CLR}; = #" + name if kind == "BOOL" else "L {!%s}; T #%s" % (kind, name))
        self.put(NUMBER)
        for call in calls:
            self.piece(0)
            if self.draw.random() < 0.2:
                self.loop(0, lambda _: self.call(*call))
            else:
                self.call(*call)
            self.defined()
        for _ in range(self.draw.randint(2, 3)):
            self.piece(0)
        self.put(NUMBER)
        self.string()
        after = self.label()
        self.put(self.draw.choice(["SAVE", "SAVE", "BEB", "SPBN %s; BEA; %s: NOP 0" % (after, after)]))
        self.piece(1)

    def call(self, callee, how):
        """`how` is a data block, the name of a multi-instance, or nothing."""
        used = ["#" + name for name in KEPT]
        given = []
        for name, kind in callee.outputs + callee.in_outs:
            Block.cells += 4
            at = Block.cells
            used.append(self.own(kind, self.written(), used) or self.cell(kind, at, at + SIZES[kind], 501, at + SIZES[kind]))
            given.append("%s := %s" % (name, used[-1]))
        for name, kind in callee.inputs:
            value = self.constant(kind) if self.draw.random() < 0.3 else self.own(kind, self.inputs + self.written(), used)
            given.append("%s := %s" % (name, value or self.cell(kind, 0, READ, 500, 2 * WORDS)))
        target = "#" + how if isinstance(how, str) else "%s %d%s" % (callee.kind, callee.number, ", DB %d" % how if how else "")
        self.put("CALL %s (%s)" % (target, ", ".join(given)))

    def source(self):
        word = {"FC": "FUNCTION", "FB": "FUNCTION_BLOCK", "OB": "ORGANIZATION_BLOCK"}[self.kind]
        text = ["%s %s %d%s" % (word, self.kind, self.number, " : VOID" * (self.kind == "FC"))]
        for section, rows in (("VAR_INPUT", self.inputs), ("VAR_OUTPUT", self.outputs), ("VAR_IN_OUT", self.in_outs),
                              ("VAR", self.statics + self.inner), ("VAR_TEMP", self.temps)):
            text += [section, *("  %s : %s;" % row for row in rows), "END_VAR"] if rows else []
        return "\n".join([*text, "BEGIN", *self.lines, "END_" + word, ""])


def data_block(number, content):
    return "DATA_BLOCK DB %d\n%s\nBEGIN\nEND_DATA_BLOCK\n" % (number, content)


class Program:
    def __init__(self, seed, count):
        self.draw, self.instances = random.Random(seed), []
        Block.cells = CELLS
        made, free = [], []
        for n in range(count):
            kind = self.draw.choice(["FC", "FB"])
            block = Block(self.draw, kind, 1 + sum(one.kind == kind for one in made))
            # It calls some of those that nobody has called yet; a few of them are left for a second caller.
            callees = [one for one in self.draw.sample(free, min(len(free), self.draw.choice([0, 0, 1, 1, 2, 3]))) if one.depth < 5]
            for one in callees:
                block.depth = max(block.depth, one.depth + 1)
                if one.callers or self.draw.random() < 0.9:
                    free.remove(one)
                one.callers.append(block)
            block.body([(one, self.instance(block, one)) for one in callees])
            made.append(block)
            free.append(block)
        main = Block(self.draw, "OB", 1)
        main.inputs = main.outputs = main.in_outs = main.statics = []
        main.temps = [("info", "ARRAY [0..19] OF BYTE")]
        self.begin(main)
        for one in free:
            main.call(one, self.instance(main, one))
        made.append(main)
        data = [data_block(number, "FB %d" % of) for number, of in self.instances]
        data += [data_block(500, "STRUCT\n  w : ARRAY [0..%d] OF WORD;\nEND_STRUCT" % (WORDS - 1)),
                 data_block(501, "STRUCT\n  b : ARRAY [0..%d] OF BYTE;\nEND_STRUCT" % (Block.cells + 8))]
        self.text = "\n".join([block.source() for block in made[:-1]] + data + [main.source()])

    def begin(self, main):
        main.put("CLR; SAVE; L 0; L MD %d; + L#1; T MD %d" % (SCANS, SCANS))
        for at in range(0, WRITTEN, 4):
            main.put("L {!DWORD}; T MD %d" % at)
        for at in range(REALS, RESULTS, 4):
            main.put("L %.4e; T MD %d" % (self.draw.choice([-1, 1]) * self.draw.uniform(0.01, 2000), at))
        main.put("L {!WORD}; T AW 0; T AW 2; AUF DB 500; LAR1 P#0.0; L %d; n001: T MW %d; L {!WORD}; T DBW [AR1,P#0.0]; +AR1 P#2.0; L MW %d; LOOP n001"
                 % (WORDS, COUNT, COUNT))

    def instance(self, caller, callee):
        if callee.kind == "FC":
            return None
        if caller.kind == "FB" and self.draw.random() < 0.6:
            caller.inner.append(("n%d" % len(caller.inner), "FB %d" % callee.number))
            return caller.inner[-1][0]
        self.instances.append((600 + len(self.instances), callee.number))
        return self.instances[-1][0]


def selftest():
    text = Program(1, 30).text
    assert text == Program(1, 30).text != Program(2, 30).text
    assert len(re.findall("^FUNCTION", text, re.M)) == 30 and "{" not in text
    called = re.findall(r"CALL F[CB] (\d+)|CALL #n\d", text)
    assert len(called) >= 30, "each has a caller"
    print("s7_programs.py: passed")


if __name__ == "__main__":
    if sys.argv[1:] == ["--selftest"]:
        selftest()
        sys.exit()
    print(Program(int(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 100).text)
