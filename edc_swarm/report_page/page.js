"use strict";
(() => {
  const byId = (id) => document.getElementById(id);
  const pages = ["data", "data-b"].map(byId).filter(Boolean).map((node) => JSON.parse(node.textContent));
  const page = pages[0];
  const [slider, play, speed, clock, detail, followList] = ["slider", "play", "speed", "clock", "detail", "follow"].map(byId);
  const END_S = Math.max(...pages.map((each) => Math.max(each.end_s, each.slot_s)));
  const ACTIVE_S = Math.min(END_S, Math.max(...pages.map((each) => each.active_s || END_S)));
  const OPENS_AT = 0.35, MANY_LINKS = 30;
  const span = { from: 0, to: ACTIVE_S };
  let timeS = 0, playing = false, colours = {};
  const theme = { of: (name) => colours[name] };
  const layers = Object.fromEntries(["targets", "trails", "truth", "links"].map((name) => [name, byId(`layer-${name}`)]));
  layers.links.checked = page.uavs.length <= MANY_LINKS;
  const canvases = [...document.querySelectorAll("canvas.map")];
  const maps = canvases.map((canvas, n) => createMap(pages[n], canvas, theme, layers));
  const plots = createPlots(pages, byId("plots"), span, (t) => { setPlaying(false); seek(t); });
  const overview = createOverview(page, byId("overview"), span, END_S, (from, to) => setSpan(from, to));

  // ---- the story ----

  const lists = [...document.querySelectorAll("ol.events")];
  const items = pages.map((each, n) => each.story.map((told) => {
    const item = document.createElement("li"), button = document.createElement("button");
    item.className = `${told.level} ${told.kind}`;
    button.type = "button";
    for (const [kind, words] of [["time", `${told.time_s.toFixed(1)} s`], ["kind", told.kind], ["words", told.words]]) {
      const part = document.createElement("span");
      part.className = kind; part.textContent = words; button.appendChild(part);
    }
    button.addEventListener("click", () => { setPlaying(false); seek(told.time_s); if (told.uavs.length === 1 && n === 0) setFollowed(told.uavs[0]); });
    item.appendChild(button);
    lists[n].appendChild(item);
    return { time: told.time_s, item, isDetail: told.level === "detail" };
  }));
  const showDetails = () => { for (const list of items) for (const each of list) each.item.hidden = each.isDetail && !byId("details").checked; };
  const markNow = () => items.forEach((list, n) => {
    const now = list.findLast((each) => each.time <= timeS + 1e-9 && !each.item.hidden);
    for (const each of list) each.item.classList.toggle("now", each === now);
    if (now) lists[n].scrollTop = now.item.offsetTop - lists[n].clientHeight / 2;
  });
  const step = (way) => {
    const times = items[0].filter((each) => !each.item.hidden).map((each) => each.time);
    const next = way > 0 ? times.find((t) => t > timeS + 1e-6) : times.findLast((t) => t < timeS - 1e-6);
    if (next !== undefined) seek(next);
  };

  // ---- time ----

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
  const drawMaps = () => { for (const map of maps) map.draw(timeS); };
  const headsOf = (n) => {
    const { uavs, terms, clusters } = pages[n], leaders = maps[n].leaders(timeS);
    if (leaders.every((head) => head < 0)) return terms.length ? "no head" : "head unknown";
    return (leaders.length > 1 ? "heads " : "head ") + leaders.map((head, c) => (clusters.length ? `${clusters[c]}: ` : "") + (uavs[head] ?? "none")).join(", ");
  };
  const show = () => {
    const followed = Number(followList.value), heads = pages.map((_, n) => (pages.length > 1 ? `${"AB"[n]}: ` : "") + headsOf(n)).join("; ");
    clock.textContent = `${timeS.toFixed(1)} s of ${END_S.toFixed(1)} s, slot ${Math.floor(timeS / page.slot_s + 1e-9)}, ${heads}`;
    const words = followed >= 0 ? maps[0].describe(followed, timeS) : "";
    if (detail.textContent !== words) detail.textContent = words;
    slider.value = timeS;
    slider.setAttribute("aria-valuetext", clock.textContent);
    drawMaps(); plots.show(timeS); overview.draw(timeS); markNow();
  };
  const seek = (t) => { timeS = Math.max(0, Math.min(END_S, t)); show(); };
  const setSpan = (from, to) => {
    const length = Math.min(END_S, Math.max(2 * page.slot_s, to - from));
    span.from = Math.max(0, Math.min(END_S - length, from)); span.to = span.from + length;
    plots.layout(); show();
  };
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

  // ---- the map ----

  const setFollowed = (k) => {
    followList.value = String(k);
    maps.forEach((map, n) => map.follow(k < pages[n].uavs.length ? k : -1));
    for (const row of document.querySelectorAll("#flights tbody tr")) row.classList.toggle("now", row.rowIndex === k + 1);
    show();
  };
  const zoom = (factor, event) => { for (const map of maps) map.zoomBy(factor, event); drawMaps(); };
  canvases.forEach((canvas, n) => {
    let from = null, moved = false;
    canvas.addEventListener("wheel", (event) => {
      if (!(event.ctrlKey || event.metaKey || document.activeElement === canvas)) return;
      event.preventDefault(); zoom(event.deltaY < 0 ? 1.25 : 0.8, event);
    }, { passive: false });
    canvas.addEventListener("pointerdown", (event) => { from = [event.clientX, event.clientY]; moved = false; });
    canvas.addEventListener("pointermove", (event) => {
      if (from && event.buttons) {
        const [dx, dy] = [event.clientX - from[0], event.clientY - from[1]];
        if (moved || Math.hypot(dx, dy) > 4) {
          moved = true; from = [event.clientX, event.clientY];
          if (Number(followList.value) >= 0) setFollowed(-1);
          for (const map of maps) map.panBy(dx, dy);
          drawMaps();
        }
      } else if (maps[n].hover(maps[n].under(event))) drawMaps();
    });
    canvas.addEventListener("pointerleave", () => { if (maps[n].hover(-1)) drawMaps(); });
    canvas.addEventListener("pointerup", (event) => { if (from && !moved) setFollowed(maps[n].under(event)); from = null; });
  });
  page.uavs.forEach((uav, k) => followList.add(new Option(uav, String(k))));
  followList.addEventListener("change", () => setFollowed(Number(followList.value)));
  document.querySelectorAll("#flights tbody tr").forEach((row, k) => row.addEventListener("click", () => setFollowed(k)));
  for (const layer of Object.values(layers)) layer.addEventListener("change", drawMaps);

  // ---- keys, buttons, layout ----

  const showAll = () => { for (const map of maps) map.reset(); setFollowed(-1); };
  const keys = {
    " ": () => setPlaying(!playing), ArrowRight: (e) => seek(timeS + (e.shiftKey ? 10 : 1) * page.slot_s),
    ArrowLeft: (e) => seek(timeS - (e.shiftKey ? 10 : 1) * page.slot_s), Home: () => seek(0), End: () => seek(END_S),
    "+": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: showAll, n: () => step(1), p: () => step(-1),
  };
  document.addEventListener("keydown", (event) => {
    // A list has its own keys, a button and a box have space; the slider's own arrows would not go a slot.
    const isOwn = event.target.closest?.(event.key === " " ? "select, button, [type=checkbox]" : "select");
    if (event.ctrlKey || event.metaKey || event.altKey || isOwn || !(event.key in keys)) return;
    event.preventDefault(); keys[event.key](event);
  });
  const clicks = {
    "zoom-in": () => zoom(1.5), "zoom-out": () => zoom(1 / 1.5), "zoom-all": showAll, "span-all": () => setSpan(0, END_S),
    "span-active": () => setSpan(0, ACTIVE_S), "span-near": () => setSpan(timeS - 5, timeS + 5),
  };
  for (const [id, act] of Object.entries(clicks)) byId(id).addEventListener("click", act);
  byId("details").addEventListener("change", () => { showDetails(); markNow(); });
  const layout = () => {
    const style = getComputedStyle(document.documentElement);
    colours = Object.fromEntries(["--ink", "--panel", "--soft", "--line", "--blue", "--green", "--vermillion", "--amber", "--grey", "--cyan", "--purple"].map((n) => [n, style.getPropertyValue(n).trim()]));
    canvases.forEach((canvas, n) => {
      const [left, low, right, high] = pages[n].extent_m;
      canvas.style.height = `${Math.round(Math.max(280, Math.min(canvas.clientWidth * (high - low) / Math.max(1e-9, right - left), canvas.clientWidth, 700)))}px`;
    });
    plots.layout(); drawMarks(); show();
  };
  slider.max = END_S;
  slider.addEventListener("input", () => { setPlaying(false); seek(Number(slider.value)); });
  play.addEventListener("click", () => setPlaying(!playing));
  window.addEventListener("resize", layout);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", layout);
  timeS = OPENS_AT * ACTIVE_S;
  showDetails();
  layout();
})();
