// Marks as primitives, by points in W [m] and sizes: see primitives.py. A picture at rest is told in them; a motion is made of them.

// Sizes of an arrow [m]: its head is six radii long, less on arrows too short for that.
function arrowSizes(length, radius) {
  const head = Math.min(6 * radius, 0.5 * length);
  const wide = 2.6 * radius * Math.min(1, head / (6 * radius) + 0.25);
  return { head, wide, thin: Math.min(radius, 0.6 * wide) };
}

const cylinder = (radius, length, sides = 10) =>
  new MeshCat.THREE.CylinderGeometry(radius, radius, length, sides).rotateX(Math.PI / 2).translate(0, 0, length / 2);
const cone = (radius, length) =>
  new MeshCat.THREE.ConeGeometry(radius, length, 24).rotateX(Math.PI / 2).translate(0, 0, length / 2);
const knee = (radius, at) => new MeshCat.THREE.SphereGeometry(radius, 10, 6).translate(...at);
const distance = (a, b) => Math.hypot(...a.map((x, i) => b[i] - x));

// Puts a geometry's origin at a point, with z towards another one.
function along(geometry, from, to) {
  const T = MeshCat.THREE;
  const way = new T.Vector3(...to).sub(new T.Vector3(...from)).normalize();
  const turn = new T.Quaternion().setFromUnitVectors(new T.Vector3(0, 0, 1), way);
  return geometry.applyMatrix4(new T.Matrix4().compose(new T.Vector3(...from), turn, new T.Vector3(1, 1, 1)));
}

// Triangles with normals of their own; `corners` are numbers of points.
function facets(points, corners) {
  const T = MeshCat.THREE;
  const made = new T.BufferGeometry(), positions = new Float32Array(points.flat());
  made.setAttribute("position", new T.BufferAttribute(positions, 3));
  made.setAttribute("normal", new T.BufferAttribute(normals(positions, corners), 3));
  made.setIndex(corners);
  return made;
}

const PRIMITIVES = {
  arrow({ points: [from, to], radius, heads }) {
    const length = distance(from, to), { head, wide, thin } = arrowSizes(length, radius);
    const pieces = [cylinder(thin, length - head, 24)];
    for (let i = 0; i < heads; i++) pieces.push(cone(wide, head).translate(0, 0, length - head * (1 + 0.8 * i)));
    return pieces.map((piece) => along(piece, from, to));
  },

  ball({ points, radius }) {
    return points.map((at) => new MeshCat.THREE.SphereGeometry(radius, 24, 16).translate(...at));
  },

  line({ points, radius, closed }) {
    const ends = closed ? [...points, points[0]] : points;
    const pieces = [knee(radius, ends[0])];
    for (let i = 1; i < ends.length; i++) {
      const length = distance(ends[i - 1], ends[i]);
      if (length) pieces.push(along(cylinder(radius, length), ends[i - 1], ends[i]), knee(radius, ends[i]));
    }
    return pieces;
  },

  polygon({ points }) {
    return [facets(points, points.slice(2).flatMap((_, i) => [0, i + 1, i + 2]))];
  },

  fan({ points: [apex, ...rim] }) {
    const corners = rim.flatMap((p, i) => [apex, rim[(i + 1) % rim.length], p]);
    return [facets(corners, corners.map((_, i) => i))];
  },

  // From the first point around the axis by an angle; the head at its end is bent along.
  arc({ points: [centre, first], axis, angle, radius, heads }) {
    const T = MeshCat.THREE;
    const out = new T.Vector3(...first).sub(new T.Vector3(...centre)), far = out.length(), size = Math.abs(angle);
    const head = heads ? Math.min((6 * radius) / far, 0.6 * size) : 0;  // the angle that a head takes
    const thin = heads ? Math.min(radius, 0.4 * far * head) : radius;
    const steps = Math.max(2, Math.ceil((size - head) / 0.12));
    const at = (turn) => [far * Math.cos(turn), far * Math.sin(turn), 0];
    const pieces = [new T.TorusGeometry(far, thin, 10, steps, size - head)];
    if (heads) pieces.push(knee(thin, at(0)));
    for (let i = 0; i < heads; i++) {
      const foot = at(size - head * (1 + 0.8 * i)), tip = at(size - 0.8 * head * i);
      pieces.push(along(cone(2.6 * thin, distance(foot, tip)), foot, tip));
    }
    const z = new T.Vector3(...axis).multiplyScalar(Math.sign(angle)), x = out.normalize();
    const place = new T.Matrix4().makeBasis(x, z.clone().cross(x), z).setPosition(...centre);
    return pieces.map((piece) => piece.applyMatrix4(place));
  },
};

// The triangles of some primitives as one geometry.
function solid(primitives) {
  const T = MeshCat.THREE;
  const pieces = primitives.flatMap((each) => PRIMITIVES[each.kind](each)), made = new T.BufferGeometry();
  const index = [];
  let first = 0;
  for (const { attributes, index: own } of pieces) {
    for (const corner of own.array || own) index.push(first + corner);
    first += attributes.position.count;
  }
  for (const name of ["position", "normal"]) {
    const whole = new Float32Array(3 * first);
    let at = 0;
    for (const { attributes } of pieces) {
      whole.set(attributes[name].array, at);
      at += attributes[name].array.length;
    }
    made.setAttribute(name, new T.BufferAttribute(whole, 3));
  }
  made.setIndex(index);
  return made;
}
