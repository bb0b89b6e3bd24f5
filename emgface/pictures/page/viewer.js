// The page of stored motions: trials, strategies, time, and activations at an instant.
const state = { trial: null, frame: 0, playing: false };
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
  for (const kind of ["simulated", "measured"]) {
    const shown = $(kind).checked && motion[kind], n = data.markers.length;
    points[kind] = data.markers.map((_, m) => {
      const at = 3 * (frame * n + m);
      if (!shown || motion[kind][at] === data.absent) return null;
      return [0, 1, 2].map((c) => motion[kind][at + c] * MM);
    });
  }
  draw(points);
  canvas.dataset.frame = frame;
  $("clock").textContent = `${trial.time[frame].toFixed(2)} s`;
  $("time").value = frame;
  $("time").setAttribute("aria-valuetext", `${trial.time[frame].toFixed(2)} seconds`);
  if (motion.activation) data.muscles.forEach((muscle, k) => {
    const width = `${(motion.activation[frame * data.muscles.length + k] / 2.55).toFixed(1)}%`;
    bars[k].forEach((bar) => { bar.style.width = width; });
  });
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
    const name = put("b", "", stem);
    name.title = data.muscles.find((m) => m.id.startsWith(stem)).name;
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
  const advance = (now) => {
    if (!state.playing || !state.trial) return;
    const time = state.trial.time, last = time[time.length - 1];
    const at = from + (now - began) / 1000;
    if (at > last) { from = 0; began = now; state.frame = 0; }
    else state.frame = Math.max(0, time.findIndex((t) => t >= at));
    show();
    requestAnimationFrame(advance);
  };
  play.addEventListener("click", () => {
    set(!state.playing);
    if (state.playing) {
      began = performance.now();
      from = state.trial ? state.trial.time[state.frame] : 0;
      requestAnimationFrame(advance);
    }
  });
}

async function begin() {
  radios("strategy", data.strategies, (value) => value);
  radios("instruction", Object.keys(data.instructions), (value) => `${value}: ${data.instructions[value]}`);
  muscles();
  const stops = data.displacement.map((c) => `rgb(${c.map((x) => Math.round(255 * x)).join()})`);
  $("colours").style.background = `linear-gradient(90deg,${stops.join()})`;
  await unpack();
  const first = await decode(data.trials[0]);
  millimetres(first.skin, 0, start.length, start);
  prepare();
  listen();
  // What a page does not hold is not offered.
  document.querySelector(".activation").hidden = !data.muscles.length;
  document.querySelector(".time").hidden = data.trials[0].time.length < 2;
  displacement.parentElement.hidden = data.trials[0].time.length < 2;
  $("measured").parentElement.hidden = !data.trials.some((t) => t.measured);
  // The first strategy of the first instruction may have failed.
  document.querySelector(`input[name=strategy][value="${data.trials[0].strategy}"]`).checked = true;
  document.querySelector(`input[name=instruction][value="${data.trials[0].instruction}"]`).checked = true;
  await choose();
  canvas.dataset.ready = "yes";
}
begin();
