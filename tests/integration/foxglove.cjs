// A recording read with the libraries of Foxglove's own: every channel, by its schema; as JSON.
// NODE_PATH=.../node_modules node foxglove.cjs FILE

const fs = require("fs");
const { McapIndexedReader } = require("@mcap/core");
const { parse } = require("@foxglove/rosmsg");
const { MessageReader } = require("@foxglove/rosmsg-serialization");
const known = require("@foxglove/schemas/jsonschema.js");
const fzstd = require("fzstd");

class File {
  constructor(data) {
    this.data = data;
  }
  async size() {
    return BigInt(this.data.length);
  }
  async read(offset, size) {
    return this.data.subarray(Number(offset), Number(offset + size));
  }
}

const text = (bytes) => new TextDecoder("utf-8", { fatal: true }).decode(bytes);

// Whether a value is what Foxglove, which knows one type for each field, takes it for.
function misfits(schema, value, path) {
  if (value === null || value === undefined) return [];
  switch (schema.type) {
    case "object":
      if (typeof value !== "object" || Array.isArray(value)) return [path];
      return Object.entries(value).flatMap(([key, inner]) => {
        const field = (schema.properties ?? {})[key];
        return field ? misfits(field, inner, `${path}.${key}`) : [`${path}.${key}`];
      });
    case "array":
      if (!Array.isArray(value)) return [path];
      return value.flatMap((inner) => misfits(schema.items, inner, `${path}[]`));
    case "integer":
      return Number.isInteger(value) ? [] : [path];
    case "number":
    case "string":
    case "boolean":
      return typeof value === schema.type ? [] : [path];
    default:
      return [`${path}: ${schema.type}`];
  }
}

// Fields of ours that a schema of Foxglove's does not have, or has with another type.
function strangers(ours, theirs, path) {
  if (theirs.type === "string" && theirs.format?.startsWith("date")) return [];
  if (theirs.oneOf) theirs = { type: "integer" };
  if (ours.type !== theirs.type) return [path];
  if (ours.type === "array") return strangers(ours.items, theirs.items, `${path}[]`);
  return Object.entries(ours.properties ?? {}).flatMap(([key, field]) => {
    const other = (theirs.properties ?? {})[key];
    return other ? strangers(field, other, `${path}.${key}`) : [`${path}.${key}`];
  });
}

function reader(channel, schema) {
  if (channel.messageEncoding === "json" && schema.encoding === "jsonschema") {
    const root = JSON.parse(text(schema.data));
    if (root.type !== "object") throw new Error(`${channel.topic}: no object`);
    const name = schema.name.replace(/^foxglove\./, "");
    const theirs = schema.name === name ? undefined : known[name];
    return {
      read: (data) => JSON.parse(text(data)),
      wrong: (message) => misfits(root, message, schema.name),
      strangers: theirs ? strangers(root, theirs, schema.name) : [],
      shown: theirs !== undefined,
    };
  }
  if (channel.messageEncoding === "ros1" && schema.encoding === "ros1msg") {
    const ros = new MessageReader(parse(text(schema.data)));
    return { read: (data) => ros.readMessage(data), wrong: () => [], strangers: [], shown: false };
  }
  throw new Error(`${channel.topic}: ${channel.messageEncoding} by ${schema.encoding}`);
}

async function main(path) {
  const decompressHandlers = { zstd: (data, size) => fzstd.decompress(data, new Uint8Array(Number(size))) };
  const file = await McapIndexedReader.Initialize({
    readable: new File(fs.readFileSync(path)),
    decompressHandlers,
  });
  const readers = new Map();
  const topics = {};
  for (const [id, channel] of file.channelsById) {
    const schema = file.schemasById.get(channel.schemaId);
    const found = reader(channel, schema);
    readers.set(id, found);
    const { shown, strangers } = found;
    topics[channel.topic] = { schema: schema.name, shown, strangers, messages: 0, wrong: [] };
  }
  for await (const message of file.readMessages()) {
    const found = readers.get(message.channelId);
    const topic = topics[file.channelsById.get(message.channelId).topic];
    const read = found.read(message.data);
    topic.messages += 1;
    topic.last = read;
    topic.wrong = [...new Set([...topic.wrong, ...found.wrong(read)])];
  }
  for (const topic of Object.values(topics)) {
    if (topic.last?.data instanceof Uint8Array) topic.last = { ...topic.last, data: topic.last.data.length };
  }
  const plain = (_, value) => (typeof value === "bigint" ? Number(value) : value);
  process.stdout.write(JSON.stringify({ profile: file.header.profile, topics }, plain));
}

main(process.argv[2]);
