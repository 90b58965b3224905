// A tree of objects in three.js, a camera to turn, and two commands of Meshcat's protocol: set_transform and delete.
import {
  ColorManagement, DataTexture, LinearFilter, LinearSRGBColorSpace, PCFShadowMap, PerspectiveCamera, Scene, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { unpacked } from "./msgpack.js";
import { SceneNode } from "./tree.js";

export * as THREE from "./three.js";

// Colours are what the screen gets: light is added to them as they are, without a detour over linear ones.
ColorManagement.enabled = false;

export class Viewer {
  constructor(pane) {
    this.pane = pane;
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.outputColorSpace = LinearSRGBColorSpace;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    this.renderer.setTransparentSort((a, b) => this.order(a, b));
    this.renderer.setPixelRatio(window.devicePixelRatio);
    pane.append(this.renderer.domElement);
    // The scene is z up; the camera is not in it, and y up.
    this.scene = new Scene();
    this.scene.rotateX(-Math.PI / 2);
    this.scene_tree = new SceneNode(this.scene);
    this.camera = new PerspectiveCamera(75, 1, 0.01, 100);
    this.camera.position.set(3, 1, 0);
    this.controls = new OrbitControls(this.camera, pane);
    for (const event of ["start", "change"]) this.controls.addEventListener(event, () => this.set_dirty());
    this.set_dirty();
    for (const event of ["load", "resize"]) window.addEventListener(event, () => this.set_3d_pane_size());
    requestAnimationFrame(() => this.set_3d_pane_size());
    this.animate();
  }

  // Of translucent objects the one farther away is drawn first, by their origins. Marks all have that of W: of those at one place
  // the latest is on top, from wherever one looks. By the middles of objects, as three.js has it, they would change with the camera.
  order(a, b) {
    return a.groupOrder - b.groupOrder || a.renderOrder - b.renderOrder || this.nearness(a) - this.nearness(b) || a.id - b.id;
  }

  nearness({ object }) {
    const { elements: to } = this.camera.matrixWorldInverse, { elements: at } = object.matrixWorld;
    return to[2] * at[12] + to[6] * at[13] + to[10] * at[14];
  }

  set_dirty() {
    this.needs_render = true;
  }

  // Behind the scene: colours [r, g, b] from 0 to 1 at the top and at the bottom, and between them all that lie between.
  set_background(top, bottom) {
    const pixels = [bottom, top].flatMap((color) => [...color, 1].map((x) => Math.trunc(255 * x)));
    const texture = new DataTexture(new Uint8Array(pixels), 1, 2);
    texture.minFilter = texture.magFilter = LinearFilter;
    // From the middle of one pixel to that of the other.
    texture.matrixAutoUpdate = false;
    texture.matrix.set(0.5, 0, 0.25, 0, 0.5, 0.25, 0, 0, 1);
    texture.needsUpdate = true;
    this.scene.background = texture;
    this.set_dirty();
  }

  set_3d_pane_size(width = this.pane.offsetWidth, height = window.innerHeight) {
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height);
    this.set_dirty();
  }

  render() {
    this.controls.update();
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.scene, this.camera);
    this.needs_render = false;
  }

  animate() {
    requestAnimationFrame(() => this.animate());
    if (this.needs_render) this.render();
  }

  set_transform(path, matrix) {
    this.scene_tree.find(path).set_transform(matrix);
  }

  set_object(path, object) {
    this.scene_tree.find([...path, "<object>"]).set_object(object);
  }

  delete_path(path) {
    this.scene_tree.delete(path);
  }

  // A command as Python packs it, see recorder.py.
  handle_command_bytearray(data) {
    const { type, path, matrix } = unpacked(data);
    const names = path.split("/").filter((name) => name);
    if (type === "set_transform") this.set_transform(names, matrix);
    else if (type === "delete") this.delete_path(names);
    else throw new Error(`The viewer has no command ${type}.`);
    this.set_dirty();
  }
}
