"""The site builds without a warning or a network; every link holds, mathematics and both themes are readable."""

import base64
import functools
import html
import http.server
import json
import re
import subprocess
import sys
import threading
import zlib
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urldefrag

import docutils.utils
import pytest
from test_readme import TOP

from rbd.visual import find_browser
from rbd.visual.pages.browser import FLAGS

sys.path.insert(0, str(TOP / "docs" / "site"))
from docutils import nodes  # noqa: E402
from rbd_site import (  # noqa: E402  # noqa: E402
    api,
    bibliography,
    folded,
    formulas,
    gallery,
    links,
    mathjax,
    modules,
    public,
    shared_scenes,
    smaller,
    sources,
    subscripts,
)

SCENES = ("four_bar", "task_loop", "talos")
"""Scenes that the test builds: no motion is computed for them; `make docs` builds all."""
TAG = re.compile(r"<([a-z][a-z0-9]*)\b([^>]*)>")
NAMED = re.compile(r'\b(href|src|action|srcset|id)="([^"]*)"')
OUTSIDE = re.compile(r"""(?:\burl\(|@import)\s*["']?\s*(?:https?:)?//""")
PROBED = ("index", "reference/theory", "reference/notation", "api/rbd.Solution", "gallery/index", "courses/planar_chains/index")
READABLE = 4.5
"""Contrast of text against its ground that accessibility rules ask for."""


def built(folder: Path) -> str:
    """Build the site into a folder; what Sphinx has to say."""
    command = [sys.executable, "-m", "sphinx", "-b", "html", "-q", "-W", "--keep-going", "-d", str(folder.parent / "doctrees")]
    command += ["-D", f"rbd_scenes={','.join(SCENES)}", str(TOP / "docs"), str(folder)]
    run = subprocess.run(command, capture_output=True, text=True, cwd=TOP, check=False, timeout=400)
    return run.stderr + (f"exit code {run.returncode}" if run.returncode else "")


def named(html: str) -> tuple[set[str], set[str]]:
    """(addresses to which a page's tags refer, its anchors)."""
    found = {attribute for tag in TAG.finditer(html) for attribute in NAMED.findall(tag[2])}
    return {value for kind, value in found if kind != "id"}, {value for kind, value in found if kind == "id"}


def styles(file: Path) -> str:
    """The text of a style sheet, or of the styles within a page."""
    text = file.read_text(encoding="utf-8")
    return text if file.suffix == ".css" else "".join(re.findall(r"<style[^>]*>(.*?)</style>", text, flags=re.DOTALL))


def faults(site: Path) -> Iterator[str]:
    """Dead links and anchors, addresses outside, pages that no link reaches."""
    texts = {page: page.read_text(encoding="utf-8") for page in site.rglob("*.html") if "scenes" not in page.parts}
    both = {page: named(text) for page, text in texts.items()}
    icons = site / "_static" / "icons.js"  # which a script puts into each page
    drawn = set(re.findall(r'id=\\"([\w-]+)\\"', icons.read_text(encoding="utf-8"))) if icons.is_file() else set()
    found, anchored = ({page: each[i] for page, each in both.items()} for i in (0, 1))
    leads_to: dict[Path, set[Path]] = {page: set() for page in texts}
    for page, targets in found.items():
        for target in targets:
            path, anchor = urldefrag(target)
            if re.match(r"\w+:|//", target):
                yield from [f"{page}: outside, {target}"] if not target.startswith("data:") else []
                continue
            file = (page.parent / unquote(path.partition("?")[0])).resolve() if path else page
            if not file.is_file():
                yield f"{page}: dead link {target}"
            elif anchor and file in anchored and unquote(anchor) not in anchored[file] | drawn:
                yield f"{page}: dead anchor {target}"
            if file in leads_to:
                leads_to[page].add(file)
    for file in [*site.rglob("*.css"), *texts]:
        yield from (f"{file}: outside, {address}" for address in OUTSIDE.findall(styles(file)))
    reached, coming = {site / "index.html"}, [site / "index.html"]
    while coming:
        coming = [page for page in set().union(*(leads_to[page] for page in coming)) - reached]
        reached |= set(coming)
    yield from (f"no link leads to {page}" for page in set(texts) - reached - {site / "search.html"})


def found_by_search(site: Path, word: str) -> list[str]:
    """Titles of the pages that the search finds for a word, or that define a name."""
    text = (site / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text[text.index("{") : text.rindex("}") + 1])
    pages = index["terms"].get(word, [])
    names = [entry[4] if len(entry) > 4 else "" for entries in index["objects"].values() for entry in entries]
    return [index["titles"][i] for i in ([pages] if isinstance(pages, int) else pages)] + [n for n in names if n == word]


PROBE = """<!doctype html><title>probe</title><pre id="told"></pre><script>
const pages = PAGES, told = {};
function light(color) {
  const linear = (c) => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
  const [r, g, b] = color.match(/[\\d.]+/g).slice(0, 3).map((c) => linear(c / 255));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
}
function ground(view, element) {
  for (; element; element = element.parentElement) {
    const color = view.getComputedStyle(element).backgroundColor, parts = color.match(/[\\d.]+/g);
    if (parts.length < 4 || parts[3] > 0.5) return color;
  }
  return "rgb(255, 255, 255)";
}
function contrast(view, element) {
  const a = light(view.getComputedStyle(element).color), b = light(ground(view, element));
  return (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
}
function over(frame, width) {
  frame.width = width;
  const root = frame.contentDocument.documentElement;
  return root.scrollWidth - root.clientWidth;
}
async function look(page, theme) {
  localStorage.setItem("theme", theme);
  const frame = document.createElement("iframe");
  frame.width = 400; frame.height = 800; frame.src = page + ".html";
  document.body.append(frame);
  await new Promise((done) => { frame.onload = done; });
  const view = frame.contentWindow, shown = view.document;
  if (view.MathJax?.startup) await view.MathJax.startup.promise;
  const texts = [...shown.querySelectorAll("article p, article li, article a, article code, article pre span, article td")];
  const seen = texts.filter((e) => e.getClientRects().length && e.textContent.trim() && !e.closest("mjx-container"));
  const poor = seen.filter((e) => contrast(view, e) < READABLE);
  told[page + " " + theme] = {
    wide: over(frame, 400),
    columns: theme == "light" ? Math.max(...[1050, 1320, 1400, 1560].map((width) => over(frame, width))) : 0,
    formulas: shown.querySelectorAll(".math").length,
    rendered: shown.querySelectorAll(".math mjx-container").length,
    wrong: [...shown.querySelectorAll("mjx-merror")].map((e) => e.textContent),
    ground: ground(view, shown.querySelector("article")),
    texts: seen.length,
    poor: [...new Set(poor.map((e) => e.className + " " + e.tagName + " " + view.getComputedStyle(e).color))],
  };
  frame.remove();
}
async function search(words) {
  const frame = document.createElement("iframe");
  frame.src = "search.html?q=" + encodeURIComponent(words);
  document.body.append(frame);
  await new Promise((done) => { frame.onload = done; });
  const found = () => [...frame.contentDocument.querySelectorAll("#search-results li > a")].map((a) => a.textContent);
  const summary = () => frame.contentDocument.querySelector(".search-summary")?.textContent ?? "";
  for (let i = 0; i < 100 && !summary().includes("finished"); i++)
    await new Promise((done) => setTimeout(done, 100));
  told[words] = found();
  await new Promise((done) => setTimeout(done, 300));
  told[words + ", sentences"] = [...frame.contentDocument.querySelectorAll("p.context")].map((p) => p.textContent);
}
async function live() {
  const frame = document.createElement("iframe");
  frame.src = "index.html";
  document.body.append(frame);
  await new Promise((done) => { frame.onload = done; });
  const shown = frame.contentDocument;
  shown.querySelector(".scene-link.live a").click();
  told["live scene"] = shown.querySelector("iframe.scene").src.split("/").slice(-2).join("/");
  frame.remove();
}
(async () => {
  await live();
  await search("load_robot");
  await search("restitution");
  for (const page of pages) for (const theme of ["light", "dark"]) await look(page, theme);
  document.getElementById("told").textContent = JSON.stringify(told);
})();
</script>"""


def seen_in_browser(site: Path, browser: str) -> tuple[dict, list[str]]:
    """({page and theme: what it looks like 400 pixels wide; words: pages found}, messages of the console)."""
    page = PROBE.replace("PAGES", json.dumps(PROBED)).replace("READABLE", str(READABLE))
    (site / "probe.html").write_text(page, encoding="utf-8")
    handler = functools.partial(Quiet, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        server.handle_error = lambda *_: None  # a page that is left takes no more of a file
        threading.Thread(target=server.serve_forever, daemon=True).start()
        flags = [flag for flag in FLAGS if not flag.startswith(("--host-resolver", "--virtual-time"))]
        flags += [
            "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1",
            "--virtual-time-budget=60000",
            "--enable-logging=stderr",
        ]
        flags += ["--enable-logging=stderr", f"--user-data-dir={site.parent}/profile", "--dump-dom"]
        command = [browser, *flags, f"http://127.0.0.1:{server.server_port}/probe.html"]
        run = subprocess.run(command, capture_output=True, text=True, timeout=240, check=False)
        server.shutdown()
    console = [line for line in run.stderr.splitlines() if "CONSOLE" in line]
    return json.loads(re.search(r'<pre id="told">(.*?)</pre>', run.stdout, flags=re.DOTALL)[1]), console


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files and writes nothing to the terminal."""

    def log_message(self, *args: object) -> None:
        """Nothing."""


@pytest.mark.long
def test_the_site_is_whole(tmp_path):
    """One build: no warning, no dead link, no address outside, each page reached, words found; and how it looks in Chromium.

    One test, as a build takes half a minute and workers share nothing.
    """
    site = tmp_path / "site"
    assert built(site) == ""
    assert list(faults(site)) == []
    assert "Contact laws" in found_by_search(site, "friction") and "load_robot" in found_by_search(site, "load_robot")
    theory, example = (
        (site / page).read_text(encoding="utf-8") for page in ("reference/theory.html", "gallery/10_four_bar.html")
    )
    for address in ("../api/rbd.solve.html#rbd.solve", "../source/tests/test_cones.py.html#test_", "../bibliography.html#ref-"):
        assert f'href="{address}' in theory, address
    assert 'href="../scenes/four_bar.html"' in example
    assert all('<script src="shared/' in (site / "scenes" / f"{name}.html").read_text(encoding="utf-8") for name in SCENES)
    assert (site / "_static" / "mathjax" / "tex-chtml-full.js").is_file()
    size = sum(file.stat().st_size for file in site.rglob("*") if file.is_file())
    assert size < 36e6  # all scenes, of which three are built here, add 5 MB
    browser = find_browser()
    if browser is None:
        pytest.skip("Chromium is not installed: links hold, and how pages look is not tested")
    seen, console = seen_in_browser(site, browser)
    assert console == []
    assert seen.pop("live scene") == "scenes/talos.html"
    assert "rbd.load_robot" in seen.pop("load_robot") and seen.pop("load_robot, sentences")
    found, sentences = seen.pop("restitution"), seen.pop("restitution, sentences")
    assert found and sentences and all("restitution" in sentence.lower() for sentence in sentences)
    for page, look in seen.items():
        assert look["wide"] <= 0 and look["columns"] <= 0, page
        assert look["formulas"] == look["rendered"] and look["wrong"] == [], page
        assert look["texts"] > 10 and look["poor"] == [], page
    assert seen["reference/theory light"]["formulas"] > 15
    assert all(seen[f"{page} light"]["ground"] != seen[f"{page} dark"]["ground"] for page in PROBED)


def test_faults_of_a_site_are_noticed(tmp_path):
    """The checks above can fail."""
    front = '<a href="one.html#here">1</a><a href="gone.html">2</a><img src="https://example.org/x.png">'
    (tmp_path / "index.html").write_text(front)
    (tmp_path / "one.html").write_text('<p id="there">1</p><style>p { background: url(//example.org/y.png) }</style>')
    (tmp_path / "lost.html").write_text("<p>nobody links here</p>")
    said = "\n".join(faults(tmp_path))
    for fault in (
        "dead link gone.html",
        "dead anchor one.html#here",
        "index.html: outside, https",
        "lost.html",
        "one.html: outside",
    ):
        assert fault in said


def test_mathjax_is_installed():
    """What the site copies is in the package."""
    assert all((mathjax.mathjax_folder() / name).exists() for name in mathjax.NEEDED)


def test_every_public_name_has_one_home():
    """A name on top is documented on top, wherever it is imported from; the groups on top hold each name once."""
    homes = public.homes()
    assert homes["rbd.model.State"] == "rbd.State" and homes["rbd.statics.hold"] == "rbd.hold"
    assert homes["rbd.statics.zmp"] == "rbd.statics.zmp"
    assert links.documented("rbd.model.State.q") == "rbd.State.q" and links.documented("rbd.nothing") is None
    assert sorted(" ".join(public.GROUPS.values()).split()) == sorted(public.names_of("rbd"))


def test_a_source_page_has_an_anchor_at_each_function():
    """Links to a test lead to the line where it begins."""
    file = Path(__file__)
    html = sources.html_of(file)
    assert sources.address(file, "test_mathjax_is_installed") == "source/tests/test_site.py.html#test_mathjax_is_installed"
    assert sources.address(file, "log_message") == "source/tests/test_site.py.html#Quiet.log_message"
    assert '<i id="test_mathjax_is_installed"></i>def test_mathjax_is_installed' in html
    shown = re.sub(r"<[^>]+>", "", html[html.index("<pre") :]).replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&")
    assert shown.strip() == file.read_text(encoding="utf-8").strip()


def test_the_pages_of_rooms_list_every_module_once():
    """A module stands on its room's page alone, with the first line of its docstring."""
    made = modules.pages()
    names = [name for text in made.values() for name in re.findall(r"^- `(rbd[\w.]+)`: \S", text, flags=re.MULTILINE)]
    files = [file for file in (TOP / "rbd").rglob("*.py") if not file.name.startswith("__")]
    assert sorted(names) == sorted(file.relative_to(TOP).with_suffix("").as_posix().replace("/", ".") for file in files)
    assert "- `rbd.answers.many.states`: Many states" in made["modules/rbd.answers.md"]
    assert modules.address("rbd.answers.many") == "modules/rbd.answers.html#rbd-answers-many"
    assert modules.address("rbd") == "modules/rbd.html"


def test_the_source_of_an_error_is_the_file_that_writes_it():
    """Errors name their package as their module; [source] leads to the module in it."""
    written = {"CannotHold": "no_solution", "ModelWarning": "warned", "RbdError": "reasons", "nearest": "inputs"}
    for name, file in written.items():
        assert public.place_of(f"rbd.errors.{name}") == (TOP / f"rbd/errors/{file}.py", name)
    assert public.place_of("rbd.Solution") == (TOP / "rbd/answers/solution.py", "Solution")


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("|v| is a size", r"\|v\| is a size"),
        ("`|v|` and `Rows`s", r"`|v|` and `Rows`\ s"),
        ("2 * 3, x**2", r"2 \* 3, x\*\*2"),
        ("an *emphasis*", "an *emphasis*"),
    ],
)
def test_docstrings_are_read_as_written(line, expected):
    """Bars, stars and an s after code are no markup."""
    assert api.plain(line) == expected


def marked(text: str) -> str:
    """Running text as the site sets it, with tags."""
    tags = {"subscript": "sub", "superscript": "sup"}

    def written(node) -> str:
        inside = "".join(written(child) for child in node.children) or node.astext()
        return f"<{tags[node.tagname]}>{inside}</{tags[node.tagname]}>" if node.tagname in tags else inside

    return "".join(written(node) for node in subscripts.split(text)) or text


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("the free motion a_free, and f_n > 0", "the free motion a<sub>free</sub>, and f<sub>n</sub> > 0"),
        ("|f_t| ≤ μ f_n", "|f<sub>t</sub>| ≤ μ f<sub>n</sub>"),
        ("h = q̇ᵀC q̇ − τ_g, q̈_free", "h = q̇ᵀC q̇ − τ<sub>g</sub>, q̈<sub>free</sub>"),
        ("½‖a − a_free‖²_M", "½‖a − a<sub>free</sub>‖²<sub>M</sub>"),
        ("λᵀ(J_c a) and p_WF", "λᵀ(J<sub>c</sub> a) and p<sub>WF</sub>"),
        ("Σ (τ_i / τ_max,i)², 2θ_1", "Σ (τ<sub>i</sub> / τ<sub>max,i</sub>)², 2θ<sub>1</sub>"),
        ("J a + J_dot v = 0", "J a + J\u0307 v = 0"),
        ("f = J^T λ, M^-1, |x|^2", "f = J<sup>T</sup> λ, M<sup>−1</sup>, |x|<sup>2</sup>"),
        ("L_2 e^(iθ₂) = s e^{iθ_k}", "L<sub>2</sub> e<sup>iθ₂</sup> = s e<sup>iθ<sub>k</sub></sup>"),
    ],
)
def test_letters_in_running_text_get_their_indices(text, expected):
    """One letter, dotted or in bars, with its index or exponent."""
    assert marked(text) == expected


@pytest.mark.parametrize(
    "text",
    ["test_docs", "tau_ext of a robot", "mj_step", "x86_64", "01_stand.py", "rbd.q_free", "a_b_c", "f_", "_x", "^T", "a ^ b"],
)
def test_names_in_running_text_stay(text):
    """Names of several letters, of files and of functions are no formulas."""
    assert marked(text) == text and subscripts.split(text) == []


def test_examples_and_formulas_of_docstrings_stay_as_they_are():
    """What an example prints has its stars, as what stands after `::` does; the text after it is escaped again."""
    lines = ["a formula::", "", "    c * d", "", ">>> det", "l_1*l_2", "", "e * f"]
    api.read_as_written(None, "function", "name", None, None, lines)
    assert lines == ["a formula::", "", "    c * d", "", ">>> det", "l_1*l_2", "", r"e \* f"]


def test_the_search_knows_the_sections_of_the_site():
    """Every section whose pages the search shows earlier or later exists."""
    script = (TOP / "docs" / "site" / "scorer.js").read_text(encoding="utf-8")
    sections = re.findall(r"(\w+): -?\d", script[script.index("SECTIONS = {") : script.index("};")])
    made = {"gallery", "changelog", "contributing", "modules"}  # pages that the build makes
    assert sections and all(s in made or (TOP / "docs" / s).is_dir() or (TOP / "docs" / f"{s}.md").is_file() for s in sections)


def test_the_bibliography_has_no_address():
    """Authors with their accents, titles, years; identifiers as text."""
    page = bibliography.page()
    assert "://" not in page and "Jean Jacques Moreau" in page and "Stéphane Caron" in page
    assert all(f"**{key}**" in page for key in bibliography.keys())


def test_every_example_has_a_page():
    """With its question; links of examples/README.md lead to pages of the site."""
    pages = gallery.pages()
    for file in (TOP / "examples").glob("[0-9][0-9]_*.py"):
        assert f"gallery/{file.stem}.md" in pages
    assert "](../" not in "".join(pages.values())
    assert gallery.sections()["14-falls-simulate-pushes-until-it-falls"] == "14_push_recovery"


def test_scenes_share_the_viewer_and_equal_triangles():
    """Two scenes of one robot: the viewer and the robot's triangles stand once, each page has its pieces in its order."""
    import rbd
    from rbd.visual import Scene

    robot, raw = rbd.mechanism.four_bar(1.0, 3.0, 2.0, 2.5), {}
    for name, posture in (("one", "assembled"), ("two", "neutral")):
        with Scene(robot) as scene:
            scene.show(robot.at(posture) if posture in robot.postures else robot.at())
            raw[name] = scene.page()
    raw["both"] = f'<iframe srcdoc="{html.escape(raw["one"])}"></iframe>'
    made = shared_scenes.shared(raw)
    assert set(made) >= {"one.html", "two.html", "both.html"}
    assert sum('id: "library"' in text for text in made.values()) == 1
    assert sum(map(len, made.values())) < 0.5 * sum(map(len, raw.values()))
    for name in raw:
        inside = html.unescape(made[f"{name}.html"])
        order = json.loads(re.search(r"order = (\[\[.*?\]\]);", inside)[1])
        kept = []
        for group, i in order:
            data, sizes = json.loads(made[f"shared/{group}.js"].split("] = ")[1].rstrip(";\n"))
            whole = zlib.decompress(base64.b64decode(data))
            kept.append(whole[sum(sizes[:i]) : sum(sizes[: i + 1])])
            assert f'src="shared/{group}.js"' in inside
        assert tuple(kept) == next(shared_scenes._scenes(raw[name])).pieces
        assert "script-src 'unsafe-inline' 'self' file:" in inside


def test_tests_behind_a_formula_are_folded():
    """What names the code stays, the tests go into a block that opens; a paragraph without tests stays as it is."""
    document = docutils.utils.new_document("page")
    first, second = nodes.literal("", "tests/test_cones.py::test_a"), nodes.literal("", "tests/test_law.py")
    tests = [first, nodes.Text(","), nodes.Text("\n"), second]
    named = nodes.paragraph("", "", nodes.Text("In code: x. Tests:"), nodes.Text("\n"), *tests, nodes.Text(". More."))
    document += [named, nodes.paragraph("", "", nodes.Text("Tests: none."))]
    folded.fold_tests(None, document)
    texts = [child.astext() for child in document]
    assert texts[0] == "In code: x. More." and texts[2].split() == ["tests/test_cones.py::test_a,", "tests/test_law.py"]
    assert "<summary>2 tests</summary>" in texts[1] and texts[3:] == ["</details>", "Tests: none."]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("M v+ = M v + J^T p", r"M v^{+} = M v + J^{\top} p"),
        ("1/2 |a - a_free|_M^2", r"\tfrac12  \vert a - a_{\rm free}\vert _{M}^{2}"),
        ("J a + J_dot v in K*", r"J a + \dot J v\text{ in }K^{*}"),
        ("|M a - rhs|", r"\vert M a - \mathrm{rhs}\vert "),
    ],
)
def test_formulas_of_docstrings_are_set_as_mathematics(line, expected):
    """Letters as symbols, words as words."""
    assert formulas.tex(line).replace(" \\text", r"\text").replace("} K", "}K") == expected


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("Its rows obey J a + J_dot v = 0, shape (m,).", ["J a + J_dot v = 0"]),
        ("Used is |f_t| / (mu f_n) of a point, of\nM a + h =\nS^T tau.", ["|f_t| / (mu f_n)", "M a + h = S^T tau"]),
        ("A point is a force [kg m^2], x_i and a number 2 of q; a.b^2; f(x)^2; w = d^2 @ e.", []),
    ],
)
def test_formulas_in_sentences_of_docstrings_are_set(text, expected):
    """Articles, units, names of Python and parts of longer expressions stay."""
    assert [node.rawsource for node in formulas.inline(text) if isinstance(node, nodes.math)] == expected


def test_pages_lose_only_what_says_nothing():
    """Code blocks keep their lines, pictures get their new ending, marks of signatures go."""
    page = '<p>\n   <span class="pre">a</span>\n\n</p><pre>b\n\n   c</pre>'
    page += '<img src="_images/x.png"><a title="Link to this heading">'
    assert smaller.smaller(page) == '<p>\na\n</p><pre>b\n\n   c</pre><img src="_images/x.webp"><a>'
