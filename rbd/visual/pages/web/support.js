// The support polygon of a motion: the hull, seen from above, of the points that carry load; each corner at its own height.
class Support {
  constructor(group, { line, lift }, color) {
    this.lift = 2 * lift;
    this.radius = 1.2 * line;
    this.outline = [];
    // Faint through the soles above it: from the usual view they hide most of it.
    this.area = twice(solid([]), color, 0.22, 0.64);
    this.edge = twice(solid([]), color);
    this.group = new MeshCat.THREE.Group();
    this.group.add(this.area, this.edge);
    this.group.userData.label = () => polygonLabel(this.outline);
    group.add(this.group);
  }

  // Shows the hull of points [[x, y, z], ...].
  set(points) {
    const hull = this.outline = convexHull(points);
    const flat = hull.map(([x, y, z]) => [x, y, z + this.lift]), closed = hull.length > 2;
    this.show(this.area, closed ? [{ kind: "polygon", points: flat }] : []);
    this.show(this.edge, hull.length > 1 ? [{ kind: "line", points: flat, radius: this.radius, closed }] : []);
  }

  show(node, primitives) {
    node.visible = primitives.length > 0;
    node.children[0].geometry.dispose();
    const made = solid(primitives);
    for (const mesh of node.children) mesh.geometry = made;
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
