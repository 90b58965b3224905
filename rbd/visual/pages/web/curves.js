// Curves of a motion: charts over time with the present moment marked; a click goes to a time. Beside the robot, in narrow
// windows below it. The panel folds, and a row of buttons chooses charts.
const NARROW_WINDOW = 900, LOW = 480;  // pixels

class Curves {
  constructor(described, [first, last], names, go, changed) {
    Object.assign(this, { first, last, names, changed });
    this.times = described.times.map(floats);
    this.panel = make("aside", "curves", document.body);
    this.panel.setAttribute("aria-label", "Curves");
    const head = make("header", "", this.panel);
    this.folder = make("button", "fold", head);
    this.folder.onclick = () => { this.fold(!this.folded); this.folder.blur(); };
    this.choices = make("span", "choices", head);
    this.box = make("div", "charts", this.panel);
    this.charts = described.charts.map((chart) => this.chart(chart, go));
    this.chosen = false;
    this.arrange();
  }

  // Whether the panel is below the robot: in a narrow window.
  get below() {
    return window.innerWidth <= NARROW_WINDOW;
  }

  // Until one chooses: all charts beside the robot, as many as fit in a row below it, none in a small frame.
  arrange() {
    if (this.chosen) return;
    const most = this.below ? Math.max(1, Math.floor((window.innerWidth - 28) / 290)) : Infinity;
    this.charts.forEach((chart, i) => this.show(chart, i < most));
    this.fold(this.below && window.innerHeight < LOW, false);
  }

  show(chart, on) {
    chart.node.hidden = !on;
    chart.button.setAttribute("aria-pressed", String(on));
  }

  fold(on, byHand = true) {
    this.folded = on;
    this.chosen = this.chosen || byHand;
    this.panel.classList.toggle("folded", on);
    this.folder.textContent = on ? "▸ curves" : "▾";
    this.folder.title = on ? "Unfold the curves (c)" : "Fold the curves (c)";
    this.folder.setAttribute("aria-label", on ? "Unfold the curves" : "Fold the curves");
    this.folder.setAttribute("aria-expanded", String(!on));
    if (byHand) this.changed();
  }

  chart({ name, title, low, top, log, limits, lines }, go) {
    const [width, height, left, foot] = [300, 96, 30, 12];
    const button = make("button", "", this.choices, name);
    const node = make("section", "chart", this.box);
    make("h2", "", node, title);
    const svg = draw("svg", node, { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
    const x = (t) => left + ((width - left - 2) * (t - this.first)) / (this.last - this.first);
    const scale = log ? (value) => Math.log10(Math.max(value, low)) : (value) => value;
    const [from, to] = [scale(low), scale(top)];
    const y = (value) => 4 + (height - foot - 4) * (1 - (Math.min(to, Math.max(from, scale(value))) - from) / (to - from));
    const word = (text, at, anchor) => { draw("text", svg, { ...at, "text-anchor": anchor }).textContent = text; };
    const written = [];
    const tick = (value) => {
      const at = Math.min(height - foot, Math.max(9, y(value) + 3));
      if (written.some((other) => Math.abs(other - at) < 9)) return;
      written.push(at);
      word(log ? `1e${Math.round(Math.log10(value))}` : String(Number(value.toPrecision(3))), { x: left - 4, y: at }, "end");
    };
    const rule = (value, given) => draw("line", svg, { x1: left, x2: width, y1: y(value), y2: y(value), "stroke-width": 0.8, ...given });
    for (const value of [low, top]) rule(value, { stroke: "#d5dbe1" });
    if (low < 0 && top > 0) rule(0, { stroke: "#9aa5b1" });
    for (const { value } of limits) if (value > low && value < top) rule(value, { stroke: "#1f2933", "stroke-dasharray": "4 3" });
    for (const value of [...limits.map((limit) => limit.value), ...(low < 0 && top > 0 ? [0] : []), low, top]) {
      if (value >= low && value <= top) tick(value);
    }
    word(`${Number(this.first.toPrecision(3))} s`, { x: left, y: height - 2 }, "start");
    word(`${Number(this.last.toPrecision(4))} s`, { x: width - 2, y: height - 2 }, "end");
    const keys = this.times.map((_, i) => {
      const row = make("div", "keys", node);
      if (this.times.length > 1 && lines.some((line) => line.motion === i)) make("b", "", row, this.names[i]);
      return row;
    });
    const shown = lines.map(({ name: what, color, values, width: thick, motion }) => {
      const numbers = floats(values), times = this.times[motion];
      let path = "", pen = false;
      numbers.forEach((value, i) => {
        if (Number.isFinite(value)) path += `${pen ? "L" : "M"}${x(times[i]).toFixed(1)} ${y(value).toFixed(1)}`;
        pen = Number.isFinite(value);
      });
      const look = { fill: "none", stroke: color, "stroke-width": thick, "stroke-linejoin": "round" };
      draw("path", svg, { d: path, ...look, ...(motion ? { "stroke-dasharray": "5 2.5" } : {}) });
      const key = make("span", "", keys[motion]);
      key.style.color = color;
      return { name: what, numbers, motion, key };
    });
    for (const { name: what } of limits) make("span", "limit", keys[0], `- - ${what}`);
    const now = draw("line", svg, { x1: 0, x2: 0, y1: 0, y2: height - foot, stroke: "#1f2933", "stroke-width": 1.2 });
    const seek = (event) => {
      const frame = svg.getBoundingClientRect();
      const share = ((event.clientX - frame.left) * (width / frame.width) - left) / (width - left - 2);
      go(this.first + Math.min(1, Math.max(0, share)) * (this.last - this.first));
    };
    svg.onpointerdown = (event) => { svg.setPointerCapture(event.pointerId); seek(event); };
    svg.onpointermove = (event) => { if (event.buttons) seek(event); };
    const made = { name, node, button, svg, shown, now, x, log, span: top - low };
    button.title = title;
    button.onclick = () => {
      this.chosen = true;
      this.show(made, node.hidden);
      button.blur();
      this.changed();
    };
    return made;
  }

  // Of each motion where a time is among its samples: the index of the one before, and the share of the way to the next.
  among(t) {
    return this.times.map((times) => {
      const low = before(times, t);
      return [low, Math.min(1, Math.max(0, (t - times[low]) / (times[low + 1] - times[low])))];
    });
  }

  // Marks a time, and writes the values of the curves there: straight between two samples, as they are drawn.
  set(t) {
    const at = this.among(t);
    for (const { shown, now, x, log, span } of this.charts) {
      now.setAttribute("x1", x(t));
      now.setAttribute("x2", x(t));
      for (const { name, numbers, motion, key } of shown) key.textContent = `${name} ${inWords(valueAt(numbers, at[motion]), log, span)}`;
    }
  }

  // Places the panel above a footer of so many pixels; what it takes of the window: {beside, below} in pixels.
  place(footer) {
    this.arrange();
    const { below } = this;
    this.panel.classList.toggle("below", below);
    this.panel.style.bottom = below ? `${footer + 20}px` : "auto";
    this.panel.style.maxHeight = below ? `${Math.round(0.42 * (window.innerHeight - footer))}px` : `calc(100vh - ${footer + 64}px)`;
    const high = this.panel.offsetHeight;
    // The legend ends above the charts.
    document.getElementById("legend").style.maxHeight = below ? `${Math.max(40, window.innerHeight - footer - high - 90)}px` : "";
    if (this.folded && !below) return { beside: 0, below: 0 };
    return below ? { beside: 0, below: high + 8 } : { beside: this.panel.offsetWidth + 14, below: 0 };
  }
}

// Between two samples; where one of them is none, the nearer.
function valueAt(numbers, [low, share]) {
  const [a, b] = [numbers[low], numbers[low + 1]];
  if (share === 0 || share === 1 || !Number.isFinite(a + b)) return share < 0.5 ? a : b;
  return a + share * (b - a);
}

// Three digits of a number; zero where it is a rounding error on an axis of this length.
function inWords(value, log, span) {
  if (!Number.isFinite(value)) return "–";
  if (log) return value ? value.toExponential(1) : "0";
  if (Math.abs(value) < 5e-5 * span) return "0";
  return String(Math.abs(value) >= 1000 ? Math.round(value) : Number(value.toPrecision(3)));
}
