// Curves beside a motion: charts over time with the present moment marked; a click goes to a time.
class Curves {
  constructor(motion, go, footer) {
    this.times = floats(motion.charts.times);
    this.first = this.times[0];
    this.last = this.times[this.times.length - 1];
    this.panel = document.createElement("aside");
    this.panel.className = "curves";
    this.panel.style.maxHeight = `calc(100vh - ${footer.offsetHeight + 64}px)`;
    document.body.append(this.panel);
    this.charts = motion.charts.charts.map((chart) => this.chart(chart, go));
  }

  chart({ title, top, limit, lines }, go) {
    const [width, height, left, foot] = [300, 92, 26, 12];
    const space = Object.assign(document.createElement("div"), { innerHTML: "<svg></svg>" }).firstChild.namespaceURI;
    const draw = (tag, parent, given) => {
      const node = document.createElementNS(space, tag);
      for (const [name, value] of Object.entries(given)) node.setAttribute(name, value);
      parent.append(node);
      return node;
    };
    const heading = document.createElement("h2");
    heading.textContent = title;
    this.panel.append(heading);
    const svg = draw("svg", this.panel, { viewBox: `0 0 ${width} ${height}`, role: "img", "aria-label": title });
    const x = (t) => left + ((width - left - 2) * (t - this.first)) / (this.last - this.first);
    const y = (value) => 3 + (height - foot - 3) * (1 - Math.min(top, Math.max(0, value)) / top);
    const word = (text, at, anchor) => { draw("text", svg, { ...at, "text-anchor": anchor }).textContent = text; };
    for (const value of [0, top]) {
      draw("line", svg, { x1: left, x2: width, y1: y(value), y2: y(value), stroke: "#d5dbe1", "stroke-width": 0.8 });
      word(String(Number(value.toPrecision(3))), { x: left - 4, y: y(value) + (value ? 6 : 1) }, "end");
    }
    draw("line", svg, { x1: left, x2: width, y1: y(limit), y2: y(limit), stroke: "#1f2933", "stroke-dasharray": "4 3", "stroke-width": 0.8 });
    if (limit > 0.15 * top && limit < 0.85 * top) word(String(limit), { x: left - 4, y: y(limit) + 3 }, "end");
    word(`${this.first.toFixed(1)} s`, { x: left, y: height - 2 }, "start");
    word(`${this.last.toFixed(1)} s`, { x: width - 2, y: height - 2 }, "end");
    const keys = document.createElement("div");
    keys.className = "keys";
    const shown = lines.map(({ name, color, values, width: thick }) => {
      const numbers = floats(values);
      let path = "", pen = false;
      numbers.forEach((value, i) => {
        if (Number.isFinite(value)) path += `${pen ? "L" : "M"}${x(this.times[i]).toFixed(1)} ${y(value).toFixed(1)}`;
        pen = Number.isFinite(value);
      });
      draw("path", svg, { d: path, fill: "none", stroke: color, "stroke-width": thick, "stroke-linejoin": "round" });
      const key = document.createElement("span");
      key.style.color = color;
      keys.append(key);
      return { name, numbers, key };
    });
    const now = draw("line", svg, { x1: 0, x2: 0, y1: 0, y2: height - foot, stroke: "#1f2933", "stroke-width": 1.2 });
    const seek = (event) => {
      const box = svg.getBoundingClientRect();
      const share = ((event.clientX - box.left) * (width / box.width) - left) / (width - left - 2);
      go(this.first + Math.min(1, Math.max(0, share)) * (this.last - this.first));
    };
    svg.onpointerdown = (event) => { svg.setPointerCapture(event.pointerId); seek(event); };
    svg.onpointermove = (event) => { if (event.buttons) seek(event); };
    this.panel.append(keys);
    return { shown, now, x };
  }

  // Marks a time, and writes the values of the nearest frame.
  set(t) {
    let low = 0, high = this.times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (this.times[middle] <= t) low = middle;
      else high = middle;
    }
    const nearest = t - this.times[low] < this.times[high] - t ? low : high;
    for (const { shown, now, x } of this.charts) {
      now.setAttribute("x1", x(t));
      now.setAttribute("x2", x(t));
      for (const { name, numbers, key } of shown) {
        const value = numbers[nearest];
        const rounded = value < 0.005 ? 0 : value < 100 ? Number(value.toPrecision(2)) : Math.round(value);
        key.textContent = `${name} ${Number.isFinite(value) ? rounded : "–"}`;
      }
    }
  }
}
