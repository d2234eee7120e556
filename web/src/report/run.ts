// The report of a run. Its numbers are those of summary.json and wrench.csv.

import { element } from '../dom';
import { depthsOf, inObjects, momentSection, probeSection, type Moment, type MoveTool, type Probe, type ToolAt } from './moment';
import { counted, LENGTH, list, microseconds, newtons, percent, short, TIME, TORQUE, unitFor, VOLUME, withUnit } from './numbers';
import { normOf } from './overlay';
import { cards, columns, folded, footer, heading, paragraph, table, title, warning, type Row } from './parts';
import { plot, type Line, type Plot } from './plot';

type Value = string | number | boolean | number[];
type Settings = Record<string, Record<string, Value>>;
interface Camera { name: string; width: number; height: number; fx: number; fy: number; cx: number; cy: number; unit: number; sensor: string }
interface Times { p50: number; p99: number; p999: number; max: number; mean: number; num: number }

/** The displayed part of summary.json. */
interface Summary {
  program: string;
  tool: { source: string; spheres: number; sphere_volume_m3: number; mesh_volume_m3: number };
  full_volume_m3: number;
  device: { kind: string; name: string; max_force_N: number; max_torque_Nm: number };
  rate: number;
  stream: Camera;
  cameras: Camera[];
  objects: { source: string; spheres: number; position_m: number[] }[];
  seconds: number; ticks: number; ticks_in_contact: number; contacts: number; frames: number; missed: number; lost_records: number;
  interrupted: boolean; ending: string; failure: string; not_kept: string;
  faults: { time_s: number; fault: string; meaning: string; seconds: number | null }[];
  newtons_per_m3: number;
  peaks: {
    volume_m3: number; fraction: number; volume_time_s: number; force_N: number; torque_Nm: number;
    volume_in_objects_m3?: number;
    hand_force_N?: number; desired_force_N?: number; stretch_m?: number;
  };
  limited_ticks: number;
  microseconds?: Record<string, Times>;
  why_not_cuda?: string;
  warnings: string[];
  settings: Settings;
  probe?: Probe;
  changes: Settings[]; // the first and the last ones if there are many
  num_changes: number;
}

export interface RunData {
  summary: Summary;
  defaults: Settings;
  series: Record<string, (number | null)[]>; // columns of wrench.csv; rows of the largest forces
  frame_times_s: number[];
  nearest: { distance_m: number; time_s: number } | null; // of a run without contact
  latencies: Record<string, [number, number][]>; // microseconds, count
  moment: Moment | null;
  moment_trouble: string;
}

export const STAGES: Record<string, string> = {
  haptic_compute: 'haptic tick: computing',
  haptic_cpu: 'haptic tick: computing, without what others ran on its core meanwhile',
  haptic_period: 'haptic tick: from one to the next',
  contact_compute: 'contact query: computing',
  surface_compute: 'surface of a depth frame: computing',
  contact_age: 'age of the contact at a tick',
  sensor_to_force: 'from the depth frame to the force',
};

export async function runReport(main: HTMLElement, data: RunData): Promise<void> {
  const { summary, moment } = data;
  const { tool, stream, cameras, objects } = summary;
  const seconds = `${short(summary.seconds, 3)} s`;
  const seen = cameras.length > 1 ? `the depth images of ${cameras.length} cameras` : 'a stream of depth images';
  title(main, `${summary.peaks.volume_m3 > 0 ? 'Contact' : 'No contact'} of ${tool.source} with ${stream.name}${cameras.length > 1 ? `, seen by ${cameras.length} cameras` : ''}`,
    `A tool of ${tool.spheres} spheres on ${summary.device.name}, measured against ${seen}` +
    `${objects.length > 0 ? ` and ${counted(objects.length, 'object')}` : ''} for ${seconds}.`);
  if (summary.interrupted) {
    main.append(warning(`This run was interrupted after ${seconds}. What is shown is complete up to there.`));
  }
  if (summary.failure) main.append(warning(`The run ended early: ${summary.failure}`));
  if (summary.not_kept) main.append(warning(`Not all of the run is kept: ${summary.not_kept}`));
  main.append(...headline(summary));
  // Everything below the pictures is laid out now, so that the page does not jump.
  const pictures = element('section'), rest = element('section');
  main.append(pictures, rest);
  let moveTool: MoveTool = () => {};
  rest.append(...plots(data, (at) => moveTool(at)), ...times(data), ...notes(summary), ...settings(data),
    footer(`Palpate ${summary.program}. All of it is in recording.mcap, which ROS 2 tools and Foxglove open; the numbers ` +
      'are in wrench.csv and summary.json, too; palpate replay repeats it.'));

  const depths = moment && await depthsOf(moment).catch((error: Error) => {
    pictures.append(warning(`The depth images could not be read: ${error.message}`));
    return null;
  });
  const { force_N: force, torque_Nm: torque } = summary.peaks;
  if (depths) {
    const made = momentSection(moment, depths, { force, torque }, nearestWords(data));
    pictures.append(...made.parts);
    moveTool = made.moveTool;
  }
  if (data.moment_trouble) pictures.append(warning(data.moment_trouble));
  const first = depths?.[0] ?? null; // the camera of the automatic path
  if (summary.probe) pictures.append(...probeSection(summary.probe, first, first ? stream.width / first.width : 1));
}

/** Returns pose and wrench of a row; null where they are unknown. */
export function toolAt(series: RunData['series'], i: number): ToolAt | null {
  const at = (...names: string[]) => names.map((name) => series[name]?.[i] ?? NaN);
  const of = (prefix: string, unit: string) => at(...['x', 'y', 'z'].map((axis) => `${prefix}_${axis}_${unit}`));
  const X_WT = [...of('tool', 'm'), ...at('tool_qx', 'tool_qy', 'tool_qz', 'tool_qw')];
  if (!X_WT.every(Number.isFinite)) return null;
  const known = (values: number[]) => values.map((value) => (Number.isFinite(value) ? value : 0));
  return { time: series.time_s[i]!, X_WT, force_N: known(of('force', 'N')), torque_Nm: known(of('torque', 'Nm')) };
}

/** Returns where a run without contact was nearest, as a sentence. */
export function nearestWords({ nearest }: RunData): string {
  return nearest ? `It was nearest at ${short(nearest.time_s, 3)} s: ${withUnit(nearest.distance_m, LENGTH, 2)} away. ` : '';
}

const hasHand = (summary: Summary) => summary.settings.coupling.kind !== 'none';

function headline(summary: Summary): HTMLElement[] {
  const { peaks, microseconds: stages, cameras, ticks, missed, rate, seconds } = summary;
  const contact = (summary.ticks_in_contact / Math.max(ticks, 1)) * seconds;
  const made: [string, string][] = [
    [newtons(peaks.force_N), 'largest force on the tool'],
    [withUnit(peaks.torque_Nm, TORQUE), 'largest torque on the tool'],
    [withUnit(peaks.volume_m3, VOLUME),
      `deepest penetration${inObjects(peaks.volume_m3, peaks.volume_in_objects_m3 ?? 0)}; ${percent(peaks.fraction)} of the tool`],
    [withUnit(contact, TIME), `in contact, of ${short(seconds, 3)} s`],
    [String(cameras.length), `${cameras.length === 1 ? 'camera' : 'cameras'}; contact method ${summary.settings.contact.method}`],
  ];
  if (hasHand(summary)) {
    made.splice(2, 0, [newtons(peaks.hand_force_N!),
      `largest force on the hand, of ${newtons(peaks.desired_force_N!)} before the safety filter`]);
  }
  const share = 1 - missed / Math.max(ticks, 1);
  const medians = [['contact_compute', 'a query'], ['surface_compute', 'the surface of a depth frame'],
    ...(hasHand(summary) ? [['sensor_to_force', 'the way from depth frame to force']] : [])]
    .flatMap(([key, words]) => (stages?.[key] ? [`${words} takes ${microseconds(stages[key].p50)}`] : []));
  const verdict = `${short(rate / 1000)} kHz ${share >= 0.99 ? 'kept' : 'not kept'}: ${percent(share)} of ${ticks} ticks took ` +
    `less than ${withUnit(1 / rate, TIME)}. ${medians.length > 0 ? `In the median, ${medians.join(', ')}.` : ''}` +
    (share >= 0.99 ? '' : ` ${helpOnTime(summary)}`);
  return [cards(made), ...forceOff(summary), element('p', 'verdict', verdict)];
}

/** Returns what helps where ticks take too long. */
function helpOnTime({ microseconds: stages, rate }: Summary): string {
  const median = Math.max(...['haptic_compute', 'contact_compute'].map((key) => stages?.[key]?.p50 ?? 0));
  return median < 0.5e6 / rate ? 'The medians are far below that: other programs took the processor.'
    : 'Fewer spheres (--spheres) or another method take less.';
}

/** Returns a warning of a hand that had no force for a tenth of the run, which cards do not show. */
function forceOff({ faults, seconds, settings }: Summary): HTMLElement[] {
  const off = faults.reduce((sum, fault) => sum + (fault.seconds ?? seconds - fault.time_s), 0);
  return settings.coupling.kind === 'none' || off < 0.1 * seconds || off === 0 ? [] :
    [warning(`The force on the hand was off for ${short(off, 2)} of ${short(seconds, 2)} s: see “Times without force”.`)];
}

// Plots.

function unseenWords({ settings: { field } }: Summary): string {
  const thickness = field.thickness as number;
  const policy = field.unseen === 'solid' ? 'counts as solid'
    : field.unseen === 'fade' ? `pushes it no more from ${withUnit(thickness, LENGTH)} on`
      : `is ${withUnit(2 * thickness, LENGTH)} thick, and then there is nothing`;
  return 'How much of the tool lies more than 20 mm behind all that any camera has seen, or where none of them looks. ' +
    `The contact there is a guess: what is behind a surface ${policy}.`;
}

function plots(data: RunData, moveTool: MoveTool): HTMLElement[] {
  const { summary, series } = data;
  const x = series.time_s as number[];
  if (x.length === 0) return [];
  const column = (name: string, factor = 1) => series[name].map((value) => (value === null ? null : factor * value));
  const { peaks, settings, device } = summary;
  const { nearest } = data, touches = peaks.volume_m3 > 0;
  const markers = touches ? [{ x: peaks.volume_time_s, words: 'deepest' }] :
    nearest ? [{ x: nearest.time_s, words: 'nearest' }] : [];
  const onPoint = (i: number | null) => moveTool(i === null ? null : toolAt(series, i));
  const base = { x, xWords: 'time in s', strokes: data.frame_times_s, together: 'time', markers, onPoint };
  const simple = (yWords: string, lines: Line[], caption: string, more: Partial<Plot> = {}) =>
    plot({ ...base, yWords, lines, ...more }, caption);
  /** Returns the band of a standard deviation, if the run has it. */
  const band = (name: string, factor = 1) => (series[name] ? { std: column(name, factor) } : {});
  /** Plots the components and the norm of a vector. */
  const vector = (prefix: string, unit: string, symbol: string, yWords: string, caption: string, more = {}) => {
    const axes = ['x', 'y', 'z'].map((axis) => column(`${prefix}_${axis}_${unit}`));
    const size = normOf(axes);
    const lines = ['x', 'y', 'z'].map((axis, i) => ({ name: `${symbol} ${axis}`, values: axes[i], ...band(`${prefix}_std_${axis}_${unit}`) }));
    return simple(yWords, [...lines, { name: `|${symbol}|`, values: size, ...band(`${prefix}_std_${unit}`) }], caption, more);
  };

  const unit = unitFor(touches ? peaks.volume_m3 : 1e-6, VOLUME);
  const volumes = [{ name: 'penetration volume', values: column('volume_m3', unit.factor), ...band('volume_std_m3', unit.factor) }];
  const hasObjects = summary.objects.length > 0;
  if (hasObjects) volumes.push({ name: 'in objects', values: column('objects_volume_m3', unit.factor) });
  const made = [
    heading('What the tool felt'),
    paragraph('Drag across a plot, or pinch it, to zoom all of them in time; double-click to see all again.' +
      (series.volume_std_m3 ? ' Bands are one standard deviation to both sides, by the noise of the depth (--std).' : '')),
    simple(`volume in ${unit.name}`, volumes, `How much of the tool lies behind the surface${
      hasObjects ? ' or in an object' : ''}. Strokes on the top edge are depth frames, where there is room for them, and late ones.`, {
      right: { factor: 100 / (summary.full_volume_m3 * unit.factor), words: '% of the tool' },
    }),
    ...(series.unseen ? [simple('share of the tool in %', [{ name: 'where no camera sees', values: column('unseen', 100) }],
      unseenWords(summary))] : []),
    vector('force', 'N', 'F', 'force in N', 'Force on the tool in the axes of the world W (those of the first camera, ' +
      `x right, y down, z away from it, unless cameras have poses): volume times direction, times the volume stiffness of ${stiffness(summary)}.`),
    vector('torque', 'Nm', 'M', 'torque in N m', "Torque of the same forces about the tool's center of mass."),
  ];
  if (!hasHand(summary)) return made;

  const most = device.max_force_N * (settings.safety.force_share as number);
  const limit = peaks.hand_force_N! > 0.3 * most ? { limit: { value: most, words: 'most that the device gives' } } : {};
  const length = unitFor(peaks.stretch_m!, LENGTH);
  made.push(heading('What the hand felt'), vector('hand_force', 'N', 'F', 'force in N',
    "Force at the handle after the safety filter, in the axes of the device's base.", limit));
  if (device.max_torque_Nm > 0) {
    made.push(vector('hand_torque', 'Nm', 'M', 'torque in N m', 'Torque at the handle.'));
  }
  made.push(
    heading('Between hand and tool'),
    simple(`stretch in ${length.name}`, [{ name: 'stretch', values: column('stretch_m', length.factor) }],
      'How far the tool stays behind where the hand holds it: the surface keeps it out.'),
    simple('energy in mJ', [{ name: 'given to the hand', values: column('energy_given_J', 1e3) },
      { name: 'in the coupling', values: column('energy_coupling_J', 1e3) }],
    'What the passivity observer counts: above zero the device has given the hand more than it took.'),
    heading('Safety'),
    simple('share', [{ name: 'force let through', values: column('gain') },
      { name: 'fault', values: column('fault').map((fault) => (fault ? 1 : 0)) }],
    'The ramp after engaging, and the fade after a fault or at the end.'),
    simple('age in ms', [{ name: 'depth frame', values: positive(column('sensor_age_s', 1e3)) },
      { name: 'contact', values: positive(column('contact_age_s', 1e3)) }],
    'How old what a force rests on was, at each tick.', { yLogarithmic: true }));
  if (summary.faults.length > 0) {
    made.push(heading('Times without force'), table(summary.faults.map(({ time_s, meaning, seconds }) => [
      `${short(time_s)} s`, `${meaning}; ${seconds === null ? 'it did not come back' : `back after ${short(seconds, 3)} s`}`])));
  }
  return made;
}

/** Replaces values that a logarithmic axis cannot show by gaps. */
const positive = (values: (number | null)[]) => values.map((value) => (value && value > 0 ? value : null));

// Times.

function times({ summary, latencies }: RunData): HTMLElement[] {
  const stages = Object.entries(summary.microseconds ?? {});
  if (stages.length === 0) return [];
  const rows: Row[] = stages.map(([key, { p50, p99, p999, max }]) =>
    [STAGES[key] ?? key, ...[p50, p99, p999, max].map(microseconds)]);
  const shown = Object.entries({ haptic_compute: 'tick', haptic_period: 'tick to tick', contact_compute: 'query',
    surface_compute: 'surface' }).filter(([key]) => (latencies[key]?.length ?? 0) > 0);
  const all = shown.flatMap(([key]) => latencies[key].map(([time]) => time)).filter((time) => time > 0);
  const x = [...new Set(all)].sort((a, b) => a - b);
  const lines = shown.map(([key, name]) => ({ name, values: sharesAbove(latencies[key], x) }));
  const made: HTMLElement[] = [heading('How long it took')];
  if (x.length > 1) {
    made.push(plot({ x, lines, xWords: 'time in µs', yWords: '% that took longer', xLogarithmic: true, yLogarithmic: true },
      'How often each stage took longer than the time below: 1 % is the 99th percentile. Both axes are logarithmic.'));
  }
  return [...made, table(rows, ['stage', 'median', '99 %', '99.9 %', 'largest'])];
}

/** Returns the percentage of counts at or above each x; null where there is none. */
function sharesAbove(histogram: [number, number][], x: number[]): (number | null)[] {
  const num = histogram.reduce((sum, [, count]) => sum + count, 0);
  let below = 0, i = 0;
  return x.map((time) => {
    for (; i < histogram.length && histogram[i][0] < time; ++i) below += histogram[i][1];
    return below < num ? (100 * (num - below)) / num : null;
  });
}

// Words.

function notes({ warnings }: Summary): HTMLElement[] {
  return warnings.length > 0 ? [heading('Notes'), ...warnings.map(warning)] : [];
}

/** Returns the stiffness in words: newtons per volume. */
function stiffness({ newtons_per_m3, settings }: Summary): string {
  return `${short(1e-6 * newtons_per_m3)} N/cm³, which is ${short(settings.coupling.force_at_eighth as number)} N at an ` +
    "eighth of the tool's volume";
}

export const words = (value: Value) => (Array.isArray(value) ? list(value) :
  typeof value === 'boolean' ? (value ? 'on' : 'off') : typeof value === 'number' ? short(value, 6) : value);

/** Returns [section, key, value] of all settings. */
export const each = (settings: Settings): [string, string, Value][] => Object.entries(settings).flatMap(
  ([section, keys]) => Object.entries(keys).map(([key, value]): [string, string, Value] => [section, key, value]));

function settings({ summary, defaults }: RunData): HTMLElement[] {
  const { tool, cameras, device } = summary;
  const facts: Row[] = [
    ['tool', tool.source], ['spheres', tool.spheres],
    ['sphere volume / mesh volume', `${withUnit(tool.sphere_volume_m3, VOLUME)} / ${withUnit(tool.mesh_volume_m3, VOLUME)}`],
    ['volume stiffness', stiffness(summary)],
    ...summary.objects.map(({ source, spheres, position_m }): Row =>
      ['object', `${source}, ${spheres} spheres, at ${list(position_m)} m`]),
    ['device', device.name], ['rate', `${short(summary.rate)} Hz`],
    ...(['contact.method', 'coupling.kind', 'time.mode', 'loop.backend'].map((key): Row => {
      const [section, name] = key.split('.');
      return [key, words(summary.settings[section][name])];
    })),
  ];
  if (hasHand(summary)) {
    facts.push(['most force, torque', `${short(device.max_force_N)} N, ${short(device.max_torque_Nm)} N m`],
      ['ticks bent by a limit', summary.limited_ticks]);
  }
  const more: Row[] = [
    ...cameras.flatMap(({ name, width, height, fx, fy, cx, cy, unit, sensor }, i): Row[] => {
      const of = cameras.length > 1 ? `camera ${i + 1}: ` : '';
      return [[`${of}depth frames from`, name], [`${of}image`, `${width} × ${height}`],
        [`${of}fx, fy, cx, cy`, list([fx, fy, cx, cy], 6)],
        [`${of}depth unit`, `${short(unit, 6)} m`], [`${of}kind of sensor`, sensor === 'none' ? 'not known' : sensor.replace('_', ' ')]];
    }),
    ['ticks', summary.ticks], ['queries', summary.contacts], ['depth frames', summary.frames],
    ['records lost', summary.lost_records], ['duration', `${short(summary.seconds)} s`],
  ];
  if (summary.ending) more.push(['end', summary.ending]);
  if (summary.why_not_cuda) more.push(['not on a GPU because', summary.why_not_cuda]);
  const all = each(summary.settings);
  const differing = all.filter(([section, key, value]) =>
    JSON.stringify(value) !== JSON.stringify(defaults[section]?.[key]));
  const made = [heading('Setup'), columns(table(facts), table(more)), heading('Settings')];
  if (differing.length > 0) {
    made.push(table(differing.map(([section, key, value]) =>
      [`${section}.${key}`, words(value), words(defaults[section]?.[key] ?? '–')]), ['setting', 'value', 'default']));
  }
  made.push(folded('all settings', table(all.map(([section, key, value]) => [`${section}.${key}`, words(value)]))));
  if (summary.changes.length > 0) {
    const { num_changes, changes: kept } = summary, left_out = num_changes - kept.length;
    const number = (i: number) => String(i < kept.length / 2 ? i + 1 : i + 1 + left_out);
    made.push(heading('Changed while it ran'), table(kept.map((change, i) => [number(i),
      each(change).map(([section, key, value]) => `${section}.${key} = ${words(value)}`).join(', ')])));
  }
  return made;
}
