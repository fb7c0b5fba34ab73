#!/usr/bin/env node
// nodes7 as a client: reads and writes what standard input says, one JSON object a line.
//
//     s7_nodes7.js HOST PORT [SLOT]
//
//     {"op": "read", "items": {"name": "DB1,INT0", ...}}          {"ok": true, "values": {...}, "bad": false}
//     {"op": "write", "items": {"DB1,INT0": 5, ...}}              {"ok": true}
//
// Addresses are those of nodes7: DB1,X0.3 DB1,REAL4 DB1,S50.10 MW4 IB3 QB3 PIW0.

const nodes7 = require("nodes7");
const lines = require("readline").createInterface({ input: process.stdin });
const [host, port, slot] = [process.argv[2], Number(process.argv[3]), Number(process.argv[4] || 2)];
const say = (answer) => process.stdout.write(JSON.stringify(answer) + "\n");

const client = new nodes7({ silent: true });
const waiting = [];
let [busy, ended] = [true, false];

function next() {
  if (busy) return;
  if (waiting.length === 0) {
    if (ended) client.dropConnection(() => process.exit(0));
    return;
  }
  busy = true;
  const request = JSON.parse(waiting.shift());
  const done = (answer) => {
    say(answer);
    busy = false;
    next();
  };
  if (request.op === "read") {
    client.setTranslationCB((name) => request.items[name]);
    client.removeItems();
    client.addItems(Object.keys(request.items));
    client.readAllItems((bad, values) => done({ ok: true, bad, values }));
  } else if (request.op === "write") {
    client.setTranslationCB((name) => name);
    const [names, values] = [Object.keys(request.items), Object.values(request.items)];
    const refused = client.writeItems(names, values, (bad) => done({ ok: !bad }));
    if (refused) done({ ok: false, error: "busy" });
  } else {
    done({ ok: false, error: "unknown" });
  }
}

lines.on("line", (line) => {
  waiting.push(line);
  next();
});
lines.on("close", () => {
  ended = true;
  next();
});
client.initiateConnection({ host, port, rack: 0, slot, timeout: 5000 }, (error) => {
  if (error) {
    say({ ok: false, error: String(error) });
    process.exit(1);
  }
  say({ ok: true, connected: "nodes7" });
  busy = false;
  next();
});
