// What the theme leaves out for screen readers: names of its landmarks, levels of its captions.
for (const aside of document.querySelectorAll("aside")) {
  aside.setAttribute("aria-label", aside.matches(".toc-drawer") ? "On this page" : "Site");
}
for (const caption of document.querySelectorAll('p.caption[role="heading"]')) {
  caption.setAttribute("aria-level", "2");
}
