// Parts that fold: open on a screen, closed on a phone, where the page would else be endless; on printing all are open.

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

// Open the part that the address names.
function openNamed() {
  const part = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (part) reveal(part);
}

export function reveal(part) {
  const folded = part.closest("details");
  if (folded) folded.open = true;
  part.scrollIntoView({ block: "start" });
}
