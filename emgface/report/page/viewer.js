// The moving face. Draws with WebGL, and on a plain canvas where there is none.
const data = JSON.parse(document.getElementById("motions").textContent);
const $ = (id) => document.getElementById(id);
const canvas = $("stage");

// Decoding: base 64, deflate, byte planes, differences in time.
async function bytes(text) {
  const raw = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
async function frames(text, count) {
  const packed = await bytes(text);
  const n = packed.length / 2;
  const values = new Int16Array(n);
  for (let i = 0; i < n; i++) values[i] = packed[i] | (packed[n + i] << 8);
  const size = n / count;
  for (let i = size; i < n; i++) values[i] += values[i - size];
  return values;
}
const MM = data.quantum * 1000;
function millimetres(values, from, size, into) {
  for (let i = 0; i < size; i++) into[i] = values[from + i] * MM;
}

const view = { yaw: 0, pitch: 0, zoom: 1 };
const VIEWS = { front: [0, 0], left: [-90, 0], right: [90, 0], oblique: [-35, 12] };
const state = { trial: null, frame: 0, playing: false };
const position = new Float32Array(3 * data.nodes);
const start = new Float32Array(3 * data.nodes);
const colour = new Float32Array(3 * data.nodes);
const SKIN = [0.91, 0.79, 0.71];
// Five stops of cividis.
const STOPS = [[0, 0.133, 0.306], [0.231, 0.286, 0.424], [0.486, 0.482, 0.471], [0.737, 0.682, 0.424], [0.992, 0.906, 0.216]];
function shade(x, out, at) {
  const t = Math.min(Math.max(x, 0), 1) * 4;
  const k = Math.min(Math.floor(t), 3);
  for (let c = 0; c < 3; c++) out[at + c] = STOPS[k][c] + (t - k) * (STOPS[k + 1][c] - STOPS[k][c]);
}

const decoded = new Map();
async function decode(trial) {
  if (!decoded.has(trial)) {
    const count = trial.time.length;
    const motion = {
      skin: await frames(trial.skin, count),
      simulated: await frames(trial.simulated, count),
      measured: await frames(trial.measured, count),
      activation: await bytes(trial.activation),
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

// Both ways of drawing share one orthographic camera. It looks at the lips, and takes in as much of the
// face as lets them be seen.
function extent() {
  let reach = 0;
  for (let i = 0; i < start.length; i++) reach = Math.max(reach, Math.abs(start[i]));
  return Math.min(1.16 * reach, 62);
}
let reach = 60;
const MIDDLE = data.lips;

// Two shapes, so that the markers differ without colour as well.
function mark(pen, kind, u, v, size, line) {
  pen.beginPath();
  if (kind === "simulated") {
    pen.arc(u, v, 0.8 * size, 0, 7);
    pen.fillStyle = "#0072b2"; pen.strokeStyle = "#ffffff"; pen.lineWidth = line;
    pen.fill(); pen.stroke();
    return;
  }
  pen.moveTo(u, v - size); pen.lineTo(u + size, v); pen.lineTo(u, v + size); pen.lineTo(u - size, v);
  pen.closePath();
  pen.strokeStyle = "#ffffff"; pen.lineWidth = 2.2 * line; pen.stroke();
  pen.strokeStyle = "#b84a00"; pen.lineWidth = 1.5 * line; pen.stroke();
}

function webgl(triangles) {
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, powerPreference: "low-power" });
  const scene = new THREE.Scene();
  const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 1, 2000);
  camera.up.set(0, 0, 1);
  scene.add(new THREE.HemisphereLight(0xffffff, 0x8c7468, 1.7));
  const lamp = new THREE.DirectionalLight(0xffffff, 1.7);
  scene.add(lamp);
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(position, 3));
  geometry.setAttribute("color", new THREE.BufferAttribute(colour, 3));
  geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
  const material = new THREE.MeshStandardMaterial({ vertexColors: true, roughness: 0.75, metalness: 0, side: THREE.DoubleSide });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.frustumCulled = false;
  scene.add(mesh);
  const markers = {};
  for (const kind of ["simulated", "measured"]) {
    const paint = new THREE.SpriteMaterial({ map: symbol(kind), depthTest: false, toneMapped: false });
    markers[kind] = data.markers.map(() => {
      // Markers lie on the skin: as bodies, half of each would drown in it.
      const one = new THREE.Sprite(paint);
      one.renderOrder = kind === "measured" ? 3 : 2;
      scene.add(one);
      return one;
    });
  }
  function symbol(kind) {
    const picture = Object.assign(document.createElement("canvas"), { width: 64, height: 64 });
    const pen = picture.getContext("2d");
    mark(pen, kind, 32, 32, 23, 5);
    const map = new THREE.CanvasTexture(picture);
    map.colorSpace = THREE.SRGBColorSpace;
    return map;
  }
  const linear = new THREE.Color();
  return (points) => {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    renderer.setSize(width, height, false);
    const half = reach / view.zoom, aspect = width / height;
    const across = aspect > 1 ? half * aspect : half, up = aspect > 1 ? half : half / aspect;
    Object.assign(camera, { left: -across, right: across, top: up, bottom: -up });
    camera.updateProjectionMatrix();
    const a = (view.yaw * Math.PI) / 180, b = (view.pitch * Math.PI) / 180;
    camera.position.set(500 * Math.sin(a) * Math.cos(b), 500 * Math.cos(a) * Math.cos(b), 500 * Math.sin(b));
    camera.lookAt(0, 0, 0);
    camera.position.set(camera.position.x + MIDDLE[0], camera.position.y + MIDDLE[1], camera.position.z + MIDDLE[2]);
    lamp.position.set(camera.position.x - 200 * Math.cos(a), camera.position.y + 200 * Math.sin(a), camera.position.z + 350);
    for (let i = 0; i < colour.length; i += 3) {
      linear.setRGB(colour[i], colour[i + 1], colour[i + 2], THREE.SRGBColorSpace);
      colour[i] = linear.r; colour[i + 1] = linear.g; colour[i + 2] = linear.b;
    }
    geometry.attributes.position.needsUpdate = true;
    geometry.attributes.color.needsUpdate = true;
    geometry.computeVertexNormals();
    const size = 0.065 * reach / Math.sqrt(view.zoom);
    for (const kind of Object.keys(markers)) {
      markers[kind].forEach((one, m) => {
        const at = points[kind][m];
        one.visible = Boolean(at);
        if (at) { one.position.set(...at); one.scale.setScalar(size); }
      });
    }
    renderer.render(scene, camera);
  };
}

function plain(triangles) {
  const pen = canvas.getContext("2d");
  const count = triangles.length / 3;
  const flat = new Float32Array(3 * data.nodes);
  return (points) => {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio; canvas.height = height * ratio;
    pen.setTransform(ratio, 0, 0, ratio, width * ratio / 2, height * ratio / 2);
    const scale = (Math.min(width, height) / 2) * (view.zoom / reach);
    const a = (view.yaw * Math.PI) / 180, b = (view.pitch * Math.PI) / 180;
    const ca = Math.cos(a), sa = Math.sin(a), cb = Math.cos(b), sb = Math.sin(b);
    const project = (right, front, top) => {
      const x = right - MIDDLE[0], y = front - MIDDLE[1], z = top - MIDDLE[2];
      const away = sa * x + ca * y;
      return [-(ca * x - sa * y) * scale, -(cb * z - sb * away) * scale, cb * away + sb * z];
    };
    for (let i = 0; i < flat.length; i += 3) {
      const [u, v, w] = project(position[i], position[i + 1], position[i + 2]);
      flat[i] = u; flat[i + 1] = v; flat[i + 2] = w;
    }
    const order = Array.from({ length: count }, (_, k) => k);
    const depth = order.map((k) => flat[3 * triangles[3 * k] + 2] + flat[3 * triangles[3 * k + 1] + 2] + flat[3 * triangles[3 * k + 2] + 2]);
    order.sort((p, q) => depth[p] - depth[q]);
    for (const k of order) {
      const [i, j, l] = [3 * triangles[3 * k], 3 * triangles[3 * k + 1], 3 * triangles[3 * k + 2]];
      const ux = flat[j] - flat[i], uy = flat[i + 1] - flat[j + 1], uz = (flat[j + 2] - flat[i + 2]) * scale;
      const vx = flat[l] - flat[i], vy = flat[i + 1] - flat[l + 1], vz = (flat[l + 2] - flat[i + 2]) * scale;
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      const length = Math.hypot(nx, ny, nz) || 1;
      const light = 0.45 + 0.55 * Math.max(0, Math.abs(0.8 * nz + 0.45 * ny - 0.3 * nx) / length);
      const paint = [0, 1, 2].map((c) => Math.round(255 * Math.min(1, light * (colour[i + c] + colour[j + c] + colour[l + c]) / 3)));
      pen.fillStyle = pen.strokeStyle = `rgb(${paint.join()})`;
      pen.beginPath();
      pen.moveTo(flat[i], flat[i + 1]); pen.lineTo(flat[j], flat[j + 1]); pen.lineTo(flat[l], flat[l + 1]);
      pen.closePath(); pen.fill(); pen.lineWidth = 0.7; pen.stroke();
    }
    for (const kind of ["simulated", "measured"]) {
      for (const at of points[kind]) {
        if (!at) continue;
        const [u, v] = project(...at);
        mark(pen, kind, u, v, 5, 1.2);
      }
    }
  };
}

function hasWebGL() {
  if (new URLSearchParams(location.search).has("plain")) return false;
  try {
    const probe = document.createElement("canvas").getContext("webgl2");
    if (!probe) return false;
    probe.getExtension("WEBGL_lose_context")?.loseContext();
    return true;
  } catch { return false; }
}

let draw = () => {};
let waiting = false;
function refresh() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; show(); });
}

function show() {
  if (!state.trial) return;
  const { trial, motion, frame } = state;
  const size = 3 * data.nodes;
  millimetres(motion.skin, frame * size, size, position);
  millimetres(motion.skin, 0, size, start);
  const coloured = $("displacement").checked;
  $("scale").hidden = !coloured;
  for (let i = 0; i < size; i += 3) {
    if (coloured) {
      const far = Math.hypot(position[i] - start[i], position[i + 1] - start[i + 1], position[i + 2] - start[i + 2]);
      shade(far / motion.most, colour, i);
    } else for (let c = 0; c < 3; c++) colour[i + c] = SKIN[c];
  }
  const points = {};
  for (const kind of ["simulated", "measured"]) {
    const shown = $(kind).checked, n = data.markers.length;
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
  data.muscles.forEach((muscle, k) => {
    bars[k].style.width = `${(motion.activation[frame * data.muscles.length + k] / 2.55).toFixed(1)}%`;
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
  const rho = trial.rho === null ? "undefined" : trial.rho.toFixed(2);
  const what = `Trial ${trial.label} under ${strategy} (${data.instructions[instruction]}), face ${data.face}: median rho ${rho}, sigma_max ${(trial.sigma_max / 1000).toFixed(0)} kPa.`;
  $("shown").textContent = `${what} Simulated motion, ${data.origin} recording.`;
  canvas.setAttribute("aria-label", `Simulated face. ${what}`);
  canvas.dataset.trial = `${trial.label} ${strategy}`;
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
}

const bars = [];
function muscles() {
  const place = $("muscles");
  const stems = [...new Set(data.muscles.map((m) => m.id.replace(/_[LR]$/, "")))];
  const put = (tag, name, text) => {
    const one = document.createElement(tag);
    one.className = name; one.textContent = text; place.append(one);
    return one;
  };
  // From the front the subject's right is on the left, as in the picture.
  put("span", "head", "right"); put("b", "head", ""); put("span", "head", "left");
  for (const stem of stems) {
    const make = (side) => {
      const at = data.muscles.findIndex((m) => m.id === `${stem}_${side}`);
      const bar = put("span", side === "R" ? "bar left" : "bar", "");
      if (at >= 0) bars[at] = bar.appendChild(document.createElement("i"));
    };
    make("R");
    const name = put("b", "", stem);
    name.title = data.muscles.find((m) => m.id.startsWith(stem)).name;
    make("L");
  }
}

function turn(yaw, pitch) {
  view.yaw = yaw;
  view.pitch = Math.min(Math.max(pitch, -80), 80);
  for (const button of document.querySelectorAll("[data-view]")) {
    const [y, p] = VIEWS[button.dataset.view];
    button.setAttribute("aria-pressed", String(Math.abs(y - view.yaw) < 1 && Math.abs(p - view.pitch) < 1));
  }
  refresh();
}

function listen() {
  $("time").addEventListener("input", () => { state.frame = Number($("time").value); refresh(); });
  for (const id of ["simulated", "measured", "displacement"]) $(id).addEventListener("change", refresh);
  for (const button of document.querySelectorAll("[data-view]")) {
    button.addEventListener("click", () => turn(...VIEWS[button.dataset.view]));
  }
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
  let grip = null;
  canvas.addEventListener("pointerdown", (event) => {
    grip = [event.clientX, event.clientY, view.yaw, view.pitch];
    canvas.setPointerCapture(event.pointerId);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (grip) turn(grip[2] - 0.5 * (event.clientX - grip[0]), grip[3] + 0.5 * (event.clientY - grip[1]));
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { grip = null; });
  canvas.addEventListener("wheel", (event) => {
    if (!event.ctrlKey) return;  // a page is scrolled by the wheel alone
    event.preventDefault();
    view.zoom = Math.min(Math.max(view.zoom * Math.exp(-0.01 * event.deltaY), 0.5), 6);
    refresh();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: [-8, 0], ArrowRight: [8, 0], ArrowUp: [0, 8], ArrowDown: [0, -8] }[event.key];
    if (step) { event.preventDefault(); turn(view.yaw + step[0], view.pitch + step[1]); }
    if (event.key === "+" || event.key === "-") {
      view.zoom = Math.min(Math.max(view.zoom * (event.key === "+" ? 1.15 : 0.87), 0.5), 6);
      refresh();
    }
  });
  new ResizeObserver(refresh).observe(canvas);
}

async function begin() {
  radios("strategy", data.strategies, (value) => value);
  radios("instruction", Object.keys(data.instructions), (value) => `${value}: ${data.instructions[value]}`);
  muscles();
  const triangles = new Uint32Array((await bytes(data.triangle)).buffer);
  const first = await decode(data.trials[0]);
  millimetres(first.skin, 0, start.length, start);
  reach = extent();
  let way = "canvas";
  if (hasWebGL()) {
    try { draw = webgl(triangles); way = "webgl"; } catch { way = "canvas"; }
  }
  if (way === "canvas") draw = plain(triangles);
  canvas.dataset.drawn = way;
  listen();
  // The first strategy of the first instruction may have failed.
  document.querySelector(`input[name=strategy][value="${data.trials[0].strategy}"]`).checked = true;
  document.querySelector(`input[name=instruction][value="${data.trials[0].instruction}"]`).checked = true;
  await choose();
  canvas.dataset.ready = "yes";
}
begin();
