// One motion of a page: its frames, the robot that it moves, and its part of the legend.
class Reel {
  constructor(stage, motion, legend) {
    this.motion = motion;
    this.times = motion.times;
    this.rows = floats(motion.rows);
    this.codes = bytes(motion.codes);
    this.width = this.rows.length / this.times.length;
    this.names = motion.contacts.length + motion.others.length;
    this.cast = new Cast(stage, motion);
    this.cues = new Cues(legend, motion);
    if (motion.com && motion.trace) {
      const k = 7 * motion.bodies;
      this.cast.path(this.times.map((_, i) => Array.from(this.row(i).subarray(k, k + 3))));
    }
    // The page frames the robot as it starts; a camera that follows must have seen it there.
    this.cast.set(this.row(0));
  }

  row(i) {
    return this.rows.subarray(i * this.width, (i + 1) * this.width);
  }

  // Frame number of a time, with its fraction.
  position(t) {
    const low = before(this.times, t), high = low + 1;
    return low + Math.min(1, Math.max(0, (t - this.times[low]) / (this.times[high] - this.times[low])));
  }

  // The row at a frame number: straight between two frames, quaternions along the shorter arc.
  between(position) {
    const T = MeshCat.THREE;
    const low = Math.min(Math.floor(position), this.times.length - 2), w = position - low;
    const a = this.row(low), b = this.row(low + 1);
    if (w === 0 || w === 1) return w ? b : a;
    // A point that is there in one frame only is shown in the nearer one.
    const row = a.map((x, i) => {
      const y = (1 - w) * x + w * b[i];
      return Number.isFinite(y) ? y : w < 0.5 ? x : b[i];
    });
    for (let k = 3; k < 7 * this.motion.bodies; k += 7) {
      new T.Quaternion().fromArray(a, k).slerp(new T.Quaternion().fromArray(b, k), w).toArray(row, k);
    }
    return row;
  }

  // Shows a time; touches of the last `window` seconds glow.
  show(t, window) {
    const position = this.position(t), nearest = Math.round(position);
    this.cast.set(this.between(position), nearest);
    if (this.cast.been) this.cast.been(position);
    for (const { path, from, to } of this.motion.spans || []) {
      const object = this.cast.stage.layers.object(path);
      if (object) object.visible = t > from - 1e-9 && t < to - 1e-9;
    }
    this.glow(t, window);
    const codes = this.codes.subarray(nearest * this.names, (nearest + 1) * this.names);
    this.cues.set(codes, this.cast.tracks);
    const past = this.motion.events.filter((event) => event.t <= t + 1e-9);
    this.cues.happened.textContent = past.length ? past[past.length - 1].words[0] : "";
  }

  // A touch may last no longer than a step: it glows for a moment, at the point that touched.
  glow(t, window) {
    const { events, contacts, bodies } = this.motion;
    const touched = events.filter((e) => e.kind === "touches" && e.t <= t + 1e-9 && e.t > t - window).pop();
    const c = touched ? contacts.findIndex((contact) => contact.name === touched.name) : -1;
    if (c < 0 || touched.point < 0 || touched.point >= contacts[c].points) {
      this.cast.glow([NaN], NaN, "");
      return;
    }
    const earlier = contacts.slice(0, c).reduce((sum, contact) => sum + contact.points, 0);
    const k = 7 * bodies + 3 + 6 * (earlier + touched.point);
    const where = this.row(Math.round(this.position(touched.t))).subarray(k, k + 3);
    this.cast.glow(where, (t - touched.t) / window, contacts[c].color);
  }
}

// Index of the last of the times that is not after t, but of the last but one at most.
function before(times, t) {
  let low = 0, high = times.length - 1;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle;
    else high = middle;
  }
  return low;
}
