#!/usr/bin/env python3
"""An OPC UA client that is not ours: asyncua.

    opcua.py URL [--user NAME --password WORD] [--policy Basic256Sha256 --pki FOLDER]

does what standard input says, one JSON object a line; each answer is one line: {"ok": true, ...} or {"ok": false,
"error": "BadNodeIdUnknown"}.

    read       ids                     values, types: of each id; a status in place of a value that is bad
    part       id, range               value: a part of it; times: those that come with it, of those in "times" of the
               [times, attribute]      request (Both, Source, Server, Neither), for Value or another attribute
    write      id, type, value         type is a built-in type: Int16, Float, String, ...; a list is an array
    children   id                      names, ids
    pages      id, most                statuses: of the answers, count: of forward references, read so many at a time
    find       path                    id: from Objects along browse names of namespace 2
    paths      id, paths               ids: where paths from one node lead, asked for at once; a status in place of an id
    attributes id                      class, data_type, rank, dimensions, description, writable
    call       id
    history    id
    watch      ids, every, [sampling]  one subscription of these items, sampled as often as it is published if not said
    watch_part id, range               a subscription to a part of a value
    vanish     ids                     accepted: items of a subscription that expires, as its news are never asked for
    flood      ids, count              accepted: how many of so many items are taken; refused: why no more
    changes    count                   the next values that come, [[id, value], ...]
    events                             a subscription to the events of the server
    event                              message, severity: of the next event
    endpoints                          policies, modes, users of each endpoint
"""

import argparse
import asyncio
import datetime
import json
import os
import sys

PATIENCE = 60


def plain(value):
    """As JSON has it."""
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, datetime.datetime):
        return value.replace(tzinfo=None).isoformat(timespec="milliseconds")
    if isinstance(value, bytes):
        return value.hex()
    return value


class Handler:
    def __init__(self):
        self.changes, self.events = asyncio.Queue(), asyncio.Queue()

    def datachange_notification(self, node, value, data):
        self.changes.put_nowait([node.nodeid.Identifier, plain(value)])

    def event_notification(self, event):
        self.events.put_nowait({"message": event.Message.Text, "severity": event.Severity})

    def status_change_notification(self, status):
        pass


class Peer:
    def __init__(self, client):
        self.client, self.handler, self.kept = client, Handler(), []

    def node(self, text):
        from asyncua import ua

        if text == "Objects":
            return self.client.nodes.objects
        return self.client.get_node(ua.NodeId(text, 2))

    async def read(self, ask):
        from asyncua import ua

        nodes = [self.node(text) for text in ask["ids"]]
        results = await self.client.uaclient.read_attributes([node.nodeid for node in nodes], ua.AttributeIds.Value)
        values, types = [], []
        for result in results:
            good = result.StatusCode is None or result.StatusCode.is_good()
            values.append(plain(result.Value.Value) if good else result.StatusCode.name)
            types.append(result.Value.VariantType.name if good and result.Value is not None else None)
        return {"values": values, "types": types}

    async def part(self, ask):
        from asyncua import ua

        item = ua.ReadValueId()
        item.NodeId = self.node(ask["id"]).nodeid
        item.AttributeId = ua.AttributeIds[ask.get("attribute", "Value")]
        item.IndexRange = ask.get("range")
        parameters = ua.ReadParameters()
        parameters.TimestampsToReturn = ua.TimestampsToReturn[ask.get("times", "Both")]
        parameters.NodesToRead = [item]
        result = (await self.client.uaclient.read(parameters))[0]
        times = {"Source": result.SourceTimestamp, "Server": result.ServerTimestamp}
        result.StatusCode.check()
        value = result.Value.Value
        value = getattr(value, "Text", value)
        return {"value": plain(value), "times": [name for name, time in times.items() if time is not None]}

    async def write(self, ask):
        from asyncua import ua

        value, kind = ask["value"], ua.VariantType[ask["type"]]
        if kind == ua.VariantType.DateTime:
            value = datetime.datetime.fromisoformat(value)
        await self.node(ask["id"]).write_value(ua.DataValue(ua.Variant(value, kind)))
        return {}

    async def children(self, ask):
        found = await self.node(ask["id"]).get_children()
        names = [(await node.read_browse_name()).Name for node in found]
        return {"names": names, "ids": [node.nodeid.Identifier for node in found]}

    async def pages(self, ask):
        from asyncua import ua

        wanted = ua.BrowseDescription()
        wanted.NodeId = self.node(ask["id"]).nodeid
        wanted.BrowseDirection = ua.BrowseDirection.Forward
        wanted.ResultMask = 63
        parameters = ua.BrowseParameters()
        parameters.View.Timestamp = ua.get_win_epoch()
        parameters.RequestedMaxReferencesPerNode = ask["most"]
        parameters.NodesToBrowse = [wanted]
        (page,) = await self.client.uaclient.browse(parameters)
        statuses, count = [page.StatusCode.name], len(page.References)
        while page.ContinuationPoint:
            more = ua.BrowseNextParameters()
            more.ReleaseContinuationPoints = False
            more.ContinuationPoints = [page.ContinuationPoint]
            (page,) = await self.client.uaclient.browse_next(more)
            statuses.append(page.StatusCode.name)
            count += len(page.References)
        return {"statuses": statuses, "count": count}

    async def find(self, ask):
        node = await self.client.nodes.objects.get_child(["2:" + name for name in ask["path"]])
        return {"id": node.nodeid.Identifier}

    async def paths(self, ask):
        from asyncua import ua

        wanted = []
        for names in ask["paths"]:
            path = ua.BrowsePath()
            path.StartingNode = self.node(ask["id"]).nodeid
            for name in names:
                element = ua.RelativePathElement()
                element.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HierarchicalReferences)
                element.IsInverse, element.IncludeSubtypes = False, True
                element.TargetName = ua.QualifiedName(name, 2)
                path.RelativePath.Elements.append(element)
            wanted.append(path)
        results = await self.client.uaclient.translate_browsepaths_to_nodeids(wanted)
        told = lambda one: one.Targets[0].TargetId.Identifier if one.Targets else one.StatusCode.name
        return {"ids": [told(one) for one in results]}

    async def attributes(self, ask):
        from asyncua import ua

        node = self.node(ask["id"])
        kind = await node.read_node_class()
        answer = {"class": kind.name, "description": (await node.read_description()).Text}
        if kind == ua.NodeClass.Variable:
            answer["data_type"] = (await node.read_data_type()).Identifier
            answer["rank"] = int(await node.read_value_rank())
            answer["dimensions"] = await node.read_array_dimensions()
            answer["writable"] = ua.AccessLevel.CurrentWrite in await node.get_user_access_level()
        return answer

    async def call(self, ask):
        await self.node("/").call_method(self.node(ask["id"]))
        return {}

    async def history(self, ask):
        await self.node(ask["id"]).read_raw_history(numvalues=1)
        return {}

    async def watch(self, ask):
        subscription = await self.client.create_subscription(ask["every"], self.handler)
        nodes = [self.node(text) for text in ask["ids"]]
        sampling = ask.get("sampling", ask["every"])
        handles = await subscription.subscribe_data_change(nodes, queuesize=100, sampling_interval=sampling)
        self.kept.append(subscription)
        for handle in handles if isinstance(handles, list) else [handles]:
            if not isinstance(handle, int):
                handle.check()
        return {}

    def item(self, text, number, part=None):
        """A request to monitor a value, or a part of it, under the client's number."""
        from asyncua import ua

        item = ua.MonitoredItemCreateRequest()
        item.ItemToMonitor.NodeId = self.node(text).nodeid
        item.ItemToMonitor.AttributeId = ua.AttributeIds.Value
        item.ItemToMonitor.IndexRange = part
        item.MonitoringMode = ua.MonitoringMode.Reporting
        item.RequestedParameters.ClientHandle = number
        item.RequestedParameters.SamplingInterval = 50
        item.RequestedParameters.QueueSize = 1
        return item

    async def watch_part(self, ask):
        subscription = await self.client.create_subscription(100, self.handler)
        self.kept.append(subscription)
        (handle,) = await subscription.create_monitored_items([self.item(ask["id"], 1, ask["range"])])
        if not isinstance(handle, int):
            handle.check()
        return {}

    async def vanish(self, ask):
        from asyncua import ua
        from asyncua.ua.ua_binary import struct_from_binary

        request = ua.CreateSubscriptionRequest()
        request.Parameters.RequestedPublishingInterval = 50
        request.Parameters.RequestedMaxKeepAliveCount = 1
        request.Parameters.RequestedLifetimeCount = 3
        request.Parameters.PublishingEnabled = True
        answer = await self.client.uaclient.protocol.send_request(request)
        made = struct_from_binary(ua.CreateSubscriptionResponse, answer).Parameters
        parameters = ua.CreateMonitoredItemsParameters()
        parameters.SubscriptionId = made.SubscriptionId
        parameters.TimestampsToReturn = ua.TimestampsToReturn.Both
        parameters.ItemsToCreate = [self.item(text, number) for number, text in enumerate(ask["ids"])]
        results = await self.client.uaclient.create_monitored_items(parameters)
        return {"accepted": sum(result.StatusCode.is_good() for result in results)}

    async def flood(self, ask):
        subscription = await self.client.create_subscription(1000, Handler())
        self.kept.append(subscription)
        accepted = 0
        for first in range(0, ask["count"], 1000):
            nodes = [self.node(ask["ids"][i % len(ask["ids"])]) for i in range(first, min(first + 1000, ask["count"]))]
            try:
                handles = await subscription.subscribe_data_change(nodes)
            except Exception as error:  # the whole call is refused
                return {"accepted": accepted, "refused": told(error)}
            accepted += sum(isinstance(handle, int) for handle in handles)
        return {"accepted": accepted, "refused": None}

    async def changes(self, ask):
        return {"changes": [await self.handler.changes.get() for _ in range(ask["count"])]}

    async def events(self, ask):
        from asyncua import ua

        subscription = await self.client.create_subscription(100, self.handler)
        await subscription.subscribe_events(self.client.nodes.server, ua.ObjectIds.BaseEventType)
        self.kept.append(subscription)
        return {}

    async def event(self, ask):
        return await self.handler.events.get()

    async def endpoints(self, ask):
        found = await self.client.get_endpoints()
        return {
            "endpoints": [
                {
                    "policy": one.SecurityPolicyUri.split("#")[1],
                    "mode": one.SecurityMode.name.rstrip("_"),
                    "users": sorted(token.TokenType.name for token in one.UserIdentityTokens),
                }
                for one in found
            ]
        }


def told(error):
    code = getattr(error, "code", None)
    if code is None:
        return "%s: %s" % (type(error).__name__, error)
    from asyncua.ua.status_codes import get_name_and_doc

    return get_name_and_doc(code)[0]


async def secure(client, policy, folder):
    """A certificate of our own, and the server's as it says it."""
    from pathlib import Path

    from asyncua.crypto import security_policies
    from asyncua.crypto.cert_gen import setup_self_signed_certificate
    from cryptography.x509.oid import ExtendedKeyUsageOID

    key, certificate = Path(folder) / "key.pem", Path(folder) / "certificate.der"
    client.application_uri = "urn:ob1:tests:client"
    names = {"commonName": "a client of the tests"}
    uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
    await setup_self_signed_certificate(key, certificate, client.application_uri, "localhost", uses, names)
    chosen = getattr(security_policies, "SecurityPolicy" + policy)
    await client.set_security(chosen, certificate=str(certificate), private_key=str(key))


async def serve(arguments):
    from asyncua import Client

    client = Client(arguments.url, timeout=PATIENCE)
    if arguments.policy:
        await secure(client, arguments.policy, arguments.pki)
    if arguments.user:
        client.set_user(arguments.user)
        client.set_password(arguments.password)
    say = lambda answer: print(json.dumps(answer), flush=True)
    try:
        await client.connect()
    except Exception as error:  # what the server says, whatever it is
        say({"ok": False, "error": told(error)})
        return
    say({"ok": True})
    peer, lines = Peer(client), asyncio.get_running_loop()
    while True:
        line = await lines.run_in_executor(None, sys.stdin.readline)
        if not line:
            break
        ask = json.loads(line)
        try:
            answer = await asyncio.wait_for(getattr(peer, ask["op"])(ask), PATIENCE)
            say({"ok": True, **answer})
        except Exception as error:
            say({"ok": False, "error": told(error)})
    try:
        await asyncio.wait_for(client.disconnect(), 10)
    except Exception:
        pass


def selftest():
    """Against the server asyncua brings."""

    async def run():
        from asyncua import Server

        server = Server()
        await server.init()
        server.set_endpoint("opc.tcp://127.0.0.1:48415/")
        await server.register_namespace("urn:selftest")
        from asyncua import Client, ua

        node = await server.nodes.objects.add_variable(ua.NodeId("MW10", 2), "2:MW10", ua.Variant(7, ua.VariantType.Int16))
        await node.set_writable()
        async with server:
            async with Client("opc.tcp://127.0.0.1:48415/") as client:
                peer = Peer(client)
                assert await peer.read({"ids": ["MW10"]}) == {"values": [7], "types": ["Int16"]}
                await peer.watch({"ids": ["MW10"], "every": 50})
                assert (await peer.changes({"count": 1}))["changes"] == [["MW10", 7]]
                await peer.write({"id": "MW10", "type": "Int16", "value": -1})
                assert (await peer.changes({"count": 1}))["changes"] == [["MW10", -1]]
                values = await peer.read({"ids": ["MW11"]})
                assert values["values"] == ["BadNodeIdUnknown"], values

    asyncio.run(asyncio.wait_for(run(), PATIENCE))
    print("opcua.py: self-test passed")


def main():
    if "--selftest" in sys.argv:
        selftest()
        return
    parser = argparse.ArgumentParser()
    parser.add_argument("url")
    parser.add_argument("--user")
    parser.add_argument("--password", default="")
    parser.add_argument("--policy")
    parser.add_argument("--pki", default=os.getcwd())
    asyncio.run(serve(parser.parse_args()))


main()
