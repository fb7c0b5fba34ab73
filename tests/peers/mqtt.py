#!/usr/bin/env python3
"""An MQTT client and a Sparkplug B decoder that are not ours: paho and mqtt-spb-wrapper (Eclipse Tahu's protocol).

    mqtt.py HOST PORT TOPIC

subscribes with a session that the broker keeps and says each message, one JSON object a line:
{"topic", "payload", "retain"}; a payload of Sparkplug B is decoded:
{"seq", "metrics": [{"name", "alias", "type", "value", "time", "historical"}]}. It connects again when the broker is
gone. What standard input says, one JSON object a line, is published: {"topic", "payload" [, "retain"]}, or
{"topic", "metrics": [{"name", "type", "value"}]}.
"""

import json
import sys
import threading


def decoded(payload):
    from mqtt_spb_wrapper.spb_protobuf import sparkplug_b_pb2

    message = sparkplug_b_pb2.Payload()
    message.ParseFromString(payload)
    metrics = []
    for metric in message.metrics:
        field = metric.WhichOneof("value")
        value = None if metric.is_null or field is None else getattr(metric, field)
        width = {1: 8, 2: 16, 3: 32}.get(metric.datatype)
        if width and isinstance(value, int):
            # Tahu's Python fills a negative number's own width, its Java 32 bits.
            value &= (1 << width) - 1
            if value >= 1 << (width - 1):
                value -= 1 << width
        if isinstance(value, bytes):
            value = value.hex()
        metrics.append(
            {
                "name": metric.name,
                "alias": metric.alias,
                "type": metric.datatype,
                "value": value,
                "time": metric.timestamp,
                "historical": metric.is_historical,
            }
        )
    return {"seq": message.seq if message.HasField("seq") else None, "metrics": metrics}


def encoded(metrics):
    from mqtt_spb_wrapper.spb_protobuf import sparkplug_b_pb2

    message = sparkplug_b_pb2.Payload(timestamp=1)
    for wanted in metrics:
        metric = message.metrics.add(name=wanted["name"], timestamp=1, datatype=wanted["type"])
        value = wanted["value"]
        if isinstance(value, bool):
            metric.boolean_value = value
        elif isinstance(value, float):
            metric.float_value = value
        elif isinstance(value, str):
            metric.string_value = value
        elif wanted["type"] == 13:
            metric.long_value = value
        else:
            metric.int_value = value & 0xFFFFFFFF
    return message.SerializeToString()


def said(message):
    payload = message.payload
    try:
        payload = decoded(payload) if message.topic.startswith("spBv1.0/") else json.loads(payload)
    except ValueError:
        payload = {"raw": payload.hex()}
    return {"topic": message.topic, "payload": payload, "retain": bool(message.retain)}


def main():
    if "--selftest" in sys.argv:
        selftest()
        return
    import paho.mqtt.client as mqtt

    host, port, topic = sys.argv[1], int(sys.argv[2]), sys.argv[3]
    say = lambda what: print(json.dumps(what), flush=True)
    client = mqtt.Client(client_id="ob1-tests-%s" % topic.replace("/", "-"), clean_session=False)
    client.reconnect_delay_set(min_delay=1, max_delay=1)
    client.on_connect = lambda client, data, flags, code: client.subscribe(topic, qos=1)
    client.on_subscribe = lambda *_: say({"subscribed": True})
    client.on_message = lambda client, data, message: say(said(message))

    def publish():
        for line in sys.stdin:
            what = json.loads(line)
            payload = encoded(what["metrics"]) if "metrics" in what else json.dumps(what["payload"])
            client.publish(what["topic"], payload, qos=1, retain=what.get("retain", False))
        client.disconnect()

    client.connect(host, port, keepalive=5)
    threading.Thread(target=publish, daemon=True).start()
    client.loop_forever(retry_first_connection=True)


def selftest():
    metrics = [{"name": "a", "type": 2, "value": -2}, {"name": "b", "type": 11, "value": True}]
    again = decoded(encoded(metrics))
    assert [(one["name"], one["type"], one["value"]) for one in again["metrics"]] == [("a", 2, -2), ("b", 11, True)]
    assert again["seq"] is None
    print("mqtt.py: self-test passed")


main()
