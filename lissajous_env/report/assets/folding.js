// Sections that fold, and open when the address or a link names them.

import { byId } from "./words.js";
export function beginFolding() {
  addEventListener("hashchange", openNamed);
  openNamed();
}

function openNamed() {
  const part = byId(decodeURIComponent(location.hash.slice(1)));
  if (part) reveal(part);
}

export function reveal(part) {
  const folded = part.closest("details");
  if (folded) folded.open = true;
  part.scrollIntoView({ block: "start" });
}
