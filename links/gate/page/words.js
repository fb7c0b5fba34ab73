// The words of the page: English and German, each once.
const words = {
  en: {
    skip: "To the content", station: "Station", scan: "Scan", diagnostics: "Diagnostics", variables: "Variables",
    program: "Program", telegrams: "Telegrams", reports: "Soak reports", telegramsHelp: "Telegrams on the lines of the CPs, decoded by their protocol; newest first. `ob1 trace` records them.", way: "Way", sent: "sent", received: "received", noTaps: "This link may not show telegrams, or there is no CP.", language: "Deutsch", login: "Log in", logout: "Log out",
    user: "Name", password: "Password", cancel: "Cancel", ok: "OK", noConnection: "no connection, trying again",
    loginWanted: "Log in to this station.", running: "The station runs.", starting: "The station starts up.",
    held: "Held at a breakpoint",
    stopped: "The station is in STOP.", stoppedBy: "Cause of the STOP:", lastStop: "Cause of the last STOP:",
    orderly: "STOP was commanded.", noStop: "It has not been in STOP since it was started.", place: "Place",
    remedy: "Remedy", because: "Held up by", since: "Since", mode: "Operating state", run: "RUN", stop: "STOP",
    warm: "Warm restart", cold: "Cold restart", hot: "Hot restart", reset: "Memory reset",
    confirmTitle: "Change the operating state?", confirm: "The machine may move. The station {1} gets the command {0}.",
    mayNot: "Your right only allows reading: {0}.", modules: "Rack", present: "answers", absent: "does not answer",
    driver: "driver", starts: "starts", restarted: "restarted", figures: "Figures", scans: "Scans", late: "Late scans",
    overruns: "Overruns", missed: "Missed deadlines", watchdogs: "Watchdog", stands: "no cycle ends", uptime: "Runs for", memory: "Memory",
    threads: "threads", links: "Links", up: "up", down: "down", execution: "Execution", cycle: "Cycle",
    wake: "Wake-up after the deadline", upTo: "up to", count: "count", median: "median", greatest: "maximum",
    cause: "Cause", delay: "Delay", what: "What", nothingLate: "No scan was late.", newest: "The newest late scans",
    cps: "Buffers of the CPs", noEntries: "There are no entries.", gone: "gone", names: "Names, one a line",
    namesHelp: "M1.0, MW10, DB10.DBW0, DB10.Motor.Speed, a symbol; :hex :bin :anzw :status choose a form.",
    watch: "Watch", period: "every", save: "Save as", load: "Load", remove: "Delete", table: "Table", name: "Name",
    type: "Type", value: "Value", write: "Write", newValue: "New value for {0}", written: "{0} is written (scan {1}).",
    noTables: "no saved table", blocks: "Blocks", data: "Data blocks", symbols: "Symbols", find: "Uses of",
    findHelp: "operand or symbol", statements: "statements", network: "network", line: "line", address: "Address",
    toTable: "Watch its variables", instance: "instance of", noReports: "There are no reports.", verdict: "Verdict", budget: "Budget", measured: "Measured",
    unused: "No statement uses it by its address.", perhaps: "What may reach it: the address is known at run time only.", printed: "without a source: printed from its statements",
    more: "and more", event: "Event", serious: "What the operating system granted", copied: "Loaded.",
    stack: "Where it was", calledBy: "called by", localData: "Local data",
    loading: "…", closed: "Choose a block.",
  },
  de: {
    skip: "Zum Inhalt", station: "Station", scan: "Zyklus", diagnostics: "Diagnose", variables: "Variablen",
    program: "Programm", telegrams: "Telegramme", reports: "Dauerläufe", telegramsHelp: "Telegramme auf den Leitungen der CPs, nach ihrem Protokoll entschlüsselt; das neueste zuerst. `ob1 trace` zeichnet sie auf.", way: "Richtung", sent: "gesendet", received: "empfangen", noTaps: "Diese Kopplung darf keine Telegramme zeigen, oder es gibt keinen CP.", language: "English", login: "Anmelden", logout: "Abmelden",
    user: "Name", password: "Kennwort", cancel: "Abbrechen", ok: "OK", noConnection: "keine Verbindung, neuer Versuch",
    loginWanted: "Melden Sie sich an dieser Station an.", running: "Die Station läuft.", starting: "Die Station läuft an.",
    held: "Hält am Haltepunkt",
    stopped: "Die Station ist in STOP.", stoppedBy: "Ursache des STOP:", lastStop: "Ursache des letzten STOP:",
    orderly: "STOP wurde verlangt.", noStop: "Sie war seit ihrem Start nicht in STOP.", place: "Stelle",
    remedy: "Abhilfe", because: "Aufgehalten durch", since: "Seit", mode: "Betriebszustand", run: "RUN", stop: "STOP",
    warm: "Neustart (Warmstart)", cold: "Kaltstart", hot: "Wiederanlauf", reset: "Urlöschen",
    confirmTitle: "Betriebszustand ändern?", confirm: "Die Maschine kann sich bewegen. Die Station {1} erhält den Befehl {0}.",
    mayNot: "Ihre Rechte erlauben nur das Ansehen: {0}.", modules: "Baugruppen", present: "antwortet",
    absent: "antwortet nicht", driver: "Treiber", starts: "Starts", restarted: "neu gestartet", figures: "Zahlen",
    scans: "Zyklen", late: "Verspätete Zyklen", overruns: "Überläufe", missed: "Versäumte Termine",
    watchdogs: "Zyklusüberwachung", stands: "kein Zyklus endet", uptime: "Läuft seit", memory: "Speicher", threads: "Threads",
    links: "Kopplungen", up: "da", down: "weg", execution: "Bearbeitung", cycle: "Zykluszeit",
    wake: "Aufwachen nach dem Termin", upTo: "bis", count: "Anzahl", median: "Median", greatest: "größte",
    cause: "Ursache", delay: "Verzug", what: "Was", nothingLate: "Kein Zyklus war verspätet.",
    newest: "Die jüngsten verspäteten Zyklen", cps: "Puffer der CPs", noEntries: "Keine Einträge.", gone: "gegangen",
    names: "Namen, je Zeile einer",
    namesHelp: "M1.0, MW10, DB10.DBW0, DB10.Motor.Drehzahl, ein Symbol; :hex :bin :anzw :status wählen eine Form.",
    watch: "Beobachten", period: "alle", save: "Speichern als", load: "Laden", remove: "Löschen", table: "Tabelle",
    name: "Name", type: "Typ", value: "Wert", write: "Steuern", newValue: "Neuer Wert für {0}",
    written: "{0} ist geschrieben (Zyklus {1}).", noTables: "keine gespeicherte Tabelle", blocks: "Bausteine",
    data: "Datenbausteine", symbols: "Symbole", find: "Verwendungen von", findHelp: "Operand oder Symbol",
    statements: "Anweisungen", network: "Netzwerk", line: "Zeile", address: "Adresse",
    toTable: "Variablen beobachten", instance: "Instanz von", noReports: "Keine Berichte.", verdict: "Urteil", budget: "Grenze", measured: "Gemessen",
    unused: "Keine Anweisung verwendet es mit seiner Adresse.", perhaps: "Was es erreichen kann: Die Adresse steht erst zur Laufzeit fest.", printed: "ohne Quelle: aus den Anweisungen gedruckt",
    more: "und weitere", event: "Ereignis", serious: "Zusagen des Betriebssystems", copied: "Geladen.", loading: "…",
    stack: "Wo es war", calledBy: "aufgerufen von", localData: "Lokaldaten",
    closed: "Wählen Sie einen Baustein.",
  },
};

// What a CP waits for or what has failed: its text comes in English, so only the German words are here.
const reasons = {
  no_driver: "sein Treiber läuft nicht", no_parameters: "wartet auf seine Parameter: die CPU sendet sie beim Übergang nach RUN",
  parameters_refused: "Parameter abgelehnt ({number})", line_gone: "Leitung weg (Fehler {number} des Systems)",
  start_up: "wartet auf FC 9 ({hex}), seit {age} s", interrupted: "Empfangsleitung unterbrochen (BREAK), seit {age} s",
  stopped: "der Partner hält uns an (XOFF), seit {age} s", signals: "CTS oder DSR aus, seit {age} s",
  order_failed: "Aufträge enden mit {hex}: {count} nacheinander, der letzte vor {age} s",
  buffer_full: "Empfangspuffer voll: abgewiesene Telegramme: {count}, das letzte vor {age} s",
  not_fetched: "wartet auf den Empfangsbaustein, seit {age} s: nicht abgeholte Telegramme: {count}",
  receive_error: "Empfangsfehler nacheinander: {count}, der letzte ({hex}) vor {age} s",
  echoes: "die Leitung gibt das Gesendete zurück (lokales Echo abschalten), seit {age} s",
};

export function reason(of) {
  const text = language === "de" ? reasons[of.why] : null;
  const hex = `${of.number.toString(16).toUpperCase().padStart(of.number > 255 ? 4 : 2, "0")}h`;
  const told = { number: of.number, hex, count: of.count, age: of.age_s };
  return text?.replace(/\{(\w+)\}/g, (_, key) => told[key]) ?? of.text;
}

const kept = () => { try { return localStorage.getItem("ob1-language"); } catch { return null; } };
let language = kept() ?? (navigator.language.startsWith("de") ? "de" : "en");

export const current = () => language;

export function switchLanguage() {
  language = language === "de" ? "en" : "de";
  try { localStorage.setItem("ob1-language", language); } catch { /* a browser that keeps nothing */ }
}

export function say(key, ...values) {
  const text = words[language][key] ?? key;
  return values.reduce((told, value, at) => told.replace(`{${at}}`, value), text);
}

export const keys = () => [Object.keys(words.en), Object.keys(words.de)];
