// What the page says of things that move or were not sent as marks: contacts of a motion, the centre of mass, bodies.
const fewDigits = (x, n = 4) => {
  const rounded = Number(x.toPrecision(n));
  return String(Math.abs(rounded) < 1e-9 ? 0 : rounded);
};
// Three components with the last place of the largest.
const inThree = (v, unit) => {
  const most = Math.max(...v.map(Math.abs), 1e-9);
  const places = Math.max(0, Math.min(4, 3 - Math.floor(Math.log10(most))));
  return `(${v.map((x) => x.toFixed(places).replace(/^-(0(\.0*)?)$/, "$1")).join(", ")}) ${unit}`;
};

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const moved = (point, shift) => point.map((x, i) => x + shift[i]);

// Of a track of Cast: its force at the present time; null while there is none.
function trackLabel({ name, force, normal, mode, centre, layer }, shift) {
  const size = Math.hypot(...force);
  if (!(size > 1e-9)) return null;
  const lines = [`|f| ${fewDigits(size)} N`, `${layer === "pushes" ? "force" : "force on the robot"} ${inThree(force, "N")}`];
  if (normal) {
    const along = dot(force, normal);
    const across = Math.sqrt(Math.max(0, size * size - along * along));
    lines.push(`normal ${fewDigits(along)} N, tangential ${fewDigits(across)} N`);
    if (along > 0) lines.push(`tangential / normal ${(across / along).toFixed(2)}`);
  }
  lines.push(`acts at ${inThree(centre, "m")}`);
  if (mode) lines.push(mode);
  return { title: name, lines, at: moved(centre, shift) };
}

// Of the force at one point of a contact.
function cornerLabel({ name, corners }, i, shift) {
  const [p, f] = corners[i] || [[NaN], [0]];
  const size = Math.hypot(...f);
  if (!(size > 1e-9) || !Number.isFinite(p[0])) return null;
  const lines = [`|f| ${fewDigits(size)} N`, `force on the robot ${inThree([...f], "N")}`, `acts at ${inThree([...p], "m")}`];
  return { title: `${name}: corner ${i + 1}`, lines, at: moved([...p], shift) };
}

function comLabel(com, shift) {
  return { title: "centre of mass", lines: [inThree(com, "m")], at: moved(com, shift) };
}

// Of the moving support polygon, by its corners.
function polygonLabel(outline) {
  if (outline.length < 3) return null;
  let twice = 0;
  outline.forEach((p, i) => {
    const q = outline[(i + 1) % outline.length];
    twice += p[0] * q[1] - p[1] * q[0];
  });
  const at = [0, 1, 2].map((k) => outline.reduce((sum, p) => sum + p[k], 0) / outline.length);
  const lines = [`area ${fewDigits(twice / 2)} m2`, `${outline.length} corners, seen along z; of the loaded contacts with the ground`];
  return { title: "support polygon", lines, at };
}

function bodyLabel({ link, joint, mass, shape }) {
  const lines = shape ? [shape] : [];
  lines.push(joint ? `moved by ${joint}` : "fixed to the world");
  if (mass) lines.push(`${fewDigits(mass, 5)} kg with the links fixed to it`);
  return { title: link, lines, at: null };
}
