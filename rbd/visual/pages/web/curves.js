// Curves of a motion: charts over time, drawn by uPlot, with the present moment marked. A click goes to a time; dragging across
// shows what is between, in all charts, and a double click everything; two fingers stretch and shift the time. Beside the robot, in narrow windows below it. The panel
// folds, and a row of buttons chooses charts.
const NARROW_WINDOW = 900, LOW = 480, CHART_HEIGHT = 114;  // pixels
const POINTING = FINGERS ? "Tap: to that time. Drag across, or two fingers: enlarge." : "Click: to that time. Drag across: enlarge.";
const DRAGGED = 8, APART = 24;  // pixels: a finger that moved less taps; two that are nearer do not stretch
const LEAST_SHARE = 1e-4;  // of the whole time, that fingers enlarge
const AXIS_FONT = '10px system-ui, "DejaVu Sans", sans-serif';

class Curves {
  constructor(described, [first, last], names, go, changed) {
    Object.assign(this, { first, last, names, changed, span: [first, last], t: first, pointed: null });
    this.times = described.times.map(floats);
    this.panel = make("aside", "curves", document.body);
    this.panel.setAttribute("aria-label", "Curves");
    const head = make("header", "", this.panel);
    this.folder = make("button", "fold", head);
    this.folder.onclick = () => { this.fold(!this.folded); this.folder.blur(); };
    this.choices = make("span", "choices", head);
    const reading = make("div", "reading", this.panel);
    this.moment = make("output", "", reading, POINTING);
    this.whole = make("button", "whole", reading, "whole time");
    this.whole.title = "Show the whole time again (double click)";
    this.whole.hidden = true;
    this.whole.onclick = () => { this.zoom(first, last); this.whole.blur(); };
    this.box = make("div", "charts", this.panel);
    this.charts = described.charts.map((chart) => this.chart(chart, go));
    this.chosen = false;
    this.arrange();
  }

  // Whether the panel is below the robot: in a narrow window.
  get below() {
    return window.innerWidth <= NARROW_WINDOW;
  }

  // Until one chooses: all charts beside the robot, as many as fit in a row below it; folded in a small frame.
  arrange() {
    if (this.chosen) return;
    const most = this.below ? Math.max(1, Math.floor((window.innerWidth - 28) / 290)) : Infinity;
    this.charts.forEach((chart, i) => this.show(chart, i < most));
    this.fold(this.below && (window.innerHeight < LOW || window.innerWidth < FOLDS_BELOW[0]), false);
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
    const button = make("button", "", this.choices, name);
    const node = make("section", "chart", this.box);
    make("h2", "", node, title);
    const home = make("div", "", node);
    home.style.height = `${CHART_HEIGHT}px`;  // uPlot takes it later, and the camera asks before
    const keys = this.times.map((_, i) => {
      const row = make("div", "keys", node);
      if (this.times.length > 1 && lines.some((line) => line.motion === i)) make("b", "", row, this.names[i]);
      return row;
    });
    const shown = lines.map(({ name: what, color, values, width, motion }) => {
      const key = make("span", "", keys[motion]);
      theme.paint(key, "--given", color);
      key.style.setProperty("--width", `${Math.max(1, Math.round(1.6 * width))}px`);
      return { name: what, color, width, numbers: floats(values), motion, key };
    }).sort((a, b) => a.motion - b.motion);
    for (const { name: what, value } of limits) make("span", "limit", keys[0], log ? `- - ${what}` : `- - ${what} ${inWords(value, log, top - low)}`);
    const made = { name, node, button, shown, log, span: top - low };
    // A log axis has no zero: what is smaller than its foot is drawn there. What is no number is a gap.
    const drawn = (value) => (Number.isFinite(value) ? (log ? Math.max(value, low) : value) : null);
    const tables = this.times.map((times, i) => [Array.from(times), ...shown.filter(({ motion }) => motion === i).map(({ numbers }) => Array.from(numbers, drawn))]);
    const straight = limits.map(({ value }) => ({ value, color: "--ink", dash: [4, 3] }));
    if (low < 0 && top > 0) straight.push({ value: 0, color: "--faint", dash: [] });
    made.plot = new uPlot({
      width: 300,
      height: CHART_HEIGHT,
      padding: [6, 14, 0, 0],
      legend: { show: false },
      cursor: {
        y: false,
        points: { show: false },
        drag: { x: true, y: false, setScale: false },
        sync: { key: "curves" },
        bind: { dblclick: () => () => this.zoom(this.first, this.last) },
      },
      scales: {
        x: { time: false, auto: false, min: this.first, max: this.last },
        y: { distr: log ? 3 : 1, range: (_, least, most) => (this.zoomed && least !== null ? around(least, most, log) : [low, top]) },
      },
      axes: [axis("s", {}), axis("", log ? { splits: (_, i, from, to) => powers(from, to), filter: (_, splits) => splits } : { space: 22 })],
      series: [{}, ...shown.map(({ color, width, motion }) => (
        { stroke: () => theme.shade(color), width, dash: motion ? [5, 2.5] : [], points: { show: false } }))],
      hooks: {
        drawAxes: [(plot) => straight.forEach((line) => rule(plot, line))],
        draw: [() => this.mark(made)],
        setCursor: [(plot) => this.point(plot.cursor.left >= 0 ? plot.posToVal(plot.cursor.left, "x") : null)],
        setSelect: [(plot) => {
          const { left, width } = plot.select;
          if (width > 0) this.zoom(plot.posToVal(left, "x"), plot.posToVal(left + width, "x"));
        }],
      },
    }, tables.length > 1 ? uPlot.join(tables) : tables[0], home);
    const { root, over } = made.plot;
    root.setAttribute("role", "img");
    root.setAttribute("aria-label", title);
    over.addEventListener("click", ({ clientX }) => go(made.plot.posToVal(clientX - over.getBoundingClientRect().left, "x")));
    new Fingers(made.plot, this);
    made.now = make("div", "now", over);
    new ResizeObserver(() => {
      if (home.clientWidth) made.plot.setSize({ width: home.clientWidth, height: CHART_HEIGHT });
    }).observe(home);
    button.title = title;
    button.onclick = () => {
      this.chosen = true;
      this.show(made, node.hidden);
      button.blur();
      this.changed();
    };
    return made;
  }

  get zoomed() {
    return this.span[0] > this.first || this.span[1] < this.last;
  }

  // Shows a part of the time in all charts, each with an axis for what is in it.
  zoom(from, to) {
    this.span = [Math.max(this.first, from), Math.min(this.last, to)];
    this.whole.hidden = !this.zoomed;
    for (const { plot } of this.charts) {
      plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      plot.setScale("x", { min: this.span[0], max: this.span[1] });
    }
  }

  // The line of the present time; none where a chart shows other times.
  mark({ plot, now }) {
    const [from, to] = this.span;
    if (!now) return;
    now.hidden = this.t < from || this.t > to;
    now.style.left = `${plot.valToPos(this.t, "x")}px`;
  }

  // Of each motion where a time is among its samples: the index of the one before, and the share of the way to the next.
  among(t) {
    return this.times.map((times) => {
      const low = before(times, t);
      return [low, Math.min(1, Math.max(0, (t - times[low]) / (times[low + 1] - times[low])))];
    });
  }

  // Marks the present time.
  set(t) {
    this.t = t;
    for (const chart of this.charts) this.mark(chart);
    if (this.pointed === null) this.write(t);
  }

  // Values at the time under the pointer; null: at the present one.
  point(t) {
    if (t === this.pointed || !this.charts) return;
    this.pointed = t;
    this.moment.textContent = t === null ? POINTING : `at ${Number(t.toPrecision(5))} s`;
    this.write(t === null ? this.t : t);
  }

  // Writes the values of the curves at a time: straight between two samples, as they are drawn.
  write(t) {
    const at = this.among(t);
    for (const { shown, log, span } of this.charts) {
      for (const { name, numbers, motion, key } of shown) key.textContent = `${name} ${inWords(valueAt(numbers, at[motion]), log, span)}`;
    }
  }

  // In the colours of the page.
  redraw() {
    for (const { plot } of this.charts) plot.redraw(false);
  }

  remove() {
    for (const { plot } of this.charts) plot.destroy();
    this.panel.remove();
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

// Fingers on a chart: one that drags across marks what is enlarged, as the mouse does; the times under two stay under them.
class Fingers {
  constructor(plot, curves) {
    Object.assign(this, { plot, curves, down: new Map(), stretched: false });
    const on = (name, act) => plot.over.addEventListener(name, (event) => { if (event.pointerType === "touch") act(event); });
    on("pointerdown", (event) => this.press(event));
    on("pointermove", (event) => this.move(event));
    on("pointerup", (event) => this.lift(event));
    on("pointercancel", (event) => this.lift(event, true));
  }

  press(event) {
    const x = this.at(event);
    this.plot.over.setPointerCapture(event.pointerId);
    for (const finger of this.down.values()) finger.t = this.plot.posToVal(finger.x, "x");
    this.down.set(event.pointerId, { from: x, x, t: this.plot.posToVal(x, "x") });
    if (this.down.size > 1) this.mark(0, 0);
    this.stretched = this.down.size > 1;
  }

  move(event) {
    const finger = this.down.get(event.pointerId);
    if (!finger) return;
    finger.x = this.at(event);
    if (this.down.size === 2) this.stretch([...this.down.values()]);
    else if (!this.stretched && Math.abs(finger.x - finger.from) > DRAGGED) {
      this.mark(finger.from, finger.x);
      this.curves.point(this.plot.posToVal(finger.x, "x"));
    }
  }

  // The last finger ends it; of one that the browser takes to scroll nothing is enlarged.
  lift(event, cancelled = false) {
    const finger = this.down.get(event.pointerId);
    this.down.delete(event.pointerId);
    if (!finger || this.down.size) return;
    this.curves.point(null);
    this.mark(0, 0);
    const [a, b] = [finger.from, finger.x].sort((one, other) => one - other);
    if (!cancelled && !this.stretched && b - a > DRAGGED) this.curves.zoom(this.plot.posToVal(a, "x"), this.plot.posToVal(b, "x"));
    this.stretched = false;
  }

  stretch([one, other]) {
    if (Math.abs(one.x - other.x) < APART || one.t === other.t) return;
    const { first, last } = this.curves, seconds = (other.t - one.t) / (other.x - one.x);  // per pixel
    if (!(seconds > 0)) return;
    const length = Math.min(last - first, Math.max(LEAST_SHARE * (last - first), seconds * this.plot.over.clientWidth));
    const from = Math.min(last - length, Math.max(first, one.t - seconds * one.x));
    this.curves.zoom(from, from + length);
  }

  at({ clientX }) {
    return clientX - this.plot.over.getBoundingClientRect().left;
  }

  mark(from, to) {
    const left = Math.max(0, Math.min(from, to)), right = Math.min(this.plot.over.clientWidth, Math.max(from, to));
    this.plot.setSelect({ left, top: 0, width: right - left, height: right > left ? this.plot.over.clientHeight : 0 }, false);
  }
}

// An axis with room for its longest number, sign and unit.
function axis(unit, further) {
  return {
    font: AXIS_FONT,
    stroke: () => named("--soft"),
    gap: 3,
    ticks: { size: 3, stroke: () => named("--line"), width: 1 },
    grid: { stroke: () => named("--grid"), width: 1 },
    values: (_, splits) => splits.map((value) => (unit ? `${onAxis(value)} ${unit}` : onAxis(value))),
    size: (plot, words, i, cycle) => {
      if (unit) return 18;
      if (cycle > 1) return plot.axes[i]._size;  // else the sizes of both axes could alternate for ever
      plot.ctx.save();
      plot.ctx.font = AXIS_FONT;
      const widths = (words || []).map((word) => plot.ctx.measureText(word).width);
      plot.ctx.restore();
      return Math.ceil(8 + Math.max(16, ...widths));
    },
    ...further,
  };
}

// A colour of the page's style.
function named(color) {
  return getComputedStyle(document.documentElement).getPropertyValue(color).trim();
}

// A number at an axis, with its sign.
function onAxis(value) {
  const size = Math.abs(value);
  return size > 0 && (size < 1e-3 || size >= 1e5) ? value.toExponential().replace("e+", "e") : String(Number(value.toPrecision(6)));
}

// Numbers at a log axis: at most five powers of ten; 1, 2 and 5 times them where there are fewer than two.
function powers(from, to) {
  const [low, high] = [Math.ceil(Math.log10(from) - 1e-9), Math.floor(Math.log10(to) + 1e-9)];
  const power = (k, of = 1) => Number(`${of}e${k}`);
  if (high > low) {
    const step = Math.ceil((high - low) / 4);
    return Array.from({ length: Math.floor((high - low) / step) + 1 }, (_, i) => power(low + i * step));
  }
  return [low - 1, low].flatMap((k) => [1, 2, 5].map((of) => power(k, of))).filter((value) => value >= from && value <= to);
}

// An axis for numbers from the least to the most.
function around(least, most, log) {
  if (log) return [least / 1.5, most * 1.5];
  const room = 0.06 * (most - least) || 0.05 * Math.max(Math.abs(most), 1e-3);
  return [least - room, most + room];
}

// A straight line across a chart, where the axis has its value.
function rule({ ctx, bbox, scales, valToPos }, { value, color, dash }) {
  if (!(value >= scales.y.min && value <= scales.y.max)) return;
  const y = Math.round(valToPos(value, "y", true)) + 0.5;
  ctx.save();
  ctx.strokeStyle = named(color);
  ctx.lineWidth = devicePixelRatio;
  ctx.setLineDash(dash.map((each) => each * devicePixelRatio));
  ctx.beginPath();
  ctx.moveTo(bbox.left, y);
  ctx.lineTo(bbox.left + bbox.width, y);
  ctx.stroke();
  ctx.restore();
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
