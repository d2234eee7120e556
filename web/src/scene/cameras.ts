// The four views. W is the frame of the depth camera (x right, y down, z forward), so up is -y.

import { MathUtils, OrthographicCamera, PerspectiveCamera, Quaternion, Vector3 } from 'three';
import { OrbitControls } from 'three/addons/controls/OrbitControls.js';
import type { CameraView, Hello } from '../types';
import type { Framing } from './framing';

const FIELD_OF_VIEW = 42; // degrees, of the shorter side of the canvas
/// From what is looked at to the eye, beside the direction to the depth camera: over its right
/// shoulder.
const SHOULDER = new Vector3(0.55, -0.5, 0);
const FROM_THE_SIDE = new Vector3(0.55, -0.45, -0.75); // of a tool alone
const ABOVE = 15; // m, of the bird

export class Cameras {
  private readonly eye = new PerspectiveCamera(FIELD_OF_VIEW);
  private readonly sensor = new PerspectiveCamera();
  private readonly bird = new OrthographicCamera();
  private readonly orbit: OrbitControls;
  private readonly birdControls: OrbitControls;
  private stream: Hello['stream'] = null;
  private aspect = 1;
  private view: CameraView = 'free';
  private tool = new Vector3(); // centre of mass in W
  private toolRadius = 0.1;
  /// Somebody has moved the free view or the bird's.
  moved = false;

  constructor(canvas: HTMLCanvasElement) {
    this.eye.up.set(0, -1, 0);
    this.eye.position.set(0.3, -0.3, -0.3);
    this.orbit = new OrbitControls(this.eye, canvas);
    this.orbit.target.set(0, 0, 1);
    this.orbit.enableDamping = true;
    this.orbit.dampingFactor = 0.15;
    this.orbit.zoomToCursor = true;
    this.orbit.minDistance = 0.005;
    this.orbit.maxDistance = 30;
    // Away from the depth camera is up in the bird's view.
    this.bird.up.set(0, 0, 1);
    this.bird.position.set(0, -ABOVE, 1);
    this.birdControls = new OrbitControls(this.bird, canvas);
    this.birdControls.target.set(0, 0, 1);
    this.birdControls.enableRotate = false;
    this.birdControls.screenSpacePanning = true;
    this.birdControls.enabled = false;
    this.birdControls.mouseButtons.LEFT = this.birdControls.mouseButtons.RIGHT;
    this.birdControls.touches.ONE = this.birdControls.touches.TWO;
    for (const controls of [this.orbit, this.birdControls]) {
      controls.addEventListener('start', () => { this.moved = true; });
    }
    // The sensor looks along z with y down: half a turn about x from how three.js looks.
    this.sensor.quaternion.copy(new Quaternion(1, 0, 0, 0));
  }

  /// As the view is now; update() first.
  get camera(): PerspectiveCamera | OrthographicCamera {
    if (this.view === 'bird') return this.bird;
    return this.view === 'camera' && this.stream ? this.sensor : this.eye;
  }

  setHello(hello: Hello): void {
    this.stream = hello.stream;
    this.toolRadius = hello.tool.radius;
    this.moved = false;
  }

  resize(width: number, height: number): void {
    this.aspect = width / Math.max(1, height);
    // A narrow canvas shows as much from left to right as a wide one from top to bottom.
    const half = Math.tan(MathUtils.degToRad(FIELD_OF_VIEW / 2)) / Math.min(1, this.aspect);
    this.eye.fov = 2 * MathUtils.radToDeg(Math.atan(half));
  }

  /// Of mass, in W. The tool's view goes along.
  setToolCentre(centre: Vector3): void {
    if (this.view === 'tool') {
      const moved = centre.clone().sub(this.tool);
      this.eye.position.add(moved);
      this.orbit.target.add(moved);
    }
    this.tool.copy(centre);
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
      this.birdControls.update();
    } else {
      this.fitSensor();
    }
    this.camera.updateMatrixWorld();
  }

  frame({ centre, radius, farthest }: Framing): void {
    this.moved = false;
    const hasScene = farthest > 0;
    const direction = hasScene ? centre.clone().normalize().negate().add(SHOULDER) : FROM_THE_SIDE.clone();
    const distance = radius / Math.sin(MathUtils.degToRad(FIELD_OF_VIEW / 2));
    this.orbit.target.copy(centre);
    this.eye.position.copy(centre).add(direction.setLength(distance));
    this.orbit.update();
    if (this.view === 'tool') this.approachTool();
    this.frameBird(centre, radius, farthest);
  }

  /// On a canvas from -1 to 1.
  project(point: Vector3): Vector3 {
    return point.project(this.camera);
  }

  dispose(): void {
    this.orbit.dispose();
    this.birdControls.dispose();
  }

  private approachTool(): void {
    const direction = this.eye.position.clone().sub(this.orbit.target);
    this.orbit.target.copy(this.tool);
    this.eye.position.copy(this.tool).add(direction.setLength(4.5 * this.toolRadius));
    this.orbit.update();
  }

  /// From the depth camera to the far end of the scene; or the tool alone.
  private frameBird(centre: Vector3, radius: number, farthest: number): void {
    const middle = farthest > 0 ? new Vector3(0, 0, 0.5 * farthest) : centre;
    const breadth = this.stream ? this.stream.width / this.stream.fx : 1;
    const high = farthest > 0 ? 0.55 * farthest : 1.2 * radius;
    const half = Math.max(high, (high * breadth) / this.aspect);
    const { bird } = this;
    bird.top = half;
    bird.bottom = -half;
    bird.left = -half * this.aspect;
    bird.right = half * this.aspect;
    bird.near = 0.01;
    bird.far = 2 * ABOVE;
    bird.zoom = 1;
    bird.updateProjectionMatrix();
    bird.position.set(middle.x, centre.y - ABOVE, middle.z);
    this.birdControls.target.set(middle.x, centre.y, middle.z);
    this.birdControls.update();
  }

  /// The whole image, as large as it fits. Pixel centres are at whole numbers.
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
