import { element, write } from '../dom';
import { digits, norm } from '../format';
import type { Hello, Sample, Spheres, State } from '../types';

/** The main numbers, in large type. */
export class Readouts {
  readonly root = element('section', 'card readouts');
  private readonly force = value();
  private readonly torque = value();
  private readonly volume = value();
  private readonly share = value();
  private readonly inObjects = value();
  private readonly age = value();
  private readonly compute = value();
  private readonly fill = value();
  private readonly sizes = value();
  private toolVolume = 0;

  constructor() {
    this.root.setAttribute('aria-label', 'measurements');
  }

  setHello(hello: Hello): void {
    this.root.replaceChildren();
    if (hello.kind === 'tool') this.showTool(hello.tool);
    else this.showRun(hello);
  }

  update(sample: Sample | null, state: State | null): void {
    if (sample) {
      write(this.force, digits(norm(sample.force_x, sample.force_y, sample.force_z)));
      write(this.torque, digits(1000 * norm(sample.torque_x, sample.torque_y, sample.torque_z), 1));
      write(this.volume, digits(1e6 * sample.volume));
      write(this.share, digits((100 * sample.volume) / this.toolVolume, 1));
      write(this.inObjects, digits(sample.volume > 0 ? (100 * (sample.objects_volume ?? 0)) / sample.volume : 0, 0));
      write(this.age, digits(1000 * sample.contact_age, 1));
    }
    const haptic = state?.stages?.find((stage) => stage.num > 0);
    if (haptic) write(this.compute, digits(haptic.p99, 1));
  }

  /** Shows how well the spheres fill a tool, and their sizes. */
  setSpheres({ count, data }: Spheres): void {
    const radii = Array.from({ length: count }, (_, i) => data[4 * i + 3]).sort((a, b) => a - b);
    const filled = radii.reduce((sum, r) => sum + (4 / 3) * Math.PI * r ** 3, 0);
    write(this.fill, digits((100 * filled) / this.toolVolume, 1));
    if (count > 0) write(this.sizes, `${digits(1000 * radii[0])} – ${digits(1000 * radii[count - 1])}`);
  }

  private showRun(hello: Hello): void {
    this.toolVolume = hello.tool.volume;
    this.root.append(
      row('Force', this.force, 'N', 'main'),
      row('Torque', this.torque, 'N mm'),
      row('Volume', this.volume, 'cm³'),
      row('inside', this.share, '%'),
      ...(hello.objects > 0 ? [row('of it in objects', this.inObjects, '%')] : []),
      row('Contact age', this.age, 'ms', 'extra'),
    );
    if (hello.kind === 'live') this.root.append(row('Compute, p99', this.compute, 'µs', 'extra'));
  }

  private showTool(tool: Hello['tool']): void {
    this.toolVolume = tool.volume;
    this.root.append(
      row('Spheres', value(tool.spheres.toLocaleString('en')), '', 'main'),
      row('Volume', value(digits(1e6 * tool.volume)), 'cm³'),
      row('filled by spheres', this.fill, '%'),
      row('radii of spheres', this.sizes, 'mm'),
      row('farthest from its center', value(digits(1000 * tool.radius, 1)), 'mm'),
    );
  }
}

function value(text = '–'): HTMLElement {
  return element('b', 'number', text);
}

function row(name: string, number: HTMLElement, unit: string, kind = ''): HTMLElement {
  return element('p', kind, element('span', '', name), number, element('i', '', unit));
}
