// The viewer's tree: a name at each level, as in Meshcat. What is shown at a path is the child "<object>" of its node.
import { Group, Matrix4 } from "three";

export class SceneNode {
  constructor(object) {
    this.object = object;
    this.children = {};
  }

  // The node at a path, made if there is none.
  find(path) {
    let node = this;
    for (const name of path) {
      if (!(name in node.children)) {
        const group = new Group();
        group.name = name;
        node.object.add(group);
        node.children[name] = new SceneNode(group);
      }
      node = node.children[name];
    }
    return node;
  }

  set_transform(matrix) {
    const { position, quaternion, scale } = this.object;
    new Matrix4().fromArray(matrix).decompose(position, quaternion, scale);
  }

  // Shows an object here, in place of what was.
  set_object(object) {
    const { parent } = this.object;
    this.dispose();
    parent.remove(this.object);
    this.object = object;
    parent.add(object);
  }

  delete(path) {
    const name = path[path.length - 1], parent = this.find(path.slice(0, -1));
    const child = parent.children[name];
    if (!child) return;
    child.dispose();
    parent.object.remove(child.object);
    delete parent.children[name];
  }

  // Frees what the graphics card holds of it; what is still drawn elsewhere is sent there again.
  dispose() {
    for (const child of Object.values(this.children)) child.dispose();
    const { geometry, material } = this.object;
    if (geometry) geometry.dispose();
    if (material) material.dispose();
  }
}
