// A depth camera in the scene: its point cloud, unseen space, normals and frustum.

import { Group, Matrix4 } from 'three';
import type { Frame, Pose, SceneOptions, Stream } from '../../types';
import { Cloud } from './cloud';
import { DepthImage } from './depth_image';
import { Fog } from './fog';
import { Frustum } from './frustum';
import { NormalNeedles } from './normals';
import type { Uniforms } from '../glsl';
import { NO_POSE, setPose } from '../poses';

export class DepthCamera {
  readonly object = new Group(); // everything in C
  readonly image: DepthImage;
  readonly cloud: Cloud;
  X_WC: Pose = NO_POSE;
  private readonly normals: NormalNeedles;
  private readonly fog: Fog;
  private readonly frustum: Frustum;
  private readonly X_LC = new Matrix4();

  /** `name` to display, empty for a single camera; `numCameras` in all; `stage`: the uniforms of Distances. */
  constructor(stream: Stream, name: string, numCameras: number, stage: Uniforms) {
    this.image = new DepthImage(stream, numCameras);
    this.cloud = new Cloud(this.image, stage);
    this.normals = new NormalNeedles(this.image);
    this.fog = new Fog(this.image);
    this.frustum = new Frustum(stream, name);
    this.object.add(this.cloud.object, this.normals.object, this.fog.object, this.frustum.object);
  }

  get isSeeing(): boolean {
    return this.image.number >= 0;
  }

  setFrame(frame: Frame): void {
    this.X_WC = frame.X_WC;
    setPose(this.object, frame.X_WC);
    this.object.updateMatrixWorld();
    this.image.setFrame(frame);
    this.cloud.setFrame(frame);
  }

  /** Updates all parts; the light is at the first of `cameras`. Other parameters as in Cloud.update. */
  update(cameras: DepthCamera[], options: SceneOptions, coarser: number, height: number, pixelRatio: number): void {
    const first = cameras[0], isFirst = this === first;
    // Exactly the identity for the first camera.
    if (isFirst) this.X_LC.identity();
    else this.X_LC.copy(first.object.matrixWorld).invert().multiply(this.object.matrixWorld);
    this.cloud.setLight(this.X_LC, first.cloud.depths);
    this.cloud.update(options, coarser, height, pixelRatio);
    this.normals.update(options.normals);
    this.fog.update(options.fog, options.fog ? this.seenFrom(cameras) : [], pixelRatio);
    this.frustum.update(options.dark);
    // Hidden: the camera of the current view, and cameras without a known pose.
    this.frustum.object.visible = isFirst ? options.view !== 'camera' : this.isSeeing;
  }

  dispose(): void {
    for (const part of [this.image, this.cloud, this.normals, this.fog, this.frustum]) part.dispose();
  }

  /** Returns the images of the other cameras with this camera's pose in them. */
  private seenFrom(cameras: DepthCamera[]): [DepthImage, Matrix4][] {
    return cameras.filter((other) => other !== this).map((other) =>
      [other.image, other.object.matrixWorld.clone().invert().multiply(this.object.matrixWorld)]);
  }
}
