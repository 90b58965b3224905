// Force elements that move: springs as coils, dampers as cylinders with rods, torsional ones as spirals, bushings.
// A line through points (x, y, z) of t from 0 to 1.
function lineThrough(point) {
  const curve = new MeshCat.THREE.Curve();
  curve.getPoint = (t, target = new MeshCat.THREE.Vector3()) => target.set(...point(t));
  return curve;
}

// Along z: straight at both ends, on the axis there.
function coilLine(length, radius, turns, straight) {
  return lineThrough((t) => {
    const inside = Math.min(Math.max((t - straight) / (1 - 2 * straight), 0), 1);
    const angle = 2 * Math.PI * turns * inside, r = radius * Math.min(1, 12 * inside, 12 * (1 - inside));
    return [r * Math.cos(angle), r * Math.sin(angle), length * t];
  });
}

function spiralLine(radius, turns) {
  return lineThrough((t) => {
    const angle = 2 * Math.PI * turns * t, r = radius * (0.12 + 0.88 * t);
    return [r * Math.cos(angle), r * Math.sin(angle), 0];
  });
}

class ForceElement {
  constructor(group, look, shift) {
    const T = MeshCat.THREE;
    this.look = look;
    this.node = new T.Group();
    group.add(this.node);
    const { length, radius, wire, spiral, turns, straight } = look;
    const rod = new T.CylinderGeometry(wire, wire, 1, 10).rotateX(Math.PI / 2).translate(0, 0, 0.5);
    const add = (geometry, opacity = 1) => {
      const piece = twice(geometry, look.colors[0], opacity, opacity === 1 ? 0.5 : 0);
      this.node.add(piece);
      return piece;
    };
    if (look.shape === "coil") {
      const curve = coilLine(length, Math.min(radius, 0.5 * length + wire), turns, straight);
      this.stretched = [add(new T.TubeGeometry(curve, 24 * turns, wire, 8, false))];
    } else if (look.shape === "cylinder") {
      const body = 0.4 * length;
      this.cylinder = add(new T.CylinderGeometry(0.8 * radius, 0.8 * radius, body, 24).rotateX(Math.PI / 2));
      this.rods = [add(rod), add(rod)];
    } else if (look.shape === "bushing") {
      this.sleeve = add(new T.SphereGeometry(1.3 * radius, 24, 16), 0.35);
      this.ball = add(new T.SphereGeometry(0.6 * radius, 20, 14));
      this.rods = [add(rod)];
    } else if (look.shape === "drum") {
      this.turned = add(new T.CylinderGeometry(0.6 * spiral, 0.6 * spiral, 0.5 * spiral, 24).rotateX(Math.PI / 2));
    } else {
      this.turned = add(new T.TubeGeometry(spiralLine(spiral, 3), 96, wire, 8, false));
    }
    this.node.userData.label = () => this.label(shift);
  }

  // Its ends, its axis, and how much it pulls.
  set(row) {
    const T = MeshCat.THREE;
    const { look } = this;
    this.row = [...row];
    this.node.visible = Number.isFinite(row[0]);
    if (!this.node.visible) return;
    const a = new T.Vector3(row[0], row[1], row[2]), b = new T.Vector3(row[3], row[4], row[5]);
    const axis = new T.Vector3(row[6], row[7], row[8]);
    const along = b.clone().sub(a);
    const length = along.length(), up = new T.Vector3(0, 0, 1);
    const turn = new T.Quaternion();
    if (this.turned) turn.setFromUnitVectors(up, axis.lengthSq() ? axis : up);
    else if (length > 1e-9) turn.setFromUnitVectors(up, along.divideScalar(length));
    this.node.position.copy(this.turned ? b : a);
    this.node.quaternion.copy(turn);
    if (this.stretched) for (const piece of this.stretched) piece.scale.z = Math.max(length / look.length, 1e-6);
    if (this.cylinder) {
      const from = 0.15 * look.length, body = 0.4 * look.length;
      this.cylinder.position.z = from + 0.5 * body;
      this.rods[0].scale.z = from;
      this.rods[1].position.z = Math.min(from + 0.5 * body, length);
      this.rods[1].scale.z = Math.max(length - this.rods[1].position.z, 1e-6);
    }
    if (this.ball) {
      this.ball.position.z = length;
      this.rods[0].scale.z = Math.max(length, 1e-6);
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
