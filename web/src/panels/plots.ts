import uPlot from 'uplot';
import 'uplot/dist/uPlot.min.css';
import { element } from '../dom';
import { Envelope } from '../envelope';
import { norm } from '../format';
import type { Sample } from '../types';
import { Latencies } from './latencies';

interface Curve {
  name: string;
  color: string; // custom property of the style sheet
  width?: number;
}

interface Plot {
  title: string;
  curves: Curve[];
  values(sample: Sample): number[];
  floor: number; // the axis spans at least this much
}

const XYZ: Curve[] = [
  { name: 'x', color: '--x' },
  { name: 'y', color: '--y' },
  { name: 'z', color: '--z' },
];
const SIZE: Curve = { name: 'size', color: '--text', width: 1.75 };

/** Contact force and torque on the tool: present in every run, also without force on the hand. */
const PLOTS: Plot[] = [
  {
    title: 'Force on the tool, N',
    curves: [...XYZ, SIZE],
    values: ({ contact_force_x: x, contact_force_y: y, contact_force_z: z }) => [x, y, z, norm(x, y, z)],
    floor: 0.5,
  },
  {
    title: 'Torque on the tool, N mm',
    curves: [...XYZ, SIZE],
    values: (s) => {
      const [x, y, z] = [1000 * s.contact_torque_x, 1000 * s.contact_torque_y, 1000 * s.contact_torque_z];
      return [x, y, z, norm(x, y, z)];
    },
    floor: 5,
  },
  { title: 'Volume inside, cm³', curves: [{ name: '', color: '--accent' }], values: (s) => [1e6 * s.volume], floor: 0.1 },
  { title: 'Compute, µs', curves: [{ name: '', color: '--accent' }], values: (s) => [s.compute], floor: 10 },
];

/** Plots of the last ten seconds, and latency histograms. */
export class Plots {
  readonly root = element('section', 'plots');
  readonly latencies = new Latencies();
  private readonly parts = PLOTS.map((plot) => new LivePlot(plot));

  constructor() {
    this.root.setAttribute('aria-label', 'plots');
    this.root.append(...this.parts.map(({ root }) => root), this.latencies.root);
  }

  add(samples: Sample[]): void {
    for (const part of this.parts) part.add(samples);
  }

  clear(): void {
    for (const part of this.parts) part.clear();
  }

  draw(): void {
    for (const part of this.parts) part.draw();
  }

  /** Remakes the plots: each reads its colors from the style sheet when it is made. */
  restyle(): void {
    for (const part of this.parts) part.restyle();
    this.latencies.restyle();
  }
}

class LivePlot {
  readonly root = element('figure');
  private readonly area = element('div', 'area');
  private readonly envelope: Envelope;
  private chart: uPlot | null = null;
  private isNew = false;

  constructor(private readonly plot: Plot) {
    this.envelope = new Envelope(plot.curves.length);
    const names = plot.curves.filter(({ name }) => name).map(({ name, color }) => {
      const word = element('i', '', name);
      word.style.color = `var(${color})`;
      return word;
    });
    this.root.append(element('figcaption', '', plot.title, ...names), this.area);
    new ResizeObserver(() => this.resize()).observe(this.area);
  }

  add(samples: Sample[]): void {
    for (const sample of samples) this.envelope.add(sample.time, this.plot.values(sample));
    this.isNew ||= samples.length > 0;
  }

  clear(): void {
    this.envelope.clear();
    this.isNew = true;
  }

  draw(): void {
    if (!this.isNew || !this.chart || this.area.clientHeight === 0) return;
    this.isNew = false;
    this.chart.setData(this.envelope.data() as uPlot.AlignedData);
  }

  restyle(): void {
    this.chart?.destroy();
    this.chart = null;
    this.resize();
  }

  private resize(): void {
    const { clientWidth: width, clientHeight: height } = this.area;
    if (width < 40 || height < 30) return;
    if (this.chart) this.chart.setSize({ width, height });
    else this.chart = new uPlot(this.look(width, height), this.envelope.data() as uPlot.AlignedData, this.area);
    this.isNew = true;
  }

  private look(width: number, height: number): uPlot.Options {
    const style = getComputedStyle(document.documentElement);
    const color = (name: string) => style.getPropertyValue(name).trim();
    const axis: uPlot.Axis = {
      stroke: color('--quiet'),
      grid: { stroke: color('--line'), width: 1 },
      ticks: { show: false },
      font: '10px system-ui, sans-serif',
    };
    const { envelope, plot } = this;
    return {
      width, height,
      padding: [6, 6, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, range: () => [Math.max(envelope.firstTime, envelope.lastTime - envelope.seconds), envelope.lastTime + 1e-3] },
        y: { range: (_, low, high) => span(low, high, plot.floor) },
      },
      axes: [
        { ...axis, size: 18, space: 60, gap: 2, values: (_, ticks) => ticks.map((t) => (t < 0 ? '' : `${t} s`)) },
        { ...axis, size: (_, labels) => widthOf(labels), space: 26, gap: 3 },
      ],
      series: [{}, ...plot.curves.map((curve) => ({
        stroke: color(curve.color), width: curve.width ?? 1.25, points: { show: false }, gaps,
      }))],
    };
  }
}

/** Returns the axis width for the longest label, in pixels: a slow computer takes 40,000 microseconds. */
function widthOf(labels: string[] | null): number {
  return Math.max(34, 9 + 6 * Math.max(0, ...(labels ?? []).map((label) => label.length)));
}

const LONGEST_LINE = 0.5; // s: longer gaps in time are not bridged by a line

/** Returns start and end of each gap, in pixels. */
function gaps(chart: uPlot, _: number, first: number, last: number): [number, number][] {
  const times = chart.data[0], found: [number, number][] = [];
  const place = (time: number) => Math.round(chart.valToPos(time, 'x', true));
  for (let i = first + 1; i <= last; ++i) {
    if (times[i] - times[i - 1] > LONGEST_LINE) found.push([place(times[i - 1]), place(times[i])]);
  }
  return found;
}

/** Returns an axis range that holds zero, has headroom and spans at least `floor`. */
function span(low: number | null, high: number | null, floor: number): [number, number] {
  const below = Math.min(0, low ?? 0), above = Math.max(0, high ?? 0);
  const size = Math.max(floor, 1.08 * (above - below));
  return below === 0 ? [0, size] : [below - 0.04 * size, Math.max(above + 0.04 * size, below + size)];
}
