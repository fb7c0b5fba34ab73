#!/usr/bin/env python3
"""Decodes M-Bus frames with pyMeterBus: what our master has read is what another's library understands.

A frame in hexadecimal a line on standard input; for each a line of JSON:

    {"header": {"identification": "...", "manufacturer": "...", "version": 20, "medium": 7}, "values": [...]}
    {"error": "why pyMeterBus cannot decode it"}

values are the records in their order: a number in the unit of the quantity (Wh, m3, s, ...), a text, or null.
"""

import json
import sys


def decode(line):
    import meterbus

    try:
        telegram = meterbus.load(bytes.fromhex(line))
        body = json.loads(telegram.to_JSON())["body"]
    # Its own errors, and those of Python where it does not expect what came: both say that it cannot.
    except (meterbus.MBusFrameDecodeError, meterbus.MBusFrameCRCError, AttributeError, IndexError, KeyError) as why:
        return {"error": f"{type(why).__name__}: {why}"}
    head = body["header"]
    header = {key: head[key] for key in ("identification", "manufacturer", "version", "medium")}
    return {"header": header, "values": [record["value"] for record in body["records"]]}


def selftest():
    """A frame by the letter of EN 1434-3, as it is and with another check sum: 12565 l, at most 113 l/h, 218.37 kWh."""
    frame = "681F1F680802727856341224400107550000000313153100DA023B13018B60043718021816"
    found, wrong = decode(frame), decode(frame[:-4] + "1916")
    held = found.get("values") == [12.565, 0.113, 218370] and "error" in wrong
    print(json.dumps({"event": "check", "what": "a frame and a wrong check sum", "held": held, "found": found}))
    return 0 if held else 1


if __name__ == "__main__":
    if "--selftest" in sys.argv:
        sys.exit(selftest())
    for text in sys.stdin:
        print(json.dumps(decode(text.strip())), flush=True)
