// The words of the page: English and German, each once.
const words = {
  en: {
    skip: "To the content", station: "Station", scan: "Scan", diagnostics: "Diagnostics", variables: "Variables",
    program: "Program", telegrams: "Telegrams", reports: "Soak reports", telegramsHelp: "What goes over the lines of the CPs, read by its protocol; newest first. `ob1 trace` records it.", way: "Way", sent: "sent", received: "received", noTaps: "This link may not show telegrams, or there is no CP.", language: "Deutsch", login: "Log in", logout: "Log out",
    user: "Name", password: "Password", cancel: "Cancel", ok: "OK", noConnection: "no connection, trying again",
    loginWanted: "This station asks who you are.", running: "The station runs.", starting: "The station starts up.",
    stopped: "The station is in STOP.", stoppedBy: "It stands because of:", lastStop: "The last STOP came of:",
    orderly: "It was asked to stop.", noStop: "It has not stopped since it was started.", place: "Place",
    remedy: "What helps", because: "In the way stood", since: "Since", mode: "Operating state", run: "RUN", stop: "STOP",
    warm: "Warm restart", cold: "Cold restart", hot: "Hot restart", reset: "Memory reset",
    confirmTitle: "Change the operating state?", confirm: "The machine may move. {0} is meant for the station {1}.",
    mayNot: "Your rights allow looking only: {0}.", modules: "Rack", present: "answers", absent: "does not answer",
    driver: "driver", starts: "starts", lost: "lost", figures: "Figures", scans: "Scans", late: "Late scans",
    overruns: "Overruns", missed: "Missed deadlines", watchdogs: "Watchdog", uptime: "Runs for", memory: "Memory",
    threads: "threads", links: "Links", up: "up", down: "down", execution: "Execution", cycle: "Cycle",
    wake: "Wake-up after the deadline", upTo: "up to", count: "count", median: "median", greatest: "greatest",
    cause: "Cause", delay: "Delay", what: "What", nothingLate: "No scan was late.", newest: "The newest late scans",
    cps: "Buffers of the CPs", noEntries: "There are no entries.", gone: "gone", names: "Names, one a line",
    namesHelp: "M1.0, MW10, DB10.DBW0, DB10.Motor.Speed, a symbol; :hex :bin :anzw :status choose a form.",
    watch: "Watch", period: "every", save: "Save as", load: "Load", remove: "Delete", table: "Table", name: "Name",
    type: "Type", value: "Value", write: "Write", newValue: "New value for {0}", written: "{0} is written (scan {1}).",
    noTables: "no saved table", blocks: "Blocks", data: "Data blocks", symbols: "Symbols", find: "Who uses",
    findHelp: "operand or symbol", statements: "statements", network: "network", line: "line", address: "Address",
    toTable: "Watch its variables", instance: "instance of", noReports: "There are no reports.", verdict: "Verdict", budget: "Budget", measured: "Measured",
    more: "and more", event: "Event", serious: "Posture of the operating system", copied: "Loaded.",
    loading: "…", closed: "Choose a block.",
  },
  de: {
    skip: "Zum Inhalt", station: "Station", scan: "Zyklus", diagnostics: "Diagnose", variables: "Variablen",
    program: "Programm", telegrams: "Telegramme", reports: "Dauerläufe", telegramsHelp: "Was über die Leitungen der CPs geht, nach seinem Protokoll gelesen; das Neueste zuerst. `ob1 trace` zeichnet es auf.", way: "Richtung", sent: "gesendet", received: "empfangen", noTaps: "Diese Kopplung darf keine Telegramme zeigen, oder es gibt keinen CP.", language: "English", login: "Anmelden", logout: "Abmelden",
    user: "Name", password: "Kennwort", cancel: "Abbrechen", ok: "OK", noConnection: "keine Verbindung, neuer Versuch",
    loginWanted: "Diese Station fragt, wer Sie sind.", running: "Die Station läuft.", starting: "Die Station läuft an.",
    stopped: "Die Station ist in STOP.", stoppedBy: "Sie steht wegen:", lastStop: "Der letzte STOP kam von:",
    orderly: "STOP wurde verlangt.", noStop: "Sie war seit ihrem Start nicht in STOP.", place: "Stelle",
    remedy: "Abhilfe", because: "Im Weg stand", since: "Seit", mode: "Betriebszustand", run: "RUN", stop: "STOP",
    warm: "Neustart (Warmstart)", cold: "Kaltstart", hot: "Wiederanlauf", reset: "Urlöschen",
    confirmTitle: "Betriebszustand ändern?", confirm: "Die Maschine kann sich bewegen. {0} gilt der Station {1}.",
    mayNot: "Ihre Rechte erlauben nur das Ansehen: {0}.", modules: "Baugruppen", present: "antwortet",
    absent: "antwortet nicht", driver: "Treiber", starts: "Starts", lost: "verloren", figures: "Zahlen",
    scans: "Zyklen", late: "Verspätete Zyklen", overruns: "Überläufe", missed: "Versäumte Termine",
    watchdogs: "Zyklusüberwachung", uptime: "Läuft seit", memory: "Speicher", threads: "Threads",
    links: "Kopplungen", up: "da", down: "weg", execution: "Bearbeitung", cycle: "Zykluszeit",
    wake: "Aufwachen nach dem Termin", upTo: "bis", count: "Anzahl", median: "Median", greatest: "größte",
    cause: "Ursache", delay: "Verzug", what: "Was", nothingLate: "Kein Zyklus war verspätet.",
    newest: "Die jüngsten verspäteten Zyklen", cps: "Puffer der CPs", noEntries: "Keine Einträge.", gone: "gegangen",
    names: "Namen, je Zeile einer",
    namesHelp: "M1.0, MW10, DB10.DBW0, DB10.Motor.Drehzahl, ein Symbol; :hex :bin :anzw :status wählen eine Form.",
    watch: "Beobachten", period: "alle", save: "Speichern als", load: "Laden", remove: "Löschen", table: "Tabelle",
    name: "Name", type: "Typ", value: "Wert", write: "Steuern", newValue: "Neuer Wert für {0}",
    written: "{0} ist geschrieben (Zyklus {1}).", noTables: "keine gespeicherte Tabelle", blocks: "Bausteine",
    data: "Datenbausteine", symbols: "Symbole", find: "Wer verwendet", findHelp: "Operand oder Symbol",
    statements: "Anweisungen", network: "Netzwerk", line: "Zeile", address: "Adresse",
    toTable: "Variablen beobachten", instance: "Instanz von", noReports: "Keine Berichte.", verdict: "Urteil", budget: "Grenze", measured: "Gemessen",
    more: "und weitere", event: "Ereignis", serious: "Zusagen des Betriebssystems", copied: "Geladen.", loading: "…",
    closed: "Wählen Sie einen Baustein.",
  },
};

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
