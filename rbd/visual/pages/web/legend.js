// The legend: a title that folds the rest, a row for each name, notes below.
const FINGERS = window.matchMedia("(pointer: coarse)").matches;
const FOLDS_BELOW = [500, 360];  // pixels across and down: the legend of a smaller window starts folded

// A title with a button that folds what is below it; kept when the legend is written anew.
function heading(legend, title) {
  if (!legend.dataset.fold) legend.dataset.fold = window.innerWidth < FOLDS_BELOW[0] || window.innerHeight < FOLDS_BELOW[1] ? "folded" : "open";
  const h1 = make("h1", "");
  const button = Object.assign(make("button", "", h1, title), { type: "button" });
  button.title = "Fold or unfold (h)";
  button.onclick = () => { foldLegend(legend); button.blur(); };
  legend.replaceChildren(h1);
  button.setAttribute("aria-expanded", String(legend.dataset.fold === "open"));
}

function foldLegend(legend, folded = legend.dataset.fold === "open") {
  legend.dataset.fold = folded ? "folded" : "open";
  const button = legend.querySelector("h1 button");
  if (button) button.setAttribute("aria-expanded", String(!folded));
  legend.dispatchEvent(new Event("fold"));
}

// The row above columns of newtons: the force along the normal is told apart from the whole.
function columnNames(table, names, skip) {
  const row = table.insertRow();
  row.className = "columns";
  for (let i = 0; i < skip; i++) row.insertCell();
  for (const name of names) row.insertCell().append(name);
}

// Words with no break between a number and its unit, or a name and its number.
function unbroken(text) {
  return text.replace(/(\d) (?=(?:%|N|J|W|m|mm|s|ms|kg|deg|degrees|rad)(?:[\s.,;:)/]|$))/g, "$1\u00a0").replace(/\b(of mu|mu|friction) (?=\d)/g, (all) => all.replace(/ /g, "\u00a0"));
}

// What was found, below the title: a row goes to the time of its largest size; lines are folded at first.
function writeCard(legend, { words, rows, lines }, go) {
  const card = make("div", "card");
  if (words) make("p", "", card, unbroken(words));
  const table = make("table", "", card);
  for (const { name, color, count, size, t, words } of rows) {
    const line = table.insertRow();
    theme.paint(make("i", "", line.insertCell()), "background", color);
    const button = Object.assign(make("button", "", line.insertCell(), name), { type: "button", title: `${words}; largest at ${t.toPrecision(4)} s` });
    button.onclick = () => { go(t); button.blur(); };
    for (const text of [count, size]) make("span", "", Object.assign(line.insertCell(), { className: "value" }), text);
  }
  const details = make("details", "", card);
  make("summary", "", details, "report");
  for (const text of lines) make("p", "", details, unbroken(text));
  legend.querySelector("h1").after(card);
}

function writeLegend(stage, { title, entries, notes }) {
  const { legend } = stage;
  heading(legend, title);
  const table = make("table", "");
  for (const entry of entries) {
    const rows = [table.insertRow()];
    theme.paint(make("i", "", rows[0].insertCell()), "background", entry.color);
    const name = rows[0].insertCell(), value = rows[0].insertCell();
    name.textContent = entry.name;
    value.className = "value";
    value.textContent = entry.value;
    for (const detail of [entry.detail || []].flat()) {
      const more = table.insertRow();
      more.insertCell();
      const cell = more.insertCell();
      cell.colSpan = 2;
      cell.className = "detail";
      cell.textContent = unbroken(detail);
      rows.push(more);
    }
    for (const row of entry.layer ? rows : []) {
      row.dataset.layer = entry.layer;
      row.hidden = stage.layers.on[entry.layer] === false;
    }
  }
  legend.append(table);
  for (const line of notes) makeNote(legend, line);
}

// A note below a legend; on a screen that is touched it says how fingers turn the scene.
function makeNote(legend, text) {
  const turns = howToTurn(text);
  make("p", turns, legend, turns && FINGERS ? "One finger turns, two zoom and shift." : unbroken(text));
}

// The class of a note that says how to turn the scene: pictures and videos leave it out.
function howToTurn(note) {
  return note.startsWith("Drag to turn") ? "turn" : "";
}
