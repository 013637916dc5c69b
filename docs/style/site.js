// What screen readers need and the theme lacks: names of landmarks, levels of captions, the search page's heading, and
// no role for the lists that Sphinx makes of long signatures.
for (const aside of document.querySelectorAll("aside")) {
  aside.setAttribute("aria-label", aside.matches(".toc-drawer") ? "On this page" : "Site");
}
for (const caption of document.querySelectorAll('p.caption[role="heading"]')) {
  caption.setAttribute("aria-level", "2");
}
for (const list of document.querySelectorAll("dt.sig > dl")) {
  list.setAttribute("role", "presentation");
}
const results = document.getElementById("search-results");
if (results) {
  results.insertAdjacentHTML("beforebegin", "<h1>Search</h1>");
}
