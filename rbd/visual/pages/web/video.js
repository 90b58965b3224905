// Frames of a video. A page draws each picture as well as it can; here each costs milliseconds on a machine without a graphics
// card: points of meshes that fall into one pixel are merged, light is computed at them, edges are smoothed afterwards, and
// shadows are the robot's projection on level ground, on terrain those of the page, coarser. This script runs in the page of a
// motion, and no page carries it.
const MOST_TRIANGLES = 36000, MOST_SHADOW_TRIANGLES = 8000, SHADOW_PIXELS = 1024;

class Video {
  // Pictures of `width` x `height`; the window may be larger or smaller, and what it lays out is scaled.
  constructor(stage, { width, height, quality, speed }) {
    Object.assign(this, { stage, width, height, quality, speed });
    const { viewer, player } = stage;
    const T = MeshCat.THREE;
    player.play(false);
    player.footer.hidden = true;
    viewer.render = () => {};  // the page's own loop rests
    this.renderer = viewer.renderer;
    this.renderer.shadowMap.enabled = !(stage.view.cell > 0);  // terrain takes shadows wherever it is
    this.renderer.setSize(width, height, false);
    this.target = new T.WebGLRenderTarget(width, height, { stencilBuffer: true, minFilter: T.LinearFilter });
    this.canvas = Object.assign(document.createElement("canvas"), { width, height });
    this.paper = this.canvas.getContext("2d", { alpha: false, willReadFrequently: true });
    this.clock = document.createElement("div");
    this.clock.style.cssText = "position: absolute; right: 14px; bottom: 12px; padding: 3px 10px; border-radius: 6px; font-size: 15px;"
      + "background: rgb(var(--panel) / 0.86); border: 1px solid var(--edge); white-space: nowrap";
    document.body.append(this.clock);
    this.painter = new Painter(this.paper);
    // Nobody can turn a video.
    for (const each of stage.legend.querySelectorAll("p.turn")) each.remove();
    stage.fit();
    viewer.scene.updateMatrixWorld(true);
    this.simplify();
    this.smooth = new Smooth(T, width, height);
  }

  // Coarse meshes in cheap materials, and their shadows.
  simplify() {
    const T = MeshCat.THREE;
    const { viewer, view, lamps } = this.stage;
    const { camera, controls } = viewer;
    const pixel = 2 * camera.position.distanceTo(controls.target) * Math.tan((Math.PI / 360) * camera.fov) / this.height;
    const bodies = [];
    for (const path of ["robot", "second"]) {
      viewer.scene_tree.find(["meshcat", path]).object.traverse((each) => { if (each.isMesh) bodies.push(each); });
    }
    const light = lightOf(T, lamps);
    const materials = new Map();
    const solid = bodies.filter(({ material }) => material.isMaterial && material.type === "MeshPhongMaterial" && material.opacity === 1);
    for (const body of solid) {
      const { uuid } = body.material;
      if (!materials.has(uuid)) materials.set(uuid, litAtPoints(T, body.material, light));
      body.material = materials.get(uuid);
    }
    const coarse = coarser(T, bodies, 1.3 * pixel, 6 * pixel, MOST_TRIANGLES);
    const dark = coarser(T, solid, 3 * pixel, 20 * pixel, MOST_SHADOW_TRIANGLES);
    this.shades = [];
    if (view.cell > 0) this.shade(T, solid, dark, light.directions[0], -0.0005 * view.radius);
    lamps.traverse(({ isDirectionalLight, castShadow, shadow }) => {
      if (!isDirectionalLight || !castShadow) return;
      shadow.mapSize.set(SHADOW_PIXELS, SHADOW_PIXELS);
      if (shadow.map) shadow.map.dispose();
      shadow.map = null;
    });
    // What a second motion shares with the first is made coarse with it.
    viewer.scene.traverse((each) => { if (each.isMesh && coarse.has(each.geometry)) each.geometry = coarse.get(each.geometry); });
    const rounds = new Map();
    viewer.scene.traverse((each) => {
      if (!each.isMesh || each.geometry.type !== "SphereGeometry") return;
      const { radius, widthSegments } = each.geometry.parameters;
      if (widthSegments <= 12 || radius * each.scale.x > 6 * pixel) return;
      if (!rounds.has(radius)) rounds.set(radius, new T.SphereGeometry(radius, 10, 7));
      each.geometry = rounds.get(radius);
    });
  }

  // Every solid body once more, flattened along the light on the ground; each pixel is darkened once.
  shade(T, solid, dark, toLight, height) {
    const { scene } = this.stage.viewer;
    if (!toLight || toLight.y < 0.05) return;
    const [a, c] = [toLight.x / toLight.y, toLight.z / toLight.y];
    const flat = new T.Matrix4().set(1, -a, 0, a * height, 0, 0, 0, height, 0, -c, 1, c * height, 0, 0, 0, 1);
    const black = new T.MeshBasicMaterial({
      color: 0, opacity: 0.2, transparent: true, depthWrite: false, side: T.DoubleSide,
      stencilWrite: true, stencilFunc: T.EqualStencilFunc, stencilRef: 0, stencilZPass: T.IncrementStencilOp,
    });
    this.flat = flat;
    this.shadow = new T.Group();
    this.shadow.matrixAutoUpdate = false;
    this.shades = solid.map((body) => {
      const shade = new T.Mesh(dark.get(body.geometry) || body.geometry, black);
      shade.matrixAutoUpdate = shade.frustumCulled = false;
      shade.renderOrder = -1;
      this.shadow.add(shade);
      return [body, shade];
    });
    scene.add(this.shadow);
    this.stage.lamps.traverse((each) => { if (each.material && each.material.type === "ShadowMaterial") each.visible = false; });
  }

  draw(t) {
    const { viewer, player, labels } = this.stage;
    const { renderer, paper } = this;
    player.seek(t);
    viewer.controls.update();
    place(viewer.scene);
    for (const [body, shade] of this.shades) {
      shade.visible = seen(body);
      shade.matrixWorld.multiplyMatrices(this.flat, body.matrixWorld);
    }
    viewer.scene.matrixWorldAutoUpdate = false;
    renderer.setRenderTarget(this.target);
    renderer.render(viewer.scene, viewer.camera);
    renderer.setRenderTarget(null);
    this.smooth.render(renderer, this.target.texture);
    labels.place();
    paper.resetTransform();
    paper.drawImage(renderer.domElement, 0, 0);
    paper.scale(this.width / window.innerWidth, this.height / window.innerHeight);
    this.clock.textContent = `${player.t.toFixed(player.digits)} s${this.speed === 1 ? "" : ` at ${this.speed}×`}`;
    this.painter.paint(this.stage.legend);
    this.painter.paint(this.clock);
    if (!labels.tags.hidden) this.painter.paint(labels.tags);
  }

  // The pictures at some times, as JPEG in base64.
  frames(times) {
    return times.map((t) => {
      this.draw(t);
      return this.canvas.toDataURL("image/jpeg", this.quality).slice("data:image/jpeg;base64,".length);
    });
  }
}

// Where everything visible is in the world; three.js does it for what is hidden, too, which is most of it.
function place(object) {
  if (!object.visible) return;
  if (object.matrixAutoUpdate) object.updateMatrix();
  if (object.parent) object.matrixWorld.multiplyMatrices(object.parent.matrixWorld, object.matrix);
  else object.matrixWorld.copy(object.matrix);
  for (const child of object.children) place(child);
}

// The light of the stage in three's world: {sky, ground, up, directions, colors}.
function lightOf(T, lamps) {
  const found = { sky: new T.Color(0), ground: new T.Color(0), up: new T.Vector3(0, 1, 0), directions: [], colors: [] };
  lamps.updateMatrixWorld(true);
  lamps.traverse((each) => {
    const color = each.isLight && each.color.clone().multiplyScalar(each.intensity / FULL);
    const place = new T.Vector3().setFromMatrixPosition(each.matrixWorld);
    if (each.isHemisphereLight) {
      Object.assign(found, { sky: color, ground: each.groundColor.clone().multiplyScalar(each.intensity / FULL), up: place.normalize() });
    } else if (each.isDirectionalLight) {
      found.directions.push(place.sub(new T.Vector3().setFromMatrixPosition(each.target.matrixWorld)).normalize());
      found.colors.push(color);
    }
  });
  return found;
}

// A material like Phong's whose light is computed at the points of a mesh, on both of its sides.
function litAtPoints(T, { color, specular, shininess }, { sky, ground, up, directions, colors }) {
  const n = directions.length;
  return new T.ShaderMaterial({
    side: T.DoubleSide,
    uniforms: {
      base: { value: color }, gloss: { value: specular }, shine: { value: shininess },
      sky: { value: sky }, ground: { value: ground }, up: { value: up }, to: { value: directions }, lamp: { value: colors },
    },
    vertexShader: `
      uniform vec3 base, gloss, sky, ground, up, to[${n}], lamp[${n}];
      uniform float shine;
      varying vec3 front, back;
      vec3 lit(vec3 n, vec3 eye) {
        vec3 sum = base * mix(ground, sky, 0.5 + 0.5 * dot(n, up));
        for (int i = 0; i < ${n}; i++) {
          float facing = max(0.0, dot(n, to[i]));
          float mirrored = pow(max(0.0, dot(n, normalize(to[i] + eye))), shine);
          sum += lamp[i] * facing * (base + gloss * 0.25 * (0.5 * shine + 1.0) * mirrored);
        }
        return sum;
      }
      void main() {
        vec4 at = modelMatrix * vec4(position, 1.0);
        vec3 n = normalize(mat3(modelMatrix) * normal), eye = normalize(cameraPosition - at.xyz);
        front = lit(n, eye);
        back = lit(-n, eye);
        gl_Position = projectionMatrix * viewMatrix * at;
      }`,
    fragmentShader: `
      varying vec3 front, back;
      void main() { gl_FragColor = vec4(gl_FrontFacing ? front : back, 1.0); }`,
  });
}

// {geometry: a coarser one}: the points in each cell of a grid become one. The cell grows until few enough triangles are left.
function coarser(T, meshes, cell, largest, most) {
  const geometries = [...new Set(meshes.map(({ geometry }) => geometry))];
  const size = (geometry) => (geometry.index || geometry.attributes.position).count / 3;
  for (;;) {
    const found = new Map(geometries.map((geometry) => [geometry, size(geometry) < 200 ? geometry : merged(T, geometry, cell)]));
    const total = meshes.reduce((sum, { geometry }) => sum + size(found.get(geometry)), 0);
    if (total <= most || cell >= largest) return found;
    cell = Math.min(largest, cell * Math.max(1.15, Math.sqrt(total / most)));
  }
}

// Points of one cell that look about the same way become one, so that edges stay sharp.
function merged(T, geometry, cell) {
  const { position, normal } = geometry.attributes;
  if (!normal) geometry.computeVertexNormals();
  const p = position.array, d = geometry.attributes.normal.array, n = position.count;
  const index = geometry.index ? geometry.index.array : Array.from({ length: n }, (_, i) => i);
  const places = new Map(), corners = new Map(), place = new Int32Array(n), corner = new Int32Array(n);
  const sums = [], turns = [], of = [];
  for (let i = 0; i < n; i++) {
    const [x, y, z] = [p[3 * i], p[3 * i + 1], p[3 * i + 2]];
    const key = (Math.round(x / cell) * 73856093) ^ (Math.round(y / cell) * 19349663) ^ (Math.round(z / cell) * 83492791);
    let j = places.get(key);
    if (j === undefined) {
      places.set(key, (j = sums.length / 4));
      sums.push(0, 0, 0, 0);
    }
    sums[4 * j] += x, sums[4 * j + 1] += y, sums[4 * j + 2] += z, sums[4 * j + 3] += 1;
    place[i] = j;
    const side = (Math.round(1.2 * d[3 * i]) + 1) * 9 + (Math.round(1.2 * d[3 * i + 1]) + 1) * 3 + Math.round(1.2 * d[3 * i + 2]) + 1;
    const name = 27 * j + side;
    let k = corners.get(name);
    if (k === undefined) {
      corners.set(name, (k = of.length));
      of.push(j);
      turns.push(0, 0, 0);
    }
    turns[3 * k] += d[3 * i], turns[3 * k + 1] += d[3 * i + 1], turns[3 * k + 2] += d[3 * i + 2];
    corner[i] = k;
  }
  // The point nearest to their mean stands for those of a cell: the mean itself lies below a round surface, and what is inside
  // would come through.
  const nearest = new Int32Array(sums.length / 4), least = new Float64Array(sums.length / 4).fill(Infinity);
  for (let i = 0; i < n; i++) {
    const j = place[i];
    const away = [0, 1, 2].reduce((sum, m) => sum + (p[3 * i + m] - sums[4 * j + m] / sums[4 * j + 3]) ** 2, 0);
    if (away < least[j]) [least[j], nearest[j]] = [away, i];
  }
  const known = new Set(), kept = [];
  for (let i = 0; i < index.length; i += 3) {
    const [a, b, c] = [index[i], index[i + 1], index[i + 2]];
    const [u, v, w] = [place[a], place[b], place[c]];
    if (u === v || v === w || w === u) continue;
    const low = Math.min(u, v, w), high = Math.max(u, v, w);
    const name = (low * 2097152 + (u + v + w - low - high)) * 2097152 + high;
    if (known.has(name)) continue;
    known.add(name);
    kept.push([corner[a], corner[b], corner[c]]);
  }
  const points = new Float32Array(3 * of.length), normals = new Float32Array(3 * of.length);
  of.forEach((j, k) => {
    const size = Math.hypot(turns[3 * k], turns[3 * k + 1], turns[3 * k + 2]) || 1;
    for (let m = 0; m < 3; m++) {
      points[3 * k + m] = p[3 * nearest[j] + m];
      normals[3 * k + m] = turns[3 * k + m] / size;
    }
  });
  // A triangle that turned over shows its front where its points look.
  const edge = (from, to) => [0, 1, 2].map((m) => points[3 * to + m] - points[3 * from + m]);
  const turned = kept.flatMap(([a, b, c]) => {
    const [x, y] = [edge(a, b), edge(a, c)];
    const across = [x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]];
    const agrees = across.reduce((sum, value, m) => sum + value * (normals[3 * a + m] + normals[3 * b + m] + normals[3 * c + m]), 0);
    return agrees < 0 ? [a, c, b] : [a, b, c];
  });
  const made = new T.BufferGeometry();
  made.setAttribute("position", new T.BufferAttribute(points, 3));
  made.setAttribute("normal", new T.BufferAttribute(normals, 3));
  made.setIndex(turned);
  return made;
}

// Smooths steps along edges of a finished picture: where neighbours differ in lightness, it blends along the edge (FXAA).
class Smooth {
  constructor(T, width, height) {
    this.scene = new T.Scene();
    this.camera = new T.OrthographicCamera(-1, 1, 1, -1, 0, 1);
    this.picture = { value: null };
    const material = new T.ShaderMaterial({
      depthTest: false, depthWrite: false,
      uniforms: { picture: this.picture, step: { value: new T.Vector2(1 / width, 1 / height) } },
      glslVersion: T.GLSL3,
      vertexShader: "void main() { gl_Position = vec4(position.xy, 0.0, 1.0); }",
      fragmentShader: `
        uniform sampler2D picture;
        uniform vec2 step;
        out vec4 color;
        const vec3 eye = vec3(0.299, 0.587, 0.114);
        vec3 at(vec2 p) { return texture(picture, p).rgb; }
        void main() {
          ivec2 pixel = ivec2(gl_FragCoord.xy), last = ivec2(1.0 / step) - 1;
          ivec2 less = max(pixel - 1, ivec2(0)), more = min(pixel + 1, last);
          vec3 here = texelFetch(picture, pixel, 0).rgb;
          float m = dot(here, eye), a = dot(texelFetch(picture, less, 0).rgb, eye), d = dot(texelFetch(picture, more, 0).rgb, eye);
          float b = dot(texelFetch(picture, ivec2(more.x, less.y), 0).rgb, eye);
          float c = dot(texelFetch(picture, ivec2(less.x, more.y), 0).rgb, eye);
          float low = min(m, min(min(a, b), min(c, d))), high = max(m, max(max(a, b), max(c, d)));
          color = vec4(here, 1.0);
          if (high - low < max(0.03, 0.06 * high)) return;
          vec2 along = vec2(c + d - a - b, a + c - b - d);
          float least = 1.0 / (min(abs(along.x), abs(along.y)) + max(0.03125 * (a + b + c + d), 0.0078));
          along = clamp(along * least, -8.0, 8.0) * step;
          vec2 p = gl_FragCoord.xy * step;
          vec3 near = 0.5 * (at(p - along / 6.0) + at(p + along / 6.0));
          vec3 far = 0.5 * near + 0.25 * (at(p - 0.5 * along) + at(p + 0.5 * along));
          float f = dot(far, eye);
          color.rgb = f < low || f > high ? near : far;
        }`,
    });
    const quad = new T.Mesh(new T.PlaneGeometry(2, 2), material);
    quad.frustumCulled = false;
    this.scene.add(quad);
  }

  render(renderer, texture) {
    this.picture.value = texture;
    renderer.render(this.scene, this.camera);
  }
}

// Paints HTML on a canvas as the browser lays it out: backgrounds, borders, corners and text; that is all a legend has.
class Painter {
  constructor(paper) {
    this.paper = paper;
  }

  paint(node) {
    const style = getComputedStyle(node);
    if (style.display === "none" || style.visibility === "hidden") return;
    const { paper } = this;
    paper.save();
    paper.globalAlpha *= Number(style.opacity);
    const box = node.getBoundingClientRect();
    this.box(box, style);
    if (style.overflowX !== "visible") {
      paper.beginPath();
      paper.rect(box.left, box.top, box.width, box.height);
      paper.clip();
    }
    for (const child of node.childNodes) {
      if (child.nodeType === Node.ELEMENT_NODE) this.paint(child);
      else if (child.nodeType === Node.TEXT_NODE && child.data.trim()) this.text(child, style);
    }
    paper.restore();
  }

  box({ left, top, width, height }, style) {
    const { paper } = this;
    const border = parseFloat(style.borderTopWidth), half = border / 2;
    const clear = /^rgba\(.*, 0\)$|^transparent$/.test(style.backgroundColor);
    if ((clear && !border) || !width || !height) return;
    paper.beginPath();
    const radius = Math.max(0, Math.min(parseFloat(style.borderTopLeftRadius) || 0, width / 2, height / 2) - half);
    paper.roundRect(left + half, top + half, width - border, height - border, radius);
    if (!clear) {
      paper.fillStyle = style.backgroundColor;
      paper.fill();
    }
    if (border && style.borderTopStyle !== "none") {
      paper.strokeStyle = style.borderTopColor;
      paper.lineWidth = border;
      paper.stroke();
    }
  }

  text(node, style) {
    const { paper } = this;
    const range = document.createRange();
    paper.font = `${style.fontStyle} ${style.fontWeight} ${style.fontSize} ${style.fontFamily}`;
    paper.fillStyle = style.color;
    const { fontBoundingBoxAscent: up, fontBoundingBoxDescent: down } = paper.measureText("x");
    for (const [words, box] of this.lines(node, range)) {
      paper.fillText(words, box.left, box.top + (box.height - up - down) / 2 + up);
    }
  }

  // The lines of a text as they are broken: [text, box].
  lines(node, range) {
    range.selectNodeContents(node);
    const whole = range.getClientRects();
    if (whole.length === 1) return [[node.data.replace(/\s+/g, " ").trim(), whole[0]]];
    const lines = [];
    for (const found of node.data.matchAll(/\S+/g)) {
      range.setStart(node, found.index);
      range.setEnd(node, found.index + found[0].length);
      const box = range.getBoundingClientRect();
      const last = lines[lines.length - 1];
      if (last && Math.abs(last[1].top - box.top) < 2) last[0] += ` ${found[0]}`;
      else lines.push([found[0], box]);
    }
    return lines;
  }
}
