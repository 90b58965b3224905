// The layers of a scene, and the list that shows and hides them. A mark's layer is told by Python, see drawing.described;
// what moves (Cast) puts its own objects into a layer by `put`.
class Layers {
  constructor(stage) {
    this.stage = stage;
    this.on = {};
    this.members = new Map();  // layer -> Set of three.js objects
    this.listed = [];
  }

  // {layers: {name: on}, listed: [{path, layer, label}]}
  set({ layers, listed }) {
    for (const name of Object.keys(layers)) if (!(name in this.on)) this.on[name] = layers[name];
    this.listed = listed;
    this.apply();
  }

  put(layer, object) {
    if (!this.members.has(layer)) this.members.set(layer, new Set());
    this.members.get(layer).add(object);
    object.visible = this.on[layer] !== false;
  }

  show(layer, on) {
    this.on[layer] = on;
    this.apply();
  }

  apply() {
    const tree = this.stage.viewer.scene_tree;
    const set = (path, on) => { tree.find(["meshcat", ...path.split("/")]).object.visible = on; };
    if ("meshes" in this.on) set("robot", this.on.meshes);
    if ("other poses" in this.on) set("beside", this.on["other poses"]);
    for (const { path, layer } of this.listed) {
      for (const each of [path, `${path}_seen_through`]) set(`marks/${each}`, this.on[layer] !== false);
    }
    for (const [layer, objects] of this.members) for (const object of objects) object.visible = this.on[layer] !== false;
    this.stage.viewer.set_dirty();
  }
}
