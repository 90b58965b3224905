// The stage on which the viewer shows a scene of rbd: light, ground, camera and legend.
// World is z up, x forward; the camera lives in three.js's own axes, y up: (x, y, z) -> (x, z, -y).
const LOW_WINDOW = 700;  // pixels
const FULL = Math.PI;  // intensity of a lamp that shows a white surface which faces it as white

// An element of a class with a text, at the end of a parent.
function make(tag, kind, parent, text = "") {
  const made = Object.assign(document.createElement(tag), { className: kind, textContent: text });
  if (parent) parent.append(made);
  return made;
}

// An element of a vector drawing, with attributes.
function draw(tag, parent, given) {
  draw.space ??= Object.assign(document.createElement("div"), { innerHTML: "<svg></svg>" }).firstChild.namespaceURI;
  const made = document.createElementNS(draw.space, tag);
  for (const [name, value] of Object.entries(given)) made.setAttribute(name, value);
  parent.append(made);
  return made;
}

// Puts an object at a pose: position and quaternion.
function pose(object, at) {
  object.position.set(...at.slice(0, 3));
  object.quaternion.set(...at.slice(3));
}

class Stage {
  constructor(pane, legend, pieces) {
    this.legend = legend;
    this.pane = pane;
    this.viewer = new MeshCat.Viewer(pane);
    this.meshes = new Meshes(this.viewer, pieces);
    // The viewer asks for the window's size several times while a page loads: only a new one is a reason to draw again.
    const resize = this.viewer.set_3d_pane_size.bind(this.viewer);
    let known = "";
    this.viewer.set_3d_pane_size = (...asked) => {
      const size = asked.length ? asked : this.size();
      if (size.join() !== known) resize(...size);
      known = size.join();
    };
    this.layers = new Layers(this);
    this.controls = new Controls(this);
    this.labels = new Labels(this, pane);
    this.gauges = new Gauges(this);
    this.views = new Views(this);
    this.toolbar = new Toolbar(this);
    this.frames = [];
    this.foot = 0;
    this.touched = false;
    this.carried = [0, 0, 0];
    theme.stage = this;
    theme.apply();
    for (const event of ["pointerdown", "wheel", "touchstart"]) {
      pane.addEventListener(event, () => { this.touched = true; }, { passive: true });
    }
    window.addEventListener("resize", () => { if (!this.touched) this.fit(); });
    legend.addEventListener("fold", () => { if (!this.touched) this.fit(); });
    window.addEventListener("beforeprint", () => this.viewer.render());
    this.afterEachPicture();
  }

  // What lies over the picture follows it: labels, axes, scale; and the address keeps time and camera.
  afterEachPicture() {
    const render = this.viewer.render.bind(this.viewer);
    let before = null;
    this.viewer.render = () => {
      render();
      this.labels.place();
      this.gauges.place();
      const now = this.player && !this.player.playing ? this.player.t : before;
      if (before !== null && now !== before) this.views.keep();
      before = now ?? before;
    };
    for (const event of ["pointerup", "wheel", "touchend"]) {
      this.pane.addEventListener(event, () => {
        const moved = this.touched && document.body.dataset.ready && this.placed !== this.views.camera().join();
        if (!moved) return;
        this.views.name = "";
        this.toolbar.refresh();
        this.views.keep();
      }, { passive: true });
    }
  }

  // Where a point of W is in the window, in pixels; null behind the camera.
  project(point) {
    const { camera } = this.viewer;
    const p = new MeshCat.THREE.Vector3(point[0], point[2], -point[1]).project(camera);
    const [width, height] = this.size();
    return p.z < 1 ? [(width * (1 + p.x)) / 2, (height * (1 - p.y)) / 2] : null;
  }

  // A piece of the page: a command of Meshcat's.
  command(number) {
    this.viewer.handle_command_bytearray(this.meshes.pieces[number]);
  }

  // A piece of the page: triangles, as an object at a path.
  place(header, number) {
    this.meshes.place(header, number);
  }

  // Bytes from the socket of a live scene.
  receive(data) {
    this.meshes.receive(data);
  }

  note(message) {
    if ("hold" in message && this.live) this.live.backdrop.hold(message.hold);
    if (message.legend) writeLegend(this, message.legend);
    if (message.bodies) this.labels.name(message);
    if (message.frames) this.triads(message.frames);
    if (message.marks) {
      this.layers.set(message.marks);
      if (this.player) this.player.seek(this.player.t);  // some of them move, or are shown at times
    }
    if ("motion" in message) this.move(message.motion);
    if (message.paused && this.player) this.player.play(false);
    if (message.controls) this.controls.build(message.controls);
    if (message.answer) this.controls.answer(message.answer);
    if (message.verify) this.verifier = new Verifier(this, message.verify);
    if (message.view) {
      this.light(message.view);
      if (!document.body.dataset.ready) this.views.name = message.view.opens;
      if (document.body.dataset.ready) this.fit();
    }
  }

  // A motion gets a bar to play it; null ends it.
  move(motion) {
    if (this.player) {
      this.player.remove();
      this.layers.clear();
    }
    this.player = null;
    this.carried = [0, 0, 0];
    if (!motion) {
      this.legend.replaceChildren();
      return;
    }
    this.player = new Player(this, motion);
    if (motion.sheet) {
      this.legend.hidden = this.player.footer.hidden = true;
      this.size = () => [motion.sheet.width, motion.sheet.height];
    }
  }

  // Moves camera, lamps and ground along with the robot: by so much in W [m] from where they stand at first.
  carry(offset) {
    const d = offset.map((x, i) => x - this.carried[i]);
    this.carried = offset;
    for (const p of [this.viewer.camera.position, this.viewer.controls.target]) p.add({ x: d[0], y: d[2], z: -d[1] });
    const cell = (this.view && this.view.cell) || 1;
    // The ground moves by whole cells: its lines stay where they are.
    if (this.lamps) this.lamps.position.set(...offset.map((x) => Math.round(x / cell) * cell));
    this.viewer.set_dirty();
  }

  size() {
    return [window.innerWidth, window.innerHeight];
  }

  ready() {
    this.viewer.set_3d_pane_size(...this.size());
    this.views.open();
    if (this.views.name) this.fit();
    this.viewer.render();
    const sheet = this.player && this.player.motion.sheet;
    if (sheet) this.player.sheet(sheet);
    // Reading a pixel waits until all is drawn.
    const gl = this.viewer.renderer.getContext();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
    performance.mark("drawn");
    document.body.dataset.ready = "true";
    this.toolbar.refresh();
  }

  connect(address) {
    this.live = new Live(this, address, (message) => this.note(message));
  }

  // Whether the robot is drawn in a grey red: what is shown cannot be.
  tint(on) {
    if (on === Boolean(this.tinted)) return;
    this.tinted = on;
    const refused = new MeshCat.THREE.Color("#9a6b68");
    this.viewer.scene_tree.find(["meshcat", "robot"]).object.traverse(({ isMesh, material }) => {
      if (!isMesh) return;
      if (!material.userData.color) material.userData.color = material.color.clone();
      material.color.copy(material.userData.color);
      if (on) material.color.lerp(refused, 0.75);
    });
    this.viewer.set_dirty();
  }

  // Lamps, shadow and ground, sized to the scene.
  light(view) {
    this.view = view;
    const T = MeshCat.THREE;
    const [x, y, z] = view.centre;
    const r = view.radius;
    const group = new T.Group();
    group.add(new T.HemisphereLight(0xffffff, 0xb9bec6, 0.62 * FULL));
    // The lamps stand as for a camera at the front left (1, 0.62), turned with it: a front is never in the shade.
    const turn = Math.atan2(view.direction[1], view.direction[0]) - Math.atan2(0.62, 1);
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const place = (lamp, dx, dy, dz) => {
      lamp.position.set(x + r * (c * dx - s * dy), y + r * (s * dx + c * dy), z + r * dz);
      lamp.target.position.set(x, y, z);
    };
    const sun = new T.DirectionalLight(0xffffff, 0.5 * FULL);
    place(sun, 1.2, 0.9, 2.6);
    sun.castShadow = true;
    Object.assign(sun.shadow.camera, { left: -1.6 * r, right: 1.6 * r, top: 1.6 * r, bottom: -1.6 * r, near: 0.05 * r, far: 8 * r });
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.bias = -0.0005;
    sun.shadow.normalBias = 0.004 * r;
    sun.shadow.radius = 1.5;
    const fill = new T.DirectionalLight(0xffffff, 0.18 * FULL);
    place(fill, 1, -2, 0.6);
    group.add(sun, sun.target, fill, fill.target);
    if (view.cell > 0) {
      const cells = 2 * Math.ceil((3 * r) / view.cell);
      const grid = new T.GridHelper(cells * view.cell, cells, ...theme.look.grid);
      grid.rotateX(Math.PI / 2);
      grid.position.set(Math.round(x / view.cell) * view.cell, Math.round(y / view.cell) * view.cell, 0);
      const floor = new T.Mesh(new T.PlaneGeometry(cells * view.cell, cells * view.cell), new T.ShadowMaterial({ opacity: theme.look.shadow, depthWrite: false }));
      floor.position.set(grid.position.x, grid.position.y, -0.001 * r);
      floor.receiveShadow = true;
      group.add(grid, floor);
    }
    this.lamps = group;
    this.viewer.set_object(["Stage"], group);
    this.gauges.origin();
    this.viewer.set_dirty();
  }

  // Lamps and ground anew, where they stand.
  relight() {
    if (!this.lamps) return;
    const at = this.lamps.position.clone();
    this.light(this.view);
    this.lamps.position.copy(at);
  }

  // Places the camera so that every fit point is on the free part of the screen, with a small margin.
  fit() {
    if (!this.view) return;
    const T = MeshCat.THREE;
    const camera = this.viewer.camera;
    const [width, height] = this.size();
    const taken = this.legend.offsetWidth ? this.legend.offsetLeft + this.legend.offsetWidth : 0;
    const below = taken ? this.legend.offsetTop + this.legend.offsetHeight : 0;
    // The bar of a motion, or sliders, take the foot of the window; curves the right side of a wide one.
    const { beside, foot } = this.player ? this.player.room() : this.controls.room();
    this.foot = foot ? foot - 12 : 0;
    const margin = 0.93;
    const full = margin * Math.tan((Math.PI / 180) * this.view.fov / 2);
    const three = (p) => new T.Vector3(p[0], p[2], -p[1]);
    const back = three(this.views.direction(this.views.name)).normalize();
    const right = new T.Vector3(0, 1, 0).cross(back).normalize();
    const top = back.clone().cross(right);
    const points = this.view.points.map(three);
    // For a target at the middle of what is seen, the distance at which the last point comes inside the frame.
    const middle = (axis) => {
      const along = points.map((p) => p.dot(axis));
      return (Math.min(...along) + Math.max(...along)) / 2;
    };
    // The camera for what is left beside, or below, the legend.
    const aim = ([shift, drop]) => {
      const up = (full * (height - drop - foot)) / height;
      const side = (full * (width - shift - beside)) / height;
      const target = new T.Vector3();
      for (const axis of [right, top, back]) target.addScaledVector(axis, middle(axis));
      let distance = 0;
      for (let round = 0; round < 4; round++) {
        distance = 0;
        let low = [0, 0], high = [0, 0];
        for (const p of points) {
          const d = p.clone().sub(target);
          distance = Math.max(distance, d.dot(back) + Math.abs(d.dot(right)) / side, d.dot(back) + Math.abs(d.dot(top)) / up);
        }
        for (const p of points) {
          const d = p.clone().sub(target);
          const depth = distance - d.dot(back);
          [right, top].forEach((axis, i) => {
            low[i] = Math.min(low[i], d.dot(axis) / depth);
            high[i] = Math.max(high[i], d.dot(axis) / depth);
          });
        }
        // Nearer points look larger: recentre on what the camera sees.
        target.addScaledVector(right, (distance * (low[0] + high[0])) / 2);
        target.addScaledVector(top, (distance * (low[1] + high[1])) / 2);
      }
      return { shift, drop, target, distance };
    };
    // The legend takes the left side of a wide window; else the side or the top, whichever leaves the larger picture.
    const wide = taken <= 0.4 * width && this.legend.dataset.fold !== "folded";
    // In a low window, or one with curves beside it, the robot's head would be behind the buttons.
    const bar = height < LOW_WINDOW || beside ? this.toolbar.bottom() : 0;
    const ways = wide ? [[taken, bar]] : [[taken, bar], [0, Math.max(bar, below)]];
    const free = ways.filter(([shift, drop]) => width - shift - beside > 90 && height - drop - foot > 60);
    const found = (free.length ? free : [[0, 0]]).map(aim).sort((a, b) => a.distance - b.distance);
    const { shift, drop, target, distance } = found[0];
    camera.fov = this.view.fov;
    camera.aspect = width / height;
    camera.near = distance / 100;
    camera.far = distance * 50;
    camera.setViewOffset(width, height, (beside - shift) / 2, (foot - drop) / 2, width, height);
    camera.position.copy(target).addScaledVector(back, distance);
    this.viewer.controls.target.copy(target);
    const carried = this.carried;
    this.carried = [0, 0, 0];
    this.carry(carried);
    this.viewer.controls.update();
    camera.updateProjectionMatrix();
    this.placed = this.views.camera().join();
    this.viewer.set_dirty();
  }

  // The joints' and contacts' frames as arrows along x, y, z: [{name, lines, at: pose in W}], of one length.
  triads({ length, listed }) {
    const T = MeshCat.THREE;
    const root = new T.Group();
    for (const frame of listed) root.add(triad(frame, length));
    this.viewer.set_object(["meshcat", "frames"], root);
    this.frames = root.children;
  }
}

// Three thin sticks in the colours of W's axes; named when pointed at.
function triad({ name, lines, at }, length) {
  const T = MeshCat.THREE;
  const node = new T.Group();
  triad.stick ??= new T.CylinderGeometry(0.03, 0.03, 1, 8).translate(0, 0.5, 0);
  triad.colors ??= AXES.map(([, color, axis]) => ({
    turn: new T.Quaternion().setFromUnitVectors(new T.Vector3(0, 1, 0), new T.Vector3(...axis)),
    material: new T.MeshBasicMaterial({ color, depthTest: false, transparent: true }),
  }));
  for (const { turn, material } of triad.colors) {
    const stick = new T.Mesh(triad.stick, material);
    stick.quaternion.copy(turn);
    stick.scale.setScalar(length);
    stick.renderOrder = 3;
    node.add(stick);
  }
  if (at) pose(node, at);
  const label = { title: name, lines, at: null };
  node.userData.label = () => label;
  return node;
}
