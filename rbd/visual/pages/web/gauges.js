// W's axes and a scale, drawn over the picture: the layer "axes".
const AXES = [["x", "#c0392b", [1, 0, 0]], ["y", "#1e8449", [0, 1, 0]], ["z", "#2456b4", [0, 0, 1]]];

class Gauges {
  constructor(stage) {
    this.stage = stage;
    this.node = Object.assign(make("div", "gauges", document.body), { hidden: true });
    const svg = draw("svg", this.node, { width: 84, height: 84, viewBox: "-42 -42 84 84", role: "img", "aria-label": "World axes" });
    this.axes = AXES.map(([letter, color, axis]) => {
      const group = draw("g", svg, {});
      const line = draw("line", group, { x1: 0, y1: 0, "stroke-width": 3, "stroke-linecap": "round" });
      const text = draw("text", group, { "text-anchor": "middle", "dominant-baseline": "central" });
      text.textContent = letter;
      theme.paint(line, "stroke", color);
      theme.paint(text, "fill", color);
      return { group, line, text, axis };
    });
    this.bar = make("div", "scale", this.node);
  }

  // Arrows of W at its origin, of a round length; remade when the scene's size is.
  origin() {
    const T = MeshCat.THREE;
    const { radius } = this.stage.view;
    const length = rounded(0.35 * radius), r = 0.012 * length;
    this.group = new T.Group();
    for (const [, color, axis] of AXES) {
      const arrow = new Arrow(this.group, color, r);
      arrow.set([0, 0, 0], axis.map((x) => x * length), 2 * length);
    }
    const told = { title: "origin of W", lines: [`arrows along x, y, z, ${length} m long`], at: [0, 0, 0] };
    this.group.userData.label = () => told;
    this.stage.viewer.set_object(["Origin"], this.group);
    this.place();
  }

  // After each picture.
  place() {
    const { stage } = this;
    const on = stage.layers.on.axes === true && Boolean(stage.view);
    this.node.hidden = !on;
    if (this.group) this.group.visible = on;
    if (!on) return;
    this.node.style.bottom = `${14 + stage.foot}px`;
    // Beside a legend that comes down to it.
    const { offsetLeft, offsetTop, offsetWidth, offsetHeight } = stage.legend;
    const covers = offsetWidth && offsetTop + offsetHeight > this.node.offsetTop;
    this.node.style.left = `${covers ? offsetLeft + offsetWidth + 12 : 14}px`;
    const T = MeshCat.THREE;
    const { camera } = stage.viewer;
    const turn = new T.Quaternion();
    camera.getWorldQuaternion(turn).invert();
    const drawn = this.axes.map(({ group, line, text, axis }) => {
      const v = new T.Vector3(axis[0], axis[2], -axis[1]).applyQuaternion(turn);
      for (const [name, value] of [["x2", 26 * v.x], ["y2", -26 * v.y]]) line.setAttribute(name, value.toFixed(2));
      for (const [name, value] of [["x", 35 * v.x], ["y", -35 * v.y]]) text.setAttribute(name, value.toFixed(2));
      return { group, depth: v.z };
    });
    // What points at the viewer is drawn last.
    for (const { group } of drawn.sort((a, b) => a.depth - b.depth)) group.parentNode.append(group);
    const perMetre = this.pixelsPerMetre();
    const metres = rounded(110 / perMetre);
    const pixels = metres * perMetre;
    this.bar.style.width = `${pixels.toFixed(2)}px`;
    this.bar.textContent = metres >= 1 ? `${metres} m` : metres >= 0.01 ? `${Number((100 * metres).toPrecision(2))} cm` : `${Number((1000 * metres).toPrecision(2))} mm`;
    this.bar.title = "At the distance of the robot";
  }

  // Of what is as far from the camera as the middle of the scene.
  pixelsPerMetre() {
    const T = MeshCat.THREE;
    const { view, viewer, carried } = this.stage;
    const [x, y, z] = view.centre.map((c, i) => c + carried[i]);
    const depth = -new T.Vector3(x, z, -y).applyMatrix4(viewer.camera.matrixWorldInverse).z;
    const { camera } = viewer;
    return (this.stage.size()[1] * camera.zoom) / (2 * Math.tan((Math.PI / 360) * camera.fov) * Math.max(depth, 1e-6));
  }
}

// The largest of 1, 2, 5 times a power of ten that is not above x.
function rounded(x) {
  const ten = 10 ** Math.floor(Math.log10(x));
  return Number((ten * [5, 2, 1].find((n) => n * ten <= x * (1 + 1e-9))).toPrecision(1));
}
