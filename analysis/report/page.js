"use strict";
// Draws what the page's data block describes. A number row is packed: {i2: base64 of 16-bit counts, scale, offset} or
// {from, step, n}, and {row: k} is the k-th of those that several pictures share; a colour "@name" is the theme's. A picture has choosers (selects) and one panel for every choice.
(function () {
  const root = document.documentElement;

  const {rows, pictures} = JSON.parse(document.getElementById("pictures").textContent);
  const narrow = () => window.innerWidth < 640;
  const touch = window.matchMedia("(pointer: coarse)").matches;

  function row(packed) {
    if ("n" in packed) return Float64Array.from({length: packed.n}, (_, k) => packed.from + k * packed.step);
    const bytes = Uint8Array.from(atob(packed.i2), (c) => c.charCodeAt(0)), view = new DataView(bytes.buffer);
    return Float64Array.from({length: bytes.length / 2}, (_, k) => {
      const count = view.getInt16(2 * k, true);
      const value = packed.offset + packed.scale * count;
      return count === -32768 ? NaN : packed.log ? 10 ** value : value;
    });
  }
  function ready(value) {  // unpacked and in the theme's colours
    if (typeof value === "string" && value[0] === "@")
      return getComputedStyle(root).getPropertyValue("--" + value.slice(1)).trim();
    if (Array.isArray(value)) return value.map(ready);
    if (value === null || typeof value !== "object") return value;
    if ("row" in value && "packed" in value) return row(rows[value.row]);
    if ("i2" in value || "n" in value && "step" in value) return row(value);
    return Object.fromEntries(Object.entries(value).map(([key, item]) => [key, ready(item)]));
  }
  function merged(base, more) {
    const result = {...base};
    for (const [key, item] of Object.entries(more || {}))
      result[key] = item && typeof item === "object" && !Array.isArray(item) ? merged(result[key] || {}, item) : item;
    return result;
  }
  function axis(more) {
    return merged({gridcolor: "@grid", zerolinecolor: "@grid", linecolor: "@muted", automargin: true, fixedrange: touch,
                   title: {font: {size: 12}, standoff: 6}}, more);
  }
  function layout(own) {
    const base = {
      modebar: {bgcolor: "rgba(0,0,0,0)", color: "@muted", activecolor: "@ink"},
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: {color: "@ink", size: narrow() ? 11 : 12},
      margin: {l: narrow() ? 48 : 64, r: 12, t: 12, b: 44}, height: (own.height || 380) * (narrow() ? 0.9 : 1),
      legend: {orientation: "h", y: 1.02, yanchor: "bottom", x: 0, font: {size: 11}}, hovermode: "closest",
      dragmode: touch ? false : "zoom", hoverlabel: {namelength: -1}, autosize: true,
    };
    const result = merged(base, own);
    result.height = base.height;
    if (result.grid && narrow()) {  // side by side where there is room, else one above the other
      result.grid = {...result.grid, rows: result.grid.rows * result.grid.columns, columns: 1};
      result.height *= 1.5;
    }
    for (const key of Object.keys(result)) if (/^[xy]axis\d*$/.test(key)) result[key] = axis(result[key]);
    for (const key of ["xaxis", "yaxis"]) if (!result[key]) result[key] = axis({});
    return ready(result);
  }
  const config = {responsive: true, displaylogo: false, showTips: false, scrollZoom: false, displayModeBar: touch || narrow() ? false : "hover",
                  modeBarButtons: [["zoom2d", "pan2d", "zoomIn2d", "zoomOut2d", "resetScale2d"]]};

  function draw(place, panel) {
    Plotly.react(place, ready(panel.traces), layout(panel.layout || {}), config);
    place.panel = panel;
  }
  function picture(holder) {
    const spec = pictures[holder.dataset.picture], place = holder.querySelector(".plot");
    const said = holder.querySelector("[data-says]");
    const selects = [...holder.querySelectorAll("select")], ticks = [...holder.querySelectorAll("input[type=checkbox]")];
    function show() {
      const ticked = ticks.filter((tick) => tick.checked).map((tick) => tick.value).sort().join("+");
      const key = [...(ticks.length ? [ticked] : []), ...selects.map((select) => select.value)].join("|");
      const panel = spec.panels[key];
      if (said) said.textContent = panel ? panel.says || "" : spec.missing || "";
      holder.dataset.key = key;
      place.style.opacity = panel ? 1 : 0.25;
      if (panel) draw(place, merged(spec, panel));
    }
    for (const control of [...selects, ...ticks]) control.addEventListener("change", show);
    show();
  }

  const holders = [...document.querySelectorAll("[data-picture]")];
  const waiting = holders.slice();
  function next() {  // one at a time, so that the page answers while it draws
    const holder = waiting.shift();
    if (!holder) { root.dataset.ready = "true"; return; }
    try { picture(holder); } catch (problem) { window.fault(String(problem)); }
    setTimeout(next, 0);
  }
  next();
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const place of document.querySelectorAll(".plot")) if (place.panel) draw(place, place.panel);
  });
})();
