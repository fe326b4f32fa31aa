"use strict";
// Sorting and filtering of the drives. Without it the page shows all of them, in the order of the suite.
{
  const table = document.getElementById("all-drives");
  const body = table.tBodies[0];
  const rows = Array.from(body.rows, (row, place) => ({ row, place, text: row.textContent.toLowerCase() }));
  const form = document.getElementById("filters");
  const count = document.getElementById("count");
  const numeric = new Intl.Collator("en", { numeric: true });
  const last = table.tHead.rows[0].cells.length - 1;

  const valueOf = (row, column) => row.cells[column].dataset.value ?? row.cells[column].textContent;

  function sortBy(column, direction) {
    const order = direction === "descending" ? -1 : 1;
    const sorted = direction === "none" ? [...rows] : [...rows].sort((a, b) =>
      order * numeric.compare(valueOf(a.row, column), valueOf(b.row, column)) || a.place - b.place);
    body.append(...sorted.map((each) => each.row));
    Array.from(table.tHead.rows[0].cells).slice(0, last).forEach((cell, i) =>
      cell.setAttribute("aria-sort", i === column ? direction : "none"));
  }

  Array.from(table.tHead.rows[0].cells).slice(0, last).forEach((cell, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = cell.textContent;
    cell.replaceChildren(button);
    cell.setAttribute("aria-sort", "none");
    button.addEventListener("click", () => {
      const next = { none: "ascending", ascending: "descending", descending: "none" };
      sortBy(column, next[cell.getAttribute("aria-sort")]);
    });
  });

  function filter() {
    const words = form.text.value.toLowerCase().split(/\s+/).filter(Boolean);
    const { value: line } = form.line, { value: family } = form.family, { checked: lost } = form.lost;
    let shown = 0;
    for (const { row, text } of rows) {
      row.hidden = !((!line || row.dataset.line === line) && (!family || row.dataset.family === family)
        && (!lost || "lost" in row.dataset) && words.every((word) => text.includes(word)));
      shown += row.hidden ? 0 : 1;
    }
    count.textContent = shown === rows.length ? `${shown} drives` : `${shown} of ${rows.length} drives`;
  }

  // A link to a drive that the filters hide shows it all the same.
  function reveal() {
    const wanted = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    if (wanted?.hidden) {
      form.reset();
      filter();
      wanted.scrollIntoView({ block: "center" });
    }
  }

  form.hidden = false;
  form.addEventListener("input", filter);
  form.addEventListener("reset", () => setTimeout(filter));
  form.addEventListener("submit", (event) => event.preventDefault());
  addEventListener("hashchange", reveal);
  filter();
}
