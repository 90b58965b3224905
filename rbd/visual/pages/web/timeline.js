// Plays a motion in time: button, bar with lanes and marks, speed, keys. Reads the frames that the page holds.
const GLYPHS = { touches: "▼", leaves: "▲", slips: "◆", sticks: "■" };
const MOST_LANES = 10;
const GLOW_SECONDS = 0.25;  // of playback

class Player {
  constructor(stage, motion) {
    this.motion = motion;
    heading(stage.legend, motion.title);
    const second = motion.second ? [{ ...motion.second, trace: motion.trace, note: "" }] : [];
    this.reels = [motion, ...second].map((each) => new Reel(stage, each, stage.legend));
    const [reel] = this.reels;
    Object.assign(this, { times: reel.times, cast: reel.cast, cues: reel.cues });
    this.cast.follow = motion.follow;
    this.first = Math.min(...this.reels.map(({ times }) => times[0]));
    this.last = Math.max(...this.reels.map(({ times }) => times[times.length - 1]));
    this.step = (this.times[this.times.length - 1] - this.times[0]) / (this.times.length - 1);
    this.speed = motion.speed;
    this.playing = false;
    this.digits = Math.max(2, Math.min(6, 2 - Math.floor(Math.log10(this.last - this.first))));
    this.build();
    // Whoever has turned the camera keeps it; bar, curves and buttons take their places all the same.
    const arrange = () => {
      if (stage.touched) this.room();
      else stage.fit();
      if (stage.toolbar) stage.toolbar.refresh();
    };
    const names = this.reels.map((each) => each.motion.name);
    const charts = motion.sheet ? null : motion.charts;
    this.curves = charts ? new Curves(charts, [this.first, this.last], names, (t) => this.go(t), arrange) : null;
    if (motion.card) writeCard(stage.legend, motion.card, (t) => this.go(t));
    this.seek(this.asked() ?? motion.start);
    if (motion.playing) this.play(true);
    this.ending = new AbortController();
    const { signal } = this.ending;
    window.addEventListener("keydown", (event) => this.key(event), { capture: true, signal });
    window.addEventListener("resize", arrange, { signal });
    window.addEventListener("hashchange", () => this.seek(this.asked() ?? this.t), { signal });
    requestAnimationFrame((now) => this.tick(now));
  }

  // The time that the address asks for: page.html#t=0.5
  asked() {
    const found = /[#&]t=([-+0-9.eE]+)/.exec(window.location.hash);
    return found && Number.isFinite(Number(found[1])) ? Number(found[1]) : null;
  }

  seek(t) {
    this.t = Math.min(this.last, Math.max(this.first, t));
    for (const reel of this.reels) reel.show(this.t, GLOW_SECONDS * this.speed);
    const share = 100 * (this.t - this.first) / (this.last - this.first);
    this.done.style.width = `${share}%`;
    this.knob.style.left = `${share}%`;
    this.clock.textContent = `${this.t.toFixed(this.digits)} / ${this.last.toFixed(this.digits)} s`;
    if (this.curves) this.curves.set(this.t);
    this.bar.setAttribute("aria-valuenow", this.t.toFixed(6));
    this.bar.setAttribute("aria-valuetext", `${this.t.toFixed(this.digits)} seconds`);
  }

  // What bar and curves take of the window [pixels]: {beside, foot}.
  room() {
    const bar = this.footer.offsetHeight;
    const { beside, below } = this.curves ? this.curves.place(bar) : { beside: 0, below: 0 };
    const { style } = this.cast.stage.legend;
    style.maxHeight = style.maxHeight || `calc(100vh - ${Math.max(160, bar + 76)}px)`;
    return { beside, foot: (bar ? bar + 12 : 0) + below };
  }

  // Ends it, for another motion or a picture at rest.
  remove() {
    this.ending.abort();
    this.playing = false;
    for (const { cast } of this.reels) cast.remove();
    this.footer.remove();
    if (this.curves) this.curves.remove();
  }

  tick(now) {
    if (this.ending.signal.aborted) return;
    requestAnimationFrame((later) => this.tick(later));
    // A tab that was hidden does not jump ahead.
    const passed = Math.min(0.2, (now - (this.before ?? now)) / 1000);
    this.before = now;
    if (!this.playing) return;
    this.seek(this.t + passed * this.speed);
    if (this.t >= this.last) this.play(false);
  }

  play(on) {
    if (on && this.t >= this.last) this.seek(this.first);
    this.playing = on;
    this.button.textContent = on ? "❚❚" : "▶";
    this.button.title = on ? "Pause (space)" : "Play (space)";
    this.button.setAttribute("aria-label", on ? "Pause" : "Play");
  }

  go(t) {
    this.play(false);
    this.seek(t);
  }

  setSpeed(speed) {
    this.speed = speed;
    this.choice.value = String(speed);
  }

  setFollow(on) {
    const [reel] = this.reels;
    this.cast.followFrom(on, reel.row(Math.round(reel.position(this.t))));
    this.following.checked = on;
    this.seek(this.t);
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest && event.target.closest(".toolbar")) return;  // it has keys of its own
    const step = this.step * (event.shiftKey ? 10 : 1);
    const { speeds } = this.motion, { events } = this;
    const faster = (by) => this.setSpeed(speeds[Math.min(speeds.length - 1, Math.max(0, speeds.indexOf(this.speed) + by))]);
    const near = 1e-6 * (this.last - this.first);
    const actions = {
      " ": () => this.play(!this.playing),
      ArrowLeft: () => this.go(this.t - step),
      ArrowRight: () => this.go(this.t + step),
      ArrowUp: () => faster(1),
      ArrowDown: () => faster(-1),
      Home: () => this.go(this.first),
      End: () => this.go(this.last),
      PageUp: () => this.go(events.filter((e) => e.t < this.t - near).pop()?.t ?? this.first),
      PageDown: () => this.go(events.find((e) => e.t > this.t + near)?.t ?? this.last),
      f: () => this.setFollow(!this.cast.follow),
      c: () => this.curves && this.curves.fold(!this.curves.folded),
    };
    if (!actions[event.key]) return;
    event.preventDefault();
    event.stopPropagation();
    actions[event.key]();
  }

  build() {
    const footer = make("footer", "player", document.body);
    this.footer = footer;
    this.button = make("button", "play", footer);
    this.button.onclick = () => { this.play(!this.playing); this.button.blur(); };
    const middle = make("div", "middle", footer);
    this.lanes(middle);
    this.bar = make("div", "bar", middle);
    this.bar.tabIndex = 0;
    for (const [name, value] of [["role", "slider"], ["aria-label", "Time"], ["aria-valuemin", this.first], ["aria-valuemax", this.last]]) {
      this.bar.setAttribute(name, value);
    }
    this.done = make("div", "done", this.bar);
    this.knob = make("div", "knob", this.bar);
    const scrub = (event) => {
      const box = this.bar.getBoundingClientRect();
      this.seek(this.first + (this.last - this.first) * (event.clientX - box.left) / box.width);
    };
    middle.onpointerdown = (event) => {
      if (event.target.classList.contains("event")) return;
      middle.setPointerCapture(event.pointerId);
      this.held = true;
      this.play(false);
      scrub(event);
    };
    middle.onpointermove = (event) => { if (this.held) scrub(event); };
    middle.onpointerup = middle.onpointercancel = () => { this.held = false; };
    this.clock = make("output", "clock", footer);
    this.choice = make("select", "speed", footer);
    this.choice.title = "Speed (up, down)";
    this.choice.setAttribute("aria-label", "Speed");
    for (const speed of this.motion.speeds) make("option", "", this.choice, `${speed}×`).value = String(speed);
    this.choice.onchange = () => { this.setSpeed(Number(this.choice.value)); this.choice.blur(); };
    this.setSpeed(this.speed);
    const label = make("label", "follow", footer);
    this.following = make("input", "", label);
    this.following.type = "checkbox";
    this.following.checked = this.cast.follow;
    this.following.onchange = () => { this.setFollow(this.following.checked); this.following.blur(); };
    label.append("follow");
    label.title = "The camera goes with the robot (f)";
    label.hidden = !this.motion.com;
    this.play(false);
  }

  // A lane for each contact: filled while it touches, striped while it slips; its events as marks on it. Below them the lanes
  // of whatever else is true at times, with its name.
  lanes(parent) {
    const percent = (t) => 100 * (t - this.first) / (this.last - this.first);
    const fill = (lane, kind, color, from, to) => {
      Object.assign(theme.paint(make("div", kind, lane), "color", color).style, { left: `${percent(from)}%`, width: `${percent(to) - percent(from)}%` });
    };
    const hint = make("div", "hint", parent);
    hint.hidden = true;
    const lanes = make("div", "lanes", parent);
    const where = new Map();
    this.reels.forEach(({ motion }, i) => motion.contacts.slice(0, MOST_LANES).forEach(({ name, color, stretches }) => {
      const lane = make("div", i ? "lane second" : "lane", lanes);
      lane.title = motion.name ? `${name} (${motion.name})` : name;
      where.set(i + name, { lane, color });
      for (const [from, to, code] of stretches) fill(lane, motion.words[code], color, from, to);
    }));
    for (const { name, color, stretches } of this.motion.lanes) {
      const lane = make("div", "lane named", lanes);
      lane.title = name;
      where.set(0 + name, { lane, color });
      for (const [from, to, code] of stretches) fill(lane, this.motion.words[code], color, from, to);
      make("span", "", lane, name);
    }
    const told = this.reels.flatMap(({ motion }, i) => motion.events.map((event) => ({ event, key: i + event.name })));
    this.events = told.map(({ event }) => event).sort((a, b) => a.t - b.t);
    const rest = told.some(({ key }) => !where.has(key)) ? make("div", "lane", lanes) : null;
    for (const { event, key } of told) {
      const { lane, color } = where.get(key) || { lane: rest, color: "#1f2933" };
      const mark = make("button", "event", lane, GLYPHS[event.kind] || "●");
      mark.tabIndex = -1;
      mark.style.left = `${percent(event.t)}%`;
      theme.paint(mark, "color", color);
      mark.setAttribute("aria-label", event.words.join("; "));
      mark.onclick = () => { this.go(event.t); mark.blur(); };
      mark.onpointerenter = () => {
        hint.hidden = false;
        hint.replaceChildren(...event.words.map((words) => make("div", "", null, words)));
        const box = parent.getBoundingClientRect();
        const free = Math.max(0, box.width - hint.offsetWidth);
        hint.style.left = `${Math.min(free, Math.max(0, mark.getBoundingClientRect().left - box.left - hint.offsetWidth / 2))}px`;
      };
      mark.onpointerleave = () => { hint.hidden = true; };
    }
  }

  // Many times side by side, in place of the page.
  sheet({ times, columns, width, height, gap }) {
    const { viewer } = this.cast.stage;
    const main = make("main", "sheet");
    for (const t of times) {
      this.seek(t);
      viewer.controls.update();
      viewer.camera.updateProjectionMatrix();
      viewer.renderer.render(viewer.scene, viewer.camera);
      const figure = make("figure", "", main);
      figure.append(Object.assign(new Image(width, height), { src: viewer.renderer.domElement.toDataURL() }));
      make("figcaption", "", figure, `${t.toFixed(this.digits)} s`);
    }
    main.style.gridTemplateColumns = `repeat(${columns}, ${width}px)`;
    main.style.gap = `${gap}px`;
    document.body.replaceChildren(main);
  }
}
