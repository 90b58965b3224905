// The support polygon of a motion: the hull, seen from above, of the points that carry load; each corner at its own height.
class Support {
  constructor(group, most, { line, lift }, color) {
    const T = MeshCat.THREE;
    this.lift = 2 * lift;
    this.outline = [];
    this.group = new T.Group();
    group.add(this.group);
    this.positions = new T.BufferAttribute(new Float32Array(3 * most), 3);
    const area = new T.BufferGeometry();
    area.setAttribute("position", this.positions);
    area.setIndex(Array.from({ length: Math.max(0, most - 2) }, (_, i) => [0, i + 1, i + 2]).flat());
    // Faint through the soles above it: from the usual view they hide most of it.
    const look = { color, transparent: true, depthWrite: false, side: T.DoubleSide };
    this.areas = [
      new T.Mesh(area, new T.MeshBasicMaterial({ ...look, opacity: 0.22 })),
      new T.Mesh(area, new T.MeshBasicMaterial({ ...look, opacity: 0.14, depthTest: false })),
    ];
    for (const mesh of this.areas) mesh.frustumCulled = false;
    const rod = new T.CylinderGeometry(1.2 * line, 1.2 * line, 1, 10).rotateX(Math.PI / 2).translate(0, 0, 0.5);
    this.edges = Array.from({ length: most }, () => twice(rod, color));
    this.group.add(...this.areas, ...this.edges);
    this.group.userData.label = () => polygonLabel(this.outline);
  }

  // Shows the hull of points [[x, y, z], ...].
  set(points) {
    const T = MeshCat.THREE;
    const hull = this.outline = convexHull(points);
    const n = hull.length;
    hull.forEach((p, i) => this.positions.setXYZ(i, p[0], p[1], p[2] + this.lift));
    this.positions.needsUpdate = true;
    for (const mesh of this.areas) {
      mesh.visible = n > 2;
      mesh.geometry.setDrawRange(0, 3 * Math.max(0, n - 2));
    }
    const count = n > 2 ? n : n === 2 ? 1 : 0;
    this.edges.forEach((edge, i) => {
      edge.visible = i < count;
      if (!edge.visible) return;
      const from = new T.Vector3(...hull[i]), along = new T.Vector3(...hull[(i + 1) % n]).sub(from);
      edge.position.set(from.x, from.y, from.z + this.lift);
      edge.scale.z = along.length();
      edge.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), along.normalize());
    });
  }
}

// Corners of the hull of [[x, y, ...], ...] in the x-y plane, counterclockwise; points on an edge are no corners.
function convexHull(points) {
  const order = [...points].sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const apart = order.filter((p, i) => !i || Math.hypot(p[0] - order[i - 1][0], p[1] - order[i - 1][1]) > 1e-9);
  if (apart.length < 3) return apart;
  const chain = (run) => {
    const out = [];
    for (const p of run) {
      while (out.length > 1) {
        const [a, b] = out.slice(-2);
        if ((b[0] - a[0]) * (p[1] - a[1]) - (b[1] - a[1]) * (p[0] - a[0]) > 1e-9) break;
        out.pop();
      }
      out.push(p);
    }
    return out.slice(0, -1);
  };
  return [...chain(apart), ...chain([...apart].reverse())];
}
