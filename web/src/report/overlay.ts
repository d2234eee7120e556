// Columns of two runs on one time.

type Column = (number | null)[];

/** Returns a column of a run at other times, linearly between its rows; null outside of the run or beside a gap. */
export function interpolated(series: Record<string, Column>, name: string, x: number[]): Column {
  const times = series.time_s as number[], values = series[name];
  let i = 0;
  return x.map((time) => {
    while (i + 2 < times.length && times[i + 1] <= time) ++i;
    if (!values || times.length === 0 || time < times[0] || time > times[times.length - 1]) return null;
    const before = values[i], after = values[Math.min(i + 1, values.length - 1)];
    if (before === null || after === null) return null;
    const step = (times[i + 1] ?? times[i]) - times[i];
    return step > 0 ? before + ((after - before) * (time - times[i])) / step : before;
  });
}

export function difference(a: Column, b: Column): Column {
  return a.map((value, i) => (value === null || b[i] === null ? null : value - b[i]!));
}

/** Returns the norm of a vector of columns. */
export function normOf(axes: Column[]): Column {
  return axes[0].map((_, i) => (axes.some((axis) => axis[i] === null) ? null : Math.hypot(...axes.map((axis) => axis[i]!))));
}
