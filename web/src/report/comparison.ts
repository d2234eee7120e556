// The report of the packing benchmark: three packers on the same meshes.

import { element } from '../dom';
import { short } from './numbers';
import { columns, footer, heading, paragraph, table, title, warning, type Row } from './parts';
import { plot } from './plot';

interface Curve { spheres: number[]; fill: number[]; seconds: number[]; is_reported: boolean[]; ending: string }

interface ComparisonData {
  finding: string;
  skipped: string[];
  methods: string[];
  meshes: { mesh: string; curves: Curve[] }[];
  summary_header: string[];
  summary_rows: string[][];
  prototype_share: number;
  grid_cells: number;
  facts: [string, string][];
}

export async function comparisonReport(main: HTMLElement, data: ComparisonData): Promise<void> {
  title(main, 'Sphere packing, side by side',
    'Three ways to fill a solid with disjoint spheres, on the same meshes, in one run');
  main.append(element('p', 'finding', data.finding), ...data.skipped.map(warning));
  for (const { mesh, curves } of data.meshes) {
    main.append(heading(mesh), columns(
      fillOver(curves, data.methods, 'spheres', 'spheres', 'Fill over the number of spheres.'),
      fillOver(curves, data.methods, 'seconds', 'processor time on one thread, s', 'Fill over time.')));
    curves.forEach(({ ending }, m) => {
      if (ending) main.append(paragraph(`${data.methods[m]}: ${ending}`));
    });
  }
  main.append(heading('Summary'), table(data.summary_rows as Row[], data.summary_header),
    paragraph('Fill A and fill B are what Palpate fills with 1000 and 10 000 spheres; the last four columns are multiples of ' +
      'what Palpate needs for them. Times are processor times; everything runs on one thread. >: so many were not enough, ' +
      'and the method ended there. –: it ended earlier.'),
    heading('What is compared'),
    paragraph('Palpate: pack_spheres, one run for each number of spheres.'),
    paragraph('Prototype placement: one random prototype per grid cell and round flees from its closest obstacle in 50 ' +
      `cooled steps, those of at least ${short(data.prototype_share)} times the largest are inserted, the grid is split as ` +
      'rounds go by (after Weller and Zachmann 2010; Teuber, Weller and Zachmann 2013).'),
    paragraph(`Fixed grid: a distance field of ${data.grid_cells} cells along the longest side, always the largest sphere ` +
      'that fits around a cell center.'),
    paragraph("Both peers are this project's implementations of published descriptions, not their authors' code, on the CPU, " +
      "with Palpate's own distance queries. They run once per mesh and are timed sphere by sphere. Every packing was checked " +
      'in double precision: all spheres inside the solid, no two overlap.'),
    heading('How the numbers came to be'), table(data.facts), footer('Palpate, make packing-curves'));
}

/** Plots the fill of all methods over a common x, on a logarithmic axis. */
function fillOver(
  curves: Curve[], methods: string[], over: 'spheres' | 'seconds', xWords: string, caption: string,
): HTMLElement {
  const x = [...new Set(curves.flatMap((curve) => curve[over]))].filter((value) => value > 0).sort((a, b) => a - b);
  if (x.length < 2) return paragraph('There is nothing to draw.');
  const lines = curves.map((curve, m) => {
    const fills = new Map(curve[over].map((value, i) => [value, curve.fill[i]]));
    return { name: methods[m], values: x.map((value) => fills.get(value) ?? null), joined: true };
  });
  const marks = curves.map((curve) => new Set(curve[over].filter((_, i) => curve.is_reported[i])));
  return plot({
    x, xWords, xLogarithmic: true, yWords: 'fill', yFrom: Math.floor(10 * Math.min(...curves.flatMap(({ fill }) => fill))) / 10,
    lines: lines.map((line, m) => ({ ...line, marks: (i: number) => marks[m].has(x[i]) })),
  }, caption);
}
