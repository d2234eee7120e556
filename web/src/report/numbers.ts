// Number formatting in suitable units.

export interface Unit { name: string; factor: number }

const units = (...list: [string, number][]): Unit[] => list.map(([name, factor]) => ({ name, factor }));
export const LENGTH = units(['m', 1], ['mm', 1e3], ['µm', 1e6]);
export const VOLUME = units(['m³', 1], ['cm³', 1e6], ['mm³', 1e9]);
export const TORQUE = units(['N m', 1], ['N mm', 1e3]);
export const TIME = units(['s', 1], ['ms', 1e3], ['µs', 1e6]);

/** Formats a value with at most `digits` significant digits, without trailing zeros. */
export function short(value: number, digits = 4): string {
  if (!Number.isFinite(value)) return '–';
  const rounded = Number(value.toPrecision(digits));
  const size = Math.abs(rounded);
  return size !== 0 && (size < 1e-4 || size >= 1e7) ? rounded.toExponential().replace('e+', 'e') : String(rounded);
}

/** Returns the first unit in which `largest` is at least 1, else the last one. */
export function unitFor(largest: number, list: Unit[]): Unit {
  return list.find(({ factor }) => largest * factor >= 1) ?? list[list.length - 1];
}

export function withUnit(value: number, list: Unit[], digits = 3): string {
  const unit = unitFor(Math.abs(value), list);
  return `${short(value * unit.factor, digits)}\u00a0${unit.name}`;
}

export const microseconds = (value: number) => withUnit(1e-6 * value, TIME);
export const newtons = (value: number) => `${short(value, 3)}\u00a0N`;
export const percent = (share: number, digits = 3) => `${short(100 * share, digits)}\u00a0%`;
export const list = (values: number[], digits = 4) => values.map((value) => short(value, digits)).join(', ');
export const counted = (number: number, what: string) => `${number} ${what}${number === 1 ? '' : 's'}`;
