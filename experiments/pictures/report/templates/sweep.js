// Tables sorted by a click on a head.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells];
  heads.forEach((head, column) => {
    const button = document.createElement("button");
    button.type = "button";
    button.append(...head.childNodes);
    head.append(button);
    button.onclick = () => {
      const up = head.ariaSort !== "ascending";
      heads.forEach(other => other.removeAttribute("aria-sort"));
      head.ariaSort = up ? "ascending" : "descending";
      const key = row => row.cells[column].dataset.v ?? row.cells[column].textContent.trim();
      const order = (a, b) => {
        if (a === "" || b === "") return (a === "") - (b === "");  // no figure: last, both ways
        const by = isNaN(a) || isNaN(b) ? a.localeCompare(b, "en", {numeric: true}) : a - b;
        return up ? by : -by;
      };
      const body = table.tBodies[0];
      body.append(...[...body.rows].map(row => [key(row), row])
        .sort((one, other) => order(one[0], other[0])).map(pair => pair[1]));
    };
  });
}
