// Force elements that move: their pieces come from Python, in the element's own axes, z from its first end to its second.
class ForceElement {
  constructor(stage, group, look, shift) {
    this.look = look;
    this.node = new MeshCat.THREE.Group();
    group.add(this.node);
    this.pieces = look.pieces.map((piece, i) => {
      const { object } = stage.viewer.scene_tree.find(["meshcat", ...look.path.split("/"), String(i)]);
      object.visible = false;
      let triangles = null;
      object.traverse((each) => { if (each.isMesh) triangles = each.geometry; });
      const drawn = twice(triangles, look.colors[0], piece.opacity, piece.opacity === 1 ? 0.5 : 0);
      this.node.add(drawn);
      return { ...piece, drawn };
    });
    this.node.userData.label = () => this.label(shift);
  }

  // Its ends, its axis, and how much it pulls.
  set(row) {
    const T = MeshCat.THREE;
    const { turned } = this.look;
    this.row = [...row];
    this.node.visible = Number.isFinite(row[0]);
    if (!this.node.visible) return;
    const a = new T.Vector3(row[0], row[1], row[2]), b = new T.Vector3(row[3], row[4], row[5]);
    const along = b.clone().sub(a), length = along.length();
    const axis = turned ? new T.Vector3(row[6], row[7], row[8]) : along.normalize();
    this.node.position.copy(turned ? b : a);
    this.node.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), axis.lengthSq() ? axis : new T.Vector3(0, 0, 1));
    for (const { drawn, start, stretched } of this.pieces) {
      const low = start ?? length;
      drawn.position.z = low;
      if (stretched) drawn.scale.z = Math.max(length - low, 1e-6);
    }
    this.paint(row[9]);
  }

  // Grey where it is relaxed, to the colour of pulling or pushing.
  paint(tension) {
    const T = MeshCat.THREE;
    const [relaxed, pulls, pushes] = this.look.colors;
    const share = Math.sqrt(Math.min(1, Math.abs(tension) / this.look.full));
    const color = new T.Color(relaxed).lerp(new T.Color(tension > 0 ? pulls : pushes), share);
    this.node.traverse((each) => {
      if (!each.isMesh) return;
      each.material.color.copy(color);
      each.material.emissive.copy(color).multiplyScalar(0.15);
    });
  }

  label(shift) {
    if (!this.row || !Number.isFinite(this.row[0])) return null;
    const { name, unit, shape } = this.look;
    const [a, b, tension] = [this.row.slice(0, 3), this.row.slice(3, 6), this.row[9]];
    const does = Math.abs(tension) < 1e-9 || shape === "bushing" ? "" : unit === "N" ? (tension > 0 ? ", pulls" : ", pushes")
      : (tension > 0 ? ", turns back" : ", turns forward");
    const lines = shape === "bushing" ? [] : [`${fewDigits(Math.abs(tension))} ${unit}${does}`];
    lines.push(`from ${inThree(a, "m")} to ${inThree(b, "m")}`);
    return { title: name, lines, at: moved(a.map((x, i) => 0.5 * (x + b[i])), shift) };
  }
}
