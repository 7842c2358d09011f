"use strict";
// The plots: uPlot with the page's colours; made anew when the colours change.

const SERIES = 6;
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const seriesColour = (place) => colour(`--series-${(place % SERIES) + 1}`);

class Chart {
  // `options(width)` returns those of uPlot without size, `data()` its data; both are asked again when drawn anew.
  constructor(holder, height, options) {
    this.holder = holder;
    this.height = height;
    this.options = options;
    this.key = null;
    this.plot = null;
    this.data = null;
    new ResizeObserver(() => this.fit()).observe(holder);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw(this.key, this.data, true));
  }

  width() { return Math.max(200, this.holder.clientWidth); }

  tall() { return this.width() < 500 ? Math.round(this.height * 0.8) : this.height; }

  fit() {
    if (this.plot && Math.abs(this.plot.width - this.width()) > 1) this.plot.setSize({ width: this.width(), height: this.tall() });
  }

  draw(key, data, anew) {
    if (!data) return;
    this.data = data;
    if (!anew && this.plot && key === this.key) {
      this.plot.setData(data);
      return;
    }
    this.key = key;
    if (this.plot) this.plot.destroy();
    this.holder.textContent = "";
    this.plot = new uPlot({ width: this.width(), height: this.tall(), ...this.options(key) }, data, this.holder);
  }
}

function axis(label, extra) {
  return {
    label, labelSize: 18, labelFont: "12px system-ui, sans-serif", font: "12px system-ui, sans-serif", size: 34, gap: 4,
    stroke: colour("--quiet"), grid: { stroke: colour("--grid"), width: 1 }, ticks: { stroke: colour("--rule"), width: 1 }, ...extra,
  };
}

function zeroLine(plot) {
  const y = Math.round(plot.valToPos(0, "y", true));
  if (y < plot.bbox.top || y > plot.bbox.top + plot.bbox.height) return;
  plot.ctx.save();
  plot.ctx.strokeStyle = colour("--quiet");
  plot.ctx.lineWidth = 1;
  plot.ctx.beginPath();
  plot.ctx.moveTo(plot.bbox.left, y + 0.5);
  plot.ctx.lineTo(plot.bbox.left + plot.bbox.width, y + 0.5);
  plot.ctx.stroke();
  plot.ctx.restore();
}

const leftAxis = (label, extra) => axis(label, { size: 62, ...extra });

function marks(label, place, size, digits) {
  return {
    label, stroke: seriesColour(place), paths: () => null,
    points: { show: true, size, fill: seriesColour(place), stroke: seriesColour(place), width: 0 },
    value: (_, value) => (value === null || value === undefined ? "–" : signed(value, digits)),
  };
}

function line(label, place, digits, dash) {
  return {
    label, stroke: seriesColour(place), width: 1.25, dash, spanGaps: true, points: { show: false },
    value: (_, value) => (value === null || value === undefined ? "–" : signed(value, digits)),
  };
}
