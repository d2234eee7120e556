// The report of two runs, laid over each other on the time of both: what-if replays, which have the same motion and
// depth images, differ by their settings alone.

import { difference, interpolated, normOf } from './overlay';
import { depthsOf, momentSection, type MoveTool } from './moment';
import { newtons, percent, short, TIME, TORQUE, unitFor, VOLUME, withUnit } from './numbers';
import { cards, footer, heading, paragraph, table, title, warning, type Row } from './parts';
import { plot, type Line, type Plot } from './plot';
import { each, nearestWords, STAGES, toolAt, words, type RunData } from './run';

export interface TwoRunsData { names: [string, string]; runs: [RunData, RunData] }

export async function twoRunsReport(main: HTMLElement, { names, runs }: TwoRunsData): Promise<void> {
  const [a, b] = runs, [name_a, name_b] = names;
  title(main, `${name_a} and ${name_b}`, `${names.map((name, i) => `${name}: ${runs[i].summary.tool.source}, ` +
    `${short(runs[i].summary.seconds, 3)} s, contact method ${runs[i].summary.settings.contact.method}`).join('; ')}.`);
  const x = a.series.time_s as number[];
  const isSameMotion = moves(a, b, x);
  if (!isSameMotion) {
    main.append(warning('The tool moves differently in these runs: differences of force are those of the motion, too.'));
  }
  main.append(headline(names, runs, x));
  const pictures = document.createElement('section');
  main.append(pictures);
  let moveTool: MoveTool = () => {};
  main.append(...plots(names, runs, x, (i) => moveTool(i === null ? null : toolAt(a.series, i))), ...settings(names, runs),
    ...times(names, runs), footer(`Palpate ${a.summary.program}. palpate report makes this page of the reports of both runs.`));
  const { moment } = a;
  const depths = moment && await depthsOf(moment).catch((error: Error) => {
    pictures.append(warning(`The depth images could not be read: ${error.message}`));
    return null;
  });
  if (!moment || !depths) return;
  const made = momentSection(moment, depths, { force: a.summary.peaks.force_N, torque: a.summary.peaks.torque_Nm }, nearestWords(a));
  pictures.append(...made.parts, paragraph(`The picture is of ${name_a}.`));
  moveTool = made.moveTool;
}

/** True if the tool has the same poses in both, to 10 µm, where both have any. */
function moves(a: RunData, b: RunData, x: number[]): boolean {
  return ['x', 'y', 'z'].every((axis) => difference(a.series[`tool_${axis}_m`], interpolated(b.series, `tool_${axis}_m`, x))
    .every((apart) => apart === null || Math.abs(apart) < 1e-5));
}

function headline([name_a, name_b]: string[], [a, b]: RunData[], x: number[]): HTMLElement {
  const changed = (before: number, after: number) =>
    before > 0 && after !== before ? ` (${after > before ? '+' : '−'}${percent(Math.abs(after / before - 1), 2)})` : '';
  const pair = (of: (run: RunData) => number, show: (value: number) => string, what: string): [string, string] =>
    [`${show(of(a))} → ${show(of(b))}`, `${what}${changed(of(a), of(b))}`];
  const contact = ({ summary }: RunData) => (summary.ticks_in_contact / Math.max(summary.ticks, 1)) * summary.seconds;
  const apart = forceApart(a, b, x), known = apart.filter((value) => value !== null);
  const most = known.length > 0 ? Math.max(...known) : NaN;
  const rms = Math.sqrt(known.reduce((sum, value) => sum + value * value, 0) / known.length);
  return cards([
    pair((run) => run.summary.peaks.force_N, newtons, `largest force on the tool, ${name_a} → ${name_b}`),
    pair((run) => run.summary.peaks.torque_Nm, (value) => withUnit(value, TORQUE), 'largest torque'),
    pair((run) => run.summary.peaks.volume_m3, (value) => withUnit(value, VOLUME), 'deepest penetration'),
    pair(contact, (value) => withUnit(value, TIME), 'in contact'),
    [newtons(most), `largest difference of force, at ${short(x[apart.indexOf(most)], 4)} s; ${newtons(rms)} rms`],
  ]);
}

/** Returns the norm of the difference of force at each x, N. */
function forceApart(a: RunData, b: RunData, x: number[]): (number | null)[] {
  return normOf(['x', 'y', 'z'].map((axis) =>
    difference(a.series[`force_${axis}_N`], interpolated(b.series, `force_${axis}_N`, x))));
}

function plots([name_a, name_b]: string[], [a, b]: RunData[], x: number[], onPoint: Plot['onPoint']): HTMLElement[] {
  const { peaks } = a.summary;
  const base = { x, xWords: 'time in s', together: 'time', onPoint,
    markers: peaks.volume_m3 > 0 ? [{ x: peaks.volume_time_s, words: `deepest of ${name_a}` }] : [] };
  const both = (of: (run: RunData, column: (name: string) => (number | null)[]) => (number | null)[]): Line[] =>
    [{ name: name_a, values: of(a, (name) => a.series[name]) }, { name: name_b, values: of(b, (name) => interpolated(b.series, name, x)) }];
  const vector = (prefix: string, unit: string) => both((_, column) => normOf(['x', 'y', 'z'].map((axis) => column(`${prefix}_${axis}_${unit}`))));
  const unit = unitFor(Math.max(peaks.volume_m3, b.summary.peaks.volume_m3) || 1e-6, VOLUME);
  const apart = ['x', 'y', 'z'].map((axis): Line => ({ name: `ΔF ${axis}`,
    values: difference(interpolated(b.series, `force_${axis}_N`, x), a.series[`force_${axis}_N`]) }));
  return [
    heading('What the tool felt'),
    paragraph('Drag across a plot, or pinch it, to zoom all of them in time; double-click to see all again.'),
    plot({ ...base, yWords: 'force in N', lines: vector('force', 'N') }, 'Size of the force on the tool.'),
    plot({ ...base, yWords: 'difference in N', lines: apart }, `Force on the tool in ${name_b}, minus that in ${name_a}, in the axes of the world.`),
    plot({ ...base, yWords: 'torque in N m', lines: vector('torque', 'Nm') }, "Size of the torque about the tool's center of mass."),
    plot({ ...base, yWords: `volume in ${unit.name}`,
      lines: both((_, column) => column('volume_m3').map((value) => (value === null ? null : unit.factor * value))) },
    'How much of the tool lies behind the surface.'),
  ];
}

function settings(names: string[], runs: RunData[]): HTMLElement[] {
  const [of_a, of_b] = runs.map(({ summary }) => new Map(each(summary.settings).map(([section, key, value]) => [`${section}.${key}`, value])));
  const rows = [...new Set([...of_a.keys(), ...of_b.keys()])].map((key): Row => {
    const [one, other] = [of_a, of_b].map((of) => (of.has(key) ? words(of.get(key)!) : '–'));
    return [key, one, other];
  }).filter(([, one, other]) => one !== other);
  return [heading('Settings that differ'), rows.length > 0 ? table(rows, ['setting', ...names]) : paragraph('None.')];
}

function times(names: string[], runs: RunData[]): HTMLElement[] {
  const rows = Object.keys(STAGES).flatMap((stage): Row[] => {
    const found = runs.map(({ summary }) => summary.microseconds?.[stage]);
    if (!found.some((one) => one)) return [];
    return [[STAGES[stage], ...found.map((one) => (one ? `${withUnit(1e-6 * one.p50, TIME)}, ${withUnit(1e-6 * one.p99, TIME)}` : '–'))]];
  });
  return rows.length > 0 ? [heading('How long it took'), table(rows, ['stage: median, 99 %', ...names])] : [];
}
