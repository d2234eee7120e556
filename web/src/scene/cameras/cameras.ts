// The four views. Up is the first depth camera's up (x right, y down, z forward) when the view was framed,
// because the axes of W are arbitrary.

import { MathUtils, OrthographicCamera, PerspectiveCamera, Quaternion, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import type { CameraView, Hello, Pose, Stream } from '../../types';
import type { Framing } from '../framing';
import { inverted, NO_POSE, setPose, transformed } from '../poses';

const FIELD_OF_VIEW = 42; // degrees, of the shorter side of the canvas
/** The eye is beside what pushes the tool out, on the right of the depth camera: shares of directions to the right,
 * up, along the push, and to the depth camera. */
const BESIDE = { right: 1, up: 0.3, push: 0.25, camera: 0.35 };
const FROM_THE_SIDE = new Vector3(0.55, -0.45, -0.75); // for a tool alone
const ABOVE = 15; // m, height of the bird's view

export class Cameras {
  private readonly eye = new PerspectiveCamera(FIELD_OF_VIEW);
  private readonly sensor = new PerspectiveCamera();
  private readonly bird = new OrthographicCamera();
  private orbit: OrbitControls;
  private birdControls: OrbitControls;
  private birdSees = { high: 1, wide: 1 }; // half extents, m
  private stream: Stream | null = null; // first depth camera
  private X_WC: Pose = NO_POSE;         // of the first depth camera
  private aspect = 1;
  private view: CameraView = 'free';
  private tool = new Vector3(); // center of mass in W
  private toolRadius = 0.1;
  /** The person has moved the free or the bird's view. */
  moved = false;

  constructor(private readonly canvas: HTMLCanvasElement) {
    this.eye.up.set(0, -1, 0);
    this.eye.position.set(0.3, -0.3, -0.3);
    this.orbit = this.makeOrbit();
    // The bird's up points away from the depth camera.
    this.bird.up.set(0, 0, 1);
    this.bird.position.set(0, -ABOVE, 1);
    this.birdControls = this.makeBirdControls();
    this.setSensorPose(NO_POSE);
  }

  /** Camera of the current view; call update() first. */
  get camera(): PerspectiveCamera | OrthographicCamera {
    if (this.view === 'bird') return this.bird;
    return this.view === 'camera' && this.stream ? this.sensor : this.eye;
  }

  setHello(hello: Hello): void {
    this.stream = hello.streams[0] ?? null;
    this.setSensorPose(NO_POSE);
    this.toolRadius = hello.tool.radius;
    this.moved = false;
  }

  resize(width: number, height: number): void {
    this.aspect = width / Math.max(1, height);
    // The field of view holds for the shorter side of the canvas.
    const half = Math.tan(MathUtils.degToRad(FIELD_OF_VIEW / 2)) / Math.min(1, this.aspect);
    this.eye.fov = 2 * MathUtils.radToDeg(Math.atan(half));
  }

  /** Sets the pose of the first depth camera. */
  setSensorPose(X_WC: Pose): void {
    this.X_WC = X_WC;
    setPose(this.sensor, X_WC);
    // The sensor looks along z with y down: half a turn about x from three.js.
    this.sensor.quaternion.multiply(new Quaternion(1, 0, 0, 0));
  }

  /** Sets the tool's center of mass in W. The tool's view follows it. */
  setToolCenter(center: Vector3): void {
    if (this.view === 'tool') {
      const moved = center.clone().sub(this.tool);
      this.eye.position.add(moved);
      this.orbit.target.add(moved);
    }
    this.tool.copy(center);
  }

  update(view: CameraView): void {
    if (view !== this.view) {
      this.view = view;
      if (view === 'tool') this.approachTool();
    }
    const free = this.camera === this.eye;
    this.orbit.enabled = free;
    this.birdControls.enabled = this.view === 'bird';
    if (free) {
      this.orbit.update();
      const distance = this.eye.position.distanceTo(this.orbit.target);
      this.eye.aspect = this.aspect;
      this.eye.near = Math.min(0.02, Math.max(0.0005, 0.01 * distance));
      this.eye.far = 40;
      this.eye.updateProjectionMatrix();
    } else if (this.view === 'bird') {
      this.fitBird();
      this.birdControls.update();
    } else {
      this.fitSensor();
    }
    this.camera.updateMatrixWorld();
  }

  frame(found: Framing): void {
    const { center, radius, hasScene } = found;
    this.moved = false;
    this.takeUp();
    const direction = hasScene ? this.beside(found) : this.turned(FROM_THE_SIDE);
    const distance = radius / Math.sin(MathUtils.degToRad(FIELD_OF_VIEW / 2));
    this.orbit.target.copy(center);
    this.eye.position.copy(center).add(direction.setLength(distance));
    this.orbit.update();
    if (this.view === 'tool') this.approachTool();
    this.frameBird(found);
  }

  /** Projects a point of W to the canvas, -1 to 1. */
  project(point: Vector3): Vector3 {
    return point.project(this.camera);
  }

  dispose(): void {
    this.orbit.dispose();
    this.birdControls.dispose();
  }

  /** Returns the length in W of a CSS pixel where one looks at; null from the depth camera, where it means nothing. */
  metersPerPixel(height: number): number | null {
    if (this.camera === this.bird) return (2 * this.bird.top) / this.bird.zoom / height;
    if (this.camera !== this.eye) return null;
    return (2 * this.eye.position.distanceTo(this.orbit.target) * Math.tan(MathUtils.degToRad(this.eye.fov / 2))) / height;
  }

  /** Returns the direction from the tool to the eye. */
  private beside({ center, push }: Framing): Vector3 {
    const camera = new Vector3(...this.X_WC.position).sub(center).normalize();
    const right = this.turned(new Vector3(1, 0, 0)), up = this.turned(new Vector3(0, -1, 0));
    const out = push ?? camera, side = right.clone().addScaledVector(out, -right.dot(out));
    if (side.length() < 0.3) side.copy(up.clone().addScaledVector(out, -up.dot(out)));
    return side.normalize().multiplyScalar(BESIDE.right).addScaledVector(up, BESIDE.up).addScaledVector(out, BESIDE.push)
      .addScaledVector(camera, BESIDE.camera);
  }

  private approachTool(): void {
    const direction = this.eye.position.clone().sub(this.orbit.target);
    this.orbit.target.copy(this.tool);
    this.eye.position.copy(this.tool).add(direction.setLength(4.5 * this.toolRadius));
    this.orbit.update();
  }

  /** Frames the scene from the depth cameras to its far end, or the tool alone. */
  private frameBird({ center, radius, hasScene, across, along }: Framing): void {
    const center_C = inverted(this.X_WC, center);
    const [x, z] = hasScene ? [0.5 * (across[0] + across[1]), 0.5 * (along[0] + along[1])] : [center_C.x, center_C.z];
    const breadth = this.stream ? this.stream.width / this.stream.fx : 1;
    const high = hasScene ? 0.55 * (along[1] - along[0]) : 1.2 * radius;
    const wide = high * breadth + (hasScene ? 0.5 * (across[1] - across[0]) : 0);
    this.birdSees = { high, wide };
    const { bird } = this;
    bird.near = 0.01;
    bird.far = 2 * ABOVE;
    bird.zoom = 1;
    this.fitBird();
    bird.position.copy(transformed(this.X_WC, [x, center_C.y - ABOVE, z]));
    this.birdControls.target.copy(transformed(this.X_WC, [x, center_C.y, z]));
    this.birdControls.update();
  }

  private fitBird(): void {
    const { bird, birdSees: { high, wide }, aspect } = this;
    bird.top = Math.max(high, wide / aspect);
    bird.bottom = -bird.top;
    bird.right = bird.top * aspect;
    bird.left = -bird.right;
    bird.updateProjectionMatrix();
  }

  /** Transforms a direction from the first depth camera to W. */
  private turned(direction: Vector3): Vector3 {
    return direction.clone().applyQuaternion(new Quaternion(...this.X_WC.quaternion));
  }

  /** Sets up to the first depth camera's current up; three.js reads it when controls are made. */
  private takeUp(): void {
    const up = this.turned(new Vector3(0, -1, 0));
    if (up.distanceTo(this.eye.up) < 1e-6 && this.turned(new Vector3(0, 0, 1)).distanceTo(this.bird.up) < 1e-6) return;
    this.eye.up.copy(up);
    this.bird.up.copy(this.turned(new Vector3(0, 0, 1)));
    this.dispose();
    this.orbit = this.makeOrbit();
    this.birdControls = this.makeBirdControls();
  }

  private makeOrbit(): OrbitControls {
    const orbit = new OrbitControls(this.eye, this.canvas);
    orbit.target.set(0, 0, 1);
    orbit.enableDamping = true;
    orbit.dampingFactor = 0.15;
    orbit.zoomToCursor = true;
    orbit.minDistance = 0.005;
    orbit.maxDistance = 30;
    orbit.addEventListener('start', () => { this.moved = true; });
    return orbit;
  }

  private makeBirdControls(): OrbitControls {
    const controls = new OrbitControls(this.bird, this.canvas);
    controls.target.set(0, 0, 1);
    controls.enableRotate = false;
    controls.screenSpacePanning = true;
    controls.enabled = false;
    controls.mouseButtons.LEFT = controls.mouseButtons.RIGHT;
    controls.touches.ONE = controls.touches.TWO;
    controls.addEventListener('start', () => { this.moved = true; });
    return controls;
  }

  /** Fits the whole depth image into the canvas. Pixel centers are at whole numbers. */
  private fitSensor(): void {
    const { width, height, fx, fy, cx, cy } = this.stream!;
    const near = 0.01;
    let left = (-0.5 - cx) / fx, right = (width - 0.5 - cx) / fx;
    let top = (cy + 0.5) / fy, bottom = (cy + 0.5 - height) / fy;
    const wider = this.aspect / ((right - left) / (top - bottom));
    if (wider > 1) {
      const more = 0.5 * (right - left) * (wider - 1);
      left -= more;
      right += more;
    } else {
      const more = 0.5 * (top - bottom) * (1 / wider - 1);
      bottom -= more;
      top += more;
    }
    this.sensor.projectionMatrix.makePerspective(left * near, right * near, top * near, bottom * near, near, 40);
    this.sensor.projectionMatrixInverse.copy(this.sensor.projectionMatrix).invert();
  }
}
