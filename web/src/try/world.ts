// A live run inside the page: a simulated or given depth image, a tool, and the haptic loop at 1 kHz. To the page it is a program
// that speaks docs/viewer-protocol.md.
//
// A browser wakes a worker every few milliseconds only, so each time the ticks since are computed, one after the other and at
// their own times, in bursts of at most 10. Behind a late wake, burst follows burst until the run has caught up: no motor waits
// for a tick, so a late one is as good. A tick measures the contact while that is quick, else the first of a burst does. What a busy
// machine does not compute within LONGEST_DELAY passes without ticks: the clock of the run stands still, and the hand feels no jump.
import type { Camera, Contact, Hand, Palpate, Scene, Sensor, Simulation, Tick, Tool } from '../../core/palpate';
import { cameraOf, type GivenImage, imageOf, isSameCamera, nearestOf, noteOf } from './given_image';
import { type GivenObject, placeObject, type PlacedObject, SHAPES } from './object';
import { COLUMNS, contactMessage, frameMessage, type Image, meshMessage, objectsMessage, samplesMessage, spheresMessage } from './packets';
import { Follower } from './motion';
import { controls, DEFAULTS, DEVICE, RATE, type Value } from './settings';

const TICK = 1 / RATE; // s
const MOST_TICKS = 10; // of a burst
const LONGEST_DELAY = 100; // ticks, of the run behind the clock
const LONG_DELAY = 50;     // ticks: drawing, by software perhaps, takes the processor from the run
const LONGEST_PAUSE = 100; // ms, of pictures
const QUICK = 0.35; // ms, a query that every tick can pay
const FRAME_SECONDS = 0.1;
const SILENCE = 2000; // ms without a pose: nobody holds the tool; a busy phone draws slowly, and there is no motor
const KEPT_SAMPLES = 4000;
const STATES = ['waiting', 'engaged', 'fading', 'off', 'held_off', 'ended'];
const WIDTH = 320, HEIGHT = 240;

/** Inputs and choices of the reader. */
interface Given { given: GivenImage | null; givenTool: Uint8Array; givenObject: GivenObject; settings: Record<string, Value> }
export interface Outlet { text(message: object): void; binary(buffer: ArrayBuffer): void }

export class World {
  private settings: Record<string, Value> = { ...DEFAULTS };
  private revision = 1;
  private simulation!: Simulation;
  private sensor!: Sensor;
  private scene!: Scene;
  private tool!: Tool;
  private object: PlacedObject | null = null;
  private contact!: Contact;
  private hand!: Hand;
  private follower!: Follower;
  private images: Image[] = []; // shown in turn
  private given: GivenImage | null = null;
  private ownImage: GivenImage | null = null; // the reader's last, which comes back after a camera's
  private givenTool: Uint8Array | null = null; // a tool file
  private givenObject: GivenObject | null = null;
  private camera!: Camera;
  private title = '';

  private time = 0; // s, of the last tick
  private isHeld = false; private isSilent = false; // let go, since no pose came
  private heldTime = 0; // ms, of the last pose of the page
  private nextFrame = 0; // s
  private isFrameDue = false; // one was pushed
  private captured = 0; // s, of the newest frame
  private frameNumber = 0;
  private X_WT: number[] = [];
  private tickNumber = 0;
  private missed = 0;
  private lost = 0; // s without ticks
  private contacts = 0;
  private last: Tick | null = null;
  private queryMs = 0;
  private longestDelay = 0; // ticks, of the run behind the clock
  private late = 0; // ticks that came more than MOST_TICKS after their time
  private bursts = 0;
  private show = { frames: false, contacts: false, samples: false };
  private samples: number[][] = [];
  private firstSample = 0;
  private picture = 0;
  private acknowledged = 0;
  private pictures = { time: 0, pause: 0, areTooMany: false }; // ms, of the last one and until the next
  private hasNewFrame = true;
  private nextState = 0;
  private note: string | null = null;

  constructor(private readonly palpate: Palpate, private readonly out: Outlet) {
    this.build();
  }

  /** Makes the run anew, scene, tool and hand, or a part of it. If that fails, the run before goes on. */
  private build(make = () => this.make()): void {
    const { hand, contact, scene, object, sensor, tool, simulation, images, camera, title } = this, old = this.owned();
    try {
      make();
    } catch (error) {
      const begun = this.owned();
      Object.assign(this, { hand, contact, scene, object, sensor, tool, simulation, images, camera, title });
      begun.forEach((object, i) => object !== old[i] && object?.free());
      throw error;
    }
    const made = this.owned();
    old.forEach((object, i) => object !== made[i] && object?.free());
  }
  /** Returns what the core has of this run, in the order in which it is freed. */
  private owned(): ({ free(): void } | undefined)[] {
    return [this.hand, this.contact, this.scene, this.object?.shape, this.sensor, this.tool, this.simulation];
  }

  private make(): void {
    const { palpate, settings } = this, name = String(settings['scene.name']), noise = Number(settings['camera.noise']);
    this.simulation = palpate.simulation(name, WIDTH, HEIGHT, noise);
    const { info } = this.simulation, spheres = Number(settings['packing.spheres']);
    if (this.given) {
      this.camera = cameraOf(this.given);
      this.images = [imageOf(this.given)];
      this.title = this.given.name;
    } else {
      this.camera = info.camera;
      this.images = [0, 1].map(() => ({ ...this.simulation.next(), width: WIDTH, height: HEIGHT, unit: info.unit }));
      this.title = name === 'hand' ? 'A pen and a hand' : info.title;
    }
    const whole = this.givenTool ? palpate.loadTool(this.givenTool) : null;
    this.tool = whole ?? palpate.packShape(name === 'hand' ? 'stylus' : info.tool_shape, name === 'hand' ? 0.12 : info.tool_size, `packing.spheres = ${spheres}`);
    if (whole && whole.info.spheres > spheres) {
      this.tool = whole.prefix(spheres); // if it throws, the whole is freed with the rest
      whole.free();
    }
    this.sensor = palpate.sensor(this.camera);
    this.takeFrame();
    this.takeFrame();
    this.makeScene();
    this.makeHand(this.start());
    [this.isHeld, this.last] = [false, null];
    this.samples = [];
    this.longestDelay = this.bursts = this.contacts = 0;
  }

  /** Joins what the camera sees and the object, which rests on it. A room that moves has none. */
  private makeScene(): void {
    const { palpate, settings, tool, camera } = this, around = { image: this.images[0], camera, tool, X_WT: this.start() };
    this.object = this.given?.camera ? null : placeObject(palpate, settings, this.givenObject, around);
    this.scene = palpate.scene();
    this.scene.addSensor(this.sensor);
    if (this.object) this.scene.addBody(this.object.shape, this.object.pose(settings));
    this.makeContact();
  }

  /** Puts another object into the scene, or none. The tool stays where it is, and is let go. */
  private makeObject(): void {
    this.makeScene();
    this.makeHand(this.X_WT);
    this.isHeld = false;
  }

  private moveObject(): void {
    if (this.object) this.scene.moveBody(0, this.object.pose(this.settings));
  }

  /** Puts the tool somewhere: a new hand holds it there, and feels nothing before it has been free. */
  private makeHand(X_WT: number[]): void {
    this.hand = this.palpate.hand(this.tool, DEVICE, this.handOptions());
    this.X_WT = X_WT;
    this.follower = new Follower(this.hand.handleAt(X_WT));
    this.measure(this.time);
  }

  /** Returns the pose of the scene's path at its begin, or in front of the middle of a given image. */
  private start(): number[] {
    if (!this.given) return this.simulation.toolAt(0);
    return [0, 0, Math.max(0.15, nearestOf(this.images[0]) - 1.2 * this.tool.info.radius), 0, 1, 0, 0];  // a pen points away from the camera
  }

  private makeContact(): void {
    this.contact = this.palpate.contact(this.tool, `contact.method = ${this.settings['contact.method']}`);
    this.queryMs = 0;
  }
  private handOptions(): string {
    return ['coupling.stiffness', 'coupling.force_at_eighth', 'friction.coefficient'].map((key) => `${key} = ${this.settings[key]}`).join('; ');
  }

  hello(): object {
    const { info } = this.tool;
    return {
      type: 'hello', protocol: 3, version: this.palpate.version, kind: 'live', title: this.title,
      tool: { spheres: info.spheres, center_of_mass: info.center_of_mass, radius: info.radius, volume: info.volume },
      streams: [{ name: this.title, ...this.camera, rate: 1 / FRAME_SECONDS, is_moving: this.given?.camera !== undefined }],
      objects: this.object ? 1 : 0, handle: { max_force: DEVICE.max_force }, columns: COLUMNS,
      controls: controls(this.settings, this.palpate.simulations, [...SHAPES, ...(this.givenObject ? [this.givenObject.name] : [])]),
    };
  }

  state(): object {
    const { last } = this;
    return {
      type: 'state', time: this.time, running: true, fault: last && last.fault > 0 ? this.palpate.faultText(last.fault) : null,
      note: this.note, force: STATES[last?.state ?? 0], handle: this.isHeld ? 'held' : 'free', paused: false,
      revision: this.revision, settings: { ...this.settings, 'packing.spheres': String(this.settings['packing.spheres']) },
      frame_number: this.frameNumber, pages: 1, ticks: this.tickNumber, missed: this.missed, lost: 0, frames: this.frameNumber,
      contacts: this.contacts, sensor_age: Math.max(0, this.time - this.nextFrame + FRAME_SECONDS), stages: [],
      longest_delay: this.longestDelay, late: this.late, query_ms: this.queryMs,
    };
  }

  // Messages of the page.

  take(message: Record<string, unknown>): void {
    if (typeof message.ack === 'number') {
      this.acknowledged = message.ack;
    } else if (Array.isArray(message.hand)) {
      if (!this.isHeld) return this.out.text({ type: 'answer', id: null, ok: false, error: this.isSilent ? 'The tool was let go: the page sent no pose for a while.' : 'The tool is held anew: the scene has changed.' });
      this.heldTime = performance.now();
      this.follower.move(message.hand as number[]);
    } else {
      try {
        this.out.text({ type: 'answer', id: message.id, ok: true, ...this.command(message) });
      } catch (error) {
        this.out.text({ type: 'answer', id: message.id, ok: false, error: (error as Error).message });
      }
    }
  }

  private command(message: Record<string, unknown>): object {
    switch (message.command) {
      case 'show': Object.assign(this.show, message); this.hasNewFrame = true; return {};
      case 'get':
        if (message.what === 'spheres') this.out.binary(spheresMessage(this.tool));
        else if (message.what === 'mesh') this.out.binary(meshMessage(this.tool));
        else if (message.what === 'objects') this.out.binary(objectsMessage(this.object ? [this.object.shape] : []));
        else throw new Error(`The page without a program has no ${message.what}; take the program for it.`);
        return {};
      case 'set': return { value: this.set(String(message.key), message.value as Value) };
      case 'hold':
        if (Array.isArray(message.at)) this.build(() => this.makeHand(message.at as number[]));
        [this.isHeld, this.isSilent, this.heldTime] = [true, false, performance.now()];
        this.follower.grip();
        this.out.text(this.state());
        return {};
      case 'release': this.release(); return {};
      case 'force': return {};
      default: throw new Error(`The page without a program cannot ${message.command}; take the program for it.`);
    }
  }

  private release(isSilent = false): void {
    [this.isHeld, this.isSilent] = [false, isSilent];
    this.follower.stop();
    this.out.text(this.state());
  }

  set(key: string, value: Value): Value {
    const before = this.settings[key], { given, ownImage } = this;
    if (before === undefined) throw new Error(`There is no setting ${key} on this page.`);
    this.settings[key] = typeof before === 'number' ? Number(value) : value;
    try {
      if (key === 'contact.method') {
        const old = this.contact;
        this.makeContact();
        old.free();
      } else if (key.startsWith('coupling.') || key.startsWith('friction.')) {
        this.hand.change(this.handOptions());
      } else if (key === 'objects.shape') {
        this.rebuild(() => this.makeObject());
      } else if (key.startsWith('objects.')) {
        if (this.object) this.build(() => { this.moveObject(); this.makeHand(this.X_WT); });
      } else {
        if (key === 'scene.name') this.given = this.ownImage = null;
        this.rebuild();
      }
    } catch (error) {
      this.settings[key] = before;
      Object.assign(this, { given, ownImage });
      this.moveObject();
      throw error;
    }
    ++this.revision;
    this.out.text(this.state());
    return this.settings[key];
  }

  private rebuild(make = () => this.make()): void {
    this.build(make);
    this.out.text(this.hello());
    this.out.text(this.state());
  }

  useTool(bytes: Uint8Array, name: string): void {
    this.takeOver({ givenTool: bytes }, `The tool is ${name}.`);
  }
  useObject(bytes: Uint8Array, name: string): void {
    this.takeOver({ givenObject: { name, bytes }, settings: { ...this.settings, 'objects.shape': name } }, `The object is ${name}.`, () => this.makeObject());
  }
  /** Takes an image as the scene, or the next one of the same moving camera; null: what was there before the camera. */
  useImage(image: GivenImage | null): void {
    if (image && isSameCamera(image.camera, this.given?.camera)) {
      [this.given, this.images, this.isFrameDue] = [{ ...image, camera: this.given?.camera }, [imageOf(image)], true];
    } else {
      const given = image ?? this.ownImage;
      this.takeOver({ given }, noteOf(given));
      if (!given?.camera) this.ownImage = given;
    }
  }
  /** Takes what a reader gave, or refuses it and goes on as before. */
  private takeOver(news: Partial<Given>, note: string | null, make = () => this.make()): void {
    const { given, givenTool, givenObject, settings } = this;
    Object.assign(this, news);
    try {
      this.rebuild(make);
      this.note = note;
    } catch (error) {
      Object.assign(this, { given, givenTool, givenObject, settings });
      throw error;
    }
  }

  // The loop.

  private takeFrame(): void {
    const image = this.images[this.frameNumber % this.images.length];
    this.sensor.update(image.counts, image.unit, image.X_WC);
    ++this.frameNumber;
    this.isFrameDue = false;
    this.captured = this.time;
    this.nextFrame = this.time + FRAME_SECONDS;
    this.hasNewFrame = true;
  }

  private measure(time: number): void {
    const begin = performance.now();
    const isPushed = this.given?.camera !== undefined, progress = isPushed || this.images.length > 1 ? Math.min(1, Math.max(0, 1 - (this.nextFrame - time) / FRAME_SECONDS)) : 1;
    this.contact.measure(this.scene, this.X_WT, { progress, stiffness: true });
    this.hand.contact(this.contact, this.X_WT, time, isPushed ? this.captured : time); // a camera that has stopped ends the force
    // A query that another program has interrupted is none that is slow.
    this.queryMs += 0.05 * (Math.min(performance.now() - begin, 2 * QUICK) - this.queryMs);
    ++this.contacts;
  }

  /** Computes the next ticks until `now`, s; returns false if more of them are due. */
  run(now: number): boolean {
    const due = Math.floor((now - this.lost - this.time) / TICK);
    if (due <= 0) return true;
    const missed = Math.max(0, due - LONGEST_DELAY), num = Math.min(due - missed, MOST_TICKS);
    this.missed += missed;
    this.lost += missed * TICK;
    this.longestDelay = this.bursts++ > 100 ? Math.max(this.longestDelay, due) : 0; // after the code has warmed up
    if (due > LONG_DELAY) this.pictures.areTooMany = true;
    this.late += Math.min(num, Math.max(0, due - missed - MOST_TICKS));
    const begin = performance.now();
    if (this.isHeld && begin - this.heldTime > SILENCE) this.release(true);
    for (let k = 0; k < num; ++k) this.tick(k === 0);
    this.perTick = (performance.now() - begin) / num;
    const hasCaughtUp = num === due - missed, isFrameDue = this.isFrameDue || (this.images.length > 1 && this.time >= this.nextFrame);
    if (!isFrameDue || !(hasCaughtUp || this.time >= this.nextFrame + FRAME_SECONDS)) return hasCaughtUp;
    this.takeFrame();
    return false; // ticks were due meanwhile
  }
  private perTick = 0; // ms

  private tick(isFirst: boolean): void {
    this.time += TICK;
    ++this.tickNumber;
    if (this.isHeld) this.follower.step(TICK);
    if (isFirst || this.queryMs < QUICK) this.measure(this.time);
    const { pose, linear, angular } = this.follower;
    const tick = this.hand.tick({ time: this.time, X_BH: pose, linear, angular, buttons: this.isHeld ? 1 : 0, isReleased: !this.isHeld });
    this.X_WT = tick.X_WT;
    this.last = tick;
    this.addSample(tick);
  }

  private addSample(tick: Tick): void {
    if (this.samples.length >= KEPT_SAMPLES) {
      this.firstSample += this.samples.length;
      this.samples = [];
    }
    const volume = this.contact.volume();
    this.samples.push([
      this.time, ...tick.force, ...tick.torque, ...tick.contactForce, ...tick.contactTorque, volume, 1000 * this.perTick, 0,
      0, tick.stretch, tick.gain, tick.energy, ...tick.X_WT, ...tick.X_WT_hand, this.contact.bodiesVolume()]);
  }

  /** Sends a picture if the page has drawn the last one, and the state four times a second. Pictures become rarer while ticks are delayed. */
  send(): void {
    if (this.time >= this.nextState) {
      this.nextState = this.time + 0.25;
      this.out.text(this.state());
    }
    if (this.acknowledged < this.picture || !(this.show.frames || this.show.contacts || this.show.samples)) return;
    const { time, pause, areTooMany } = this.pictures, now = performance.now();
    if (now - time < pause) return;
    this.pictures = { time: now, pause: areTooMany ? Math.min(LONGEST_PAUSE, 1.5 * pause + 5) : 0.95 * pause, areTooMany: false };
    if (this.show.frames && this.hasNewFrame) {
      this.hasNewFrame = false;
      const image = this.images[(this.frameNumber - 1) % this.images.length];
      this.out.binary(frameMessage(this.frameNumber, this.time, image));
    }
    if (this.show.contacts) {
      this.contact.measure(this.scene, this.X_WT, { spheres: true });
      this.out.binary(contactMessage(this.contacts, this.time, this.X_WT, this.contact, this.object ? [this.object.pose(this.settings)] : []));
    }
    if (this.show.samples && this.samples.length > 0) {
      const start = this.samples[0][0];
      for (const sample of this.samples) sample[0] -= start;
      this.out.binary(samplesMessage(this.firstSample, start, this.samples));
      this.firstSample += this.samples.length;
      this.samples = [];
    }
    this.out.text({ type: 'picture', number: ++this.picture });
  }
}
