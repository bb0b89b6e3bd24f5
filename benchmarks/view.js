// Bodies of functions that the page runs, each below a line with its name.

// drag
const [steps, done] = arguments;
const c = document.getElementById("curve"), stage = document.getElementById("stage");
c.setPointerCapture = () => {};
const b = () => c.getBoundingClientRect();
const fire = (name, x, y) => c.dispatchEvent(new PointerEvent(name, {pointerId: 1, buttons: 1,
  clientX: b().left + x, clientY: b().top + y}));
const until = (test) => new Promise((good) => {
  const look = () => (test() ? good() : requestAnimationFrame(look)); look(); });
const rows = [];
(async () => {
  for (const [muscle, x, from, to] of steps) {
    const select = document.getElementById("muscle");
    if (select.value !== muscle) {
      const before = stage.dataset.motion;
      select.value = muscle; select.dispatchEvent(new Event("change"));
      await until(() => stage.dataset.shown !== before && stage.dataset.way === "complete");
    }
    const at = (t) => 34 + t * (c.clientWidth - 42), y = (v) => 8 + (1 - v) * (c.clientHeight - 28);
    fire("pointerdown", at(x), y(from));
    const last = stage.dataset.motion, began = performance.now();
    fire("pointermove", at(x), y(to));
    await until(() => stage.dataset.motion !== last && stage.dataset.shown === stage.dataset.motion);
    const row = [performance.now() - began];
    for (const part of ["waited", "simulated", "scored", "total"]) row.push(Number(stage.dataset[part]));
    const preview = stage.dataset.motion, released = performance.now();
    fire("pointerup", at(x), y(to));
    await until(() => stage.dataset.motion !== preview && stage.dataset.shown === stage.dataset.motion);
    row.push(performance.now() - released);
    for (const part of ["waited", "simulated", "scored", "total"]) row.push(Number(stage.dataset[part]));
    rows.push(row);
  }
  done(rows);
})();

// moves
const [seconds, done] = arguments;
const slides = [...document.querySelectorAll("#grid input")], stage = document.getElementById("stage");
document.getElementById("linked").checked = false;
const reacted = []; let last = "";
const first = Number(stage.dataset.frames), end = performance.now() + 1e3 * seconds;
const timer = setInterval(() => {
  const one = slides[Math.floor(Math.random() * slides.length)];
  one.value = 0.3 * Math.random(); one.dispatchEvent(new Event("input"));
  if (stage.dataset.reacted !== last) { last = stage.dataset.reacted; reacted.push(Number(last)); }
  if (performance.now() < end) return;
  clearInterval(timer);
  done([Number(stage.dataset.frames) - first, reacted]);
}, 1e3 / 30);

// scroll
const [seconds, zoom, done] = arguments, c = document.getElementById("traces");
let n = 0; const began = performance.now();
const key = (n) => (zoom ? (n % 20 < 10 ? "-" : "+") : n % 200 < 100 ? "ArrowRight" : "ArrowLeft");
const step = (now) => {
  if (now - began > 1e3 * seconds) { done([n, now - began]); return; }
  c.dispatchEvent(new KeyboardEvent("keydown", {key: key(n)}));
  n++; requestAnimationFrame(step);
};
requestAnimationFrame(step);

// play
const [seconds, done] = arguments, stage = document.getElementById("stage");
let n = 0, last = stage.dataset.frame; const began = performance.now();
document.getElementById("play").click();
const look = (now) => {
  if (stage.dataset.frame !== last) { last = stage.dataset.frame; n++; }
  if (now - began > 1e3 * seconds) done([n, now - began]); else requestAnimationFrame(look);
};
requestAnimationFrame(look);

// turn
const [seconds, done] = arguments, stage = document.getElementById("stage");
let n = 0; const began = performance.now();
const step = (now) => {
  if (now - began > 1e3 * seconds) { done([n, now - began]); return; }
  stage.dispatchEvent(new KeyboardEvent("keydown", {key: n % 20 < 10 ? "ArrowLeft" : "ArrowRight"}));
  n++; requestAnimationFrame(step);
};
requestAnimationFrame(step);
