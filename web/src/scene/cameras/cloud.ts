// The point cloud: the depth image drawn as points without a vertex buffer. Vertex number i is
// the i-th pixel of a coarser or finer raster over the image. A point is a disc in the surface, as large as
// the gap to its neighbors there, so that surfaces are closed also where they are seen from the side. Far
// from the tool the cloud fades into the background. One draw call, and a second small
// one for the window: in front of the tool only one point of four is drawn, which shows the part
// of the tool inside the scene. The tool has marked that region in the stencil (glsl.ts).

import {
  BufferGeometry, Group, Matrix4, Points, type RawShaderMaterial, type ShaderMaterialParameters, Vector2, type Vector3, Vector4,
} from 'three';
import type { Frame, SceneOptions } from '../../types';
import { rgb, THEMES } from '../colors';
import { DEPTH_IMAGE, type DepthImage } from './depth_image';
import { DepthRange } from './depth_range';
import { EYE_DOME } from '../distances';
import { DISTANCES, OUT_OF_WINDOW, shaderMaterial, type Uniforms, VIRIDIS, WITHIN_WINDOW } from '../glsl';

const COLORINGS = { shaded: 0, depth: 1, normals: 2 };

const VERTEX = `${DEPTH_IMAGE}${VIRIDIS}
uniform int stride, columns, coloring;
uniform float point_size;   // smallest, in pixels of the canvas
uniform float spread;       // share of the gap to the next point that a point covers
uniform float canvas_height;
uniform vec2 depth_range;   // m
uniform vec3 surface_color;
uniform vec4 tool_ball;     // bounding sphere of the tool, in W; radius 0: no window
uniform mat4 X_LC;          // L: the first camera, which defines light and colors of all clouds
uniform bool plain;         // only distances matter
uniform vec4 focus;         // in W, and the distance from which on the cloud fades, m; 0: nowhere
uniform vec3 ground_color;
out vec3 point_color;
flat out vec3 disc;         // its normal in the view frame
flat out float disc_size;   // pixels of the canvas

// True if the ray from the eye through a point of the view frame meets the tool's ball.
bool meets_tool(vec3 p) {
  vec3 to_center = (viewMatrix * vec4(tool_ball.xyz, 1.0)).xyz - p;
  vec3 ray = is_orthographic() ? vec3(0.0, 0.0, -1.0) : normalize(p);
  float along = dot(to_center, ray);
  return dot(to_center, to_center) - along * along < tool_ball.w * tool_ball.w;
}

void main() {
  ivec2 pixel = stride * ivec2(gl_VertexID % columns, gl_VertexID / columns);
  float z = depth_at(pixel);
  if (z == 0.0) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  z = calm_depth_at(pixel, z);
  vec3 p = point_at(pixel, z);
  vec4 p_view = modelViewMatrix * vec4(p, 1.0);
  if (tool_ball.w > 0.0 && !meets_tool(p_view.xyz)) { gl_Position = vec4(0.0, 0.0, 2.0, 1.0); return; }
  gl_Position = projectionMatrix * p_view;
  // Distance between neighboring points, in pixels of the canvas.
  float gap = float(stride) * z / intrinsics.x * projectionMatrix[1][1] * 0.5 * canvas_height / gl_Position.w;
  vec3 n = plain ? vec3(0.0) : normal_at(pixel, z);
  bool has_normal = n != vec3(0.0);
  if (has_normal) gap /= max(0.4, abs(dot(n, normalize(p))));
  gl_PointSize = disc_size = clamp(spread * gap, point_size, 64.0);
  disc = has_normal ? normalize(mat3(modelViewMatrix) * n) : vec3(0.0, 0.0, 1.0);
  if (plain) return;

  n = mat3(X_LC) * n;
  if (coloring == 1) {
    point_color = viridis(1.0 - clamp(((X_LC * vec4(p, 1.0)).z - depth_range.x) / (depth_range.y - depth_range.x), 0.0, 1.0));
    point_color *= 0.7 + 0.3 * abs(n.z);
  } else if (coloring == 2) {
    point_color = n == vec3(0.0) ? vec3(0.3) : 0.5 - 0.5 * vec3(-n.x, n.y, n.z);
  } else {
    // The light is fixed above and to the left of the first camera, and soft: one also looks at what faces away from it.
    float light = 0.5 + 0.5 * dot(n, vec3(-0.41, -0.50, -0.763));
    point_color = surface_color * (n == vec3(0.0) ? 0.4 : 0.32 - 0.12 * n.y + 0.6 * light * light);
    float far_off = distance((modelMatrix * vec4(p, 1.0)).xyz, focus.xyz);
    if (focus.w > 0.0) point_color = mix(point_color, ground_color, 0.8 * smoothstep(focus.w, 3.0 * focus.w, far_off));
  }
}
`;

const FRAGMENT = `${EYE_DOME}
in vec3 point_color;
flat in vec3 disc;
flat in float disc_size;
uniform bool plain;

void main() {
  vec2 c = vec2(2.0, -2.0) * gl_PointCoord + vec2(-1.0, 1.0);
  float along = dot(c, disc.xy) / max(0.35, abs(disc.z));
  if (disc_size > 3.0 && dot(c, c) + along * along > 1.0) discard;
  color = vec4(plain ? vec3(0.0) : point_color * eye_dome(), 1.0);
}
`;

export class Cloud {
  readonly object = new Group();
  private readonly uniforms: Uniforms;
  private readonly parts: Part[];
  private readonly range = new DepthRange();

  /** `stage`: the uniforms of Distances. */
  constructor(private readonly image: DepthImage, stage: Uniforms) {
    this.uniforms = {
      ...image.uniforms, ...stage, ground_color: { value: rgb(THEMES.dark.ground) },
      coloring: { value: 0 }, point_size: { value: 2 }, canvas_height: { value: 1 },
      depth_range: { value: new Vector2() }, X_LC: { value: new Matrix4() }, surface_color: { value: rgb(THEMES.dark.surface) },
    };
    this.parts = [new Part(this.uniforms, OUT_OF_WINDOW), new Part(this.uniforms, WITHIN_WINDOW)];
    this.object.add(...this.parts.map((part) => part.object));
  }

  setFrame(frame: Frame): void {
    this.range.update(frame);
  }

  /** Sets the bounding sphere of the tool, in W: elsewhere there is no window. */
  setTool(center: Vector3, radius: number): void {
    (this.parts[1].object.material.uniforms.tool_ball.value as Vector4).set(...center.toArray(), radius);
  }

  /** Depth range of most of this camera's image, m. */
  get depths(): [near: number, far: number] {
    return [this.range.near, this.range.far + 1e-3];
  }

  /** Sets this camera's pose in the first camera and the depth range of the colors. */
  setLight(X_LC: Matrix4, depths: [near: number, far: number]): void {
    (this.uniforms.X_LC.value as Matrix4).copy(X_LC);
    (this.uniforms.depth_range.value as Vector2).set(...depths);
  }

  /** `coarser`: factor of the governor on the stride. `height` of the canvas, in its own pixels. */
  update(options: SceneOptions, coarser: number, height: number, pixelRatio: number): void {
    const { image, uniforms } = this;
    this.object.visible = options.cloud && image.number >= 0;
    uniforms.coloring.value = COLORINGS[options.cloudColor];
    uniforms.point_size.value = options.pointSize * pixelRatio;
    uniforms.canvas_height.value = height;
    const { surface, ground } = THEMES[options.dark ? 'dark' : 'light'];
    uniforms.surface_color.value = rgb(surface);
    uniforms.ground_color.value = rgb(ground);
    const stride = Math.max(1, Math.round(options.stride)) * coarser;
    // Discs of two pixels and more cover the surface without gaps at any distance.
    const spread = 0.75 * options.pointSize;
    this.parts[0].update(image, stride, spread);
    // The glow of a solid tool is seen as a whole.
    this.parts[1].object.visible = options.toolLook === 'spheres' || options.toolLook === 'caps';
    this.parts[1].update(image, 2 * stride, spread / 2);
  }

  dispose(): void {
    for (const part of this.parts) part.dispose();
  }
}

/** Points inside or outside the window. */
class Part {
  readonly object: Points<BufferGeometry, RawShaderMaterial>;

  constructor(uniforms: Uniforms, window: ShaderMaterialParameters) {
    this.object = new Points(new BufferGeometry(), shaderMaterial({
      ...uniforms, stride: { value: 1 }, columns: { value: 1 }, spread: { value: 1 },
      tool_ball: { value: new Vector4(0, 0, 0, 0) },
    }, VERTEX, FRAGMENT, window));
    this.object.frustumCulled = false;
    this.object.renderOrder = -1; // drawn after the tool
    this.object.layers.enable(DISTANCES);
  }

  update(image: DepthImage, stride: number, spread: number): void {
    const columns = Math.ceil(image.width / stride), rows = Math.ceil(image.height / stride);
    this.object.geometry.setDrawRange(0, columns * rows);
    const u = this.object.material.uniforms;
    u.stride.value = stride;
    u.columns.value = columns;
    u.spread.value = spread;
  }

  dispose(): void {
    this.object.geometry.dispose();
    this.object.material.dispose();
  }
}
