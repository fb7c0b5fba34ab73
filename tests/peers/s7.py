#!/usr/bin/env python3
"""S7 clients that are not ours: python-snap7's pure client, its native library (snap7), and pyS7.

    s7.py CLIENT HOST PORT [--slot 2]      does what standard input says, one JSON object a line

    s7.py server HOST PORT                 snap7's server with 1000 bytes of DB 10, until standard input ends

CLIENT is native (python-snap7 2, which brings the C++ library), pure (python-snap7 3) or pys7. Each line of standard
input is {"op": ...}; each answer is one line: {"ok": true, ...} or {"ok": false, "error": "..."}.

    read     area, db, at, bytes           hex
    write    area, db, at, hex
    multi    items: [[area, db, at, bytes], ...]   hex: [...], None for an item that was refused
    bit      area, db, at, bit [, value]   value
    string   db, at [, value, room]        value
    real     db, at [, value]              value
    szl      id, index                     record, hex
    counts                                 OB, FB, FC, DB, SFC, SFB, SDB
    list     type                          numbers
    upload   type, number                  hex
    download hex                           the block its head names
    delete   type, number
    clock    [value]                       value, as an ISO date
    state                                  RUN or STOP
    stop, warm, cold
    login    password

pyS7 has the values and the state; the rest it does not know.
"""

import argparse
import ctypes
import datetime
import json
import os
import socket
import struct
import sys
import threading

NATIVE = os.environ.get("OB1_SNAP7_NATIVE", "")
AREAS = {"PE": 0x81, "PA": 0x82, "M": 0x83, "DB": 0x84, "C": 0x1C, "T": 0x1D}
TYPES = {"OB": "OB", "FB": "FB", "FC": "FC", "DB": "DB", "SDB": "SDB", "SFC": "SFC", "SFB": "SFB"}


class Snap7:
    """python-snap7; both halves have nearly one interface."""

    def __init__(self, host, port, slot, native):
        if native and NATIVE:
            sys.path.insert(0, NATIVE)
        import snap7

        major = int(getattr(snap7, "__version__", "2").split(".")[0]) if native else 3
        if native and hasattr(snap7, "s7protocol"):
            raise SystemExit("the native library is not here (OB1_SNAP7_NATIVE): found python-snap7 %s" % major)
        from snap7.client import Client
        from snap7.type import Areas, Block, WordLen

        self.areas = {name: getattr(Areas, {"M": "MK", "C": "CT", "T": "TM"}.get(name, name)) for name in AREAS}
        self.blocks = {name: getattr(Block, name) for name in TYPES}
        self.words, self.native = WordLen, native
        self.client = Client()
        self.client.connect(host, 0, slot, port)

    def read(self, area, db, at, count):
        return bytes(self.client.read_area(self.areas[area], db, at, count))

    def write(self, area, db, at, data):
        self.client.write_area(self.areas[area], db, at, bytearray(data))

    def multi(self, items):
        from snap7.type import S7DataItem

        wanted = (S7DataItem * len(items))()
        buffers = []
        for item, (area, db, at, count) in zip(wanted, items):
            buffer = ctypes.create_string_buffer(count)
            buffers.append((buffer, count))
            item.Area, item.WordLen, item.DBNumber = AREAS[area], 2, db
            item.Start, item.Amount, item.Result = at, count, 0
            item.pData = ctypes.cast(buffer, ctypes.POINTER(ctypes.c_uint8))
        _, results = self.client.read_multi_vars(wanted)
        return [bytes(buffer.raw[:count]).hex() if not item.Result else None
                for item, (buffer, count) in zip(results, buffers)]

    def szl(self, number, index):
        szl = self.client.read_szl(number, index)
        header, data = szl.Header, bytes(szl.Data)
        if self.native:
            return header.LengthDR, header.NDR, data
        # The pure client leaves the length and number of the records in front of them.
        return (*struct.unpack(">HH", data[:4]), data[4:])

    def counts(self):
        counts = self.client.list_blocks()
        return {name: getattr(counts, name + "Count") for name in TYPES}

    def list(self, kind):
        numbers = list(self.client.list_blocks_of_type(self.blocks[kind], 1000))
        return sorted(number for number in numbers if number)

    def upload(self, kind, number):
        data, length = self.client.full_upload(self.blocks[kind], number)
        return bytes(data)[:length]

    def download(self, data):
        number = struct.unpack(">H", data[6:8])[0]
        done = self.client.download(bytearray(data), number)
        if done:
            raise RuntimeError("refused: %r" % done)

    def delete(self, kind, number):
        done = self.client.delete(self.blocks[kind], number)
        if done:
            raise RuntimeError("refused: %r" % done)

    def clock(self, value=None):
        if value:
            self.client.set_plc_datetime(datetime.datetime.fromisoformat(value))
        return self.client.get_plc_datetime().isoformat()

    def state(self):
        if not self.native:
            # The pure client's own question is no question of the protocol.
            return {8: "RUN", 3: "STOP", 4: "STOP"}.get(self.szl(0x0424, 0)[2][3] & 0x0F, "?")
        return "RUN" if "Run" in str(self.client.get_cpu_state()) else "STOP"

    def command(self, name):
        done = {"stop": self.client.plc_stop, "warm": self.client.plc_hot_start, "cold": self.client.plc_cold_start}[name]()
        if done:
            raise RuntimeError("refused: %r" % done)

    def login(self, password):
        self.client.set_session_password(password)


class PyS7:
    """pyS7 reads and writes tags by their names."""

    def __init__(self, host, port, slot):
        from pyS7 import S7Client

        self.client = S7Client(host, 0, slot, port=port)
        self.client.connect()

    @staticmethod
    def tag(area, db, at, letter, rest=""):
        return "DB%d,%s%d%s" % (db, letter, at, rest) if area == "DB" else {"PE": "I", "PA": "Q"}.get(area, area) + letter + "%d%s" % (at, rest)

    def read(self, area, db, at, count):
        values = self.client.read([self.tag(area, db, at + n, "B") for n in range(count)])
        return bytes(values)

    def write(self, area, db, at, data):
        self.client.write([self.tag(area, db, at + n, "B") for n in range(len(data))], list(data))

    def multi(self, items):
        return [self.read(*item).hex() for item in items]

    def state(self):
        return "RUN" if "RUN" in str(self.client.get_cpu_status()).upper() else "STOP"


def serve(partner, request):
    op = request.get("op")
    area, db, at = request.get("area", "DB"), request.get("db", 0), request.get("at", 0)
    if op == "read":
        return {"hex": partner.read(area, db, at, request["bytes"]).hex()}
    if op == "write":
        partner.write(area, db, at, bytes.fromhex(request["hex"]))
        return {}
    if op == "multi":
        return {"hex": partner.multi([tuple(item) for item in request["items"]])}
    if op == "bit":
        if isinstance(partner, PyS7):
            tag = partner.tag(area, db, at, "X" if area == "DB" else "", ".%d" % request["bit"])
            if "value" in request:
                partner.client.write([tag], [request["value"]])
            return {"value": partner.client.read([tag])[0]}
        byte = bytearray(partner.read(area, db, at, 1))
        if "value" in request:
            mask = 1 << request["bit"]
            byte[0] = byte[0] | mask if request["value"] else byte[0] & ~mask
            partner.write(area, db, at, byte)
        return {"value": bool(partner.read(area, db, at, 1)[0] >> request["bit"] & 1)}
    if op == "string":
        if "value" in request:
            text = request["value"].encode("latin-1")
            partner.write("DB", db, at, bytes([request["room"], len(text)]) + text)
        head = partner.read("DB", db, at, 2)
        return {"value": partner.read("DB", db, at + 2, head[1]).decode("latin-1")}
    if op == "real":
        if "value" in request:
            partner.write("DB", db, at, struct.pack(">f", request["value"]))
        return {"value": struct.unpack(">f", partner.read("DB", db, at, 4))[0]}
    if op == "szl":
        record, count, data = partner.szl(request["id"], request["index"])
        return {"record": record, "count": count, "hex": data[: record * count].hex()}
    if op == "counts":
        return partner.counts()
    if op == "list":
        return {"numbers": partner.list(request["type"])}
    if op == "upload":
        return {"hex": partner.upload(request["type"], request["number"]).hex()}
    if op == "download":
        partner.download(bytes.fromhex(request["hex"]))
        return {}
    if op == "delete":
        partner.delete(request["type"], request["number"])
        return {}
    if op == "clock":
        return {"value": partner.clock(request.get("value"))}
    if op == "state":
        return {"value": partner.state()}
    if op in ("stop", "warm", "cold"):
        partner.command(op)
        return {}
    if op == "login":
        partner.login(request["password"])
        return {}
    raise ValueError("there is no %r" % op)


def connect(name, host, port, slot):
    return PyS7(host, port, slot) if name == "pys7" else Snap7(host, port, slot, name == "native")


def answers(partner, lines):
    for line in lines:
        request = json.loads(line)
        try:
            yield {"ok": True, **serve(partner, request)}
        except Exception as error:  # what a client throws is its business
            yield {"ok": False, "error": "%s: %s" % (type(error).__name__, error)}


def serve_snap7(port):
    """The C++ server of the native library."""
    if NATIVE:
        sys.path.insert(0, NATIVE)
    import snap7

    if hasattr(snap7, "s7protocol"):
        raise SystemExit("the native library is not here (OB1_SNAP7_NATIVE)")
    from snap7.server import Server
    from snap7.type import SrvArea

    server = Server(log=False)
    block = (ctypes.c_uint8 * 1000)()
    server.register_area(SrvArea.DB, 10, block)
    server.start(port)
    print(json.dumps({"ok": True, "serves": port}), flush=True)
    sys.stdin.read()
    os._exit(0)


def selftest():
    """The pure client and pyS7 against the server that comes with python-snap7."""
    from snap7.server import Server
    from snap7.type import SrvArea

    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = Server()
    block = (ctypes.c_uint8 * 100)(*range(100))
    server.register_area(SrvArea.DB, 1, block)
    server.start(port)
    try:
        for name in ("pure", "pys7"):
            partner = connect(name, "127.0.0.1", port, 1)
            got = list(answers(partner, [
                '{"op":"read","db":1,"at":10,"bytes":3}',
                '{"op":"write","db":1,"at":20,"hex":"aa"}',
                '{"op":"read","db":1,"at":19,"bytes":3}',
                '{"op":"nonsense"}',
            ]))
            assert got[0] == {"ok": True, "hex": "0a0b0c"}, got
            assert got[1]["ok"] and got[2]["hex"] == "13aa15", got
            assert not got[3]["ok"], got
    finally:
        # The server's own threads are ended with the process; it waits seconds for them otherwise.
        threading.Thread(target=server.stop, daemon=True).start()
    print("s7.py: passed")
    sys.stdout.flush()
    os._exit(0)


def main():
    if sys.argv[1:] == ["--selftest"]:
        selftest()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("client", choices=["native", "pure", "pys7", "server"])
    parser.add_argument("host")
    parser.add_argument("port", type=int)
    parser.add_argument("--slot", type=int, default=2)
    args = parser.parse_args()
    if args.client == "server":
        return serve_snap7(args.port)
    try:
        partner = connect(args.client, args.host, args.port, args.slot)
    except Exception as error:
        print(json.dumps({"ok": False, "error": str(error)}), flush=True)
        return 1
    print(json.dumps({"ok": True, "connected": args.client}), flush=True)
    for answer in answers(partner, sys.stdin):
        print(json.dumps(answer), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
