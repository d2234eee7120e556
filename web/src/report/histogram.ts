// Histograms, as a bar plot.

import type { Plot } from './plot';

const NUM_BINS = 48;
/** Stands for a share of zero on a logarithmic axis. */
export const NOTHING = 1e-9;

/**
 * Bins ascending values, in percent of all. `isEven`: bins of equal width from zero on, both axes linear; else
 * bins of equal ratio, both axes logarithmic, so that rare values stay visible.
 */
export function histogram(values: number[], isEven: boolean): Pick<Plot, 'x' | 'lines' | 'bars' | 'xLogarithmic' | 'yLogarithmic'> {
  const largest = values[values.length - 1];
  const low = isEven ? 0 : Math.log(values[0]);
  const high = Math.max(isEven ? largest : Math.log(largest), low + 1e-6);
  const x = Array.from({ length: NUM_BINS + 1 }, (_, i) => {
    const at = low + ((high - low) * i) / NUM_BINS;
    return isEven ? at : Math.exp(at);
  });
  const shares = new Array<number>(NUM_BINS + 1).fill(0);
  for (const value of values) {
    const at = ((isEven ? value : Math.log(value)) - low) / (high - low);
    shares[Math.min(NUM_BINS - 1, Math.max(0, Math.floor(at * NUM_BINS)))] += 100 / values.length;
  }
  return bars(x, shares, !isEven);
}

/** Histogram of whole numbers with their counts; one bin each, above 15 bins of a tenth of the number. */
export function wholeNumbers(counts: [value: number, count: number][]): ReturnType<typeof histogram> {
  const num = counts.reduce((sum, [, count]) => sum + count, 0);
  const x = [Math.max(0.5, counts[0][0] - 0.5)], shares: number[] = [];
  const last = counts[counts.length - 1][0];
  while (x[x.length - 1] <= last) {
    const from = x[x.length - 1], to = Math.floor(Math.max(from + 1, 1.1 * from)) + 0.5;
    const inside = counts.filter(([value]) => Math.max(value, 0.5) >= from && value < to);
    shares.push((100 * inside.reduce((sum, [, count]) => sum + count, 0)) / num);
    x.push(to);
  }
  return bars(x, [...shares, 0], true);
}

function bars(x: number[], shares: number[], isLogarithmic: boolean): ReturnType<typeof histogram> {
  const values = shares.map((share) => (isLogarithmic && share === 0 ? NOTHING : share));
  return { x, lines: [{ name: 'share', values }], bars: true, xLogarithmic: isLogarithmic, yLogarithmic: isLogarithmic };
}
