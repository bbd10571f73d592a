/* How the site's search ranks what it finds: pages that say how something is done come before lists and records of it. */
var Scorer = {
  score: ([page, , , , score]) =>
    score + (page.startsWith("how-to/") ? 4 : page.startsWith("reference/") ? -4 : 0),
  // the rest as Sphinx has it, but for objects, which stood above every page
  objNameMatch: 5,
  objPartialMatch: 2,
  objPrio: {0: 5, 1: 0, 2: -5},
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
