// The report of a packing.

import { histogram, wholeNumbers } from './histogram';
import { LENGTH, percent, short, TIME, unitFor, VOLUME, withUnit } from './numbers';
import { cards, columns, footer, heading, paragraph, table, title, warning, type Row } from './parts';
import { plot } from './plot';
import { cutColors, cutOpen, type Solid } from './solid';

interface Mass {
  volume_m3: number; center_of_mass_m: number[];
  inertia_m5: number[]; // xx yy zz xy xz yz at 1 kg/m3
}

interface PackingData {
  program: string;
  source: string;
  num_spheres: number;
  solid: Solid;
  num_triangles: number;
  warning: string;
  fill: [n: number, fill: number][];
  void_law: { factor: number; exponent: number; rms: number; first: number } | null;
  apollonian_exponent: number;
  radii_m: number[]; // ascending; all, or evenly spaced ranks
  smallest_radius_m: number; median_radius_m: number; largest_radius_m: number;
  standoff: { samples_m: number[]; num_samples: number; mean_m: number; p95_m: number; max_m: number; worst_m: number[] };
  degrees: [degree: number, count: number][];
  mean_degree: number; median_degree: number; p90_degree: number; p99_degree: number; max_degree: number;
  graph: { edges: number; bridges: number; components: number; is_relative: boolean };
  tree_nodes: number;
  represented_volume_m3: number;
  mass: { spheres: Mass; mesh: Mass };
  stopped: string;
  options: [name: string, value: string][];
  steps: [name: string, seconds: number][];
}

const length = (meters: number) => withUnit(meters, LENGTH);
/** Formats numbers next to one as large as `large`; rounding errors become 0. */
const numbers = (values: number[], large: number) =>
  values.map((value) => short(Math.abs(value) < 1e-9 * large ? 0 : value)).join(', ');
const millimeters = (v: number[]) => `${numbers(v.map((x) => 1000 * x), 1)}\u00a0mm`;

export async function packingReport(main: HTMLElement, data: PackingData): Promise<void> {
  const { low_m: low, high_m: high } = data.solid;
  const size = high.map((one, i) => short(1000 * (one - low[i]), 3)).join(' × ');
  title(main, data.source, `A tool of ${size}\u00a0mm, filled with ${data.num_spheres} spheres.`);
  main.append(headline(data));
  if (data.warning) main.append(warning(data.warning));
  main.append(...cutSection(data), ...fillPlots(data), ...countPlots(data), ...mass(data), ...details(data),
    footer(`Palpate ${data.program}. The spheres and edges themselves: palpate export. The main numbers for programs: ` +
      'palpate info --json.'));
}

function headline(data: PackingData): HTMLElement {
  const { standoff, graph } = data;
  return cards([
    [String(data.num_spheres), `spheres of ${length(data.smallest_radius_m)} to ${length(data.largest_radius_m)}`],
    [percent(data.fill[data.fill.length - 1][1]), 'of the mesh is filled'],
    [length(standoff.mean_m), `from the surface to the nearest sphere on average; 95 %: ${length(standoff.p95_m)}, at most ` +
      `${length(standoff.max_m)}, at ${millimeters(standoff.worst_m)}`],
    [String(graph.edges), `edges between neighbors, ${short(data.mean_degree, 3)} per sphere`],
    [String(graph.components), `connected parts, joined by ${graph.bridges} bridges`],
  ]);
}

function cutSection({ solid, num_spheres, num_triangles }: PackingData): HTMLElement[] {
  const { root, numShown } = cutOpen(solid, 'the tool cut open',
    'The half towards you is taken away. Drag to turn, scroll or pinch to zoom, and move the cut.');
  const parts = [heading('Cut open'), root, cutColors()];
  if (numShown < num_spheres) parts.push(paragraph(`Of the spheres the first ${numShown} are shown.`));
  if (!solid.mesh) parts.push(paragraph(`The mesh has ${num_triangles} triangles, more than a page holds.`));
  return parts;
}

// Plots.

function fillPlots({ fill, void_law: law, apollonian_exponent: best }: PackingData): HTMLElement[] {
  const x = fill.map(([n]) => n), xWords = 'number of spheres';
  const lawWords = law ? `${short(law.factor, 3)} N^-${short(law.exponent, 3)}` : '';
  const rest = [{ name: 'empty', values: fill.map(([, share]) => 100 * (1 - share)) as (number | null)[] }];
  let caption = 'The empty share on logarithmic axes. ';
  if (law) {
    rest.push({ name: lawWords, values: x.map((n) => (n >= law.first ? 100 * law.factor * n ** -law.exponent : null)) });
    caption += `From ${law.first} spheres on it follows ${lawWords} within ${percent(law.rms, 2)}. The exponent says how ` +
      `fast more spheres help: the Apollonian packing, the best that spheres can do, has ${short(best)}.`;
    if (law.exponent > 0) {
      caption += ` Half as much empty space takes ${short(2 ** (1 / law.exponent), 2)} times as many spheres.`;
    }
  } else {
    caption += 'There are too few spheres to fit a law.';
  }
  return [
    heading('How full it is'),
    plot({ x, xWords, xLogarithmic: true, yWords: 'filled in %', lines: [{ name: 'filled', values: fill.map(([, share]) => 100 * share) }] },
      'Filled share of the mesh over the number of spheres. Spheres are stored in the order in which they were packed: ' +
      'the first N of this tool are what packing N would have given, and the option --spheres of query and touch takes them.'),
    plot({ x, xWords, xLogarithmic: true, yLogarithmic: true, yWords: 'empty in %', lines: rest }, caption),
  ];
}

function countPlots(data: PackingData): HTMLElement[] {
  const { standoff } = data;
  const radius = unitFor(data.median_radius_m, LENGTH), gap = unitFor(standoff.mean_m, LENGTH);
  const mark = (words: string, meters: number, factor: number) => ({ x: factor * meters, words: `${words} ${length(meters)}` });
  return [
    heading('How large the spheres are'),
    plot({
      ...histogram(data.radii_m.map((r) => radius.factor * r), false),
      xWords: `radius in ${radius.name}`, yWords: '% of the spheres',
      markers: [mark('smallest', data.smallest_radius_m, radius.factor), mark('median', data.median_radius_m, radius.factor),
        mark('largest', data.largest_radius_m, radius.factor)],
    }, 'Radii, counted. Both axes are logarithmic.'),
    heading('Mean standoff'),
    plot({
      ...histogram(standoff.samples_m.map((d) => gap.factor * Math.max(0, d)), true),
      xWords: `from the surface to the nearest sphere in ${gap.name}`, yWords: '% of the points',
      markers: [mark('mean', standoff.mean_m, gap.factor), mark('95 %', standoff.p95_m, gap.factor)],
    }, 'Spheres fill the inside and never quite reach the surface: a tool that touches with its surface feels nothing until ' +
      `the first sphere touches. Distances from ${standoff.num_samples} points spread evenly over the surface. The largest, ` +
      `${length(standoff.max_m)}, is that of the worst of these points and all corners, at x, y, z = ` +
      `${millimeters(standoff.worst_m)} of the tool frame.`),
    heading('How the spheres are connected'),
    plot({
      ...wholeNumbers(data.degrees), xWords: 'neighbors of a sphere', yWords: '% of the spheres',
      markers: ([['median', data.median_degree], ['99 %', data.p99_degree], ['most', data.max_degree]] as const)
        .map(([words, degree]) => ({ x: Math.max(0.5, degree), words: `${words} ${degree}` })),
    }, 'Neighbors in the leaf graph, counted. Large spheres have many small neighbors.'),
  ];
}

// Tables.

function mass({ mass: { spheres, mesh }, represented_volume_m3: represented }: PackingData): HTMLElement[] {
  const volume = (value: number) => withUnit(value, VOLUME, 6);
  // 1 g/cm3 is 1000 kg/m3, and 1 kg m2 is 1e7 g cm2.
  const inertia = (of: Mass, from: number) =>
    numbers(of.inertia_m5.slice(from, from + 3).map((i) => 1e10 * i), 1e10 * of.inertia_m5[0]);
  return [heading('Mass'), table([
    ['volume', volume(spheres.volume_m3), volume(mesh.volume_m3)],
    ['volumes that the spheres stand for, together', volume(represented), volume(mesh.volume_m3)],
    ['center of mass x, y, z', millimeters(spheres.center_of_mass_m), millimeters(mesh.center_of_mass_m)],
    ['inertia xx, yy, zz in g\u00a0cm² at 1\u00a0g/cm³', inertia(spheres, 0), inertia(mesh, 0)],
    ['xy, xz, yz', inertia(spheres, 3), inertia(mesh, 3)],
  ], ['', 'spheres', 'mesh']), paragraph('Contacts are measured with the spheres and about their center of mass.')];
}

function details(data: PackingData): HTMLElement[] {
  const { graph } = data;
  const left: Row[] = [
    ['mesh', data.source], ['triangles', data.num_triangles], ['tree nodes', data.tree_nodes],
    ['gap rule', graph.is_relative ? 'relative: at most half the smaller radius' : 'absolute: less than twice the smallest radius'],
    ['edges', graph.edges], ['of these bridges', graph.bridges], ['connected parts without bridges', graph.components],
    ['neighbors: mean / median', `${short(data.mean_degree, 3)} / ${data.median_degree}`],
    ['neighbors: 90 % / 99 % / most', `${data.p90_degree} / ${data.p99_degree} / ${data.max_degree}`],
  ];
  const right: Row[] = [
    ...(data.stopped ? [['no more spheres because', data.stopped]] : []), ...data.options,
    ...data.steps.map(([name, seconds]): Row => [`time: ${name}`, withUnit(seconds, TIME)]),
  ];
  return [heading('Details'), columns(table(left), table(right))];
}
