// Sort a table by a click on a heading, by `data-value` of the cells, missing values last.

export function sortable(table) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    head.querySelector("button")?.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of heads) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const value = (row) => row.cells[column].dataset.value;
      const rows = [...table.tBodies[0].rows].sort((a, b) => ordered(value(a), value(b), down));
      table.tBodies[0].append(...rows);
    });
  });
}

// Compare two values; missing ones come last.
export function ordered(a, b, down) {
  const none = (value) => value === undefined || value === null;
  if (none(a) || none(b)) return Number(none(a)) - Number(none(b));
  return down ? Number(b) - Number(a) : Number(a) - Number(b);
}
