// The stage on which Meshcat's viewer shows a scene of rbd: light, ground, camera and legend.
// World is z up, x forward; the camera lives in three.js's own axes, y up: (x, y, z) -> (x, z, -y).
class Stage {
  constructor(pane, legend) {
    this.legend = legend;
    this.viewer = new MeshCat.Viewer(pane);
    // Meshcat lets everything cast and take shadows; marks are not things.
    const put = this.viewer.set_object.bind(this.viewer);
    this.viewer.set_object = (path, object) => {
      if (path[1] === "marks") object.castShadow = object.receiveShadow = false;
      put(path, object);
    };
    this.layers = new Layers(this);
    this.touched = false;
    this.carried = [0, 0, 0];
    for (const path of [["Grid"], ["Axes"], ["Lights"]]) this.viewer.set_property(path, "visible", false);
    this.viewer.set_property(["Background"], "top_color", [0.99, 0.99, 1.0]);
    this.viewer.set_property(["Background"], "bottom_color", [0.86, 0.89, 0.92]);
    for (const event of ["pointerdown", "wheel", "touchstart"]) {
      pane.addEventListener(event, () => { this.touched = true; }, { passive: true });
    }
    window.addEventListener("resize", () => { if (!this.touched) this.fit(); });
  }

  command(base64) {
    this.viewer.handle_command_bytearray(Uint8Array.from(atob(base64), (c) => c.charCodeAt(0)));
  }

  note(message) {
    if (message.legend) this.write(message.legend);
    if (message.marks) this.layers.set(message.marks);
    if ("motion" in message) this.move(message.motion);
    if (message.moment && this.cast) {
      this.cast.set(floats(message.moment.row));
      this.cues.set(message.moment.codes, this.cast.tracks.map((track) => track.force));
    }
    if (message.view) {
      this.light(message.view);
      if (document.body.dataset.ready) this.fit();
    }
  }

  // A motion with its frames gets a bar to play it; one without waits for its moments; null ends it.
  move(motion) {
    if (this.cast) this.cast.remove();
    this.cast = this.cues = null;
    this.carried = [0, 0, 0];
    if (!motion) {
      this.legend.replaceChildren();
    } else if (motion.times) {
      this.player = new Player(this, motion);
      if (motion.sheet) {
        this.legend.hidden = this.player.footer.hidden = true;
        this.size = () => [motion.sheet.width, motion.sheet.height];
      }
    } else {
      this.cast = new Cast(this, motion);
      this.cast.follow = motion.follow;
      this.cues = new Cues(this.legend, motion);
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
    this.fit();
    this.viewer.render();
    const sheet = this.player && this.player.motion.sheet;
    if (sheet) this.player.sheet(sheet);
    document.body.dataset.ready = "true";
  }

  connect(address) {
    const socket = new WebSocket(address);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => {
      if (typeof event.data !== "string") this.viewer.handle_command_bytearray(new Uint8Array(event.data));
      else this.note(JSON.parse(event.data));
    };
  }

  // Lamps, shadow and ground, sized to the scene.
  light(view) {
    this.view = view;
    const T = MeshCat.THREE;
    const [x, y, z] = view.centre;
    const r = view.radius;
    const group = new T.Group();
    group.add(new T.HemisphereLight(0xffffff, 0xb9bec6, 0.62));
    // The lamps stand as for a camera at the front left (1, 0.62), turned with it: a front is never in the shade.
    const turn = Math.atan2(view.direction[1], view.direction[0]) - Math.atan2(0.62, 1);
    const [c, s] = [Math.cos(turn), Math.sin(turn)];
    const place = (lamp, dx, dy, dz) => {
      lamp.position.set(x + r * (c * dx - s * dy), y + r * (s * dx + c * dy), z + r * dz);
      lamp.target.position.set(x, y, z);
    };
    const sun = new T.DirectionalLight(0xffffff, 0.5);
    place(sun, 1.2, 0.9, 2.6);
    sun.castShadow = true;
    Object.assign(sun.shadow.camera, { left: -1.6 * r, right: 1.6 * r, top: 1.6 * r, bottom: -1.6 * r, near: 0.05 * r, far: 8 * r });
    sun.shadow.mapSize.set(2048, 2048);
    sun.shadow.bias = -0.0005;
    sun.shadow.normalBias = 0.004 * r;
    sun.shadow.radius = 4;
    const fill = new T.DirectionalLight(0xffffff, 0.18);
    place(fill, 1, -2, 0.6);
    group.add(sun, sun.target, fill, fill.target);
    if (view.cell > 0) {
      const cells = 2 * Math.ceil((3 * r) / view.cell);
      const grid = new T.GridHelper(cells * view.cell, cells, 0x9aa5b1, 0xcbd2d9);
      grid.rotateX(Math.PI / 2);
      grid.position.set(Math.round(x / view.cell) * view.cell, Math.round(y / view.cell) * view.cell, 0);
      const floor = new T.Mesh(new T.PlaneGeometry(cells * view.cell, cells * view.cell), new T.ShadowMaterial({ opacity: 0.22 }));
      floor.position.set(grid.position.x, grid.position.y, -0.001 * r);
      floor.receiveShadow = true;
      group.add(grid, floor);
    }
    this.lamps = group;
    this.viewer.set_object(["Stage"], group);
    this.viewer.set_dirty();
  }

  // Places the camera so that every fit point is on the free part of the screen, with a small margin.
  fit() {
    if (!this.view) return;
    const T = MeshCat.THREE;
    const camera = this.viewer.camera;
    const [width, height] = this.size();
    const taken = this.legend.offsetWidth ? this.legend.offsetLeft + this.legend.offsetWidth : 0;
    // The legend takes the left side of a wide window, the top of a narrow one.
    const shift = taken > 0.4 * width ? 0 : taken;
    const below = this.legend.offsetTop + this.legend.offsetHeight;
    const drop = !shift && taken && below < 0.5 * height ? below : 0;
    // The bar of a motion takes the foot of the window.
    const bar = this.player && this.player.footer.offsetHeight;
    const foot = bar ? bar + 12 : 0;
    const margin = 0.93;
    // Curves take the right side of a wide window.
    const curves = this.player && this.player.curves && this.player.curves.panel.offsetWidth;
    const beside = curves ? curves + 14 : 0;
    const full = margin * Math.tan((Math.PI / 180) * this.view.fov / 2);
    const up = (full * (height - drop - foot)) / height;
    const side = (full * (width - shift - beside)) / height;
    const three = (p) => new T.Vector3(p[0], p[2], -p[1]);
    const back = three(this.view.direction).normalize();
    const right = new T.Vector3(0, 1, 0).cross(back).normalize();
    const top = back.clone().cross(right);
    const points = this.view.points.map(three);
    // For a target at the middle of what is seen, the distance at which the last point comes inside the frame.
    const middle = (axis) => {
      const along = points.map((p) => p.dot(axis));
      return (Math.min(...along) + Math.max(...along)) / 2;
    };
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
    this.viewer.set_dirty();
  }

  write(legend) {
    const make = (tag, text, kind) => {
      const element = document.createElement(tag);
      if (text) element.textContent = text;
      if (kind) element.className = kind;
      return element;
    };
    this.legend.replaceChildren(make("h1", legend.title));
    const table = make("table");
    for (const entry of legend.entries) {
      const row = table.insertRow();
      const swatch = make("i");
      swatch.style.background = entry.color;
      row.insertCell().append(swatch);
      row.insertCell().textContent = entry.name;
      const value = row.insertCell();
      value.className = "value";
      value.textContent = entry.value;
      if (entry.detail) {
        const more = table.insertRow();
        more.insertCell();
        const cell = more.insertCell();
        cell.colSpan = 2;
        cell.className = "detail";
        cell.textContent = [entry.detail].flat().join(", ");
      }
    }
    this.legend.append(table);
    for (const line of legend.notes) this.legend.append(make("p", line));
  }
}
