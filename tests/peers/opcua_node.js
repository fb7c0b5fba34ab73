#!/usr/bin/env node
// A second OPC UA client that is not ours: node-opcua.
//
//     opcua_node.js URL [USER PASSWORD [POLICY]]
//
// does what standard input says, one JSON object a line; each answer is one line: {"ok": true, ...} or {"ok": false,
// "error": "BadNodeIdUnknown"}. What it can do is a part of opcua.py, and means the same:
//
//     read ids | write id type value | children id | find path | call id | watch ids every | changes count
//
// Its certificate lies in the folder it runs in.

// What libraries have to say is no answer.
console.log = console.error;
const opcua = require("node-opcua-client");
const { OPCUACertificateManager } = require("node-opcua-certificate-manager");
const path = require("path");
const readline = require("readline");
const [url, userName, password, policy] = process.argv.slice(2);
const say = (answer) => process.stdout.write(JSON.stringify(answer) + "\n");
const PATIENCE = 60000;

const node = (text) => (text === "Objects" ? "ns=0;i=85" : opcua.makeNodeId(text, 2));

function plain(value) {
  if (value === null || value === undefined || typeof value !== "object") return value;
  if (value instanceof Date) return value.toISOString().replace("Z", "");
  if (Buffer.isBuffer(value)) return value.toString("hex");
  return Array.from(value, plain);
}

/** Throws the name of a status that is bad. */
function checked(status) {
  if (!status.isGood()) throw new Error(status.name);
}

class Peer {
  constructor(session) {
    this.session = session;
    this.heard = [];
    this.waiting = [];
  }

  async read({ ids }) {
    const wanted = ids.map((id) => ({ nodeId: node(id), attributeId: opcua.AttributeIds.Value }));
    const values = await this.session.read(wanted);
    return {
      values: values.map((one) => (one.statusCode.isGood() ? plain(one.value.value) : one.statusCode.name)),
      types: values.map((one) => (one.statusCode.isGood() ? opcua.DataType[one.value.dataType] : null)),
    };
  }

  async write({ id, type, value }) {
    const dataType = opcua.DataType[type];
    const typed = dataType === opcua.DataType.DateTime ? new Date(`${value}Z`) : value;
    const arrayType = Array.isArray(value) ? opcua.VariantArrayType.Array : opcua.VariantArrayType.Scalar;
    const variant = { dataType, arrayType, value: typed };
    checked(await this.session.write({ nodeId: node(id), attributeId: opcua.AttributeIds.Value, value: { value: variant } }));
    return {};
  }

  async children({ id }) {
    let result = await this.session.browse({ nodeId: node(id), referenceTypeId: "HierarchicalReferences", includeSubtypes: true,
      browseDirection: opcua.BrowseDirection.Forward, resultMask: 63 });
    checked(result.statusCode);
    const all = [...result.references];
    while (result.continuationPoint?.length) {
      result = await this.session.browseNext(result.continuationPoint, false);
      checked(result.statusCode);
      all.push(...result.references);
    }
    return { names: all.map((one) => one.browseName.name), ids: all.map((one) => one.nodeId.value) };
  }

  async find({ path: names }) {
    const browsePath = opcua.makeBrowsePath("ns=0;i=85", names.map((name) => `/2:${name}`).join(""));
    const result = await this.session.translateBrowsePath(browsePath);
    checked(result.statusCode);
    return { id: result.targets[0].targetId.value };
  }

  async call({ id }) {
    checked((await this.session.call({ objectId: node("/"), methodId: node(id), inputArguments: [] })).statusCode);
    return {};
  }

  async watch({ ids, every }) {
    const subscription = await this.session.createSubscription2({ requestedPublishingInterval: every, requestedLifetimeCount: 300,
      requestedMaxKeepAliveCount: 10, maxNotificationsPerPublish: 0, publishingEnabled: true, priority: 0 });
    for (const id of ids) {
      const item = await subscription.monitor({ nodeId: node(id), attributeId: opcua.AttributeIds.Value },
        { samplingInterval: every, queueSize: 100, discardOldest: true }, opcua.TimestampsToReturn.Both);
      if (item.statusCode) checked(item.statusCode);
      item.on("changed", (told) => this.hear([id, told.statusCode.isGood() ? plain(told.value.value) : told.statusCode.name]));
    }
    return {};
  }

  hear(change) {
    const taker = this.waiting.shift();
    if (taker) taker(change);
    else this.heard.push(change);
  }

  async changes({ count }) {
    const all = [];
    while (all.length < count) {
      all.push(this.heard.length ? this.heard.shift() : await new Promise((resolve) => this.waiting.push(resolve)));
    }
    return { changes: all };
  }
}

function within(promise) {
  let timer;
  const late = new Promise((_, reject) => { timer = setTimeout(() => reject(new Error("nothing came")), PATIENCE); });
  return Promise.race([promise, late]).finally(() => clearTimeout(timer));
}

/** What the server says, by its name where it has one. */
const told = (error) => /Bad[A-Z]\w+/.exec(String(error?.message ?? error))?.[0] ?? String(error?.message ?? error);

async function main() {
  const certificates = new OPCUACertificateManager({ rootFolder: path.join(process.cwd(), "node-opcua"), automaticallyAcceptUnknownCertificate: true });
  await certificates.initialize();
  const client = opcua.OPCUAClient.create({
    applicationName: "tests", clientCertificateManager: certificates, endpointMustExist: false,
    securityMode: policy ? opcua.MessageSecurityMode.SignAndEncrypt : opcua.MessageSecurityMode.None,
    securityPolicy: policy ? opcua.SecurityPolicy[policy] : opcua.SecurityPolicy.None,
    connectionStrategy: { maxRetry: 0 }, requestedSessionTimeout: PATIENCE,
  });
  let session;
  try {
    await within(client.connect(url));
    const user = userName ? { type: opcua.UserTokenType.UserName, userName, password } : undefined;
    session = await within(client.createSession(user));
  } catch (error) {
    say({ ok: false, error: told(error) });
    process.exit(0);
  }
  say({ ok: true });
  const peer = new Peer(session);
  for await (const line of readline.createInterface({ input: process.stdin })) {
    const ask = JSON.parse(line);
    try {
      say({ ok: true, ...(await within(peer[ask.op](ask))) });
    } catch (error) {
      say({ ok: false, error: told(error) });
    }
  }
  const end = setTimeout(() => process.exit(0), 5000);
  await session.close(true).catch(() => {});
  await client.disconnect().catch(() => {});
  clearTimeout(end);
  process.exit(0);
}

main();
