/* What the search shows first: pages for users before pages on how the package is built; a class before its members. */
const SECTIONS = { tasks: 6, courses: 4, reference: 4, start: 4, gallery: 2, design: -3, architecture: -3, modules: -3, contributing: -3, changelog: -4 };

var Scorer = {
  score: ([docname, title, anchor, descr, score]) => {
    const member = docname.startsWith("api/") && anchor && anchor !== "#" + docname.slice("api/".length);
    return score + (SECTIONS[docname.split("/")[0]] ?? 0) - (member ? 8 : 0);
  },
  // Below, the values of Sphinx.
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
