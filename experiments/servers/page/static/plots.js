// Three plots of the last 20 s over arrival times, in bounded memory; they also move without new states.

/* global uPlot */
const SPAN_S = 20;
const MOST = 4000;
const GRID = "#263341";
const QUIET = "#98a8b8";
const BLUE = "#56b4e9";
const ORANGE = "#e69f00";
const PURPLE = "#cc79a7";

// Semi-axes of the 95 % region in standard deviations, in the plane and in space: roots of chi-square quantiles
export const WITHIN_95 = { 2: 2.4477, 3: 2.7955 };

export class Traces {
  constructor() {
    this.clear();
  }

  clear() {
    // times, sigma, 95 %, NIS, lower and upper end of its band, poke
    this.columns = [[], [], [], [], [], [], []];
  }

  take(state, dim, now, gapMs) {
    const [times] = this.columns;
    const at = now / 1000;
    if (times.length && 1000 * (at - times.at(-1)) > gapMs) this.push([times.at(-1) + 1e-3, ...Array(6).fill(null)]);
    const sigma = state.sigma_mm;
    const [low, high] = state.nis_band ?? [null, null];
    this.push([at, sigma, sigma === null ? null : WITHIN_95[dim] * sigma, state.nis, low, high, state.poked]);
  }

  push(row) {
    this.columns.forEach((column, k) => column.push(row[k]));
    const times = this.columns[0];
    let old = Math.max(0, times.length - MOST);
    while (times[old] < row[0] - SPAN_S - 1) old += 1;
    if (old > 0) this.columns.forEach((column) => column.splice(0, old));
  }

  // Columns of a plot, with times before now
  shown(now, ...which) {
    return [this.columns[0].map((t) => t - now / 1000), ...which.map((k) => this.columns[k])];
  }
}

export class Plots {
  constructor(traces) {
    this.traces = traces;
    const nis = { low: ORANGE, fill: "rgb(230 159 0 / .16)" };
    this.plots = [
      plot("plot-sigma", [1, 2], fromZero, [line(BLUE, 2), line(BLUE, 1, [5, 4])]),
      plot("plot-nis", [3, 4, 5], logarithmic, [line("#ffffff", 1.5), line(nis.low, 1), line(nis.low, 1)], nis.fill),
      plot("plot-poke", [6], [0, 1], [line(PURPLE, 2)]),
    ];
    for (const { chart, root } of this.plots) {
      new ResizeObserver(() => chart.setSize({ width: root.clientWidth, height: root.clientHeight })).observe(root);
    }
  }

  draw(now) {
    for (const { chart, which } of this.plots) {
      const [times, ...columns] = this.traces.shown(now, ...which);
      // A logarithmic axis has no zero
      const held = chart.scales.y.distr === 3 ? columns.map((c) => c.map((y) => (y === null ? null : Math.min(999, Math.max(0.101, y))))) : columns;
      chart.setData([times, ...held]);
    }
  }
}

const logarithmic = "logarithmic";

function fromZero(_chart, _low, high) {
  const step = 10 ** Math.floor(Math.log10(Math.max(high ?? 1, 1e-3)));
  return [0, Math.max(step * Math.ceil((1.05 * (high ?? 1)) / step), 1)];
}

function line(stroke, width, dash) {
  return { stroke, width, dash, points: { show: false }, spanGaps: false };
}

function plot(id, which, range, series, fill) {
  const root = document.getElementById(id);
  const axis = { stroke: QUIET, font: "11px system-ui, sans-serif", ticks: { show: false }, grid: { stroke: GRID, width: 1 } };
  const scale = range === logarithmic ? { distr: 3, range: (_chart, _low, high) => [0.1, high >= 100 ? 1000 : 100] } : { range };
  const options = {
    width: Math.max(root.clientWidth, 50),
    height: Math.max(root.clientHeight, 40),
    padding: [6, 16, 0, 0],
    legend: { show: false },
    cursor: { show: false },
    scales: { x: { time: false, range: [-SPAN_S, 0] }, y: scale },
    axes: [
      { ...axis, size: 18, gap: 2, values: (_chart, splits) => splits.map((t) => (t === 0 ? "now" : `${t} s`)) },
      { ...axis, size: 34, gap: 4, space: 22 },
    ],
    series: [{}, ...series],
    bands: fill ? [{ series: [3, 2], fill }] : [],
  };
  if (range === logarithmic) options.axes[1].splits = () => [0.1, 1, 10, 100, 1000];
  return { chart: new uPlot(options, which.reduce((data) => [...data, []], [[]]), root), which, root };
}
