"use strict";
// Sorting and filtering of the drives. Without it the page shows all of them, in the order of the suite.
{
  // What is long where columns stand below one another is folded there.
  const narrow = window.matchMedia("(max-width: 60rem)").matches;
  if (narrow) document.querySelectorAll(".unfolded").forEach((box) => { box.open = false; });
  const form = document.getElementById("filters");
  const count = document.getElementById("count");
  const numeric = new Intl.Collator("en", { numeric: true });

  /** What a search looks at: not the commands that make replays, in the last cell. */
  function told(row) {
    return Array.from(row.cells).slice(0, -1).map((cell) => cell.textContent).join(" ").toLowerCase();
  }

  const families = Array.from(document.querySelectorAll(".family"), (box) => {
    const [table, every] = [box.querySelector(".drives"), box.querySelector(".every")];
    const rows = Array.from(table.tBodies[0].rows, (row, place) => ({ row, place, text: told(row) }));
    return { box, every, table, rows, name: box.dataset.family };
  });
  const drives = families.reduce((sum, { rows }) => sum + rows.length, 0);

  const valueOf = (row, column) => row.cells[column].dataset.value ?? row.cells[column].textContent;

  /** Numbers by their value, which a collator does not know of decimals; all else as people sort. */
  function compared(a, b) {
    const [one, other] = [Number(a), Number(b)];
    const numbers = a.trim() !== "" && b.trim() !== "" && Number.isFinite(one) && Number.isFinite(other);
    return numbers ? one - other : numeric.compare(a, b);
  }

  function sortBy({ table, rows }, column, direction) {
    const order = direction === "descending" ? -1 : 1;
    const sorted = direction === "none" ? [...rows] : [...rows].sort((a, b) =>
      order * compared(valueOf(a.row, column), valueOf(b.row, column)) || a.place - b.place);
    table.tBodies[0].append(...sorted.map((each) => each.row));
    headers(table).forEach((cell, i) => cell.setAttribute("aria-sort", i === column ? direction : "none"));
  }

  /** All but the last, under which the replays lie. */
  function headers(table) {
    return Array.from(table.tHead.rows[0].cells).slice(0, -1);
  }

  for (const family of families) {
    headers(family.table).forEach((cell, column) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = cell.textContent;
      cell.replaceChildren(button);
      cell.setAttribute("aria-sort", "none");
      button.addEventListener("click", () => {
        const next = { none: "ascending", ascending: "descending", descending: "none" };
        sortBy(family, column, next[cell.getAttribute("aria-sort")]);
      });
    });
  }

  function filter() {
    const words = form.text.value.toLowerCase().split(/\s+/).filter(Boolean);
    const { value: line } = form.line, { value: family } = form.family, { checked: lost } = form.lost;
    const narrowed = Boolean(line || family || lost || words.length);
    let shown = 0;
    for (const { box, every, rows, name } of families) {
      let here = 0;
      for (const { row, text } of rows) {
        row.hidden = !((!line || row.dataset.line === line) && (!family || name === family)
          && (!lost || "lost" in row.dataset) && words.every((word) => text.includes(word)));
        here += row.hidden ? 0 : 1;
      }
      box.hidden = narrowed && !here;
      if (narrowed && here) box.open = every.open = true;
      box.querySelector(".heat").hidden = narrowed;
      shown += here;
    }
    count.textContent = shown === drives ? `${shown} drives` : `${shown} of ${drives} drives`;
  }

  // A link to a drive that the filters hide, or that lies in a family that is folded, shows it all the same.
  function reveal() {
    const wanted = document.getElementById(decodeURIComponent(location.hash.slice(1)));
    const family = wanted?.closest(".family");
    if (!family) return;
    if (wanted.hidden || family.hidden) {
      form.reset();
      filter();
    }
    family.open = wanted.closest(".every").open = true;
    wanted.scrollIntoView({ block: "center" });
  }

  form.hidden = false;
  form.addEventListener("input", filter);
  form.addEventListener("reset", () => setTimeout(filter));
  form.addEventListener("submit", (event) => event.preventDefault());
  addEventListener("hashchange", reveal);
  addEventListener("beforeprint", () => families.forEach(({ box, every }) => { box.open = every.open = true; }));
  filter();
  reveal();
}
