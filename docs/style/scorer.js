// Order of the search's results: Sphinx's score, then how many of the query's words the title has, then the kind of page.
const WORDS = (new URLSearchParams(location.search).get("q") ?? "").toLowerCase().match(/[\p{L}\d]{3,}/gu) ?? [];
const KINDS = [[/^(how-to|tutorials)\//, 4], [/^(explanation|theory|reference|results)\//, 2], [/(^|\/)index$/, -8]];
Scorer = {
  score: ([page, title, , , score]) => {
    const inTitle = WORDS.filter((word) => title.toLowerCase().includes(word.replace(/s$/, ""))).length;
    const kind = KINDS.find(([pattern]) => pattern.test(page))?.[1] ?? 0;
    return score + (20 * inTitle) / Math.max(WORDS.length, 1) + kind;
  },
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 15,
  partialTitle: 7,
  term: 5,
  partialTerm: 2,
};
