"use strict";
(() => {
  const { specs, files } = JSON.parse(document.getElementById("data").textContent);
  const root = document.documentElement;
  const darkScreen = matchMedia("(prefers-color-scheme: dark)");
  const all = (selector, within = document) => [...within.querySelectorAll(selector)];

  // Colours: "@agent" or "@agent/opacity" in a spec become the page's own, which follow light and dark.
  function colour(name) {
    const [key, opacity] = name.slice(1).split("/");
    const style = getComputedStyle(root);
    const value = ["--" + key, "--agent-" + key]
      .map((variable) => style.getPropertyValue(variable).trim())
      .find((found) => found);
    if (!opacity) return value;
    const part = (at) => parseInt(value.slice(at, at + 2), 16);
    return `rgba(${part(1)},${part(3)},${part(5)},${opacity})`;
  }

  function resolved(value) {
    if (typeof value === "string") return /^@[\w/.]+$/.test(value) ? colour(value) : value;
    if (Array.isArray(value)) return typeof value[0] === "number" ? value : value.map(resolved);
    if (value && typeof value === "object")
      return Object.fromEntries(Object.entries(value).map(([key, inner]) => [key, resolved(inner)]));
    return value;
  }

  const axis = { color: "@muted", gridcolor: "@rule", zeroline: false, linecolor: "@rule", ticks: "outside", tickcolor: "@rule" };
  const NARROW = 460; // pixels: below, or where they are long, the names of a forest plot's rows stand over their rows

  function layoutOf(spec, width) {
    const own = structuredClone(spec.layout);
    const layout = {
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", hovermode: "closest", dragmode: "zoom",
      font: { family: getComputedStyle(document.body).fontFamily, size: 12, color: "@ink" },
      hoverlabel: { bgcolor: "@paper", bordercolor: "@rule", font: { color: "@ink" } },
      ...own,
      margin: own.margin ?? { l: 8, r: 14, t: 8, b: 8 },
      xaxis: { ...axis, ...own.xaxis },
      yaxis: { ...axis, ...own.yaxis },
    };
    layout.xaxis.nticks = width < NARROW ? 5 : 8;
    const rows = own.yaxis?.ticktext;
    const named = rows && (width < NARROW || 6.5 * Math.max(...rows.map((text) => text.length)) > width / 2);
    if (named) {
      layout.yaxis.ticktext = rows.map(() => "");
      layout.annotations = rows.map((text, row) => ({
        text, x: 0, xref: "paper", xanchor: "left", y: row, yanchor: "bottom", yshift: 9, showarrow: false, font: { size: 11 },
      }));
      layout.yaxis.range = [rows.length - 0.5, -0.8];
    }
    return [resolved(layout), named ? 70 + 46 * rows.length : spec.height];
  }

  const config = { responsive: false, displaylogo: false, displayModeBar: false, doubleClick: "reset" };

  function draw(plot) {
    const spec = specs[plot.dataset.spec];
    const width = plot.clientWidth;
    if (!width) return;
    const [layout, height] = layoutOf(spec, width);
    plot.style.height = height + "px";
    const hidden = new Set(all(".legend [aria-pressed=false]", plot.closest("figure")).map((button) => button.dataset.agent));
    const data = resolved(spec.data).map((trace) => (hidden.has(trace.meta) ? { ...trace, visible: false } : trace));
    Plotly.react(plot, data, { ...layout, width, height }, config);
    plot.dataset.drawn = width;
  }

  // Plots are drawn when they come near the screen.
  const near = new IntersectionObserver(
    (entries) => entries.forEach((entry) => {
      if (entry.isIntersecting && !entry.target.dataset.drawn) draw(entry.target);
    }),
    { rootMargin: "600px" },
  );
  const plots = all(".plot");
  plots.forEach((plot) => near.observe(plot));
  const redraw = () => plots.filter((plot) => plot.dataset.drawn).forEach(draw);

  let waiting;
  new ResizeObserver(() => {
    clearTimeout(waiting);
    waiting = setTimeout(() => plots
      .filter((plot) => plot.dataset.drawn && +plot.dataset.drawn !== plot.clientWidth)
      .forEach(draw), 120);
  }).observe(document.body);

  // Light and dark
  const theme = document.getElementById("theme");
  const isDark = () => (root.dataset.theme ?? (darkScreen.matches ? "dark" : "light")) === "dark";
  const nameTheme = () => { theme.textContent = "Theme: " + (isDark() ? "dark" : "light"); };
  function showTheme() {
    nameTheme();
    redraw();
  }
  theme.addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    showTheme();
  });
  darkScreen.addEventListener("change", showTheme);
  nameTheme();
  let before;
  addEventListener("beforeprint", () => {
    before = root.dataset.theme;
    root.dataset.theme = "light";
    plots.forEach(draw);
  });
  addEventListener("afterprint", () => {
    if (before) root.dataset.theme = before;
    else delete root.dataset.theme;
    redraw();
  });

  // Legends and targets
  all(".legend button").forEach((button) => button.addEventListener("click", () => {
    button.setAttribute("aria-pressed", button.getAttribute("aria-pressed") !== "true");
    all(".plot", button.closest("figure")).filter((plot) => plot.dataset.drawn).forEach(draw);
  }));
  all("figure select").forEach((select) => {
    const show = () => all(".panel", select.closest("figure")).forEach((panel) => {
      panel.hidden = panel.dataset.target !== select.value;
    });
    select.addEventListener("change", show);
    show();
  });

  // Tables: a click sorts by the column, another turns it round; cells without a value stay last.
  function sort(head) {
    const table = head.closest("table");
    const column = [...head.parentNode.children].indexOf(head);
    const up = head.getAttribute("aria-sort") !== "ascending";
    const number = head.classList.contains("number");
    const key = (row) => row.children[column].dataset.sort;
    const compare = (a, b) => (number ? a - b : a.localeCompare(b, undefined, { numeric: true }));
    const rows = [...table.tBodies[0].rows].sort((one, other) => {
      const [a, b] = [key(one), key(other)];
      if (a === undefined || b === undefined) return (a === undefined) - (b === undefined);
      return up ? compare(a, b) : compare(b, a);
    });
    table.tBodies[0].append(...rows);
    all("th[aria-sort]", table).forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", up ? "ascending" : "descending");
  }
  all(".sortable th button").forEach((button) => button.addEventListener("click", () => sort(button.parentNode)));

  // Downloads; a page inside another page's sandbox may not save, so there it shows the text to copy.
  const inside = location.protocol === "about:" || (location.protocol === "blob:" && origin === "null");
  function save(name) {
    const text = files[name];
    if (inside) {
      const dialog = document.getElementById("copy");
      dialog.querySelector("h2").textContent = name;
      const area = dialog.querySelector("textarea");
      area.value = text;
      dialog.showModal();
      area.select();
      return;
    }
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
    link.download = name;
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
  }
  all("[data-file]").forEach((button) => button.addEventListener("click", () => save(button.dataset.file)));

  // Inside an iframe a link to "#id" would leave the page, so sections are scrolled to.
  all("nav a, .skip").forEach((link) => link.addEventListener("click", (event) => {
    event.preventDefault();
    const goal = document.querySelector(link.getAttribute("href"));
    goal.scrollIntoView();
    (goal.querySelector("h2") ?? goal).focus({ preventScroll: true });
  }));
})();
