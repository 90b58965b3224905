// Where the camera stands, and the link that keeps it: page.html#t=0.9&view=front&on=labels&off=cones
const VIEWS = ["start", "front", "side", "top"];
const LIFT = 0.1;  // a little from above: the ground is not an edge

class Views {
  constructor(stage) {
    this.stage = stage;
    this.name = "start";
    this.waiting = null;
    window.addEventListener("hashchange", () => this.open());
  }

  // Unit vectors in W from the robot to the camera; the front is where the toes point.
  direction(name) {
    const { front, direction } = this.stage.view;
    const [x, y] = front || [1, 0];
    return { front: [x, y, LIFT], side: [-y, x, LIFT], top: [-1e-4 * x, -1e-4 * y, 1] }[name] || direction;
  }

  go(name) {
    if (!VIEWS.includes(name)) return;
    this.name = name;
    this.stage.touched = false;
    this.stage.fit();
    this.keep();
    this.stage.toolbar.refresh();
  }

  // The camera where it was left: six numbers, its place and what it looks at, in W [m].
  camera() {
    const p = this.stage.viewer.camera.position, c = this.stage.viewer.controls.target;
    return [p.x, -p.z, p.y, c.x, -c.z, c.y].map((x) => Number(x.toFixed(3)));
  }

  place(numbers) {
    const { camera, controls } = this.stage.viewer;
    const [px, py, pz, cx, cy, cz] = numbers;
    camera.position.set(px, pz, -py);
    controls.target.set(cx, cz, -cy);
    controls.update();
    this.name = "";
    this.stage.touched = true;
    this.stage.viewer.set_dirty();
  }

  // The parts of the address that are understood.
  static asked(hash = window.location.hash) {
    const found = {};
    for (const part of hash.replace(/^#/, "").split("&")) {
      const [key, value = ""] = part.split("=");
      try {
        found[key] = decodeURIComponent(value);
      } catch {
        // A broken escape is no part of a link.
      }
    }
    return found;
  }

  // Opens the page as the address says; what it does not name stays.
  open() {
    const { view, camera, on, off, controls, follow, theme: page } = Views.asked();
    const { layers, player } = this.stage;
    for (const [names, wanted] of [[on, true], [off, false]]) {
      for (const name of (names || "").split(",")) if (name in layers.on) layers.on[name] = wanted;
    }
    document.body.classList.toggle("bare", controls === "off");
    if (player && (follow === "on" || follow === "off" || view === "follow")) player.setFollow(follow !== "off");
    layers.apply();
    if (page in LOOKS) theme.choose(page);
    const numbers = (camera || "").split(",").map(Number);
    if (VIEWS.includes(view)) this.name = view;
    if (numbers.length === 6 && numbers.every(Number.isFinite)) {
      this.stage.fit();
      this.place(numbers);
    } else if (VIEWS.includes(view)) {
      this.stage.touched = false;
      this.stage.fit();
    }
    this.stage.toolbar.refresh();
  }

  // The link of the page as it is shown.
  link() {
    const { layers, player, motion } = this.stage;
    const parts = [];
    if (player) parts.push(`t=${Number(player.t.toFixed(6))}`);
    if (!this.name) parts.push(`camera=${this.camera().join(",")}`);
    else if (this.name !== this.stage.view.opens) parts.push(`view=${this.name}`);
    for (const [word, wanted] of [["on", true], ["off", false]]) {
      const names = Object.keys(layers.first).filter((name) => layers.on[name] === wanted && layers.first[name] !== wanted);
      if (names.length) parts.push(`${word}=${names.map(encodeURIComponent).join(",")}`);
    }
    if (player && player.cast.follow !== player.motion.follow) parts.push(`follow=${player.cast.follow ? "on" : "off"}`);
    if (theme.asked) parts.push(`theme=${theme.asked}`);
    return parts.join("&");
  }

  // Writes the link into the address, when changes have come to rest.
  keep() {
    if (!document.body.dataset.ready || document.body.classList.contains("bare")) return;
    clearTimeout(this.waiting);
    this.waiting = setTimeout(() => {
      const { pathname, search } = window.location;
      const link = this.link();
      try {
        if (window.location.hash !== `#${link}`) window.history.replaceState(null, "", link ? `#${link}` : pathname + search);
      } catch {
        // A page inside of another, or from a file, may not be allowed to change its address.
      }
    }, 250);
  }
}
