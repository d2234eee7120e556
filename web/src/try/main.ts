// The page without a program: the viewer's page over a worker with the core, and the files that a reader drops on it.
import '../style.css';
import './try.css';
import { button, element, icon } from '../dom';
import { Page } from '../page';
import { Headset } from './headset';
import { readMesh } from './meshes';
import { readDepthPng } from './png';
import { whyNot } from '../../core/palpate';
import { packInWorker, WorkerWire } from './wire';

const LARGEST_FILE = 64 << 20; // bytes
const TOOL_SPHERES = 5000; // those of a slider are the first of them
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
  private readonly button = element('button', 'try-cancel', 'cancel');
  private readonly input = element('input');
  private cancel = () => {};

  constructor(private readonly wasm: ArrayBuffer, private readonly wire: WorkerWire) {
    const label = element('label', 'try-open', 'your own tool or depth image');
    this.input.type = 'file';
    this.input.accept = '.stl,.glb,.gltf,.png,.palp';
    this.input.setAttribute('aria-label', 'open your own STL, glTF, .palp or 16-bit PNG');
    this.input.onchange = () => void this.take(this.input.files?.[0]);
    label.append(this.input);
    this.line.setAttribute('role', 'status');
    this.button.hidden = true;
    this.button.onclick = () => this.cancel();
    document.body.append(element('div', 'try-files', label, this.line, this.button, licenses()));
    addEventListener('dragover', (event) => event.preventDefault());
    addEventListener('drop', (event) => {
      event.preventDefault();
      void this.take(event.dataTransfer?.files[0]);
    });
  }

  say(text: string): void {
    this.line.textContent = text;
  }

  async take(file: File | undefined): Promise<void> {
    if (!file) return;
    this.input.value = '';
    try {
      if (file.size > LARGEST_FILE) throw new Error(`${file.name} has ${Math.round(file.size / 2 ** 20)} MB, and this page takes at most 64; simplify the mesh, or use the program.`);
      const bytes = await file.arrayBuffer();
      if (/\.png$/i.test(file.name)) {
        this.wire.order({ kind: 'image', image: await readDepthPng(file.name, new Uint8Array(bytes)) });
        this.say('');
      } else if (/\.palp$/i.test(file.name)) {
        this.wire.order({ kind: 'tool', name: file.name, bytes: new Uint8Array(bytes) });
        this.say('');
      } else if (/\.(stl|glb|gltf)$/i.test(file.name)) {
        await this.pack(file.name, bytes);
      } else {
        throw new Error(`${file.name} is neither a mesh nor a depth image; give an .stl, .glb, .gltf, .palp or 16-bit .png file.`);
      }
    } catch (error) {
      this.say((error as Error).message);
    }
  }

  private async pack(name: string, bytes: ArrayBuffer): Promise<void> {
    this.cancel();
    this.say(`Reading ${name}`);
    const mesh = await readMesh(name, bytes);
    this.say(`Filling ${name} with spheres`);
    const packing = packInWorker({ kind: 'pack', core: this.wasm, ...mesh, spheres: TOOL_SPHERES },
      (share) => this.say(`Filling ${name} with spheres: ${Math.round(100 * share)} %`));
    this.cancel = packing.cancel;
    this.button.hidden = false;
    const packed = await packing.result.finally(() => { this.button.hidden = true; });
    if (packed) this.wire.order({ kind: 'tool', name, bytes: packed });
    this.say(packed ? '' : `${name} was not packed: cancelled.`);
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
  const page = new Page(address, () => wire);
  files = new Files(wasm, wire);
  new Headset(page, wire, (text) => files?.say(text));
  Object.assign(window, {
    palpate: {
      counters: page.counters, scene: page.scene, command: page.command.bind(page), tell: (message: object) => wire.send(JSON.stringify(message)), take: (file: File) => files?.take(file), readPng: readDepthPng,
      get hello() { return page.hello; }, get state() { return page.state; }, get sample() { return page.sample; }, get mesh() { return page.mesh; },
    },
  });
}

void begin();
