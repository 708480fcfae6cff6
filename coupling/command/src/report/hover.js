// Reads values back from the figures: a line at the same time in all of them, a tooltip in the one under the pointer.
(() => {
  "use strict";
  const tip = document.getElementById("tip");
  const numbers = (text) => text.split(" ").map(Number);
  const plots = [...document.querySelectorAll("svg.plot")].map((svg) => {
    const [left, right, top, bottom] = numbers(svg.dataset.frame);
    const [t0, t1, v0, v1] = numbers(svg.dataset.domain);
    const cursor = document.createElementNS(svg.namespaceURI, "path");
    cursor.setAttribute("class", "cursor");
    svg.append(cursor);
    return { svg, left, right, top, bottom, t0, t1, v0, v1, cursor, lines: null };
  });
  const points = (path) =>
    [...path.getAttribute("d").matchAll(/[ML]([-\d.]+) ([-\d.]+)/g)].map((m) => [+m[1], +m[2]]);
  const value = (plot, y) => {
    const v = plot.v0 + ((plot.bottom - y) / (plot.bottom - plot.top)) * (plot.v1 - plot.v0);
    return plot.svg.dataset.log ? 10 ** v : v;
  };
  const text = (v, range) => {
    if (range === null) return v.toExponential(1).replace("-", "−");
    const decimals = Math.max(0, 3 - Math.max(0, Math.floor(Math.log10(range)) + 1));
    return v.toFixed(decimals).replace("-", "−");
  };
  const show = (event, html) => {
    tip.innerHTML = html;
    tip.hidden = false;
    const box = tip.getBoundingClientRect();
    const x = event.clientX + 16 + box.width > innerWidth ? event.clientX - box.width - 12 : event.clientX + 16;
    tip.style.left = Math.max(4, x) + "px";
    tip.style.top = Math.max(4, Math.min(event.clientY + 12, innerHeight - box.height - 4)) + "px";
  };
  const clear = () => {
    tip.hidden = true;
    for (const plot of plots) plot.cursor.removeAttribute("d");
  };
  const safe = (s) => s.replace(/[&<>]/g, (c) => ({ "&": "&amp;", "<": "&lt;", ">": "&gt;" })[c]);
  const main = document.querySelector("main");
  const start = Number(main.querySelector("header").dataset.start);
  const end = Number(main.querySelector("header").dataset.end);
  const fraction = main.querySelector("header").dataset.fraction;
  const when = (t) =>
    fraction
      ? `${(100 * t).toFixed(1)} %`
      : t.toFixed(3) + " s" + (end > start ? ` · ${((100 * (t - start)) / (end - start)).toFixed(1)} %` : "");

  for (const plot of plots) {
    plot.svg.addEventListener("pointermove", (event) => {
      const box = plot.svg.getBoundingClientRect();
      const x = ((event.clientX - box.left) / box.width) * plot.svg.viewBox.baseVal.width;
      if (x < plot.left || x > plot.right) return clear();
      plot.lines ??= [...plot.svg.querySelectorAll("path.line")].map((path) => ({
        name: path.dataset.name,
        colour: getComputedStyle(path).stroke,
        points: points(path),
      }));
      const t = plot.t0 + ((x - plot.left) / (plot.right - plot.left)) * (plot.t1 - plot.t0);
      for (const other of plots) {
        const at = other.left + ((t - other.t0) / (other.t1 - other.t0)) * (other.right - other.left);
        other.cursor.setAttribute("d", `M${at} ${other.top}V${other.bottom}`);
      }
      const { unit, log, right, rightUnit } = plot.svg.dataset;
      const range = log ? null : Math.max(Math.abs(plot.v0), Math.abs(plot.v1));
      const rows = plot.lines.map((line) => {
        let near = null;
        for (const p of line.points) if (!near || Math.abs(p[0] - x) < Math.abs(near[0] - x)) near = p;
        if (!near || Math.abs(near[0] - x) > 6) return "";
        const v = value(plot, near[1]);
        const second = right ? ` · ${(v / right).toFixed(2)} ${safe(rightUnit)}` : "";
        return `<div><i style="background:${line.colour}"></i>${safe(line.name)}<b>${text(v, range)} ${safe(unit)}${second}</b></div>`;
      });
      show(event, `<div class="when">${when(t)}</div>` + rows.join(""));
    });
    plot.svg.addEventListener("pointerleave", clear);
  }
  for (const map of document.querySelectorAll("svg.heatmap")) {
    const [left, right] = numbers(map.dataset.frame);
    const rows = [...map.querySelectorAll(".row")];
    map.addEventListener("pointermove", (event) => {
      const box = map.getBoundingClientRect();
      const scale = map.viewBox.baseVal.width / box.width;
      const [x, y] = [(event.clientX - box.left) * scale, (event.clientY - box.top) * scale];
      const row = rows.find((r) => Math.abs(r.dataset.y - y) <= 6.5);
      if (!row || x < left || x >= right) return clear();
      const values = row.dataset.values.split(",");
      const i = Math.floor(((x - left) / (right - left)) * values.length);
      const note = values[i] === "" ? "no solution" : values[i] + " %";
      show(event, `<div class="when">frame ${i + 1}</div><div>${safe(row.dataset.name)}<b>${note}</b></div>`);
    });
    map.addEventListener("pointerleave", clear);
  }
})();
