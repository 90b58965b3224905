// What moves in a scene of rbd: bodies, force arrows, contact points, centre of mass. World is z up.
class Arrow {
  constructor(group, color, radius) {
    const T = MeshCat.THREE;
    this.radius = radius;
    this.node = new T.Group();
    const head = cone(1, 1);
    this.shaft = twice(cylinder(1, 1, 24), color);
    this.heads = [twice(head, color), twice(head, color)];
    this.node.add(this.shaft, ...this.heads);
    group.add(this.node);
  }

  // From `start` along `vector` [m], at most `longest`: a cut arrow has two heads.
  set(start, vector, longest) {
    const T = MeshCat.THREE;
    const v = new T.Vector3(...vector);
    const wanted = v.length();
    this.node.visible = Number.isFinite(wanted) && Number.isFinite(start[0]) && wanted > 1e-3 * this.radius;
    if (!this.node.visible) return;
    const length = Math.min(wanted, longest), { head, wide, thin } = arrowSizes(length, this.radius);
    this.node.position.set(...start);
    this.node.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), v.divideScalar(wanted));
    this.shaft.scale.set(thin, thin, length - head);
    this.heads.forEach((cone, i) => {
      cone.scale.set(wide, wide, head);
      cone.position.z = length - head * (1 + 0.8 * i);
    });
    this.heads[1].visible = wanted > longest;
  }
}

// A shape in one colour that shines faintly through what hides it; it casts no shadow.
function twice(geometry, color, opacity = 1, through = 0.5) {
  const T = MeshCat.THREE;
  const material = { opacity, transparent: opacity < 1, depthWrite: opacity === 1 };
  const lambert = (given) => theme.material(new T.MeshLambertMaterial(given), color, 0.15);
  const node = new T.Group();
  node.add(new T.Mesh(geometry, lambert(material)));
  const ghost = { ...material, opacity: through * opacity, transparent: true, depthTest: false, depthWrite: false };
  if (through) node.add(new T.Mesh(geometry, lambert(ghost)));
  return node;
}

// All that moves. A row has poses of the bodies, centre of mass, point and force of every point, force elements: see Frames.rows.
// A second motion is displaced by `shift`; its pieces are those of the first robot, copied, or those at the path `tree`.
class Cast {
  constructor(stage, motion) {
    const T = MeshCat.THREE;
    this.stage = stage;
    this.motion = motion;
    const { sizes } = motion;
    this.shift = motion.shift || [0, 0, 0];
    this.where = motion.shift ? "Second motion" : "Motion";
    this.group = new T.Group();
    stage.viewer.set_object([this.where], this.group);
    this.group.position.set(...this.shift);
    this.layers = new Map();
    this.riders = [];
    this.parts = motion.parts.map((part) => ({
      object: this.piece(part.node),
      body: part.body,
      position: new T.Vector3(...part.at.slice(0, 3)),
      turn: new T.Quaternion(...part.at.slice(3)),
    }));
    if (motion.shift) this.place(motion.fixed);
    else this.takeAlong(motion.riders || []);
    this.ghost = motion.ghost ? motion.parts.map((part) => ({ ...part, body: part.body + motion.ghost.bodies })) : [];
    this.start = null;
    this.floors = motion.floors ? floats(motion.floors) : [];
    if (motion.com) this.makeCom(sizes);
    // By how much what acts beside another force is drawn aside: to the right, as the page is opened.
    const [x, y] = stage.view ? stage.views.direction("start") : [1, 0], across = Math.hypot(x, y) || 1;
    this.aside = [-y / across, x / across, 0].map((each) => 5 * sizes.shaft * each);
    this.halo = twice(new T.SphereGeometry(1, 24, 16), "#000000", 0.5, 0);
    this.halo.visible = false;
    this.layer("forces").add(this.halo);
    this.tracks = [...motion.contacts.map((track) => ({ ...track, layer: "forces" })),
      ...motion.pushes.map((track) => ({ ...track, layer: "pushes" }))].map((track) => this.makeTrack(track, sizes));
    this.elements = (motion.elements || []).map((look) => new ForceElement(stage, this.layer("force elements"), look, this.shift));
    this.support = motion.contacts.some(({ supports }) => supports) ? new Support(this.layer("support polygon"), sizes, motion.support) : null;
  }

  // What is shown and hidden with a layer.
  layer(name) {
    if (!this.layers.has(name)) {
      const group = new MeshCat.THREE.Group();
      this.layers.set(name, group);
      this.group.add(group);
      this.stage.layers.put(name, group);
    }
    return this.layers.get(name);
  }

  // A piece of the robot in the viewer's tree; for a second motion of the same robot a copy that shares its meshes.
  piece(node) {
    const { tree = "robot", shift } = this.motion;
    const { object } = this.stage.viewer.scene_tree.find(["meshcat", tree, String(node)]);
    if (!shift) return object;
    const piece = tree === "robot" ? object.clone() : object;
    const body = tree === "robot" ? this.stage.labels.bodies[node] : null;
    if (body) piece.userData.label = () => bodyLabel(body);
    this.layer("meshes").add(piece);
    return piece;
  }

  // Puts pieces that are fixed to the world where they are.
  place(fixed) {
    for (const { node, at } of fixed) pose(this.piece(node), at);
  }

  // Frames and collision shapes go with their bodies; those of bodies that have no pose here are hidden.
  takeAlong(riders) {
    const T = MeshCat.THREE;
    for (const { tree, node, body, at } of riders) {
      const object = tree === "frames" ? this.stage.frames[node] : this.stage.layers.object(`${tree}/${node}`);
      if (!object) continue;
      if (body === null) object.visible = false;
      else this.riders.push({ object, body, position: new T.Vector3(...at.slice(0, 3)), turn: new T.Quaternion(...at.slice(3)) });
    }
  }

  // A second motion of the same robot: its meshes are those of the first, in one translucent colour. The first pass writes
  // depth alone, so that only the outermost surface is seen.
  makeGhost() {
    const T = MeshCat.THREE;
    const { color } = this.motion.ghost;
    const depth = new T.MeshBasicMaterial({ colorWrite: false, transparent: true });
    const glow = new T.Color(color).multiplyScalar(0.25);
    const skin = new T.MeshLambertMaterial({ color, emissive: glow, opacity: 0.4, transparent: true, depthWrite: false });
    for (const part of this.ghost) {
      const from = this.stage.viewer.scene_tree.find(["meshcat", "robot", String(part.node)]).object;
      part.object = new T.Group();
      from.traverse((each) => {
        if (!each.isMesh) return;
        [depth, skin].forEach((material, i) => {
          const copy = new T.Mesh(each.geometry, material);
          copy.renderOrder = 1 + i;
          part.object.add(copy);
        });
      });
      part.position = new T.Vector3(...part.at.slice(0, 3));
      part.turn = new T.Quaternion(...part.at.slice(3));
      this.layer("other poses").add(part.object);
    }
    this.parts = [...this.parts, ...this.ghost];
    this.ghost = [];
  }

  makeCom({ body, line }) {
    const color = this.motion.com, r = 0.028 * body, origin = [0, 0, 0];
    this.ball = twice(solid([{ kind: "ball", points: [origin], radius: 0.02 * body }]), color);
    const group = this.layer("centre of mass");
    group.add(this.ball);
    this.ball.userData.label = () => comLabel(this.ball.position.toArray(), this.shift);
    if (!this.motion.ground) return;
    this.drop = twice(cylinder(line, 1).translate(0, 0, -0.5), color);
    const ring = { kind: "arc", points: [origin, [r, 0, 0]], axis: [0, 0, 1], angle: 2 * Math.PI, radius: 0.8 * line, heads: 0 };
    const cross = [[1.5 * r, 0, 0], [0, 1.5 * r, 0]].map((end) => ({ kind: "line", points: [end.map((x) => -x), end], radius: 0.8 * line }));
    this.foot = twice(solid([ring, ...cross]), color);
    group.add(this.drop, this.foot);
  }

  makeTrack({ name, color, points, layer, supports, normals, disks, aside }, { shaft }) {
    const T = MeshCat.THREE;
    const many = points > 1, isPush = layer === "pushes";
    const home = (of) => {
      if (!aside) return this.layer(of);
      const group = new T.Group();
      group.position.set(...this.aside);
      this.layer(of).add(group);
      return group;
    };
    const corners = home(many ? "corner forces" : layer);
    const ball = new T.SphereGeometry((many ? 1.4 : 2) * shaft, 20, 14);
    const dots = [], thin = [];
    for (let i = 0; i < points; i++) {
      if (many) thin.push(new Arrow(corners, color, 0.45 * shaft));
      if (isPush) continue;
      if (disks) {
        const round = (height) => twice(cylinder(4.2 * shaft, height * shaft, 28), color, 1, 0.45);
        dots.push({ disk: round(0.8), inner: round(1.1) });
        corners.add(dots[i].disk, dots[i].inner);
        continue;
      }
      const dot = { closed: twice(ball, color), open: twice(ball, color, 0.3, 0) };
      corners.add(dot.closed, dot.open);
      dots.push(dot);
    }
    const big = new Arrow(home(layer), color, shaft);
    // `force` [N] acts at `centre` [m], both in W; NaN where there is none.
    const track = { name, color, layer, supports, points, dots, thin, big, force: [0, 0, 0], centre: [NaN, NaN, NaN] };
    // Unit vectors from the surroundings to the robot, one for each frame, or one for all.
    track.normals = normals ? floats(normals) : new Float32Array(0);
    track.normal = null;
    if (disks) track.disks = { ...disks, codes: bytes(disks.codes), normals: floats(disks.normals), used: disks.used ? bytes(disks.used) : null };
    track.corners = [];
    big.node.userData.label = () => trackLabel(track, this.shift);
    thin.forEach((arrow, i) => { arrow.node.userData.label = () => cornerLabel(track, i, this.shift); });
    return track;
  }

  // The path of the centre of mass: pale where it goes, dark where it has been.
  path(points) {
    const T = MeshCat.THREE;
    const { body, line } = this.motion.sizes;
    const kept = [], along = [0];
    for (const [i, p] of points.entries()) {
      const here = new T.Vector3(...p);
      if (!kept.length || here.distanceTo(kept[kept.length - 1]) > 0.004 * body) kept.push(here);
      if (i) along.push(along[i - 1] + here.distanceTo(new T.Vector3(...points[i - 1])));
    }
    const length = along[along.length - 1];
    if (kept.length < 3 || length < 0.05 * body) return;
    const segments = Math.min(4 * kept.length, window.mostSegments || 3000), sides = 6;
    const curve = new T.CatmullRomCurve3(kept, false, "centripetal");
    curve.arcLengthDivisions = 2 * segments;
    const tube = new T.TubeGeometry(curve, segments, 1.2 * line, sides, false);
    const past = tube.clone();
    this.layer("centre of mass").add(twice(tube, this.motion.com, 0.2, 0.4), twice(past, this.motion.com, 0.9, 0.4));
    this.been = (position) => {
      const i = Math.min(Math.floor(position), along.length - 2);
      const share = (along[i] + (position - i) * (along[i + 1] - along[i])) / length;
      past.setDrawRange(0, Math.round(share * segments) * sides * 6);
    };
  }

  // Shows a row of the frame with this number.
  set(row, frame = 0) {
    const T = MeshCat.THREE;
    const { sizes, bodies } = this.motion;
    const turn = new T.Quaternion(), at = new T.Vector3();
    if (this.ghost.length) this.makeGhost();
    for (const part of [...this.parts, ...this.riders]) {
      const k = 7 * part.body;
      at.set(row[k], row[k + 1], row[k + 2]);
      turn.set(row[k + 3], row[k + 4], row[k + 5], row[k + 6]).normalize();
      part.object.position.copy(part.position).applyQuaternion(turn).add(at);
      part.object.quaternion.multiplyQuaternions(turn, part.turn);
    }
    for (const { path, body } of this.motion.shift ? [] : this.motion.lifts || []) {
      const object = this.stage.layers.object(path);
      if (object) object.position.set(row[7 * body], row[7 * body + 1], row[7 * body + 2]);
    }
    let k = 7 * bodies;
    const com = [row[k], row[k + 1], row[k + 2]];
    if (this.ball) this.showCom(com, sizes, this.floors.length ? this.floors[frame] : 0);
    k += 3;
    const loaded = [];
    for (const track of this.tracks) {
      const force = [0, 0, 0], centre = [0, 0, 0];
      let total = 0;
      const first = 3 * Math.min(frame, track.normals.length / 3 - 1);
      track.normal = first >= 0 ? track.normals.subarray(first, first + 3) : null;
      for (let i = 0; i < track.points; i++, k += 6) {
        const p = row.subarray(k, k + 3), f = row.subarray(k + 3, k + 6);
        const size = Math.hypot(...f);
        const there = Number.isFinite(p[0]);
        track.corners[i] = [p, f];
        const closed = there && size * sizes.metresPerNewton > 1e-5 * sizes.body;
        if (track.disks) this.showDisk(track, i, frame, p, there);
        else if (track.dots[i]) this.showDot(track.dots[i], p, there, closed);
        if (track.thin[i]) track.thin[i].set(p, f.map((x) => x * sizes.metresPerNewton), sizes.longest);
        if (!there) continue;
        if (closed && track.supports) loaded.push([...p]);
        total += size;
        for (let j = 0; j < 3; j++) {
          force[j] += f[j];
          centre[j] += size * p[j];
        }
      }
      track.centre = centre.map((x) => x / total);
      track.big.set(track.centre, force.map((x) => x * sizes.metresPerNewton), sizes.longest);
      track.force = force;
    }
    for (const element of this.elements) {
      element.set(row.subarray(k, k + 10));
      k += 10;
    }
    if (this.support) this.support.set(loaded);
    if (this.ball) this.start = this.start || com;  // the view was measured for where the robot starts
    if (this.follow && this.ball) {
      this.stage.carry([com[0] - this.start[0], com[1] - this.start[1], 0]);
    }
    this.stage.viewer.set_dirty();
  }

  // A glow where something touched a moment ago, `age` from 0 to 1; NaN: nothing did.
  glow(point, age, color) {
    this.halo.visible = age >= 0 && age < 1 && Number.isFinite(point[0]);
    if (!this.halo.visible) return;
    this.halo.position.set(...point);
    this.halo.scale.setScalar(this.motion.sizes.shaft * (3 + 7 * age));
    const { material } = this.halo.children[0];
    material.opacity = 0.6 * (1 - age);
    material.color.set(color);
    material.emissive.set(color).multiplyScalar(0.4);
  }

  // Above ground of this height.
  showCom(com, { lift }, floor) {
    this.ball.position.set(...com);
    if (!this.drop) return;
    this.drop.position.set(com[0], com[1], (com[2] + floor) / 2);
    this.drop.scale.z = Math.max(Math.abs(com[2] - floor), 1e-6);
    this.foot.position.set(com[0], com[1], floor + lift);
  }

  showDot(dot, p, there, closed) {
    for (const ball of [dot.closed, dot.open]) ball.position.set(p[0], p[1], p[2]);
    dot.closed.visible = there && closed;
    dot.open.visible = there && !closed;
  }

  // A disk on the surface, in the colour of the point's mode in the frame; as much of its area as friction is used, the rest pale.
  showDisk({ dots, disks, points }, i, frame, p, there) {
    const T = MeshCat.THREE;
    const { disk, inner } = dots[i], k = frame * points + i;
    const share = disks.used ? disks.used[k] / 255 : 1;
    disk.visible = there;
    inner.visible = there && share > 0 && share < 1;
    if (!there) return;
    const n = new T.Vector3(...disks.normals.subarray(3 * k, 3 * k + 3));
    disk.position.set(p[0], p[1], p[2]);
    if (n.lengthSq() > 0.5) disk.quaternion.setFromUnitVectors(new T.Vector3(0, 0, 1), n.normalize());
    inner.position.copy(disk.position);
    inner.quaternion.copy(disk.quaternion);
    inner.scale.set(Math.sqrt(share) || 1, Math.sqrt(share) || 1, 1);
    const color = new T.Color(theme.shade(disks.colors[disks.codes[k]])), pale = color.clone().lerp(new T.Color(named("--halo")), 0.6);
    [[disk, share < 1 ? pale : color], [inner, color]].forEach(([each, look]) => each.children.forEach(({ material }) => {
      material.color.copy(look);
      material.emissive.copy(look).multiplyScalar(0.3);
    }));
  }

  // Follow from where the robot is now, so that the picture does not jump.
  followFrom(on, row) {
    const k = 7 * this.motion.bodies;
    const [x, y, z] = this.stage.carried;
    this.follow = on;
    this.start = [row[k] - x, row[k + 1] - y, row[k + 2] - z];
  }

  remove() {
    for (const [name, group] of this.layers) this.stage.layers.members.get(name)?.delete(group);
    this.stage.viewer.delete_path([this.where]);
    this.stage.viewer.set_dirty();
  }
}

// The legend of a motion: who touches, how, and how hard at the present time.
class Cues {
  constructor(legend, motion) {
    this.motion = motion;
    if (motion.name) make("h2", "", legend, motion.name);
    const table = make("table", "", legend);
    const normals = motion.contacts.some((c) => c.normals);
    const row = (name, color) => {
      const line = table.insertRow();
      theme.paint(make("i", "", line.insertCell()), "background", color || "none");
      line.insertCell().textContent = name;
      const mode = line.insertCell(), normal = normals ? line.insertCell() : null, value = line.insertCell();
      mode.className = "mode";
      value.className = "value";
      if (normal) normal.className = "value";
      return { line, mode, normal, value };
    };
    if (motion.contacts.length) columnNames(table, normals ? ["normal", "|f|"] : ["|f|"], 3);
    this.contacts = motion.contacts.map((c) => row(c.name, c.color));
    const driven = motion.driven || {};
    this.others = motion.others.map((name) => (driven[name] ? row(`${name}: ${driven[name].joint}`, driven[name].color) : row(name, "")));
    // Below a push its vector.
    this.pushes = motion.pushes.map((c) => {
      const made = row(c.name, c.color), more = table.insertRow();
      more.insertCell();
      const vector = more.insertCell();
      vector.colSpan = normals ? 4 : 3;
      vector.className = "detail";
      return { ...made, vector, more, aside: c.aside };
    });
    const disks = motion.contacts.find((c) => c.disks);
    if (disks) {
      const line = table.insertRow(), cell = line.insertCell();
      cell.colSpan = normals ? 5 : 4;
      cell.className = "disks";
      cell.append("points: ");
      const seen = new Set(motion.contacts.flatMap((c) => (c.disks ? [...bytes(c.disks.codes)] : [])));
      disks.disks.modes.forEach((mode, i) => {
        if (!seen.has(i)) return;
        theme.paint(make("i", "", cell), "background", disks.disks.colors[i]);
        cell.append(`${mode} `);
      });
      if (motion.contacts.some((c) => c.disks && c.disks.used)) make("div", "", cell, "filled: share of the friction used");
    }
    if (motion.com) row("centre of mass", motion.com);
    for (const name of motion.terrains || []) row(name, motion.terrainColor);
    for (const [name, color] of motion.named || []) row(name, color);
    if (motion.ghost) row(motion.ghost.name, motion.ghost.color);
    for (const note of motion.shift ? [] : [motion.note, "Drag to turn, wheel to zoom, right button to shift."]) {
      if (note) makeNote(legend, note);
    }
    this.happened = make("p", "happened", legend);
    this.happened.hidden = !(motion.events && motion.events.length);
  }

  // Modes by their codes, and the tracks of Cast as it is now.
  set(codes, tracks) {
    const n = this.contacts.length;
    const newtons = (size) => `${Math.abs(size) < 5e-4 ? 0 : Number(size.toPrecision(3))} N`;
    this.contacts.forEach((cell, i) => {
      cell.mode.textContent = this.motion.words[codes[i]];
      const { force, normal } = tracks[i];
      cell.value.textContent = newtons(Math.hypot(...force));
      if (cell.normal) cell.normal.textContent = normal ? newtons(dot(force, normal)) : "";
      cell.line.className = codes[i] ? "" : "idle";
      tracks[i].mode = this.motion.words[codes[i]];
    });
    let shown = 0;
    this.others.forEach((cell, i) => {
      cell.mode.textContent = (this.motion.driven || {})[this.motion.others[i]] ? "driven" : this.motion.words[codes[n + i]];
      cell.line.hidden = !codes[n + i] || ++shown > 8;
    });
    this.pushes.forEach((cell, i) => {
      const size = Math.hypot(...tracks[n + i].force);
      cell.value.textContent = newtons(size);
      cell.vector.textContent = `(${tracks[n + i].force.map((x) => (Math.abs(x) < 5e-4 ? 0 : Number(x.toPrecision(3)))).join(", ")}) N`;
      cell.line.className = size ? "" : "idle";
      if (cell.aside) cell.line.hidden = cell.more.hidden = !size;
    });
  }
}
