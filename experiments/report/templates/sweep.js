// Tables sorted by a click on a head; runs picked by a click on their number.
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
const list = document.getElementById("runs");
function pick(text) {
  const parts = text ? text.split(", ").map(part => {
    const [first, last, step] = part.split(/[-/]/).map(Number);
    return [first, last ?? first, step ?? 1];
  }) : null;
  let shown = 0;
  for (const row of list.querySelectorAll("tbody tr")) {
    const run = Number(row.cells[0].textContent);
    row.hidden = parts !== null &&
      !parts.some(([first, last, step]) => run >= first && run <= last && (run - first) % step === 0);
    shown += !row.hidden;
  }
  document.getElementById("picked").textContent = parts === null ? "" : `${shown} picked.`;
  document.getElementById("all").hidden = parts === null;
}
function follow() {
  const match = /^#runs=(.+)$/.exec(decodeURIComponent(location.hash));
  if (!match) return;
  pick(match[1]);
  list.open = true;
  list.scrollIntoView();
}
document.getElementById("all").onclick = () => { pick(null); history.replaceState(null, "", "#runs"); };
addEventListener("hashchange", follow);
follow();
