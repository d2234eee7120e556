// The 3-D part of the page: draws decoded messages (thesis section 4.4). Moving parts are written into
// existing buffers; nothing is allocated per picture.

import { Color, Group, Matrix4, Quaternion, Scene, Vector3 } from 'three';
import { defaultOptions } from '../options';
import type {
  ArrowScale, Contact, Edges, Frame, Grasp, Graph, Hello, Mesh, Normals, PictureAxes, Pose, Sample, SceneView, Spheres, Tree,
} from '../types';
import { Arrows } from './arrows';
import { Cameras } from './cameras/cameras';
import { heat, THEMES } from './colors';
import { Distances } from './distances';
import { CutOutline } from './tool/cut_outline';
import { DepthCamera } from './cameras/depth_camera';
import { EdgeMarks } from './tool/edges';
import { framing } from './framing';
import { cameraNames } from './cameras/frustum';
import type { ViewOf } from './cameras/views';
import { Ghost } from './tool/ghost';
import { Gauge } from './gauge';
import { Governor } from './governor';
import { LeafGraph } from './tool/graph';
import { Landmarks } from './landmarks';
import { Objects } from './objects';
import { NO_POSE, sampledPose, sampledVector, setPose, transformed } from './poses';
import { createRenderer } from './renderer';
import { Rings } from './tool/rings';
import { ToolSpheres } from './tool/spheres';
import { Spring } from './spring';
import { ToolMesh } from './tool/tool_mesh';
import { Trace } from './tool/trace';
import { TreeNodes } from './tool/tree';

/** Pose of a tool alone: y up as in mesh viewers, half a turn about x in W. */
const UPRIGHT: Pose = { position: [0, 0, 0], quaternion: [1, 0, 0, 0] };
/** s: age of the last contact from which samples give the tool's pose instead. */
const CONTACT_IS_OLD = 0.5;
/** Radii of the tool, from its center, from which on the cloud fades. */
const FADES_FROM = 4;

class View implements SceneView {
  readonly options = defaultOptions();
  private readonly renderer;
  private readonly cameras;
  private readonly governor;
  private readonly scene = new Scene();
  private readonly tool = new Group(); // everything in T
  private readonly ground = new Color();

  private sensors: DepthCamera[] = [];
  private readonly distances = new Distances();
  private readonly edges = new EdgeMarks();
  private readonly spheres = new ToolSpheres();
  private readonly graph = new LeafGraph();
  private readonly tree = new TreeNodes();
  private readonly mesh = new ToolMesh();
  private readonly objects = new Objects();
  private readonly outline = new CutOutline();
  private readonly ghost = new Ghost(this.mesh);
  private readonly arrows = new Arrows();
  private readonly spring = new Spring();
  private readonly rings = new Rings();
  private readonly trace = new Trace();
  private readonly landmarks = new Landmarks();
  private readonly gauge = new Gauge();

  private hello: Hello | null = null;
  private X_WT: Pose | null = null;
  private X_WT_hand: Pose | null = null;
  private contact: Contact | null = null;
  private strain = 0;
  private push: Vector3 | null = null; // direction of the last force on the tool
  private framed: 'nothing' | 'scene' | 'tool' = 'nothing';
  private sawNothing = false; // the framing had no measurement
  private framedSensors = 0;  // cameras with an image when framed
  private size: [number, number] = [1, 1]; // CSS pixels
  private pixelRatio = 1;
  private drawnRatio = 0;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.renderer = createRenderer(canvas);
    this.cameras = new Cameras(canvas);
    this.governor = new Governor(this.renderer.getContext() as WebGL2RenderingContext);
    this.tool.add(this.spheres.object, this.mesh.object, this.graph.object, this.tree.object,
      this.outline.object);
    this.scene.add(this.tool, this.objects.object,
      this.ghost.object, this.arrows.object, this.spring.object, this.rings.object, this.trace.object,
      this.landmarks.object);
    this.resize(canvas.clientWidth, canvas.clientHeight, 1);
    canvas.addEventListener('webglcontextrestored', () => requestAnimationFrame(() => this.render()));
  }

  setHello(hello: Hello): void {
    this.hello = hello;
    this.X_WT = this.X_WT_hand = this.contact = this.push = null;
    this.spring.object.visible = false;
    this.ghost.throughAll = hello.handle !== null;
    this.setStrain(0);
    setPose(this.tool, NO_POSE);
    this.trace.clear();
    this.objects.setMeshes([]);
    this.objects.setPoses([]);
    this.ghost.setPoses(NO_POSE, NO_POSE);
    this.arrows.setTool(hello.tool.radius, hello.tool.center_of_mass, hello.handle !== null);
    this.makeSensors(hello);
    this.landmarks.setHello(hello);
    this.cameras.setHello(hello);
    this.spheres.setCameras(hello.streams.length);
    this.framed = 'nothing';
    this.sawNothing = false;
    this.framedSensors = 0;
    if (hello.streams.length === 0) this.setToolPose(UPRIGHT);
  }

  setSpheres(spheres: Spheres): void {
    this.spheres.setSpheres(spheres);
    this.graph.setSpheres(spheres, this.spheres.stateArray);
    this.ghost.setTool(spheres, this.hello?.tool.radius ?? 0.1);
    if (this.contact) this.setContact(this.contact);
  }

  setGraph(graph: Graph): void {
    this.graph.setGraph(graph);
  }

  setMesh(mesh: Mesh): void {
    this.mesh.setMesh(mesh);
    this.outline.setMesh(mesh);
  }

  setObjects(meshes: Mesh[]): void {
    this.objects.setMeshes(meshes);
  }

  setTree(tree: Tree): void {
    this.tree.setTree(tree);
  }

  setFrame(frame: Frame): void {
    const sensor = this.sensors[frame.camera];
    if (!sensor) return;
    sensor.setFrame(frame);
    if (frame.camera === 0) this.cameras.setSensorPose(frame.X_WC);
    this.frameOnce();
  }

  setContact(contact: Contact): void {
    this.contact = contact;
    this.setToolPose(contact.X_WT);
    this.objects.setPoses(contact.objects);
    // A tool alone touches nothing: its spheres have no state.
    if (this.sensors.length > 0 && this.spheres.setContact(contact)) this.graph.statesChanged();
  }

  setCut(n: readonly number[], d: number): void {
    this.spheres.cut(n, d);
    this.outline.setPlane(n, d);
  }

  setNormals(normals: Normals): void {
    this.sensors[0]?.image.setNormals(normals);
  }

  setEdges(edges: Edges): void {
    this.edges.setEdges(edges);
  }

  setArrowScale(scale: ArrowScale): void {
    this.arrows.setScale(scale);
  }

  addSamples(samples: Sample[]): void {
    const center = this.hello?.tool.center_of_mass ?? [0, 0, 0];
    for (const sample of samples) {
      const X_WT = this.trace.isDue(sample.time) && sampledPose(sample, 'tool');
      if (X_WT) this.trace.add(sample.time, transformed(X_WT, center));
    }
    const last = samples.at(-1);
    const X_WT = (last && sampledPose(last, 'tool')) ?? this.X_WT;
    if (!last || !X_WT) return;
    if (last.time - (this.contact?.time ?? -Infinity) > CONTACT_IS_OLD) this.setToolPose(X_WT);
    const X_WT_hand = this.X_WT_hand = sampledPose(last, 'hand');
    const force = sampledVector(last, 'contact_force');
    this.push = force.lengthSq() > 0 ? force.normalize() : null;
    this.arrows.setSample(last, X_WT, X_WT_hand);
    this.setHandle(X_WT);
    this.ghost.setPoses(X_WT, X_WT_hand ?? X_WT);
  }

  resize(width: number, height: number, pixelRatio: number): void {
    this.size = [Math.max(1, width), Math.max(1, height)];
    this.pixelRatio = pixelRatio;
    this.drawnRatio = 0;
    this.cameras.resize(...this.size);
  }

  render(): void {
    this.governor.begin();
    this.update();
    const { camera } = this.cameras, { options } = this;
    const isLit = this.isStaged && options.cloud && options.cloudColor === 'shaded' && this.governor.isLit;
    this.distances.draw(this.renderer, this.scene, camera, isLit, this.drawnRatio);
    this.renderer.render(this.scene, camera);
    const scale = this.cameras.metersPerPixel(this.size[1]);
    const turned = this.sensors.length > 0 ? new Quaternion() : this.tool.quaternion;
    if (scale && this.hello) this.gauge.draw(this.renderer, camera, this.size, scale, turned, options.dark);
    this.governor.end();
  }

  picture(): Promise<Blob> {
    this.render();
    // In the task of the drawing: the browser clears the canvas after it.
    return new Promise((resolve, reject) => {
      this.canvas.toBlob((blob) => (blob ? resolve(blob) : reject(new Error('The picture could not be made.'))));
    });
  }

  resetView(): void {
    const found = this.framing();
    this.cameras.frame(found);
    this.framed = this.X_WT ? 'tool' : 'scene';
    this.sawNothing = this.sensors.length > 0 && !found.hasScene;
    this.framedSensors = this.numSeeing;
  }

  project(x: number, y: number, z: number): [number, number] {
    this.cameras.update(this.options.view);
    return this.toPixels(new Vector3(x, y, z));
  }

  get handPose(): Pose | null {
    return this.X_WT_hand;
  }

  graspAt(x: number, y: number, reach: number): Grasp | null {
    this.cameras.update(this.options.view);
    const ring = this.rings.grasp(x, y, reach, (p) => this.toPixels(p));
    if (ring || !this.X_WT) return ring;
    const { camera } = this.cameras;
    const at = (depth: number) => new Vector3((2 * x) / this.size[0] - 1, 1 - (2 * y) / this.size[1], depth);
    const origin = at(-1).unproject(camera), direction = at(0.5).unproject(camera).sub(origin).normalize();
    const inverse = this.tool.matrix.compose(this.tool.position, this.tool.quaternion, this.tool.scale).clone().invert();
    const margin = reach * this.pictureAxes().perPixel;
    origin.applyMatrix4(inverse);
    direction.transformDirection(inverse);
    return this.spheres.isMet(origin, direction, margin) ? { kind: 'tool' } : null;
  }

  pictureAxes(): PictureAxes {
    this.cameras.update(this.options.view);
    const { camera } = this.cameras;
    const center = this.handCenter() ?? new Vector3(0, 0, 1);
    const [right, up, back] = [0, 1, 2].map((i) => new Vector3().setFromMatrixColumn(camera.matrixWorld, i).normalize());
    const eye = new Vector3().setFromMatrixPosition(camera.matrixWorld);
    const sight = center.clone().sub(eye);
    const away = 'isPerspectiveCamera' in camera ? sight.clone().normalize() : back.clone().negate();
    const step = 1e-3, [u0, v0] = this.toPixels(center), [u1, v1] = this.toPixels(center.clone().addScaledVector(right, step));
    const perPixel = step / Math.max(1e-6, Math.hypot(u1 - u0, v1 - v0));
    return { right, up, away, perPixel, distance: Math.min(2, sight.length()) };
  }

  projectHand(): [number, number] {
    const center = this.handCenter();
    return center ? this.toPixels(center) : [0, 0];
  }

  setHeld(isHeld: boolean): void {
    this.rings.object.visible = isHeld;
  }

  setGrasp(grasp: Grasp | null): void {
    this.rings.point(grasp);
  }

  setStrain(share: number): void {
    this.mesh.strain = share;
    this.strain = share;
  }

  dispose(): void {
    for (const part of [...this.sensors, this.edges, this.spheres, this.graph, this.tree,
      this.distances, this.mesh, this.objects, this.outline, this.ghost, this.arrows, this.spring, this.rings, this.trace, this.landmarks, this.gauge, this.cameras,
      this.renderer]) {
      part.dispose();
    }
  }

  private update(): void {
    const { options, renderer } = this;
    const ratio = this.pixelRatio * this.governor.finer;
    if (ratio !== this.drawnRatio) {
      this.drawnRatio = ratio;
      renderer.setPixelRatio(ratio);
      renderer.setSize(...this.size, false);
    }
    renderer.setClearColor(this.ground.set(THEMES[options.dark ? 'dark' : 'light'].ground));
    const { width, height } = this.canvas;
    const center = this.toolCenter();
    if (center) this.distances.uniforms.focus.value.set(...center.toArray(), this.isStaged ? FADES_FROM * (this.hello?.tool.radius ?? 0) : 0);
    const views = this.sensors.map(({ image, object }): ViewOf => [image, new Matrix4().copy(object.matrixWorld).invert()]);
    this.mesh.setViews(views, this.hello?.tool.radius ?? 0.1);
    for (const sensor of this.sensors) sensor.update(this.sensors, options, this.governor.coarser, height, ratio);
    this.edges.update(options);
    this.spheres.update(options);
    this.mesh.update(options);
    this.objects.update(options);
    this.graph.update(options);
    this.tree.update(options);
    this.ghost.update(options.ghost);
    this.arrows.update(options.arrows, options.dark);
    this.trace.update(options.trace, width, height, ratio);
    this.landmarks.update(options);
    this.cameras.update(options.view);
  }

  /** True in the views that show the contact rather than the scene: the rest stands back. */
  private get isStaged(): boolean {
    return this.options.view === 'free' || this.options.view === 'tool';
  }

  private setToolPose(X_WT: Pose): void {
    this.X_WT = X_WT;
    setPose(this.tool, X_WT);
    const center = this.toolCenter();
    if (!this.hello || !center) return;
    this.cameras.setToolCenter(center);
    for (const { cloud } of this.sensors) cloud.setTool(center, this.hello.tool.radius);
    this.frameOnce();
  }

  /** Tool's center of mass in W; null until it is known. */
  private toolCenter(): Vector3 | null {
    return this.X_WT && this.hello ? transformed(this.X_WT, this.hello.tool.center_of_mass) : null;
  }

  private toPixels(p_W: Vector3): [number, number] {
    const p = this.cameras.project(p_W.clone());
    return [(0.5 + 0.5 * p.x) * this.size[0], (0.5 - 0.5 * p.y) * this.size[1]];
  }

  private handCenter(): Vector3 | null {
    return this.X_WT_hand && this.hello ? transformed(this.X_WT_hand, this.hello.tool.center_of_mass) : null;
  }

  /** Places the rings and the spring of a tool that pages can hold. */
  private setHandle(X_WT: Pose): void {
    const held = this.handCenter();
    if (!this.hello?.handle || !held || !this.X_WT_hand) return;
    const { center_of_mass: center, radius } = this.hello.tool;
    this.rings.place(held, new Quaternion(...this.X_WT_hand.quaternion), radius);
    this.spring.set(held, transformed(X_WT, center), radius, heat(this.strain));
  }

  /** Frames the scene once it is there, then the tool in it, unless the person has moved the view. */
  private frameOnce(): void {
    if (!this.hello || this.cameras.moved) return;
    const numSeeing = this.numSeeing;
    const hasScene = numSeeing > 0 || this.sensors.length === 0;
    const step = this.X_WT && hasScene ? 'tool' : hasScene ? 'scene' : 'nothing';
    // A camera may begin with empty images: frame again once there is a measurement.
    const appears = this.sawNothing && this.framing().hasScene;
    const isNew = step !== this.framed && this.framed !== 'tool';
    if (step !== 'nothing' && (isNew || appears || numSeeing > this.framedSensors)) this.resetView();
  }

  private get numSeeing(): number {
    return this.sensors.filter((sensor) => sensor.isSeeing).length;
  }

  /** Makes one depth camera per stream and drops the previous ones. */
  private makeSensors({ streams }: Hello): void {
    for (const sensor of this.sensors) {
      this.scene.remove(sensor.object);
      sensor.dispose();
    }
    const names = cameraNames(streams);
    this.sensors = streams.map((stream, i) => new DepthCamera(stream, streams.length > 1 ? names[i] : '',
      streams.length, this.distances.uniforms));
    this.edges.setStream(streams[0] ?? null);
    this.sensors[0]?.object.add(this.edges.needles, this.edges.panes);
    if (this.sensors.length > 0) this.scene.add(...this.sensors.map((sensor) => sensor.object));
  }

  private framing() {
    return framing(this.sensors, this.toolCenter(), this.hello?.tool.radius ?? 0.1, this.push);
  }
}

/** Throws if the browser lacks WebGL 2. */
export function createScene(canvas: HTMLCanvasElement): SceneView {
  return new View(canvas);
}
