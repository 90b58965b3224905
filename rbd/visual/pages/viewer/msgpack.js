// Messages of Meshcat's protocol are msgpack: here all of it but its extensions.
const text = new TextDecoder();

// What some bytes say.
export function unpacked(data) {
  const view = new DataView(data.buffer, data.byteOffset, data.byteLength);
  let at = 0;
  const skip = (length) => (at += length) - length;
  const count = (size) => view[`getUint${8 * size}`](skip(size));
  const bytes = (length) => data.subarray(skip(length), at);
  const string = (length) => text.decode(bytes(length));
  const array = (length) => Array.from({ length }, next);
  const map = (length) => Object.fromEntries(Array.from({ length }, () => [next(), next()]));
  // By the first byte; sizes of lengths are in bytes.
  const kinds = {
    0xc0: () => null, 0xc2: () => false, 0xc3: () => true,
    0xc4: () => bytes(count(1)), 0xc5: () => bytes(count(2)), 0xc6: () => bytes(count(4)),
    0xca: () => view.getFloat32(skip(4)), 0xcb: () => view.getFloat64(skip(8)),
    0xcc: () => count(1), 0xcd: () => count(2), 0xce: () => count(4), 0xcf: () => Number(view.getBigUint64(skip(8))),
    0xd0: () => view.getInt8(skip(1)), 0xd1: () => view.getInt16(skip(2)), 0xd2: () => view.getInt32(skip(4)),
    0xd3: () => Number(view.getBigInt64(skip(8))),
    0xd9: () => string(count(1)), 0xda: () => string(count(2)), 0xdb: () => string(count(4)),
    0xdc: () => array(count(2)), 0xdd: () => array(count(4)), 0xde: () => map(count(2)), 0xdf: () => map(count(4)),
  };
  function next() {
    const kind = count(1);
    if (kind < 0x80) return kind;
    if (kind < 0x90) return map(kind & 15);
    if (kind < 0xa0) return array(kind & 15);
    if (kind < 0xc0) return string(kind & 31);
    if (kind >= 0xe0) return kind - 256;
    if (!(kind in kinds)) throw new Error(`A message has the byte 0x${kind.toString(16)}, which is no msgpack that this page reads.`);
    return kinds[kind]();
  }
  return next();
}
