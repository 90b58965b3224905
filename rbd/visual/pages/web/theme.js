// Light or dark: as the reader's system has it, until a button or the address says otherwise.
const LOOKS = {
  light: { top: [0.99, 0.99, 1.0], bottom: [0.86, 0.89, 0.92], grid: [0x9aa5b1, 0xcbd2d9], shadow: 0.22 },
  dark: { top: [0.17, 0.2, 0.23], bottom: [0.25, 0.29, 0.33], grid: [0x7d8a96, 0x55616d], shadow: 0.45 },
};
const LEAST_LIGHT = 0.25;  // relative luminance of a colour on dark ground: 4.5 times as bright as a panel, by WCAG's measure
const BLACK = 0.03, WHITE = "#f2f5f7";  // what is darker than that on a light page is white on a dark one
const GROUND_LEFT = 0.4;  // of the light of terrain on a dark page

class Theme {
  constructor() {
    this.asked = "";
    this.stage = null;
    this.system = window.matchMedia("(prefers-color-scheme: dark)");
    this.system.addEventListener("change", () => this.apply());
    this.apply();
  }

  get name() {
    return this.asked || (this.system.matches ? "dark" : "light");
  }

  get look() {
    return LOOKS[this.name];
  }

  // "light", "dark", or "" as the system has it.
  choose(asked) {
    this.asked = asked;
    this.apply();
  }

  toggle() {
    const other = this.name === "dark" ? "light" : "dark";
    this.choose(other === (this.system.matches ? "dark" : "light") ? "" : other);
  }

  // A colour as it is drawn: on a dark page mixed with white until it can be read there, black as white.
  shade(color) {
    if (this.name === "light" || !/^#[0-9a-f]{6}$/i.test(color)) return color;
    let parts = [1, 3, 5].map((i) => parseInt(color.slice(i, i + 2), 16));
    if (luminance(parts) < BLACK) return WHITE;
    while (luminance(parts) < LEAST_LIGHT) parts = parts.map((part) => part + 0.08 * (255 - part));
    return `#${parts.map((part) => Math.round(part).toString(16).padStart(2, "0")).join("")}`;
  }

  // Gives an element a colour of the scene, as "background" or "color", which follows the theme.
  paint(element, property, color) {
    element.dataset.given = `${property} ${color}`;
    element.style.setProperty(property, this.shade(color));
    return element;
  }

  // Gives the material of a mark its colour, which follows the theme; what it gives off is a share of it.
  material(made, color, glow = 0, ground = false) {
    made.userData.given = { color, glow, ground };
    return this.recolor(made);
  }

  recolor(made) {
    const { color, glow, ground } = made.userData.given;
    made.color.set(ground ? color : this.shade(color));
    if (ground && this.name === "dark") made.color.multiplyScalar(GROUND_LEFT);
    if (glow) made.emissive.copy(made.color).multiplyScalar(glow);
    return made;
  }

  apply() {
    const { stage, look } = this;
    document.documentElement.dataset.theme = this.name;
    for (const each of document.querySelectorAll("[data-given]")) {
      const [property, color] = each.dataset.given.split(" ");
      this.paint(each, property, color);
    }
    if (!stage) return;
    stage.viewer.set_background(look.top, look.bottom);
    stage.viewer.scene.traverse(({ material }) => { if (material && material.userData && material.userData.given) this.recolor(material); });
    stage.relight();
    stage.toolbar.refresh();
    if (stage.player) {
      stage.player.seek(stage.player.t);
      if (stage.player.curves) stage.player.curves.redraw();
    }
    stage.viewer.set_dirty();
  }
}

// Relative luminance of red, green and blue from 0 to 255, by WCAG.
function luminance(parts) {
  const [r, g, b] = parts.map((part) => part / 255).map((s) => (s <= 0.04045 ? s / 12.92 : ((s + 0.055) / 1.055) ** 2.4));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}

const theme = new Theme();
