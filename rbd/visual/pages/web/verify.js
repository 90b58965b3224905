// The panel "verify": residuals of the page's answers, computed anew from the numbers that the page carries. It uses nothing of
// the rest of the page. M a + h = tau + J' f; rows move by c = J a + offset; f = G w with weights w in their sets (circular cones,
// half-lines, intervals), each paired with an entry of y = H' c + y0. README of the law: rbd.problem.force_set.
const EQUATIONS = [
  ["equation of motion", "N"], ["accelerations", "m/s²"], ["sets of forces", "N"],
  ["force × acceleration", "N m/s²"], ["momentum", "N"],
];
const AGREES = 1e-12;  // of the sum of the absolute terms

// The arrays of a frame, row by row, in the order in which verified_frames.py writes them.
function frameOf(head, numbers) {
  const { nv, m, p } = head;
  const take = (n) => { const part = numbers.array.subarray(numbers.at, numbers.at + n); numbers.at += n; return part; };
  const names = { L: (nv * (nv + 1)) / 2, J: m * nv, a: nv, h: nv, tau: nv, offset: m, f: m, G: m * p, H: m * p, y0: p, lower: p, upper: p, w: p };
  const F = { ...head };
  for (const [name, n] of Object.entries(names)) F[name] = take(n);
  if (head.momentum) for (const [name, n] of [["A", 6 * nv], ["bias", 6], ["wrench", 6], ["C", 6 * m]]) F[name] = take(n);
  return F;
}

// Sums of terms, with the sums of their absolute values: what rounding is measured by.
class Sum {
  constructor() { this.value = this.size = 0; }
  add(x) { this.value += x; this.size += Math.abs(x); return this; }
  row(A, i, x) { for (let j = 0; j < x.length; j++) this.add(A[i * x.length + j] * x[j]); return this; }
  column(A, j, x, sign = 1) { const n = A.length / x.length; for (let k = 0; k < x.length; k++) this.add(sign * A[k * n + j] * x[k]); return this; }
}

// The nearest point of the cone |t| <= mu n.
function intoCone([x, y, n], mu) {
  const t = Math.hypot(x, y), normal = t <= mu * n ? n : Math.max((mu * t + n) / (1 + mu * mu), 0);
  const factor = Math.min((mu * normal) / Math.max(t, 1e-200), 1);
  return [factor * x, factor * y, normal];
}

// The five residuals of a frame, [value, size of its terms] each; null where there is none.
function residualsOf(F) {
  const most = (sums) => sums.reduce(([v, s], x) => [Math.max(v, Math.abs(x.value)), Math.max(s, x.size)], [0, 0]);
  const each = (n, made) => Array.from({ length: n }, (_, i) => made(new Sum(), i));
  const motion = each(F.nv, (sum, i) => {
    for (let j = 0; j < F.nv; j++) sum.add(F.L[i > j ? (i * (i + 1)) / 2 + j : (j * (j + 1)) / 2 + i] * F.a[j]);
    return sum.add(F.h[i]).add(-F.tau[i]).column(F.J, i, F.f, -1);
  });
  const momentum = F.momentum ? most(each(6, (sum, i) => {
    for (let k = 0; k < F.m; k++) sum.add(-F.C[i * F.m + k] * F.f[k]);
    return sum.row(F.A, i, F.a).add(F.bias[i]).add(-F.wrench[i]);
  })) : null;
  const c = each(F.m, (sum, k) => sum.row(F.J, k, F.a).add(F.offset[k]));
  if (F.bilateral) return [most(motion), most(c), [0, 0], [0, 0], momentum];
  const y = each(F.p, (sum, j) => {
    for (let k = 0; k < F.m; k++) { const h = F.H[k * F.p + j]; sum.value += h * c[k].value; sum.size += Math.abs(h) * c[k].size; }
    return sum.add(F.y0[j]);
  });
  const w = F.w.map((x, j) => Math.min(Math.max(x, F.lower[j]), F.upper[j]));
  F.cones.forEach((i, k) => { intoCone(F.w.subarray(i, i + 3), F.mu[k]).forEach((x, d) => { w[i + d] = x; }); });
  const gap = y.map(({ value, size }, j) => ({
    value: (F.lower[j] > -Infinity ? 0 : Math.max(value, 0)) + (F.upper[j] < Infinity ? 0 : Math.max(-value, 0)), size,
  }));
  const slack = y.map(({ value, size }, j) => {
    const below = F.lower[j] > -Infinity ? (w[j] - F.lower[j]) * Math.max(value, 0) : 0;
    const above = F.upper[j] < Infinity ? (F.upper[j] - w[j]) * Math.max(-value, 0) : 0;
    return { value: below + above, size: size * (Math.abs(w[j]) + 1) };
  });
  F.cones.forEach((i, k) => {
    const [a, b, n] = [i, i + 1, i + 2], [p, q, r] = [y[a].value, y[b].value, y[n].value], size = y[a].size + y[b].size + y[n].size;
    const force = Math.abs(w[a]) + Math.abs(w[b]) + Math.abs(w[n]), along = w[a] * p + w[b] * q, mu = F.mu[k];
    for (const j of [a, b]) gap[j] = slack[j] = { value: 0, size: 0 };
    gap[n] = { size, value: F.coulomb ? Math.max(-r, 0) : Math.hypot(...intoCone([-p, -q, -r], mu)) };
    const value = F.coulomb ? Math.max(Math.abs(w[n] * r), Math.abs(along + mu * w[n] * Math.hypot(p, q))) : Math.abs(along + w[n] * r);
    slack[n] = { size: size * (1 + mu) * (force + 1), value };
  });
  const off = each(F.m, (sum, k) => { sum.add(F.f[k]); for (let j = 0; j < F.p; j++) sum.add(-F.G[k * F.p + j] * w[j]); return sum; });
  return [most(motion), most(gap), most(off), most(slack), momentum];
}

// The largest share of friction that each constraint uses where coefficients are so many times theirs; only of cones that push.
function sharesOf(F, factor) {
  return F.constraints.map(([name, start, end]) => ({
    name,
    share: Math.max(...F.cones.map((i, k) => (i < start || i >= end || !(F.w[i + 2] > 0) ? -1 :
      Math.hypot(F.w[i], F.w[i + 1]) / (factor * F.mu[k] * F.w[i + 2])))),
  })).filter(({ share }) => share >= 0);
}

class Verifier {
  constructor(stage, given) {
    Object.assign(this, { stage, given, factor: 1, shown: 0 });
    this.node = stage.toolbar.panel("verify", "Compute the residuals anew", "v");
    this.node.setAttribute("role", "dialog");
    make("p", "", this.node, "This page carries M, J, h, τ, a and f. Computed here from them, and by rbd:");
    const row = make("div", "verify-row", this.node);
    this.button = Object.assign(make("button", "", row, "verify"), { type: "button", onclick: () => this.verify() });
    if (given.frames.length > 1) {
      this.choice = make("select", "", row);
      this.choice.setAttribute("aria-label", "Sample");
      for (const { t } of given.frames) this.choice.append(new Option(`t = ${t.toFixed(3)} s`));
      this.choice.onchange = () => { this.shown = this.choice.selectedIndex; this.go(); this.write(); };
    }
    this.said = make("p", "verify-said", this.node);
    this.table = make("table", "", this.node);
    const label = this.label = make("label", "", this.node, "friction × ");
    this.slider = Object.assign(make("input", "", label), { type: "range", min: 0.05, max: 2, step: 0.01, value: 1 });
    this.scale = make("output", "", label, "1.00");
    this.slider.oninput = () => { this.factor = Number(this.slider.value); this.scale.textContent = this.factor.toFixed(2); this.write(); };
    this.cones = make("table", "", this.node);
    if (given.note) make("p", "", this.node, given.note);
    label.hidden = true;
  }

  // Unpacks the numbers, and computes the residuals of all frames; gives the largest difference over the size of its terms.
  async verify() {
    const [data] = await inflated(this.given.data, [this.given.size]);
    const numbers = { array: new Float64Array(data.slice().buffer), at: 0 };
    this.frames = this.given.frames.map((head) => frameOf(head, numbers));
    this.found = this.frames.map(residualsOf);
    this.differ = this.found.map((each, i) => each.map((x, e) => (x ? Math.abs(x[0] - this.frames[i].found[e]) / Math.max(x[1], 1e-300) : 0)));
    const worst = this.differ.map((each) => (each.some(Number.isNaN) ? Infinity : Math.max(...each)));
    if (!(worst[this.shown] > AGREES)) this.shown = worst.indexOf(Math.max(...worst));
    if (this.choice) this.choice.selectedIndex = this.shown;
    const wrong = worst.filter((x) => !(x <= AGREES)).length, all = worst.length;
    this.said.textContent = wrong ? `${wrong} of ${all} answers do NOT agree with what rbd found.` :
      `${all > 1 ? `All ${all} answers agree` : "Agrees"} with rbd: differences at most ${Math.max(...worst).toExponential(1)} of their terms.`;
    this.said.classList.toggle("wrong", wrong > 0);
    this.go();
    this.write();
    return Math.max(...worst);
  }

  go() {
    const { t } = this.given.frames[this.shown];
    if (t !== null && this.stage.player) this.stage.player.go(t);
  }

  write() {
    if (!this.frames) return;
    const F = this.frames[this.shown];
    this.table.replaceChildren();
    columnNames(this.table, ["here", "by rbd"], 1);
    EQUATIONS.forEach(([name, unit], e) => {
      const x = this.found[this.shown][e];
      if (!x) return;
      const row = this.table.insertRow();
      row.insertCell().textContent = name;
      for (const value of [x[0], F.found[e]]) row.insertCell().textContent = `${value.toExponential(1)} ${unit}`;
      row.classList.toggle("wrong", !(this.differ[this.shown][e] <= AGREES));
    });
    const shares = sharesOf(F, this.factor);
    this.label.hidden = !shares.length;
    this.cones.replaceChildren();
    for (const { name, share } of shares) {
      const row = this.cones.insertRow();
      row.insertCell().textContent = name;
      row.insertCell().textContent = share > 1 + 1e-9 ? `leaves its cone: ${(100 * share).toFixed(0)} % of friction` :
        `${(100 * share).toFixed(1)} % of friction`;
      row.classList.toggle("wrong", share > 1 + 1e-9);
    }
  }
}
