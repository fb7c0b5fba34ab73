// A worker that all tabs of this browser share: they have one stream together.
import { Stream } from "./stream.js";

const stream = new Stream();
/** A tab that says nothing for so long is gone. It says that it is here every five seconds. */
const SILENT = 20000;
const seen = new Map();

addEventListener("connect", (event) => {
  const port = event.ports[0];
  port.onmessage = ({ data }) => {
    // A tab that was taken for gone says again what it wants.
    if (!("wants" in data) && !seen.has(port)) port.postMessage({ name: "again", data: null });
    if (data.wants === null) seen.delete(port);
    else if ("wants" in data || seen.has(port)) seen.set(port, Date.now());
    if ("wants" in data) stream.set(port, data.wants, (told) => port.postMessage(told));
  };
});
setInterval(() => {
  for (const [port, at] of seen) {
    if (Date.now() - at > SILENT) {
      seen.delete(port);
      stream.set(port, null);
    }
  }
}, 5000);
