#!/usr/bin/env python3
"""A Modbus coupler that is not ours: pymodbus behind a TCP port.

    coupler.py [--port N]      N: 0 (default) takes a free one

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


async def serve(args):
    from pymodbus.server import ModbusTcpServer
    from pymodbus.simulator import DataType, SimData, SimDevice

    bits = lambda: SimData(0, values=[False] * SIZE, datatype=DataType.BITS)
    words = lambda: SimData(0, values=[0] * SIZE, datatype=DataType.REGISTERS)
    # Any unit.
    device = SimDevice(0, simdata=([bits()], [bits()], [words()], [words()]))
    server = ModbusTcpServer(device, address=("127.0.0.1", args.port))
    await server.serve_forever(background=True)
    say(port=server.transport.sockets[0].getsockname()[1])
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


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--port", type=int, default=0)
    asyncio.run(serve(parser.parse_args()))


if __name__ == "__main__":
    main()
