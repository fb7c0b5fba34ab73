// The words of the page: English and German, side by side.
import { german, patterns } from "./german.js";

const words = {
  skip: ["To the content", "Zum Inhalt"], station: ["Station", "Station"], scan: ["Scan", "Zyklus"],
  io: ["I/O", "E/A"], diagnostics: ["Diagnostics", "Diagnose"], variables: ["Variables", "Variablen"],
  program: ["Program", "Programm"], telegrams: ["Telegrams", "Telegramme"], reports: ["Soak reports", "Dauerläufe"],
  language: ["Deutsch", "English"], login: ["Log in", "Anmelden"], logout: ["Log out", "Abmelden"], menu: ["Menu", "Menü"],
  pages: ["Pages", "Seiten"], user: ["Name", "Name"], password: ["Password", "Kennwort"], cancel: ["Cancel", "Abbrechen"],
  close: ["Close", "Schließen"], back: ["Back", "Zurück"], again: ["Try again", "Erneut versuchen"],
  noConnection: ["No connection, trying again", "Keine Verbindung, neuer Versuch"],
  tooLate: ["No answer within {0} s", "Keine Antwort innerhalb von {0} s"],
  asOf: ["No connection: as of {0}, trying again", "Keine Verbindung: Stand von {0}, neuer Versuch"],
  loading: ["Loading …", "Lädt …"], loginWanted: ["Log in to this station.", "Melden Sie sich an dieser Station an."],

  alarms: ["Alarms", "Meldungen"], noAlarms: ["No alarm is active or waits for its acknowledgement.", "Keine Meldung steht an oder wartet auf ihre Quittierung."],
  bell: ["{0} alarms, {1} not acknowledged", "{0} Meldungen, {1} nicht quittiert"],
  alarmState: ["State", "Zustand"], alarmCame: ["Came", "Gekommen"], alarmSince: ["Since", "Seit"], alarmClass: ["Class", "Klasse"],
  alarmAck: ["Acknowledgement", "Quittierung"], alarmActive: ["active", "steht an"], alarmGone: ["gone", "gegangen"],
  alarmDone: ["not needed", "nicht nötig"], alarmOpen: ["open", "offen"], alarmLocked: ["locked: not sent to displays", "gesperrt: wird nicht gemeldet"],
  acknowledge: ["Acknowledge", "Quittieren"], acknowledgeAll: ["Acknowledge all", "Alle quittieren"],

  running: ["The station runs.", "Die Station läuft."], starting: ["The station starts up.", "Die Station läuft an."],
  held: ["The station holds at a breakpoint.", "Die Station hält am Haltepunkt."],
  stopped: ["The station is in STOP.", "Die Station ist in STOP."], stoppedBy: ["Cause of the STOP:", "Ursache des STOP:"],
  lastStop: ["Last STOP:", "Letzter STOP:"], orderly: ["STOP was commanded.", "STOP wurde verlangt."],
  noStop: ["It has not been in STOP since it was started.", "Sie war seit ihrem Start nicht in STOP."],
  sinceThen: ["since {0}", "seit {0}"], place: ["Place", "Stelle"], remedy: ["Remedy", "Abhilfe"],
  because: ["Held up by", "Aufgehalten durch"], stack: ["Where it was", "Wo es war"], calledBy: ["called by", "aufgerufen von"],
  localData: ["Local data", "Lokaldaten"], mode: ["Operating state", "Betriebszustand"],

  run: ["RUN", "RUN"], stop: ["STOP", "STOP"], warm: ["Warm restart", "Neustart (Warmstart)"], cold: ["Cold restart", "Kaltstart"],
  hot: ["Hot restart", "Wiederanlauf"], reset: ["Memory reset", "Urlöschen"],
  ask_run: ["Start the station {0}?", "Station {0} starten?"], ask_stop: ["Stop the station {0}?", "Station {0} anhalten?"],
  ask_warm: ["Warm restart of {0}?", "Neustart (Warmstart) von {0}?"], ask_cold: ["Cold restart of {0}?", "Kaltstart von {0}?"],
  ask_hot: ["Hot restart of {0}?", "Wiederanlauf von {0}?"], ask_reset: ["Memory reset of {0}?", "{0} urlöschen?"],
  tell_run: ["The machine may move: the program runs and drives the outputs. From STOP it starts warm.",
    "Die Maschine kann sich bewegen: Das Programm läuft und steuert die Ausgänge. Aus STOP heraus ist es ein Warmstart."],
  tell_stop: ["The machine stops: the program ends its cycle, all outputs are switched off. What hangs, falls or coasts may move.",
    "Die Maschine hält an: Das Programm beendet seinen Zyklus, alle Ausgänge werden abgeschaltet. Was hängt, fallen oder nachlaufen kann, kann sich bewegen."],
  tell_warm: ["The machine may move: OB 100 runs, then the program. Data blocks keep their values; bit memory, timers and counters only where they are retentive.",
    "Die Maschine kann sich bewegen: OB 100 läuft, danach das Programm. Datenbausteine behalten ihre Werte; Merker, Zeiten und Zähler nur, wo sie remanent sind."],
  tell_cold: ["The machine may move: OB 102 (or OB 100) runs, then the program. All values begin anew, retentive ones too; data blocks with those of the program.",
    "Die Maschine kann sich bewegen: OB 102 (oder OB 100) läuft, danach das Programm. Alle Werte beginnen neu, auch die remanenten; Datenbausteine mit denen des Programms."],
  tell_hot: ["The machine may move: OB 101 runs, then the program goes on where it was interrupted. All values stay.",
    "Die Maschine kann sich bewegen: OB 101 läuft, danach geht das Programm an der Unterbrechungsstelle weiter. Alle Werte bleiben."],
  tell_reset: ["All values are lost:", "Alle Werte gehen verloren:"],
  lose: ["bit memory, timers and counters, retentive ones too|all values of data blocks: they begin with those of the program|what the program has created with SFC 22",
    "Merker, Zeiten und Zähler, auch remanente|alle Werte der Datenbausteine: sie beginnen mit denen des Programms|was das Programm mit SFC 22 angelegt hat"],
  mayNot: ["Your rights allow looking only ({0}).", "Ihre Rechte erlauben nur das Ansehen ({0})."],

  modules: ["Modules", "Baugruppen"], present: ["answers", "antwortet"], absent: ["does not answer", "antwortet nicht"],
  driver: ["driver", "Treiber"], restarted: ["restarted", "neu gestartet"], figures: ["Figures", "Zahlen"],
  scans: ["Cycles", "Zyklen"], late: ["Late cycles", "Verspätete Zyklen"], overruns: ["Overruns", "Überläufe"],
  missed: ["Missed deadlines", "Versäumte Termine"], watchdogs: ["Cycle monitoring expired", "Zyklusüberwachung abgelaufen"],
  stands: ["no cycle ends", "kein Zyklus endet"], uptime: ["Runtime", "Laufzeit"], memory: ["Memory", "Speicher"],
  threads: ["threads", "Threads"], links: ["Links", "Kopplungen"], up: ["up", "da"], down: ["down", "weg"],
  forced: ["forced", "geforct"], forcedAll: ["Forced", "Geforct"], cpErrors: ["CPs with an error", "CPs mit Fehler"], none: ["none", "keine"],
  cycleNow: ["Cycle: typical", "Zykluszeit: typisch"], cycleMax: ["Longest cycle", "Größte Zykluszeit"],
  execution: ["Execution", "Bearbeitungszeit"], cycle: ["From cycle to cycle", "Zyklusabstand"],
  wake: ["Wake-up after the deadline", "Aufwachen nach dem Termin"], upTo: ["up to", "bis"], count: ["count", "Anzahl"],
  median: ["median", "Median"], greatest: ["longest", "größte"], cause: ["Cause", "Ursache"], delay: ["Delay", "Verzug"],
  what: ["What", "Was"], nothingLate: ["No cycle was late.", "Kein Zyklus war verspätet."],
  newest: ["The newest late cycles", "Die jüngsten verspäteten Zyklen"],
  history: ["The last ten minutes, as long as this page is open", "Die letzten zehn Minuten, solange diese Seite offen ist"],
  historyText: ["Execution time each second: the line is the median, the marks are the 99 % value; now {0}, greatest {1}.",
    "Bearbeitungszeit jede Sekunde: die Linie ist der Median, die Striche der 99-%-Wert; jetzt {0}, größte {1}."],
  seriesText: ["Execution time from interval to interval ({0}): the line is the median, the marks are the 99 % value; greatest {1}.",
    "Bearbeitungszeit von Abschnitt zu Abschnitt ({0}): die Linie ist der Median, die Striche der 99-%-Wert; größte {1}."],
  what_sched: ["What the operating system granted", "Zusagen des Betriebssystems"],

  noEntries: ["There are no entries.", "Keine Einträge."], gone: ["gone", "gegangen"], csv: ["Download as CSV", "Als CSV laden"],
  number: ["Number", "Nummer"], event: ["Event", "Ereignis"], time: ["Time", "Zeit"], text: ["Text", "Text"],

  names: ["Names, one a line", "Namen, je Zeile einer"],
  namesHelp: ["M1.0, MW10, DB10.DBW0, DB10.Motor.Speed, a symbol; :hex :bin :anzw :status choose a form; // begins a comment.",
    "M1.0, MW10, DB10.DBW0, DB10.Motor.Drehzahl, ein Symbol; :hex :bin :anzw :status wählen eine Form; // beginnt einen Kommentar."],
  watch: ["Watch", "Beobachten"], period: ["every", "alle"], save: ["Save as", "Speichern als"], load: ["Load", "Laden"],
  remove: ["Delete", "Löschen"], table: ["Table", "Tabelle"], name: ["Name", "Name"], type: ["Type", "Typ"], value: ["Value", "Wert"],
  write: ["Write", "Steuern"], writeName: ["Write {0}", "{0} steuern"], newValue: ["New value", "Neuer Wert"],
  presentValue: ["Present value", "Aktueller Wert"], allowedForm: ["Allowed", "Erlaubt"],
  written: ["{0} is written (cycle {1}).", "{0} ist geschrieben (Zyklus {1})."],
  noTables: ["no saved table", "keine gespeicherte Tabelle"], comment: ["Comment", "Kommentar"],
  tableKept: ["Kept with the station, for everybody: {0}", "In der Station gespeichert, für alle: {0}"],
  askRemove: ["Delete the table {0} for everybody?", "Tabelle {0} für alle löschen?"],
  add: ["Add", "Hinzufügen"], addHelp: ["name of a variable", "Name einer Variablen"],
  trend: ["Trend", "Verlauf"], trendOf: ["{0}: {1} to {2}", "{0}: {1} bis {2}"], trendShow: ["Show the trend of {0}", "Verlauf von {0} zeigen"],
  recording: ["Recording", "Aufzeichnung"],
  recordingFile: ["Open a recording of signals (.ob1trace, .csv); it is not sent anywhere", "Aufzeichnung von Signalen öffnen (.ob1trace, .csv); sie wird nirgends hingeschickt"],
  noRecording: ["This is no recording of signals.", "Das ist keine Aufzeichnung von Signalen."],
  recordCut: ["The file is cut off; what is whole is shown.", "Die Datei ist abgeschnitten; gezeigt wird, was ganz ist."],
  recordDamaged: ["The file is damaged at byte {0}; what comes before is shown.", "Die Datei ist ab Byte {0} beschädigt; gezeigt wird, was davor liegt."],
  recorded: ["{0}: {1} rows, {2} lost", "{0}: {1} Zeilen, {2} verloren"],
  recordSignals: ["Signals, up to {0}", "Signale, bis zu {0}"], record_from: ["From", "Von"], record_to: ["To", "Bis"],
  recordPart: ["trigger: {0}", "Auslöser: {0}"], recordLate: ["late cycle {0}: {1}", "verspäteter Zyklus {0}: {1}"],
  recordMore: ["and {0} more", "und {0} weitere"],
  form_BOOL: ["TRUE or FALSE", "TRUE oder FALSE"], form_BYTE: ["0 to 255, 16#0 to 16#FF", "0 bis 255, 16#0 bis 16#FF"],
  form_WORD: ["0 to 65535, 16#0 to 16#FFFF", "0 bis 65535, 16#0 bis 16#FFFF"],
  form_DWORD: ["0 to 4294967295, 16#0 to 16#FFFF_FFFF", "0 bis 4294967295, 16#0 bis 16#FFFF_FFFF"],
  form_INT: ["-32768 to 32767", "-32768 bis 32767"], form_DINT: ["-2147483648 to 2147483647", "-2147483648 bis 2147483647"],
  form_REAL: ["a number with a point: 1.5, 2e-3", "eine Zahl mit Punkt: 1.5, 2e-3"],
  form_TIME: ["T#1d2h3m4s5ms", "T#1d2h3m4s5ms"], form_S5TIME: ["S5T#1h2m3s, up to 2h46m30s", "S5T#1h2m3s, bis 2h46m30s"],
  form_DATE: ["D#2026-11-29", "D#2026-11-29"], form_TIME_OF_DAY: ["TOD#19:31:02.125", "TOD#19:31:02.125"],
  form_DATE_AND_TIME: ["DT#2026-11-29-19:31:02.125", "DT#2026-11-29-19:31:02.125"], form_CHAR: ["one character: 'A'", "ein Zeichen: 'A'"],
  form_STRING: ["a text in quotes: 'lemonade'", "ein Text in Hochkommas: 'Limonade'"],
  form_other: ["as ob1 set takes it", "wie ob1 set es nimmt"],

  blocks: ["Blocks", "Bausteine"], data: ["Data blocks", "Datenbausteine"], symbols: ["Symbols", "Symbole"],
  find: ["Uses of", "Verwendungen von"], findHelp: ["operand or symbol", "Operand oder Symbol"], search: ["Find", "Suchen"],
  filter: ["Filter", "Filter"], statements: ["statements", "Anweisungen"], network: ["Network", "Netzwerk"], line: ["line", "Zeile"],
  address: ["Address", "Adresse"], toTable: ["Watch its variables", "Variablen beobachten"], instance: ["instance of", "Instanz von"],
  instances: ["Instance", "Instanz"], anyInstance: ["any instance", "jede Instanz"], access: ["Access", "Zugriff"], via: ["Through", "Über"],
  unused: ["No statement uses it by its address.", "Keine Anweisung verwendet es mit seiner Adresse."],
  perhaps: ["What may reach it: the address is known at run time only.", "Was es erreichen kann: Die Adresse steht erst zur Laufzeit fest."],
  printed: ["without a source: printed from its statements", "ohne Quelle: aus den Anweisungen gedruckt"],
  more: ["and more", "und weitere"], closed: ["Choose a block.", "Wählen Sie einen Baustein."], view: ["View", "Ansicht"],
  registers: ["RLO STA ACCU1", "VKE STA AKKU1"], stl: ["STL", "AWL"], lad: ["LAD", "KOP"], fbd: ["FBD", "FUP"], live: ["Live", "Beobachten ein/aus"],
  print: ["Print", "Drucken"], emptyNetwork: ["empty", "leer"], asStatements: ["as statements: {0}", "als Anweisungen: {0}"],
  power: ["has power", "führt Strom"], noPower: ["has none", "führt keinen"], notRun: ["did not run, or not known", "nicht gelaufen oder nicht bekannt"],
  live_whole: ["Live: OB {0}{1}", "Live: OB {0}{1}"], live_stopped: ["The CPU went to STOP in this pass.", "Die CPU ging in diesem Durchlauf in STOP."],
  live_not_called: ["The block is not called.", "Der Baustein wird nicht aufgerufen."],
  live_too_long: ["Not watched: [cpu] test_load does not allow it.", "Nicht beobachtet: [cpu] test_load erlaubt es nicht."],
  live_full: ["Two others watch the program already.", "Zwei andere beobachten das Programm bereits."],
  live_changed: ["The block has been changed: open it again.", "Der Baustein wurde geändert: öffnen Sie ihn neu."],
  live_trouble: ["No values.", "Keine Werte."], networkSilent: ["not run in this pass", "in diesem Durchlauf nicht gelaufen"],

  whyOff: ["Why is {0} off?", "Warum ist {0} aus?"], whyOn: ["Why is {0} on?", "Warum ist {0} ein?"], whyAsk: ["Why? {0}", "Warum? {0}"],
  whyBlock: ["Is {0} called?", "Wird {0} aufgerufen?"],
  why_by: ["Its value comes from", "Den Wert gab"], why_left: ["Left as it was by", "Unverändert gelassen von"],
  why_led: ["Not reached: led away by", "Nicht erreicht: vorbeigeführt von"],
  why_unreached: ["The statements that write it were not reached.", "Die Anweisungen, die es schreiben, wurden nicht erreicht."],
  why_none: ["No statement writes it by its address.", "Keine Anweisung schreibt es mit seiner Adresse."],
  why_event: ["The CPU calls it when its event comes.", "Die CPU ruft ihn auf, wenn sein Ereignis kommt."],
  why_noCall: ["No statement calls it.", "Keine Anweisung ruft ihn auf."],
  why_input: ["It is an input: the sensor, its cable or the module decides.", "Es ist ein Eingang: Geber, Leitung oder Baugruppe entscheiden."],
  why_stands: ["No program runs: the outputs are in their safe state.", "Es läuft kein Programm: Die Ausgänge sind in ihrem sicheren Zustand."],
  why_notCalled: ["{0} is not called, so nothing writes it:", "{0} wird nicht aufgerufen, also schreibt es nichts:"],
  why_places: ["Written at", "Geschrieben an"], why_decides: ["decides", "entscheidet"],
  why_many: ["More than one of these must change.", "Mehr als eines davon muss sich ändern."],
  why_open: ["Not everything is known: others may decide as well.", "Nicht alles ist bekannt: Auch anderes kann entscheiden."],
  why_inside: ["What {0} does there", "Was {0} dort tut"], why_scans: ["What is asked there", "Was dort abgefragt wird"],
  showBlock: ["Show {0}", "{0} zeigen"],

  inputs: ["Inputs", "Eingänge"], outputs: ["Outputs", "Ausgänge"], noIo: ["No module has inputs or outputs of its own.", "Keine Baugruppe hat eigene Ein- oder Ausgänge."],
  ioHelp: ["Tap a channel to learn why it is on or off.", "Tippen Sie einen Kanal an, um zu erfahren, warum er ein oder aus ist."],

  telegramsHelp: ["Telegrams on the lines of the CPs, decoded by their protocol; newest first. ob1 trace records them.",
    "Telegramme auf den Leitungen der CPs, nach ihrem Protokoll entschlüsselt; das neueste zuerst. ob1 trace zeichnet sie auf."],
  way: ["Way", "Richtung"], sent: ["sent", "gesendet"], received: ["received", "empfangen"], pause: ["Pause", "Anhalten"], goOn: ["Go on", "Weiter"],
  handshake: ["Handshake", "Handshake"], errorsOnly: ["Errors only", "Nur Fehler"], download: ["Download", "Laden"],
  noTaps: ["This link may not show telegrams, or there is no CP.", "Diese Kopplung darf keine Telegramme zeigen, oder es gibt keinen CP."],

  noReports: ["There are no reports.", "Keine Berichte."], verdict: ["Verdict", "Urteil"], budget: ["Budget", "Grenze"], measured: ["Measured", "Gemessen"],
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
  const about = { number: of.number, hex, count: of.count, age: of.age_s };
  return text?.replace(/\{(\w+)\}/g, (_, key) => about[key]) ?? of.text;
}

const kept = () => { try { return localStorage.getItem("ob1-language"); } catch { return null; } };
let language = kept() ?? (navigator.language.startsWith("de") ? "de" : "en");

export const current = () => language;

export function switchLanguage() {
  language = language === "de" ? "en" : "de";
  try { localStorage.setItem("ob1-language", language); } catch { /* a browser that keeps nothing */ }
}

export function say(key, ...values) {
  const text = words[key]?.[language === "de" ? 1 : 0] ?? key;
  return values.reduce((told, value, at) => told.replace(`{${at}}`, value), text);
}

export const has = (key) => key in words;

const phrases = Object.entries(german).sort(([one], [other]) => other.length - one.length);

/** What the station says in English, in the language of the page. */
export function told(text) {
  if (language !== "de" || !text) return text;
  if (german[text]) return german[text];
  for (const [pattern, words] of patterns) {
    if (pattern.test(text)) return text.replace(pattern, (_, ...parts) => words(...parts));
  }
  const found = phrases.find(([english]) => english.length > 8 && text.includes(english));
  return found ? text.replace(found[0], found[1]) : text;
}

/** Each text in both languages, for tests. */
export const all = () => words;
