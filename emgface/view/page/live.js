// The live face: activations by sliders or curves; frames and motions from the server on this computer.
const setup = data.live;
const N = setup.muscles.length;
const levels = new Float32Array(N);
const live = { frame: null, motion: null, at: 0, playing: false, tab: "sliders", asked: 0, drawn: 0 };
const side = (k) => setup.muscles[k].slice(-2);
const stem = (k) => setup.muscles[k].replace(/_[LR]$/, "");
const other = (k) => setup.muscles.findIndex((m) => stem(k) === m.replace(/_[LR]$/, "") && m !== setup.muscles[k]);
const fullName = (k) => setup.names[k] + ({ _L: ", left", _R: ", right" }[side(k)] || "");

let socket = null;
const NOTHING = "There is nothing to undo.";
function say(message) { if (socket && socket.readyState === 1) socket.send(JSON.stringify(message)); }
function notify(text) { $("message").textContent = text; }
// Answer of the program to a text, or a sentence `why` there is none.
async function posted(name, body) {
  try {
    const answer = await fetch(name, { method: "POST", body });
    if (answer.status === 413) return { why: "The text is larger than 1 MB." };
    return answer.ok ? await answer.json() : { why: `The program answered with an error (${answer.status}).` };
  } catch { return { why: "The program has ended or does not answer." }; }
}

function show() {
  let skin, markers;
  if (live.tab === "curves" && live.motion) {
    const { skin: all, marker, count } = live.motion, size = all.length / count, few = marker.length / count;
    skin = all.subarray(live.at * size, (live.at + 1) * size);
    markers = marker.subarray(live.at * few, (live.at + 1) * few);
  } else if (live.frame) ({ skin, markers } = live.frame);
  else { skin = rest; markers = new Int16Array(0); }
  for (let i = 0; i < skin.length; i++) position[i] = skin[i] * MM;
  follow(position, 3);
  colour.set(own);
  const measured = live.tab === "curves" && live.motion && live.measured && $("measured").checked ? live.measured : null;
  const points = { simulated: [], measured: data.markers.map((_, m) => {
    const at = measured && 3 * (Math.min(live.at, measured.length / (3 * data.markers.length) - 1) * data.markers.length + m);
    return !measured || measured[at] === data.absent ? null : [0, 1, 2].map((c) => measured[at + c] * MM);
  }) };
  data.markers.forEach((_, m) => {
    points.simulated.push(3 * m + 2 < markers.length ? [0, 1, 2].map((c) => markers[3 * m + c] * MM) : null);
  });
  draw(points);
  scale();
  live.drawn++;
  canvas.dataset.frames = live.drawn;
  canvas.dataset.at = live.at;
  canvas.dataset.shown = canvas.dataset.motion || 0;
}

// A bar of a round length, at most a fifth of the width.
function scale() {
  const perPixel = (2 * camera(canvas.clientWidth, canvas.clientHeight).half) / canvas.clientHeight;
  const length = [100, 50, 20, 10, 5, 2, 1].find((mm) => mm / perPixel < canvas.clientWidth / 5) || 1;
  $("scalebar").firstElementChild.style.width = `${(length / perPixel).toFixed(1)}px`;
  $("scalebar").lastElementChild.textContent = `${length} mm`;
}

// Frames: numbers, activations, skin, markers.
const numbers = setup.head.length + N;
function framed(buffer) {
  const values = new Float32Array(buffer.slice(0, 4 * numbers));
  const points = new Int16Array(buffer.slice(4 * numbers));
  const row = Object.fromEntries(setup.head.map((name, k) => [name, values[k]]));
  live.frame = { row, levels: values.subarray(setup.head.length), skin: points.subarray(0, 3 * data.nodes), markers: points.subarray(3 * data.nodes) };
  if (live.tab === "sliders") {
    if (!setup.sliders) live.frame.levels.forEach((a, k) => { inputs[k].value = a; });
    status(row);
    requestAnimationFrame(() => { show(); reacted(); say({ kind: "drawn" }); });
  } else say({ kind: "drawn" });
}

// Time [ms] from the move of a slider to the first picture with another activation of its muscle.
function reacted() {
  const { moved, frame } = live;
  if (!moved || frame.levels[moved.k] === moved.level) return;
  canvas.dataset.reacted = (performance.now() - moved.at).toFixed(1);
  live.moved = null;
}

function motion(buffer) {
  const size = new DataView(buffer).getUint32(0, true);
  const head = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
  const points = new Int16Array(buffer.slice(4 + size));
  const count = head.time.length, skin = 3 * data.nodes * count, both = skin + 3 * setup.markers * count;
  live.motion = { ...head, count, skin: points.subarray(0, skin), marker: points.subarray(skin, both) };
  // A preview is aligned as the last complete motion, whose measured markers stay.
  if (!head.preview) live.measured = points.length > both ? points.subarray(both) : null;
  $("measured").parentElement.hidden = !live.measured;
  live.at = Math.min(live.at, count - 1);
  $("time").max = count - 1;
  canvas.dataset.waited = (performance.now() - live.asked).toFixed(1);
  canvas.dataset.motion = Number(canvas.dataset.motion || 0) + 1;
  for (const part of ["simulated", "scored", "total"]) canvas.dataset[part] = (1e3 * head[part]).toFixed(1);
  canvas.dataset.way = head.preview ? "preview" : "complete";
  notify([head.doubt && `The reduced face is not trusted here: ${head.doubt}.`, head.clipped && `${head.clipped} knots are outside 0 to 1 and limited.`, head.why && `No score: ${head.why}`].filter(Boolean).join(" "));
  entries([["bound of the error", `${(1e3 * head.bound).toFixed(2)} mm`], ["computed in", `${(1e3 * head.total).toFixed(0)} ms`], ["steps", head.preview ? "preview" : "complete"], ["force of contact", "requires full order"], ["force", ""]]);
  if (Object.keys(head.rho).length) scores(head.rho);
  live.pending = false;
  instant();
  if (live.again) { const preview = live.again === "preview"; live.again = null; ask(preview); }
}

function entries(rows) {
  $("status").replaceChildren(...rows.map(([name, value]) => {
    const one = document.createElement("div");
    one.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: value }));
    return one;
  }));
}
function status(row) {
  const ms = (x) => `${(1e3 * x).toFixed(1)} ms`;
  const rows = [["time", `${row.time.toFixed(2)} s`], ["step computed in", ms(row.computing)]];
  if (Number.isFinite(row.bound)) rows.push(["bound of the error", `${(1e3 * row.bound).toFixed(2)} mm`]);
  if (Number.isFinite(row.smallest_J)) rows.push(["smallest J", row.smallest_J.toFixed(3)]);
  rows.push(["latency", ms(row.latency)]);
  if (!setup.real_time) rows.push(["pace", `${row.pace.toFixed(3)} of real time`]);
  if (!setup.sliders) rows.push(["lost samples", row.lost.toFixed(0)]);
  entries(rows);
  $("state").textContent = row.trusted ? setup.words : "The activation is outside the range of the training: the motion is not trusted.";
  $("state").style.color = row.trusted ? "" : "var(--orange)";
  canvas.dataset.time = row.time.toFixed(2);
}

function scores(rho) {
  $("rho-title").hidden = false;
  $("rho").replaceChildren(...Object.entries(rho).flatMap(([name, value]) => {
    const bar = Object.assign(document.createElement("span"), { className: "bar" });
    const fill = bar.appendChild(document.createElement("i"));
    fill.style.width = `${Math.max(0, Math.min(1, value ?? 0)) * 100}%`;
    fill.className = value !== null && value < 0.5 ? "low" : "";
    return [Object.assign(document.createElement("span"), { textContent: name.replaceAll("_", " ") }), bar,
      Object.assign(document.createElement("span"), { textContent: value === null ? "undefined" : value.toFixed(2) })];
  }));
}

// Sliders.
const inputs = [];
const before = [];
function remember() { before.push(Array.from(inputs, (i) => Number(i.value))); if (before.length > 200) before.shift(); }
function send() { say({ kind: "activation", values: inputs.map((i) => Number(i.value)) }); }
function build() {
  const place = $("grid");
  const put = (tag, cls, text) => { const one = document.createElement(tag); one.className = cls; one.textContent = text; place.append(one); return one; };
  put("span", "head", "right"); put("b", "head", ""); put("span", "head", "left");
  const slider = (k, cls) => {
    if (k < 0) { put("span", "", ""); return; }
    const one = Object.assign(document.createElement("input"), { type: "range", min: 0, max: 1, step: 0.01, value: 0, id: `slide-${setup.muscles[k]}`, className: cls });
    one.setAttribute("aria-label", fullName(k));
    one.title = fullName(k);
    one.disabled = !setup.sliders;
    one.addEventListener("pointerdown", remember);
    one.addEventListener("keydown", (event) => { if (event.key.startsWith("Arrow")) remember(); });
    one.addEventListener("input", () => {
      const pair = other(k);
      if ($("linked").checked && pair >= 0) inputs[pair].value = one.value;
      if (!live.moved && live.frame && Math.abs(live.frame.levels[k] - one.value) > 0.01) live.moved = { k, level: live.frame.levels[k], at: performance.now() };
      send();
    });
    inputs[k] = one;
    place.append(one);
  };
  for (const name of [...new Set(setup.muscles.map((_, k) => stem(k)))]) {
    const right = setup.muscles.indexOf(`${name}_R`), left = setup.muscles.indexOf(`${name}_L`);
    const alone = setup.muscles.indexOf(name);
    slider(right >= 0 ? right : alone, "right");
    const k = [right, left, alone].find((x) => x >= 0);
    put("b", "", `${setup.names[k]}`).title = name;
    slider(left, "");
  }
  for (const [letter, one] of Object.entries(setup.presets)) {
    const button = Object.assign(document.createElement("button"), { type: "button", textContent: one.name, title: `instruction ${letter}` });
    button.disabled = !setup.sliders;
    button.addEventListener("click", () => { notify(`Activations of "${one.name}".`); remember(); one.levels.forEach((a, k) => { inputs[k].value = a; }); send(); });
    $("presets").append(button);
  }
  $("rest").addEventListener("click", () => { remember(); for (const i of inputs) i.value = 0; send(); say({ kind: "rest" }); });
  $("undo").addEventListener("click", () => { const last = before.pop(); if (last) { last.forEach((a, k) => { inputs[k].value = a; }); send(); } else notify(NOTHING); });
  for (const id of ["undo", "rest", "linked"]) $(id).disabled = !setup.sliders;
}

// Curves: knots of each muscle, edited on a canvas.
const plot = $("curve");
const edit = { knots: {}, chosen: -1, past: [], grip: false };
const muscle = () => $("muscle").value;
const end = () => Math.min(Math.max(Number($("duration").value), 0.1), 60);
function knots(name = muscle()) { return edit.knots[name] || (edit.knots[name] = [[0, 0], [end(), 0]]); }
function past() { edit.past.push(JSON.stringify(edit.knots)); if (edit.past.length > 200) edit.past.shift(); }
function ask(preview) {
  if (live.tab !== "curves") return;
  if (live.pending) { live.again = preview ? live.again || "preview" : "complete"; return; }
  live.pending = true;
  live.asked = performance.now();
  if (live.motion) force();
  say({ kind: "curves", duration: end(), interpolation: $("interpolation").value, knots: edit.knots, preview });
}
const margin = { l: 34, r: 8, t: 8, b: 20 };
const across = (t) => margin.l + (t / end()) * (plot.clientWidth - margin.l - margin.r);
const down = (v) => margin.t + (1 - v) * (plot.clientHeight - margin.t - margin.b);
function value(rows, t) {
  if (t <= rows[0][0]) return rows[0][1];
  const last = rows.length - 1;
  if (t >= rows[last][0]) return rows[last][1];
  let i = 0;
  while (rows[i + 1][0] <= t) i++;
  const [t0, y0] = rows[i], [t1, y1] = rows[i + 1], s = (t - t0) / (t1 - t0);
  const way = $("interpolation").value;
  if (way === "step") return y0;
  if (way === "linear" || rows.length < 3) return y0 + s * (y1 - y0);
  const slope = (k) => (k === 0 ? (rows[1][1] - rows[0][1]) / (rows[1][0] - rows[0][0]) : k === last ? (rows[last][1] - rows[last - 1][1]) / (rows[last][0] - rows[last - 1][0]) : (rows[k + 1][1] - rows[k - 1][1]) / (rows[k + 1][0] - rows[k - 1][0]));
  const h = t1 - t0, a = slope(i) * h, b = slope(i + 1) * h;
  return y0 + s * (a + s * (3 * (y1 - y0) - 2 * a - b + s * (2 * (y0 - y1) + a + b)));
}
function plotted() {
  const ratio = window.devicePixelRatio || 1, w = plot.clientWidth, h = plot.clientHeight;
  if (plot.width !== Math.round(w * ratio) || plot.height !== Math.round(h * ratio)) { plot.width = Math.round(w * ratio); plot.height = Math.round(h * ratio); }
  const pen = plot.getContext("2d", { willReadFrequently: true }), css = getComputedStyle(document.documentElement);
  const ink = css.getPropertyValue("--ink"), soft = css.getPropertyValue("--soft"), lineColour = css.getPropertyValue("--line"), blue = css.getPropertyValue("--blue"), orange = css.getPropertyValue("--orange");
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.clearRect(0, 0, w, h);
  pen.font = "11px system-ui, sans-serif"; pen.fillStyle = soft; pen.strokeStyle = lineColour; pen.lineWidth = 1;
  for (const v of [0, 0.5, 1]) { pen.beginPath(); pen.moveTo(margin.l, down(v)); pen.lineTo(w - margin.r, down(v)); pen.stroke(); pen.fillText(v.toFixed(1), 8, down(v) + 4); }
  const ticks = 4;
  for (let k = 0; k <= ticks; k++) { const t = (end() * k) / ticks; pen.fillText(`${t.toFixed(2)} s`, Math.min(across(t), w - 38), h - 5); }
  const line = (rows, colour, width) => {
    pen.beginPath(); pen.strokeStyle = colour; pen.lineWidth = width;
    for (let x = 0; x <= 200; x++) { const t = (end() * x) / 200, y = down(Math.min(Math.max(value(rows, t), 0), 1)); if (x) pen.lineTo(across(t), y); else pen.moveTo(across(t), y); }
    pen.stroke();
  };
  for (const [name, rows] of Object.entries(edit.knots)) if (name !== muscle()) line(rows, lineColour, 1);
  const mine = knots();
  line(mine, blue, 2);
  mine.forEach(([t, v], k) => {
    pen.beginPath(); pen.arc(across(t), down(Math.min(Math.max(v, 0), 1)), k === edit.chosen ? 6 : 4, 0, 7);
    pen.fillStyle = k === edit.chosen ? orange : blue; pen.fill();
  });
  if (live.motion) { const t = live.motion.time[live.at]; pen.beginPath(); pen.strokeStyle = ink; pen.lineWidth = 1; pen.moveTo(across(t), margin.t); pen.lineTo(across(t), h - margin.b); pen.stroke(); }
}
function move(k, t, v, preview = true) {
  const rows = knots(), gap = 1e-3;
  const low = k ? rows[k - 1][0] + gap : 0, high = k < rows.length - 1 ? rows[k + 1][0] - gap : end();
  rows[k] = [Math.round(1e4 * Math.min(Math.max(t, low), high)) / 1e4, Math.round(1e3 * Math.min(Math.max(v, 0), 1)) / 1e3];
  plotted(); ask(preview);
}
function place(event) {
  const box = plot.getBoundingClientRect(), w = plot.clientWidth - margin.l - margin.r, h = plot.clientHeight - margin.t - margin.b;
  return [((event.clientX - box.left - margin.l) / w) * end(), 1 - (event.clientY - box.top - margin.t) / h];
}
function nearest(event) {
  const box = plot.getBoundingClientRect(), x = event.clientX - box.left, y = event.clientY - box.top;
  let best = -1, least = 12;
  knots().forEach(([t, v], k) => { const d = Math.hypot(across(t) - x, down(Math.min(Math.max(v, 0), 1)) - y); if (d < least) { least = d; best = k; } });
  return best;
}
function add(t, v) {
  const rows = knots();
  if (rows.some((r) => Math.abs(r[0] - t) < 1e-3)) return;
  past(); rows.push([t, v]); rows.sort((a, b) => a[0] - b[0]);
  edit.chosen = rows.findIndex((r) => r[0] === t);
  move(edit.chosen, t, v, false);
}
function change(alter) {
  past();
  const made = {};
  for (const [name, rows] of Object.entries(edit.knots)) { const [to, moved] = alter(name, rows); made[to] = moved; }
  edit.knots = made; edit.chosen = -1; plotted(); ask(false);
}
function curveEditor() {
  setup.muscles.forEach((m, k) => $("muscle").append(Object.assign(document.createElement("option"), { value: m, textContent: fullName(k) })));
  edit.knots = structuredClone(setup.curves.knots || {});
  $("duration").value = Number((setup.curves.duration || 1.6).toFixed(4));
  $("interpolation").value = setup.curves.interpolation || "linear";
  $("duration").addEventListener("change", () => { $("duration").value = Number(end().toFixed(4)); });
  for (const id of ["muscle", "interpolation", "duration"]) $(id).addEventListener("change", () => { edit.chosen = -1; plotted(); ask(false); });
  plot.addEventListener("pointerdown", (event) => { edit.chosen = nearest(event); if (edit.chosen >= 0) { past(); edit.grip = true; plot.setPointerCapture(event.pointerId); } plotted(); });
  plot.addEventListener("pointermove", (event) => { if (edit.grip) move(edit.chosen, ...place(event)); });
  plot.addEventListener("pointerup", () => { if (edit.grip) { edit.grip = false; ask(false); } });
  plot.addEventListener("dblclick", (event) => { if (nearest(event) < 0) add(...place(event)); });
  plot.addEventListener("keydown", (event) => {
    const rows = knots(), k = edit.chosen;
    const step = { ArrowLeft: [-0.01, 0], ArrowRight: [0.01, 0], ArrowUp: [0, 0.02], ArrowDown: [0, -0.02] }[event.key];
    if (step && k >= 0) { event.preventDefault(); past(); move(k, rows[k][0] + step[0], rows[k][1] + step[1], false); }
    if (event.key === "PageDown" || event.key === "PageUp") { event.preventDefault(); edit.chosen = (k + (event.key === "PageDown" ? 1 : rows.length - 1 + (k < 0 ? 1 : 0))) % rows.length; plotted(); }
    if (event.key === "Insert") { event.preventDefault(); const i = Math.max(Math.min(k, rows.length - 2), 0); const t = rows.length > 1 ? (rows[i][0] + rows[i + 1][0]) / 2 : end() / 2; add(Math.round(1e4 * t) / 1e4, value(rows, t)); }
    if ((event.key === "Delete" || event.key === "Backspace") && k >= 0 && rows.length > 1) { event.preventDefault(); past(); rows.splice(k, 1); edit.chosen = -1; plotted(); ask(false); }
  });
  const swap = (name) => name.replace(/_([LR])$/, (_, s) => (s === "L" ? "_R" : "_L"));
  $("mirror").addEventListener("click", () => { past(); edit.knots[swap(muscle())] = structuredClone(knots()); plotted(); ask(false); });
  $("exchange").addEventListener("click", () => change((name, rows) => [swap(name), rows]));
  const shift = (dt) => change((name, rows) => [name, rows.map(([t, v]) => [Math.round(1e4 * (t + dt)) / 1e4, v])]);
  const stretch = (s) => change((name, rows) => [name, rows.map(([t, v]) => [Math.round(1e4 * t * s) / 1e4, v])]);
  $("earlier").addEventListener("click", () => shift(-0.02));
  $("later").addEventListener("click", () => shift(0.02));
  $("shorter").addEventListener("click", () => stretch(0.95));
  $("longer").addEventListener("click", () => stretch(1.05));
  $("undo-curve").addEventListener("click", () => { const last = edit.past.pop(); if (last) { edit.knots = JSON.parse(last); edit.chosen = -1; plotted(); ask(false); } else notify(NOTHING); });
  $("save").addEventListener("click", () => {
    const rows = Object.entries(edit.knots).flatMap(([name, all]) => all.map(([t, v]) => [name, t, v, $("interpolation").value, end()].join()));
    const text = ["muscle,time,value,interpolation,duration", ...rows].join("\n") + "\n";
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([text], { type: "text/csv" })), download: "curves.csv" });
    link.click(); URL.revokeObjectURL(link.href);
    notify("The curves were passed to the browser as curves.csv.");
  });
  $("load").addEventListener("change", async () => {
    const file = $("load").files[0];
    if (!file) return;
    const answer = await posted("curves", await file.text());
    if (answer.why) { notify(answer.why); return; }
    past(); edit.knots = answer.knots; $("duration").value = Number(answer.duration.toFixed(4)); $("interpolation").value = answer.interpolation;
    edit.chosen = -1; plotted(); ask(false);
  });
  new ResizeObserver(plotted).observe(plot);
}

// The force of the chosen muscle, which only the complete motion of the curves that are shown has.
function force() {
  const { forces } = live.motion, k = setup.forces.indexOf(muscle()), place = $("status").lastElementChild;
  if (!place) return;  // the curves have no motion
  const shown = forces && k >= 0 && !live.pending;
  const why = k < 0 ? "not available: the muscle has no fibre lines" : "follows the complete motion";
  const most = shown ? Math.max(...forces.map((row) => row[k])) : 0;
  place.firstElementChild.textContent = `force of ${fullName(setup.muscles.indexOf(muscle()))}`;
  place.lastElementChild.textContent = shown ? `${forces[live.at][k].toFixed(3)} N, at most ${most.toFixed(3)} N` : why;
  canvas.dataset.force = shown ? forces[live.at][k] : "";
}
// Curves whose motion failed: the picture remains that of the former ones, without their numbers.
function failed(why) {
  live.pending = false;
  canvas.dataset.refused = why;
  canvas.dataset.force = "";
  if (live.tab !== "curves") return;
  $("rho").replaceChildren();
  $("rho-title").hidden = true;
  $("status").replaceChildren();
  notify(`${why} The face shows the motion of the former curves.`);
  if (live.again) { const preview = live.again === "preview"; live.again = null; ask(preview); }
}

// Time of a motion of curves.
function instant() {
  const { time } = live.motion;
  $("time").value = live.at;
  $("clock").textContent = `${time[live.at].toFixed(2)} s`;
  force();
  plotted();
  refresh();
}
function timeline() {
  let began = 0, from = 0;
  const set = (playing) => { live.playing = playing; $("play").setAttribute("aria-pressed", String(playing)); $("play").textContent = playing ? "Pause" : "Play"; };
  const advance = (now) => {
    if (!live.playing || !live.motion) return;
    const time = live.motion.time, last = time[time.length - 1];
    const at = from + (Number($("speed").value) * (now - began)) / 1000;
    if (at > last) {
      if (!$("loop").checked) { live.at = time.length - 1; instant(); set(false); return; }
      from = 0; began = now; live.at = 0;
    } else live.at = Math.max(0, time.findIndex((t) => t >= at - 1e-9));
    instant();
    requestAnimationFrame(advance);
  };
  const toggle = () => { if (!live.motion) return; set(!live.playing); if (live.playing) { began = performance.now(); from = live.at === live.motion.count - 1 ? 0 : live.motion.time[live.at]; requestAnimationFrame(advance); } };
  $("play").addEventListener("click", toggle);
  $("measured").addEventListener("change", refresh);
  $("speed").addEventListener("change", () => { began = performance.now(); from = live.motion ? live.motion.time[live.at] : 0; });
  $("time").addEventListener("input", () => { if (live.motion) { set(false); live.at = Number($("time").value); instant(); } });
  document.addEventListener("keydown", (event) => {
    if (event.key === " " && (event.target === document.body || event.target === canvas || event.target === plot)) { event.preventDefault(); toggle(); }
  });
}

function tabs() {
  const open = (name) => {
    live.tab = name;
    for (const one of ["sliders", "curves"]) { $(one).hidden = one !== name; $(`tab-${one}`).setAttribute("aria-selected", String(one === name)); }
    document.querySelector(".time").hidden = name !== "curves";
    $("tag").textContent = name === "curves" ? "edited curves" : "live";
    notify("");
    if (name === "curves") { say({ kind: "still" }); plotted(); ask(false); } else { if (setup.sliders) send(); else say({ kind: "go" }); refresh(); }
  };
  for (const one of ["sliders", "curves"]) $(`tab-${one}`).addEventListener("click", () => open(one));
  $("tab-curves").disabled = !setup.edits;
  if (!setup.edits) $("tab-curves").title = "Curves require a reduced face.";
  document.querySelector(".time").hidden = true;
}

// The folder that keeps curves, view and notes.
function workspace() {
  const kept = setup.workspace;
  if (!kept) return;
  $("workspace").hidden = false;
  $("notes").value = kept.notes;
  Object.assign(view, kept.view);
  $("keep").addEventListener("click", async () => {
    const body = JSON.stringify({ curves: { knots: edit.knots, duration: end(), interpolation: $("interpolation").value }, view, notes: $("notes").value });
    const answer = await posted("workspace", body);
    notify(answer.why || `Saved in ${answer.wrote}.`);
    canvas.dataset.kept = answer.wrote || "";
  });
}

function connect() {
  if (!location.protocol.startsWith("http")) {
    $("state").textContent = "This page is a copy without its program: start emgface live.";
    canvas.dataset.connected = "no";
    return;
  }
  socket = new WebSocket(`ws://${location.host}${location.pathname}socket`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { $("state").textContent = setup.words; canvas.dataset.connected = "yes"; };
  socket.onmessage = (event) => {
    if (typeof event.data === "string") {
      const said = JSON.parse(event.data);
      notify(said.text || said.why || "");
      if (said.kind === "refused") failed(said.why);
      return;
    }
    // A motion begins with the length of its header, a frame with its time.
    if (event.data.byteLength === 4 * numbers + 6 * (data.nodes + setup.markers)) framed(event.data);
    else motion(event.data);
  };
  socket.onclose = () => {
    live.pending = false;
    $("state").textContent = "The program has ended or does not answer; trying again.";
    canvas.dataset.connected = "no";
    setTimeout(connect, 1000);
  };
}

let rest;
async function begin() {
  await unpack();
  rest = await frames(setup.rest, 1);
  millimetres(rest, 0, start.length, start);
  prepare();
  build(); curveEditor(); timeline(); tabs(); workspace();
  show();
  connect();
  canvas.dataset.ready = "yes";
}
begin();
