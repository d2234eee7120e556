// Number formatting for people.

/** Formats a value with fewer decimals the larger it is; a dash if it is not finite. */
export function digits(value: number, places = 2): string {
  if (!Number.isFinite(value)) return '–';
  const size = Math.abs(value);
  return value.toFixed(size >= 100 ? Math.max(0, places - 2) : size >= 10 ? Math.max(0, places - 1) : places);
}

/** Formats microseconds as µs, ms or s. */
export function duration(microseconds: number): string {
  if (!Number.isFinite(microseconds)) return '–';
  if (microseconds < 1000) return `${digits(microseconds, 1)} µs`;
  if (microseconds < 1e6) return `${digits(microseconds / 1000, 2)} ms`;
  return `${digits(microseconds / 1e6, 2)} s`;
}

/** Formats seconds as minutes: 75.31 -> "1:15.3" */
export function clock(seconds: number): string {
  const tenths = Math.floor(Math.max(0, seconds) * 10 + 1e-6);
  const minutes = Math.floor(tenths / 600);
  return `${minutes}:${((tenths % 600) / 10).toFixed(1).padStart(4, '0')}`;
}

export function norm(x: number, y: number, z: number): number {
  return Math.hypot(x, y, z);
}
