// Names of what is drawn: of the thing under the pointer, and next to every mark while the layer "labels" is on.
const RANK = {
  forces: 0, pushes: 0, "force elements": 0, "loop forces": 0, "pin forces": 0, moments: 0, "joint torques": 0, "corner forces": 1, "centre of mass": 1, frames: 1,
  cones: 2, "support polygon": 3, regions: 3, surfaces: 4, meshes: 5, "collision shapes": 5, "other poses": 6,
};
// What has no tag of its own: it would say again what the others say.
const UNTAGGED = ["meshes", "collision shapes", "other poses", "frames", "cones", "corner forces"];
const OBSTACLES = "#legend, .toolbar .row, .toolbar .panel:not([hidden]), .player, .curves, .controls";
const MOST_TAGS = 40;
const STEPS = 5;  // heights of a tag by which it may be moved from its mark; a line then leads back
// Pixels around the pointer in which a thin mark is found; a finger is thicker.
const REACH = { mouse: 5, touch: 16 };
const TAP_MS = 500;

class Labels {
  constructor(stage, pane) {
    this.stage = stage;
    this.bodies = [];
    this.shapes = [];
    this.caster = new MeshCat.THREE.Raycaster();
    this.tags = make("div", "chrome tags", document.body);
    this.svg = draw("svg", this.tags, {});
    [this.spans, this.lines] = [[], []];
    this.tip = make("div", "chrome tip", document.body);
    this.tip.hidden = true;
    this.tip.setAttribute("role", "status");
    this.watch(pane);
  }

  // Of the robot's parts and collision shapes, in the order in which they were sent.
  name({ bodies, shapes }) {
    [this.bodies, this.shapes] = [bodies, shapes];
  }

  // Everything that can be named: [{object, layer, label}].
  things() {
    const { layers } = this.stage;
    const found = [];
    const add = (object, layer, label) => { if (object && layers.on[layer] !== false) found.push({ object, layer, label }); };
    for (const { path, layer, label } of layers.listed) if (label) add(layers.object(`marks/${path}`), layer, () => label);
    for (const [layer, objects] of layers.members) {
      for (const object of objects) {
        object.traverse((each) => { if (each.userData.label) add(each, layer, each.userData.label); });
      }
    }
    this.bodies.forEach((body, i) => add(layers.object(`robot/${i}`), "meshes", () => bodyLabel(body)));
    this.shapes.forEach((body, i) => add(layers.object(`collision/${i}`), "collision shapes", () => bodyLabel(body)));
    for (const each of this.stage.frames) add(each, "frames", each.userData.label);
    return found;
  }

  // Whether any mark has a label.
  some() {
    const { listed, members } = this.stage.layers;
    if (listed.some(({ label }) => label)) return true;
    let found = false;
    for (const objects of members.values()) {
      for (const object of objects) object.traverse((each) => { found = found || Boolean(each.userData.label); });
    }
    return found;
  }

  // The nearest named thing within `reach` pixels of a point of the window: {label, at}; null where there is none. A mark is
  // found through the robot, as it shines through it; an arrow inside of a cone.
  pick(x, y, reach = REACH.mouse) {
    const things = this.things();
    const bodies = things.filter(({ layer }) => RANK[layer] >= 4), marks = things.filter(({ layer }) => !(RANK[layer] >= 4));
    let hit = this.cast(x, y, marks);
    for (let turn = 0; turn < 8 && !hit; turn++) {
      hit = this.cast(x + reach * Math.cos(turn * Math.PI / 4), y + reach * Math.sin(turn * Math.PI / 4), marks);
    }
    return hit || this.cast(x, y, bodies);
  }

  cast(x, y, things) {
    const [width, height] = this.stage.size();
    const T = MeshCat.THREE;
    this.caster.setFromCamera(new T.Vector2((2 * x) / width - 1, 1 - (2 * y) / height), this.stage.viewer.camera);
    let best = null;
    for (const { object, layer, label } of things) {
      const hits = this.caster.intersectObject(object, true).filter((hit) => seen(hit.object));
      if (!hits.length) continue;
      const told = label();
      if (!told) continue;
      const rank = RANK[layer] ?? 2, { distance, point } = hits[0];
      if (!best || rank < best.rank || (rank === best.rank && distance < best.distance)) {
        best = { rank, distance, label: told, layer, at: [point.x, -point.z, point.y], again: label };
      }
    }
    return best;
  }

  watch(pane) {
    let asked = false;
    const at = (event) => [event.clientX, event.clientY];
    pane.addEventListener("pointermove", (event) => {
      if (event.pointerType === "touch" || asked) return;
      if (event.buttons) { this.clear(); return; }
      asked = true;
      requestAnimationFrame(() => {
        asked = false;
        this.point(...at(event));
      });
    });
    pane.addEventListener("pointerleave", (event) => { if (event.pointerType !== "touch") this.clear(); });
    let down = null;
    pane.addEventListener("pointerdown", (event) => { down = { at: at(event), time: event.timeStamp }; });
    // A tap names a thing; one elsewhere takes the name away.
    pane.addEventListener("pointerup", (event) => {
      const moved = down ? Math.hypot(event.clientX - down.at[0], event.clientY - down.at[1]) : Infinity;
      if (moved < 10 && event.timeStamp - down.time < TAP_MS) {
        this.point(...at(event), event.pointerType === "touch" ? REACH.touch : REACH.mouse);
      }
    });
  }

  // Names what is at a point of the window.
  point(x, y, reach) {
    this.found = this.pick(x, y, reach);
    if (!this.found) {
      this.clear();
      return;
    }
    this.where = [x, y];
    this.tell();
  }

  clear() {
    this.found = null;
    this.tip.hidden = true;
    this.stage.pane.style.cursor = "";
  }

  tell() {
    const label = this.found.again();
    if (!label) {
      this.clear();
      return;
    }
    this.tip.replaceChildren(make("b", "", null, label.title), ...label.lines.map((line) => make("div", "", null, line)));
    this.tip.hidden = false;
    this.stage.pane.style.cursor = "help";
    const [width, height] = this.stage.size();
    const [x, y] = this.where, w = this.tip.offsetWidth, h = this.tip.offsetHeight;
    this.tip.style.left = `${Math.max(4, x + 16 + w > width ? x - w - 12 : x + 16)}px`;
    this.tip.style.top = `${Math.max(4, y + 16 + h > height ? y - h - 12 : y + 16)}px`;
  }

  // After each picture: tags next to what they name; none covers another while there is room.
  place() {
    if (this.found && !this.tip.hidden && this.stage.player) this.tell();
    const on = this.stage.layers.on.labels === true;
    this.tags.hidden = !on;
    if (!on) return;
    const named = new Map();
    for (const { object, layer, label } of this.things()) {
      if (UNTAGGED.includes(layer) || !seen(object)) continue;
      const told = label();
      if (!told || !told.at || !told.at.every(Number.isFinite)) continue;
      // Several marks may say the same: arrow and patch, ball and drop line. The highest one has the tag.
      const key = told.lines.join();
      if (!named.has(key) || named.get(key).at[2] < told.at[2]) named.set(key, { ...told, rank: layer === "joint torques" ? 9 : RANK[layer] ?? 2 });
    }
    const list = [...named.values()].sort((a, b) => a.rank - b.rank).slice(0, MOST_TAGS);
    while (this.spans.length < list.length) {
      this.spans.push(make("span", "", this.tags));
      this.lines.push(draw("line", this.svg, {}));
    }
    while (this.spans.length > list.length) {
      this.spans.pop().remove();
      this.lines.pop().remove();
    }
    const taken = [...document.querySelectorAll(OBSTACLES)].map((node) => edgesOf(node.getBoundingClientRect()));
    list.forEach((label, i) => this.tag(this.spans[i], this.lines[i], label, taken));
  }

  // A tag has no place where all are taken: it is left out rather than laid over another.
  tag(span, line, { title, lines, at }, taken) {
    const text = lines.length ? `${title}: ${lines[0]}` : title;
    if (span.textContent !== text) span.textContent = text;
    const spot = this.stage.project(at);
    const [width, height] = this.stage.size();
    span.hidden = false;
    line.setAttribute("visibility", "hidden");
    if (!spot || spot[0] < 0 || spot[1] < 0 || spot[0] > width || spot[1] > height) {
      span.hidden = true;
      return;
    }
    const w = span.offsetWidth, h = span.offsetHeight;
    const [x, y] = spot;
    let placed = null;
    for (let step = 0; step < STEPS && !placed; step++) {
      for (const up of step ? [-1, 1] : [1]) {
        for (const left of [x + 10, x - w - 10]) {
          const top = y - h / 2 + up * step * (h + 2);
          const rect = [left, top, left + w, top + h];
          const inside = left >= 2 && top >= 2 && rect[2] <= width - 2 && rect[3] <= height - 2;
          if (inside && !placed && !taken.some((other) => overlap(rect, other))) placed = rect;
        }
      }
    }
    span.hidden = !placed;
    if (!placed) return;
    taken.push(placed);
    const end = placed[0] > x ? placed[0] : placed[2], middle = (placed[1] + placed[3]) / 2;
    for (const [name, value] of [["x1", x], ["y1", y], ["x2", end], ["y2", middle]]) line.setAttribute(name, value.toFixed(1));
    line.setAttribute("visibility", "visible");
    span.style.transform = `translate(${placed[0].toFixed(1)}px, ${placed[1].toFixed(1)}px)`;
  }
}

const edgesOf = ({ left, top, right, bottom }) => [left, top, right, bottom];
const overlap = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];

// Whether an object and all above it are visible.
function seen(object) {
  for (let each = object; each; each = each.parent) if (!each.visible) return false;
  return true;
}
