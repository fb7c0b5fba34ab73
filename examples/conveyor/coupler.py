#!/usr/bin/env python3
"""A conveyor with a Modbus TCP coupler: python3 coupler.py [PORT], 1502 without one.

Coil 0 is the motor. Discrete input 0 is the light barrier at the beginning of the belt, input 1 that at the end. A part is put on the belt each
second while its beginning is free; with the motor on it travels for two seconds. The watchdog is that of a WAGO 750: register 1000h the time in
100 ms, 100Ah := 1 starts it, 1008h := 55AAh stops it. When it expires the motor stops.
"""

import socketserver
import struct
import sys
import threading
import time

TRAVEL = 2.0


class Belt:
    def __init__(self):
        self.lock = threading.Lock()
        self.motor, self.parts, self.arrived = False, [], 0
        self.watchdog, self.time, self.heard = False, 0.0, time.monotonic()

    def barrier(self, end):
        at = TRAVEL if end else 0.0
        return any(abs(part - at) < 0.15 for part in self.parts)

    def work(self):
        last = put = time.monotonic()
        while True:
            time.sleep(0.01)
            now = time.monotonic()
            with self.lock:
                if self.watchdog and now - self.heard > self.time and self.motor:
                    self.motor = False
                    print("watchdog: motor off", flush=True)
                if self.motor:
                    self.parts = [part + now - last for part in self.parts]
                if now - put > 1 and not self.barrier(False):
                    self.parts.append(0.0)
                    put = now
                gone = [part for part in self.parts if part > TRAVEL + 0.1]
                if gone or (self.barrier(True) and not self.motor):
                    # Whoever waits at the end takes the part.
                    self.parts = [part for part in self.parts if part < TRAVEL - 0.15]
                    self.arrived += 1
                    print("parts: %d" % self.arrived, flush=True)
            last = now

    def answer(self, code, data):
        """The answer to a request without its unit; an exception is a number."""
        if len(data) < 4:
            return 3
        first, value = struct.unpack(">HH", data[:4])
        if code in (1, 2):
            bits = [self.motor] if code == 1 else [self.barrier(False), self.barrier(True)]
            bits += [False] * 16
            if first + value > len(bits):
                return 2
            number = sum(1 << n for n, bit in enumerate(bits[first : first + value]) if bit)
            size = (value + 7) // 8
            return bytes([code, size]) + number.to_bytes(size, "little")
        if code == 5:
            self.motor = value != 0 if first == 0 else self.motor
        elif code == 15:
            self.motor = bool(data[5] & 1) if first == 0 else self.motor
        elif code == 6 and first == 0x1000 and not self.watchdog:
            self.time = value / 10
        elif code == 6 and first == 0x1008:
            self.watchdog = False
        elif code == 6 and first == 0x100A:
            self.watchdog = value == 1
        else:
            return 2 if code == 6 else 1
        return bytes([code]) + data[:4]


BELT = Belt()


class Connection(socketserver.StreamRequestHandler):
    def handle(self):
        while True:
            head = self.rfile.read(7)
            if len(head) < 7:
                return
            transaction, protocol, length, unit = struct.unpack(">HHHB", head)
            request = self.rfile.read(length - 1)
            if protocol or len(request) < 1:
                return
            with BELT.lock:
                BELT.heard = time.monotonic()
                answer = BELT.answer(request[0], request[1:])
            if isinstance(answer, int):
                answer = bytes([request[0] | 0x80, answer])
            self.wfile.write(struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer)


def main():
    port = int(sys.argv[1]) if len(sys.argv) > 1 else 1502
    threading.Thread(target=BELT.work, daemon=True).start()
    socketserver.ThreadingTCPServer.allow_reuse_address = True
    socketserver.ThreadingTCPServer.daemon_threads = True
    with socketserver.ThreadingTCPServer(("127.0.0.1", port), Connection) as server:
        print("the coupler listens on port %d" % port, flush=True)
        server.serve_forever()


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
