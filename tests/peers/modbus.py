#!/usr/bin/env python3
"""Modbus partners that are not ours: pymodbus, minimalmodbus and libmodbus, on a tty.

    modbus.py master LIBRARY TTY --mode rtu --inputs HEX     asks a slave of 16 bytes each way for everything there is
    modbus.py slave LIBRARY TTY --mode rtu                   answers until standard input ends
    modbus.py bench LIBRARY TTY --count 1000                 how long so many transactions take; libmodbus also takes HOST:PORT

LIBRARY is pymodbus (master and slave, RTU and ASCII), minimalmodbus (master, RTU and ASCII) or libmodbus (slave, RTU).

The master keeps a picture of the output area of its own: words high byte first, bit n in byte n / 8, lowest first
[S0 "Range definitions"]. Everything it reads must be as in the picture, and in --inputs for the input area; what it is refused must be
refused with the right code. It prints one JSON line a step and ends with code 1 at the first that is wrong.

The slave has 512 words and 512 bits of each kind. Input word n is 1000h + n, input bit n is set when n is a multiple of 3. At the end
it prints, as one JSON line, the first 64 words and bits of the areas that can be written.
"""

import argparse
import ctypes
import json
import os
import select
import sys
import threading
import time

SIZE = 512


def report(**event):
    print(json.dumps(event), flush=True)


class Refused(Exception):
    """The slave has answered with an exception code."""

    def __init__(self, code):
        super().__init__("exception %d" % code)
        self.code = code


class Silent(Exception):
    """No answer."""


# ---- masters: one name for each function code ----


class PymodbusMaster:
    def __init__(self, args):
        from pymodbus import FramerType
        from pymodbus.client import ModbusSerialClient
        from pymodbus.exceptions import ModbusIOException

        self.silent, self.address = ModbusIOException, args.address
        framer = FramerType.RTU if args.mode == "rtu" else FramerType.ASCII
        self.client = ModbusSerialClient(
            args.tty, framer=framer, baudrate=args.baud, bytesize=8, parity="N", stopbits=1, timeout=args.timeout, retries=0
        )
        if not self.client.connect():
            raise OSError("cannot open " + args.tty)

    def _done(self, call, *what, **more):
        try:
            answer = call(*what, device_id=self.address, **more)
        except self.silent:
            raise Silent from None
        if answer.isError():
            if isinstance(answer, self.silent):
                raise Silent
            raise Refused(answer.exception_code)
        return answer

    def read_bits(self, code, first, count):
        call = {1: self.client.read_coils, 2: self.client.read_discrete_inputs}[code]
        return [bool(bit) for bit in self._done(call, first, count=count).bits[:count]]

    def read_words(self, code, first, count):
        call = {3: self.client.read_holding_registers, 4: self.client.read_input_registers}[code]
        return list(self._done(call, first, count=count).registers)

    def write_bit(self, at, on):
        self._done(self.client.write_coil, at, on)

    def write_word(self, at, value):
        self._done(self.client.write_register, at, value)

    def write_bits(self, first, bits):
        self._done(self.client.write_coils, first, bits)

    def write_words(self, first, words):
        self._done(self.client.write_registers, first, words)

    def broadcast_word(self, at, value):
        self.client.write_register(at, value, device_id=0, no_response_expected=True)
        # The turnaround delay after a broadcast, which the library leaves to its user: without it the next telegram would follow
        # without the silence in between. Nobody answers.
        select.select([self.client.socket.fileno()], [], [], 0.2)

    def to(self, address):
        self.address = address


class MinimalmodbusMaster:
    def __init__(self, args):
        import minimalmodbus

        self.library = minimalmodbus
        mode = minimalmodbus.MODE_RTU if args.mode == "rtu" else minimalmodbus.MODE_ASCII
        self.instrument = minimalmodbus.Instrument(args.tty, args.address, mode=mode)
        self.instrument.serial.baudrate = args.baud
        self.instrument.serial.timeout = args.timeout

    def _done(self, call, *what, **more):
        try:
            return call(*what, **more)
        except self.library.NoResponseError:
            raise Silent from None
        except self.library.IllegalRequestError as why:
            # It tells the kinds apart by its words only.
            codes = {"illegal function": 1, "illegal data address": 2, "illegal data value": 3}
            raise Refused(next((code for text, code in codes.items() if text in str(why).lower()), 0)) from None

    def read_bits(self, code, first, count):
        return [bool(bit) for bit in self._done(self.instrument.read_bits, first, count, functioncode=code)]

    def read_words(self, code, first, count):
        return self._done(self.instrument.read_registers, first, count, functioncode=code)

    def write_bit(self, at, on):
        self._done(self.instrument.write_bit, at, int(on), functioncode=5)

    def write_word(self, at, value):
        self._done(self.instrument.write_register, at, value, functioncode=6)

    def write_bits(self, first, bits):
        self._done(self.instrument.write_bits, first, [int(bit) for bit in bits])

    def write_words(self, first, words):
        self._done(self.instrument.write_registers, first, list(words))

    def to(self, address):
        self.instrument.address = address


def play_master(master, args):
    """Everything, against a picture of the slave's output area; returns the number of steps."""
    picture, inputs = bytearray(16), bytes.fromhex(args.inputs)
    steps = 0

    def words(area, first, count):
        return [area[2 * n] << 8 | area[2 * n + 1] for n in range(first, first + count)]

    def bits(area, first, count):
        return [bool(area[n // 8] >> n % 8 & 1) for n in range(first, first + count)]

    def same(what, found, expected):
        nonlocal steps
        steps += 1
        report(step=what, good=found == expected)
        if found != expected:
            report(found=found, expected=expected)
            sys.exit(1)

    def whole(what):
        same(what + ", code 3", master.read_words(3, 0, 8), words(picture, 0, 8))
        same(what + ", code 1", master.read_bits(1, 0, 128), bits(picture, 0, 128))

    values = [0xA0A1, 0xA2A3, 0xA4A5, 0xA6A7, 0xA8A9, 0xAAAB, 0xACAD, 0xAEAF]
    master.write_words(0, values)
    picture[:] = bytes(range(0xA0, 0xB0))
    whole("code 16")
    master.write_word(3, 0x1234)
    picture[6:8] = b"\x12\x34"
    whole("code 6")
    for on in (True, False):
        master.write_bit(13, on)
        picture[1] = picture[1] & 0xDF | (0x20 if on else 0)
        whole("code 5")
    pattern = [n % 3 == 0 for n in range(21)]
    master.write_bits(70, pattern)
    for n, bit in enumerate(pattern, 70):
        picture[n // 8] = picture[n // 8] & ~(1 << n % 8) | bit << n % 8
    whole("code 15")
    same("code 4", master.read_words(4, 0, 8), words(inputs, 0, 8))
    same("code 4, one", master.read_words(4, 7, 1), words(inputs, 7, 1))
    same("code 2", master.read_bits(2, 0, 128), bits(inputs, 0, 128))
    same("code 2, some", master.read_bits(2, 9, 14), bits(inputs, 9, 14))
    for what, call in (
        ("words", lambda: master.read_words(3, 7, 2)),
        ("bits", lambda: master.read_bits(2, 120, 9)),
        ("write", lambda: master.write_word(8, 1)),
    ):
        try:
            call()
            code = 0
        except Refused as why:
            code = why.code
        same("outside, " + what, code, 2)
    master.to(args.address + 1)
    try:
        master.read_words(3, 0, 1)
        answered = True
    except Silent:
        answered = False
    same("another slave", answered, False)
    master.to(args.address)
    if args.library == "pymodbus":
        master.broadcast_word(0, 0xBEEF)
        picture[0:2] = b"\xbe\xef"
    whole("at the end")
    return steps


# ---- slaves ----


def ended_input():
    """Waits for the end of standard input."""
    while os.read(0, 4096):
        pass


def pymodbus_slave(args):
    import asyncio

    from pymodbus import FramerType
    from pymodbus.server import ModbusSerialServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    coils = SimData(0, values=[False] * SIZE, datatype=DataType.BITS)
    inputs = SimData(0, values=[n % 3 == 0 for n in range(SIZE)], datatype=DataType.BITS)
    words = SimData(0, values=[0] * SIZE, datatype=DataType.REGISTERS)
    input_words = SimData(0, values=[0x1000 + n for n in range(SIZE)], datatype=DataType.REGISTERS)
    device = SimDevice(args.address, simdata=([coils], [inputs], [words], [input_words]))
    framer = FramerType.RTU if args.mode == "rtu" else FramerType.ASCII

    async def serve():
        server = ModbusSerialServer(
            device, framer=framer, port=args.tty, baudrate=args.baud, ignore_missing_devices=True, broadcast_enable=True
        )
        await server.serve_forever(background=True)
        report(ready=True)
        await asyncio.get_running_loop().run_in_executor(None, ended_input)
        written = await server.async_getValues(args.address, 3, 0, 64)
        bits = await server.async_getValues(args.address, 1, 0, 64)
        await server.shutdown()
        report(words=list(written), bits=[bool(bit) for bit in bits])

    asyncio.run(serve())


class Mapping(ctypes.Structure):
    """modbus_mapping_t."""

    _fields_ = [(name, ctypes.c_int) for name in (
        "nb_bits", "start_bits", "nb_input_bits", "start_input_bits",
        "nb_input_registers", "start_input_registers", "nb_registers", "start_registers",
    )] + [
        ("tab_bits", ctypes.POINTER(ctypes.c_uint8)), ("tab_input_bits", ctypes.POINTER(ctypes.c_uint8)),
        ("tab_input_registers", ctypes.POINTER(ctypes.c_uint16)), ("tab_registers", ctypes.POINTER(ctypes.c_uint16)),
    ]


def libmodbus():
    try:
        library = ctypes.CDLL("libmodbus.so.5", use_errno=True)
    except OSError as why:
        sys.exit("libmodbus is not here (%s); apt install libmodbus5" % why)
    library.modbus_new_rtu.restype = ctypes.c_void_p
    library.modbus_new_rtu.argtypes = [ctypes.c_char_p, ctypes.c_int, ctypes.c_char, ctypes.c_int, ctypes.c_int]
    library.modbus_mapping_new.restype = ctypes.POINTER(Mapping)
    for name, kinds in {
        "modbus_set_slave": [ctypes.c_int],
        "modbus_connect": [],
        "modbus_get_socket": [],
        "modbus_receive": [ctypes.c_char_p],
        "modbus_reply": [ctypes.c_char_p, ctypes.c_int, ctypes.POINTER(Mapping)],
    }.items():
        getattr(library, name).argtypes = [ctypes.c_void_p] + kinds
    return library


def libmodbus_slave(args):
    library = libmodbus()
    context = library.modbus_new_rtu(args.tty.encode(), args.baud, b"N", 8, 1)
    if not context or library.modbus_set_slave(context, args.address) or library.modbus_connect(context):
        sys.exit("libmodbus cannot open " + args.tty)
    mapping = library.modbus_mapping_new(SIZE, SIZE, SIZE, SIZE)
    for n in range(SIZE):
        mapping.contents.tab_input_bits[n] = n % 3 == 0
        mapping.contents.tab_input_registers[n] = 0x1000 + n
    tty = library.modbus_get_socket(context)
    request = ctypes.create_string_buffer(260)
    report(ready=True)
    while True:
        ready, _, _ = select.select([0, tty], [], [])
        if 0 in ready and not os.read(0, 4096):
            break
        if tty in ready:
            length = library.modbus_receive(context, request)
            if length > 0:
                library.modbus_reply(context, request, length, mapping)
    report(
        words=mapping.contents.tab_registers[:64],
        bits=[bool(bit) for bit in mapping.contents.tab_bits[:64]],
    )


# ---- how fast a library is as a master ----


def bench(args):
    """Reads one register so many times; the pty's other end answers 1234h."""
    if args.library == "pymodbus":
        master = PymodbusMaster(args)
        once = lambda: master.read_words(3, 0, 1)  # noqa: E731
        answered = lambda result: result == [0x1234]  # noqa: E731
    else:
        library = libmodbus()
        host, _, port = args.tty.rpartition(":")
        if host:
            library.modbus_new_tcp.restype = ctypes.c_void_p
            library.modbus_new_tcp.argtypes = [ctypes.c_char_p, ctypes.c_int]
            context = library.modbus_new_tcp(host.encode(), int(port))
        else:
            context = library.modbus_new_rtu(args.tty.encode(), args.baud, b"N", 8, 1)
        if not context or library.modbus_set_slave(context, args.address) or library.modbus_connect(context):
            sys.exit("libmodbus cannot open " + args.tty)
        library.modbus_read_registers.argtypes = [
            ctypes.c_void_p, ctypes.c_int, ctypes.c_int, ctypes.POINTER(ctypes.c_uint16)
        ]
        word = (ctypes.c_uint16 * 1)()
        once = lambda: library.modbus_read_registers(context, 0, 1, word)  # noqa: E731
        answered = lambda result: result == 1 and word[0] == 0x1234  # noqa: E731
    assert answered(once())
    begin = time.perf_counter()
    for _ in range(args.count):
        assert answered(once())
    report(seconds=time.perf_counter() - begin)


# ---- the script itself ----


def selftest():
    """The libraries are the pinned ones, and agree with one another about a telegram over a pty of our own."""
    import tty
    from importlib.metadata import version

    pinned = {}
    with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "requirements.in"), encoding="utf-8") as lines:
        for line in lines:
            if "==" in line and not line.startswith("#"):
                name, number = line.strip().split("==")
                pinned[name] = number
    for name in ("pymodbus", "minimalmodbus", "pyserial"):
        number = pinned[name]
        assert version(name) == number, "%s is %s, not %s" % (name, version(name), number)
    libmodbus()
    ours, theirs = os.openpty()
    tty.setraw(ours)
    tty.setraw(theirs)

    class Arguments:
        tty, mode, address, baud, timeout = os.ttyname(theirs), "rtu", 5, 19200, 5

    def answer():
        request = b""
        while len(request) < 8:
            request += os.read(ours, 8 - len(request))
        assert request == bytes.fromhex("050300000001858e"), request.hex()
        os.write(ours, bytes.fromhex("050302123444f3"))

    for master in (PymodbusMaster, MinimalmodbusMaster):
        thread = threading.Thread(target=answer)
        thread.start()
        assert master(Arguments).read_words(3, 0, 1) == [0x1234], master.__name__
        thread.join()
    print("modbus.py: self-test passed")


def main():
    if sys.argv[1:] == ["--selftest"]:
        return selftest()
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("role", choices=["master", "slave", "bench"])
    parser.add_argument("library", choices=["pymodbus", "minimalmodbus", "libmodbus"])
    parser.add_argument("tty")
    parser.add_argument("--mode", choices=["rtu", "ascii"], default="rtu")
    parser.add_argument("--address", type=int, default=5)
    parser.add_argument("--baud", type=int, default=19200)
    parser.add_argument("--count", type=int, default=1000, help="transactions of a measurement")
    parser.add_argument("--timeout", type=float, default=5)
    parser.add_argument("--inputs", default="00" * 16, help="the slave's input area, 16 bytes")
    args = parser.parse_args()
    if args.role == "slave":
        {"pymodbus": pymodbus_slave, "libmodbus": libmodbus_slave}[args.library](args)
        return
    if args.role == "bench":
        return bench(args)
    master = {"pymodbus": PymodbusMaster, "minimalmodbus": MinimalmodbusMaster}[args.library](args)
    report(done=play_master(master, args))


if __name__ == "__main__":
    main()
