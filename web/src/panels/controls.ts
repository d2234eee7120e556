import GUI from 'lil-gui';
import type { Controller, NumberController } from 'lil-gui';
import '../../node_modules/lil-gui/dist/lil-gui.css';
import type { Answer, Command } from '../connection';
import { element } from '../dom';
import type { Control, Hello, SceneOptions, State, Value } from '../types';

export interface Actions {
  send(command: Command): Promise<Answer>;
  /** An option of the scene has changed. */
  onOptions(): void;
  savePicture(): void;
  resetView(): void;
}

const WIDEST_SLIDER = 64; // wider ranges get a text field

/** All controls: options of the scene and settings of the run. */
export class Controls {
  readonly root = element('section', 'controls');
  private gui: GUI | null = null;
  private readonly values: Record<string, Value> = {}; // as displayed
  private readonly typed = new Set<string>(); // numbers that may also be a word
  private readonly turned = new Map<string, Controller>();
  private revision = -1;

  constructor(private readonly options: SceneOptions, private readonly actions: Actions) {
    this.root.setAttribute('aria-label', 'controls');
  }

  /** Rebuilds the controls for the program's settings. */
  setHello(hello: Hello): void {
    this.gui?.destroy();
    this.turned.clear();
    this.typed.clear();
    this.revision = -1;
    this.gui = new GUI({ container: this.root, title: 'Controls', injectStyles: false, touchStyles: 0 });
    this.addShow(this.gui.addFolder('Show'), hello);
    const folders = new Map<string, GUI>();
    for (const control of hello.controls) {
      const [section, ...rest] = control.key.split('.');
      const folder = folders.get(section) ?? this.gui.addFolder(capital(section)).close();
      folders.set(section, folder);
      this.addControl(folder, control, rest.join(' ').replaceAll('_', ' '));
    }
    if (hello.kind === 'live') this.addButtons('Run', this.runButtons());
    this.addButtons('Picture', {
      'look at the whole': () => this.actions.resetView(),
      'save a picture': () => this.actions.savePicture(),
    });
  }

  /** Takes over the program's settings, which another page may have changed. */
  update(state: State): void {
    if (state.revision === this.revision) return;
    const isShown = Object.entries(state.settings).map(([key, value]) => this.accept(key, value));
    if (isShown.every(Boolean)) this.revision = state.revision;
  }

  /** Shows options that keys have changed. */
  refresh(): void {
    for (const controller of this.gui?.controllersRecursive() ?? []) {
      if (controller.object === this.options) controller.updateDisplay();
    }
  }

  private addShow(folder: GUI, hello: Hello): void {
    const { options } = this;
    const addTo = (to: GUI) => (name: keyof SceneOptions, words: string, ...how: unknown[]) =>
      (to.add as (...all: unknown[]) => Controller).call(to, options, name, ...how)
        .name(words)
        .onChange(() => this.actions.onOptions());
    const add = addTo(folder);
    const hasScene = hello.streams.length > 0;
    add('toolLook', 'tool', { spheres: 'spheres', 'cut spheres': 'caps', mesh: 'mesh', hidden: 'hidden' });
    add('view', 'view', hasScene ? { free: 'free', camera: 'camera', 'from above': 'bird', tool: 'tool' } : { free: 'free', tool: 'tool' });
    if (hasScene) {
      add('cloud', 'cloud');
      add('cloudColor', 'cloud color', { shaded: 'shaded', depth: 'depth', normals: 'normals' });
      add('arrows', 'force and torque');
      add('ghost', 'ghost of the hand');
      add('trace', 'path of the tool');
      add('fog', 'fog where no camera sees');
    }
    const more = addTo(folder.addFolder('More to show').close());
    if (hasScene) {
      more('outside', 'spheres outside');
      more('sphereColor', 'sphere color', { state: 'state', 'deciding camera': 'camera' });
      more('pointSize', 'point size', 1, 8, 0.5);
      more('stride', 'every n-th pixel', 1, 8, 1);
      more('normals', 'normals');
      more('edges', 'depth changes');
      more('edgePlanes', 'edge planes');
    }
    more('graph', 'sphere graph');
    more('treeLevel', 'tree level', -1, 12, 1);
  }

  private addControl(folder: GUI, control: Control, name: string): void {
    const { key } = control;
    if (control.kind === 'number' && control.choices) this.typed.add(key);
    this.values[key] = this.shown(key, control.value);
    const controller = this.makeController(folder, control).name(name);
    controller.domElement.title = [control.words, control.unit, `(${key})`].filter(Boolean).join('\n');
    controller.onFinishChange((value: Value) => void this.set(key, this.typed.has(key) ? numberOrWord(String(value)) : value));
    this.turned.set(key, controller);
  }

  private makeController(folder: GUI, { key, kind, choices, low, high, whole, value }: Control): Controller {
    if (kind === 'choice') return folder.add(this.values, key, choices ?? []);
    if (kind === 'switch' || this.typed.has(key)) return folder.add(this.values, key);
    if (low !== undefined && high !== undefined && high - low <= WIDEST_SLIDER) {
      return folder.add(this.values, key, low, high, whole ? 1 : undefined);
    }
    const controller = folder.add(this.values, key, low) as NumberController;
    return controller.step(whole ? 1 : fineStep(Number(value)), whole === true); // only whole numbers are rounded
  }

  private shown(key: string, value: Value): Value {
    return this.typed.has(key) ? String(value) : value;
  }

  private async set(key: string, value: Value): Promise<void> {
    const answer = await this.actions.send({ command: 'set', key, value });
    if (!answer.ok) this.revision = -1; // the next state restores the value
  }

  /** Sets a displayed value. Returns false while the person is editing it. */
  private accept(key: string, value: Value): boolean {
    const controller = this.turned.get(key);
    const shown = this.shown(key, value);
    if (!controller || this.values[key] === shown) return true;
    if (controller.domElement.contains(document.activeElement)) return false;
    this.values[key] = shown;
    controller.updateDisplay();
    return true;
  }

  private runButtons(): Record<string, () => void> {
    const { send } = this.actions;
    return {
      'mark with a note …': () => {
        const text = prompt('What should be remembered of this moment?');
        if (text) void send({ command: 'mark', text });
      },
      'end the run …': () => {
        if (confirm('End the run? The force fades out and the recording is closed.')) void send({ command: 'end' });
      },
    };
  }

  private addButtons(title: string, buttons: Record<string, () => void>): void {
    const folder = this.gui!.addFolder(title);
    for (const name of Object.keys(buttons)) folder.add(buttons, name);
  }
}

function capital(word: string): string {
  return word.charAt(0).toUpperCase() + word.slice(1);
}

function numberOrWord(text: string): Value {
  const word = text.trim();
  return word === '' || Number.isNaN(Number(word)) ? word : Number(word);
}

/** Returns the step of arrow keys: about a twentieth of the number. */
function fineStep(value: number): number {
  return value === 0 ? 0.1 : 10 ** Math.floor(Math.log10(Math.abs(value)) - 1);
}
