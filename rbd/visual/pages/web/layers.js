// The layers of a scene: what is shown and hidden together. Python tells the layer of a mark, see drawing.described; what
// moves (Cast) puts its own objects into a layer by `put`.
class Layers {
  constructor(stage) {
    this.stage = stage;
    this.on = {};
    this.first = {};  // as the page was written
    this.members = new Map();  // layer -> Set of three.js objects
    this.listed = [];
  }

  // {layers: {name: on}, listed: [{path, layer, label}]}
  set({ layers, listed }) {
    this.first = layers;
    for (const name of Object.keys(layers)) if (!(name in this.on)) this.on[name] = layers[name];
    this.listed = listed;
    this.apply();
  }

  // An object may have `userData.label`, which returns {title, lines, at} at the present time, or null: what the page says of it.
  put(layer, object) {
    if (!this.members.has(layer)) this.members.set(layer, new Set());
    this.members.get(layer).add(object);
    object.visible = this.on[layer] !== false;
  }

  // What moved by itself has gone.
  clear() {
    this.members.clear();
  }

  show(layer, on) {
    this.on[layer] = on;
    this.apply();
  }

  // The object at a path below Meshcat's root; null if there is none.
  object(path) {
    let node = this.stage.viewer.scene_tree.children.meshcat;
    for (const name of path.split("/")) node = node && node.children[name];
    return node ? node.object : null;
  }

  // The layers in which the page has something, in Python's order.
  present() {
    const has = new Set(this.listed.map(({ layer }) => layer));
    for (const [layer, objects] of this.members) if (objects.size) has.add(layer);
    for (const [layer, path] of TREES) {
      const object = this.object(path);
      if (object && object.children.length) has.add(layer);
    }
    if (this.stage.labels.some()) has.add("labels");
    if (this.stage.view) has.add("axes");
    return Object.keys(this.first).filter((name) => has.has(name));
  }

  apply() {
    const set = (path, on) => {
      const object = this.object(path);
      if (object) object.visible = on;
    };
    for (const [layer, path] of TREES) set(path, this.on[layer] !== false);
    for (const { path, layer } of this.listed) {
      for (const each of [path, `${path}_seen_through`]) set(`marks/${each}`, this.on[layer] !== false);
    }
    for (const [layer, objects] of this.members) for (const object of objects) object.visible = this.on[layer] !== false;
    // The legend has no line for what is hidden.
    for (const row of this.stage.legend.querySelectorAll("tr[data-layer]")) row.hidden = this.on[row.dataset.layer] === false;
    this.stage.viewer.set_dirty();
  }
}

// Layers that are a branch of the tree.
const TREES = [["meshes", "robot"], ["other poses", "beside"], ["collision shapes", "collision"], ["frames", "frames"]];
