// The page: passes data from the program to the scene and the panels, and input back.

import { Connection } from './connection';
import type { Answer, Command, Link, Listener, OpenWire } from './connection';
import { element } from './dom';
import { Drawing } from './drawing';
import { Handling } from './hand/handling';
import { decode } from './messages';
import { withoutScene } from './no_scene';
import { applyAddress } from './options';
import { Banner, notice } from './panels/banner';
import { CameraImage } from './panels/camera_image';
import { Controls } from './panels/controls';
import { Dock } from './panels/dock';
import type { PanelName } from './panels/dock';
import { Help, hint, listenToKeys } from './panels/help';
import { Legend } from './panels/legend';
import { Plots } from './panels/plots';
import { Readouts } from './panels/readouts';
import { Timeline } from './panels/timeline';
import { TopBar } from './panels/top_bar';
import { PictureRate } from './picture_rate';
import { createScene } from './scene/scene_view';
import { Theme } from './theme';
import type { CameraView, Contact, Frame, Hello, Mesh, Sample, SceneView, State, ToolLook } from './types';
import type { Subscription } from './subscription';
import { pictureSubscription, neededShapes } from './subscription';

const PANEL_PERIOD = 100; // ms
const TROUBLE_TIME = 8000; // ms
const LOOKS: ToolLook[] = ['spheres', 'caps', 'mesh', 'hidden'];

export class Page implements Listener {
  readonly counters = { pictures: 0, frames: 0, contacts: 0, samples: 0, reconnects: 0, drawn: 0 };
  hello: Hello | null = null;
  state: State | null = null;
  sample: Sample | null = null; // the newest
  mesh: Mesh | null = null; // of the tool
  contact: Contact | null = null; // the newest
  readonly scene: SceneView;

  private readonly root = element('div', 'page');
  private readonly stage = element('main', 'stage');
  private readonly canvas = element('canvas', 'scene');
  private readonly bar = new TopBar();
  private readonly banner = new Banner(() => void this.command({ command: 'force' }));
  private readonly readouts = new Readouts();
  private readonly legend = new Legend();
  private readonly hint = hint(this.canvas);
  private readonly image = new CameraImage();
  private readonly plots = new Plots();
  private readonly help = new Help();
  private readonly timeline = new Timeline((command) => this.command(command));
  private readonly controls: Controls;
  private readonly dock: Dock;
  private readonly theme: Theme;
  private readonly drawing: Drawing;
  private readonly rate = new PictureRate();
  private readonly handling: Handling;
  private readonly connection: Connection;

  private frames: (Frame | null)[] = []; // the latest of each camera
  private requested = new Set<string>(); // shapes requested over this connection
  private subscription = '';
  private trouble: string | null = null;
  private troubleEnd = 0;
  private readonly opened: PanelName[]; // panels open at first
  private readonly hasLook: boolean; // the address sets the tool's look
  private hasBegun = false;

  constructor(address: URLSearchParams, openWire?: OpenWire) {
    this.scene = this.makeScene();
    const { options } = this.scene;
    this.opened = applyAddress(address, options);
    this.hasLook = address.has('look');

    this.theme = new Theme((isDark) => this.onTheme(isDark), address.get('theme'));
    this.dock = new Dock(this.root, () => this.theme.toggle(), () => this.help.toggle());
    this.controls = new Controls(options, {
      send: (command) => this.command(command),
      onOptions: () => this.onOptions(),
      savePicture: () => void this.savePicture(),
      resetView: () => this.resetView(),
    });
    this.handling = new Handling({
      scene: this.scene,
      stage: this.stage,
      send: (command) => this.command(command),
      tell: (message) => this.connection.tell(message),
      requestDraw: () => this.drawing?.requestDraw(),
    });
    this.layOut();
    this.drawing = new Drawing(
      this.canvas, () => this.draw(), (picture) => this.connection.acknowledge(picture));
    this.dock.begin(this.opened);
    this.listen();
    this.connection = new Connection(this, address.get('token'), openWire);
    setInterval(() => this.updatePanels(), PANEL_PERIOD);
  }

  /** Sends a command. Errors are shown, and returned in the answer. */
  async command(command: Command): Promise<Answer> {
    const answer = await this.connection.send(command);
    if (!answer.ok && !['get', 'marks'].includes(command.command)) this.tell(answer.error ?? 'That could not be done.');
    return answer;
  }

  // Messages from the program.

  onLink(link: Link): void {
    this.bar.setLink(link);
    this.counters.reconnects = this.connection.reconnects;
    if (link !== 'open') {
      this.drawing.forget();
      this.handling.lose();
    }
    this.updatePanels();
  }

  onHello(hello: Hello): void {
    this.hello = hello;
    this.state = this.contact = this.sample = this.mesh = null;
    this.frames = hello.streams.map(() => null);
    this.requested.clear();
    this.subscription = '';
    this.rate.begin();
    this.plots.clear();
    this.scene.setHello(hello);
    // A tool alone is looked at for its spheres.
    if (!this.hasLook && !this.hasBegun) this.scene.options.toolLook = hello.kind === 'tool' ? 'caps' : 'mesh';
    if (hello.handle && !this.hasBegun) this.makeSpaceForHand();
    this.hasBegun = true; // what is opened and looked at since stays as it is
    for (const panel of [this.bar, this.readouts, this.image, this.timeline, this.controls, this.handling]) panel.setHello(hello);
    this.root.dataset.kind = hello.kind;
    this.dock.hide(hello.kind === 'tool' ? ['plots', 'image'] : hello.streams.length > 0 ? [] : ['image']);
    this.onOptions();
  }

  /** Closes most panels, for a run whose tool the page can hold. */
  private makeSpaceForHand(): void {
    this.hint.hidden = true; // the hand's card says more
    this.dock.begin(this.opened.filter((name) => name === 'plots'));
  }

  onState(state: State): void {
    this.state = state;
    this.timeline.update(state);
    this.handling.setState(state);
    this.controls.update(state);
    this.plots.latencies.update(state.stages);
    this.updateLegend();
  }

  private updateLegend(): void {
    if (this.hello) this.legend.update(this.hello, this.scene.options, this.state?.settings['coupling.kind'] !== 'none');
  }

  onBinary(buffer: ArrayBuffer): void {
    let message;
    try {
      message = decode(buffer, this.hello?.columns ?? []);
    } catch (error) {
      this.tell(`A message from Palpate could not be read: ${(error as Error).message}`);
      return;
    }
    switch (message?.kind) {
      case 'frame':
        ++this.counters.frames;
        this.frames[message.frame.camera] = message.frame;
        this.scene.setFrame(message.frame);
        break;
      case 'contact':
        ++this.counters.contacts;
        this.contact = message.contact;
        this.scene.setContact(message.contact);
        break;
      case 'samples':
        this.addSamples(message.samples);
        break;
      case 'normals': return this.scene.setNormals(message.normals);
      case 'edges': return this.scene.setEdges(message.edges);
      case 'spheres':
        this.image.setSpheres(message.spheres);
        this.readouts.setSpheres(message.spheres);
        this.scene.setSpheres(message.spheres);
        return this.drawing.requestDraw();
      case 'graph':
        this.scene.setGraph(message.graph);
        return this.drawing.requestDraw();
      case 'mesh':
        this.mesh = message.mesh;
        this.scene.setMesh(message.mesh);
        return this.drawing.requestDraw();
      case 'objects':
        this.scene.setObjects(message.meshes);
        return this.drawing.requestDraw();
      case 'tree':
        this.scene.setTree(message.tree);
        return this.drawing.requestDraw();
    }
  }

  onRefusal(error: string): void {
    this.tell(error);
    this.handling.hand.refused();
  }

  onPicture(number: number): void {
    ++this.counters.pictures;
    this.rate.count();
    this.drawing.askFor(number);
  }

  private addSamples(samples: Sample[]): void {
    if (samples.length === 0) return;
    this.counters.samples += samples.length;
    this.sample = samples[samples.length - 1];
    this.scene.addSamples(samples);
    this.plots.add(samples);
    this.handling.setSample(this.sample);
  }

  // Input.

  private listen(): void {
    new ResizeObserver(() => this.onResize()).observe(this.stage);
    this.root.addEventListener('panels', () => this.onOptions());
    document.addEventListener('visibilitychange', () => this.rate.begin());
    const { options } = this.scene;
    const toggle = (name: 'cloud' | 'normals' | 'fog' | 'edges' | 'graph') => () => {
      options[name] = !options[name];
      this.onOptions();
    };
    const look = (toolLook: ToolLook) => () => {
      options.toolLook = toolLook;
      this.onOptions();
    };
    listenToKeys({
      ' ': () => this.timeline.toggle(),
      '.': () => this.timeline.step(1),
      ',': () => this.timeline.step(-1),
      'v': () => this.nextView(),
      'r': () => this.resetView(),
      '1': look(LOOKS[0]), '2': look(LOOKS[1]), '3': look(LOOKS[2]), '4': look(LOOKS[3]),
      'c': toggle('cloud'), 'n': toggle('normals'), 'u': toggle('fog'), 'e': toggle('edges'), 'g': toggle('graph'),
      'w': () => {
        options.sphereColor = options.sphereColor === 'state' ? 'camera' : 'state';
        this.onOptions();
      },
      'p': () => this.dock.toggle('plots'),
      'i': () => this.dock.toggle('image'),
      'k': () => this.dock.toggle('controls'),
      't': () => this.handling.toggle(),
      'escape': () => this.handling.hand.letGo(),
      'm': () => this.timeline.mark(),
      's': () => void this.savePicture(),
      'd': () => this.theme.toggle(),
      'h': () => this.help.toggle(),
      '?': () => this.help.toggle(),
    });
  }

  /** Requests from the program the data that the options need. */
  private onOptions(): void {
    this.controls.refresh();
    this.drawing.requestDraw();
    if (!this.hello || this.connection.link !== 'open') return;
    this.updateLegend();
    const subscription: Subscription = pictureSubscription(this.hello, this.scene.options, this.dock.isOpen('image'));
    if (JSON.stringify(subscription) !== this.subscription) {
      this.subscription = JSON.stringify(subscription);
      void this.command({ command: 'show', ...subscription });
    }
    for (const what of neededShapes(this.hello, this.scene.options)) {
      if (this.requested.has(what)) continue;
      this.requested.add(what);
      void this.command({ command: 'get', what });
    }
  }

  private nextView(): void {
    const views: CameraView[] = this.hello?.streams.length ? ['free', 'camera', 'bird', 'tool'] : ['free', 'tool'];
    const { options } = this.scene;
    options.view = views[(views.indexOf(options.view) + 1) % views.length];
    this.onOptions();
    this.drawing.glide();
  }

  private resetView(): void {
    this.scene.resetView();
    this.controls.refresh();
    this.drawing.glide();
  }

  private async savePicture(): Promise<void> {
    try {
      const url = URL.createObjectURL(await this.scene.picture());
      const link = element('a');
      link.href = url;
      link.download = `palpate-${(this.state?.time ?? 0).toFixed(2)}s.png`;
      link.click();
      setTimeout(() => URL.revokeObjectURL(url), 10000);
    } catch (error) {
      this.tell((error as Error).message);
    }
  }

  // The scene and its drawing.

  private makeScene(): SceneView {
    try {
      return createScene(this.canvas);
    } catch (error) {
      const reason = (error as Error).message;
      this.tell(`This browser shows no 3-D picture (${reason}); turn on its graphics acceleration, or use plots and controls, which work without it.`, Infinity);
      return withoutScene();
    }
  }

  private layOut(): void {
    const overlay = element('div', 'overlay', this.readouts.root, this.legend.root);
    this.stage.append(this.canvas);
    this.root.append(
      this.bar.root, this.dock.root, this.banner.root, this.stage, overlay, this.hint, this.handling.card.root, this.image.root,
      this.controls.root, this.timeline.root, this.plots.root, this.help.root);
    document.body.replaceChildren(this.root);
  }

  private draw(): void {
    this.scene.render();
    this.handling.place();
  }

  private onResize(): void {
    const { clientWidth, clientHeight } = this.stage;
    if (clientWidth === 0 || clientHeight === 0) return;
    this.scene.resize(clientWidth, clientHeight, Math.min(devicePixelRatio, 2));
    this.drawing.requestDraw();
  }

  private onTheme(isDark: boolean): void {
    this.scene.options.dark = isDark;
    this.plots.restyle();
    this.drawing?.requestDraw(); // null during construction
  }

  private tell(words: string, milliseconds = TROUBLE_TIME): void {
    this.trouble = words;
    this.troubleEnd = performance.now() + milliseconds;
  }

  private updatePanels(): void {
    if (performance.now() > this.troubleEnd) this.trouble = null;
    const { hello, state, trouble } = this;
    const pictureAge = document.hidden || this.drawing.isBehind ? 0 : this.rate.age;
    this.banner.show(notice({ link: this.connection.link, hello, state, pictureAge, trouble }));
    this.counters.drawn = this.drawing.count;
    if (!hello || document.hidden) return;
    this.bar.update(hello, state, this.rate.perSecond);
    this.readouts.update(this.sample, state);
    this.handling.update();
    if (this.dock.isOpen('plots')) this.plots.draw();
    if (this.dock.isOpen('image')) this.image.draw(this.frames, this.contact);
  }
}
