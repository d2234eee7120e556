// The evaluation report: verdict of every claim, and each figure with its plots.
import './evaluation.css';

import { element } from '../dom';
import { floats } from './bytes';
import { depthsOf, seenTool, STATE_KEY, type SeenTool } from './moment';
import { short } from './numbers';
import { captioned, folded, footer, heading, key, paragraph, table, title, warning } from './parts';
import { plot, type Curve } from './plot';
import { cutColors, cutOpen, type Solid } from './solid';

interface Claim { source: string; claim: string; where: string; measured: string; verdict: string; is_against: boolean }
interface PlotData {
  title: string; x_label: string; y_label: string; log_x: boolean; log_y: boolean; caption: string;
  curves: { label: string; style: string; x: string; y: string }[]; // base64 of floats
}
type PictureData = { title: string; caption: string } & ({ kind: 'cut open'; data: Solid } | { kind: 'seen'; data: SeenTool });

/** Results of one run of a figure, as in its file. */
interface Stored {
  commit: string; made: string; seconds: number; failure: string;
  key: { form: string; isa: string };
  machine: string;
  numbers: { key: string; value: number | null; unit: string }[];
  plots: PlotData[];
  tables: { title: string; columns: string[]; rows: string[][] }[];
  pictures: PictureData[];
  notes: string[];
}

interface Figure {
  id: string; title: string; section: string; is_current: boolean; data_file: string;
  claims: Claim[];
  stored: Stored | null; // null: not made yet
  on_gpu: Stored | null;
}

interface EvaluationData {
  program: string; command: string; machine: string; form: string; inputs: string;
  sources: { name: string; heading: string; counts: [verdict: string, count: number][] }[];
  figures: Figure[];
}

/** Style class of each verdict. */
const TONES: Record<string, string> = {
  agrees: 'good', holds: 'good', better: 'new', differs: 'mixed', even: 'mixed', 'holds in part': 'mixed',
  contradicts: 'bad', worse: 'bad', fails: 'bad',
};
const tone = (verdict: string) => TONES[verdict] ?? 'none';
const chip = (verdict: string) => element('span', `chip ${tone(verdict)}`, verdict);

const anchor = (text: string) => text.replace(/[^0-9a-zA-Z.-]/g, '_');

function link(to: string, words: string): HTMLElement {
  const made = element('a', '', words);
  made.href = `#${to}`;
  return made;
}
const figureLink = ({ id }: Figure) => link(`f-${anchor(id)}`, id);

export async function evaluationReport(main: HTMLElement, data: EvaluationData): Promise<void> {
  title(main, 'Evaluation', 'Every figure of “A Volume-Based Penetration Measure for 6DOF Haptic Rendering of Streaming Point ' +
    'Clouds”, repeated with this program, with a verdict on each claim.');
  document.body.classList.add('evaluation');
  main.append(...counts(data), facts(data), ...failures(data), ...findings(data));
  const made = data.figures.filter(({ stored }) => stored);
  const sections = [...new Set(made.map(({ section }) => section))];
  const sources = data.sources.filter(({ name }) => made.some(({ claims }) => claims.some((claim) => claim.source === name)));
  main.append(element('nav', '',
    ...sources.map(({ name, heading }) => link(`all-${name}`, heading)), ...sections.map((name) => link(`s-${anchor(name)}`, name))));
  for (const source of sources) main.append(...allClaims(data, source));
  const missing = data.figures.filter(({ stored }) => !stored).map(({ id }) => id);
  if (missing.length > 0) main.append(paragraph(`Not made yet: ${missing.join(', ')}.`));
  for (const name of sections) {
    const words = heading(name);
    words.id = `s-${anchor(name)}`;
    main.append(words);
    for (const figure of made) if (figure.section === name) main.append(await figureSection(figure, data));
  }
  main.append(footer(`Palpate ${data.program}. Times are of single calls on one thread: compare them within one report. All ` +
    'else is the same on every machine.'));
  // The target of the address's hash exists only now.
  if (location.hash) document.getElementById(decodeURIComponent(location.hash.slice(1)))?.scrollIntoView();
}

// The first screen.

function counts({ sources }: EvaluationData): HTMLElement[] {
  return sources.flatMap(({ heading: words, counts }) => [
    element('h3', '', words),
    element('div', 'share', ...counts.map(([verdict, count]) => {
      const part = element('i', tone(verdict));
      part.style.flex = String(count);
      return part;
    })),
    element('div', 'verdicts', ...counts.map(([verdict, count]) => element('span', '', element('b', '', String(count)), chip(verdict)))),
  ]);
}

function facts(data: EvaluationData): HTMLElement {
  const made = data.figures.filter(({ stored }) => stored);
  const seconds = made.reduce((sum, { stored }) => sum + stored!.seconds, 0);
  const time = seconds < 100 ? `${short(seconds, 2)} s` : `${short(seconds / 60, 2)} min`;
  return table([
    ['figures', `${made.length} of ${data.figures.length}, made in ${time}`], ['machine', data.machine], ['form', data.form],
    ['inputs', data.inputs], ['made again by', data.command],
  ]);
}

/** Lists claims that contradict the thesis or this project, in full. */
function findings({ figures }: EvaluationData): HTMLElement[] {
  const items = figures.flatMap((figure) => figure.claims.filter(({ is_against: is }) => is).flatMap((claim) => [
    element('dt', '', figureLink(figure), `${claim.where} ${claim.measured} `, chip(claim.verdict)), element('dd', '', claim.claim)]));
  if (items.length === 0) return [];
  return [element('div', 'first', element('h2', '', 'Results against the thesis, or against us'), element('dl', '', ...items))];
}

function failures({ figures }: EvaluationData): HTMLElement[] {
  return figures.filter(({ stored }) => stored?.failure).map((figure) => {
    const made = warning(` failed: ${figure.stored!.failure}`);
    made.prepend(figureLink(figure));
    return made;
  });
}

function claimTable(head: string[], rows: { first?: HTMLElement; claim: Claim }[]): HTMLElement {
  const line = ({ first, claim }: { first?: HTMLElement; claim: Claim }) => element('tr', '',
    ...(first ? [element('td', 'figure', first)] : []), element('td', 'claim', claim.claim + claim.where),
    element('td', 'measured', claim.measured), element('td', 'verdict', chip(claim.verdict)));
  return element('table', 'claims',
    element('thead', '', element('tr', '', ...head.map((words) => element('th', '', words)))), element('tbody', '', ...rows.map(line)));
}

function allClaims({ figures }: EvaluationData, { name, heading: words }: { name: string; heading: string }): HTMLElement[] {
  const rows = figures.filter(({ stored }) => !stored?.failure).flatMap((figure) =>
    figure.claims.filter(({ source }) => source === name).map((claim) => ({ first: figureLink(figure), claim })));
  const above = heading(words);
  above.id = `all-${name}`;
  return [above, claimTable(['figure', 'claim', 'we measure', 'verdict'], rows)];
}

// A figure.

async function figureSection(figure: Figure, { sources }: EvaluationData): Promise<HTMLElement> {
  const stored = figure.stored!;
  const above = element('h3', '', figureLink(figure), ` ${figure.title}`);
  above.id = `f-${anchor(figure.id)}`;
  const made = element('section', 'made', above);
  if (!figure.is_current) {
    made.append(element('p', 'below', `From an earlier run: ${stored.made}, ${stored.key.form} form, ` +
      `${stored.commit ? `commit ${stored.commit}` : 'commit not given'}, ${stored.machine}.`));
  }
  if (stored.failure) {
    made.append(warning(`Failed: ${stored.failure}`));
    return made;
  }
  for (const { name, heading: words } of sources) {
    const rows = figure.claims.filter(({ source }) => source === name).map((claim) => ({ claim }));
    if (rows.length > 0) made.append(claimTable([words, 'we measure', 'verdict'], rows));
  }
  if (stored.pictures.length > 0) made.append(element('div', 'plots', ...await Promise.all(stored.pictures.map(pictureOf))));
  made.append(...plotsAndTables(stored));
  if (figure.on_gpu) {
    const { key: { isa }, made: when, commit } = figure.on_gpu;
    made.append(element('p', 'below', `The same, ${isa} (${when}, commit ${commit}):`), ...plotsAndTables(figure.on_gpu));
  }
  if (stored.notes.length > 0) made.append(element('ul', 'notes', ...stored.notes.map((note) => element('li', '', note))));
  if (stored.numbers.length > 0 || stored.plots.length > 0) made.append(numbers(figure, stored));
  return made;
}

async function pictureOf(one: PictureData): Promise<HTMLElement> {
  const above = element('h4', '', one.title), caption = `${one.caption} Drag to turn, scroll or pinch to zoom.`;
  if (one.kind === 'cut open') return element('div', '', above, cutOpen(one.data, one.title, caption).root, cutColors());
  return element('div', '', above, seenTool(one.data, await depthsOf(one.data), one.title, caption).root, key(STATE_KEY));
}

function plotsAndTables({ plots, tables }: Stored): HTMLElement[] {
  return [...(plots.length > 0 ? [element('div', 'plots', ...plots.map(plotOf))] : []), ...tables.map(tableOf)];
}

// Plots.

const STYLES = ['weighted', 'simplified', 'graph', 'graph-cap', 'field', 'exact', 'thesis', 'other1', 'other2', 'other3', 'other4'];
const DASHES: Record<string, number[]> = { exact: [5, 4], thesis: [1, 4], 'graph-cap': [7, 3] };
const WIDTHS: Record<string, number> = { field: 2.4, thesis: 2.4 };
const MOST_DOTS = 40;

function plotOf(data: PlotData): HTMLElement {
  const curves = data.curves.map(({ label, style, x, y }): Curve => {
    const known = STYLES.includes(style) ? style : 'other1', xs = floats(x);
    return {
      name: label, color: `--${known}`, x: xs, y: floats(y), width: WIDTHS[known] ?? 1.6, dash: DASHES[known],
      hasDots: xs.length <= MOST_DOTS && known !== 'exact',
    };
  });
  let low = Infinity, high = -Infinity;
  for (const { x } of curves) {
    for (let i = 0; i < x.length; ++i) {
      if (!Number.isFinite(x[i]) || (data.log_x && x[i] <= 0)) continue;
      low = Math.min(low, x[i]);
      high = Math.max(high, x[i]);
    }
  }
  if (!(low <= high)) [low, high] = data.log_x ? [1, 10] : [0, 1];
  const made = plot({
    x: [low, high], lines: [], curves, xWords: data.x_label, yWords: data.y_label,
    xLogarithmic: data.log_x, yLogarithmic: data.log_y,
  }, data.caption);
  const named = curves.filter(({ name }) => name);
  made.prepend(element('h4', '', data.title), element('div', 'names', ...named.map(({ name, color, dash }) => {
    const stroke = element('i', dash ? 'dashed' : '');
    stroke.style.borderColor = `var(${color})`;
    return element('span', '', stroke, name);
  })));
  return made;
}

// Tables.

/** True if a cell reads as a number, with or without a sign: such columns are right-aligned. */
const isNumber = (cell: string) => /^[-+−\s]*(\d|$)/.test(cell);

function tableOf({ title: words, columns, rows }: Stored['tables'][number]): HTMLElement {
  const isRight = columns.map((_, i) => i > 0 && rows.every((row) => isNumber(row[i] ?? '')));
  const line = (cells: string[], tag: 'td' | 'th') =>
    element('tr', '', ...cells.map((cell, i) => element(tag, isRight[i] ? 'number' : '', cell)));
  return captioned(element('div', 'wide', element('table', 'data',
    element('thead', '', line(columns, 'th')), element('tbody', '', ...rows.map((row) => line(row, 'td'))))), words);
}

function numbers({ data_file: file }: Figure, stored: Stored): HTMLElement {
  const made = folded(`${stored.numbers.length} numbers; all data in ${file} and CSV files beside it`);
  // Filled when unfolded: most readers never do.
  made.addEventListener('toggle', () => made.append(table(stored.numbers.map(({ key: name, value, unit }) =>
    [name, value === null ? 'none' : short(value, 5), unit]))), { once: true });
  return made;
}
