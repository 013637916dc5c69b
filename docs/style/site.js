// What screen readers need and the theme lacks: names of landmarks and of the gallery's pictures, levels of captions, a
// heading of the search page, and no role for empty heads of columns and for the lists that Sphinx makes of signatures.
for (const aside of document.querySelectorAll("aside")) {
  aside.setAttribute("aria-label", aside.matches(".toc-drawer") ? "On this page" : "Site");
}
for (const caption of document.querySelectorAll('p.caption[role="heading"]')) {
  caption.setAttribute("aria-level", "2");
}
for (const item of document.querySelectorAll("dt.sig > dl, th.head:has(> p:empty)")) {
  item.setAttribute("role", "presentation");
}
for (const link of document.querySelectorAll(".sphx-glr-thumbcontainer a")) {
  link.setAttribute("aria-label", link.textContent);
}
const results = document.getElementById("search-results");
if (results) {
  results.insertAdjacentHTML("beforebegin", "<h1>Search</h1>");
}
