// Faults in the layout of an open page, as a list of texts; the body of a function.
const faults = [], wide = document.documentElement;
if (wide.scrollWidth > window.innerWidth + 1) faults.push(`the page is ${wide.scrollWidth} wide`);
const seen = (e) => e.getClientRects().length && getComputedStyle(e).visibility !== "hidden";
const name = (e) => `${e.tagName.toLowerCase()}${e.id ? "#" + e.id : ""} "${e.textContent.trim().slice(0, 40)}"`;
const rolls = (e) => { for (let up = e; up; up = up.parentElement) {
  if (/auto|scroll/.test(getComputedStyle(up).overflowX)) return true; } return false; };
for (const e of document.querySelectorAll("body h1, body h2, body h3, body p, body button, body label, body th, body td, body dt, body dd, body legend, body figcaption")) {
  if (!seen(e)) continue;
  const style = getComputedStyle(e), box = e.getBoundingClientRect();
  if (style.overflowX === "hidden" && e.scrollWidth > e.clientWidth + 1 && style.display !== "inline") faults.push(`${name(e)} is cut`);
  if (style.overflowY === "hidden" && e.scrollHeight > e.clientHeight + 1 && style.display !== "inline") faults.push(`${name(e)} is cut below`);
  if (box.right > window.innerWidth + 1 && !rolls(e)) faults.push(`${name(e)} leaves the window`);
}
for (const svg of document.querySelectorAll("svg")) {
  const outer = svg.getBoundingClientRect();
  if (!outer.width) continue;
  for (const text of svg.querySelectorAll("text, g[id*='text_']")) {
    const box = text.getBoundingClientRect();
    if (!box.width) continue;
    if (box.left < outer.left - 2 || box.right > outer.right + 2 || box.top < outer.top - 2 || box.bottom > outer.bottom + 2)
      faults.push(`a text of a figure leaves it: ${text.id} ${text.textContent.trim().slice(0, 30)}`);
  }
}
// A short word on several lines is squeezed.
for (const e of document.querySelectorAll("body *")) {
  if (!seen(e) || e.closest("svg, canvas, noscript, option, textarea")) continue;
  for (const node of e.childNodes) {
    const word = node.nodeType === 3 && node.data.match(/[^\s/_-]{3,20}(?=[\s]|$)/);
    if (!word || /[\s\S]/.test(node.data.charAt(word.index - 1)) && !/\s/.test(node.data.charAt(word.index - 1))) continue;
    const range = document.createRange();
    range.setStart(node, word.index); range.setEnd(node, word.index + word[0].length);
    if (new Set([...range.getClientRects()].map((r) => Math.round(r.top))).size > 1) faults.push(`${name(e)} breaks "${word[0]}"`);
  }
}
const rgb = (text) => { const m = text.match(/[\d.]+/g).map(Number); return m.length > 3 ? m : [...m, 1]; };
const light = (c) => { const [r, g, b] = c.slice(0, 3).map((v) => (v /= 255) <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
  return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
const over = (top, below) => [0, 1, 2].map((k) => top[k] * top[3] + below[k] * (1 - top[3])).concat(1);
const behind = (e) => { const layers = [];
  for (let up = e; up; up = up.parentElement) {
    const s = getComputedStyle(up);
    if (s.backgroundImage !== "none") return null;
    const c = rgb(s.backgroundColor);
    layers.push(c);
    if (c[3] === 1) break;
  }
  let found = [255, 255, 255, 1];
  if (layers[layers.length - 1][3] < 1 && matchMedia("(prefers-color-scheme: dark)").matches) found = rgb(getComputedStyle(document.documentElement).backgroundColor);
  for (const c of layers.reverse()) found = over(c, found);
  return found; };
for (const e of document.querySelectorAll("body *")) {
  if (!seen(e) || e.closest("svg, canvas, noscript, option, :disabled") || ![...e.childNodes].some((n) => n.nodeType === 3 && n.data.trim())) continue;
  const below = behind(e);
  if (!below) continue;
  const ink = over(rgb(getComputedStyle(e).color), below), pair = [light(ink), light(below)].sort((a, b) => b - a);
  const contrast = (pair[0] + 0.05) / (pair[1] + 0.05);
  if (contrast < 3) faults.push(`${name(e)} has a contrast of ${contrast.toFixed(1)}`);
}
return [...new Set(faults)];
