"use strict";

// The map of one recording: `createMap` draws the swarm at a time, zooms, pans and finds the UAV under a point.

const decode = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
const COLOUR_OF = {
  overlap: "--vermillion", silent: "--grey", unknown: "--grey", arrived: "--green", beside: "--green",
  flying: "--blue", holding: "--amber", dead: "--vermillion", frozen: "--cyan", "cut-off": "--purple",
};
const FAINT = new Set(["silent", "unknown", "frozen", "cut-off", "beside"]);
const MARGIN = 34, FOOT = 20;  // Room for the numbers of the axes, in pixels.
const ARRIVED_M = 0.1, TRAIL_S = 15, MANY = 100;

const createMap = (page, canvas, theme, layers) => {
  const K = page.uavs.length;
  const centres = new Float32Array(decode(page.centres).buffer), heard = decode(page.heard);
  const states = decode(page.states), ages = decode(page.ages), battery = decode(page.battery);
  const offsets = new Int8Array(decode(page.offsets).buffer);
  const camera = { zoom: 1, x: 0, y: 0 };
  let followed = -1, hovered = -1, timeS = 0;

  const frameAt = (t) => Math.max(0, Math.min(page.frames - 1, Math.floor(t / page.frame_s + 1e-9)));
  const centre = (k, t) => {
    const i = frameAt(t), share = Math.max(0, Math.min(1, t / page.frame_s - i));
    const a = 2 * (i * K + k), b = 2 * ((i + 1) * K + k);
    return [centres[a] + share * (centres[b] - centres[a]), centres[a + 1] + share * (centres[b + 1] - centres[a + 1])];
  };
  const recorded = (k, i) => page.state_names[states[i * K + k]] ?? "unknown";
  // The route that UAV k flies at time t (its goal), and the point of it that it flies to.
  const goalOf = (k, t) => {
    const { routes, goals, turns } = page.itineraries[k];
    const [, route, leg] = turns.findLast((turn) => turn[0] * page.slot_s <= t + 1e-9) ?? [0, 0, 0];
    return { points: routes[route], leg: Math.min(leg, routes[route].length - 1), number: goals[route] };
  };
  const isThere = (k, at) => {
    const { points, leg } = goalOf(k, timeS), target = points[points.length - 1];
    return leg === points.length - 1 && Math.hypot(at[0] - target[0], at[1] - target[1]) <= ARRIVED_M;
  };
  const landed = (k, i) => heard[i * K + k] === 2 || recorded(k, i) === "landed";
  const overlapping = (at, i) => {
    const hit = new Set();
    for (let k = 0; k < K; k++) for (let l = 0; l < k; l++) {
      if (landed(k, i) || landed(l, i)) continue;
      if (Math.hypot(at[k][0] - at[l][0], at[k][1] - at[l][1]) < page.r_m[k] + page.r_m[l] - 1e-4) hit.add(k).add(l);
    }
    return hit;
  };

  const view = () => {
    const [left, low, right, high] = page.extent_m;
    const width = canvas.clientWidth, height = canvas.clientHeight, pad = 36;
    const fit = Math.min((width - pad - 12) / (right - left), (height - pad - 12) / (high - low));
    const scale = fit * camera.zoom;
    let middle = [(left + right) / 2 + camera.x, (low + high) / 2 + camera.y];
    if (followed >= 0 && K) middle = centre(followed, timeS);
    const x0 = pad + (width - pad - 12) / 2, y0 = 12 + (height - pad - 12) / 2;
    const x = (m) => x0 + scale * (m - middle[0]), y = (m) => y0 - scale * (m - middle[1]);
    return { scale, x, y, width, height, toM: (px, py) => [middle[0] + (px - x0) / scale, middle[1] - (py - y0) / scale] };
  };
  const path = (g, points) => {
    g.beginPath();
    points.forEach(([x, y], n) => (n ? g.lineTo(x, y) : g.moveTo(x, y)));
    g.stroke();
  };
  const clusterOf = (k) => page.cluster[k] ?? 0, C = Math.max(1, page.clusters.length);
  const leaderOf = (k, i) => page.leader[i * C + clusterOf(k)] ?? -1;  // The head of the cluster of UAV k.
  const draw = (t) => {
    timeS = Math.min(t, page.end_s);
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    const g = canvas.getContext("2d"), v = view();
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, v.width, v.height);
    if (!page.frames || !K) return;
    for (const zone of page.zones) drawZone(g, v, zone);
    drawGrid(g, v);
    const at = page.uavs.map((_, k) => centre(k, timeS)), i = frameAt(timeS), hit = overlapping(at, i);
    const leads = (k) => leaderOf(k, i) === k;
    if (layers.links.checked) drawLinks(g, v, at, i);
    if (layers.targets.checked) for (let k = 0; k < K; k++) drawTarget(g, v, k, at[k], landed(k, i));
    if (layers.trails.checked) for (let k = 0; k < K; k++) drawTrail(g, v, k);
    const all = page.uavs.map((_, k) => k), flying = all.filter((k) => !landed(k, i));
    for (const k of all) if (landed(k, i)) drawLanded(g, v, k, at[k], flying.map((l) => [v.x(at[l][0]), v.y(at[l][1]), v.scale * page.r_m[l]]));  // Others may fly over them.
    for (const k of flying) drawDisc(g, v, k, at[k], stateOf(k, at[k], hit, i), leads(k));
    if (layers.truth.checked) for (const k of flying) drawTruth(g, v, k, at[k], i);
    for (const k of flying) drawLabel(g, v, k, at[k], leads(k));
    drawAxes(g, v);
  };
  const stateOf = (k, at, hit, i) => {
    if (hit.has(k)) return "overlap";
    const state = recorded(k, i);
    return (state === "flying" || state === "holding") && isThere(k, at) ? "arrived" : state;
  };
  const ticks = (v) => {
    const [left, high] = v.toM(0, 0), [right, low] = v.toM(v.width, v.height);
    const step = niceStep(Math.max(right - left, high - low), 6);
    const between = (from, to) => Array.from({ length: Math.floor(to / step) - Math.ceil(from / step) + 1 }, (_, n) => (Math.ceil(from / step) + n) * step);
    return [between(left, right), between(low, high)];
  };
  const drawGrid = (g, v) => {
    const [xs, ys] = ticks(v);
    g.strokeStyle = theme.of("--line"); g.lineWidth = 1; g.globalAlpha = 0.8; g.setLineDash([]);
    for (const x of xs) path(g, [[v.x(x), 0], [v.x(x), v.height]]);
    for (const y of ys) path(g, [[0, v.y(y)], [v.width, v.y(y)]]);
    g.globalAlpha = 1;
  };
  const drawAxes = (g, v) => {
    const [xs, ys] = ticks(v);
    g.fillStyle = theme.of("--panel");
    g.fillRect(0, 0, MARGIN, v.height); g.fillRect(MARGIN, v.height - FOOT, v.width, FOOT);
    g.fillStyle = theme.of("--soft"); g.font = "11px system-ui, sans-serif";
    g.textAlign = "right"; g.textBaseline = "bottom";
    const words = "east, north (m)", free = v.width - 6 - g.measureText(words).width - 20;
    g.fillText(words, v.width - 6, v.height - 4);
    g.textAlign = "center";
    for (const x of xs) if (v.x(x) > MARGIN + g.measureText(tidy(x)).width / 2 && v.x(x) < free) g.fillText(tidy(x), v.x(x), v.height - 4);
    g.textAlign = "left"; g.textBaseline = "middle";
    for (const y of ys) if (v.y(y) > 10 && v.y(y) < v.height - FOOT - 6) g.fillText(tidy(y), 4, v.y(y));
  };
  const drawZone = (g, v, zone) => {
    const excludes = zone.kind === "exclusion", colour = theme.of(excludes ? "--amber" : "--green");
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
  const drawLinks = (g, v, at, i) => {
    for (let k = 0; k < K; k++) {
      const age = ages[i * K + k], head = leaderOf(k, i);
      if (head < 0 || k === head || landed(k, i) || age === 255) continue;
      g.strokeStyle = theme.of(age === 0 ? "--green" : age < 5 ? "--amber" : "--vermillion"); g.setLineDash(age < 5 ? [] : [5, 4]);
      g.globalAlpha = age === 0 ? 0.35 : 0.8; g.lineWidth = age === 0 ? 1 : 1.8;
      path(g, [[v.x(at[k][0]), v.y(at[k][1])], [v.x(at[head][0]), v.y(at[head][1])]]);
    }
    g.globalAlpha = 1;
  };
  const drawTarget = (g, v, k, at, isDown) => {
    const { points, leg } = goalOf(k, timeS), left = points.slice(leg).map((p) => [v.x(p[0]), v.y(p[1])]);
    const [x, y] = left[left.length - 1], here = [v.x(at[0]), v.y(at[1])];
    g.strokeStyle = g.fillStyle = theme.of(k === followed ? "--ink" : "--soft"); g.lineWidth = 1; g.setLineDash([]);
    g.globalAlpha = k === followed ? 0.9 : K >= MANY ? 0.15 : 0.35;
    path(g, isDown ? left : [here, ...left]);
    g.globalAlpha = 0.8;
    left.slice(0, -1).forEach(([px, py], n) => {
      const d = n ? 3 : 4;  // A diamond, since a dot is a UAV that has landed.
      g.beginPath(); g.moveTo(px, py - d); g.lineTo(px + d, py); g.lineTo(px, py + d); g.lineTo(px - d, py); g.closePath();
      if (n || isDown) g.stroke(); else g.fill();
    });
    g.globalAlpha = 0.9; g.lineWidth = 1.4;
    if (!isThere(k, at)) g.strokeRect(x - 3, y - 3, 6, 6);
    g.globalAlpha = 1;
  };
  const drawTrail = (g, v, k) => {
    const from = Math.max(0, timeS - TRAIL_S), step = Math.max(page.frame_s, TRAIL_S / (K > MANY ? 12 : 40));
    g.strokeStyle = theme.of(k === followed ? "--ink" : "--blue"); g.lineWidth = 1.6; g.setLineDash([]);
    for (let t = from; t < timeS; t += step) {
      const [a, b] = [centre(k, t), centre(k, Math.min(t + step, timeS))];
      g.globalAlpha = 0.7 * (1 - (timeS - t) / TRAIL_S) + 0.05;
      path(g, [[v.x(a[0]), v.y(a[1])], [v.x(b[0]), v.y(b[1])]]);
    }
    g.globalAlpha = 1;
  };
  const drawDisc = (g, v, k, at, state, leads) => {
    const [x, y, r] = [v.x(at[0]), v.y(at[1]), Math.max(2, v.scale * page.r_m[k])];
    g.strokeStyle = g.fillStyle = theme.of(COLOUR_OF[state]);
    g.beginPath(); g.arc(x, y, r, 0, 2 * Math.PI);
    g.globalAlpha = state === "overlap" ? 0.5 : state === "arrived" ? 0.28 : 0.13; g.fill();
    g.globalAlpha = 1; g.lineWidth = 1.6; g.setLineDash(FAINT.has(state) ? [3, 3] : []); g.stroke(); g.setLineDash([]);
    if (state === "dead") {
      const d = 0.7 * r;
      g.globalAlpha = 0.6; path(g, [[x - d, y - d], [x + d, y + d]]); path(g, [[x - d, y + d], [x + d, y - d]]); g.globalAlpha = 1;
    }
    if (page.clusters.length) {
      g.strokeStyle = page.cluster_colours[clusterOf(k) % page.cluster_colours.length]; g.lineWidth = 3;
      g.beginPath(); g.arc(x, y, Math.max(2, 0.55 * r), 0, 2 * Math.PI); g.stroke();
    }
    if (leads || k === followed) {
      g.strokeStyle = theme.of("--ink"); g.lineWidth = leads ? 3 : 1.2;
      g.beginPath(); g.arc(x, y, r + 2.5, 0, 2 * Math.PI); g.stroke();
    }
  };
  const drawLanded = (g, v, k, at, discs) => {
    const [x, y] = [v.x(at[0]), v.y(at[1])], chosen = k === hovered || k === followed;
    g.fillStyle = theme.of("--grey");
    g.beginPath(); g.arc(x, y, 3.5, 0, 2 * Math.PI); g.fill();
    if (chosen) { g.strokeStyle = theme.of("--ink"); g.lineWidth = 1.2; g.setLineDash([]); g.beginPath(); g.arc(x, y, 6, 0, 2 * Math.PI); g.stroke(); }
    const isFree = discs.every(([dx, dy, r]) => Math.hypot(dx - x, dy - y - 11) > r + 15);
    if (chosen || (isNamed(k) && isFree)) write(g, page.uavs[k], chosen ? "12px" : "10px", x, y + 11, theme.of(chosen ? "--ink" : "--soft"));
  };
  const drawTruth = (g, v, k, at, i) => {
    const dx = offsets[2 * (i * K + k)], dy = offsets[2 * (i * K + k) + 1];
    if (dx === -128 || v.scale * page.r_m[k] < 6) return;
    g.fillStyle = theme.of("--ink"); g.globalAlpha = 0.75;
    g.beginPath(); g.arc(v.x(at[0] + dx * page.r_m[k] / 127), v.y(at[1] + dy * page.r_m[k] / 127), 1.6, 0, 2 * Math.PI); g.fill();
    g.globalAlpha = 1;
  };
  // Names of a large swarm show when near, or of the one under the pointer.
  const isNamed = (k) => K < MANY || camera.zoom >= 2 || k === hovered || k === followed;
  const drawLabel = (g, v, k, at, leads) => {
    const [x, y, r] = [v.x(at[0]), v.y(at[1]), v.scale * page.r_m[k]], words = page.uavs[k];
    const chosen = k === hovered || k === followed;
    if (!isNamed(k) && !leads) return;
    g.font = "10px system-ui, sans-serif";
    const px = chosen ? 12 : Math.min(12, 0.8 * r, 10 * 1.85 * r / g.measureText(words).width), named = px >= 7;
    if (named) write(g, words, `${px}px`, x, y + (leads ? 0.55 * px : 0));
    if (leads) write(g, "H", `700 ${Math.max(11, Math.min(14, 0.8 * r))}px`, x, y - (named ? 0.65 * px : 0));
  };
  const write = (g, words, font, x, y, colour = theme.of("--ink")) => {
    g.font = `${font} system-ui, sans-serif`; g.textAlign = "center"; g.textBaseline = "middle";
    g.strokeStyle = theme.of("--panel"); g.lineWidth = 2.5; g.lineJoin = "round"; g.setLineDash([]);
    g.strokeText(words, x, y);
    g.fillStyle = colour; g.fillText(words, x, y);
  };

  const under = (event) => {
    const box = canvas.getBoundingClientRect(), v = view(), px = event.clientX - box.left, py = event.clientY - box.top;
    let best = -1, nearest = 14;
    for (let k = 0; k < K; k++) {
      const at = centre(k, timeS), d = Math.hypot(v.x(at[0]) - px, v.y(at[1]) - py) - v.scale * page.r_m[k];
      if (d < nearest) { nearest = d; best = k; }
    }
    return best;
  };
  const zoomBy = (factor, event) => {
    const before = event ? view().toM(event.offsetX, event.offsetY) : null;
    camera.zoom = Math.max(1, Math.min(40, camera.zoom * factor));
    if (before && followed < 0) {
      const after = view().toM(event.offsetX, event.offsetY);
      camera.x += before[0] - after[0]; camera.y += before[1] - after[1];
    }
    if (camera.zoom === 1) camera.x = camera.y = 0;
  };
  return {
    draw, under, zoomBy, camera, frameAt, leaders: (t) => page.leader.slice(frameAt(t) * C, (frameAt(t) + 1) * C),
    reset: () => { camera.zoom = 1; camera.x = camera.y = 0; },
    panBy: (dx, dy) => { const { scale } = view(); camera.x -= dx / scale; camera.y += dy / scale; },
    hover: (k) => { const changed = k !== hovered; hovered = k; return changed; },
    follow: (k) => { followed = k; if (k >= 0 && camera.zoom < 3) camera.zoom = 3; },
    describe: (k, t) => {
      const i = frameAt(t), age = ages[i * K + k], charge = battery[i * K + k];
      const why = page.story.findLast((each) => each.uavs.includes(k) && each.time_s <= t + 1e-9 && (each.end_s ?? Infinity) > t && ["holding", "dead", "frozen", "silent", "cut-off", "landed"].includes(each.kind));
      const words = [`${page.uavs[k]}: ${landed(k, i) ? "landed" : recorded(k, i)}`];
      if (why) words.push(why.words.split(": ").slice(1).join(": "));
      const { points, leg, number } = goalOf(k, t);
      if (number || points.length > 1) words.push(`point ${leg + 1} of ${points.length}${number ? ` of its goal ${number}` : ""}`);
      words.push(charge === 255 ? "battery unknown" : `battery ${charge} %`);
      if (page.clusters.length) words.push(`cluster ${page.clusters[clusterOf(k)]}`);
      if (leaderOf(k, i) === k) words.push("the head"); else words.push(!page.terms.length ? "no plan is recorded" : age === 255 ? "no head has heard it" : age ? `the head's fix of it is ${age} slot${age > 1 ? "s" : ""} old` : "the head has its fix");
      return words.join("; ");
    },
  };
};
