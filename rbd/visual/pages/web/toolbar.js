// Small buttons at the top: views, layers, help; and their keys.
class Toolbar {
  constructor(stage) {
    this.stage = stage;
    this.node = make("nav", "chrome toolbar", document.body);
    this.node.setAttribute("aria-label", "View");
    this.row = make("div", "row", this.node);
    this.views = this.viewButtons(make("span", "views", this.row));
    this.panels = [];
    this.panel("layers", "Layers", "l");
    this.panel("?", "Help", "?", "help");
    this.layers = this.panels[0].node;
    this.layers.setAttribute("role", "group");
    this.layers.setAttribute("aria-label", "Layers");
    this.help = this.panels[1].node;
    this.help.setAttribute("role", "dialog");
    this.help.setAttribute("aria-label", "Help");
    this.dark = make("button", "opener", this.row, "◐");
    this.dark.type = "button";
    this.dark.onclick = () => { this.darken(); this.dark.blur(); };
    this.boxes = new Map();
    this.opened = "";
    window.addEventListener("keydown", (event) => this.key(event), { capture: true });
    window.addEventListener("resize", () => this.refresh());
    stage.pane.addEventListener("pointerdown", () => this.open(""));
  }

  // A button at the end of the row, and the panel that it opens.
  panel(text, name, key, panel = text) {
    const button = make("button", "opener", this.row, text);
    button.type = "button";
    button.title = `${name} (${key})`;
    button.setAttribute("aria-label", name);
    button.setAttribute("aria-expanded", "false");
    button.setAttribute("aria-controls", panel);
    button.onclick = () => this.open(this.opened === panel ? "" : panel);
    const node = Object.assign(make("div", "panel", this.node), { id: panel, hidden: true });
    this.panels.push({ panel, button, node, key });
    return node;
  }

  // Where the row of buttons ends [pixels]; 0 where there are none.
  bottom() {
    return this.row.offsetHeight ? this.node.offsetTop + this.row.offsetHeight : 0;
  }

  viewButtons(parent) {
    return VIEWS.map((name, i) => {
      const button = make("button", "view", parent, name);
      button.type = "button";
      button.title = `${name === "start" ? "As the page opened" : `From the ${name}`} (${i})`;
      button.onclick = () => { this.stage.views.go(name); button.blur(); };
      return { name, button };
    });
  }

  open(panel) {
    this.opened = panel;
    if (panel === "help") this.writeHelp();
    for (const each of this.panels) {
      each.node.hidden = each.panel !== panel;
      each.button.setAttribute("aria-expanded", String(each.panel === panel));
    }
    this.refresh();
  }

  // What the page is now: pressed buttons, ticked boxes, and where there is room.
  refresh() {
    const { stage } = this;
    const { legend, views } = stage;
    this.node.hidden = !legend.childElementCount;
    for (const { name, button } of [...this.views, ...(this.more || [])]) button.setAttribute("aria-pressed", String(views.name === name));
    const curves = document.querySelector(".curves");
    const box = curves && curves.getBoundingClientRect();
    const beside = box && box.width && box.top < 60 && box.right > window.innerWidth - 40 && box.left > 0.4 * window.innerWidth;
    this.node.style.right = `${beside ? window.innerWidth - box.left + 10 : 14}px`;
    document.documentElement.style.setProperty("--buttons", `${this.row.offsetWidth}px`);
    const other = theme.name === "dark" ? "Light" : "Dark";
    this.dark.title = `${other} page (d)`;
    this.dark.setAttribute("aria-label", `${other} page`);
    if (!this.layers.hidden) this.writeLayers();
  }

  darken() {
    theme.toggle();
    this.stage.views.keep();
  }

  writeLayers() {
    const names = this.stage.layers.present();
    if (names.join() !== [...this.boxes.keys()].join()) {
      this.boxes.clear();
      this.layers.replaceChildren();
      const small = make("div", "views small", this.layers);
      this.more = this.viewButtons(small);
      for (const name of names) {
        const label = make("label", "", this.layers);
        const box = make("input", "", label);
        box.type = "checkbox";
        box.onchange = () => this.show(name, box.checked);
        label.append(name);
        this.boxes.set(name, box);
      }
    }
    for (const [name, box] of this.boxes) box.checked = this.stage.layers.on[name] !== false;
  }

  show(name, on) {
    this.stage.layers.show(name, on);
    this.stage.views.keep();
  }

  writeHelp() {
    const { player } = this.stage;
    const rows = [
      ["drag", "turns the camera"], ["wheel", "zooms"], ["right button", "shifts"], ["point or tap", "names a mark or a body, with its numbers"],
      ["0 1 2 3", "views: start, front, side, top"], ["l", "layers"], ["n", "labels on and off"], ["h", "folds the legend"], ["d", "dark or light page"], ["? Esc", "this help"],
      ...(player ? [
        ["space", "plays"], ["← →", "one frame, with shift ten"], ["↑ ↓", "speed"], ["PgUp PgDn", "from event to event"],
        ["Home End", "first and last frame"], ["f", "the camera follows the robot"],
        ...(player.curves ? [["c", "folds the curves; a click on one goes there, dragging across enlarges"]] : []),
      ] : []),
    ];
    this.help.replaceChildren();
    const table = make("table", "", this.help);
    for (const [key, words] of rows) {
      const line = table.insertRow();
      make("kbd", "", line.insertCell(), key);
      line.insertCell().textContent = words;
    }
    make("p", "", this.help, "The address keeps what you see: copy it, or write one.");
    make("code", "", this.help, `#${player ? "t=0.9&" : ""}view=front&on=labels,axes&off=cones`);
    make("p", "", this.help, "This page as it is now:");
    make("code", "now", this.help, `#${this.stage.views.link()}`);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey || document.body.classList.contains("bare")) return;
    if (event.target.matches && event.target.matches("select, textarea, input:not([type=checkbox]):not([type=range])")) return;
    const { stage } = this;
    const actions = {
      n: () => this.show("labels", stage.layers.on.labels !== true),
      h: () => foldLegend(stage.legend),
      d: () => this.darken(),
      Escape: () => { this.open(""); stage.labels.clear(); },
    };
    for (const { panel, key } of this.panels) actions[key] = () => this.open(this.opened === panel ? "" : panel);
    VIEWS.forEach((name, i) => { actions[String(i)] = () => stage.views.go(name); });
    if (!actions[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
  }
}
