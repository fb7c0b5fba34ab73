#!/usr/bin/env python3
"""The mash tun behind its Modbus coupler, with a page to look at it: python3 plant.py [MODBUS PORT] [PAGE PORT].

The coupler listens on 1503, the page is at http://127.0.0.1:8091/. Only this machine reaches them. The watchdog is that of a WAGO 750: register
1000h the time in 100 ms, 100Ah := 1 starts it, 1008h := 55AAh stops it; when it expires all outputs go off.
"""

import http.server
import json
import socketserver
import struct
import sys
import threading
import time

FULL, HOT, UNITS = 1000.0, 120.0, 27648.0
# What a hand at the machine can do: name, text, and whether it is a push button.
HANDS = {
    "start": ("Start", True), "stop": ("Stop", True), "quit": ("Quittieren", True), "notaus": ("Not-Aus", False),
    "pumpe": ("Motorschutz Pumpe auslösen", False), "ruehrer": ("Motorschutz Rührwerk auslösen", False),
    "deckel": ("Deckel öffnen", False), "filter": ("Filter verstopfen", False), "hand": ("Schlüsselschalter Hand", False),
}


class Plant:
    def __init__(self):
        self.lock = threading.Lock()
        self.hands = {name: False for name in HANDS}
        self.coils, self.heater = [False] * 16, 0
        self.level, self.celsius, self.valve = 0.0, 20.0, 0.0
        self.watchdog, self.time, self.heard = False, 0.0, time.monotonic()

    def work(self):
        last = time.monotonic()
        while True:
            time.sleep(0.02)
            now = time.monotonic()
            with self.lock:
                self.step(now - last, now)
            last = now

    def step(self, seconds, now):
        if self.watchdog and now - self.heard > self.time and any(self.coils):
            self.coils, self.heater = [False] * 16, 0
            print("watchdog: outputs off", flush=True)
        self.valve = min(1.0, max(0.0, self.valve + (seconds if self.coils[0] else -seconds)))
        self.level += 60 * self.valve * seconds - 50 * seconds * self.flows()
        self.level = min(FULL, max(0.0, self.level))
        gain = 2.5 * self.heater / UNITS if self.coils[3] and self.level > 0 else 0
        self.celsius += (gain - (self.celsius - 20) / 300) * seconds

    def flows(self):
        return self.coils[2] and self.level > 0 and not self.hands["filter"]

    def inputs(self):
        on = self.hands
        return [
            not on["notaus"], on["start"], not on["stop"], on["quit"], not on["pumpe"], not on["ruehrer"], self.valve == 1, self.valve == 0,
            bool(self.flows()), self.level > 5, self.level > 950, not on["deckel"], on["hand"], False, False, False,
        ]

    def analog(self):
        return [int(self.level / FULL * UNITS), int(min(self.celsius, HOT) / HOT * UNITS)]

    def seen(self):
        lamps = ["Zulaufventil", "Rührwerk", "Pumpe", "Heizung frei", "Störung", "Hupe", "Betrieb"]
        return {"level": self.level, "celsius": self.celsius, "heater": 100 * self.heater / UNITS,
                "lamps": list(zip(lamps, self.coils)), "hands": self.hands}

    def answer(self, code, data):
        """The answer to a request without its unit; an exception is a number."""
        if len(data) < 4:
            return 3
        first, value = struct.unpack(">HH", data[:4])
        if code in (1, 2):
            bits = self.coils if code == 1 else self.inputs()
            if first + value > len(bits):
                return 2
            size = (value + 7) // 8
            return bytes([code, size]) + sum(1 << n for n, bit in enumerate(bits[first:first + value]) if bit).to_bytes(size, "little")
        if code in (3, 4):
            words = [self.heater] if code == 3 else self.analog()
            if first + value > len(words):
                return 2
            return bytes([code, 2 * value]) + struct.pack(">%dh" % value, *words[first:first + value])
        if code == 15 and first + value <= 16 and len(data) >= 5 + (value + 7) // 8:
            bits = int.from_bytes(data[5:], "little")
            for n in range(value):
                self.coils[first + n] = bool(bits >> n & 1)
        elif code == 16 and (first, value) == (0, 1) and len(data) >= 7:
            self.heater = max(0, struct.unpack(">h", data[5:7])[0])
        elif code == 5 and first < 16:
            self.coils[first] = value != 0
        elif code == 6 and first == 0:
            self.heater = max(0, struct.unpack(">h", data[2:4])[0])
        elif code == 6 and first == 0x1000:
            self.time = value / 10
        elif code == 6 and first == 0x1008:
            self.watchdog = False
        elif code == 6 and first == 0x100A:
            self.watchdog = value == 1
        else:
            return 2 if code in (5, 6, 15, 16) else 1
        return bytes([code]) + data[:4]


PLANT = Plant()


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
            with PLANT.lock:
                PLANT.heard = time.monotonic()
                answer = PLANT.answer(request[0], request[1:])
            if isinstance(answer, int):
                answer = bytes([request[0] | 0x80, answer])
            self.wfile.write(struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer)


PAGE = """<!doctype html><html lang="de"><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>Maischbottich</title>
<style>body{font:16px system-ui;margin:16px;max-width:720px}button{font:inherit;padding:8px 12px;margin:4px}button.on{background:#c33;color:#fff}
svg{width:240px;height:260px}li{display:inline-block;margin:4px 12px 4px 0}li.on{font-weight:700}li.on::before{content:"● "}li::before{content:"○ "}</style>
<h1>Maischbottich</h1><svg viewBox="0 0 240 260"><rect x="20" y="10" width="200" height="220" fill="none" stroke="#555" stroke-width="4"/>
<rect id="fill" x="22" width="196" fill="#d9a441"/></svg><p id="values"></p><ul id="lamps"></ul><p id="hands"></p>
<script>
const hands = %s;
for (const [name, [text, push]] of Object.entries(hands)) {
  const button = document.createElement("button");
  button.id = name; button.textContent = text;
  const put = (on) => fetch("hand", { method: "POST", body: JSON.stringify([name, on]) });
  if (push) { button.onpointerdown = () => put(true); button.onpointerup = button.onpointerleave = () => put(false); }
  else button.onclick = () => put(!button.classList.contains("on"));
  document.getElementById("hands").append(button);
}
setInterval(async () => {
  const now = await (await fetch("now")).json();
  const height = 216 * now.level / 1000, fill = document.getElementById("fill");
  fill.setAttribute("y", 228 - height); fill.setAttribute("height", height);
  document.getElementById("values").textContent = `${now.level.toFixed(0)} l, ${now.celsius.toFixed(1)} °C, Heizung ${now.heater.toFixed(0)} %%`;
  document.getElementById("lamps").innerHTML = now.lamps.map(([text, on]) => `<li class="${on ? "on" : ""}">${text}</li>`).join("");
  for (const [name, on] of Object.entries(now.hands)) document.getElementById(name).classList.toggle("on", on);
}, 200);
</script></html>"""


class Page(http.server.BaseHTTPRequestHandler):
    def reply(self, kind, text):
        self.send_response(200)
        self.send_header("content-type", kind + "; charset=utf-8")
        self.end_headers()
        self.wfile.write(text.encode())

    def do_GET(self):
        if self.path == "/now":
            with PLANT.lock:
                self.reply("application/json", json.dumps(PLANT.seen()))
        else:
            self.reply("text/html", PAGE % json.dumps(HANDS))

    def do_POST(self):
        name, on = json.loads(self.rfile.read(int(self.headers.get("content-length", 0))))
        with PLANT.lock:
            if name in PLANT.hands:
                PLANT.hands[name] = bool(on)
        self.reply("application/json", "{}")

    def log_message(self, *_):
        pass


class Server(socketserver.ThreadingTCPServer):
    allow_reuse_address, daemon_threads = True, True


def main():
    ports = [int(text) for text in sys.argv[1:3]] + [1503, 8091][len(sys.argv[1:3]):]
    threading.Thread(target=PLANT.work, daemon=True).start()
    with Server(("127.0.0.1", ports[0]), Connection) as coupler, Server(("127.0.0.1", ports[1]), Page) as page:
        threading.Thread(target=page.serve_forever, daemon=True).start()
        print("the coupler listens on port %d; look at http://127.0.0.1:%d/" % tuple(ports), flush=True)
        coupler.serve_forever()


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        pass
