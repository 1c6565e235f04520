"use strict";

// The plots over mission time: `createPlots` draws them for a span of it; with two recordings both are in each plot.

const SVG = "http://www.w3.org/2000/svg";
const make = (name, attributes, parent, words) => {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (words !== undefined) node.textContent = words;
  if (parent) parent.appendChild(node);
  return node;
};
const tidy = (value) => String(Number(value.toPrecision(6)));
const niceStep = (span, count) => {
  const raw = Math.max(span, 1e-9) / count, power = 10 ** Math.floor(Math.log10(raw));
  return power * [1, 2, 5, 10].find((m) => m * power >= raw * 0.999999);
};
const BOX = { left: 52, right: 12, top: 24, bottom: 22 }, ROW = 15, READ_OUT = 60;
const MARKED = new Set(["dead", "frozen", "term", "landed", "cut-off", "no-head", "battery-empty", "silent"]);

const createPlots = (pages, host, span, seek) => {
  const page = pages[0], cursors = [];
  let timeS = 0;

  // `entries` of the legend, [words, kind], stand beside the title, or below it where they do not fit.
  const frame = (plotted, title, entries = []) => {
    const box = [...host.children].find((each) => !each.firstChild);
    const width = box.clientWidth, svg = make("svg", { role: "img", "aria-label": title }, box);
    const heading = make("text", { x: 8, y: 15, class: "title" }, svg, title), free = 8 + heading.getComputedTextLength() + 10;
    const labels = entries.map(([words, kind]) => [make("text", { "text-anchor": "end", class: kind === "limit" ? "limit-name" : "" }, svg, words), kind]);
    const wide = labels.reduce((sum, [label]) => sum + label.getComputedTextLength() + 36, 0);
    const below = labels.length > 0 && free + READ_OUT + wide > width, top = BOX.top + (below ? ROW : 0), height = plotted + top - BOX.top;
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`); svg.setAttribute("height", height);
    let right = width - BOX.right;
    for (const [label, kind] of labels.toReversed()) {
      const y = below ? 15 + ROW : 15, length = label.getComputedTextLength();
      label.setAttribute("x", right); label.setAttribute("y", y);
      make("line", { x1: right - length - 24, x2: right - length - 6, y1: y - 4, y2: y - 4, class: kind }, svg);
      right -= length + 36;
    }
    const inner = width - BOX.left - BOX.right, length = span.to - span.from;
    const x = (t) => BOX.left + inner * (t - span.from) / length;
    const clip = `clip${[...host.children].indexOf(box)}`;
    make("rect", { x: BOX.left, y: 0, width: Math.max(0, inner), height }, make("clipPath", { id: clip }, svg));
    const step = niceStep(length, Math.max(2, Math.floor(width / 90)));
    for (let t = Math.ceil(span.from / step - 1e-9) * step; t <= span.to + 1e-4 * length; t += step) {
      make("line", { x1: x(t), x2: x(t), y1: top, y2: height - BOX.bottom, class: "axis" }, svg);
      if (x(t) < width - 70 || t === 0) make("text", { x: x(t), y: height - BOX.bottom + 13, "text-anchor": "middle" }, svg, tidy(t));
    }
    make("text", { x: width - BOX.right, y: height - BOX.bottom + 13, "text-anchor": "end" }, svg, "time (s)");
    const follow = (event) => {
      if (event.buttons) seek(span.from + (event.clientX - svg.getBoundingClientRect().left - BOX.left) / inner * length);
    };
    svg.addEventListener("pointerdown", follow);
    svg.addEventListener("pointermove", follow);
    const body = make("g", { "clip-path": `url(#${clip})` }, svg);
    return { svg, body, x, width, height, top, free, end: below ? width - BOX.right : right };
  };
  const finish = ({ body, x, top, height }) => {
    const line = (t, kind, words) => {
      if (t < span.from || t > span.to) return;
      const mark = make("line", { x1: x(t), x2: x(t), y1: top, y2: height - BOX.bottom, class: kind }, body);
      make("title", {}, mark, words);
    };
    for (const each of page.story) if (MARKED.has(each.kind)) line(each.time_s, "mark", `${each.time_s.toFixed(1)} s: ${each.kind} ${each.words}`);
    for (const fault of page.faults) line(fault.time_s, "fault", `${fault.time_s.toFixed(2)} s: ${fault.text}`);
    const cursor = make("line", { y1: top, y2: height - BOX.bottom, class: "cursor" }, body);
    cursors.push(() => { cursor.setAttribute("x1", x(timeS)); cursor.setAttribute("x2", x(timeS)); });
  };
  const seen = (series) => series.y.filter((_, i) => series.x[i] >= span.from - page.slot_s && series.x[i] <= span.to + page.slot_s);
  const drawPlot = (plot, index) => {
    const compared = pages.length > 1;
    const all = compared ? pages.map((each, n) => ({ ...each.plots[index].series[0], name: "AB"[n] })) : plot.series;
    const values = all.flatMap(seen), title = `${plot.title} (${plot.unit})`;
    if (!values.length) {
      const box = frame(150, title);
      make("text", { x: box.width / 2, y: box.height / 2, "text-anchor": "middle" }, box.svg, "no data recorded"); finish(box); return;
    }
    let low = values.reduce((a, b) => Math.min(a, b), 0), high = values.reduce((a, b) => Math.max(a, b), 0);
    const inSight = plot.limit !== null && plot.limit <= high * 3 && plot.limit >= low;
    if (inSight) high = Math.max(high, plot.limit);
    if (high - low < 1e-9) high = low + 1;
    high += 0.05 * (high - low); if (low < 0) low -= 0.05 * (high - low);
    const entries = all.length > 1 ? all.map((series, n) => [series.name, `series series${n}`]) : [];
    if (plot.limit !== null) entries.push([inSight ? `${plot.limit_name} (${tidy(plot.limit)} ${plot.unit})` : `${plot.limit_name} ${tidy(plot.limit)} ${plot.unit}, outside the range`, "limit"]);
    const box = frame(150, title, entries), { svg, body, x, width, height, top } = box;
    const y = (value) => height - BOX.bottom - (height - top - BOX.bottom) * (value - low) / (high - low);
    const step = niceStep(high - low, 4);
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      make("line", { x1: BOX.left, x2: width - BOX.right, y1: y(value), y2: y(value), class: "axis" }, svg);
      make("text", { x: BOX.left - 6, y: y(value) + 4, "text-anchor": "end" }, svg, tidy(value));
    }
    svg.appendChild(body);
    all.forEach((series, n) => {
      const d = series.x.map((t, i) => `${i && t - series.x[i - 1] < 3.5 * page.slot_s ? "L" : "M"}${x(t).toFixed(1)} ${y(series.y[i]).toFixed(1)}`).join("");
      make("path", { d, class: `series series${n}` }, body);
    });
    readOut(box, all);
    if (inSight) make("line", { x1: BOX.left, x2: width - BOX.right, y1: y(plot.limit), y2: y(plot.limit), class: "limit" }, svg);
    finish(box);
  };
  const readOut = ({ svg, free, end }, all) => {
    const label = make("text", { x: free, y: 15, class: "now" }, svg);
    const valueAt = ({ x, y }) => {
      const i = x.findLastIndex((t) => t <= timeS + 1e-9);
      return i < 0 || timeS - x[i] >= 3.5 * page.slot_s ? "-" : String(Number(y[i].toPrecision(3)));
    };
    cursors.push(() => {
      label.textContent = all.map(valueAt).join(", ");  // In the order of the legend.
      if (free + label.getComputedTextLength() > end) label.textContent = "";
    });
  };
  const drawHeads = () => {
    const names = [...new Set(page.terms.map((term) => term.head))], row = 16;
    const box = frame(BOX.top + BOX.bottom + row * Math.max(1, Math.min(names.length, 12)), `Head${pages.length > 1 ? " of A" : ""} over time (term in the bar)`), { svg, body, x } = box;
    const rowOf = (name) => Math.min(names.indexOf(name), 11);
    const clusterOf = (name) => page.clusters[page.cluster[page.uavs.indexOf(name)]];
    const ofCluster = (name) => page.clusters.length ? `${clusterOf(name)}: ${name}` : name;
    names.slice(0, 12).forEach((name, n) => {
      const words = n === 11 && names.length > 12 ? "others" : ofCluster(name).length > 7 ? ofCluster(name).slice(0, 6) + "…" : ofCluster(name);
      make("text", { x: BOX.left - 6, y: BOX.top + row * n + 12, "text-anchor": "end" }, svg, words);
    });
    page.terms.forEach((term, n) => {
      const from = Math.max(span.from, term.first_slot * page.slot_s), to = Math.min(span.to, (term.last_slot + 1) * page.slot_s);
      if (to <= from) return;
      const top = BOX.top + row * rowOf(term.head), left = x(from), right = x(to);
      const bar = make("rect", { x: left, y: top + 2, width: Math.max(2, right - left), height: row - 4, class: `term${n % 2}`, rx: 2 }, body);
      make("title", {}, bar, `${term.head}${page.clusters.length ? ` of cluster ${clusterOf(term.head)}` : ""}, term ${term.term}, slots ${term.first_slot} to ${term.last_slot}`);
      if (right - left > 9 * String(term.term).length + 6) {
        make("text", { x: (left + right) / 2, y: top + 12, "text-anchor": "middle", style: "fill: var(--paper); font-weight: 600" }, body, term.term);
      }
    });
    if (!names.length) make("text", { x: box.width / 2, y: BOX.top + 12, "text-anchor": "middle" }, svg, "no head recorded");
    finish(box);
  };
  return {
    layout: () => {
      // All boxes first: the width of one depends on their number.
      host.replaceChildren(...page.plots.map(() => document.createElement("div")), document.createElement("div"));
      cursors.length = 0;
      page.plots.forEach(drawPlot); drawHeads();
    },
    show: (t) => { timeS = t; for (const move of cursors) move(); },
  };
};

const createOverview = (page, svg, span, endS, change) => {
  const HEIGHT = 44, PAD = 12;
  const draw = (timeS) => {
    const width = svg.clientWidth, x = (t) => PAD + (width - 2 * PAD) * t / endS;
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} ${HEIGHT}`);
    make("rect", { x: x(span.from), y: 2, width: Math.max(3, x(span.to) - x(span.from)), height: 26, class: "window", rx: 3 }, svg);
    const { x: times, y: values } = page.plots[0].series[0];
    const top = values.reduce((a, b) => Math.max(a, b), 1e-9), low = values.reduce((a, b) => Math.min(a, b), 0);
    const d = times.map((t, i) => `${i ? "L" : "M"}${x(t).toFixed(1)} ${(26 - 22 * (values[i] - low) / (top - low)).toFixed(1)}`).join("");
    make("path", { d, class: "series series0" }, svg);
    for (const fault of page.faults) make("line", { x1: x(fault.time_s), x2: x(fault.time_s), y1: 2, y2: 28, class: "fault" }, svg);
    make("line", { x1: x(timeS), x2: x(timeS), y1: 2, y2: 28, class: "cursor" }, svg);
    make("text", { x: PAD, y: 41 }, svg, "0 s");
    make("text", { x: width / 2, y: 41, "text-anchor": "middle" }, svg, `plots: ${span.from.toFixed(1)} to ${span.to.toFixed(1)} s`);
    make("text", { x: width - PAD, y: 41, "text-anchor": "end" }, svg, `${endS.toFixed(1)} s`);
  };
  const timeAt = (event) => {
    const box = svg.getBoundingClientRect();
    return Math.max(0, Math.min(endS, (event.clientX - box.left - PAD) / (box.width - 2 * PAD) * endS));
  };
  let begun = null;
  svg.addEventListener("pointerdown", (event) => { begun = timeAt(event); svg.setPointerCapture(event.pointerId); });
  svg.addEventListener("pointerup", (event) => {
    if (begun === null) return;
    const [from, to] = [begun, timeAt(event)].sort((a, b) => a - b);
    begun = null;
    const half = (span.to - span.from) / 2;
    if (to - from > 2 * page.slot_s) change(from, to); else change(from - half, from + half);
  });
  return { draw };
};
