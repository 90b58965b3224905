// Triangles as Python packs them (packed_meshes.py), and the objects made of them.

// Unpacks the viewer and the page's pieces, and builds the scene; where that fails, the page says why.
async function unpackPage([library, ...sizes], build) {
  const packed = (name) => document.getElementById(name).textContent;
  try {
    const [[viewer], pieces] = await Promise.all([inflated(packed("library"), [library]), inflated(packed("pieces"), sizes)]);
    // As an element it is allowed by a policy that forbids eval.
    document.head.append(make("script", "", null, new TextDecoder().decode(viewer)));
    build(new Stage(document.getElementById("meshcat-pane"), document.getElementById("legend"), pieces));
  } catch (error) {
    document.body.dataset.failed = `This picture could not be drawn. ${error.message}`;
    make("p", "failed", document.body, document.body.dataset.failed);
    throw error;
  }
}

// The pieces of a block that Python deflated: bytes, one array a piece.
async function inflated(base64, lengths) {
  if (typeof DecompressionStream === "undefined") {
    throw new Error(`${OLD_BROWSER} It cannot unpack data (no DecompressionStream).`);
  }
  const stream = new Blob([bytes(base64)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const whole = await new Response(stream).arrayBuffer();
  let at = 0;
  return lengths.map((length) => new Uint8Array(whole, (at += length) - length, length));
}

function bytes(base64) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(base64);
  const text = atob(base64);
  const out = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) out[i] = text.charCodeAt(i);
  return out;
}

function floats(base64) {
  return new Float32Array(bytes(base64).buffer);
}

// The first byte of a message of ours; Meshcat's never begin with it.
const OURS = 0xc1;

class Meshes {
  constructor(viewer, pieces) {
    this.viewer = viewer;
    this.pieces = pieces;
    // A mark's ghost goes with it.
    const remove = viewer.delete_path.bind(viewer);
    viewer.delete_path = (path) => {
      remove(path);
      if (path[1] === "marks" && path.length > 2) remove([...path.slice(0, -1), `${path[path.length - 1]}_seen_through`]);
    };
    this.made = new Map();  // piece and box -> geometry: equal triangles are unpacked once
  }

  // A message of a live scene: Meshcat's, or our byte, the length of a header, the header, triangles.
  receive(data) {
    if (data[0] !== OURS) return this.viewer.handle_command_bytearray(data);
    const length = new DataView(data.buffer, data.byteOffset).getUint32(1, true);
    const header = JSON.parse(new TextDecoder().decode(data.subarray(5, 5 + length)));
    this.put(header, header.primitives ? solid(header.primitives) : geometry(header, data.subarray(5 + length)));
  }

  // An object of this page: its header, and the number of its triangles' piece.
  place(header, number) {
    if (header.primitives) return this.put(header, solid(header.primitives));
    const key = [number, ...header.low, ...header.side].join();
    if (!this.made.has(key)) this.made.set(key, geometry(header, this.pieces[number]));
    this.put(header, this.made.get(key));
  }

  // Parts cast and take shadows; marks do not, and may shine faintly through what hides them.
  put(header, triangles) {
    const T = MeshCat.THREE;
    const path = header.path.split("/").filter((name) => name);
    const { color, opacity } = header;
    const glass = { opacity, transparent: opacity < 1 };
    const add = (ending, material, shadows) => {
      const object = new T.Mesh(triangles, material);
      object.castShadow = object.receiveShadow = shadows;
      this.viewer.set_object([...path.slice(0, -1), path[path.length - 1] + ending], object);
    };
    if (header.kind === "part") {
      // Inner parts of glass must be drawn, in any order.
      const shine = { specular: 0x222222, shininess: 20, side: T.DoubleSide, depthWrite: opacity >= 0.5 };
      const { nearer } = header;
      const offset = nearer ? { polygonOffset: true, polygonOffsetFactor: -nearer, polygonOffsetUnits: -nearer } : {};
      const made = new T.MeshPhongMaterial({ ...glass, ...shine, ...offset, color });
      add("", path.includes("marks") ? theme.material(made, color, 0, true) : made, true);
    } else {
      const lambert = (more) => theme.material(new T.MeshLambertMaterial({ ...glass, side: T.DoubleSide, ...more }), color, 0.15);
      add("", lambert({ depthWrite: opacity === 1 }), false);
      const ghost = { opacity: 0.6 * opacity, transparent: true, depthTest: false, depthWrite: false };
      if (header.through) add("_seen_through", lambert(ghost), false);
    }
    this.viewer.set_dirty();
  }
}

// Coordinates are differences of 65535ths of the box, low bytes before high bytes, even for up and odd for down; corners are
// how far below the next new vertex they lie, in three planes of bytes.
function geometry({ vertices, faces, low, side }, data) {
  const T = MeshCat.THREE;
  const positions = new Float32Array(3 * vertices);
  for (let axis = 0; axis < 3; axis++) {
    const from = 2 * axis * vertices, step = side[axis] / 65535;
    for (let i = 0, at = 0; i < vertices; i++) {
      const code = data[from + i] | (data[from + vertices + i] << 8);
      at = (at + ((code >> 1) ^ -(code & 1))) & 65535;
      positions[3 * i + axis] = low[axis] + at * step;
    }
  }
  const corners = new (vertices > 65535 ? Uint32Array : Uint16Array)(3 * faces);
  const from = 6 * vertices, plane = 3 * faces;
  for (let k = 0, next = 0; k < plane; k++) {
    const below = data[from + k] | (data[from + plane + k] << 8) | (data[from + 2 * plane + k] << 16);
    corners[k] = next - below;
    if (!below) next++;
  }
  const made = new T.BufferGeometry();
  made.setAttribute("position", new T.BufferAttribute(positions, 3));
  made.setAttribute("normal", new T.BufferAttribute(normals(positions, corners), 3));
  made.setIndex(new T.BufferAttribute(corners, 1));
  return made;
}

// Normals of vertices: the sum over their triangles, by area.
function normals(p, corners) {
  const out = new Float32Array(p.length);
  for (let k = 0; k < corners.length; k += 3) {
    const a = 3 * corners[k], b = 3 * corners[k + 1], c = 3 * corners[k + 2];
    const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
    const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    out[a] += x; out[a + 1] += y; out[a + 2] += z;
    out[b] += x; out[b + 1] += y; out[b + 2] += z;
    out[c] += x; out[c + 1] += y; out[c + 2] += z;
  }
  for (let i = 0; i < out.length; i += 3) {
    const length = Math.hypot(out[i], out[i + 1], out[i + 2]) || 1;
    out[i] /= length; out[i + 1] /= length; out[i + 2] /= length;
  }
  return out;
}
