// Sliders and choices of a live page, and the answer to them: what holds, what gives way. Python checks what they send.
class Controls {
  constructor(stage) {
    this.stage = stage;
    this.page = crypto.getRandomValues(new Uint32Array(1))[0];
    this.asked = this.answered = 0;
    this.inputs = new Map();  // name -> {input, show, held}
    this.times = { number: 0, asked: 0, answered: 0, solved_ms: 0 };  // of the last question and its first answer
  }

  // {listed: [{kind, name, low, high, step, unit | options}]}
  build({ listed }) {
    if (this.panel) this.panel.remove();
    this.inputs.clear();
    this.panel = make("footer", "controls", document.body);
    this.said = make("section", "verdict", this.panel);
    this.said.setAttribute("role", "status");
    this.said.setAttribute("aria-live", "polite");
    const grid = make("div", "sliders chrome", this.panel);
    for (const control of listed) grid.append(control.kind === "slider" ? this.slider(control) : this.choice(control));
    // Keys of the page (views, layers) do not hear what is typed here.
    this.panel.addEventListener("keydown", (event) => event.stopPropagation());
    this.enable(Boolean(this.stage.live && this.stage.live.open));
    if (document.body.dataset.ready) this.stage.fit();
  }

  slider({ name, low, high, step, unit }) {
    const label = make("label", "");
    make("span", "", label, name);
    const value = make("output", "", label);
    const input = Object.assign(make("input", "", label), { type: "range", min: low, max: high, step: "any" });
    const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
    const show = (x) => {
      input.value = x;
      value.textContent = `${Number(x).toFixed(digits)}${unit ? ` ${unit}` : ""}`;
      input.setAttribute("aria-valuetext", value.textContent);
    };
    const read = () => Math.min(high, Math.max(low, low + Math.round((input.valueAsNumber - low) / step) * step));
    input.oninput = () => {
      const x = read();
      value.textContent = `${x.toFixed(digits)}${unit ? ` ${unit}` : ""}`;
      this.ask({ [name]: x });
    };
    // Arrows step by the step, page up and page down by ten of them.
    input.onkeydown = (event) => {
      const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -10, PageUp: 10 }[event.key];
      if (!by) return;
      event.preventDefault();
      show(Math.min(high, Math.max(low, read() + by * step)));
      input.oninput();
    };
    this.inputs.set(name, { input, show });
    return label;
  }

  choice({ name, options }) {
    const label = make("label", "");
    make("span", "", label, name);
    const input = make("select", "", label);
    for (const option of options) input.append(new Option(option, option));
    input.onchange = () => this.ask({ [name]: input.value });
    this.inputs.set(name, { input, show: (x) => { input.value = x; } });
    return label;
  }

  ask(values) {
    if (!this.stage.live) return;
    this.asked += 1;
    this.times.asked = performance.now();
    this.stage.live.send({ set: values, asked: [this.page, this.asked] });
  }

  // {values, asked: [page, number], verdict: {title, lines, good} | null, ms}
  answer({ values, asked, verdict, ms }) {
    const [page, number] = asked;
    const ours = page === this.page;
    if (ours) this.answered = number;
    // What is older than what this page has asked since does not move its sliders back.
    if (!ours || number === this.asked) for (const [name, x] of Object.entries(values)) this.show(name, x);
    if (this.said && verdict) this.say(verdict);
    this.stage.tint(Boolean(verdict && verdict.good === false));
    if (number !== this.times.number) Object.assign(this.times, { number, answered: performance.now(), solved_ms: ms });
  }

  show(name, x) {
    const held = this.inputs.get(name);
    if (held) held.show(x);
  }

  say({ title, lines, good }) {
    this.said.classList.toggle("good", good === true);
    this.said.classList.toggle("bad", good === false);
    this.said.replaceChildren(make("h2", "", null, unbroken(title)), ...lines.map((line) => make("p", "", null, unbroken(line))));
  }

  // What the sliders take of the window, in pixels.
  room() {
    return { beside: 0, foot: this.panel ? this.panel.offsetHeight + 12 : 0 };
  }

  enable(on) {
    for (const { input } of this.inputs.values()) input.disabled = !on;
    if (this.panel) this.panel.classList.toggle("off", !on);
  }
}
