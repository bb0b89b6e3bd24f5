// Recording browser: channels as smallest and largest values per pixel column, markers, spectra, marks.
const data = JSON.parse(document.getElementById("data").textContent);
// A copy of the page without its program has the data of the page, and passes the mapping to the browser.
if (!location.protocol.startsWith("http")) data.served = data.saves = false;
const $ = (id) => document.getElementById(id);
const { emg, markers } = data;
const canvas = $("traces"), overview = $("overview");
// Colours of the style sheet, looked up once per appearance (light or dark).
const looked = new Map();
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { looked.clear(); refresh(); });
function css(name) {
  if (!looked.has(name)) looked.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return looked.get(name);
}

async function bytes(text) {
  const raw = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Uint8Array(await new Response(new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
}
function joined(packed) {
  const n = packed.length / 2, values = new Int16Array(n);
  for (let i = 0; i < n; i++) values[i] = packed[i] | (packed[n + i] << 8);
  return values;
}
// Levels of bins: each of the next level covers four.
async function levels(given, rows) {
  const plain = async (text) => {
    const values = joined(await bytes(text)), n = given.bins;
    for (let r = 0; r < rows; r++) for (let i = 1; i < n; i++) values[r * n + i] += values[r * n + i - 1];
    return values;
  };
  const low = await plain(given.low), high = given.high ? await plain(given.high) : low;
  const all = [{ size: given.size, n: given.bins, offset: 0, low, high }];
  while (all[all.length - 1].n > 512) {
    const fine = all[all.length - 1], n = Math.ceil(fine.n / 4);
    const next = { size: 4 * fine.size, n, offset: 0, low: new Int16Array(rows * n).fill(data.gap), high: new Int16Array(rows * n).fill(data.gap) };
    for (let r = 0; r < rows; r++) for (let i = 0; i < fine.n; i++) {
      const a = fine.low[r * fine.n + i], b = fine.high[r * fine.n + i], k = r * n + (i >> 2);
      if (a === data.gap) continue;
      if (next.low[k] === data.gap) { next.low[k] = a; next.high[k] = b; continue; }
      if (a < next.low[k]) next.low[k] = a;
      if (b > next.high[k]) next.high[k] = b;
    }
    all.push(next);
  }
  return all;
}

const count = emg ? emg.labels.length : 0;
const length = emg ? emg.samples / emg.rate : 0;
const first = emg ? emg.start : markers.time[0];
const last = emg ? first + length : markers.time[markers.time.length - 1];
const view = { from: first, to: last, at: first, chosen: 0, gain: 1, top: 0, detail: null, playing: false };
const marks = { order: [...Array(count).keys()], hidden: new Set(), bad: new Set(), names: {}, markerNames: {}, spans: [] };
const past = [];
let source = {}, spectra = null, points = null, frame = 0;

const keep = () => { past.push(JSON.stringify({ ...marks, hidden: [...marks.hidden], bad: [...marks.bad] })); if (past.length > 200) past.shift(); };
function undo() {
  const one = past.pop();
  if (!one) { say("There is nothing to undo."); return; }
  const old = JSON.parse(one);
  Object.assign(marks, { ...old, hidden: new Set(old.hidden), bad: new Set(old.bad) });
  listed(); refresh();
}
const say = (text) => { $("message").textContent = text; };
const label = (k) => emg.labels[k];
const name = (k) => marks.names[label(k)] ?? label(k);

function shown() {
  const text = $("find").value.toLowerCase();
  return marks.order.filter((k) => !marks.hidden.has(k) && (!text || label(k).toLowerCase().includes(text) || name(k).toLowerCase().includes(text)));
}
function rows() {
  const all = shown(), most = Number($("rows").value) || all.length;
  view.top = Math.min(Math.max(view.top, 0), Math.max(all.length - most, 0));
  return all.slice(view.top, view.top + most);
}
const way = () => ($("filtered").checked && source.filtered ? "filtered" : "raw");

let waiting = false;
function refresh() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; drawAll(); });
}

// Bins of a view: the finest level that has no more than two bins per column, or those of the server.
function binsFor(width) {
  const each = ((view.to - view.from) * emg.rate) / width;
  const all = source[way()];
  if (view.detail && view.detail.way === way() && view.from >= view.detail.from - 1e-9 && view.to <= view.detail.to + 1e-9 && view.detail.size < all[0].size) return view.detail;
  let k = 0;
  while (k + 1 < all.length && all[k + 1].size <= Math.max(each / 2, 1)) k++;
  return all[k];
}
let asking = 0;
function detail() {
  if (!data.served || !emg) return;
  const each = ((view.to - view.from) * emg.rate) / Math.max(wide(), 1);
  if (each >= source[way()][0].size || source[way()][0].size === 1) return;
  const begin = Math.max(Math.floor((view.from - (view.to - view.from) / 2 - first) * emg.rate), 0);
  const end = Math.min(Math.ceil((view.to + (view.to - view.from) / 2 - first) * emg.rate), emg.samples);
  const mine = ++asking, used = way();
  setTimeout(async () => {
    if (mine !== asking) return;
    const answer = await fetch(`span?start=${begin}&stop=${end}&columns=4096&filtered=${used === "filtered" ? 1 : 0}`).catch(() => null);
    if (!answer || !answer.ok) { say("The program has ended or does not answer; the page shows its own data."); return; }
    const buffer = await answer.arrayBuffer(), [n, size] = new Int32Array(buffer.slice(0, 8));
    const values = new Int16Array(buffer.slice(8)), half = values.length / 2;
    if (mine !== asking) return;
    view.detail = { way: used, n, size, offset: begin, from: first + begin / emg.rate, to: first + end / emg.rate, low: values.subarray(0, half), high: values.subarray(half) };
    canvas.dataset.detail = size;
    refresh();
  }, 60);
}

const margin = 92;
const across = (t) => margin + ((t - view.from) / (view.to - view.from)) * (wide() - margin);
const instant = (x) => view.from + ((x - margin) / (wide() - margin)) * (view.to - view.from);

// Sizes are those of the last change; to ask for them in every picture would lay out the page again.
const sizes = new Map(), wide = () => sizes.get(canvas)?.w ?? 1;
function measure(one) { sizes.set(one, { w: one.clientWidth, h: one.clientHeight }); }
function sized(one) {
  if (!sizes.has(one)) measure(one);
  const ratio = Math.min(window.devicePixelRatio || 1, 2), { w, h } = sizes.get(one);
  if (one.width !== Math.round(w * ratio) || one.height !== Math.round(h * ratio)) { one.width = Math.round(w * ratio); one.height = Math.round(h * ratio); }
  const pen = one.getContext("2d", { willReadFrequently: true });
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { pen, w, h, ratio };
}
// True if what a picture depends on has changed since it was drawn.
const states = new Map();
function changed(one, ...parts) {
  const { w, h } = sizes.get(one) ?? {}, now = [w, h, css("--paper"), ...parts].join();
  if (states.get(one) === now) return false;
  states.set(one, now);
  return true;
}

function rgb(text) {
  const probe = document.createElement("canvas").getContext("2d");
  probe.fillStyle = text;
  const v = parseInt(probe.fillStyle.slice(1), 16);
  return [(v >> 16) & 255, (v >> 8) & 255, v & 255];
}
const packed = new Map();
function packedColour(text) {
  if (!packed.has(text)) { const [r, g, b] = rgb(text); packed.set(text, ((255 << 24) | (b << 16) | (g << 8) | r) >>> 0); }
  return packed.get(text);
}

const picture = new Traces(data.gap);
function traces() {
  const { pen, w, h, ratio } = sized(canvas);
  const high = canvas.height, left = Math.round(margin * ratio), width = Math.max(canvas.width - left, 1);
  const list = rows(), scales = emg[way()].scale, same = $("same").checked, most = Math.max(...list.map((k) => scales[k]));
  picture.resize(pen, width, high, list.length);
  const blue = packedColour(css("--blue")), grey = packedColour(css("--line")), orange = packedColour(css("--orange"));
  list.forEach((k, r) => {
    const unit = (view.gain * 0.48 * (high / list.length) * (same ? scales[k] / most : 1)) / 32767;
    picture.row(r, k, unit, marks.bad.has(k) ? grey : k === view.chosen ? orange : blue);
  });
  picture.draw(binsFor(width), (view.from - first) * emg.rate, ((view.to - view.from) * emg.rate) / width, packedColour(css("--paper")));
  pen.fillStyle = css("--paper"); pen.fillRect(0, 0, margin, h);
  pen.putImageData(picture.image, left, 0);
  pen.font = "12px system-ui, sans-serif";
  const line = css("--line"), ink = css("--ink"), soft = css("--soft"), rowHeight = h / Math.max(list.length, 1);
  // Labels so close that they would overlap are thinned.
  const every = Math.max(1, Math.ceil(13 / rowHeight));
  list.forEach((k, r) => {
    if (r % every && k !== view.chosen) return;
    pen.fillStyle = k === view.chosen ? css("--orange") : marks.bad.has(k) ? soft : ink;
    const text = `${marks.bad.has(k) ? "✕ " : ""}${name(k)}`;
    pen.fillText(text.length > 14 ? `${text.slice(0, 13)}…` : text, 4, (r + 0.5) * rowHeight + 4);
  });
  for (const one of marks.spans) {
    const a = Math.max(across(one.start), margin), b = Math.min(across(one.stop), w);
    if (b <= a) continue;
    pen.fillStyle = "rgba(213,94,0,.22)";
    if (one.channel === null) pen.fillRect(a, 0, b - a, h);
    else { const r = list.findIndex((k) => label(k) === one.channel); if (r >= 0) pen.fillRect(a, r * rowHeight, b - a, rowHeight); }
  }
  if (view.drag) { pen.fillStyle = "rgba(0,114,178,.2)"; const a = Math.min(...view.drag), b = Math.max(...view.drag); pen.fillRect(a, 0, b - a, h); }
  for (const one of data.findings) if (Number.isFinite(one.at) && one.at >= view.from && one.at <= view.to) {
    const r = one.kind === "channel" ? list.findIndex((k) => label(k) === one.name) : -1;
    pen.fillStyle = css("--orange");
    pen.beginPath(); pen.arc(across(one.at), r < 0 ? 6 : (r + 0.2) * rowHeight, 4, 0, 7); pen.fill();
  }
  pen.strokeStyle = css("--green"); pen.fillStyle = css("--green");
  for (const one of data.events) if (one.at >= view.from && one.at <= view.to) { pen.beginPath(); pen.moveTo(across(one.at), 0); pen.lineTo(across(one.at), h); pen.stroke(); pen.fillText(one.label, across(one.at) + 3, 12); }
  const step = niceStep((view.to - view.from) / 6);
  const ticks = [];
  pen.strokeStyle = line;
  for (let t = Math.ceil(view.from / step) * step; t <= view.to; t += step) { const x = across(t); pen.beginPath(); pen.moveTo(x, 0); pen.lineTo(x, h); pen.globalAlpha = 0.5; pen.stroke(); pen.globalAlpha = 1; ticks.push([`${Number(t.toFixed(4))} s`, x + 3]); }
  // Times are written on the paper, not on the traces.
  for (const [text, x] of ticks) { pen.fillStyle = css("--paper"); pen.fillRect(x - 2, h - 15, pen.measureText(text).width + 4, 15); pen.fillStyle = soft; pen.fillText(text, x, h - 4); }
  pen.strokeStyle = ink;
  if (view.at >= view.from && view.at <= view.to) { pen.beginPath(); pen.moveTo(across(view.at), 0); pen.lineTo(across(view.at), h); pen.stroke(); }
}
function niceStep(x) { const p = 10 ** Math.floor(Math.log10(x)); return [1, 2, 5, 10].find((m) => m * p >= x) * p; }

let whole = null;  // the chosen channel over the whole recording
function overviewed() {
  const { pen, w, h, ratio } = sized(overview);
  const x = (t) => ((t - first) / (last - first)) * w;
  if (emg && (!whole || changed(overview, view.chosen, way()))) {
    whole = Object.assign(document.createElement("canvas"), { width: overview.width, height: overview.height });
    const still = whole.getContext("2d", { willReadFrequently: true });
    still.setTransform(ratio, 0, 0, ratio, 0, 0);
    const bins = source[way()][source[way()].length - 1], k = view.chosen;
    still.fillStyle = css("--blue");
    for (let i = 0; i < bins.n; i++) {
      const a = bins.low[k * bins.n + i], b = bins.high[k * bins.n + i];
      if (a === data.gap) continue;
      still.fillRect((i / bins.n) * w, h / 2 - (b / 32767) * h * 0.48, Math.max(w / bins.n, 1), Math.max(((b - a) / 32767) * h * 0.48, 1));
    }
  }
  pen.clearRect(0, 0, w, h);
  if (whole) pen.drawImage(whole, 0, 0, w, h);
  pen.fillStyle = "rgba(0,114,178,.18)"; pen.strokeStyle = css("--ink");
  pen.fillRect(x(view.from), 0, Math.max(x(view.to) - x(view.from), 2), h);
  pen.beginPath(); pen.moveTo(x(view.at), 0); pen.lineTo(x(view.at), h); pen.stroke();
}

function spectrum() {
  const { pen, w, h } = sized($("spectrum"));
  if (!emg || !changed($("spectrum"), view.chosen, name(view.chosen))) return;
  pen.clearRect(0, 0, w, h);
  const n = emg.spectra.count, own = spectra.subarray(view.chosen * n, (view.chosen + 1) * n);
  let low = Infinity, high = -Infinity;
  for (let i = 1; i < n; i++) { low = Math.min(low, own[i]); high = Math.max(high, own[i]); }
  pen.font = "11px system-ui, sans-serif"; pen.fillStyle = css("--soft");
  for (let k = 0; k <= 4; k++) pen.fillText(`${((emg.spectra.largest * k) / 4).toFixed(0)} Hz`, Math.min(30 + (k / 4) * (w - 36), w - 44), h - 4);
  pen.fillText(`${((high - low) / 10).toFixed(0)} dB`, 2, 12);
  pen.strokeStyle = css("--blue"); pen.beginPath();
  for (let i = 1; i < n; i++) { const x = 30 + (i / (n - 1)) * (w - 36), y = 6 + (1 - (own[i] - low) / Math.max(high - low, 1)) * (h - 28); if (i > 1) pen.lineTo(x, y); else pen.moveTo(x, y); }
  pen.stroke();
  $("of").textContent = name(view.chosen);
}

// Positions by marker, axis and time.
function coordinate(m, axis, i) { const v = points[(3 * m + axis) * markers.time.length + i]; return v === data.gap ? NaN : v; }
function instantOf(t) { let a = 0, b = markers.time.length - 1; while (a < b) { const c = (a + b) >> 1; if (markers.time[c] < t) a = c + 1; else b = c; } return a; }
function positions() {
  if (!markers) return;
  const { pen, w, h } = sized($("points"));
  if (!changed($("points"), instantOf(view.at), $("name-markers").checked, JSON.stringify(marks.markerNames))) return;
  pen.clearRect(0, 0, w, h);
  let most = 1;
  for (let i = 0; i < points.length; i += 7) if (points[i] !== data.gap) most = Math.max(most, Math.abs(points[i]));
  const i = instantOf(view.at), scale = Math.min(w, h) / (2.3 * most);
  pen.font = "10px system-ui, sans-serif";
  markers.labels.forEach((text, m) => {
    // From the front the subject's right is on the left.
    const x = w / 2 - coordinate(m, 0, i) * scale, y = h / 2 - coordinate(m, 2, i) * scale;
    if (!(x === x && y === y)) return;
    pen.beginPath(); pen.arc(x, y, 3.5, 0, 7); pen.fillStyle = css("--blue"); pen.fill();
    if ($("name-markers").checked) { pen.fillStyle = css("--soft"); pen.fillText(marks.markerNames[text] ?? text, x + 5, y); }
  });
}
function markerCurves() {
  if (!markers) return;
  const { pen, w, h } = sized($("curves"));
  if (!changed($("curves"), view.from, view.to, view.at, $("marker").selectedIndex)) return;
  pen.clearRect(0, 0, w, h);
  const m = Math.max($("marker").selectedIndex, 0), a = instantOf(view.from), b = Math.max(instantOf(view.to), a + 1);
  let most = 1;
  const mean = [0, 1, 2].map((c) => { let s = 0, n = 0; for (let i = a; i <= b; i++) { const v = coordinate(m, c, i); if (v === v) { s += v; n++; } } return n ? s / n : 0; });
  for (let c = 0; c < 3; c++) for (let i = a; i <= b; i++) { const v = Math.abs(coordinate(m, c, i) - mean[c]); if (v > most) most = v; }
  pen.font = "11px system-ui, sans-serif"; pen.fillStyle = css("--soft");
  pen.fillText(`±${(1e3 * most * markers.unit).toFixed(1)} mm`, 2, 12);
  ["--blue", "--orange", "--green"].forEach((colour, c) => {
    pen.strokeStyle = css(colour); pen.fillStyle = css(colour); pen.fillText("xyz"[c], w - 30 + 10 * c, 12); pen.beginPath();
    let open = false;
    const every = Math.max(1, Math.floor((b - a) / (2 * w)));
    for (let i = a; i <= b; i += every) { const v = coordinate(m, c, i); if (v !== v) { open = false; continue; } const x = ((markers.time[i] - view.from) / (view.to - view.from)) * w, y = h / 2 - ((v - mean[c]) / most) * h * 0.46; if (open) pen.lineTo(x, y); else pen.moveTo(x, y); open = true; }
    pen.stroke();
  });
  const x = ((view.at - view.from) / (view.to - view.from)) * w;
  pen.strokeStyle = css("--ink"); pen.beginPath(); pen.moveTo(x, 0); pen.lineTo(x, h); pen.stroke();
}

function drawAll() {
  const began = performance.now();
  if (emg) traces();
  overviewed(); spectrum(); positions(); markerCurves();
  if (!telling) { telling = true; setTimeout(tell, 100); }
  frame++;
  Object.assign(canvas.dataset, { frames: frame, took: (performance.now() - began).toFixed(1), columns: picture.drawn, from: view.from, to: view.to, at: view.at, chosen: emg ? label(view.chosen) : "" });
}
// Texts follow ten times per second: each change of them lays out the page.
let telling = false;
function tell() {
  telling = false;
  $("clock").textContent = `${view.at.toFixed(3)} s`;
  $("time").value = (1000 * (view.at - first)) / Math.max(last - first, 1e-9);
  $("state").textContent = `${view.from.toFixed(3)} to ${view.to.toFixed(3)} s of ${first.toFixed(3)} to ${last.toFixed(3)} s; ${emg ? `${rows().length} of ${count} channels, ${emg.rate.toFixed(1)} Hz` : ""}`;
  if (!emg) return;
  canvas.title = shown().length ? `${name(view.chosen)}: ±${((1e6 * emg[way()].scale[view.chosen] * 32767) / view.gain).toPrecision(3)} µV per row` : "";
}

function look(from, to) {
  const least = emg ? 8 / emg.rate : 0.01, span = Math.min(Math.max(to - from, least), last - first);
  const a = Math.min(Math.max(from, first), last - span);
  view.from = a; view.to = a + span;
  detail(); refresh();
}
const zoom = (factor, at = (view.from + view.to) / 2) => look(at - (at - view.from) * factor, at + (view.to - at) * factor);
const scroll = (part) => { const by = part * (view.to - view.from); look(view.from + by, view.to + by); };
function choose(k) { view.chosen = k; chosen(); refresh(); }
function chosen() {
  if (!emg) return;
  const k = view.chosen;
  $("chosen-title").textContent = `Channel ${label(k)}`;
  $("name").value = marks.names[label(k)] ?? "";
  $("name").placeholder = label(k);
  $("bad").checked = marks.bad.has(k);
}

function listed() {
  $("spans").replaceChildren(...marks.spans.map((one, i) => {
    const item = document.createElement("li");
    const go = Object.assign(document.createElement("button"), { type: "button", textContent: `${one.start.toFixed(3)} to ${one.stop.toFixed(3)} s, ${one.channel ?? "all channels"}` });
    go.addEventListener("click", () => { const pad = 0.5 * (one.stop - one.start); look(one.start - pad, one.stop + pad); });
    const drop = Object.assign(document.createElement("button"), { type: "button", textContent: "Remove" });
    drop.addEventListener("click", () => { keep(); marks.spans.splice(i, 1); listed(); refresh(); });
    item.append(go, drop);
    return item;
  }));
  chosen();
}
function span(start, stop, channel) {
  const a = Math.max(Math.min(start, stop), first), b = Math.min(Math.max(start, stop), last);
  if (!(b > a)) return;
  keep(); marks.spans.push({ start: a, stop: b, channel }); listed(); refresh();
}
function findings() {
  $("findings").replaceChildren(...(data.findings.length ? data.findings : [{ text: "none", verdict: "ok" }]).map((one) => {
    const item = Object.assign(document.createElement("li"), { className: one.verdict === "error" ? "error" : "" });
    const go = Object.assign(document.createElement("button"), { type: "button", textContent: `${one.name ? `${one.name}: ` : ""}${one.text}` });
    go.addEventListener("click", () => {
      const k = emg ? emg.labels.indexOf(one.name) : -1;
      if (k >= 0) choose(k);
      const m = markers ? markers.labels.indexOf(one.name) : -1;
      if (m >= 0) $("marker").selectedIndex = m;
      if (Number.isFinite(one.at)) { view.at = one.at; look(one.at - 0.5, one.at + 0.5); }
      refresh();
    });
    item.append(go);
    return item;
  }));
}

// The mapping file: names of channels, what is unusable.
const quoted = (text) => JSON.stringify(text);
function mapping() {
  const lines = [];
  const exact = (text) => data.exact[text] ?? text;
  const original = (text) => data.original[exact(text)] ?? exact(text);
  const given = (labels) => labels.some((text) => exact(text) in data.original);
  if (emg && (given(emg.labels) || emg.labels.some((text) => marks.names[text]))) { lines.push("[channels]"); for (const text of emg.labels) lines.push(`${quoted(original(text))} = ${quoted(marks.names[text] || exact(text))}`); lines.push(""); }
  if (markers && (given(markers.labels) || markers.labels.some((text) => marks.markerNames[text]))) { lines.push("[markers]"); for (const text of markers.labels) lines.push(`${quoted(original(text))} = ${quoted(marks.markerNames[text] || exact(text))}`); lines.push(""); }
  const known = data.unusable;
  const bad = [...known.channels, ...[...marks.bad].map((k) => original(label(k)))];
  if (bad.length || known.markers.length || marks.spans.length || known.spans.length) {
    lines.push("[unusable]");
    if (bad.length) lines.push(`channels = [${bad.map(quoted).join(", ")}]`);
    if (known.markers.length) lines.push(`markers = [${known.markers.map(quoted).join(", ")}]`);
    lines.push("");
    for (const span of known.spans) lines.push("[[unusable.spans]]", ...span, "");
    for (const one of marks.spans) {
      lines.push("[[unusable.spans]]", `start = ${one.start.toFixed(6)}  # s`, `stop = ${one.stop.toFixed(6)}  # s`);
      if (one.channel !== null) lines.push(`channels = [${quoted(original(one.channel))}]`);
      lines.push("");
    }
  }
  return lines.length ? [...data.prefix, ...lines].join("\n") : "";
}
async function save() {
  const text = mapping();
  if (!text) { say("Nothing has been named or marked."); return; }
  if (data.saves) {
    const answer = await fetch("mapping", { method: "POST", body: text }).then((one) => one.json()).catch(() => ({ why: "The program has ended or does not answer: nothing was saved." }));
    say(answer.why ?? `Wrote ${answer.wrote}.`);
    canvas.dataset.saved = answer.wrote ?? "";
    return;
  }
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob([text], { type: "application/toml" })), download: "mapping.toml" });
  link.click(); URL.revokeObjectURL(link.href);
  say("The mapping was passed to the browser as mapping.toml.");
}

function toggleBad() { if (!emg) return; keep(); const k = view.chosen; if (marks.bad.has(k)) marks.bad.delete(k); else marks.bad.add(k); chosen(); refresh(); }
function shift(by) {
  keep();
  const list = shown(), at = list.indexOf(view.chosen), other = list[at + by];
  if (at < 0 || other === undefined) { say("There is no shown channel to change places with."); return; }
  const a = marks.order.indexOf(view.chosen), b = marks.order.indexOf(other);
  [marks.order[a], marks.order[b]] = [marks.order[b], marks.order[a]];
  refresh();
}

function listen() {
  const on = (id, act, event = "click") => $(id).addEventListener(event, act);
  on("whole", () => look(first, last)); on("in", () => zoom(0.5)); on("out", () => zoom(2));
  on("back", () => scroll(-0.5)); on("forth", () => scroll(0.5));
  on("lower", () => { view.gain /= 1.5; refresh(); }); on("higher", () => { view.gain *= 1.5; refresh(); });
  for (const id of ["same", "rows", "name-markers", "marker"]) on(id, refresh, "change");
  on("filtered", () => { view.detail = null; detail(); refresh(); }, "change");
  on("find", () => { view.top = 0; const list = shown(); if (list.length && !list.includes(view.chosen)) view.chosen = list[0]; chosen(); refresh(); }, "input");
  on("bad", toggleBad, "change");
  on("up", () => shift(-1)); on("down", () => shift(1));
  on("hide", () => { keep(); marks.hidden.add(view.chosen); const list = shown(); if (list.length) view.chosen = list[0]; chosen(); refresh(); });
  on("show-all", () => { keep(); marks.hidden.clear(); refresh(); });
  on("name", () => { keep(); const text = $("name").value.trim(); if (text) marks.names[label(view.chosen)] = text; else delete marks.names[label(view.chosen)]; refresh(); }, "change");
  on("marker-name", () => { keep(); const text = $("marker-name").value.trim(), own = markers.labels[$("marker").selectedIndex]; if (text) marks.markerNames[own] = text; else delete marks.markerNames[own]; refresh(); }, "change");
  on("marker", () => { $("marker-name").value = marks.markerNames[markers.labels[$("marker").selectedIndex]] ?? ""; }, "change");
  on("span-one", () => span(view.from, view.to, label(view.chosen))); on("span-all", () => span(view.from, view.to, null));
  on("save", save); on("undo", undo);
  let grip = null;
  canvas.addEventListener("pointerdown", (event) => {
    const box = canvas.getBoundingClientRect(), x = event.clientX - box.left, list = rows();
    const k = list[Math.floor(((event.clientY - box.top) / box.height) * list.length)];
    if (k !== undefined && !event.shiftKey) choose(k);
    if (x < margin) return;
    grip = { x, from: view.from, to: view.to, mark: event.shiftKey, moved: false, k };
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!grip) return;
    const x = event.clientX - canvas.getBoundingClientRect().left;
    grip.moved = grip.moved || Math.abs(x - grip.x) > 3;
    if (grip.mark) { view.drag = [grip.x, x]; refresh(); return; }
    const by = ((grip.x - x) / (wide() - margin)) * (grip.to - grip.from);
    look(grip.from + by, grip.to + by);
  });
  canvas.addEventListener("pointerup", (event) => {
    if (!grip) return;
    const x = event.clientX - canvas.getBoundingClientRect().left;
    if (grip.mark) { view.drag = null; span(instant(grip.x), instant(x), null); } else if (!grip.moved) { view.at = Math.min(Math.max(instant(x), first), last); refresh(); }
    grip = null;
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const x = event.clientX - canvas.getBoundingClientRect().left;
    if (event.ctrlKey) zoom(Math.exp(0.002 * event.deltaY), instant(x));
    else if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) scroll(0.001 * (event.deltaX || event.deltaY));
    else if (Number($("rows").value)) { view.top += Math.sign(event.deltaY); refresh(); } else zoom(Math.exp(0.002 * event.deltaY), instant(x));
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const list = shown(), at = list.indexOf(view.chosen);
    const act = {
      ArrowLeft: () => scroll(-0.1), ArrowRight: () => scroll(0.1), PageUp: () => scroll(-1), PageDown: () => scroll(1),
      Home: () => look(first, first + view.to - view.from), End: () => look(last - (view.to - view.from), last),
      "+": () => zoom(0.7), "=": () => zoom(0.7), "-": () => zoom(1.4),
      ArrowUp: () => { if (at > 0) { choose(list[at - 1]); if (Number($("rows").value) && at - 1 < view.top) view.top = at - 1; } },
      ArrowDown: () => { if (at < list.length - 1) { choose(list[at + 1]); const most = Number($("rows").value); if (most && at + 1 >= view.top + most) view.top = at + 2 - most; } },
      b: toggleBad, B: toggleBad, h: () => $("hide").click(), u: undo, s: () => span(view.from, view.to, label(view.chosen)), " ": () => $("play").click(),
    }[event.key];
    if (act) { event.preventDefault(); act(); }
  });
  overview.addEventListener("pointerdown", (event) => { const t = first + (event.offsetX / overview.clientWidth) * (last - first), half = (view.to - view.from) / 2; look(t - half, t + half); });
  on("time", () => { view.at = first + (Number($("time").value) / 1000) * (last - first); if (view.at < view.from || view.at > view.to) { const half = (view.to - view.from) / 2; look(view.at - half, view.at + half); } refresh(); }, "input");
  let began = 0, from = 0;
  const step = (now) => {
    if (!view.playing) return;
    view.at = from + (Number($("speed").value) * (now - began)) / 1000;
    if (view.at >= last) { view.at = last; playing(false); }
    if (view.at > view.to) look(view.at, view.at + view.to - view.from);
    refresh();
    requestAnimationFrame(step);
  };
  const playing = (now) => { view.playing = now; $("play").setAttribute("aria-pressed", String(now)); $("play").textContent = now ? "Pause" : "Play"; };
  on("play", () => { playing(!view.playing); if (view.playing) { began = performance.now(); from = view.at >= last ? first : view.at; requestAnimationFrame(step); } });
  on("speed", () => { began = performance.now(); from = view.at; }, "change");
  const seen = new ResizeObserver((found) => { for (const one of found) measure(one.target); refresh(); });
  for (const one of document.querySelectorAll("canvas")) seen.observe(one);
}

async function begin() {
  if (emg) {
    source.raw = await levels(emg.raw, count);
    if (emg.filtered) source.filtered = await levels(emg.filtered, count);
    spectra = joined16(await bytes(emg.spectra.decibel));
    $("band").textContent = emg.filtered ? `band-pass ${emg.band[0]} to ${emg.band[1]} Hz` : "no band-pass";
    $("filtered").disabled = !emg.filtered;
    if (emg.unfiltered) $("filtered").title = emg.unfiltered;
  }
  if (markers) {
    points = joined(await bytes(markers.position));
    $("marker").replaceChildren(...markers.labels.map((text) => Object.assign(document.createElement("option"), { textContent: text })));
  }
  $("marker-names").replaceChildren(...data.names.marker.map((value) => Object.assign(document.createElement("option"), { value })));
  $("names").replaceChildren(...data.names.channel.map((value) => Object.assign(document.createElement("option"), { value })));
  for (const id of ["points", "curves"]) $(id).parentElement.hidden = !markers;
  $("spectrum").parentElement.hidden = !emg;
  listen(); listed(); findings(); drawAll();
  canvas.dataset.ready = "yes";
}
function joined16(raw) { return new Int16Array(raw.buffer, raw.byteOffset, raw.length / 2); }
begin();
