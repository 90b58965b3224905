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

// Of a track of Cast: its force at the present time; null while there is none.
function trackLabel(track, word) {
  const f = Array.from(track.force), size = Math.hypot(...f);
  if (!(size > 1e-9)) return null;
  const push = track.kind === "push";
  const lines = [push ? `force (x, y, z) ${inThree(f, "N")}` : `force on the robot (x, y, z) ${inThree(f, "N")}`];
  lines.push(`|f| ${fewDigits(size)} N`);
  if (track.normal) {
    const along = f.reduce((sum, x, i) => sum + x * track.normal[i], 0);
    const across = Math.sqrt(Math.max(0, size * size - along * along));
    lines.push(`normal ${fewDigits(along)} N, tangential ${fewDigits(across)} N`);
    if (track.friction && along > 0) {
      lines.push(`friction used ${Math.round((100 * across) / (track.friction * along))} % of mu ${track.friction}`);
    }
  }
  if (word) lines.push(word);
  return { title: track.name, lines, at: track.centre };
}

function comLabel(com) {
  return { title: "centre of mass", lines: [`(x, y, z) ${inThree(com, "m")}`], at: com };
}

function bodyLabel({ link, joint, mass, shape }) {
  const lines = shape ? [shape] : [];
  lines.push(joint ? `moved by ${joint}` : "fixed to the world");
  if (mass) lines.push(`${fewDigits(mass, 5)} kg, with all that this joint moves alone`);
  return { title: link, lines, at: null };
}
