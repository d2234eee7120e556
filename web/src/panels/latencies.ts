import { element, write } from '../dom';
import { duration } from '../format';
import type { Stage } from '../types';

/** Common logarithmic time axis of all rows, so that they can be compared. */
const LEAST = 0.1, MOST = 1e6; // microseconds
const HEIGHT = 22; // CSS pixels

interface Row {
  root: HTMLElement;
  canvas: HTMLCanvasElement;
  numbers: HTMLElement;
}

/** Latency histogram of each stage of the loop, with marks at the median, 99 and 99.9 percent. */
export class Latencies {
  readonly root = element('figure', 'latencies');
  private readonly list = element('div', 'rows');
  private readonly rows = new Map<string, Row>();
  private stages: Stage[] = [];

  constructor() {
    this.root.append(
      element('figcaption', '', 'Stage times', element('i', '', 'p50 · p99 · p99.9')), this.list);
    this.root.hidden = true;
  }

  update(stages: Stage[] | undefined): void {
    this.stages = (stages ?? []).filter(({ num }) => num > 0);
    this.root.hidden = this.stages.length === 0;
    if (this.root.offsetParent === null) return; // not visible
    for (const stage of this.stages) this.show(stage);
  }

  restyle(): void {
    for (const stage of this.stages) this.show(stage);
  }

  private show(stage: Stage): void {
    const row = this.rows.get(stage.name) ?? this.add(stage.name);
    const quantiles = [stage.p50, stage.p99, stage.p999];
    write(row.numbers, quantiles.map(duration).join(' · '));
    row.root.title = `${stage.name}: ${stage.num} times, at most ${duration(stage.max)}`;
    paint(row.canvas, stage, quantiles);
  }

  private add(name: string): Row {
    const canvas = element('canvas'), numbers = element('span', 'number');
    const row = { root: element('div', 'row', element('span', 'name', name), numbers, canvas), canvas, numbers };
    this.rows.set(name, row);
    this.list.append(row.root);
    return row;
  }
}

function paint(canvas: HTMLCanvasElement, { histogram }: Stage, quantiles: number[]): void {
  const ratio = devicePixelRatio, width = canvas.clientWidth;
  canvas.width = Math.round(width * ratio);
  canvas.height = Math.round(HEIGHT * ratio);
  const context = canvas.getContext('2d')!;
  const style = getComputedStyle(canvas);
  const place = (time: number) => (width * Math.log(Math.max(time, LEAST) / LEAST)) / Math.log(MOST / LEAST);
  context.scale(ratio, ratio);

  // Logarithmic heights: rare slow cycles matter most and must be visible.
  const tallest = Math.log1p(Math.max(1, ...histogram.map(([, count]) => count)));
  context.fillStyle = style.getPropertyValue('--accent');
  histogram.forEach(([low, count], i) => {
    const left = place(low), right = Math.max(left + 1, place(histogram[i + 1]?.[0] ?? low * 1.1));
    const height = Math.max(1, (HEIGHT * Math.log1p(count)) / tallest);
    context.fillRect(left, HEIGHT - height, Math.min(right - left, 8), height);
  });
  context.fillStyle = style.getPropertyValue('--text');
  for (const time of quantiles) context.fillRect(Math.round(place(time)), 0, 1, HEIGHT);
}
