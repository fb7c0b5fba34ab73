"""Reads a trace by Perfetto's own messages and holds it against the rules that Perfetto documents: one sequence whose
incremental state is cleared before it is needed, tracks described before their events, interned names known, one clock,
times in order, slices balanced. Prints what each track holds, as JSON.

    pftrace.py FILE.pftrace
"""

import json
import os
import sys

# Its protobuf is newer than that of the other partners.
sys.path.insert(0, os.environ.get("OB1_SNAP7_NATIVE", ""))

from perfetto.protos.perfetto.trace import perfetto_trace_pb2 as perfetto

CLEARED, NEEDS = 1, 2
MONOTONIC = 3


def refuse(condition, what):
    if condition:
        raise SystemExit(f"pftrace.py: {what}")


def unknown(message):
    """Fields that Perfetto does not know, in this message and all in it."""
    from google.protobuf.unknown_fields import UnknownFieldSet

    if len(UnknownFieldSet(message)):
        return True
    for field, value in message.ListFields():
        if field.type == field.TYPE_MESSAGE:
            many = field.is_repeated if hasattr(field, "is_repeated") else field.label == field.LABEL_REPEATED
            if any(unknown(one) for one in (value if many else [value])):
                return True
    return False


def read(path):
    with open(path, "rb") as file:
        return judge(file.read())


def judge(octets):
    trace = perfetto.Trace()
    trace.ParseFromString(octets)
    refuse(unknown(trace), "fields that Perfetto does not know")
    tracks, names, notes = {}, {}, {}
    sequences, clocks, last, cleared = set(), {}, 0, False
    for number, packet in enumerate(trace.packet):
        where = f"packet {number}"
        refuse(not packet.trusted_packet_sequence_id, f"{where}: no sequence")
        sequences.add(packet.trusted_packet_sequence_id)
        if packet.sequence_flags & CLEARED:
            names, notes, cleared = {}, {}, True
            refuse(packet.trace_packet_defaults.timestamp_clock_id != MONOTONIC, f"{where}: another clock")
        refuse(packet.sequence_flags & NEEDS and not cleared, f"{where}: needs what was never sent")
        if packet.HasField("clock_snapshot"):
            clocks = {clock.clock_id: clock.timestamp for clock in packet.clock_snapshot.clocks}
            refuse(packet.clock_snapshot.primary_trace_clock != MONOTONIC, f"{where}: another primary clock")
        for new, known in [
            (packet.interned_data.event_names, names),
            (packet.interned_data.debug_annotation_names, notes),
        ]:
            for name in new:
                refuse(not name.iid or name.iid in known or name.name in known.values(), f"{where}: {name} again")
                known[name.iid] = name.name
        if packet.HasField("track_descriptor"):
            track = packet.track_descriptor
            refuse(not track.uuid or track.uuid in tracks, f"{where}: the track {track.uuid} again")
            refuse(track.parent_uuid and track.parent_uuid not in tracks, f"{where}: a track without its parent")
            way = [*tracks[track.parent_uuid]["path"], track.name] if track.parent_uuid else []
            tracks[track.uuid] = {"path": way, "counter": track.HasField("counter"), "open": [], "process": None,
                                  "slices": [], "instants": [], "values": []}
            if track.HasField("process"):
                tracks[track.uuid]["process"] = [track.process.pid, track.process.process_name]
        if packet.HasField("track_event"):
            event, time = packet.track_event, packet.timestamp
            refuse(time < last, f"{where}: {time} after {last}")
            last = time
            refuse(event.track_uuid not in tracks, f"{where}: a track that nobody has described")
            track = tracks[event.track_uuid]
            refuse(event.name_iid and event.name_iid not in names, f"{where}: the name {event.name_iid} was never sent")
            told = {}
            for note in event.debug_annotations:
                refuse(note.name_iid not in notes, f"{where}: the name {note.name_iid} was never sent")
                kind = note.WhichOneof("value")
                told[notes[note.name_iid]] = getattr(note, kind)
            kind = perfetto.TrackEvent.Type.Name(event.type)
            refuse((kind == "TYPE_COUNTER") != track["counter"], f"{where}: {kind} on {track['path']}")
            if kind == "TYPE_COUNTER":
                track["values"].append([time, getattr(event, event.WhichOneof("counter_value_field"))])
            elif kind == "TYPE_INSTANT":
                track["instants"].append([time, names[event.name_iid], told])
            elif kind == "TYPE_SLICE_BEGIN":
                track["open"].append([time, names[event.name_iid], told])
            else:
                refuse(kind != "TYPE_SLICE_END" or not track["open"], f"{where}: {kind} without a beginning")
                begin, name, told = track["open"].pop()
                track["slices"].append([begin, time - begin, name, told])
    for track in tracks.values():
        refuse(track.pop("open"), f"{track['path']}: a slice without an end")
    refuse(len(sequences) != 1, f"sequences: {sequences}")
    refuse(set(clocks) != {1, 3, 6}, f"clocks: {clocks}")
    return {"packets": len(trace.packet), "clocks": clocks,
            "tracks": {" / ".join(track["path"]): track for track in tracks.values()}}


def example():
    """A counter, a slice and an instant, as the rules want them."""
    trace = perfetto.Trace()

    def packet(flags=NEEDS):
        new = trace.packet.add()
        new.trusted_packet_sequence_id, new.sequence_flags = 1, flags
        return new

    first = packet(CLEARED)
    first.trace_packet_defaults.timestamp_clock_id = MONOTONIC
    first.clock_snapshot.primary_trace_clock = MONOTONIC
    for clock in (1, 3, 6):
        first.clock_snapshot.clocks.add(clock_id=clock, timestamp=10)
    for uuid, parent, name in [(1, 0, "station"), (2, 1, "scan"), (3, 1, "level")]:
        track = packet().track_descriptor
        track.uuid, track.name = uuid, name
        if parent:
            track.parent_uuid = parent
        if name == "level":
            track.counter.SetInParent()
    kinds = perfetto.TrackEvent.Type
    for time, uuid, kind in [(11, 2, "SLICE_BEGIN"), (12, 3, "COUNTER"), (13, 2, "INSTANT"), (14, 2, "SLICE_END")]:
        new = packet()
        new.timestamp = time
        new.track_event.track_uuid, new.track_event.type = uuid, kinds.Value(f"TYPE_{kind}")
        if kind == "COUNTER":
            new.track_event.counter_value = 7
        elif kind != "SLICE_END":
            if time == 11:
                new.interned_data.event_names.add(iid=1, name="OB 1")
            new.track_event.name_iid = 1
    return trace


def selftest():
    held = judge(example().SerializeToString())["tracks"]
    assert held["scan"]["slices"] == [[11, 3, "OB 1", {}]], held
    assert held["scan"]["instants"] == [[13, "OB 1", {}]] and held["level"]["values"] == [[12, 7]], held

    def clock(trace):
        trace.packet[0].clock_snapshot.primary_trace_clock = 1

    def parent(trace):
        trace.packet[2].track_descriptor.parent_uuid = 9

    def order(trace):
        trace.packet[5].timestamp = 10

    def name(trace):
        trace.packet[4].ClearField("interned_data")

    def counter(trace):
        trace.packet[5].track_event.track_uuid = 2

    def sequence(trace):
        trace.packet[6].trusted_packet_sequence_id = 2

    def end(trace):
        del trace.packet[-1]

    for broken in (clock, parent, order, name, counter, sequence, end):
        trace = example()
        broken(trace)
        try:
            judge(trace.SerializeToString())
        except SystemExit:
            continue
        raise AssertionError(f"not found: {broken.__name__}")
    print("pftrace.py: self-test passed")


if __name__ == "__main__" and sys.argv[1:] == ["--selftest"]:
    selftest()
elif __name__ == "__main__":
    json.dump(read(sys.argv[1]), sys.stdout)
