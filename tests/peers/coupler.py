#!/usr/bin/env python3
"""A Modbus coupler that is not ours: pymodbus behind a TCP port.

    coupler.py [--port N]      N: 0 (default) takes a free one
    coupler.py --selftest      a client of pymodbus reads what is set, and what it writes arrives

512 words and bits of each kind. It prints {"port": N} when it listens, and then plays one JSON line of standard input after the other:

    {"set": [FUNCTION, ADDRESS, [VALUES]]}      4: input registers, 3: holding registers, 2: discrete inputs, 1: coils
    {"get": [FUNCTION, ADDRESS, COUNT]}         answers {"values": [...]}

It ends with its standard input.
"""

import argparse
import asyncio
import json
import sys

SIZE = 512


def say(**event):
    print(json.dumps(event), flush=True)


async def listen(port):
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    bits = lambda: SimData(0, values=[False] * SIZE, datatype=DataType.BITS)
    words = lambda: SimData(0, values=[0] * SIZE, datatype=DataType.REGISTERS)
    # Any unit.
    device = SimDevice(0, simdata=([bits()], [bits()], [words()], [words()]))
    server = ModbusTcpServer(device, address=("127.0.0.1", port))
    await server.serve_forever(background=True)
    return server, server.transport.sockets[0].getsockname()[1]


async def serve(args):
    server, port = await listen(args.port)
    say(port=port)
    loop = asyncio.get_running_loop()
    while True:
        line = await loop.run_in_executor(None, sys.stdin.readline)
        if not line:
            break
        step = json.loads(line)
        if "set" in step:
            function, address, values = step["set"]
            await server.async_setValues(0, function, address, values)
            say(done=True)
        else:
            function, address, count = step["get"]
            values = await server.async_getValues(0, function, address, count)
            say(values=[int(value) for value in values])
    await server.shutdown()


async def selftest():
    from pymodbus.client import AsyncModbusTcpClient

    server, port = await listen(0)
    await server.async_setValues(0, 3, 10, [0x1234, 0xABCD])
    client = AsyncModbusTcpClient("127.0.0.1", port=port)
    if not await client.connect():
        return "no connection"
    words = (await client.read_holding_registers(10, count=2, device_id=1)).registers
    await client.write_coil(7, True, device_id=1)
    coils = [bool(value) for value in await server.async_getValues(0, 1, 6, 3)]
    client.close()
    await server.shutdown()
    return None if (words, coils) == ([0x1234, 0xABCD], [False, True, False]) else f"{words} {coils}"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, default=0)
    parser.add_argument("--selftest", action="store_true", help="a client reads what is set, and what it writes arrives")
    args = parser.parse_args()
    if args.selftest:
        sys.exit(asyncio.run(selftest()))
    asyncio.run(serve(args))


if __name__ == "__main__":
    main()
