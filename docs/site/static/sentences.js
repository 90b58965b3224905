// A result of the search shows the sentence that has most of the words, from texts.js: a page on a disk may fetch none.
document.addEventListener("DOMContentLoaded", () => {
  if (typeof Search === "undefined") return;
  window.fetch = async (address) => ({ text: async () => String(address) });
  Search.makeSearchSummary = (address, words, anchor) => {
    const page = new URL(address, location.href).pathname, root = new URL(document.documentElement.dataset.content_root, location.href).pathname;
    const said = window.pageTexts[decodeURI(page.slice(root.length)).replace(/\.html$/, "")] ?? [];
    const here = said.filter(([id]) => anchor && "#" + id === anchor);
    const asked = [...words].map((word) => word.toLowerCase());
    let best = "", most = 0;
    for (const [, text] of here.length ? here : said) {
      for (const sentence of text.split(/\n|(?<=[.!?:])\s+(?=[A-Z\u0391-\u03c9`])/)) {
        const low = sentence.toLowerCase(), n = asked.filter((word) => low.includes(word)).length;
        if (n > most) [best, most] = [sentence, n];
      }
    }
    if (!best) return document.createDocumentFragment();
    const first = Math.min(...asked.map((word) => best.toLowerCase().indexOf(word)).filter((i) => i >= 0));
    const from = best.length > 260 ? Math.max(0, best.lastIndexOf(" ", Math.max(0, first - 100)) + 1) : 0;
    const text = (from ? "\u2026 " : "") + best.slice(from, from + 260) + (best.length > from + 260 ? " \u2026" : "");
    return Object.assign(document.createElement("p"), { className: "context", textContent: text });
  };
});
