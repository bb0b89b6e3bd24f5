// The surface of a face or head: decoding, camera, light; drawn with WebGL, or on a plain canvas where
// there is none. A page appends its own script, which defines show(): it writes the positions and
// colours of an instant and calls draw(points).
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
const KINDS = ["simulated", "compared", "measured"];
function millimetres(values, from, size, into) {
  for (let i = 0; i < size; i++) into[i] = values[from + i] * MM;
}

// CRC-32 of the drawn nodes of the skin as multiples of the quantum, which tells instants apart.
canvas.checksum = () => {
  const whole = Int16Array.from(position.subarray(0, 3 * data.nodes), (x) => Math.round(x / MM));
  let sum = ~0;
  for (const byte of new Uint8Array(whole.buffer)) {
    sum ^= byte;
    for (let k = 0; k < 8; k++) sum = (sum >>> 1) ^ (sum & 1 ? 0xedb88320 : 0);
  }
  return ~sum >>> 0;
};

const view = { yaw: 0, pitch: 0, zoom: 1 };
const start = new Float32Array(3 * data.nodes);
// Nodes of muscles are coloured by the activation of their muscle, numbered from 1.
let fibre = null;
// All points: nodes of the skin, those between them, the dark behind the mouth, the teeth.
let rules, triangles, drawn, own, position, colour, normal, moved;
// Two faces on one page share their coordinates and are drawn side by side: -1 and 1 of every point.
let panel;

async function unpack() {
  rules = new Uint32Array((await bytes(data.rules)).buffer);
  if (data.fibre) fibre = await bytes(data.fibre);
  triangles = new Uint32Array((await bytes(data.triangle)).buffer);
  drawn = triangles.length;  // corners; a section draws only the first ones
  const teeth = new Int16Array((await bytes(data.teeth)).buffer);
  own = Float32Array.from(await bytes(data.colour), (c) => c / 255);
  position = new Float32Array(own.length);
  normal = new Float32Array(own.length);
  colour = own.slice();
  moved = new Float32Array(own.length / 3);
  panel = data.panels ? Float32Array.from(new Int8Array((await bytes(data.panels)).buffer)) : new Float32Array(own.length / 3);
  millimetres(teeth, 0, teeth.length, position.subarray(position.length - teeth.length));
}

// Each point between nodes is (9 b + 9 c - a - d) / 16 of four earlier ones.
function follow(values, width) {
  for (let k = 0, p = data.nodes * width; k < rules.length; k += 4, p += width) {
    const a = rules[k] * width, b = rules[k + 1] * width, c = rules[k + 2] * width, d = rules[k + 3] * width;
    for (let i = 0; i < width; i++) values[p + i] = (9 * (values[b + i] + values[c + i]) - values[a + i] - values[d + i]) / 16;
  }
}

// Mean normals of the triangles round each point, weighted by area; their length has no meaning.
function normals() {
  normal.fill(0);
  for (let t = 0; t < triangles.length; t += 3) {
    const i = 3 * triangles[t], j = 3 * triangles[t + 1], k = 3 * triangles[t + 2];
    const ux = position[j] - position[i], uy = position[j + 1] - position[i + 1], uz = position[j + 2] - position[i + 2];
    const vx = position[k] - position[i], vy = position[k + 1] - position[i + 1], vz = position[k + 2] - position[i + 2];
    const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
    for (const at of [i, j, k]) { normal[at] += nx; normal[at + 1] += ny; normal[at + 2] += nz; }
  }
}

function shade(x, out, at) {
  const last = data.displacement.length - 1, t = Math.min(Math.max(x, 0), 1) * last;
  const k = Math.min(Math.floor(t), last - 1);
  for (let c = 0; c < 3; c++) out[at + c] = data.displacement[k][c] + (t - k) * (data.displacement[k + 1][c] - data.displacement[k][c]);
}

// Both ways of drawing share one orthographic camera, its light and what it has in view: the face at
// rest, in the middle, at a scale at which it fits from every side.
function axes(yaw, pitch) {
  const a = (yaw * Math.PI) / 180, b = (pitch * Math.PI) / 180;
  const ca = Math.cos(a), sa = Math.sin(a), cb = Math.cos(b), sb = Math.sin(b);
  return [[-ca, sa, 0], [-sa * sb, -ca * sb, cb], [sa * cb, ca * cb, sb]];
}
function along(axis, x, y, z) { return axis[0] * x + axis[1] * y + axis[2] * z; }
function span(axis) {
  let low = Infinity, high = -Infinity;
  for (let i = 0; i < start.length; i += 3) {
    const at = along(axis, start[i], start[i + 1], start[i + 2]);
    low = Math.min(low, at); high = Math.max(high, at);
  }
  return [low, high];
}
function camera(width, height) {
  let half = 0, shift = 0;
  const seen = Object.values(data.views).map(([yaw, pitch]) => axes(yaw, pitch).map(span));
  if (data.panels) shift = 0.53 * Math.max(...seen.map(([right]) => right[1] - right[0]));
  for (const [right, up] of seen) {
    half = Math.max(half, 0.53 * (up[1] - up[0]), ((0.53 * (right[1] - right[0]) + shift) * height) / width);
  }
  const frame = axes(view.yaw, view.pitch);
  const [u, v, w] = frame.map((axis) => { const [low, high] = span(axis); return (low + high) / 2; });
  return { frame, middle: [0, 1, 2].map((k) => u * frame[0][k] + v * frame[1][k] + w * frame[2][k]), half: half / view.zoom, shift };
}
const unit = (v) => { const n = Math.hypot(...v); return v.map((x) => x / n); };
const SOURCE = unit(data.light.key_from);
const HALF = unit([SOURCE[0], SOURCE[1], SOURCE[2] + 1]);
function lit(c, nx, ny, nz, out) {
  const { ambient, sky, key, gloss, power, shadow } = data.light;
  const direct = Math.max(0, nx * SOURCE[0] + ny * SOURCE[1] + nz * SOURCE[2]);
  const bright = ambient + (sky * (1 + ny)) / 2 + key * direct;
  const shine = gloss * Math.max(0, nx * HALF[0] + ny * HALF[1] + nz * HALF[2]) ** power;
  for (let k = 0; k < 3; k++) out[k] = Math.min(1, Math.max(0, c[k] * (1 + shadow[k] * (1 - direct)) * bright + shine));
}

// Three shapes, so that the markers differ without colour as well.
function mark(pen, kind, u, v, size, line) {
  pen.beginPath();
  if (kind === "simulated") {
    pen.arc(u, v, 0.8 * size, 0, 7);
    pen.fillStyle = "#0072b2"; pen.strokeStyle = "#ffffff"; pen.lineWidth = line;
    pen.fill(); pen.stroke();
    return;
  }
  if (kind === "compared") {
    pen.beginPath(); pen.rect(u - 0.6 * size, v - 0.6 * size, 1.2 * size, 1.2 * size);
    pen.strokeStyle = "#ffffff"; pen.lineWidth = 2.2 * line; pen.stroke();
    pen.strokeStyle = "#00734f"; pen.lineWidth = 1.5 * line; pen.stroke();
    return;
  }
  pen.moveTo(u, v - size); pen.lineTo(u + size, v); pen.lineTo(u, v + size); pen.lineTo(u - size, v);
  pen.closePath();
  pen.strokeStyle = "#ffffff"; pen.lineWidth = 2.2 * line; pen.stroke();
  pen.strokeStyle = "#b84a00"; pen.lineWidth = 1.5 * line; pen.stroke();
}

const number = (x) => x.toFixed(6);
const vector = (v) => `vec3(${v.map(number).join()})`;
const VERTEX = `
  attribute float panel; uniform float shift; varying vec3 n; varying vec3 c;
  void main() {
    n = normalMatrix * normal; c = color;
    vec4 seen = modelViewMatrix * vec4(position, 1.0);
    seen.x += panel * shift;
    gl_Position = projectionMatrix * seen;
  }`;
const FRAGMENT = `
  varying vec3 n; varying vec3 c;
  void main() {
    vec3 m = gl_FrontFacing ? normalize(n) : -normalize(n);
    float direct = max(0.0, dot(m, ${vector(SOURCE)}));
    float bright = ${number(data.light.ambient)} + ${number(data.light.sky / 2)} * (1.0 + m.y) + ${number(data.light.key)} * direct;
    float shine = ${number(data.light.gloss)} * pow(max(0.0, dot(m, ${vector(HALF)})), ${number(data.light.power)});
    vec3 skin = c * (1.0 + ${vector(data.light.shadow)} * (1.0 - direct)) * bright + shine;
    gl_FragColor = vec4(gl_FrontFacing ? skin : mix(${vector(data.mouth)}, skin, ${number(data.light.inside)}), 1.0);
  }`;

function webgl() {
  // Where the processor draws, smooth edges and further pixels would double or quadruple its work.
  const fine = !emulated || asked.has("smooth");
  canvas.dataset.fine = fine;
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: fine, alpha: true, powerPreference: "low-power" });
  const scene = new THREE.Scene();
  const eye = new THREE.OrthographicCamera(-1, 1, 1, -1, 1, 2000);
  eye.up.set(0, 0, 1);
  const geometry = new THREE.BufferGeometry();
  for (const [name, values] of Object.entries({ position, normal, color: colour })) geometry.setAttribute(name, new THREE.BufferAttribute(values, 3));
  geometry.setAttribute("panel", new THREE.BufferAttribute(panel, 1));
  geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
  const material = new THREE.ShaderMaterial({ uniforms: { shift: { value: 0 } }, vertexShader: VERTEX, fragmentShader: FRAGMENT, vertexColors: true, side: THREE.DoubleSide });
  const mesh = new THREE.Mesh(geometry, material);
  mesh.frustumCulled = false;
  scene.add(mesh);
  const markers = {};
  for (const kind of KINDS) {
    const paint = new THREE.SpriteMaterial({ map: symbol(kind), depthTest: false, toneMapped: false });
    markers[kind] = data.markers.map(() => {
      // Markers lie on the skin: as bodies, half of each would drown in it.
      const one = new THREE.Sprite(paint);
      one.renderOrder = 2 + KINDS.indexOf(kind);
      scene.add(one);
      return one;
    });
  }
  function symbol(kind) {
    const picture = Object.assign(document.createElement("canvas"), { width: 64, height: 64 });
    const pen = picture.getContext("2d");
    mark(pen, kind, 32, 32, 23, 7);
    const map = new THREE.CanvasTexture(picture);
    map.colorSpace = THREE.SRGBColorSpace;
    return map;
  }
  return (points) => {
    const width = canvas.clientWidth, height = canvas.clientHeight;
    renderer.setPixelRatio(fine ? Math.min(window.devicePixelRatio || 1, 2) : 1);
    renderer.setSize(width, height, false);
    const { frame, middle, half, shift } = camera(width, height);
    material.uniforms.shift.value = shift;
    const across = (half * width) / height;
    Object.assign(eye, { left: -across, right: across, top: half, bottom: -half });
    eye.updateProjectionMatrix();
    eye.position.set(...middle.map((m, k) => m + 500 * frame[2][k]));
    eye.lookAt(...middle);
    normals();
    geometry.setDrawRange(0, drawn);
    for (const name of ["position", "normal", "color"]) geometry.attributes[name].needsUpdate = true;
    const size = (15 * half) / (height / 2);  // pixels
    for (const kind of Object.keys(markers)) {
      markers[kind].forEach((one, m) => {
        const at = points[kind]?.[m];
        one.visible = Boolean(at);
        const side = data.panels ? shift * data.sides[m] : 0;
        if (at) { one.position.set(...at.map((x, k) => x + side * frame[0][k])); one.scale.setScalar(size); }
      });
    }
    renderer.render(scene, eye);
  };
}

// Fills the pixels whose centres are in a triangle of three points [pixels], where it is nearer than
// what they show. A path of the canvas for each triangle takes a hundred times as long.
function fill(screen, i, j, l, paint) {
  const { at, width, height, pixels, depth } = screen;
  const ax = at[i], ay = at[i + 1], bx = at[j], by = at[j + 1], cx = at[l], cy = at[l + 1];
  const whole = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
  if (!whole) return;
  const left = Math.max(0, Math.ceil(Math.min(ax, bx, cx) - 0.5)), right = Math.min(width - 1, Math.floor(Math.max(ax, bx, cx) - 0.5));
  const top = Math.max(0, Math.ceil(Math.min(ay, by, cy) - 0.5)), bottom = Math.min(height - 1, Math.floor(Math.max(ay, by, cy) - 0.5));
  for (let row = top; row <= bottom; row++) {
    for (let column = left, y = row + 0.5; column <= right; column++) {
      const x = column + 0.5;
      const a = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / whole;
      const b = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / whole;
      if (a < -1e-6 || b < -1e-6 || a + b > 1 + 1e-6) continue;
      const near = a * at[i + 2] + b * at[j + 2] + (1 - a - b) * at[l + 2], pixel = row * width + column;
      if (near > depth[pixel]) { depth[pixel] = near; pixels[pixel] = paint; }
    }
  }
}

function plain() {
  const pen = canvas.getContext("2d");
  const at = new Float32Array(position.length), turned = new Float32Array(position.length);
  const paint = [0, 0, 0], mean = [0, 0, 0], n = [0, 0, 0];
  return (points) => {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    const { clientWidth, clientHeight } = canvas;
    const width = canvas.width = clientWidth * ratio, height = canvas.height = clientHeight * ratio;
    if (!canvas.width || !canvas.height) return;
    const { frame, middle, half, shift } = camera(clientWidth, clientHeight), scale = height / 2 / half;
    const project = (x, y, z, side, into, k) => {
      x -= middle[0]; y -= middle[1]; z -= middle[2];
      into[k] = width / 2 + (along(frame[0], x, y, z) + side * shift) * scale;
      into[k + 1] = height / 2 - along(frame[1], x, y, z) * scale;
      into[k + 2] = along(frame[2], x, y, z);
      return into;
    };
    normals();
    for (let i = 0; i < at.length; i += 3) {
      project(position[i], position[i + 1], position[i + 2], panel[i / 3], at, i);
      for (let k = 0; k < 3; k++) turned[i + k] = along(frame[k], normal[i], normal[i + 1], normal[i + 2]);
    }
    const picture = pen.createImageData(canvas.width, canvas.height), { data: content } = picture;
    const depth = new Float32Array(content.length / 4).fill(-Infinity);
    const screen = { at, width: canvas.width, height: canvas.height, pixels: new Uint32Array(content.buffer), depth };
    for (let k = 0; k < drawn; k += 3) {
      const i = 3 * triangles[k], j = 3 * triangles[k + 1], l = 3 * triangles[k + 2];
      const front = (at[j] - at[i]) * (at[l + 1] - at[i + 1]) - (at[j + 1] - at[i + 1]) * (at[l] - at[i]) < 0;
      for (let c = 0; c < 3; c++) {
        n[c] = (front ? 1 : -1) * (turned[i + c] + turned[j + c] + turned[l + c]);
        mean[c] = (colour[i + c] + colour[j + c] + colour[l + c]) / 3;
      }
      lit(mean, ...unit(n), paint);
      if (!front) for (let c = 0; c < 3; c++) paint[c] = data.mouth[c] + data.light.inside * (paint[c] - data.mouth[c]);
      const [red, green, blue] = paint.map((c) => Math.round(255 * c));
      fill(screen, i, j, l, (255 << 24) | (blue << 16) | (green << 8) | red);
    }
    pen.putImageData(picture, 0, 0);
    for (const kind of KINDS) {
      (points[kind] ?? []).forEach((point, m) => {
        if (!point) return;
        const [u, v] = project(...point, data.panels ? data.sides[m] : 0, [], 0);
        mark(pen, kind, u, v, 5 * ratio, 1.2 * ratio);
      });
    }
  };
}

const asked = new URLSearchParams(location.search);
let emulated = false;  // true if WebGL is a program without a graphics unit
function hasWebGL() {
  if (asked.has("plain")) return false;
  try {
    const probe = document.createElement("canvas").getContext("webgl2");
    if (!probe) return false;
    const named = probe.getExtension("WEBGL_debug_renderer_info");
    emulated = /swiftshader|llvmpipe|softpipe|software|basic render/i.test(probe.getParameter(named ? named.UNMASKED_RENDERER_WEBGL : probe.RENDERER));
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

function turn(yaw, pitch) {
  view.yaw = yaw;
  view.pitch = Math.min(Math.max(pitch, -80), 80);
  for (const button of document.querySelectorAll("[data-view]")) {
    const [y, p] = data.views[button.dataset.view];
    button.setAttribute("aria-pressed", String(Math.abs(y - view.yaw) < 1 && Math.abs(p - view.pitch) < 1));
  }
  refresh();
}

// Chooses the way of drawing, and lets the picture be turned by pointer and keys.
function prepare() {
  let way = "canvas";
  if (hasWebGL()) {
    try { draw = webgl(); way = "webgl"; } catch { way = "canvas"; }
  }
  if (way === "canvas") draw = plain();
  canvas.dataset.drawn = way;
  for (const button of document.querySelectorAll("[data-view]")) {
    button.addEventListener("click", () => turn(...data.views[button.dataset.view]));
  }
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
