// The page without a program: the viewer's page over a worker with the core, and the files that a reader drops on it.
import '../style.css';
import './try.css';
import { button, element, icon } from '../dom';
import { Page } from '../page';
import { Headset } from './headset';
import { type GivenMesh, readMesh } from './meshes';
import { readDepthPng } from './png';
import { SPHERES } from './object';
import { whyNot } from '../../core/palpate';
import type { Hello } from '../types';
import { packInWorker, WorkerWire } from './wire';

const LARGEST_FILE = 64 << 20; // bytes
/** Meshes become one of these, of so many spheres. Those of a slider are the first of a tool's. */
const ROLES = { tool: 5000, object: SPHERES };
type Role = keyof typeof ROLES;
const NO_UNPACKING = 'This browser cannot unpack Palpate: it lacks DecompressionStream; update the browser, or take Chrome 91, Firefox 113 or Safari 16.4 or newer.';

/** Returns the core that the page has inside, as base64 of gzip. */
async function core(): Promise<ArrayBuffer> {
  const text = document.getElementById('core')?.textContent?.trim() ?? '';
  const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream('gzip'))).arrayBuffer();
}

/** Returns a button for the licenses of Palpate and of what is in the page. */
function licenses(): HTMLElement {
  const close = button('round', 'close', () => dialog.close(), icon('close'));
  const dialog = element('dialog', 'help', element('h2', '', 'Licenses', close),
    element('p', '', 'Palpate: Apache License 2.0. In this page, and in the WebAssembly in it, is also the work of others:'),
    element('pre', '', document.getElementById('licenses')?.textContent?.trim() ?? ''));
  dialog.setAttribute('aria-label', 'licenses');
  return element('span', '', button('try-licenses', 'licenses of Palpate and of what is in this page', () => dialog.showModal(), 'licenses'), dialog);
}

class Files {
  private readonly line = element('p', 'try-line');
  private readonly answers = element('span', 'try-answers');
  private readonly input = element('input');
  private readonly object = element('select');
  private shown = 'none'; // object of the run
  private cancel = () => {};
  private begun = ''; // said when the next run is there
  private turn = 0; // number of the file that was given last

  constructor(private readonly wasm: ArrayBuffer, private readonly wire: WorkerWire, private readonly page: Page) {
    const label = element('label', 'try-open', 'Open a file …');
    this.input.type = 'file';
    this.input.accept = '.stl,.glb,.gltf,.png,.palp';
    this.input.setAttribute('aria-label', 'open your own STL, glTF, .palp or 16-bit PNG');
    label.title = 'STL, glTF or depth PNG; it stays in this browser';
    this.input.onchange = () => void this.take(this.input.files?.[0]);
    label.append(this.input);
    this.line.setAttribute('role', 'status');
    this.object.setAttribute('aria-label', 'object in the scene');
    this.object.title = 'a CAD object beside what the camera sees';
    this.object.onchange = () => {
      this.say('Another object is made');
      void this.page.command({ command: 'set', key: 'objects.shape', value: this.object.value })
        .then(({ ok }) => {
          this.say('');
          if (!ok) this.object.value = this.shown;
        });
    };
    document.body.append(element('div', 'try-files', element('div', 'try-talk', this.line, this.answers), label,
      element('label', 'try-object', 'object', this.object), licenses()));
    addEventListener('dragover', (event) => event.preventDefault());
    addEventListener('drop', (event) => {
      event.preventDefault();
      void this.take(event.dataTransfer?.files[0]);
    });
  }

  say(text: string): void {
    this.line.textContent = text;
  }

  /** Shows the object of a run, and which it can have. */
  show(hello: Hello): void {
    const control = hello.controls.find(({ key }) => key === 'objects.shape');
    this.object.replaceChildren(...(control?.choices ?? []).map((name) => element('option', '', name)));
    this.object.value = this.shown = String(control?.value);
    if (this.begun) this.say(this.begun);
    this.begun = '';
  }

  /** Offers answers beside the line, each of which does something. */
  private offer(answers: Record<string, () => void>): void {
    if (this.answers.contains(document.activeElement)) this.input.focus();
    this.answers.replaceChildren(...Object.entries(answers).map(([words, act]) => button('try-answer', words, act, words)));
  }

  /** Requests from the reader what a mesh becomes; null: nothing. */
  private async requestRole(name: string): Promise<Role | null> {
    this.say(`Use ${name} as`);
    return new Promise<Role | null>((resolve) => {
      this.cancel = () => resolve(null);
      this.offer({ 'the tool': () => resolve('tool'), 'an object': () => resolve('object'), cancel: this.cancel });
      this.answers.querySelector('button')?.focus();
    }).finally(() => this.offer({}));
  }

  async take(file: File | undefined, role?: Role): Promise<void> {
    if (!file) return;
    const turn = ++this.turn; // another file takes over
    this.input.value = '';
    try {
      if (file.size > LARGEST_FILE) throw new Error(`${file.name} has ${Math.round(file.size / 2 ** 20)} MB, and this page takes at most 64; simplify the mesh, or use the program.`);
      const bytes = await file.arrayBuffer();
      if (turn !== this.turn) return;
      if (/\.png$/i.test(file.name)) {
        const image = await readDepthPng(file.name, new Uint8Array(bytes));
        this.wire.order({ kind: 'image', image });
        this.say('');
      } else if (/\.(stl|glb|gltf|palp)$/i.test(file.name)) {
        await this.takeMesh(file.name, bytes, role);
      } else {
        throw new Error(`${file.name} is neither a mesh nor a depth image; give an .stl, .glb, .gltf, .palp or 16-bit .png file.`);
      }
    } catch (error) {
      this.say((error as Error).message);
    }
  }

  private async takeMesh(name: string, bytes: ArrayBuffer, given?: Role): Promise<void> {
    const isTool = /\.palp$/i.test(name), { turn } = this;
    this.cancel();
    this.say(`Reading ${name}`);
    const mesh = isTool ? null : await readMesh(name, bytes);
    if (turn !== this.turn) return;
    const role = given ?? await this.requestRole(name);
    const packed = role && (mesh ? await this.pack(name, mesh, ROLES[role]) : new Uint8Array(bytes));
    if (role && packed) this.wire.order({ kind: role, name, bytes: packed });
    this.begun = packed ? `${name} is the ${role}.` : '';
    this.say(packed ? `${name} is put into the scene` : `${name} is not used: cancelled.`);
  }

  private async pack(name: string, mesh: GivenMesh, spheres: number): Promise<Uint8Array | null> {
    this.say(`Filling ${name} with spheres`);
    const packing = packInWorker({ kind: 'pack', core: this.wasm, ...mesh, spheres },
      (share) => this.say(`Filling ${name} with spheres: ${Math.round(100 * share)} %`));
    this.cancel = packing.cancel;
    this.offer({ cancel: packing.cancel });
    return packing.result.finally(() => this.offer({}));
  }
}

/** The viewer's page, which also says to `files` what the run has. */
class TryPage extends Page {
  files: Files | null = null;

  onHello(hello: Hello): void {
    super.onHello(hello);
    this.files?.show(hello);
  }
}

async function begin(): Promise<void> {
  const refusal = whyNot() ?? (typeof DecompressionStream === 'function' ? null : NO_UNPACKING);
  if (refusal !== null) {
    const words = element('p', 'try-refusal', refusal);
    words.setAttribute('role', 'alert');
    return document.body.append(words);
  }
  const wasm = await core();
  let files: Files | null = null;
  const address = new URLSearchParams(location.search);
  const settings = [...address].filter(([key]) => key.includes('.')); // ?friction.coefficient=1.2
  const wire = new WorkerWire(wasm, settings, (text) => files?.say(text));
  for (const [name, value] of [['plots', '0'], ['image', '0'], ['controls', '0']]) if (!address.has(name)) address.set(name, value);
  const page = new TryPage(address, () => wire);
  page.files = files = new Files(wasm, wire, page);
  new Headset(page, wire, (text) => files?.say(text));
  Object.assign(window, {
    palpate: {
      counters: page.counters, scene: page.scene, command: page.command.bind(page), tell: (message: object) => wire.send(JSON.stringify(message)), take: (file: File, role: Role) => files?.take(file, role), readPng: readDepthPng,
      get hello() { return page.hello; }, get state() { return page.state; }, get sample() { return page.sample; }, get mesh() { return page.mesh; }, get contact() { return page.contact; },
    },
  });
}

void begin();
