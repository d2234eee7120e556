// A plot of a report: dragging or pinching zooms, a double-click resets.

import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { button, element } from '../dom';
import { NOTHING } from './histogram';
import { ink, onInk, onPaper } from './ink';
import { short } from './numbers';
import { pinchToZoom } from './pinch';

export interface Line {
  name: string;
  color?: string; // of the style sheet; default: that of its index
  values: (number | null)[]; // one per `x`; null: a gap
  std?: (number | null)[]; // likewise: half the height of a band around it
  marks?: (i: number) => boolean; // True if value i has a mark
  joined?: boolean; // drawn across gaps
}

/** A line with its own x, in any order; values that are not finite are gaps. */
export interface Curve {
  name: string;
  color: string; // of the style sheet
  x: ArrayLike<number>;
  y: ArrayLike<number>;
  width?: number;
  dash?: number[];
  hasDots?: boolean;
}

export interface Plot {
  x: number[]; // ascending; with curves only: the ends of the axis
  lines: Line[];
  curves?: Curve[];
  xWords: string;
  yWords: string;
  xLogarithmic?: boolean; // requires x > 0
  yLogarithmic?: boolean;
  yFrom?: number; // start of the axis; default: zero or lower
  bars?: boolean; // each value holds from its x to the next
  strokes?: number[]; // short strokes at the top, at these x
  limit?: { value: number; words: string };
  markers?: { x: number; words: string }[]; // dashed, from top to bottom
  right?: { factor: number; words: string }; // a second axis: y times this
  together?: string; // plots with the same name zoom together
  onPoint?: (i: number | null) => void; // index of the x that a pointer is at
}

const COLORS = ['--series-1', '--series-2', '--series-3', '--series-4'];
const HEIGHT = 250;
const RIGHT_AXIS = 62; // CSS pixels, with its label
const PAPER_WIDTH = 680; // CSS pixels

/** Plots that are not visible yet are drawn only when they are about to be. */
const seen = new Map<Element, () => void>();
const watch = new IntersectionObserver((entries) => {
  for (const { target, isIntersecting } of entries) {
    if (!isIntersecting) continue;
    watch.unobserve(target);
    seen.get(target)?.();
    seen.delete(target);
  }
}, { rootMargin: '2000px' });

export function plot(spec: Plot, caption: string): HTMLElement {
  return new ZoomedPlot(spec, caption).root;
}

const groups = new Map<string, Set<ZoomedPlot>>();

class ZoomedPlot {
  readonly root = element('figure', 'plot');
  private readonly area = element('div', 'area');
  private readonly whole = button('whole', 'see all of it again', () => this.zoom(null), 'see all');
  private readonly peers: Set<ZoomedPlot>;
  private chart: uPlot | null = null;
  private range: [number, number] | null = null; // null: everything
  private isFollowing = false;
  private isNear = false;

  constructor(private readonly spec: Plot, caption: string) {
    this.whole.hidden = true;
    this.root.append(this.area, element('figcaption', '', caption), this.whole);
    const name = spec.together;
    this.peers = (name && groups.get(name)) || new Set();
    if (name) groups.set(name, this.peers);
    this.peers.add(this);
    seen.set(this.root, () => {
      this.isNear = true;
      this.fit();
    });
    watch.observe(this.root);
    new ResizeObserver(() => this.fit()).observe(this.area);
    onInk(() => this.restyle());
  }

  /** Index of the x whose values the legend has at rest: at the first marker, else in the middle; null: no x. */
  private get rest(): number | null {
    const { x, markers } = this.spec;
    if (x.length === 0) return null;
    const at = markers?.[0]?.x;
    if (at === undefined) return x.length >> 1;
    return x.reduce((best, value, i) => (Math.abs(value - at) < Math.abs(x[best] - at) ? i : best), 0);
  }

  private get width(): number {
    return onPaper() ? PAPER_WIDTH : this.area.clientWidth;
  }

  private fit(): void {
    if (this.width < 60) return;
    if (!this.chart) this.restyle();
    else if (this.chart.width !== this.width) this.chart.setSize({ width: this.width, height: HEIGHT });
  }

  /** Remakes the plot: its colors are read from the style sheet when it is made. */
  private restyle(): void {
    if (this.width < 60 || !(this.isNear || onPaper())) return;
    this.chart?.destroy();
    const { x, lines } = this.spec;
    this.chart = new uPlot(this.look(), [x, ...lines.map(({ values }) => values)] as uPlot.AlignedData, this.area);
    this.show();
  }

  private all(): [number, number] {
    const { x, bars } = this.spec;
    return [x[0], x[x.length - 1] > x[0] || bars ? x[x.length - 1] : x[0] + 1];
  }

  private show(): void {
    const [min, max] = this.range ?? this.all();
    this.isFollowing = true;
    this.chart?.batch(() => this.chart!.setScale('x', { min, max }));
    this.isFollowing = false;
    this.whole.hidden = this.range === null;
  }

  private zoom(range: [number, number] | null): void {
    const [first, last] = this.all();
    const isAll = !range || (range[0] <= first && range[1] >= last);
    for (const peer of this.peers) {
      peer.range = isAll ? null : [Math.max(first, range[0]), Math.min(last, range[1])];
      peer.show();
    }
  }

  /** Returns the smallest and the largest value. */
  private heights(): [number, number] {
    const { lines, curves, yLogarithmic } = this.spec;
    let low = Infinity, high = -Infinity;
    const add = (value: number) => {
      if (!Number.isFinite(value) || (yLogarithmic && value <= 0)) return;
      low = Math.min(low, value);
      high = Math.max(high, value);
    };
    for (const { values, std } of lines) {
      values.forEach((value, i) => {
        if (value === null || value === NOTHING) return;
        for (const side of std ? [-1, 1] : [0]) add(value + side * (std?.[i] ?? 0));
      });
    }
    for (const { x, y } of curves ?? []) for (let i = 0; i < y.length; ++i) if (Number.isFinite(x[i])) add(y[i]);
    return low <= high ? [low, high] : yLogarithmic ? [1, 10] : [0, 1];
  }

  /**
   * Returns the padding for the last label, of seven digits, or for the right axis of a plot that zooms
   * together with this one, so that their axes align.
   */
  private paddingRight(): number {
    const { right, xLogarithmic } = this.spec;
    if (right) return 0;
    return [...this.peers].some(({ spec }) => spec.right) ? RIGHT_AXIS : xLogarithmic ? 28 : 16;
  }

  private look(): uPlot.Options {
    const { spec } = this;
    const isNarrow = this.width < 520;
    const quiet = ink('--quiet');
    const axis: uPlot.Axis = {
      stroke: quiet, grid: { stroke: ink('--grid'), width: 1 }, ticks: { show: false },
      font: '11px system-ui, sans-serif', labelFont: '12px system-ui, sans-serif', labelGap: 0,
      values: (_, ticks) => ticks.map((tick) => (tick === null ? '' : short(tick))),
    };
    const [low, high] = this.heights();
    const factor = spec.right?.factor ?? 1;
    const axes: uPlot.Axis[] = [
      { ...axis, label: spec.xWords, labelSize: 18, size: 26, space: isNarrow ? 60 : 70,
        ...(spec.xLogarithmic ? { splits: decades } : {}) },
      { ...axis, label: spec.yWords, labelSize: 18, size: isNarrow ? 44 : 54, space: 32,
        ...(spec.yLogarithmic ? { splits: decades } : {}) },
    ];
    if (spec.right) {
      axes.push({
        ...axis, scale: 'right', side: 1, label: spec.right.words, labelSize: 18, size: RIGHT_AXIS - 18, space: 32,
        grid: { show: false },
      });
    }
    return {
      width: this.width, height: HEIGHT, axes,
      padding: [12, this.paddingRight(), 0, 0],
      legend: { show: !spec.curves && (spec.lines.length > 1 || !onPaper()), live: !onPaper(), markers: { width: 2 } },
      cursor: {
        drag: { x: true, y: false, dist: 6, setScale: false },
        // Linked plots share the cursor; drags and clicks stay with the plot, which then zooms all.
        ...(spec.together ? { sync: { key: spec.together, setSeries: false, filters: { pub: isPointing } } } : {}),
        points: { size: 6, fill: (_, i) => ink(spec.lines[i - 1]?.color ?? COLORS[(i - 1) % COLORS.length]) },
      },
      scales: {
        x: { time: false, distr: spec.xLogarithmic ? 3 : 1 },
        ...(spec.right ? { right: { from: 'y', range: (_, from, to) => [from * factor, to * factor] } } : {}),
        y: {
          distr: spec.yLogarithmic ? 3 : 1,
          range: spec.yLogarithmic ? () => [low / 1.3, high * 1.3] : () => span(low, high, spec.yFrom),
        },
      },
      series: [
        { label: spec.xWords, value: (_, value) => (value === null ? '–' : short(value, 6)) },
        ...spec.lines.map((line, i): uPlot.Series => {
          const color = ink(line.color ?? COLORS[i % COLORS.length]);
          return {
            label: line.name, stroke: color, width: 1.5,
            spanGaps: line.joined ?? false,
            points: { show: Boolean(line.marks), size: 6, fill: ink('--ground'), filter: (_, __, show) => (show ? marked(line) : null) },
            value: (_, value) => (value === null ? '–' : short(value === NOTHING ? 0 : value)),
            ...(spec.bars ? { paths: uPlot.paths.stepped!({ align: 1 }), fill: `${color}44` } : {}),
          };
        }),
      ],
      hooks: {
        setCursor: [(chart) => {
          const i = chart.cursor.idx ?? null;
          // Without a pointer the legend has the values at the first marker.
          if (i === null && this.rest !== null && chart.legend.idxs?.[0] !== this.rest) chart.setLegend({ idx: this.rest }, false);
          if (chart.cursor.event || i === null) spec.onPoint?.(i);
        }],
        draw: [(chart) => this.drawInside(chart)],
        setSelect: [(chart) => {
          const { left, width } = chart.select;
          if (width < 6) return;
          const range: [number, number] = [chart.posToVal(left, 'x'), chart.posToVal(left + width, 'x')];
          chart.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
          this.zoom(range);
        }],
        ready: [(chart) => {
          if (this.rest !== null) chart.setLegend({ idx: this.rest }, false);
          chart.over.addEventListener('dblclick', () => this.zoom(null));
          pinchToZoom(chart, (range) => this.zoom(range));
        }],
        // uPlot's own double-click sets the scale by itself.
        setScale: [(_, name) => { if (name === 'x' && !this.isFollowing) this.whole.hidden = this.range === null; }],
      },
    };
  }

  /** Draws over the axes, clipped to the plot. */
  private drawInside(chart: uPlot): void {
    const { ctx, bbox } = chart;
    ctx.save();
    ctx.beginPath();
    ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
    ctx.clip();
    this.drawBands(chart);
    this.drawCurves(chart);
    this.drawSigns(chart);
    ctx.restore();
  }

  /** Draws a band around each line that has one: a piece for each run of values without a gap. */
  private drawBands(chart: uPlot): void {
    const { ctx } = chart, { x, lines } = this.spec;
    lines.forEach(({ values, std, color }, n) => {
      if (!std) return;
      ctx.fillStyle = `${ink(color ?? COLORS[n % COLORS.length])}38`;
      const isKnown = (i: number) => values[i] !== null && std[i] !== null;
      for (let begin = 0, end = 0; begin < x.length; begin = end + 1) {
        for (end = begin; end < x.length && isKnown(end); ++end);
        ctx.beginPath();
        for (const side of [1, -1]) {
          for (let k = 0; k < end - begin; ++k) {
            const i = side > 0 ? begin + k : end - 1 - k;
            ctx.lineTo(chart.valToPos(x[i], 'x', true), chart.valToPos(values[i]! + side * std[i]!, 'y', true));
          }
        }
        ctx.fill();
      }
    });
  }

  private drawCurves(chart: uPlot): void {
    const { ctx } = chart;
    const size = devicePixelRatio;
    for (const { x, y, color, width, dash, hasDots } of this.spec.curves ?? []) {
      ctx.strokeStyle = ctx.fillStyle = ink(color);
      ctx.lineWidth = (width ?? 1.6) * size;
      ctx.setLineDash((dash ?? []).map((d) => d * size));
      // uPlot places values on logarithmic axes even if they are not positive.
      const has = (value: number, isLogarithmic?: boolean) => Number.isFinite(value) && (!isLogarithmic || value > 0);
      const at = (i: number): [number, number] | null =>
        has(x[i], this.spec.xLogarithmic) && has(y[i], this.spec.yLogarithmic) ?
          [chart.valToPos(x[i], 'x', true), chart.valToPos(y[i], 'y', true)] : null;
      ctx.beginPath();
      for (let i = 0, isDown = false; i < x.length; ++i) {
        const place = at(i);
        if (place) isDown ? ctx.lineTo(...place) : ctx.moveTo(...place);
        isDown = place !== null;
      }
      ctx.stroke();
      for (let i = 0; hasDots && i < x.length; ++i) {
        const place = at(i);
        if (!place) continue;
        ctx.beginPath();
        ctx.arc(...place, 2.8 * size, 0, 2 * Math.PI);
        ctx.fill();
      }
    }
  }

  /** Draws each stroke, or where they would be a comb only those that follow a gap. */
  private drawStrokes(
    chart: uPlot, line: (color: string, dash: number[], x1: number, y1: number, x2: number, y2: number) => void,
  ): void {
    const { strokes = [] } = this.spec, { top, left, width } = chart.bbox, size = devicePixelRatio;
    const shown = strokes.map((stroke) => chart.valToPos(stroke, 'x', true)).filter((x) => x >= left && x <= left + width);
    const steps = shown.slice(1).map((x, i) => x - shown[i]).sort((a, b) => a - b);
    const usual = steps[Math.floor(steps.length / 2)] ?? 0, isComb = usual < 12 * size && steps.length > 0;
    shown.forEach((x, i) => {
      const isLate = i > 0 && x - shown[i - 1] > 1.9 * usual;
      if (!isComb || isLate) line(isLate ? '--warning' : '--quiet', [], x, top, x, top + (isLate ? 12 : 6) * size);
    });
  }

  /** Draws strokes, limit and markers. */
  private drawSigns(chart: uPlot): void {
    const { spec } = this;
    const { ctx, bbox } = chart;
    const size = devicePixelRatio;
    ctx.font = `${11 * size}px system-ui, sans-serif`;
    const line = (color: string, dash: number[], x1: number, y1: number, x2: number, y2: number) => {
      ctx.strokeStyle = ink(color);
      ctx.lineWidth = size;
      ctx.setLineDash(dash.map((d) => d * size));
      ctx.beginPath();
      ctx.moveTo(x1, y1);
      ctx.lineTo(x2, y2);
      ctx.stroke();
    };
    const bottom = bbox.top + bbox.height;
    this.drawStrokes(chart, line);
    let row = 0;
    for (const { x: value, words } of spec.markers ?? []) {
      const x = chart.valToPos(value, 'x', true);
      line('--quiet', [2, 4], x, bbox.top, x, bottom);
      ctx.fillStyle = ink('--text');
      ctx.textAlign = x > bbox.left + 0.7 * bbox.width ? 'right' : 'left';
      ctx.fillText(words, x + (ctx.textAlign === 'right' ? -5 : 5) * size, bbox.top + (14 + 14 * row++) * size);
    }
    if (spec.limit) {
      const y = chart.valToPos(spec.limit.value, 'y', true);
      line('--warning', [7, 4], bbox.left, y, bbox.left + bbox.width, y);
      ctx.fillStyle = ink('--warning');
      ctx.textAlign = 'right';
      ctx.fillText(spec.limit.words, bbox.left + bbox.width - 6 * size, y - 4 * size);
    }
  }
}

const isPointing = (type: string) => type === 'mousemove' || type === 'mouseleave';

/**
 * Returns the ticks 1 to 9 of each power of ten. uPlot's own never end on an axis that begins shortly before
 * a power of ten, such as at 0.0096.
 */
function decades(_: uPlot, __: number, from: number, to: number): number[] {
  const made: number[] = [];
  for (let power = Math.floor(Math.log10(from)); power <= Math.log10(to); ++power) {
    for (let digit = 1; digit <= 9; ++digit) {
      const at = Number(`${digit}e${power}`);
      if (at >= from && at <= to) made.push(at);
    }
  }
  return made;
}

/** Returns the indices of values with a mark. */
function marked({ marks, values }: Line): number[] | null {
  return marks ? values.flatMap((value, i) => (value !== null && marks(i) ? [i] : [])) : null;
}

/** Returns an axis range that holds zero, with room at ends that are not zero. */
function span(low: number, high: number, from?: number): [number, number] {
  if (from !== undefined) return [from, high + 0.06 * (high - from)];
  const below = Math.min(0, low), above = Math.max(0, high);
  const room = 0.06 * (above - below || 1);
  return [below < 0 ? below - room : 0, above > 0 || below === 0 ? above + room : 0];
}
