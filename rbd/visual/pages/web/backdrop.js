// While only forces change, and the camera rests, a live page draws the robot once: its picture and its depth are kept, and each
// frame is that picture with the forces drawn into it. Without a graphics card a frame of Talos then takes a twentieth.

// Marks that stay where they are while the pose does; one that changes all the same is drawn in each frame from then on.
const STILL = /^(com|support|surfaces)\/|\/(patch|outline|ends|point)(_seen_through)?$/;

class Backdrop {
  constructor(stage) {
    this.stage = stage;
    this.viewer = stage.viewer;
    this.kept = new Map();  // key -> {color, target}, at most two: as it is, and tinted
    this.changes = 0;
    this.moving = new Set();  // paths of marks that have changed, of those that might have stayed
    this.last = "";
    this.frames = { full: 0, quick: 0 };
    this.full = this.viewer.render.bind(this.viewer);
    this.viewer.render = () => this.render();
    for (const name of ["set_object", "set_transform", "delete_path"]) {
      const given = this.viewer[name].bind(this.viewer);
      this.viewer[name] = (path, ...rest) => {
        const mark = path[1] === "marks" ? path.slice(2).join("/") : null;
        if (mark === null || (STILL.test(mark) && !this.moving.has(mark))) this.changes += 1;
        if (mark !== null && STILL.test(mark)) this.moving.add(mark);
        given(path, ...rest);
        if (mark !== null && name === "set_object") this.conceal(mark);
      };
    }
  }

  // A mark that the list of marks does not name yet is hidden until it does: it may be of a layer that is off.
  conceal(mark) {
    const { listed, on } = this.stage.layers;
    const known = listed.find(({ path }) => mark === path || mark === `${path}_seen_through`);
    const object = this.stage.layers.object(`marks/${mark}`);
    if (object) object.visible = Boolean(known) && on[known.layer] !== false;
  }

  // All that the kept picture depends on.
  key() {
    const { camera, renderer } = this.viewer;
    const size = renderer.getDrawingBufferSize(new MeshCat.THREE.Vector2());
    const { on } = this.stage.layers;
    const seen = [...camera.matrixWorld.elements, ...camera.projectionMatrix.elements].map((x) => x.toPrecision(9));
    return [this.changes, size.x, size.y, ...seen, JSON.stringify(on), Boolean(this.stage.tinted), theme.name].join(" ");
  }

  // Between the messages of one change nothing is drawn; if their end does not come, half a second later.
  hold(on) {
    clearTimeout(this.releases);
    this.held = on;
    if (on) this.releases = setTimeout(() => this.hold(false), 500);
    else this.viewer.set_dirty();
  }

  render() {
    if (this.held) return;
    const { viewer, stage } = this;
    viewer.controls.update();
    viewer.camera.updateProjectionMatrix();
    viewer.camera.updateMatrixWorld();
    const key = this.key();
    const rests = key === this.last && !stage.player;
    if (rests && !this.kept.has(key)) this.keep(key);
    if (rests) {
      this.quick(this.kept.get(key));
      stage.labels.place();
      stage.gauges.place();
    } else {
      this.frames.full += 1;
      this.full();
    }
    clearTimeout(this.soon);
    if (key !== this.last) this.soon = setTimeout(() => this.prepare(key), 300);
    this.last = key;
  }

  // When nothing has moved for a while: the pictures for both tints.
  prepare(key) {
    const { stage } = this;
    if (stage.player || !stage.live || !stage.live.open || key !== this.key()) return;
    if (!this.kept.has(key)) this.keep(key);
    if (this.kept.size > 1) return;
    this.soon = setTimeout(() => {
      if (key !== this.key()) return;
      const was = Boolean(stage.tinted);
      stage.tint(!was);
      this.keep(this.key());
      stage.tint(was);
    }, 50);
  }

  // What belongs to the kept picture: robot, other poses, ground, marks that stay. Lamps stay on.
  base() {
    const still = [];
    const walk = (node, path) => {
      for (const [name, child] of Object.entries(node.children)) {
        const here = path ? `${path}/${name}` : name;
        if (name === "<object>") continue;
        if (child.children["<object>"] && STILL.test(here) && !this.moving.has(here)) still.push(child.object);
        else walk(child, here);
      }
    };
    walk(this.viewer.scene_tree.find(["meshcat", "marks"]), "");
    const tree = this.viewer.scene_tree;
    const lamps = this.stage.lamps ? this.stage.lamps.children : [];
    return [
      ...["robot", "beside"].map((name) => tree.find(["meshcat", name]).object),
      ...still,
      ...lamps.filter((each) => !each.isLight && (each.isMesh || each.isLine)),
    ];
  }

  // Draws with some objects hidden.
  without(hidden, draw) {
    const seen = hidden.filter((each) => each.visible);
    for (const each of seen) each.visible = false;
    try {
      draw();
    } finally {
      for (const each of seen) each.visible = true;
    }
  }

  // The rest of the scene: marks, and whatever else moves.
  others(base) {
    const kept = new Set(base);
    const found = [];
    const look = (object) => {
      for (const child of object.children) {
        if (kept.has(child) || child.isLight) continue;
        if (base.some((each) => child.getObjectById(each.id)) || child.children.some((each) => each.isLight)) look(child);
        else if (!(child.parent && child.parent.isLight)) found.push(child);
      }
    };
    look(this.viewer.scene);
    return found;
  }

  keep(key) {
    const T = MeshCat.THREE;
    const { renderer, scene, camera } = this.viewer;
    const size = renderer.getDrawingBufferSize(new T.Vector2());
    const base = this.base(), others = this.others(base);
    const color = new T.FramebufferTexture(size.x, size.y);
    this.without(others, () => this.full());
    renderer.copyFramebufferToTexture(color);
    const target = new T.WebGLRenderTarget(size.x, size.y, { minFilter: T.NearestFilter, magFilter: T.NearestFilter });
    target.depthTexture = new T.DepthTexture(size.x, size.y, T.UnsignedIntType);
    // What writes no depth in the picture writes none here.
    const thin = [];
    for (const each of base) each.traverse((o) => { if (!o.isMesh || !o.material.depthWrite) thin.push(o); });
    const hide = [...others, ...thin.filter((o) => o.isMesh || o.isLine)];
    const { background } = scene, shadows = renderer.shadowMap.autoUpdate;
    this.without(hide, () => {
      scene.background = null;
      scene.overrideMaterial = new T.MeshBasicMaterial({ side: T.DoubleSide });
      renderer.shadowMap.autoUpdate = false;
      renderer.setRenderTarget(target);
      renderer.clear();
      renderer.render(scene, camera);
      renderer.setRenderTarget(null);
      scene.overrideMaterial.dispose();
    });
    Object.assign(scene, { background, overrideMaterial: null });
    renderer.shadowMap.autoUpdate = shadows;
    while (this.kept.size > 1) this.forget(this.kept.keys().next().value);
    this.kept.set(key, { color, target });
  }

  forget(key) {
    const { color, target } = this.kept.get(key);
    color.dispose();
    target.depthTexture.dispose();
    target.dispose();
    this.kept.delete(key);
  }

  quick({ color, target }) {
    const T = MeshCat.THREE;
    const { viewer } = this;
    const { renderer, scene, camera } = viewer;
    if (!this.screen) {
      const material = new T.ShaderMaterial({
        uniforms: { color: { value: null }, depth: { value: null } },
        vertexShader: "varying vec2 at; void main() { at = 0.5 * position.xy + 0.5; gl_Position = vec4(position.xy, 0.0, 1.0); }",
        fragmentShader:
          "uniform sampler2D color, depth; varying vec2 at;" +
          "void main() { gl_FragColor = vec4(texture2D(color, at).rgb, 1.0); gl_FragDepthEXT = texture2D(depth, at).r; }",
        depthFunc: T.AlwaysDepth,
        toneMapped: false,
      });
      const quad = new T.Mesh(new T.PlaneGeometry(2, 2), material);
      quad.frustumCulled = false;
      this.screen = new T.Scene();
      this.screen.add(quad);
      this.uniforms = material.uniforms;
    }
    this.frames.quick += 1;
    this.uniforms.color.value = color;
    this.uniforms.depth.value = target.depthTexture;
    const { background } = scene, shadows = renderer.shadowMap.autoUpdate;
    renderer.shadowMap.autoUpdate = false;
    renderer.autoClear = false;
    renderer.clear();
    renderer.render(this.screen, camera);
    scene.background = null;
    this.without(this.base(), () => renderer.render(scene, camera));
    scene.background = background;
    renderer.autoClear = true;
    renderer.shadowMap.autoUpdate = shadows;
    viewer.needs_render = false;
  }
}
