#!/usr/bin/env python3
"""A client of S7 communication in forty lines: shows the level, and sets a new target.

    client.py [TARGET]
"""

import socket
import struct
import sys


def connect(host, port, rack=0, slot=2):
    wire = socket.create_connection((host, port), timeout=5)
    called = bytes([0x02, rack << 5 | slot])
    wire.sendall(bytes.fromhex("0300001611e00000000100c0010ac1020100c202") + called)
    assert receive(wire)[1] == 0xD0, "the CPU refuses the connection"
    job(wire, bytes.fromhex("f0000001000101e0"))
    return wire


def receive(wire):
    head = wire.recv(4, socket.MSG_WAITALL)
    return wire.recv(struct.unpack(">H", head[2:])[0] - 4, socket.MSG_WAITALL)


def job(wire, parameters, data=b""):
    head = struct.pack(">BBHHHH", 0x32, 1, 0, 1, len(parameters), len(data))
    telegram = b"\x02\xf0\x80" + head + parameters + data
    wire.sendall(struct.pack(">BBH", 3, 0, len(telegram) + 4) + telegram)
    answer = receive(wire)[3:]
    assert answer[10:12] == b"\0\0", "refused: %s" % answer[10:12].hex()
    return answer[12 + struct.unpack(">H", answer[6:8])[0]:]


def item(db, first_byte, count):
    return b"\x12\x0a\x10\x02" + struct.pack(">HHI", count, db, 0x84 << 24 | first_byte * 8)


def read(wire, db, first_byte, count):
    data = job(wire, b"\x04\x01" + item(db, first_byte, count))
    assert data[0] == 0xFF, "item: code %02X" % data[0]
    return data[4:4 + count]


def write(wire, db, first_byte, data):
    code = job(wire, b"\x05\x01" + item(db, first_byte, len(data)), struct.pack(">BBH", 0, 4, len(data) * 8) + data)
    assert code[0] == 0xFF, "item: code %02X" % code[0]


plant = connect("127.0.0.1", 10102)
if len(sys.argv) > 1:
    write(plant, 10, 4, struct.pack(">f", float(sys.argv[1])))
level, target, pump, cycles = struct.unpack(">ff?xi", read(plant, 10, 0, 14))
print("level %.2f, target %.2f, pump %s, cycle %d" % (level, target, "on" if pump else "off", cycles))
