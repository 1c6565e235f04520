"use strict";
(() => {
  const page = JSON.parse(document.getElementById("data").textContent);
  const byId = (id) => document.getElementById(id);
  const [map, slider, play, speed, clock] = ["map", "slider", "play", "speed", "clock"].map(byId);
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const centres = new Float32Array(bytes(page.centres).buffer);
  const heard = bytes(page.heard);
  const K = page.uavs.length;
  const END_S = Math.max(page.end_s, page.slot_s);
  const TRAIL_S = 15;
  const ARRIVED_M = 0.1;
  let timeS = 0;
  let playing = false;
  let colours = {};

  // ---- positions ----

  const frameAt = (t) => Math.max(0, Math.min(page.frames - 1, Math.floor(t / page.frame_s + 1e-9)));
  const centre = (k, t) => {
    const i = frameAt(t);
    const share = Math.max(0, Math.min(1, t / page.frame_s - i));
    const a = 2 * (i * K + k), b = 2 * ((i + 1) * K + k);
    return [centres[a] + share * (centres[b] - centres[a]), centres[a + 1] + share * (centres[b + 1] - centres[a + 1])];
  };
  const overlapping = (at) => {
    const hit = new Set();
    for (let k = 0; k < K; k++) for (let l = 0; l < k; l++) {
      if (Math.hypot(at[k][0] - at[l][0], at[k][1] - at[l][1]) < page.r_m[k] + page.r_m[l] - 1e-4) hit.add(k).add(l);
    }
    return hit;
  };

  // ---- the map ----

  const view = () => {
    const [left, low, right, high] = page.extent_m;
    const width = map.clientWidth, height = map.clientHeight, pad = 36;
    const scale = Math.min((width - pad - 12) / (right - left), (height - pad - 12) / (high - low));
    const x0 = pad + (width - pad - 12 - scale * (right - left)) / 2;
    const y0 = 12 + (height - pad - 12 - scale * (high - low)) / 2;
    return { scale, x: (m) => x0 + scale * (m - left), y: (m) => y0 + scale * (high - m), width, height };
  };
  const drawMap = () => {
    const ratio = window.devicePixelRatio || 1;
    map.width = Math.round(map.clientWidth * ratio);
    map.height = Math.round(map.clientHeight * ratio);
    const g = map.getContext("2d"), v = view();
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, v.width, v.height);
    if (!page.frames || !K) return;
    drawGrid(g, v);
    for (const zone of page.zones) drawZone(g, v, zone);
    const at = page.uavs.map((_, k) => centre(k, timeS));
    const hit = overlapping(at), i = frameAt(timeS);
    for (let k = 0; k < K; k++) drawTarget(g, v, k, at[k]);
    for (let k = 0; k < K; k++) drawTrail(g, v, k);
    for (let k = 0; k < K; k++) drawDisc(g, v, k, at[k], stateOf(k, at[k], hit, i), page.leader[i] === k);
    for (let k = 0; k < K; k++) drawLabel(g, v, k, at[k], page.leader[i] === k);
  };
  const stateOf = (k, at, hit, i) => {
    if (hit.has(k)) return "overlap";
    if (!heard[i * K + k]) return "silent";
    return isThere(k, at) ? "arrived" : "flying";
  };
  const isThere = (k, at) => Math.hypot(at[0] - page.target_m[k][0], at[1] - page.target_m[k][1]) <= ARRIVED_M;
  const colourOf = { overlap: "--vermillion", silent: "--grey", arrived: "--green", flying: "--blue" };
  const drawGrid = (g, v) => {
    const [left, low, right, high] = page.extent_m;
    const step = niceStep(Math.max(right - left, high - low), 6);
    g.strokeStyle = colours["--line"]; g.fillStyle = colours["--soft"]; g.lineWidth = 1;
    g.font = "11px system-ui, sans-serif"; g.setLineDash([]);
    g.textAlign = "center"; g.textBaseline = "bottom";
    for (let x = Math.ceil(left / step) * step; x <= right; x += step) {
      path(g, [[v.x(x), 0], [v.x(x), v.height]]); g.fillText(tidy(x), v.x(x), v.height - 4);
    }
    g.textAlign = "left"; g.textBaseline = "middle";
    for (let y = Math.ceil(low / step) * step; y <= high; y += step) {
      path(g, [[0, v.y(y)], [v.width, v.y(y)]]); g.fillText(tidy(y), 4, v.y(y));
    }
    g.textAlign = "right"; g.textBaseline = "bottom"; g.fillText("east, north (m)", v.width - 6, v.height - 18);
  };
  const path = (g, points) => {
    g.beginPath();
    points.forEach(([x, y], n) => (n ? g.lineTo(x, y) : g.moveTo(x, y)));
    g.stroke();
  };
  const drawZone = (g, v, zone) => {
    const excludes = zone.kind === "exclusion", colour = colours[excludes ? "--amber" : "--green"];
    g.strokeStyle = g.fillStyle = colour; g.lineWidth = excludes ? 1.2 : 2; g.setLineDash([]);
    g.beginPath();
    if (zone.corners_m.length) zone.corners_m.forEach(([x, y], n) => (n ? g.lineTo(v.x(x), v.y(y)) : g.moveTo(v.x(x), v.y(y))));
    else g.arc(v.x(zone.centre_m[0]), v.y(zone.centre_m[1]), v.scale * zone.radius_m, 0, 2 * Math.PI);
    g.closePath();
    if (excludes) { g.globalAlpha = 0.25; g.fill(); g.globalAlpha = 1; }
    g.stroke();
    const [x, y, width] = zone.label_m;
    g.font = "10px system-ui, sans-serif";
    if (excludes && g.measureText(zone.name).width < v.scale * width) write(g, zone.name, "10px", v.x(x), v.y(y), colour);
  };
  const drawTarget = (g, v, k, at) => {
    const [x, y] = [v.x(page.target_m[k][0]), v.y(page.target_m[k][1])];
    g.strokeStyle = colours["--soft"]; g.lineWidth = 1; g.globalAlpha = 0.35; g.setLineDash([]);
    path(g, [[v.x(at[0]), v.y(at[1])], [x, y]]);
    g.globalAlpha = 0.9; g.lineWidth = 1.4;
    if (!isThere(k, at)) g.strokeRect(x - 3, y - 3, 6, 6);
    g.globalAlpha = 1;
  };
  const drawTrail = (g, v, k) => {
    const from = Math.max(0, timeS - TRAIL_S), step = Math.max(page.frame_s, TRAIL_S / 40);
    g.strokeStyle = colours["--blue"]; g.lineWidth = 1.6; g.setLineDash([]);
    for (let t = from; t < timeS; t += step) {
      const [a, b] = [centre(k, t), centre(k, Math.min(t + step, timeS))];
      g.globalAlpha = 0.7 * (1 - (timeS - t) / TRAIL_S) + 0.05;
      path(g, [[v.x(a[0]), v.y(a[1])], [v.x(b[0]), v.y(b[1])]]);
    }
    g.globalAlpha = 1;
  };
  const drawDisc = (g, v, k, at, state, leads) => {
    const [x, y, r] = [v.x(at[0]), v.y(at[1]), Math.max(2, v.scale * page.r_m[k])];
    g.strokeStyle = g.fillStyle = colours[colourOf[state]];
    g.beginPath(); g.arc(x, y, r, 0, 2 * Math.PI);
    g.globalAlpha = state === "overlap" ? 0.5 : state === "arrived" ? 0.28 : 0.13; g.fill();
    g.globalAlpha = 1; g.lineWidth = 1.6; g.setLineDash(state === "silent" ? [3, 3] : []); g.stroke(); g.setLineDash([]);
    if (leads) {
      g.strokeStyle = colours["--ink"]; g.lineWidth = 3;
      g.beginPath(); g.arc(x, y, r + 2.5, 0, 2 * Math.PI); g.stroke();
    }
  };
  const drawLabel = (g, v, k, at, leads) => {
    const [x, y, r] = [v.x(at[0]), v.y(at[1]), v.scale * page.r_m[k]], words = page.uavs[k];
    g.font = "10px system-ui, sans-serif";
    const px = Math.min(12, 0.8 * r, 10 * 1.85 * r / g.measureText(words).width), named = px >= 7;
    if (named) write(g, words, `${px}px`, x, y + (leads ? 0.55 * px : 0));
    if (leads) write(g, "H", `700 ${Math.max(11, Math.min(14, 0.8 * r))}px`, x, y - (named ? 0.65 * px : 0));
  };
  const write = (g, words, font, x, y, colour = colours["--ink"]) => {
    g.font = `${font} system-ui, sans-serif`; g.textAlign = "center"; g.textBaseline = "middle";
    g.strokeStyle = colours["--panel"]; g.lineWidth = 2.5; g.lineJoin = "round"; g.setLineDash([]);
    g.strokeText(words, x, y);
    g.fillStyle = colour; g.fillText(words, x, y);
  };

  // ---- plots ----

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
  const BOX = { left: 52, right: 12, top: 24, bottom: 32 };
  const cursors = [];
  const frame = (host, height, title) => {
    const width = host.clientWidth, svg = make("svg", { viewBox: `0 0 ${width} ${height}`, height, role: "img", "aria-label": title }, host);
    const x = (t) => BOX.left + (width - BOX.left - BOX.right) * t / END_S;
    const heading = make("text", { x: 8, y: 15, class: "title" }, svg, title);
    const step = niceStep(END_S, Math.max(2, Math.floor(width / 90)));
    for (let t = 0; t <= END_S * 1.0001; t += step) {
      make("line", { x1: x(t), x2: x(t), y1: BOX.top, y2: height - BOX.bottom, class: "axis" }, svg);
      if (x(t) < width - 70 || t === 0) make("text", { x: x(t), y: height - BOX.bottom + 13, "text-anchor": "middle" }, svg, tidy(t));
    }
    make("text", { x: width - BOX.right, y: height - BOX.bottom + 13, "text-anchor": "end" }, svg, "time (s)");
    const follow = (event) => {
      if (!event.buttons) return;
      const at = event.clientX - svg.getBoundingClientRect().left;
      seek((at - BOX.left) / (width - BOX.left - BOX.right) * END_S);
    };
    svg.addEventListener("pointerdown", (event) => { setPlaying(false); follow(event); });
    svg.addEventListener("pointermove", follow);
    return { svg, x, width, height, free: 8 + heading.getComputedTextLength() + 10 };
  };
  const finish = ({ svg, x, height }) => {
    for (const fault of page.faults) {
      const mark = make("line", { x1: x(fault.time_s), x2: x(fault.time_s), y1: BOX.top, y2: height - BOX.bottom, class: "fault" }, svg);
      make("title", {}, mark, `${fault.time_s.toFixed(2)} s: ${fault.text}`);
    }
    const cursor = make("line", { y1: BOX.top, y2: height - BOX.bottom, class: "cursor" }, svg);
    cursors.push(() => { cursor.setAttribute("x1", x(timeS)); cursor.setAttribute("x2", x(timeS)); });
  };
  const drawPlot = (host, plot) => {
    const box = frame(host, 150, `${plot.title} (${plot.unit})`), { svg, x, width, height } = box;
    const values = plot.series.flatMap((series) => series.y);
    if (!values.length) { make("text", { x: width / 2, y: height / 2, "text-anchor": "middle" }, svg, "no data recorded"); finish(box); return; }
    let low = values.reduce((a, b) => Math.min(a, b), 0), high = values.reduce((a, b) => Math.max(a, b), 0);
    const inSight = plot.limit !== null && plot.limit <= high * 3 && plot.limit >= low;
    if (inSight) high = Math.max(high, plot.limit);
    if (high - low < 1e-9) high = low + 1;
    high += 0.05 * (high - low); if (low < 0) low -= 0.05 * (high - low);
    const y = (value) => height - BOX.bottom - (height - BOX.top - BOX.bottom) * (value - low) / (high - low);
    const step = niceStep(high - low, 4);
    for (let value = Math.ceil(low / step) * step; value <= high; value += step) {
      make("line", { x1: BOX.left, x2: width - BOX.right, y1: y(value), y2: y(value), class: "axis" }, svg);
      make("text", { x: BOX.left - 6, y: y(value) + 4, "text-anchor": "end" }, svg, tidy(value));
    }
    plot.series.forEach((series, n) => {
      const d = series.x.map((t, i) => `${i && t - series.x[i - 1] < 3.5 * page.slot_s ? "L" : "M"}${x(t).toFixed(1)} ${y(series.y[i]).toFixed(1)}`).join("");
      make("path", { d, class: `series series${n}` }, svg);
    });
    readOut(box, plot, legend(svg, width, plot, inSight));
    if (inSight) make("line", { x1: BOX.left, x2: width - BOX.right, y1: y(plot.limit), y2: y(plot.limit), class: "limit" }, svg);
    finish(box);
  };
  const legend = (svg, width, plot, inSight) => {
    let right = width - BOX.right;
    const add = (words, kind) => {
      const label = make("text", { x: right, y: 15, "text-anchor": "end", class: kind === "limit" ? "limit-name" : "" }, svg, words);
      right -= label.getComputedTextLength() + 6;
      make("line", { x1: right - 18, x2: right, y1: 11, y2: 11, class: kind }, svg);
      right -= 30;
    };
    if (plot.limit !== null) add(inSight ? `${plot.limit_name} (${tidy(plot.limit)} ${plot.unit})` : `${plot.limit_name} ${tidy(plot.limit)} ${plot.unit}, outside the range`, "limit");
    if (plot.series.length > 1) plot.series.forEach((series, n) => add(series.name, `series series${n}`));
    return right;
  };
  const readOut = ({ svg, free }, plot, end) => {
    const label = make("text", { x: free, y: 15, class: "now" }, svg);
    const valueAt = ({ x, y }) => {
      const i = x.findLastIndex((t) => t <= timeS + 1e-9);
      return i < 0 || timeS - x[i] >= 3.5 * page.slot_s ? "-" : String(Number(y[i].toPrecision(3)));
    };
    cursors.push(() => {
      label.textContent = plot.series.map(valueAt).reverse().join(", ");  // In the order of the legend.
      if (free + label.getComputedTextLength() > end) label.textContent = "";
    });
  };
  const drawHeads = (host) => {
    const names = [...new Set(page.terms.map((term) => term.head))], row = 16;
    const box = frame(host, BOX.top + BOX.bottom + row * Math.max(1, Math.min(names.length, 12)), "Head over time (term in the bar)"), { svg, x } = box;
    const rowOf = (name) => Math.min(names.indexOf(name), 11);
    names.slice(0, 12).forEach((name, n) => {
      const words = n === 11 && names.length > 12 ? "others" : name.length > 7 ? name.slice(0, 6) + "…" : name;
      make("text", { x: BOX.left - 6, y: BOX.top + row * n + 12, "text-anchor": "end" }, svg, words);
    });
    page.terms.forEach((term, n) => {
      const from = x(term.first_slot * page.slot_s), to = x(Math.min(END_S, (term.last_slot + 1) * page.slot_s)), top = BOX.top + row * rowOf(term.head);
      const bar = make("rect", { x: from, y: top + 2, width: Math.max(2, to - from), height: row - 4, class: `term${n % 2}`, rx: 2 }, svg);
      make("title", {}, bar, `${term.head}, term ${term.term}, slots ${term.first_slot} to ${term.last_slot}`);
      if (to - from > 9 * String(term.term).length + 6) {
        make("text", { x: (from + to) / 2, y: top + 12, "text-anchor": "middle", style: "fill: var(--paper); font-weight: 600" }, svg, term.term);
      }
    });
    if (!names.length) make("text", { x: box.width / 2, y: BOX.top + 12, "text-anchor": "middle" }, svg, "no head recorded");
    finish(box);
  };
  const drawMarks = () => {
    const svg = byId("marks"), width = svg.clientWidth, thumb = 8;
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} 14`);
    for (const fault of page.faults) {
      const at = thumb + (width - 2 * thumb) * fault.time_s / END_S;
      const mark = make("polygon", { points: `${at - 5},13 ${at + 5},13 ${at},3`, class: "fault" }, svg);
      make("title", {}, mark, `${fault.time_s.toFixed(2)} s: ${fault.text}`);
    }
  };

  // ---- time ----

  const show = () => {
    const slot = frameAt(timeS), leader = page.leader[slot] ?? -1;
    clock.textContent = `${timeS.toFixed(1)} s of ${END_S.toFixed(1)} s, slot ${Math.floor(timeS / page.slot_s + 1e-9)}, ${leader < 0 ? "no head" : "head " + page.uavs[leader]}`;
    slider.value = timeS;
    drawMap();
    for (const move of cursors) move();
  };
  const seek = (t) => { timeS = Math.max(0, Math.min(END_S, t)); show(); };
  const setPlaying = (now) => {
    if (now && timeS >= END_S) timeS = 0;
    playing = now;
    play.textContent = playing ? "Pause" : "Play";
    if (playing) { let last = performance.now(); requestAnimationFrame(function next(t) {
      if (!playing) return;
      const due = timeS + Math.max(0, t - last) / 1000 * Number(speed.value);
      last = t;
      seek(due);
      if (timeS >= END_S) setPlaying(false); else requestAnimationFrame(next);
    }); }
  };
  const layout = () => {
    const style = getComputedStyle(document.documentElement);
    colours = Object.fromEntries(["--ink", "--panel", "--soft", "--line", "--blue", "--green", "--vermillion", "--amber", "--grey"].map((n) => [n, style.getPropertyValue(n).trim()]));
    const [left, low, right, high] = page.extent_m;
    map.style.height = `${Math.round(Math.max(280, Math.min(map.clientWidth * (high - low) / Math.max(1e-9, right - left), map.clientWidth, 760)))}px`;
    const host = byId("plots");
    host.replaceChildren(); cursors.length = 0;
    for (const plot of page.plots) drawPlot(host, plot);
    drawHeads(host); drawMarks(); show();
  };
  slider.max = END_S;
  slider.addEventListener("input", () => { setPlaying(false); seek(Number(slider.value)); });
  play.addEventListener("click", () => setPlaying(!playing));
  window.addEventListener("resize", layout);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", layout);
  layout();
})();
