// Sections that fold: open on a screen and in print, closed on a phone.

const phone = matchMedia("(max-width: 720px)");
const printing = matchMedia("print");

export const isNarrow = () => phone.matches;

export function beginFolding() {
  const parts = [...document.querySelectorAll("details.part")];
  for (const part of parts) part.open = !phone.matches || part.id === "ranking";
  let before = [];
  printing.addEventListener("change", (event) => {
    const all = [...document.querySelectorAll("details")];
    if (event.matches) before = all.filter((part) => !part.open);
    for (const part of before) part.open = event.matches;
  });
  addEventListener("hashchange", openNamed);
  openNamed();
}

// Open the section in the address.
function openNamed() {
  const part = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (part) reveal(part);
}

export function reveal(part) {
  const folded = part.closest("details");
  if (folded) folded.open = true;
  part.scrollIntoView({ block: "start" });
}
