// The page of stored motions: trials, strategies, time, and activations at an instant.
const state = { trial: null, other: null, frame: 0, playing: false };
const displacement = $("displacement");
const decoded = new Map();
async function decode(trial) {
  if (!decoded.has(trial)) {
    const count = trial.time.length;
    const motion = {
      skin: await frames(trial.skin, count),
      simulated: await frames(trial.simulated, count),
      measured: trial.measured ? await frames(trial.measured, count) : null,
      activation: trial.activation ? await bytes(trial.activation) : null,
      force: trial.forces ? new Float32Array((await bytes(trial.forces)).buffer) : null,
      most: 0,
    };
    const size = 3 * data.nodes;
    let most = 0;
    for (let f = 1; f < count; f++) {
      for (let i = 0; i < size; i += 3) {
        const j = f * size + i;
        const x = motion.skin[j] - motion.skin[i], y = motion.skin[j + 1] - motion.skin[i + 1], z = motion.skin[j + 2] - motion.skin[i + 2];
        most = Math.max(most, x * x + y * y + z * z);
      }
    }
    motion.most = Math.max(Math.sqrt(most) * MM, 1e-3);
    decoded.set(trial, motion);
  }
  return decoded.get(trial);
}

function show() {
  if (!state.trial) return;
  const { trial, motion, frame } = state;
  const size = 3 * data.nodes;
  millimetres(motion.skin, frame * size, size, position);
  follow(position, 3);
  $("scale").hidden = !displacement.checked;
  if (displacement.checked) {
    for (let i = 0; i < data.nodes; i++) {
      const k = frame * size + 3 * i;
      moved[i] = (Math.hypot(...[0, 1, 2].map((c) => motion.skin[k + c] - motion.skin[3 * i + c])) * MM) / motion.most;
    }
    follow(moved, 1);
    for (let i = 0; i < data.tissue; i++) shade(moved[i], colour, 3 * i);
  } else colour.set(own);
  if (fibre && motion.activation && !displacement.checked) {
    for (let i = 0; i < data.nodes; i++) {
      if (!fibre[i]) continue;
      // Small activations are visible by the square root.
      const a = Math.sqrt(motion.activation[frame * data.muscles.length + fibre[i] - 1] / 255);
      for (let c = 0; c < 3; c++) colour[3 * i + c] = (1 - a) * data.relaxed[c] + a * data.active[c];
    }
  }
  const points = {};
  for (const kind of ["simulated", "measured"]) points[kind] = $(kind).checked && motion[kind] ? markersAt(motion[kind], frame) : null;
  if (state.other && $("simulated").checked) points.compared = markersAt(state.other.motion.simulated, nearest(state.other.trial.time, trial.time[frame]));
  draw(points);
  tracks();
  canvas.dataset.frame = frame;
  $("clock").textContent = `${trial.time[frame].toFixed(2)} s`;
  $("time").value = frame;
  $("time").setAttribute("aria-valuetext", `${trial.time[frame].toFixed(2)} seconds`);
  if (motion.activation) data.muscles.forEach((muscle, k) => {
    const width = `${(motion.activation[frame * data.muscles.length + k] / 2.55).toFixed(1)}%`;
    bars[k].forEach((bar) => { bar.style.width = width; });
  });
}

function markersAt(values, frame) {
  return data.markers.map((_, m) => {
    const at = 3 * (frame * data.markers.length + m);
    return values[at] === data.absent ? null : [0, 1, 2].map((c) => values[at + c] * MM);
  });
}
function nearest(time, t) {
  const after = time.findIndex((x) => x >= t - 1e-9);
  return after < 0 ? time.length - 1 : after;
}

// Activations, and the displacement of a marker from the start [mm] or a force [N], over the time of the trial.
const plot = $("tracks");
function moves(values, count, m) {
  const n = data.markers.length, start = 3 * m, distance = new Float32Array(count);
  for (let f = 0; f < count; f++) {
    const at = 3 * (f * n + m);
    distance[f] = values[at] === data.absent || values[start] === data.absent ? NaN : Math.hypot(...[0, 1, 2].map((c) => values[at + c] - values[start + c])) * MM;
  }
  return distance;
}
// Force [N] of every instant, which a motion without forces lacks.
function forces(values, count, f) {
  return Float32Array.from({ length: count }, (_, k) => (values ? values[k * data.forces.length + f] : NaN));
}
function tracks() {
  const { trial, motion, frame } = state, count = trial.time.length;
  if (count < 2) return;
  const ratio = Math.min(window.devicePixelRatio || 1, 2), w = plot.clientWidth, h = plot.clientHeight;
  if (!w) return;
  plot.width = w * ratio; plot.height = h * ratio;
  const pen = plot.getContext("2d"), left = 38, end = trial.time[count - 1] - trial.time[0];
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.font = "11px system-ui, sans-serif";
  const x = (t) => left + ((t - trial.time[0]) / end) * (w - left - 8);
  const top = motion.activation ? h * 0.48 : 4;
  const line = (time, values, from, most, y0, y1, stroke, dash, width) => {
    pen.strokeStyle = stroke; pen.lineWidth = width; pen.setLineDash(dash); pen.beginPath();
    let open = false;
    for (let f = 0; f < time.length; f++) { const v = values(f); if (!(v === v)) { open = false; continue; } const y = y1 - ((v - from) / most) * (y1 - y0); if (open) pen.lineTo(x(time[f]), y); else pen.moveTo(x(time[f]), y); open = true; }
    pen.stroke(); pen.setLineDash([]);
  };
  const look = getComputedStyle(plot), colour = (name) => look.getPropertyValue(name);
  pen.fillStyle = colour("--soft");
  if (motion.activation) {
    const n = data.muscles.length;
    data.muscles.forEach((m, k) => line(trial.time, (f) => motion.activation[f * n + k] / 255, 0, 1, 6, top - 8, m.id === state.muscle ? colour("--blue") : colour("--faint"), m.id.endsWith("_R") ? [3, 2] : [], m.id === state.muscle ? 2.2 : 1));
    pen.fillText("1", 28, 12); pen.fillText("0", 28, top - 6);
    const named = data.muscles.find((m) => m.id === state.muscle);
    pen.fillText(named ? `${named.name}, ${named.id}` : "activations, right dashed", left + 4, 12);
  }
  const m = Math.max($("track").selectedIndex, 0), f = m - data.markers.length, force = f >= 0;
  const tracked = (one, times) => (force ? forces(one.force, times.length, f) : moves(one.simulated, times.length, m));
  const own = tracked(motion, trial.time), measured = motion.measured && !force ? moves(motion.measured, count, m) : null;
  const other = state.other ? tracked(state.other.motion, state.other.trial.time) : null;
  let most = force ? 1e-3 : 0.1;
  for (const all of [own, measured, other]) if (all) for (const v of all) if (v > most) most = v;
  line(trial.time, (f) => own[f], 0, most, top + 4, h - 16, colour("--blue"), [], 2);
  if (measured) line(trial.time, (f) => measured[f], 0, most, top + 4, h - 16, colour("--orange"), [5, 3], 1.6);
  if (other) line(state.other.trial.time, (f) => other[f], 0, most, top + 4, h - 16, colour("--green"), [2, 2], 1.6);
  pen.fillText(most.toFixed(most < 1 ? 3 : 1), 2, top + 12); pen.fillText(force ? "N" : "mm", 4, top + 24); pen.fillText("0", 28, h - 15);
  const value = (v) => (v === v ? v.toFixed(most < 1 ? 3 : 2) + (force ? " N" : " mm") : "not available");
  $("reading").textContent = value(own[frame]) + (measured ? `, measured ${value(measured[frame])}` : "") + (other ? `, compared ${value(other[nearest(state.other.trial.time, trial.time[frame])])}` : "");
  for (let k = 0; k <= 4; k++) { const t = trial.time[0] + (k / 4) * end; pen.fillText(`${t.toFixed(2)} s`, Math.min(x(t), w - 40), h - 3); }
  pen.strokeStyle = colour("--ink"); pen.lineWidth = 1; pen.beginPath(); pen.moveTo(x(trial.time[frame]), 0); pen.lineTo(x(trial.time[frame]), h - 14); pen.stroke();
  plot.setAttribute("aria-valuemax", trial.time[count - 1].toFixed(2));
  plot.setAttribute("aria-valuenow", trial.time[frame].toFixed(2));
}

// Another trial of the same instruction, or any other of a page with one instruction.
async function compare() {
  const value = $("compare").value;
  const trial = value === "" ? null : data.trials[Number(value)];
  state.other = trial ? { trial, motion: await decode(trial) } : null;
  canvas.dataset.compared = trial ? `${trial.label} ${trial.strategy}` : "";
  refresh();
}
function offerComparison() {
  const others = data.trials.map((t, k) => [t, k]).filter(([t]) => t !== state.trial && t.instruction === state.trial.instruction);
  $("compare").replaceChildren(new Option("nothing", ""), ...others.map(([t, k]) => new Option(t.strategy || t.label, k)));
  $("compared").hidden = !others.length;
  state.other = null;
  canvas.dataset.compared = "";
}

async function choose() {
  const instruction = document.querySelector("input[name=instruction]:checked").value;
  const strategy = document.querySelector("input[name=strategy]:checked").value;
  const trial = data.trials.find((t) => t.instruction === instruction && t.strategy === strategy);
  if (!trial) {
    $("shown").textContent = `There is no simulation of instruction ${instruction} under ${strategy}: the trial failed.`;
    return;
  }
  const motion = await decode(trial);
  const before = state.trial ? state.trial.time[state.frame] : 0;
  state.trial = trial;
  state.motion = motion;
  state.frame = Math.max(0, trial.time.findIndex((t) => t >= before - 1e-6));
  $("time").max = trial.time.length - 1;
  $("most").textContent = motion.most.toFixed(1);
  $("shown").textContent = trial.about;
  canvas.setAttribute("aria-label", `Simulated ${data.what || "face"}. ${trial.about}`);
  canvas.dataset.trial = `${trial.label} ${trial.strategy}`;
  offerComparison();
  refresh();
}

function radios(name, values, words) {
  const place = $(name === "strategy" ? "strategies" : "instructions");
  values.forEach((value, k) => {
    const label = document.createElement("label");
    const input = Object.assign(document.createElement("input"), { type: "radio", name, value, checked: k === 0 });
    input.addEventListener("change", choose);
    label.append(input, words(value));
    place.append(label);
  });
  place.parentElement.hidden = values.length < 2;
}

const bars = data.muscles.map(() => []);  // a muscle without sides has two
function muscles() {
  const place = $("muscles");
  const stems = [...new Set(data.muscles.map((m) => m.id.replace(/_[LR]$/, "")))];
  const put = (tag, name, text) => {
    const one = document.createElement(tag);
    one.className = name; one.textContent = text; place.append(one);
    return one;
  };
  $("scaling").textContent = data.scaling || "";
  $("scaling").hidden = !data.scaling;
  // From the front the subject's right is on the left, as in the picture.
  put("span", "head", "right"); put("b", "head", ""); put("span", "head", "left");
  for (const stem of stems) {
    const make = (side) => {
      const at = data.muscles.findIndex((m) => m.id === stem || m.id === `${stem}_${side}`);
      const bar = put("span", side === "R" ? "bar left" : "bar", "");
      if (at >= 0) bars[at].push(bar.appendChild(document.createElement("i")));
    };
    make("R");
    const one = data.muscles.find((m) => m.id === stem || m.id.startsWith(`${stem}_`));
    const name = put("b", "", one.name);
    name.title = stem;
    name.addEventListener("click", () => { state.muscle = state.muscle === one.id ? null : one.id; refresh(); });
    make("L");
  }
}

function listen() {
  $("time").addEventListener("input", () => { state.frame = Number($("time").value); refresh(); });
  for (const id of ["simulated", "measured", "displacement"]) $(id).addEventListener("change", refresh);
  const play = $("play");
  const set = (playing) => {
    state.playing = playing;
    play.setAttribute("aria-pressed", String(playing));
    play.textContent = playing ? "Pause" : "Play";
  };
  let began = 0, from = 0;
  const speed = () => Number($("speed").value);
  const advance = (now) => {
    if (!state.playing || !state.trial) return;
    const time = state.trial.time, last = time[time.length - 1];
    const at = from + (speed() * (now - began)) / 1000;
    if (at > last && !$("loop").checked) { state.frame = time.length - 1; set(false); show(); return; }
    if (at > last) { from = 0; began = now; state.frame = 0; }
    else state.frame = Math.max(0, time.findIndex((t) => t >= at));
    show();
    requestAnimationFrame(advance);
  };
  const toggle = () => {
    set(!state.playing);
    if (state.playing) {
      const time = state.trial ? state.trial.time : [0];
      began = performance.now();
      from = state.frame === time.length - 1 ? 0 : time[state.frame];
      requestAnimationFrame(advance);
    }
  };
  play.addEventListener("click", toggle);
  $("speed").addEventListener("change", () => { began = performance.now(); from = state.trial ? state.trial.time[state.frame] : 0; });
  const goto = (frame) => { if (state.trial) { set(false); state.frame = Math.min(Math.max(frame, 0), state.trial.time.length - 1); refresh(); } };
  const pointed = (event) => {
    const time = state.trial.time, part = (event.offsetX - 38) / (plot.clientWidth - 46);
    goto(nearest(time, time[0] + part * (time[time.length - 1] - time[0])));
  };
  plot.addEventListener("pointerdown", (event) => { plot.setPointerCapture?.(event.pointerId); pointed(event); });
  plot.addEventListener("pointermove", (event) => { if (event.buttons) pointed(event); });
  const keys = { " ": toggle, ",": () => goto(state.frame - 1), ".": () => goto(state.frame + 1), Home: () => goto(0), End: () => goto(Infinity) };
  for (const one of [canvas, plot]) one.addEventListener("keydown", (event) => {
    const own = one === plot ? { ...keys, ArrowLeft: keys[","], ArrowRight: keys["."] } : keys;
    if (own[event.key]) { event.preventDefault(); own[event.key](); }
  });
  $("section").addEventListener("change", () => { drawn = $("section").checked ? 3 * data.section : triangles.length; refresh(); });
  $("compare").addEventListener("change", compare);
  $("track").addEventListener("change", refresh);
}

async function begin() {
  radios("strategy", data.strategies, (value) => value);
  radios("instruction", Object.keys(data.instructions), (value) => [value, data.instructions[value]].filter(Boolean).join(": "));
  muscles();
  const stops = data.displacement.map((c) => `rgb(${c.map((x) => Math.round(255 * x)).join()})`);
  $("colours").style.background = `linear-gradient(90deg,${stops.join()})`;
  await unpack();
  const first = await decode(data.trials[0]);
  millimetres(first.skin, 0, start.length, start);
  prepare();
  listen();
  $("track").replaceChildren(...data.markers.map((name) => new Option(name.replaceAll("_", " "), name)),
    ...(data.forces || []).map((one) => new Option(`force of ${one.name}${{ _L: ", left", _R: ", right" }[one.id.slice(-2)] || ""}`, `force ${one.id}`)));
  // What a page does not hold is not offered.
  document.querySelector(".activation").hidden = !data.muscles.length;
  const still = data.trials[0].time.length < 2;
  for (const one of [document.querySelector(".time"), plot, $("tracked")]) one.hidden = still;
  displacement.parentElement.hidden = data.trials[0].time.length < 2;
  $("section").parentElement.hidden = !data.section;
  $("measured").parentElement.hidden = !data.trials.some((t) => t.measured);
  // The first strategy of the first instruction may have failed.
  document.querySelector(`input[name=strategy][value="${data.trials[0].strategy}"]`).checked = true;
  document.querySelector(`input[name=instruction][value="${data.trials[0].instruction}"]`).checked = true;
  await choose();
  canvas.dataset.ready = "yes";
}
begin();
