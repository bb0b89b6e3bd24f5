// Picking: the node under the pointer, as lines that fit, treat and mappings accept.
const picks = { lists: {}, near: 18 };
const file = () => FILES[$("pick-kind").value], list = () => (picks.lists[file()] ??= []);
const FILES = { node: "picked.py", element: "picked.py", muscle: "plan.toml", wedge: "plan.toml", landmark: "landmarks.csv", electrode: "mapping.toml" };
const quoted = (text) => JSON.stringify(text).replaceAll("\u007f", "\\u007f");

// Nodes of the skin nearest to the pointer on the screen, of those near it the one in front.
function picked(x, y) {
  const width = canvas.clientWidth, height = canvas.clientHeight;
  const { frame, middle, half } = camera(width, height), scale = height / 2 / half;
  let best = -1, depth = -Infinity, least = picks.near;
  for (let i = 0; i < data.nodes; i++) {
    const at = [0, 1, 2].map((c) => position[3 * i + c] - middle[c]);
    const u = width / 2 + along(frame[0], ...at) * scale, v = height / 2 - along(frame[1], ...at) * scale;
    const away = Math.hypot(u - x, v - y), z = along(frame[2], ...at);
    if (away > picks.near) continue;
    // Of nodes at nearly one place of the screen, the nearer to the eye hides the others.
    const hides = z > depth + 4 && away < least + 6, same = z > depth - 4;
    if (best < 0 || hides || (same && away < least)) { best = i; depth = z; least = away; }
  }
  return best;
}
function screen(i) {
  const width = canvas.clientWidth, height = canvas.clientHeight;
  const { frame, middle, half } = camera(width, height), scale = height / 2 / half;
  const at = [0, 1, 2].map((c) => position[3 * i + c] - middle[c]);
  return [width / 2 + along(frame[0], ...at) * scale, height / 2 - along(frame[1], ...at) * scale];
}

const LINES = {
  node: (p, i) => `node = ${p.node[i]}  # at (${p.position[i].join(", ")}) mm: face["position"][${p.node[i]}]`,
  element: (p, i) => `element = ${p.element[i]}  # ${p.layer[i]} layer: face.isel(element=${p.element[i]})`,
  muscle: (p, i) => p.muscle[i] && `\n[[step]]\nkind = "change"\nmuscles = [${quoted(p.muscle[i])}]\nstrength = 0.5`,
  landmark: (p, i, name) => name && `${/[",\n]/.test(name) ? `"${name.replaceAll('"', '""')}"` : name},${p.position[i].join()}`,
  electrode: (p, i, name) => name && p.channel[i] && `${quoted(name)} = ${quoted(p.channel[i])}`,
  wedge: (p, i) => p.lip[i] && `\n[[step]]\nkind = "wedge"\nlip = "${p.lip[i]}"\nplace = ${p.place[i]}\nwidth = 10.0  # mm\nheight = 10.0  # mm`,
};
const HEADS = { landmark: "name,x_mm,y_mm,z_mm\n", electrode: "[channels]\n", muscle: "schema_version = 1\n", wedge: "schema_version = 1\n" };
const LACKS = { muscle: "No muscle lies here.", landmark: "A landmark needs a name.", electrode: "An electrode needs its label in the recording as a name, and a place over a muscle of the montage.", wedge: "This place is on no lip." };

function pick(i) {
  const kind = $("pick-kind").value, own = data.pick, name = $("pick-name").value.trim();
  const line = i >= 0 && LINES[kind](own, i, name);
  canvas.dataset.picked = i >= 0 ? own.node[i] : "";
  if (!line) { $("picked").textContent = i < 0 ? "No node of the skin is here." : LACKS[kind]; return; }
  // A landmark or electrode has one place; lines of other files are kept until their kind is chosen again.
  const same = ["landmark", "electrode"].includes(kind) ? list().findIndex((one) => one.name === name) : -1;
  if (same >= 0) list().splice(same, 1);
  list().push({ kind, name, line });
  $("picked").textContent = `Node ${own.node[i]}, element ${own.element[i]} (${own.layer[i]} layer)${own.muscle[i] ? `, ${own.muscle[i]}` : ""}${own.lip[i] ? `, ${own.lip[i]} lip` : ""}.`;
  written();
}
function written() {
  const [first] = list();
  $("pick-text").value = first ? (HEADS[first.kind] || "") + list().map((one) => one.line).join("\n") + "\n" : "";
  $("pick-save").textContent = first ? `Save ${FILES[first.kind]}` : "Save";
}

function picking() {
  let at = null;
  canvas.addEventListener("pointerdown", (event) => { at = [event.clientX, event.clientY]; });
  canvas.addEventListener("pointerup", (event) => {
    const box = canvas.getBoundingClientRect();
    if (at && Math.hypot(event.clientX - at[0], event.clientY - at[1]) < 4) pick(picked(event.clientX - box.left, event.clientY - box.top));
    at = null;
  });
  const typed = () => { const i = data.pick.node.indexOf(Number($("pick-node").value)); pick(i); };
  $("pick-add").addEventListener("click", typed);
  $("pick-node").addEventListener("keydown", (event) => { if (event.key === "Enter") typed(); });
  const none = () => { if (!list().length) $("picked").textContent = `Nothing has been picked for ${file()}.`; return !list().length; };
  $("pick-kind").addEventListener("change", written);
  $("pick-undo").addEventListener("click", () => { if (none()) return; list().pop(); written(); });
  $("pick-copy").addEventListener("click", async () => {
    $("pick-text").select();
    try { await navigator.clipboard.writeText($("pick-text").value); $("picked").textContent = "Copied."; }
    catch { document.execCommand("copy"); }
  });
  $("pick-save").addEventListener("click", () => {
    if (none()) return;
    const url = URL.createObjectURL(new Blob([$("pick-text").value], { type: "text/plain" }));
    Object.assign(document.createElement("a"), { href: url, download: file() }).click();
    URL.revokeObjectURL(url);
  });
  canvas.dataset.picks = "yes";
}
if (data.pick) picking();
