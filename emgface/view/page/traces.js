// Pixels of traces: the smallest and largest value of each column of a channel. Columns lie on a fixed
// grid of time, so that a scrolled view keeps its pixels and only new columns are drawn.
class Traces {
  constructor(gap) {
    this.gap = gap;
    this.width = this.height = this.count = 0;
    this.drawn = 0;  // columns drawn by the last call
  }

  // Size of the picture [pixels] and number of rows; true if they have changed.
  resize(pen, width, height, count) {
    if (width === this.width && height === this.height && count === this.count) return;
    Object.assign(this, { width, height, count, stale: true });
    this.image = pen.createImageData(Math.max(width, 1), Math.max(height, 1));
    this.pixels = new Uint32Array(this.image.data.buffer);
    this.edges = new Int32Array(width + 2);
    this.channel = new Int32Array(count);
    this.unit = new Float64Array(count);
    this.colour = new Uint32Array(count);
  }

  // Row r shows a channel with a height [pixels] of one unit of its values, and a colour.
  row(r, channel, unit, colour) {
    if (this.channel[r] === channel && this.unit[r] === unit && this.colour[r] === colour) return;
    this.channel[r] = channel; this.unit[r] = unit; this.colour[r] = colour;
    this.stale = true;
  }

  // Bins from a sample on, with `each` samples in a column.
  draw(bins, begin, each, paper) {
    const { width: w, pixels } = this;
    // A view that is only moved has the same scale but for rounding.
    if (Math.abs(each / this.each - 1) < 1e-9) each = this.each; else this.stale = true;
    if (bins !== this.bins || paper !== this.paper) this.stale = true;
    const from = Math.round(begin / each), by = from - this.from;
    let left = 0, right = w;
    if (!this.stale && Math.abs(by) < w) {
      // Pixels that the shift carries into the next line are among the columns drawn anew.
      if (by >= 0) { if (by) pixels.copyWithin(0, by); left = w - by; } else { pixels.copyWithin(-by, 0); right = -by; }
    }
    Object.assign(this, { bins, paper, each, from, stale: false, drawn: right - left });
    if (right === left) return;
    for (let y = 0; y < this.height; y++) pixels.fill(paper, y * w + left, y * w + right);
    const { edges } = this;
    for (let x = left - 1; x <= right; x++) edges[x - left + 1] = Math.floor(((from + x) * each - bins.offset) / bins.size);
    for (let r = 0; r < this.count; r++) this.line(r, left, right);
  }

  line(r, left, right) {
    const { width: w, pixels, edges, gap, bins: { n, low, high, size, offset }, from, each } = this;
    const rowHeight = this.height / this.count, middle = (r + 0.5) * rowHeight, unit = this.unit[r], colour = this.colour[r];
    const top = Math.max(Math.floor((r - 0.4) * rowHeight), 0), bottom = Math.min(Math.ceil((r + 1.4) * rowHeight), this.height) - 1;
    const first = this.channel[r] * n, between = size === 1 && each < 1;
    let before = NaN;
    // The column before the first is joined to it, but not drawn.
    for (let x = left - 1; x < right; x++) {
      const c = x - left + 1;
      let i = edges[c], end = Math.max(edges[c + 1], i + 1), least = 32767, most = -32768;
      for (i = Math.max(i, 0), end = Math.min(end, n); i < end; i++) {
        if (low[first + i] === gap) continue;
        if (low[first + i] < least) least = low[first + i];
        if (high[first + i] > most) most = high[first + i];
      }
      if (least > most) { before = NaN; continue; }
      // Between samples that are several columns apart, the line is straight.
      if (between && edges[c] + 1 < n && low[first + edges[c] + 1] !== gap) {
        const part = (from + x + 0.5) * each - offset - edges[c];
        least = most = least + Math.min(Math.max(part, 0), 1) * (low[first + edges[c] + 1] - least);
      }
      let y0 = middle - most * unit, y1 = middle - least * unit;
      const joined = (y0 + y1) / 2;
      if (before === before) { y0 = Math.min(y0, before); y1 = Math.max(y1, before); }
      before = joined;
      if (x < left) continue;
      y0 = Math.max(Math.round(y0), top); y1 = Math.min(Math.round(y1), bottom);
      for (let p = y0 * w + x, last = y1 * w + x; p <= last; p += w) pixels[p] = colour;
    }
  }
}
