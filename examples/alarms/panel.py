#!/usr/bin/env python3
"""A panel for alarms in eighty lines of Python: logs on, shows each change as it comes, and acknowledges.

    panel.py                  shows the changes of all alarms
    panel.py ack 16#60000001  acknowledges one
"""

import csv
import os
import socket
import struct
import sys

FUNCTIONS, BLOCKS = 9, 5  # kinds of alarms: ALARM_S (SFC), ALARM_8 (SFB)
STATES = {(1, 0): "came", (0, 0): "went", (1, 1): "is there, acknowledged", (0, 1): "is over"}


def connect(host, port, rack=0, slot=2):
    wire = socket.create_connection((host, port), timeout=5)
    called = bytes([0x02, rack << 5 | slot])
    wire.sendall(bytes.fromhex("0300001611e00000000100c0010ac1020100c202") + called)
    assert receive(wire)[1] == 0xD0, "the CPU refuses the connection"
    send(wire, 1, bytes.fromhex("f0000001000101e0"))
    receive(wire)
    return wire


def receive(wire):
    head = wire.recv(4, socket.MSG_WAITALL)
    if len(head) < 4:
        sys.exit("the connection is closed")
    return wire.recv(struct.unpack(">H", head[2:])[0] - 4, socket.MSG_WAITALL)


def send(wire, kind, parameters, data=b""):
    head = struct.pack(">BBHHHH", 0x32, kind, 0, 1, len(parameters), len(data))
    telegram = b"\x02\xf0\x80" + head + parameters + data
    wire.sendall(struct.pack(">BBH", 3, 0, len(telegram) + 4) + telegram)


def service(wire, sub, data):
    """A service of group 4 (messages); returns the data of its answer."""
    send(wire, 7, bytes([0, 1, 0x12, 4, 0x11, 0x44, sub, 0]), struct.pack(">BBH", 0xFF, 9, len(data)) + data)
    while True:
        answer = receive(wire)
        if answer[18] == 0x84:  # its answer, and no message
            assert answer[23:25] == b"\0\0", "refused: %s" % answer[23:25].hex()
            return answer[29:]
        show(answer)


def show(telegram):
    """A message: date and time, function, count, and the alarm."""
    sub, data = telegram[19], telegram[25:]
    at = "20%02x-%02x-%02x %02x:%02x:%02x" % tuple(data[:6])
    number, = struct.unpack(">I", data[14:18])
    if sub == 0x0C:
        print("%s  16#%08X acknowledged" % (at, number), flush=True)
    elif sub in (0x05, 0x06, 0x11, 0x12, 0x16):
        signals, _, going, coming = data[18:22]
        value = str(int.from_bytes(data[26:], "big", signed=True)) if data[13] else "?"
        changed = signals ^ before.get(number, 0)
        before[number] = signals
        for bit in (bit for bit in range(8) if changed >> bit & 1):
            text = texts.get((number, bit + 1)) or texts.get((number, 0), "")
            state = STATES[signals >> bit & 1, (coming & going) >> bit & 1]
            print("%s  16#%08X %s: %s" % (at, number, state, text.replace("@1I%d@", value)), flush=True)


def read_texts():
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "alarms.csv")) as file:
        rows = csv.DictReader(file, delimiter=";")
        return {(int(row["number"][3:], 16), int(row["signal"] or 0)): row["text"] for row in rows}


texts, before = read_texts(), {}
panel = connect("127.0.0.1", int(os.environ.get("PORT", "10102")))
if sys.argv[1:2] == ["ack"]:
    alarm = struct.pack(">BBBBIBB", 0x12, 8, 0x19, 0, int(sys.argv[2][3:], 16), 0xFF, 0xFF)
    code = service(panel, 0x0B, b"\x09\x01" + alarm)[2]
    print("acknowledged" if code == 0xFF else "there is no such alarm")
    sys.exit(code != 0xFF)
for kind in (FUNCTIONS, BLOCKS):
    service(panel, 2, b"\x81\0PANEL_01" + bytes([kind, 0]))
print("logged on", flush=True)
panel.settimeout(None)
while True:
    message = receive(panel)
    if message[18] == 0x04:
        show(message)
